// Interactive plots: choose what is shown, zoom, read values, list them. Everything is drawn from the JSON that stands
// in the page; texts are set as text, never as markup; nothing is fetched.
const LISTED = 200;

class Plot {
  constructor(section, data) {
    this.data = data;
    this.key = data.key;
    this.hidden = new Set();
    this.x = null;
    this.y = [];
    this.cursor = null;
    this.build(section);
    this.choose();
    new ResizeObserver(() => { if (this.canvas.clientWidth !== this.width) this.draw(); }).observe(this.canvas);
    section.querySelector("details").addEventListener("toggle", () => this.list());
  }

  build(section) {
    this.controls = section.querySelector(".controls");
    this.selects = this.data.choices.map((choice) => {
      const label = make(this.controls, "label", {}, `${choice.name} `);
      const select = make(label, "select", { name: choice.name });
      for (const option of choice.options) make(select, "option", { value: option }, option);
      select.addEventListener("change", () => this.choose());
      return select;
    });
    const buttons = make(this.controls, "span", { class: "buttons", role: "group", "aria-label": "Zoom" });
    const button = (text, name, action) => {
      const element = make(buttons, "button", { type: "button", "aria-label": name, title: name }, text);
      element.addEventListener("click", action);
    };
    button("+", "Zoom in", () => this.zoom(0.5));
    button("−", "Zoom out", () => this.zoom(2));
    button("◀", "Move left", () => this.pan(-0.25));
    button("▶", "Move right", () => this.pan(0.25));
    button("Reset", "Show everything", () => this.reset());
    this.legend = section.querySelector(".legend");
    this.canvas = section.querySelector(".canvas");
    this.canvas.addEventListener("keydown", (event) => this.pressed(event));
    this.output = section.querySelector("output");
    this.facts = section.querySelector(".facts");
    this.table = section.querySelector(".values");
    this.details = section.querySelector("details");
    this.note = section.querySelector(".note");
  }

  choose() {
    const chosen = this.selects.map((select) => select.value);
    this.view = this.data.views.find((view) => view.chosen.every((option, i) => option === chosen[i])) || null;
    const first = this.view && this.view.panels[0];
    // the same x means the same zoom, so that two views can be compared
    if (!first || first.x !== this.label) this.x = null;
    this.label = first ? first.x : null;
    this.y = [];
    this.cursor = null;
    this.names = first ? [...new Set(this.view.panels.flatMap((p) => p.series.map((s) => s.name)))] : [];
    this.offer();
    this.tell();
    this.draw();
    this.list();
    this.note.textContent = this.view ? this.view.note : "";
    this.output.textContent = this.view ? "" : "Nothing was recorded for this choice.";
  }

  // The same plot with new values: what is hidden, zoomed or read stays, and nothing is taken from under a pointer.
  renew(data) {
    if (this.dragging) return;
    const names = this.names.join("\n"), units = (view) => view.panels.map((p) => p.y).join("\n"), before = this.view;
    this.data = data;
    this.view = data.views.find((view) => view.chosen.every((option, i) => option === this.selects[i].value));
    if (units(before) !== units(this.view)) this.y = [];
    this.names = [...new Set(this.view.panels.flatMap((p) => p.series.map((s) => s.name)))];
    if (this.names.join("\n") !== names) this.offer();
    this.note.textContent = this.view.note;
    this.tell();
    this.draw();
    if (this.details.open) this.list();
  }

  offer() {
    clear(this.legend);
    this.names.forEach((name, i) => {
      const label = make(this.legend, "label");
      const box = make(label, "input", { type: "checkbox" });
      box.checked = !this.hidden.has(name);
      box.addEventListener("change", () => {
        if (box.checked) this.hidden.delete(name); else this.hidden.add(name);
        this.draw();
        this.list();
      });
      const swatch = make(label, "svg:svg", { width: 28, height: 10, "aria-hidden": "true" });
      if (this.named(name).some((s) => s.kind === "points")) dot(swatch, i, 14, 5, 3, this.colour(i));
      else make(swatch, "svg:line", { x1: 0, x2: 28, y1: 5, y2: 5, stroke: this.colour(i), "stroke-width": 2,
        "stroke-dasharray": this.dash(i) });
      make(label, "span", {}, name);
    });
  }

