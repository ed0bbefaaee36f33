// One cycle: the moving system, phase portrait, one period, multipliers, peaks.

import { Chart, element, range } from "./chart.js";

const LONGEST = 5, SHORTEST = 1.6; // seconds for one period on the screen
const by = (id) => document.getElementById(id);

export class Cycle {
  constructor() {
    this.moving = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    by("play").addEventListener("click", () => this.toggle());
    this.began = performance.now();
    const step = (now) => { this.frame(now); requestAnimationFrame(step); };
    requestAnimationFrame(step);
    by("play").textContent = this.moving ? "❚❚" : "▶";
  }

  toggle() {
    this.moving = !this.moving;
    by("play").textContent = this.moving ? "❚❚" : "▶";
  }

  show(data, coordinate) {
    this.data = data;
    by("cycle").hidden = false;
    by("hint").hidden = true;
    this.wave = data.waves.find((w) => w.name === coordinate) || data.waves[0];
    this.moved = this.wave.v ? this.wave : data.waves[0]; // an output has no velocity: the portrait is that of a coordinate
    this.facts();
    this.peaks();
    this.phase();
    this.period();
    this.circle();
    this.film();
    this.last = -1;
    this.frame(performance.now());
  }

  facts() {
    const parts = [["this cycle is", this.data.verdict, this.data.verdict], ...this.data.about.filter(([, v]) => v)];
    by("cycle-facts").replaceChildren(...parts.map(([name, value, kind]) => {
      const fact = document.createElement("div"), said = document.createElement("span"), bold = document.createElement("b");
      fact.className = "fact";
      [said.textContent, bold.textContent, bold.className] = [name, value, kind || ""];
      if (name === "this cycle is") fact.title = this.data.reason;
      fact.append(said, bold);
      return fact;
    }));
  }

  peaks() {
    const head = document.createElement("tr");
    head.innerHTML = "<th>coordinate or output</th><th>peak</th>";
    by("peaks").replaceChildren(head, ...this.data.waves.map((w) => {
      const row = document.createElement("tr");
      for (const text of [w.text, w.peak]) row.insertCell().textContent = text;
      row.className = w === this.wave ? "chosen" : "";
      row.addEventListener("click", () => this.show(this.data, w.name));
      return row;
    }));
  }

  phase() {
    const w = this.moved;
    const chart = new Chart(by("phase"), { height: 270, x: labelled(w.text, w.unit), y: labelled("velocity", w.rate_unit) });
    chart.begin(range(w.q), range(w.v));
    chart.curve(w.q.map((q, i) => [q, w.v[i]]), `thin ${this.data.verdict}`);
    this.phaseDot = element("circle", { class: "dot", r: 6 }, chart.svg);
    this.phaseChart = chart.show();
  }

  period() {
    const w = this.wave, t = this.data.t;
    const chart = new Chart(by("wave"), { height: 270, x: "time [s]", y: labelled(w.name, w.unit) });
    chart.begin([t[0], t[t.length - 1]], range(w.q));
    for (const other of this.data.waves.filter((o) => o !== w && o.unit === w.unit && Math.max(...o.q.map(Math.abs)) <= 1.001 * Math.max(...w.q.map(Math.abs)))) {
      chart.curve(other.q.map((q, i) => [t[i], q]), "thin unknown").style.opacity = 0.45;
    }
    chart.curve(w.q.map((q, i) => [t[i], q]), `thin ${this.data.verdict}`);
    this.waveDot = element("circle", { class: "dot", r: 6 }, chart.svg);
    this.waveChart = chart.show();
    by("wave-text").textContent = `One period of ${w.text}; in grey what has the same unit and is no larger`;
  }

