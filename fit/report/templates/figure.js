// Zoom and read-off for the figures of the report. A figure is the SVG that matplotlib drew; this script moves its
// curves and redraws its ticks. Axes tell where they are and what they measure in `data-axes` (fit/figures/files.py).
"use strict";
(() => {
const STYLE = `
.reading { display: block; min-height: 2.9em; font-size: .8rem; line-height: 1.45; color: var(--muted); font-variant-numeric: tabular-nums; }
.reading b { color: var(--ink); font-weight: 500; }
.plane { fill: transparent; cursor: crosshair; touch-action: pan-y; outline: none; }
.plane:focus-visible { stroke: var(--blue); stroke-width: 1.2; }
.cross { stroke: var(--ink); stroke-width: .5; pointer-events: none; } .dot { fill: var(--paper); stroke: var(--ink); stroke-width: 1; pointer-events: none; }
.chosen { fill: var(--blue); fill-opacity: .15; stroke: var(--blue); stroke-width: .5; pointer-events: none; }
.ticks line { stroke: var(--grid); stroke-width: .5; } .ticks text { fill: var(--muted); font: 7px system-ui, sans-serif; }
.zoomed [id*="tick_"], .zoomed [data-vanishes] { display: none; }
@media print { .reading, .cross, .dot, .chosen { display: none; } }`;
const HINT = "Move over the figure or tap it to read it off. Drag a rectangle to zoom, or click and turn the wheel; " +
  "double-click to go back. Keys: arrows, + and −, Escape.";
const clamp = (x, low, high) => Math.min(Math.max(x, low), high);

function element(parent, name, attributes = {}) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return parent.appendChild(made);
}

function superscript(n) {
  return String(n).replace(/./g, c => c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]);
}

function text(value, digits = 4) {
  if (value === 0) return "0";
  const exponent = Math.floor(Math.log10(Math.abs(value)) + 1e-9);
  if (exponent >= -3 && exponent < 5) return String(Number(value.toPrecision(digits))).replace("-", "−");
  const mantissa = Number((value / 10 ** exponent).toPrecision(digits));
  return (mantissa === 1 ? "10" : `${mantissa}·10`.replace("-", "−")) + superscript(exponent);
}

/** One direction of the axes. Place `u`: the value or its logarithm; share: from 0 to 1 of what is shown. */
class Axis {
  constructor({ limits, log, label, unit, ticks }, start, size) {
    Object.assign(this, { log, label, unit, ticks, start, size });
    this.whole = limits.map(x => this.u(x));
    [this.low, this.high] = this.whole;
  }
  u(value) { return this.log ? Math.log10(value) : value; }
  value(u) { return this.log ? 10 ** u : u; }
  share(at) { return this.low + (at - this.start) / this.size * (this.high - this.low); }
  at(u) { return this.start + (u - this.low) / (this.high - this.low) * this.size; }
  /** What was drawn at `a` in the whole picture is now at `k a + d`. */
  get move() {
    const k = (this.whole[1] - this.whole[0]) / (this.high - this.low);
    return [k, this.at(this.whole[0]) - k * this.start];
  }
  get zoomed() { return this.low !== this.whole[0] || this.high !== this.whole[1]; }
  show(low, high) {
    const [first, last] = this.whole, least = (last - first) * 1e-3;
    if (low > high) [low, high] = [high, low];
    if (high - low < least) [low, high] = [(low + high - least) / 2, (low + high + least) / 2];
    this.low = Math.max(low, first);
    this.high = Math.min(high, last);
  }
  scale(factor, u) { this.show(u + (this.low - u) * factor, u + (this.high - u) * factor); }
  reset() { [this.low, this.high] = this.whole; }
  /** Places and texts of the ticks: powers of ten, or round numbers where too few of them are shown. */
  list() {
    const [a, b] = [this.value(this.low), this.value(this.high)];
    if (this.log && this.high - this.low >= 1.5) {
      const every = Math.ceil((this.high - this.low) / 8), found = [];
      for (let n = Math.ceil(this.low - 1e-9); n <= this.high + 1e-9; n++)
        if (n % every === 0) found.push([n, "10" + superscript(n)]);
      return found;
    }
    const rough = (b - a) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find(n => n * power >= rough * .999);
    const digits = 1 + Math.max(0, Math.ceil(Math.log10(Math.max(Math.abs(a), Math.abs(b)) / step)));
    const found = [];
    for (let n = Math.ceil(a / step - 1e-9); n * step <= b * (1 + 1e-12); n++)
      found.push([this.u(n * step), text(n * step, digits)]);
    return found;
  }
}

class Curve {
  constructor(group) {
    this.name = group.dataset.curve;
    this.path = group.querySelector("path");
    this.drawn = [...this.path.getAttribute("d").matchAll(/([ML]) (-?[\d.]+) (-?[\d.]+)/g)]
      .map(([, command, x, y]) => [command, Number(x), Number(y)]);
    this.points = this.drawn.map(([, x, y]) => [x, y]);
  }
  move([kx, dx], [ky, dy]) {
    this.points = this.drawn.map(([, x, y]) => [kx * x + dx, ky * y + dy]);
    this.path.setAttribute("d", this.points.map(([x, y], i) => `${this.drawn[i][0]} ${x.toFixed(2)} ${y.toFixed(2)}`).join(" "));
  }
}

