// The charts of the report. uPlot draws axes and curves, zooms and reads off; what it does not know is here: bands,
// error bars, shaded spans, panels that zoom together, keys, wheel, colour schemes and paper.
// What is drawn stands in a block of JSON in each chart (fit/report/charts.py).
"use strict";
(() => {
const HINT = "Drag to zoom, double-click to go back; click and turn the wheel. Keys: arrows, + and −, Escape. " +
  "A click on a name hides its curve.";
const FONT = "12px system-ui, 'Segoe UI', 'Helvetica Neue', Arial, sans-serif";
const DASHES = { "-": [], "--": [6, 4], ":": [2, 3] };
const root = document.documentElement;
let palette = {};
const colour = role => palette[role] ??= getComputedStyle(root).getPropertyValue(`--${role}`).trim();
const make = (name, parent, text = "", kind = "") => {
  const element = parent.appendChild(document.createElement(name));
  element.textContent = text;
  element.className = kind;
  return element;
};

function decoded(encoded) {
  if (Array.isArray(encoded)) return encoded;
  const bytes = Uint8Array.from(atob(encoded), c => c.charCodeAt(0));
  return Array.from(new Float32Array(bytes.buffer), x => Number.isNaN(x) ? null : x);
}

/** All curves of a panel over one x: rows in order of x, of each curve only its own, `undefined` elsewhere. */
function aligned(lines, arrays) {
  const rows = [...new Set(lines.map(line => line.x))].flatMap(k => arrays[k].map((x, i) => [x, k, i]));
  rows.sort((a, b) => a[0] - b[0]);
  const column = (line, key) => rows.map(([, k, i]) => k === line.x ? arrays[line[key]][i] : undefined);
  return [rows.map(row => row[0]), ...lines.map(line => {
    line.indices = rows.map(([, k, i]) => k === line.x ? i : -1);
    return column(line, "y");
  })];
}

class Chart {
  constructor(place) {
    this.place = place;
    Object.assign(this, JSON.parse(place.querySelector("script").textContent));
    this.arrays = this.arrays.map(decoded);
    this.key = uPlot.sync(Symbol("panels")).key;
    this.plots = this.panels.map((panel, i) => this.plot(panel, i));
    place.classList.add("drawn");
  }

  plot(panel, i) {
    const lines = panel.lines = panel.marks.filter(m => m.kind === "curve" || m.kind === "points");
    panel.last = i === this.panels.length - 1;
    const box = make("div", this.place, "", "panel");
    if (panel.title) make("div", box, "", "name").innerHTML = panel.title;  // escaped where it was made
    const options = {
      width: 300, height: 200, pxAlign: 0, legend: { markers: { show: false } }, padding: [8, this.aside, 0, 0],
      series: [{ label: panel.x.label, value: (u, x) => x == null ? "" : this.where(panel, x) },
        ...lines.map(line => this.series(panel, line))],
      scales: { x: this.scale(panel.x), y: { ...this.scale(panel.y), auto: false } },
      axes: [this.axis(panel, panel.x, 0), this.axis(panel, panel.y, 1)],
      cursor: {
        drag: { x: true, y: true, uni: 24, dist: 4 }, points: { size: 7, width: 1.5 }, y: false,
        sync: { key: this.key, scales: ["x", null], setSeries: false },
        dataIdx: (u, k, index, x) => nearest(u.data, k, index, x, panel.x.log),
        bind: { dblclick: () => () => this.reset() },
      },
      hooks: { drawAxes: [u => this.behind(u, panel)], draw: [u => this.infront(u, panel)] },
      tzDate: t => uPlot.tzDate(new Date(t * 1e3), "Etc/UTC"),
    };
    const plot = new uPlot(options, aligned(lines, this.arrays), box);
    for (const span of panel.marks.filter(m => m.kind === "span" && m.label)) {
      const name = make("th", make("tr", plot.root.querySelector(".u-legend tbody"), "", "u-series"));
      name.innerHTML = span.label;
      name.prepend(swatch(span));
    }
    this.listen(plot, panel);
    return plot;
  }

  scale({ log, dates, limits }) {
    const currentLimits = u => [u.scales.y.min ?? limits[0], u.scales.y.max ?? limits[1]];  // stays when curves come and go
    const range = (u, low, high) => !u.status ? limits : low == null ? currentLimits(u) : [low, high];
    return { time: dates, distr: log ? 3 : 1, range };
  }

  axis(panel, axis, side) {
    const rule = (role, width) => ({ stroke: () => colour(role), width });
    const options = {
      scale: side ? "y" : "x", side: side ? 3 : 2, stroke: () => colour("muted"), font: FONT, gap: 4,
      grid: { ...rule("grid", 1), filter: (u, places) => axis.log ? places.map(x => isDecade(x / axis.factor) ? x : null) : places },
      ticks: { ...rule("muted", 1), size: 5 },
      border: { show: true, ...rule("muted", 1) },
      size: side ? (u, texts) => 16 + 6.4 * Math.max(5, ...(texts ?? []).map(t => t?.length ?? 0)) : !panel.last ? 12 : axis.dates ? 40 : 28,
    };
    if (panel.last || side) Object.assign(options, { label: title(axis), labelFont: FONT, labelSize: 18, labelGap: 2 });
    if (axis.dates) return { ...options, values: (u, places, k, room, step) => panel.last ? days(places, step) : places.map(() => null) };
    const extent = u => (side ? u.bbox.height : u.bbox.width) / sharp;
    options.splits = (u, k, low, high) => axis.log ? decades(low, high) : rounds(low, high, extent(u) / (side ? 32 : 75));
    options.values = (u, places) => panel.last || side ? labels(axis, places, extent(u)) : places.map(() => null);
    options.filter = (u, places) => places;
    return options;
  }

  series(panel, line) {
    const label = document.createElement("span");
    label.innerHTML = line.label || "";  // escaped where it was made
    if (line.label) label.prepend(swatch(line));
    return {
      label, class: line.label ? line.kind : "unnamed", scale: "y", width: line.width * 1.4 || 0,
      stroke: () => colour(line.role) + alpha(line.opacity ?? 1), dash: DASHES[line.dash], pxAlign: 0,
      points: { show: false },
      paths: line.kind === "points" ? () => null : undefined, value: (u, y, k, index) => this.value(panel, line, y, index),
    };
  }

  where(panel, x) {
    if (panel.x.dates) return new Date(x * 1e3).toISOString().slice(0, 16).replace("T", " ");
    return `${printed(x / panel.x.factor)} ${panel.x.unit}`;
  }

  value(panel, line, y, index) {
    if (y == null) return "";
    const factor = panel.y.factor, i = line.indices[index];
    if (line.kind !== "points") return printed(y / factor);
    const halfWidth = (this.arrays[line.high][i] - this.arrays[line.low][i]) / 2 / factor;
    const reading = line.caps && halfWidth > 0 ? concise(y / factor, halfWidth) : printed(y / factor);
    return `${reading}${line.names[i] ? `  (${line.names[i]})` : ""}`;
  }

  /** Room for words beyond the right end, the same for all panels. */
  get aside() {
    return this.panels.some(p => p.marks.some(m => m.kind === "note" && m.x >= p.x.limits[1])) ? 70 : 18;
  }

  /** Give the panels the width of their place and, to fill a row, so much more height than they need. */
  size(extra = 0) {
    const width = this.width();
    this.plots.forEach((plot, i) => {
      const { height, last } = this.panels[i], scale = Math.min(180, Math.max(130, width / 3.375));
      const panelHeight = height * scale + (last ? 24 : 0) + extra / this.plots.length;
      if (plot.width !== width || plot.height !== Math.round(panelHeight)) plot.setSize({ width, height: Math.round(panelHeight) });
    });
  }
  width() { return printing ? this.place.closest("section figure:last-child:nth-child(odd), .single figure") ? 860 : 400 : Math.floor(this.place.clientWidth); }

  behind(u, panel) {
    const { ctx, bbox } = u;
    clipped(u, () => {
      for (const mark of panel.marks.filter(m => m.kind === "span")) {
        const vertical = mark.along === "x", [a, b] = [mark.low, mark.high].map(v => pixel(u, v, mark.along));
        ctx.fillStyle = colour(mark.role) + alpha(mark.opacity);
        const [low, size] = [Math.min(a, b), Math.max(Math.abs(b - a), mark.edge * sharp)];
        if (vertical) ctx.fillRect(low, bbox.top, size, bbox.height); else ctx.fillRect(bbox.left, low, bbox.width, size);
      }
      panel.lines.forEach((line, i) => {
        if (line.kind === "curve" && line.low != null && u.series[i + 1].show) this.band(u, line);
      });
    });
  }

  band(u, line) {
    const [x, low, high] = [line.x, line.low, line.high].map(k => this.arrays[k]), { ctx } = u;
    ctx.fillStyle = colour(line.role) + alpha(.2);
    ctx.beginPath();
    x.forEach((value, i) => low[i] == null || ctx.lineTo(pixel(u, value, "x"), pixel(u, low[i], "y")));
    for (let i = x.length - 1; i >= 0; i--) if (high[i] != null) ctx.lineTo(pixel(u, x[i], "x"), pixel(u, high[i], "y"));
    ctx.fill();
  }

  infront(u, panel) {
    const { ctx, bbox } = u;
    clipped(u, () => panel.lines.forEach((line, i) => {
      if (line.kind === "points" && u.series[i + 1].show) this.points(u, line);
    }));
    ctx.save();
    Object.assign(ctx, { fillStyle: colour("muted"), font: FONT.replace("12", 11 * sharp), textAlign: "left", textBaseline: "middle" });
    for (const note of panel.marks.filter(m => m.kind === "note")) {
      const [x, y] = [pixel(u, note.x, "x"), note.y == null ? bbox.top + bbox.height - 10 * sharp : pixel(u, note.y, "y")];
      const visible = x <= bbox.left + bbox.width + 1 && x >= bbox.left && y >= bbox.top && y <= bbox.top + bbox.height;
      if (visible) ctx.fillText(note.text, x + 5 * sharp, y);
    }
    ctx.restore();
  }

  points(u, line) {
    const { ctx } = u, [x, y, low, high] = [line.x, line.y, line.low, line.high].map(k => this.arrays[k]);
    const size = (line.mark === "square" ? 5 : 3.2) * sharp, cap = line.caps ? 3 * sharp : 0;
    Object.assign(ctx, { strokeStyle: colour(line.role), lineWidth: 1.2 * sharp });
    ctx.setLineDash([]);
    x.forEach((value, i) => {
      const [a, b, c, d] = [pixel(u, value, "x"), pixel(u, y[i], "y"), pixel(u, low[i], "y"), pixel(u, high[i], "y")];
      const halfCap = line.mark === "square" ? size : cap, path = new Path2D();
      path.moveTo(a, c); path.lineTo(a, d);
      if (line.caps) for (const e of [c, d]) { path.moveTo(a - halfCap, e); path.lineTo(a + halfCap, e); }
      ctx.stroke(path);
      const shape = new Path2D();
      if (line.mark === "square") shape.rect(a - size, b - size, 2 * size, 2 * size);
      else shape.arc(a, b, size, 0, 2 * Math.PI);
      ctx.fillStyle = colour(line.role);
      if (line.mark !== "square") ctx.fill(shape);
      ctx.stroke(shape);
    });
  }

  /** Show a range of x in all panels, or of y in one; beyond what there is to see there is nothing to show. */
  show(plot, key, low, high) {
    const { limits: [first, last], log } = this.panels[this.plots.indexOf(plot)][key];
    const u = x => log ? Math.log10(x) : x;
    if (!(u(high) - u(low) > (u(last) - u(first)) * 1e-4)) return;
    const limits = { min: Math.max(low, first), max: Math.min(high, last) };
    for (const other of key === "x" ? this.plots : [plot]) other.setScale(key, limits);
  }
  reset() {
    this.plots.forEach((plot, i) => plot.batch(() => {
      for (const key of "xy") plot.setScale(key, { min: this.panels[i][key].limits[0], max: this.panels[i][key].limits[1] });
    }));
  }
  /** Zoom x, and y by default, about a place of the plot. */
  scaled(plot, factor, { left, top }, keys = ["x", "y"]) {
    for (const key of keys) {
      const { log } = this.panels[this.plots.indexOf(plot)][key], { min, max } = plot.scales[key];
      const u = x => log ? Math.log10(x) : x, back = x => log ? 10 ** x : x;
      const centre = u(plot.posToVal(key === "x" ? left : top, key));
      this.show(plot, key, back(centre + (u(min) - centre) * factor), back(centre + (u(max) - centre) * factor));
    }
  }

  listen(plot, panel) {
    const plane = plot.over, middle = () => ({ left: plane.clientWidth / 2, top: plane.clientHeight / 2 });
    const focus = () => plot.cursor.left >= 0 ? plot.cursor : middle();
    plane.tabIndex = 0;
    plane.setAttribute("role", "application");
    plane.setAttribute("aria-label", `${this.place.getAttribute("aria-label")}: ${title(panel.y)}`);
    plane.setAttribute("aria-description", HINT);
    plane.title = "";
    plane.addEventListener("mousedown", () => plane.focus({ preventScroll: true }));
    plane.addEventListener("wheel", e => {
      if (document.activeElement !== plane && !e.ctrlKey) return;
      e.preventDefault();
      const box = plane.getBoundingClientRect();
      this.scaled(plot, 1.0015 ** e.deltaY, { left: e.clientX - box.left, top: e.clientY - box.top });
    }, { passive: false });
    plane.addEventListener("keydown", e => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[e.key];
      if (step) plot.setCursor({ left: Math.max(0, Math.min(plane.clientWidth, focus().left + step * 4)), top: focus().top }, true, true);
      else if (e.key === "+" || e.key === "-") this.scaled(plot, e.key === "+" ? .8 : 1.25, focus(), ["x"]);
      else if (e.key === "Escape" || e.key === "0") this.reset();
      else return;
      e.preventDefault();
    });
    pinched(plane, (factor, where) => this.scaled(plot, factor, where));
    for (const [i, row] of [...plot.root.querySelectorAll(".u-series")].entries()) {
      const button = row.querySelector("th");
      if (!i || row.classList.contains("unnamed")) continue;
      Object.assign(button, { tabIndex: 0, role: "button", title: "Hide or show" });
      button.addEventListener("keydown", e => {
        if (e.key === "Enter" || e.key === " ") { e.preventDefault(); button.click(); }
      });
    }
  }
}

const isDecade = x => Math.abs(Math.log10(x) - Math.round(Math.log10(x))) < 1e-6;
const alpha = share => Math.round(255 * share).toString(16).padStart(2, "0");
const pixel = (u, value, key) => u.valToPos(value, key, true);
const title = axis => axis.unit ? `${axis.label}  [${axis.unit}]` : axis.label;

function clipped({ ctx, bbox: { left, top, width, height } }, draw) {
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top, width, height);
  ctx.clip();
  draw();
  ctx.restore();
}

