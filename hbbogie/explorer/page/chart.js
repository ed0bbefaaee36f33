// Axes with curves, drawn as SVG.

const NS = "http://www.w3.org/2000/svg";

export function element(name, attributes = {}, parent = null, text = "") {
  const made = document.createElementNS(NS, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  if (parent) parent.append(made);
  return made;
}

// About `count` round numbers between two values.
export function ticks(low, high, count) {
  const raw = (high - low) / Math.max(1, count);
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= raw * 0.999);
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push(i * step);
  return { found, step };
}

export function number(value, step = 0) {
  if (value === 0 || Math.abs(value) < 1e-9 * step) return "0";
  const size = Math.abs(value);
  if (size >= 1e6 || size < 1e-4) return value.toExponential(2).replace(/\.?0+e/, "e").replace("-", "\u2212");
  const digits = step ? Math.max(0, Math.min(9, Math.ceil(-Math.log10(step) - 1e-9))) : 6;
  const text = step ? value.toFixed(digits) : String(Number(value.toPrecision(6)));
  return text.replace("-", "\u2212");
}

export class Chart {
  constructor(place, { height, x = "", y = "", square = false }) {
    this.place = place;
    Object.assign(this, { height, xLabel: x, yLabel: y, square });
  }

  // Begin a picture with axes over these ranges.
  begin([x0, x1], [y0, y1]) {
    const width = Math.max(240, this.place.clientWidth);
    const margin = { left: 62, right: 14, top: 12, bottom: this.xLabel ? 48 : 26 };
    this.size = { width, height: this.height };
    this.inner = { x: margin.left, y: margin.top, w: width - margin.left - margin.right, h: this.height - margin.top - margin.bottom };
    if (this.square) {
      const perPixel = Math.max((x1 - x0) / this.inner.w, (y1 - y0) / this.inner.h);
      const [cx, cy] = [(x0 + x1) / 2, (y0 + y1) / 2];
      [x0, x1] = [cx - (perPixel * this.inner.w) / 2, cx + (perPixel * this.inner.w) / 2];
      [y0, y1] = [cy - (perPixel * this.inner.h) / 2, cy + (perPixel * this.inner.h) / 2];
    }
    this.x = (v) => this.inner.x + (this.inner.w * (v - x0)) / (x1 - x0);
    this.y = (v) => this.inner.y + this.inner.h - (this.inner.h * (v - y0)) / (y1 - y0);
    this.back = { x: (px) => x0 + ((px - this.inner.x) * (x1 - x0)) / this.inner.w };
    const svg = element("svg", { viewBox: `0 0 ${width} ${this.height}`, height: this.height, role: "img" });
    const clip = `clip-${this.place.id}`;
    const shape = element("clipPath", { id: clip }, element("defs", {}, svg));
    element("rect", { x: this.inner.x, y: this.inner.y - 6, width: this.inner.w + 6, height: this.inner.h + 12 }, shape);
    this.svg = svg;
    this.axes([x0, x1], [y0, y1]);
    this.layer = element("g", { "clip-path": `url(#${clip})` }, svg);
    return this;
  }

  axes([x0, x1], [y0, y1]) {
    const { x: left, y: top, w, h } = this.inner;
    const across = ticks(x0, x1, w / 90), up = ticks(y0, y1, h / 52);
    for (const v of across.found) {
      element("line", { class: "grid", x1: this.x(v), x2: this.x(v), y1: top, y2: top + h }, this.svg);
      element("text", { x: this.x(v), y: top + h + 18, "text-anchor": "middle" }, this.svg, number(v, across.step));
    }
    for (const v of up.found) {
      element("line", { class: "grid", y1: this.y(v), y2: this.y(v), x1: left, x2: left + w }, this.svg);
      element("text", { x: left - 8, y: this.y(v) + 4.5, "text-anchor": "end" }, this.svg, number(v, up.step));
    }
    element("line", { class: "frame", x1: left, x2: left + w, y1: top + h, y2: top + h }, this.svg);
    element("line", { class: "frame", x1: left, x2: left, y1: top, y2: top + h }, this.svg);
    element("text", { class: "label", x: left + w / 2, y: top + h + 40, "text-anchor": "middle" }, this.svg, this.xLabel);
    const turned = { class: "label", transform: `translate(16 ${top + h / 2}) rotate(-90)`, "text-anchor": "middle" };
    element("text", turned, this.svg, this.yLabel);
  }

  path(points) {
    return points.map(([x, y], i) => `${i ? "L" : "M"}${this.x(x).toFixed(1)} ${this.y(y).toFixed(1)}`).join("");
  }

  curve(points, kind, parent = this.layer) {
    if (points.length === 1) return element("circle", { class: `dot ${kind}`, r: 4, cx: this.x(points[0][0]), cy: this.y(points[0][1]) }, parent);
    return element("path", { class: `curve ${kind}`, d: this.path(points) }, parent);
  }

  // Put the finished picture on the page, in one step.
  show() {
    this.place.replaceChildren(this.svg);
    return this;
  }
}

// The smallest range that holds some numbers, with room around it.
export function range(values, room = 0.06) {
  let low = Infinity, high = -Infinity;
  for (const v of values) { if (v < low) low = v; if (v > high) high = v; }
  if (!(low <= high)) return [0, 1];
  const width = high - low || Math.abs(high) || 1;
  return [low - room * width, high + room * width];
}
