// The bifurcation diagram: curves by their verdicts, special points, the pinned diagram behind, what is under the mouse.

import { Chart, element, number } from "./chart.js";

const REACH = 16; // pixels from a curve at which it is met
const SHAPES = {
  fold: "M0-7 7 0 0 7-7 0Z",
  hopf: "M-5.5-5.5h11v11h-11Z",
  pitchfork: "M0-7 6.5 5.5h-13Z",
  "period doubling": "M0 7 6.5-5.5h-13Z",
};
const ROUND = "M-5.5 0a5.5 5.5 0 1 0 11 0a5.5 5.5 0 1 0-11 0Z";

export class Diagram {
  constructor(place, clicked) {
    this.place = place;
    this.top = 0;
    place.addEventListener("click", (event) => {
      const met = this.under(event);
      if (met) clicked(met);
    });
    place.addEventListener("mousemove", (event) => this.hover(event));
    place.addEventListener("mouseleave", () => this.light?.replaceChildren());
  }

  draw(data, pinned, chosen) {
    this.data = data;
    const beside = pinned && pinned.axis.unit === data.axis.unit && pinned.height.unit === data.height.unit ? pinned : null;
    const top = 1.08 * Math.max(data.height.high, beside ? beside.height.high : 0, 1e-12);
    if (!(top <= this.top && top > 0.62 * this.top) || this.scale !== data.height.label) this.top = top; // steady under the mouse
    this.scale = data.height.label;
    const chart = new Chart(this.place, { height: 430, x: data.axis.label.replace(" [1]", ""), y: data.height.label.replace(" [1]", "") });
    this.chart = chart.begin([data.axis.low, data.axis.high], [-0.02 * this.top, this.top]);
    if (beside) this.curves(beside, element("g", { class: "pinned" }, chart.layer), false);
    this.curves(data, element("g", {}, chart.layer), true);
    this.light = element("g", {}, chart.svg);
    this.place_of = element("g", {}, chart.svg);
    this.choose(chosen);
    chart.show();
  }

  curves(data, parent, named) {
    for (const piece of data.rest) this.chart.curve(piece.points, `rest ${piece.verdict}`, parent);
    for (const branch of data.branches) for (const piece of branch.curves) this.chart.curve(piece.points, piece.verdict, parent);
    for (const mark of data.marks) {
      const at = `translate(${this.chart.x(mark.x).toFixed(1)} ${this.chart.y(mark.y).toFixed(1)})`;
      const open = mark.kind === "grazing" ? "mark open" : "mark";
      const drawn = element("path", { class: open, d: SHAPES[mark.kind] || ROUND, transform: at }, parent);
      element("title", {}, drawn, mark.text);
    }
    if (named) this.names(data, parent);
  }

  // Names beside the marks, where there are few and they do not cover each other.
  names(data, parent) {
    const taken = [];
    for (const mark of data.marks.filter((m) => m.kind !== "grazing").slice(0, 8)) {
      const [px, py] = [this.chart.x(mark.x), this.chart.y(mark.y)];
      const left = px > this.chart.inner.x + 150;
      const below = mark.kind === "hopf" ? -14 : left ? 5 : 24;
      if (taken.some(([x, y]) => Math.abs(x - px) < 90 && Math.abs(y - py - below) < 16)) continue;
      taken.push([px, py + below]);
      const at = { class: "note", x: px + (left ? -12 : 12), y: py + below, "text-anchor": left ? "end" : "start" };
      element("text", at, parent, `${mark.name} ${number(Number(mark.x.toPrecision(5)))}`);
    }
  }

  // The point of a curve next to the mouse.
  under(event) {
    if (!this.data) return null;
    const box = this.chart.svg.getBoundingClientRect();
    const scale = this.chart.size.width / box.width;
    const [mx, my] = [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
    let best = null, least = REACH;
    for (const branch of this.data.branches) {
      for (const piece of branch.curves) {
        for (const [x, y] of piece.points) {
          const away = Math.hypot(this.chart.x(x) - mx, this.chart.y(y) - my);
          if (away < least) [best, least] = [{ branch: branch.name, x, y, verdict: piece.verdict }, away];
        }
      }
    }
    return best;
  }

  hover(event) {
    if (!this.light) return;
    this.light.replaceChildren();
    const met = this.under(event);
    this.place.style.cursor = met ? "pointer" : "";
    if (!met) return;
    const [px, py] = [this.chart.x(met.x), this.chart.y(met.y)];
    element("circle", { class: "hover", cx: px, cy: py, r: 6 }, this.light);
    const left = px > this.chart.inner.x + 0.6 * this.chart.inner.w;
    const text = `${number(Number(met.x.toPrecision(5)))} ${this.data.axis.unit}, peak ${number(Number(met.y.toPrecision(4)))} ${this.data.height.unit}, ${met.verdict}`;
    element("text", { class: "note", x: px + (left ? -12 : 12), y: py - 10, "text-anchor": left ? "end" : "start" }, this.light, text.replaceAll(" 1,", ","));
  }

  choose(cycle) {
    this.place_of?.replaceChildren();
    if (cycle) element("circle", { class: "dot", cx: this.chart.x(cycle.x), cy: this.chart.y(cycle.y), r: 7 }, this.place_of);
  }

  // Where a cycle chosen before lies on this diagram: on a curve of the same verdict, at the same value.
  again(chosen) {
    const away = ({ branch, x, y, verdict }) => Math.abs(x - chosen.x) / (this.data.axis.high - this.data.axis.low)
      + 0.1 * Math.abs(y - chosen.y) / this.top + (verdict === chosen.verdict ? 0 : 0.5) + (branch === chosen.branch ? 0 : 0.05);
    return this.every().reduce((best, point) => (best && away(best) <= away(point) ? best : point), null);
  }

  // A stable cycle to begin with: the largest at a value, else one in the middle of the longest stable curve.
  first(value) {
    const width = (this.data.axis.high - this.data.axis.low) / 100;
    const at = this.every().filter((p) => p.verdict === "stable" && Math.abs(p.x - value) < width).sort((a, b) => b.y - a.y)[0];
    if (at) return { ...at, x: value };
    const pieces = this.data.branches.flatMap((b) => b.curves.map((c) => ({ branch: b.name, verdict: c.verdict, points: c.points })));
    const longest = pieces.sort((a, b) => (b.verdict === "stable") - (a.verdict === "stable") || b.points.length - a.points.length)[0];
    if (!longest) return null;
    const [x, y] = longest.points[Math.floor(longest.points.length / 2)];
    return { branch: longest.branch, verdict: longest.verdict, x, y };
  }

  every() {
    return this.data.branches.flatMap((b) => b.curves.flatMap((c) => c.points.map(([x, y]) => ({ branch: b.name, verdict: c.verdict, x, y }))));
  }
}
