"use strict";
// One state: numbers by keys. Every change asks for the cycle, then for slopes and the curve.
const token = new URLSearchParams(location.search).get("token") || "";
const by = (id) => document.getElementById(id);
const state = { knobs: [], values: {}, history: [], cycle: null, start: null, curve: null };

async function ask(question, more = {}) {
  const reply = await fetch("/" + question, {
    method: "POST",
    headers: { "X-Token": token, "Content-Type": "application/json" },
    body: JSON.stringify({ values: state.values, ...more }),
  });
  const found = await reply.json();
  if (!reply.ok) throw new Error(found.error);
  return found;
}

function tell(text, bad = false) {
  by("told").textContent = text;
  by("told").className = bad ? "bad" : "";
}

const short = (x) => (x === 0 ? "0" : Number(x.toPrecision(5)).toString());

// ---- pictures

function canvas(id) {
  const place = by(id);
  const scale = window.devicePixelRatio || 1;
  place.width = place.clientWidth * scale;
  place.height = place.clientHeight * scale;
  const pen = place.getContext("2d");
  pen.scale(scale, scale);
  pen.font = "12px system-ui, sans-serif";
  return [pen, place.clientWidth, place.clientHeight];
}

function ticks(low, high) {
  const raw = (high - low) / 4;
  const power = Math.pow(10, Math.floor(Math.log10(raw)));
  const step = [1, 2, 5, 10].map((x) => x * power).find((x) => x >= raw);
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + 1e-9 * step; at += step) found.push(at);
  return found;
}

// Axes with a line in them, the line of the scene itself behind it, and a point.
function draw(id, x, y, { before = null, point = null, zero = false } = {}) {
  const [pen, width, height] = canvas(id);
  const all = y.concat(before || [], point ? [point[1]] : [], zero ? [0] : []);
  let low = Math.min(...all), high = Math.max(...all);
  if (high - low < 1e-9 * Math.max(1, Math.abs(high))) { low -= 0.5; high += 0.5; }
  const pad = zero ? 0 : 0.05 * (high - low);
  low -= pad; high += 0.05 * (high - low);
  const left = 55, right = width - 10, top = 8, bottom = height - 22;
  const px = (v) => left + (right - left) * (v - x[0]) / (x[x.length - 1] - x[0]);
  const py = (v) => bottom - (bottom - top) * (v - low) / (high - low);
  pen.strokeStyle = "#d5dade"; pen.fillStyle = "#505a64"; pen.lineWidth = 1;
  pen.textAlign = "right"; pen.textBaseline = "middle";
  for (const at of ticks(low, high)) {
    pen.beginPath(); pen.moveTo(left, py(at)); pen.lineTo(right, py(at)); pen.stroke();
    pen.fillText(short(at), left - 6, py(at));
  }
  pen.textAlign = "center"; pen.textBaseline = "top";
  for (const at of ticks(x[0], x[x.length - 1])) pen.fillText(short(at), px(at), bottom + 6);
  const line = (values, colour, wide) => {
    pen.strokeStyle = colour; pen.lineWidth = wide; pen.beginPath();
    values.forEach((v, i) => (i ? pen.lineTo(px(x[i]), py(v)) : pen.moveTo(px(x[i]), py(v))));
    pen.stroke();
  };
  if (before) line(before, "#b9c1c7", 1.5);
  line(y, "#0072b2", 2);
  if (point) {
    pen.fillStyle = "#d55e00"; pen.beginPath();
    pen.arc(px(point[0]), py(point[1]), 5, 0, 7); pen.fill();
  }
}

