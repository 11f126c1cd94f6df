// What the interactive plots are drawn with: elements, numbers as text, and round values along an axis.
const SVG = "http://www.w3.org/2000/svg";
const DASHES = ["", "7 3", "2 3", "9 3 2 3", "4 2", "9 3 2 3 2 3", "16 4"];
const COLOURS = DASHES.length;
// the eighth curve has the first colour again, and another dash
const dash = (i) => DASHES[(i + Math.floor(i / COLOURS)) % COLOURS];
const MARKS = [ // as wide as a circle of radius 1 about (0, 0)
  null, "M-0.9 -0.9H0.9V0.9H-0.9Z", "M0 -1.2L1.1 0.8H-1.1Z", "M0 -1.3L1.1 0L0 1.3L-1.1 0Z", "M0 1.2L1.1 -0.8H-1.1Z",
  "M-0.4 -1.2H0.4V-0.4H1.2V0.4H0.4V1.2H-0.4V0.4H-1.2V-0.4H-0.4Z", "M-1.2 -0.7L-0.7 -1.2L1.2 0.7L0.7 1.2ZM1.2 -0.7L0.7 -1.2L-1.2 0.7L-0.7 1.2Z",
];
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

const SUPERSCRIPT = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };

// A mark of its own for every colour: circles first.
function dot(parent, i, x, y, r, fill) {
  const shape = MARKS[i % MARKS.length];
  if (!shape) return make(parent, "svg:circle", { cx: x, cy: y, r, fill });
  return make(parent, "svg:path", { d: shape, class: "dot", fill, transform: `translate(${x} ${y}) scale(${r})` });
}

function number(value, digits = 5) {
  if (typeof value === "string") return value;
  if (value === null) return "—";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size < 1e6 && size >= 1e-4) return String(Number(value.toPrecision(digits))).replaceAll("-", "−");
  const [digit, power] = value.toExponential(digits - 1).replace(/\.?0*e\+?/, "e").split("e");
  return `${digit.replace("-", "−")}·10${[...power].map((c) => SUPERSCRIPT[c]).join("")}`;
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
