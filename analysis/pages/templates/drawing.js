// What the interactive plots are drawn with: elements, numbers as text, and round values along an axis.
const SVG = "http://www.w3.org/2000/svg";
const DASHES = ["", "7 3", "2 3", "9 3 2 3", "4 2", "1 2"];
const MARGIN = { left: 46, right: 12, top: 22, bottom: 40 };

const make = (parent, name, attributes = {}, text = null) => {
  const element = name.startsWith("svg:")
    ? document.createElementNS(SVG, name.slice(4)) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== null) element.textContent = text;
  parent.append(element);
  return element;
};
const clear = (element) => { while (element.firstChild) element.firstChild.remove(); };

function number(value, digits = 5) {
  if (value === null) return "—";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e6 || size < 1e-4
    ? value.toExponential(digits - 1).replace(/\.?0*e\+?/, "e") : String(Number(value.toPrecision(digits)));
  return text.replaceAll("-", "−");
}

function ticks(low, high, log, room) {
  if (!log) {
    const rough = (high - low) / Math.max(room, 2);
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough * 0.999);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) found.push(k * step);
    return found;
  }
  if (high - low < 0.7) return ticks(10 ** low, 10 ** high, false, room).filter((v) => v > 0);
  const inside = (steps) => {
    const found = [];
    for (let d = Math.floor(low); d <= Math.ceil(high); d += 1)
      for (const m of steps) {
        const at = Math.log10(m) + d;
        if (at >= low - 1e-9 && at <= high + 1e-9) found.push(m * 10 ** d);
      }
    return found;
  };
  const fine = inside([1, 2, 5]);
  return fine.length <= room + 2 ? fine : inside([1]);
}