function drawPressure(found) {
  const [pen, width, height] = canvas("pressure");
  const rows = found.pressure_MPa, bins = rows.length, slices = rows[0].length;
  const most = Math.max(...rows.flat(), 1);
  const left = 55, right = width - 70, top = 8, bottom = height - 22;
  const w = (right - left) / slices, h = (bottom - top) / bins;
  rows.forEach((row, i) => row.forEach((value, j) => {
    const share = value / most;
    pen.fillStyle = value > 0 ? `hsl(${215 - 195 * share} 75% ${92 - 45 * share}%)` : "#f4f6f7";
    pen.fillRect(left + j * w, bottom - (i + 1) * h, w + 0.6, h + 0.6);
  }));
  pen.fillStyle = "#505a64"; pen.textBaseline = "middle"; pen.textAlign = "right";
  const [low, high] = found.path_mm;
  [0, 0.5, 1].forEach((at) =>
    pen.fillText(short(low + at * (high - low)), left - 6, bottom - at * (bottom - top)));
  pen.textAlign = "center"; pen.textBaseline = "top";
  pen.fillText("left", left + 12, bottom + 6); pen.fillText("right", right - 14, bottom + 6);
  for (let i = 0; i < 40; i++) {
    const share = i / 39;
    pen.fillStyle = `hsl(${215 - 195 * share} 75% ${92 - 45 * share}%)`;
    pen.fillRect(right + 12, bottom - (i + 1) * (bottom - top) / 40, 12, (bottom - top) / 40 + 0.6);
  }
  pen.fillStyle = "#505a64"; pen.textAlign = "left"; pen.textBaseline = "middle";
  pen.fillText(short(most), right + 28, top + 6); pen.fillText("0", right + 28, bottom - 4);
}

function drawCycle() {
  const now = state.cycle, first = state.start;
  draw("te", now.phase, now.te_um, { before: first.te_um });
  draw("stiffness", now.phase, now.mesh_stiffness_N_um, { before: first.mesh_stiffness_N_um });
  drawPressure(now);
  draw("load", now.face_load_N_mm.map((_, i) => i + 1), now.face_load_N_mm,
    { before: first.face_load_N_mm, zero: true });
  if (state.curve) drawCurve();
  by("numbers").replaceChildren(...Object.entries(now.numbers).map(([name, value]) => {
    const row = document.createElement("tr");
    for (const [kind, text] of [["th", name], ["td", short(value)],
      ["td", "scene: " + short(first.numbers[name])]]) {
      const cell = document.createElement(kind);
      cell.textContent = text;
      if (kind === "td") cell.dataset.name = name;
      row.append(cell);
    }
    row.children[1].dataset.value = value;
    return row;
  }));
}

function drawCurve() {
  const depths = ["pinion", "wheel"].map((gear) => state.values[`flank.${gear}.tip_relief.depth_um`]);
  const here = depths[0] === depths[1] ? [depths[0], state.cycle.numbers.te_rms_um] : null;
  draw("curve", state.curve.depth_um, state.curve.te_rms_um, { point: here, zero: true });
}

// ---- knobs

function makeKnobs() {
  by("knobs").replaceChildren();
  const groups = new Map();
  for (const knob of state.knobs) {
    const group = knob.key.split(".").slice(0, knob.key.startsWith("flank.") ? 2 : 1).join(".");
    if (!groups.has(group)) {
      const title = document.createElement("h2");
      title.textContent = group;
      by("knobs").append(title);
      groups.set(group, true);
    }
    const row = document.createElement("div");
    row.className = "knob";
    const name = knob.key.slice(group.length + 1);
    const label = document.createElement("label");
    label.textContent = name + (knob.unit ? ` [${knob.unit}]` : "");
    label.title = knob.meaning;
    label.htmlFor = "slide-" + knob.key;
    const common = { min: knob.low, max: knob.high, step: "any", value: knob.value };
    const slide = Object.assign(document.createElement("input"),
      { type: "range", id: "slide-" + knob.key }, common);
    const number = Object.assign(document.createElement("input"),
      { type: "number", id: "number-" + knob.key }, common);
    number.setAttribute("aria-label", knob.key);
    slide.oninput = () => move({ [knob.key]: Number(slide.value) });
    number.onchange = () => { keep(); move({ [knob.key]: Number(number.value) }); };
    slide.onpointerdown = slide.onkeydown = keep;
    const slope = document.createElement("div");
    slope.className = "slope";
    slope.id = "slope-" + knob.key;
    row.append(label, slide, number, slope);
    by("knobs").append(row);
  }
}

function showValues() {
  for (const knob of state.knobs) {
    by("slide-" + knob.key).value = state.values[knob.key];
    by("number-" + knob.key).value = Number(state.values[knob.key].toPrecision(6));
  }
}

