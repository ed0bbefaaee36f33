// A slider and a field for each parameter. What is typed goes to the program as it is, which knows units and bounds.

const STEPS = 1000;

export class Controls {
  constructor(place, parameters, moved) {
    this.rows = new Map();
    for (const p of parameters) {
      const row = this.row(p, moved);
      this.rows.set(p.name, row);
      place.append(row.box);
    }
    document.getElementById("find").addEventListener("input", (event) => {
      const wanted = event.target.value.trim().toLowerCase();
      for (const { box, p } of this.rows.values()) box.hidden = !`${p.name} ${p.text}`.toLowerCase().includes(wanted);
    });
  }

  row(p, moved) {
    const box = document.createElement("div");
    box.className = "parameter";
    box.id = `parameter-${p.name}`;
    box.innerHTML = `<div class="name"><b></b><span></span><button class="back" title="Back to the value at the start">↺</button></div>
      <div class="set"><input type="range" min="0" max="${STEPS}" step="1"><input type="text" autocomplete="off" spellcheck="false"><span class="unit"></span></div>
      <p class="wrong" role="alert"></p>`;
    const [slider, field] = box.querySelectorAll("input");
    box.querySelector("b").textContent = p.name;
    box.querySelector(".name span").textContent = p.text;
    box.querySelector(".name").title = `${p.name}: ${p.text}`;
    box.querySelector(".unit").textContent = p.unit === "1" ? "" : p.unit;
    slider.setAttribute("aria-label", `${p.name}, ${p.text}`);
    field.setAttribute("aria-label", `Value of ${p.name}`);
    const row = { box, p, slider, field, low: p.low, high: p.high, wrong: box.querySelector(".wrong") };
    slider.addEventListener("input", () => {
      const value = Number((row.low + ((row.high - row.low) * slider.value) / STEPS).toPrecision(6));
      this.write(row, value);
      moved(p.name, value);
    });
    field.addEventListener("change", () => moved(p.name, field.value));
    box.querySelector(".back").addEventListener("click", () => moved(p.name, p.value));
    this.write(row, p.value);
    slider.value = this.place(row, p.value);
    return row;
  }

  place(row, value) {
    return Math.round((STEPS * (value - row.low)) / (row.high - row.low));
  }

  write(row, value) {
    row.field.value = shown(value);
    row.box.classList.toggle("changed", Math.abs(value - row.p.value) > 1e-9 * Math.abs(row.p.value));
  }

  // Show the values as the program took them; the slider of a value beyond its ends is stretched.
  take(values, axis) {
    for (const [name, row] of this.rows) {
      const value = values[name];
      row.low = Math.min(row.low, value);
      row.high = Math.max(row.high, value);
      if (document.activeElement !== row.slider) row.slider.value = this.place(row, value);
      if (document.activeElement !== row.slider) this.write(row, value);
      row.box.classList.toggle("axis-own", name === axis);
      row.slider.disabled = row.field.disabled = name === axis;
      row.box.title = name === axis ? "This parameter is on the axis" : "";
    }
  }

  // Show what is wrong beside its field.
  complain(fields) {
    for (const [name, row] of this.rows) {
      row.wrong.textContent = fields[name] || "";
      row.field.classList.toggle("bad", Boolean(fields[name]));
    }
  }
}

function shown(value) {
  if (value === 0) return "0";
  const size = Math.abs(value);
  return size >= 1e6 || size < 1e-3 ? Number(value).toExponential().replace("e+", "e") : String(value);
}