function swatch(line) {
  const swatch = document.createElement("i");
  swatch.className = `swatch ${line.mark ?? (line.kind === "span" ? "shade" : "line")}`;
  swatch.style.setProperty("--tone", `var(--${line.role})`);
  swatch.style.setProperty("--dash", { "--": "dashed", ":": "dotted" }[line.dash] ?? "solid");
  return swatch;
}

/** The row next to the pointer in which a curve has a value, none where that is far. */
function nearest(data, k, index, x, log) {
  if (data[k][index] != null) return index;
  let [below, above] = [index, index];
  while (below >= 0 && data[k][below] == null) below--;
  while (above < data[0].length && data[k][above] == null) above++;
  const distance = i => i in data[0] ? Math.abs(log ? Math.log(data[0][i] / x) : data[0][i] - x) : Infinity;
  const closest = distance(below) <= distance(above) ? below : above;
  return closest in data[0] ? closest : null;
}

/** Two fingers: report by how much they closed, and where. */
function pinched(plane, then) {
  let lastSpread = null;
  const place = ([a, b], box) => ({ left: (a.clientX + b.clientX) / 2 - box.left, top: (a.clientY + b.clientY) / 2 - box.top });
  plane.addEventListener("touchmove", e => {
    if (e.touches.length !== 2) return;
    e.preventDefault();
    const [a, b] = e.touches, spread = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    if (lastSpread && spread) then(lastSpread / spread, place(e.touches, plane.getBoundingClientRect()));
    lastSpread = spread;
  }, { passive: false });
  plane.addEventListener("touchend", () => { lastSpread = null; });
}