// An arrow from the middle, to the side on which the response falls.
function showSlopes(slopes) {
  const reach = (knob) => Math.abs(slopes[knob.key]) * (knob.high - knob.low);
  const most = Math.max(...state.knobs.map(reach), 1e-300);
  for (const knob of state.knobs) {
    const mark = document.createElement("i");
    const wide = 50 * reach(knob) / most;
    const down = slopes[knob.key] > 0;
    mark.className = down ? "down" : "up";
    mark.style.width = wide + "%";
    mark.style.left = (down ? 50 - wide : 50) + "%";
    const place = by("slope-" + knob.key);
    place.dataset.slope = slopes[knob.key];
    place.title = `d ${by("response").value} / d ${knob.key} = ${short(slopes[knob.key])}`;
    place.replaceChildren(mark);
  }
}

// ---- what happens

// The knobs that there are, and the keys of which one may be added.
function takeKnobs(found) {
  state.knobs = found.knobs;
  const own = Object.fromEntries(found.knobs.map((knob) => [knob.key, knob.value]));
  state.values = { ...own, ...state.values };
  // What was before a knob has its value in the scene.
  state.history = state.history.map((values) => ({ ...own, ...values }));
  by("others").replaceChildren(...found.others.map((key) => new Option("", key)));
  makeKnobs();
  showValues();
}

function keep() {
  state.history.push({ ...state.values });
  by("undo").disabled = false;
}

let busy = false, again = false, failed = false;
async function refresh() {
  if (busy) { again = true; return; }
  busy = true;
  by("hint").textContent = "The grey lines are the scene's; bars under the sliders point to where " +
    by("response").value + " falls.";
  try {
    do {
      again = false;
      state.cycle = await ask("cycle");
      state.start = state.start || state.cycle;
      drawCycle();
      // What others have told stays.
      if (failed) tell("");
      failed = false;
    } while (again);
    showSlopes(await ask("slopes", { response: by("response").value }));
    if (!again && state.values["flank.pinion.tip_relief.depth_um"] !== undefined) {
      state.curve = await ask("curve");
      drawCurve();
    }
  } catch (error) {
    failed = true;
    tell(error.message, true);
  }
  busy = false;
  if (again) refresh();
}

function move(changes) {
  tell("");
  Object.assign(state.values, changes);
  showValues();
  return refresh();
}

async function long(words, work) {
  const buttons = [...document.querySelectorAll("button")].filter((each) => !each.disabled);
  buttons.forEach((each) => { each.disabled = true; });
  tell(words);
  try {
    await work();
    if (by("told").textContent === words) tell("");
  } catch (error) {
    tell(error.message, true);
  }
  buttons.forEach((each) => { each.disabled = false; });
}

by("undo").onclick = () => {
  const last = state.history.pop();
  by("undo").disabled = !state.history.length;
  move(last);
};
by("reset").onclick = () => {
  keep();
  move(Object.fromEntries(state.knobs.map((knob) => [knob.key, knob.value])));
};
by("add").onsubmit = (event) => {
  event.preventDefault();
  long("Adding a slider; its slopes take a while the first time ...", async () => {
    takeKnobs(await ask("add", { key: by("key").value.trim() }));
    by("key").value = "";
    await refresh();
  });
};
by("response").onchange = refresh;
by("write").onclick = () => long("Writing ...", async () => {
  const found = await ask("write");
  tell(`${found.changed} keys changed in ${found.file}.`);
});
by("optimise").onclick = () => long("Searching from here, as [optimise] says ...", async () => {
  const found = await ask("optimise");
  keep();
  await move(found.values);
  tell(found.converged ? "The search has converged." : "Not converged: " + found.reason);
});
by("sweep").onclick = () => long("Sweeping the speeds of [sweep] ...", async () => {
  const found = await ask("sweep");
  by("swept").hidden = false;
  draw("ratio", found.speed_rad_s, found.dynamic_ratio, { zero: true });
  tell("The sweep is of the values at which it was asked for.");
});
window.onresize = () => { if (state.cycle) drawCycle(); };

(async () => {
  try {
    const found = await ask("start");
    document.title = found.name + ": jaxgear";
    by("name").textContent = found.name;
    for (const name of found.responses) by("response").append(new Option(name, name));
    by("optimise").hidden = !found.searches;
    by("sweep").hidden = !found.sweeps;
    by("write").textContent = "Write " + found.file;
    takeKnobs(found);
    await refresh();
    if (!failed) tell("");
  } catch (error) {
    tell(error.message, true);
  }
})();