  tell() {
    clear(this.facts);
    if (!this.view) return;
    const { heads, rows } = this.view.facts;
    const head = make(make(make(this.facts, "thead"), "tr"), "th", { scope: "col" }, heads[0]).parentNode;
    for (const text of heads.slice(1)) make(head, "th", { scope: "col", class: "number" }, text);
    const body = make(this.facts, "tbody");
    for (const [name, ...values] of rows) {
      const row = make(body, "tr");
      make(row, "th", { scope: "row" }, name);
      for (const value of values) {
        const cell = make(row, "td", { class: "number" });
        make(cell, "data", { value: value === null ? "" : String(value) }, number(value, 4));
      }
    }
  }

  named(name) { return this.view.panels.flatMap((p) => p.series.filter((s) => s.name === name)); }
  // what is measured and what is noise looks the same in every plot, whatever is drawn beside it
  own(i) { return (this.named(this.names[i]).find((s) => s.colour) || {}).colour; }
  colour(i) { return this.own(i) ? `var(--${this.own(i)})` : `var(--curve-${1 + (i % COLOURS)})`; }
  dash(i) { return this.own(i) === "ink" ? "" : dash(i); }
  shown(panel) { return panel.series.filter((s) => !this.hidden.has(s.name)); }
  scale(panel) { return panel.log ? Math.log10 : (v) => v; }
  rise(panel) { return panel.log_y ? Math.log10 : (v) => v; }
  unscale(panel) { return panel.log ? (v) => 10 ** v : (v) => v; }

  extent(panel) {
    const to = this.scale(panel);
    let low = Infinity, high = -Infinity;
    for (const p of this.view.panels)
      for (const s of p.series)
        for (const v of s.x) {
          const room = s.kind === "bars" ? 0.5 : 0;
          low = Math.min(low, to(v) - room); high = Math.max(high, to(v) + room);
        }
    return low < high ? [low, high] : [low - 1, high + 1];
  }

  reach(panel, i) {
    if (this.y[i]) return this.y[i];
    if (!this.x && panel.range) return panel.range;
    const to = this.scale(panel), up = this.rise(panel), [left, right] = this.x || this.extent(panel);
    let low = Infinity, high = -Infinity;
    for (const s of this.shown(panel)) {
      if (s.kind === "bars" && !panel.log_y) low = Math.min(low, 0);
      s.x.forEach((v, k) => {
        if (s.y[k] === null || to(v) < left || to(v) > right) return;
        low = Math.min(low, up(s.y[k])); high = Math.max(high, up(s.y[k]));
      });
    }
    if (!(low <= high)) return panel.range || [-1, 1];
    const margin = 0.05 * (high - low) || 0.05 * Math.abs(high) || 1;
    return [low - margin, high + margin];
  }

  draw() {
    const width = this.canvas.clientWidth;
    if (!width) return;
    this.width = width;
    clear(this.canvas);
    this.frames = [];
    if (!this.view) return;
    const height = Math.round(Math.min(Math.max(width * 0.42, 210), 310));
    this.view.panels.forEach((panel, i) => this.panel(panel, i, width, height));
    this.mark();
  }