class Panel {
  constructor(group, figure) {
    const { box: [x, y, width, height], x: across, y: up } = JSON.parse(group.dataset.axes);
    Object.assign(this, { group, figure, box: { x, y, width, height } });
    this.x = new Axis(across, x, width);
    this.y = new Axis(up, y + height, -height);
    this.curves = [...group.querySelectorAll("[data-curve]")].map(g => new Curve(g));
    this.moving = [...group.querySelectorAll("[data-moves] :is(use, path)")].filter(e => !e.closest("defs"))
      .map(e => [e, e.localName === "path" ? e.getAttribute("d") : null]);
    this.plane = element(group, "rect", { ...this.box, class: "plane", tabindex: 0, role: "application",
      "aria-label": `${figure.svg.getAttribute("aria-label")}: ${up.label}`, "aria-description": HINT });
    this.listen();
  }
  listen() {
    const on = (type, then) => this.plane.addEventListener(type, then);
    this.touches = new Map();
    on("pointerdown", e => this.press(e));
    on("pointermove", e => this.drag(e));
    on("pointerup", e => this.release(e));
    on("pointercancel", e => { this.touches.delete(e.pointerId); this.figure.choose(null); this.from = null; });
    on("pointerleave", e => { if (!this.from && e.pointerType !== "touch") this.figure.clear(); });
    on("dblclick", () => this.figure.reset());
    on("blur", () => this.figure.clear());
    on("keydown", e => { if (this.press_key(e.key)) e.preventDefault(); });
    on("wheel", e => {
      if (document.activeElement !== this.plane && !e.ctrlKey) return;  // the page scrolls
      e.preventDefault();
      this.zoom(Math.exp(clamp(e.deltaY, -200, 200) / 400), this.place(e));
    });
  }
  place(event) {
    const at = new DOMPoint(event.clientX, event.clientY).matrixTransform(this.figure.svg.getScreenCTM().inverse());
    const { x, y, width, height } = this.box;
    return [clamp(at.x, x, x + width), clamp(at.y, y, y + height)];
  }
  press(event) {
    const at = this.place(event);
    this.touches.set(event.pointerId, at);
    if (event.pointerType === "touch") { this.read(at, this.nearest(at)); return; }
    this.from = at;
    this.plane.setPointerCapture(event.pointerId);
  }
  drag(event) {
    const at = this.place(event), before = this.touches.get(event.pointerId);
    if (before && this.touches.size === 2) this.pinch(event.pointerId, before, at);
    if (before) this.touches.set(event.pointerId, at);
    if (this.from) this.figure.choose(this.from, at);
    this.read(at, this.nearest(at));
  }
  release(event) {
    this.touches.delete(event.pointerId);
    if (!this.from) return;
    const [a, b] = [this.from, this.place(event)];
    this.from = null;
    this.figure.choose(null);
    const [wide, high] = [Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1])];
    if (wide < 4 && high < 4) return;
    if (wide >= 4) this.x.show(this.x.share(a[0]), this.x.share(b[0]));
    if (high >= 4) this.y.show(this.y.share(a[1]), this.y.share(b[1]));
    this.figure.draw(this);
  }
  pinch(id, before, at) {
    const [other] = [...this.touches].filter(([key]) => key !== id).map(([, place]) => place);
    const far = p => Math.hypot(p[0] - other[0], p[1] - other[1]);
    this.zoom(clamp(far(before) / Math.max(far(at), 1), .5, 2), other);
  }
  press_key(key) {
    const here = this.figure.reading, curve = here?.panel === this ? here.curve : this.curves.at(-1);
    const seen = curve.points.map((p, i) => [p, i]).filter(([p]) => this.inside(p));
    if (key === "Escape" || key === "0") this.figure.reset();
    else if (key === "+" || key === "=" || key === "-" || key === "−")
      this.zoom(key === "+" || key === "=" ? .7 : 1 / .7, here?.at ?? [this.box.x + this.box.width / 2, this.box.y + this.box.height / 2]);
    else if (key.startsWith("Arrow") && seen.length) {
      let index = here?.panel === this ? seen.findIndex(([, i]) => i >= here.index) : Math.floor(seen.length / 2);
      if (index < 0) index = seen.length - 1;
      if (key === "ArrowLeft" || key === "ArrowRight") {
        index = clamp(index + (here?.panel === this ? (key === "ArrowRight" ? 1 : -1) : 0), 0, seen.length - 1);
        this.read(seen[index][0], { curve, index: seen[index][1] });
      } else {
        const n = this.curves.length, next = this.curves[(this.curves.indexOf(curve) + (key === "ArrowUp" ? 1 : n - 1)) % n];
        const x = seen[index][0][0], distance = p => this.inside(p) ? Math.abs(p[0] - x) : Infinity;
        const best = next.points.reduce((b, p, i) => distance(p) < distance(next.points[b]) ? i : b, 0);
        this.read(next.points[best], { curve: next, index: best });
      }
    } else return false;
    return true;
  }
  inside([x, y]) {
    const b = this.box;
    return x >= b.x - .01 && x <= b.x + b.width + .01 && y >= b.y - .01 && y <= b.y + b.height + .01;
  }
  nearest([x, y]) {
    let found = null, least = Infinity;
    for (const curve of this.curves) curve.points.forEach((p, index) => {
      const distance = Math.hypot(p[0] - x, p[1] - y);
      if (distance < least && this.inside(p)) [found, least] = [{ curve, index }, distance];
    });
    return found;
  }
  zoom(factor, at) {
    this.x.scale(factor, this.x.share(at[0]));
    this.y.scale(factor, this.y.share(at[1]));
    this.figure.draw(this);
    this.read(at, this.nearest(at));
  }
  read(at, found) { this.figure.read(this, at, found); }
  draw() {
    const across = this.x.move, up = this.y.move;
    for (const curve of this.curves) curve.move(across, up);
    for (const [shape, d] of this.moving) {
      if (d === null) shape.setAttribute("transform", `matrix(${across[0]} 0 0 ${up[0]} ${across[1]} ${up[1]})`);
      else shape.setAttribute("d", d.replace(/(-?[\d.]+) (-?[\d.]+)/g, (_, x, y) => `${across[0] * x + across[1]} ${up[0] * y + up[1]}`));
    }
    const zoomed = this.x.zoomed || this.y.zoomed, { x, y, width, height } = this.box;
    this.group.classList.toggle("zoomed", zoomed);
    this.ticks?.remove();
    this.ticks = null;
    if (!zoomed) return;
    this.ticks = element(this.group, "g", { class: "ticks" });
    this.group.insertBefore(this.ticks, this.group.querySelector("[data-curve]"));
    for (const [u, label] of this.x.list()) {
      const at = this.x.at(u);
      element(this.ticks, "line", { x1: at, x2: at, y1: y, y2: y + height });
      if (!this.x.ticks) continue;
      const anchor = x + width - at < 6 ? "end" : "middle";  // nothing hangs over the edge of the figure
      element(this.ticks, "text", { x: anchor === "end" ? x + width + 5 : at, y: y + height + 9.5, "text-anchor": anchor }).textContent = label;
    }
    for (const [u, label] of this.y.list()) {
      const at = this.y.at(u);
      element(this.ticks, "line", { x1: x, x2: x + width, y1: at, y2: at });
      element(this.ticks, "text", { x: x - 4, y: at + 2.5, "text-anchor": "end" }).textContent = label;
    }
  }
}

