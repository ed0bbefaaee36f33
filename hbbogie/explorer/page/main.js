// The page: one view, sent to the program whenever it changes; the answer is drawn. At most one question is under way.

import { number } from "./chart.js";
import { Controls } from "./controls.js";
import { Cycle } from "./cycle.js";
import { Diagram } from "./diagram.js";

const by = (id) => document.getElementById(id);
let start, view, good, controls, diagram, cycle, shown = null, pinned = null, chosen = null;
let waiting = null, running = false;

async function ask(path, question) {
  const answer = await fetch(`/api/${path}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(question) })
    .catch(() => { throw { error: "The program does not answer; it may have been ended in the terminal.", fields: {} }; });
  const content = await answer.json();
  if (!answer.ok) throw content;
  return content;
}

// Ask for the diagram of the view. While one is computed only the newest question waits.
async function update(extra = {}) {
  waiting = { ...extra, since: performance.now() };
  if (running) return;
  running = true;
  const slow = setTimeout(() => { document.body.classList.add("busy"); by("status").textContent = "computing …"; }, 350);
  try {
    while (waiting) {
      const { since, ...more } = waiting;
      waiting = null;
      await one(since, more);
    }
  } finally {
    running = false;
    clearTimeout(slow);
    document.body.classList.remove("busy");
  }
}

async function one(since, more) {
  const asked = structuredClone(view), began = performance.now();
  try {
    shown = await ask("diagram", { view: asked, ...more });
    good = shown.view;
    complain({ error: "", fields: {} });
    draw();
    performance.measure("diagram", { start: since, end: performance.now() });
    by("status").textContent = `${shown.method}, ${((performance.now() - began) / 1000).toFixed(2)} s`;
    if (!waiting) {
      view = structuredClone(good);
      fill();
      remember();
      await follow();
    }
  } catch (problem) {
    if (!problem.fields) throw problem;
    complain(problem);
    by("status").textContent = "the diagram shows the last good values";
  }
  document.documentElement.dataset.answers = String(Number(document.documentElement.dataset.answers || 0) + 1);
}

function draw() {
  diagram.draw(shown, pinned, null);
  facts();
  by("key-unknown").hidden = !shown.branches.some((b) => b.curves.some((c) => c.verdict === "unknown"));
  by("key-pinned").hidden = !pinned;
  const line = (text, kind) => Object.assign(document.createElement("p"), { textContent: text, className: kind });
  by("said").replaceChildren(...(shown.said || []).map((t) => line(t, "")), ...shown.notes.map((t) => line(t, "note")));
}

// The special points as numbers, with their distance from the pinned ones.
function facts() {
  const count = {}, made = [];
  for (const mark of shown.marks.filter((m) => m.kind !== "grazing").sort((a, b) => a.x - b.x).slice(0, 8)) {
    const k = (count[mark.kind] = (count[mark.kind] ?? -1) + 1);
    const before = pinned?.axis.label === shown.axis.label && pinned.marks.filter((m) => m.kind === mark.kind).sort((a, b) => a.x - b.x)[k];
    const change = before ? mark.x - before.x : 0;
    const text = `${number(Number(mark.x.toPrecision(5)))} ${shown.axis.unit === "1" ? "" : shown.axis.unit}`;
    made.push([mark.name, text, before ? `${change < 0 ? "−" : "+"}${number(Number(Math.abs(change).toPrecision(3)))}` : ""]);
  }
  if (!made.length) made.push(["special points", "none", ""]);
  by("facts").replaceChildren(...made.map(([name, value, change]) => {
    const fact = document.createElement("div");
    fact.className = "fact";
    fact.append(Object.assign(document.createElement("span"), { textContent: name }), Object.assign(document.createElement("b"), { textContent: value }));
    if (change) fact.lastChild.append(Object.assign(document.createElement("small"), { textContent: `${change} from the pinned` }));
    return fact;
  }));
}

function complain({ error, fields }) {
  controls.complain(fields);
  const own = ["low", "high", "parameter", "coordinate"];
  by("axis-wrong").textContent = own.map((f) => fields[f]).filter(Boolean).join(" ");
  for (const f of ["low", "high"]) by(f).classList.toggle("bad", Boolean(fields[f]));
  by("wrong").textContent = Object.keys(fields).length ? "" : error;
}

// Show the cycle that was chosen, at its place on the diagram of now; a stable one where none was.
async function follow() {
  const at = chosen ? diagram.again(chosen) : diagram.first(view.values[view.parameter] * shown.axis.factor);
  if (!at) return;
  const close = chosen && Math.abs(at.x - chosen.x) < 0.01 * (shown.axis.high - shown.axis.low);
  await choose(close ? { ...at, x: chosen.x } : at, false);
}

async function choose(at, asked = true) {
  try {
    const found = await ask("cycle", { view: good, branch: at.branch, x: at.x, y: at.y });
    if (asked) chosen = at;
    if (waiting && !asked) return;
    diagram.choose(found);
    cycle.show(found, view.coordinate);
    by("wrong").textContent = "";
    document.documentElement.dataset.cycles = String(Number(document.documentElement.dataset.cycles || 0) + 1);
  } catch (problem) {
    if (!problem.fields) throw problem;
    by("wrong").textContent = problem.error;
  }
}

// Write the view into the fields of the page, and into the address, so that a session can be kept as a bookmark.
function fill() {
  controls.take(view.values, view.parameter);
  by("parameter").value = view.parameter;
  by("coordinate").value = view.coordinate;
  const unit = start.parameters.find((p) => p.name === view.parameter)?.unit || "";
  by("axis-unit").textContent = unit === "1" ? "" : unit;
  for (const f of ["low", "high"]) if (document.activeElement !== by(f)) by(f).value = view[f];
}

function remember() {
  const changed = Object.fromEntries(Object.entries(view.values).filter(([n, v]) => v !== start.view.values[n]));
  const { parameter, low, high, coordinate } = view;
  history.replaceState(null, "", `#${encodeURIComponent(JSON.stringify({ parameter, low, high, coordinate, changed }))}`);
}

function recalled() {
  try {
    const { changed, ...rest } = JSON.parse(decodeURIComponent(location.hash.slice(1)));
    return { ...structuredClone(start.view), ...rest, values: { ...start.view.values, ...changed } };
  } catch {
    return structuredClone(start.view);
  }
}

async function save(path, name, kind) {
  by("status").textContent = "writing …";
  try {
    const { text } = await ask(path, { view: good, pinned: pinned?.view });
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([text], { type: kind })), download: name });
    link.click();
    by("status").textContent = `${name} is in the folder of downloads`;
    document.documentElement.dataset.saved = name;
  } catch (problem) {
    by("wrong").textContent = problem.error || String(problem);
  }
}