  panel(panel, i, width, height) {
    const last = i === this.view.panels.length - 1;
    const bottom = last ? MARGIN.bottom : 8;
    const total = height - MARGIN.bottom + bottom;
    const names = this.shown(panel).map((s) => `${s.name} (${s.x.length} points)`).join(", ");
    const svg = make(this.canvas, "svg:svg", { width, height: total, viewBox: `0 0 ${width} ${total}`, class: "panel",
      role: "img", "aria-label": `${panel.y} over ${panel.x}: ${names || "nothing"}` });
    const box = { left: MARGIN.left, top: MARGIN.top, width: width - MARGIN.left - MARGIN.right,
      height: total - MARGIN.top - bottom };
    const [left, right] = this.x || this.extent(panel), [low, high] = this.reach(panel, i);
    const to = this.scale(panel), up = this.rise(panel);
    const px = (v) => box.left + ((to(v) - left) / (right - left)) * box.width;
    const py = (v) => box.top + ((high - up(v)) / (high - low)) * box.height;
    const clip = `${this.key}-clip-${i}`;
    make(make(make(svg, "svg:defs"), "svg:clipPath", { id: clip }), "svg:rect",
      { x: box.left, y: box.top, width: box.width, height: box.height });
    this.axes(svg, panel, box, { left, right, low, high, px, py, last, width, total });
    const inside = make(svg, "svg:g", { "clip-path": `url(#${clip})` });
    if (panel.band) {
      const [from, until] = panel.band;
      make(inside, "svg:rect", { class: `band ${panel.band_colour || ""}`, x: box.left, width: box.width, y: py(until),
        height: Math.max(py(from) - py(until), 0) });
    }
    for (const s of this.shown(panel)) this.curve(inside, s, panel, px, py);
    const frame = { svg, panel, box, px, py, left, right, low, high };
    this.frames.push(frame);
    this.pointer(frame, i);
  }

  axes(svg, panel, box, at) {
    const marks = panel.names ? panel.names.map((_, k) => k).filter((k) => k >= at.left && k <= at.right)
      : ticks(at.left, at.right, panel.log, box.width / 90);
    for (const v of marks) {
      const x = at.px(v), text = panel.names ? panel.names[v] : number(v);
      if (!panel.names) make(svg, "svg:line", { class: "grid", x1: x, x2: x, y1: box.top, y2: box.top + box.height });
      const inside = Math.min(x, at.width - 4 * text.length); // half of it: the last number is not cut off
      if (at.last) make(svg, "svg:text", { x: inside, y: box.top + box.height + 15, "text-anchor": "middle" }, text);
    }
    for (const v of ticks(at.low, at.high, panel.log_y, box.height / 34)) {
      const y = at.py(v);
      make(svg, "svg:line", { class: "grid", x1: box.left, x2: box.left + box.width, y1: y, y2: y });
      make(svg, "svg:text", { x: box.left - 6, y: y + 4, "text-anchor": "end" }, number(v));
    }
    make(svg, "svg:rect", { class: "frame", x: box.left, y: box.top, width: box.width, height: box.height });
    if (at.last) make(svg, "svg:text", { x: box.left + box.width / 2, y: at.total - 6, "text-anchor": "middle" }, panel.x);
    make(svg, "svg:text", { x: 0, y: 14 }, panel.y);
  }

  curve(parent, series, panel, px, py) {
    const i = this.names.indexOf(series.name), colour = this.colour(i);
    if (series.kind === "points") {
      series.x.forEach((v, k) => dot(parent, i, px(v).toFixed(2), py(series.y[k]).toFixed(2), 2.2, colour));
      return;
    }
    if (series.kind === "bars") {
      const beside = panel.series.filter((s) => s.kind === "bars").map((s) => s.name);
      const width = (px(1) - px(0)) * (0.8 / beside.length), start = (beside.indexOf(series.name) - beside.length / 2) * width;
      series.x.forEach((v, k) => make(parent, "svg:rect", { x: (px(v) + start).toFixed(2), y: py(series.y[k]).toFixed(2),
        width: (0.94 * width).toFixed(2), height: 2000, fill: colour })); // down to the frame, which cuts it off
      return;
    }
    const there = (k) => k >= 0 && series.y[k] !== null; // a line ends at a gap and begins anew behind it
    const path = series.x.map((v, k) => (there(k) ? `${there(k - 1) ? "L" : "M"}${px(v).toFixed(2)} ${py(series.y[k]).toFixed(2)}` : "")).join("");
    make(parent, "svg:path", { d: path, stroke: colour, class: "curve", "stroke-dasharray": this.dash(i) });
  }