class Figure {
  constructor(svg, hint) {
    Object.assign(this, { svg, hint });
    svg.setAttribute("role", "group");
    this.output = document.createElement("output");
    this.output.className = "reading";
    (svg.closest("figure") ?? svg.parentElement).append(this.output);
    this.panels = [...svg.querySelectorAll("[data-axes]")].map(group => new Panel(group, this));
    this.clear();
  }
  clear() {
    this.marks?.remove();
    this.reading = this.marks = null;
    this.output.textContent = this.hint;
  }
  choose(from, to) {
    this.chosen?.remove();
    this.chosen = from && element(this.svg, "rect", { class: "chosen", x: Math.min(from[0], to[0]), y: Math.min(from[1], to[1]),
      width: Math.abs(from[0] - to[0]), height: Math.abs(from[1] - to[1]) });
  }
  reset() {
    for (const panel of this.panels) { panel.x.reset(); panel.y.reset(); panel.draw(); }
    this.clear();
  }
  /** Redraw after `panel` has changed what it shows; panels above each other share their abscissa. */
  draw(panel) {
    for (const other of this.panels) { [other.x.low, other.x.high] = [panel.x.low, panel.x.high]; other.draw(); }
  }
  read(panel, at, found) {
    this.clear();
    this.reading = { panel, at, ...found };
    const { x, y, width, height } = panel.box, across = panel.x;
    this.marks = element(this.svg, "g");
    element(this.marks, "line", { class: "cross", x1: at[0], x2: at[0], y1: y, y2: y + height });
    element(this.marks, "line", { class: "cross", x1: x, x2: x + width, y1: at[1], y2: at[1] });
    const say = ([a, b]) => `${text(across.value(across.share(a)))} ${across.unit}, ${text(panel.y.value(panel.y.share(b)))} ${panel.y.unit}`;
    this.output.textContent = `${across.label} and ${panel.y.label} at the cross: ${say(at)}`;
    if (!found) return;
    const point = found.curve.points[found.index];
    element(this.marks, "circle", { class: "dot", cx: point[0], cy: point[1], r: 2 });
    const name = document.createElement("b");
    name.textContent = `${found.curve.name}: ${say(point)}`;
    this.output.prepend(name, document.createElement("br"));
  }
}

const style = document.createElement("style");
style.textContent = STYLE;
document.head.append(style);
const figures = [...document.querySelectorAll("svg")].filter(svg => svg.querySelector("[data-axes]"));
figures.forEach((svg, i) => new Figure(svg, i ? "" : HINT));  // told once
})();