function buttons() {
  const stem = start.system.toLowerCase().replace(/[^a-z0-9]+/g, "_");
  by("pin").addEventListener("click", () => {
    pinned = pinned ? null : shown;
    by("pin").textContent = pinned ? "Unpin" : "Pin";
    by("pin").setAttribute("aria-pressed", String(Boolean(pinned)));
    draw();
    follow();
  });
  by("anew").addEventListener("click", () => update({ anew: true }));
  by("reset").addEventListener("click", () => { view = structuredClone(start.view); chosen = null; fill(); update(); });
  by("script").addEventListener("click", () => save("script", `${stem}.py`, "text/x-python"));
  by("report").addEventListener("click", () => save("report", `${stem}.html`, "text/html"));
  by("theme").addEventListener("click", () => theme(document.documentElement.dataset.theme === "dark" ? "light" : "dark", true));
}

function theme(name, kept) {
  document.documentElement.dataset.theme = name;
  if (kept) localStorage.setItem("theme", name);
}

async function main() {
  theme(localStorage.getItem("theme") || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"), false);
  start = await ask("opening", {});
  document.title = `${start.system} · hbbogie explore`;
  by("system").textContent = start.system;
  by("about").textContent = `${start.about} ${start.said}`;
  const option = (c) => new Option(c.text ? `${c.name} – ${c.text}` : c.name, c.name);
  by("parameter").append(...start.parameters.map(option));
  by("coordinate").append(...start.coordinates.map(option));
  controls = new Controls(by("parameters"), start.parameters, (name, value) => { view.values[name] = value; update(); });
  diagram = new Diagram(by("diagram"), choose);
  cycle = new Cycle();
  view = good = recalled();
  buttons();
  by("parameter").addEventListener("change", (event) => {
    view.parameter = event.target.value;
    const row = start.parameters.find((p) => p.name === view.parameter);
    const own = view.parameter === start.view.parameter;
    [view.low, view.high] = own ? [start.view.low, start.view.high] : [row.low, row.high];
    chosen = null;
    for (const f of ["low", "high"]) by(f).value = view[f];
    update();
  });
  by("coordinate").addEventListener("change", (event) => { view.coordinate = event.target.value; chosen = null; update(); });
  for (const f of ["low", "high"]) by(f).addEventListener("change", (event) => { view[f] = event.target.value; update(); });
  addEventListener("resize", () => { if (shown) { draw(); follow(); } });
  fill();
  update();
}

main().catch((problem) => { by("wrong").textContent = problem.error || String(problem); });