  pointer(frame, i) {
    let from = null, mark = null;
    const local = (event) => {
      const area = frame.svg.getBoundingClientRect();
      return [event.clientX - area.left, event.clientY - area.top];
    };
    const at = (x, y) => [
      frame.left + ((x - frame.box.left) / frame.box.width) * (frame.right - frame.left),
      frame.high - ((y - frame.box.top) / frame.box.height) * (frame.high - frame.low),
    ];
    frame.svg.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      from = local(event);
      this.dragging = true;
      frame.svg.setPointerCapture(event.pointerId);
      mark = make(frame.svg, "svg:rect", { class: "select", width: 0, height: 0 });
    });
    frame.svg.addEventListener("pointermove", (event) => {
      const [x, y] = local(event);
      if (!from) { this.cursor = at(x, y)[0]; this.mark(); return; }
      mark.setAttribute("x", Math.min(x, from[0]));
      mark.setAttribute("y", Math.min(y, from[1]));
      mark.setAttribute("width", Math.abs(x - from[0]));
      mark.setAttribute("height", Math.abs(y - from[1]));
    });
    const end = (event) => {
      if (!from) return;
      this.dragging = false;
      const [x, y] = local(event), [x0, y0] = from;
      from = null;
      mark.remove();
      if (event.type !== "pointerup" || Math.abs(x - x0) < 8) return;
      const a = at(x0, y0), b = at(x, y);
      this.x = [Math.min(a[0], b[0]), Math.max(a[0], b[0])];
      this.y = [];
      // a flat stroke chooses x alone and lets y follow what is left to see
      if (Math.abs(y - y0) >= 20) this.y[i] = [Math.min(a[1], b[1]), Math.max(a[1], b[1])];
      this.draw();
      this.list();
    };
    frame.svg.addEventListener("pointerup", end);
    frame.svg.addEventListener("pointercancel", end);
    frame.svg.addEventListener("dblclick", () => this.reset());
  }

  pressed(event) {
    const actions = {
      "+": () => this.zoom(0.5), "=": () => this.zoom(0.5), "-": () => this.zoom(2), "0": () => this.reset(),
      ArrowLeft: () => (event.shiftKey ? this.step(-1) : this.pan(-0.25)),
      ArrowRight: () => (event.shiftKey ? this.step(1) : this.pan(0.25)),
    };
    if (event.ctrlKey || event.metaKey || event.altKey || !actions[event.key] || !this.view) return;
    event.preventDefault();
    actions[event.key]();
  }

  within(left, right) {
    const [first, last] = this.extent(this.view.panels[0]);
    const width = Math.min(right - left, last - first);
    const start = Math.min(Math.max(left, first), last - width);
    this.x = width >= last - first ? null : [start, start + width];
    this.y = [];
    this.draw();
    this.list();
  }

  zoom(factor) {
    if (!this.view) return;
    const [left, right] = this.x || this.extent(this.view.panels[0]);
    const held = this.cursor !== null && this.cursor > left && this.cursor < right ? this.cursor : (left + right) / 2;
    this.within(held - (held - left) * factor, held + (right - held) * factor);
  }

  pan(share) {
    if (!this.view) return;
    const [left, right] = this.x || this.extent(this.view.panels[0]);
    this.within(left + share * (right - left), right + share * (right - left));
  }

  reset() { this.x = null; this.y = []; this.draw(); this.list(); }
  nearest(series, panel, at) {
    const to = this.scale(panel);
    let best = -1, distance = Infinity;
    series.x.forEach((v, k) => { const d = Math.abs(to(v) - at); if (d < distance) { distance = d; best = k; } });
    return best;
  }

  step(direction) {
    if (!this.view) return;
    const panel = this.view.panels[0], series = this.shown(panel)[0];
    if (!series) return;
    const [left, right] = this.x || this.extent(panel), to = this.scale(panel);
    const from = this.cursor === null ? (left + right) / 2 : this.cursor;
    const next = Math.min(Math.max(this.nearest(series, panel, from) + direction, 0), series.x.length - 1);
    this.cursor = to(series.x[next]);
    this.mark();
  }

  mark() {
    if (this.cursor === null || !this.frames) return;
    const said = [];
    this.frames.forEach((frame, i) => {
      frame.svg.querySelectorAll(".cursor").forEach((old) => old.remove());
      const x = frame.box.left + ((this.cursor - frame.left) / (frame.right - frame.left)) * frame.box.width;
      if (x < frame.box.left || x > frame.box.left + frame.box.width) return;
      make(frame.svg, "svg:line", { class: "cursor", x1: x, x2: x, y1: frame.box.top,
        y2: frame.box.top + frame.box.height });
      const at = this.unscale(frame.panel)(this.cursor), names = frame.panel.names;
      if (i === 0) said.push(`${frame.panel.x}: ${names ? names[Math.round(at)] || "" : number(at, 4)}`);
      const values = this.shown(frame.panel).map((s) => {
        const k = this.nearest(s, frame.panel, this.cursor);
        return k < 0 ? null : `${s.name} ${number(s.y[k], 4)}`;
      });
      said.push(`${frame.panel.y}: ${values.filter((v) => v).join(", ")}`);
    });
    this.output.textContent = said.join(" · ");
  }

  list() {
    clear(this.table);
    if (!this.details.open || !this.view) return;
    const head = make(make(this.table, "thead"), "tr");
    for (const text of ["quantity", "curve"]) make(head, "th", { scope: "col" }, text);
    for (const text of [this.view.panels[0].x, "value"]) make(head, "th", { scope: "col", class: "number" }, text);
    const body = make(this.table, "tbody");
    for (const panel of this.view.panels) {
      const to = this.scale(panel), [left, right] = this.x || this.extent(panel);
      for (const s of this.shown(panel)) {
        const seen = s.x.map((v, k) => k).filter((k) => to(s.x[k]) >= left && to(s.x[k]) <= right);
        const every = Math.ceil(seen.length / LISTED);
        for (const k of seen.filter((_, n) => n % every === 0)) {
          const row = make(body, "tr");
          make(row, "th", { scope: "row" }, panel.y);
          make(row, "td", {}, s.name);
          make(row, "td", { class: "number" }, panel.names ? panel.names[s.x[k]] || "" : number(s.x[k], 6));
          make(row, "td", { class: "number" }, number(s.y[k], 6));
        }
      }
    }
  }
}

const plots = [];
for (const section of document.querySelectorAll(".explorer")) {
  section.hidden = false; // first: what is hidden has no width to draw on
  const plot = new Plot(section, JSON.parse(section.querySelector("script").textContent));
  plots.push(plot);
  section.querySelector(".download").addEventListener("click", () => {
    plot.details.open = true;
    plot.list();
    const quoted = (text) => (/[",\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text);
    const lines = ["quantity,curve,x,y"];
    for (const panel of plot.view ? plot.view.panels : [])
      for (const s of plot.shown(panel)) s.x.forEach((v, k) => lines.push([quoted(panel.y), quoted(s.name), v, s.y[k]].join(",")));
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([lines.join("\n") + "\n"], { type: "text/csv" }));
    link.download = `${plot.key}.csv`;
    link.click();
    URL.revokeObjectURL(link.href);
  });
}
// on paper nothing can be unfolded
addEventListener("beforeprint", () => document.querySelectorAll("details.folded, details.terms").forEach((d) => { d.open = true; }));
document.documentElement.classList.add("live");