const charts = new Map();
let printing = false;
/** Draw what can be seen of some charts. */
function draw(places) {
  const visible = [...places].filter(place => place.offsetParent);
  for (const place of visible) if (!charts.has(place)) charts.set(place, new Chart(place));
  for (const place of visible) charts.get(place).size();
  queueMicrotask(() => level(visible));  // uPlot sets sizes in a microtask, before anything is shown
}
/** Give the charts in one row of figures one height. */
function level(places) {
  const rows = new Map();
  for (const place of places) {
    const { parentElement: { parentElement: grid }, offsetTop } = place, row = rows.get(grid) ?? rows.set(grid, new Map()).get(grid);
    row.set(offsetTop, [...row.get(offsetTop) ?? [], place]);
  }
  for (const row of [...rows.values()].flatMap(row => [...row.values()])) {
    const heights = row.map(place => place.offsetHeight), tallest = Math.max(...heights);
    row.forEach((place, i) => charts.get(place).size(tallest - heights[i]));
  }
}
function recoloured() {
  palette = {};
  for (const chart of charts.values()) for (const plot of chart.plots) plot.redraw(false);
}
function onPaper(on) {
  printing = on;
  root.classList.toggle("printing", on);  // paper is light
  draw(all);
  recoloured();
}
const all = document.querySelectorAll(".chart");
draw(all);  // before anything is shown, so that nothing moves
for (const folded of document.querySelectorAll("details")) folded.addEventListener("toggle", () => draw(folded.querySelectorAll(".chart")));
let width = root.clientWidth;
addEventListener("resize", () => { if (!printing && width !== root.clientWidth) { width = root.clientWidth; draw(all); } });
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", recoloured);
addEventListener("beforeprint", () => onPaper(true));
addEventListener("afterprint", () => onPaper(false));
})();