  circle() {
    const reach = Math.min(3, Math.max(1.15, 1.1 * Math.max(...this.data.multipliers.map(([a, b]) => Math.hypot(a, b)), 0)));
    const chart = new Chart(by("circle"), { height: 270, x: "real part", y: "imaginary part", square: true });
    chart.begin([-reach, reach], [-reach, reach]);
    const ring = Array.from({ length: 121 }, (_, i) => [Math.cos((i * Math.PI) / 60), Math.sin((i * Math.PI) / 60)]);
    element("path", { class: "unit-circle", d: chart.path(ring) }, chart.layer);
    const trivial = this.data.multipliers.reduce((best, [a, b], i, all) => (best < 0 || Math.hypot(a - 1, b) < Math.hypot(all[best][0] - 1, all[best][1]) ? i : best), -1);
    this.data.multipliers.forEach(([a, b], i) => {
      const kind = i === trivial ? "one" : Math.hypot(a, b) > 1 ? "out" : "in";
      const size = Math.hypot(a, b), edge = size > reach ? reach / size : 1; // beyond the picture: at its edge
      const dot = element("circle", { class: `multiplier ${kind}`, cx: chart.x(a * edge), cy: chart.y(b * edge), r: 6 }, chart.svg);
      element("title", {}, dot, `${a.toPrecision(5)}${b ? ` ${b < 0 ? "−" : "+"} ${Math.abs(b).toPrecision(5)} i` : ""}${i === trivial ? ", the trivial one" : ""}`);
    });
    chart.show();
  }

  film() {
    const svg = element("svg", {});
    this.shapes = [];
    if (this.data.frames) {
      const all = this.data.frames.shapes.flat();
      const [x0, x1] = range(all.flatMap((s) => s.x), 0.03), [y0, y1] = range(all.flatMap((s) => s.y), 0.06);
      svg.setAttribute("viewBox", `${x0} ${-y1} ${x1 - x0} ${y1 - y0}`);
      this.shapes = this.data.frames.shapes[0].map((s) => element("path", { class: s.kind }, svg));
    } else {
      this.beads(svg);
    }
    by("film").replaceChildren(svg);
    const length = this.length(), period = this.data.t[this.data.t.length - 1];
    const slower = length / period;
    const pace = slower > 1.05 ? `shown ${slower.toPrecision(2)} times slower` : slower < 0.95 ? `shown ${(1 / slower).toPrecision(2)} times faster` : "as fast as in truth";
    by("film-text").textContent = [this.data.frames?.text || "Each coordinate as a bead that moves along its own line", pace].join("; ").replace(/\.;/, ";");
  }

  beads(svg) {
    const shown = this.data.waves.filter((w) => w.v).slice(0, 8);
    svg.setAttribute("viewBox", `0 0 860 ${34 * shown.length + 8}`);
    this.bead = shown.map((w, i) => {
      const y = 24 + 34 * i;
      element("text", { x: 0, y: y + 5 }, svg, w.text.length > 34 ? `${w.text.slice(0, 33)}…` : w.text);
      element("path", { class: "ground", d: `M270 ${y}H850` }, svg);
      const [low, high] = range(w.q, 0);
      return { dot: element("circle", { r: 9, cy: y }, svg), at: (v) => 275 + (570 * (v - low)) / (high - low || 1), w };
    });
  }

  length() {
    return Math.min(LONGEST, Math.max(SHORTEST, this.data.t[this.data.t.length - 1]));
  }

  // Move everything to where it is now.
  frame(now) {
    if (!this.data) return;
    if (!this.moving) { this.began += now - (this.before ?? now); if (this.last >= 0) { this.before = now; return; } }
    this.before = now;
    const share = ((((now - this.began) / 1000 / this.length()) % 1) + 1) % 1;
    const i = Math.floor(share * (this.data.t.length - 1));
    if (i === this.last) return;
    this.last = i;
    const w = this.wave, m = this.moved;
    move(this.phaseDot, this.phaseChart.x(m.q[i]), this.phaseChart.y(m.v[i]));
    move(this.waveDot, this.waveChart.x(this.data.t[i]), this.waveChart.y(w.q[i]));
    if (this.data.frames) {
      const frames = this.data.frames.shapes;
      frames[Math.floor(share * frames.length)].forEach((s, k) => {
        this.shapes[k].setAttribute("d", s.x.map((x, j) => `${j ? "L" : "M"}${x} ${-s.y[j]}`).join(""));
        this.shapes[k].setAttribute("class", s.lit ? `${s.kind} lit` : s.kind);
      });
    } else for (const b of this.bead) b.dot.setAttribute("cx", b.at(b.w.q[i]));
  }
}

function move(dot, x, y) {
  dot.setAttribute("cx", x);
  dot.setAttribute("cy", y);
}

function labelled(text, unit) {
  return unit && unit !== "1" ? `${text} [${unit}]` : text;
}
