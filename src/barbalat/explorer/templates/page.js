// The page: keeps the setting, hands what changed to workers, shows what comes back.

/* global document, location, history, navigator, Blob, Worker, URL */

import { readData, initialSetting, taskOf, toHash, fromHash } from "./setting.js";
import { caseFileOf, pythonOf } from "./copies.js";
import { Charts, panelsOf } from "./charts.js";
import { built } from "./controls.js";

const byId = (id) => document.getElementById(id);
const data = readData(byId("data").textContent);
const setting = fromHash(data, location.hash.slice(1));
const NAMES = {
  max_abs_e: "max |e|", tail_max_abs_e: "max |e|, tail", rms_e: "RMS e", max_abs_u: "max |u|", theta_hat_final: "estimates at the end",
  theta_hat_variation_rate: "variation, 1/s",
};
const runs = data.controllers.map(() => null);
const keys = data.controllers.map(() => "");
const wanted = data.controllers.map(() => null);
const busy = data.controllers.map(() => false);
let pinned = null;
let drawn = 0;

const source = URL.createObjectURL(new Blob([JSON.parse(byId("worker").textContent)], { type: "text/javascript" }));
const count = Math.max(1, Math.min(data.controllers.length, navigator.hardwareConcurrency || 1));
const workers = Array.from({ length: count }, () => new Worker(source));
for (const worker of workers) worker.onmessage = ({ data: answer }) => answered(answer);

function changed() {
  history.replaceState(null, "", `#${toHash(data, setting)}`);
  request();
}

function request() {
  data.controllers.forEach((_, i) => {
    if (!setting.shown[i]) return;
    const task = taskOf(data, setting, i);
    const key = [task.module, task.tableKey, task.signals.parameters, task.parameters, task.states, task.lag].join(" ");
    if (key === keys[i]) return;
    keys[i] = key;
    wanted[i] = { task, began: performance.now() };
    send(i);
  });
  document.body.dataset.state = busy.some(Boolean) ? "busy" : "ready";
  show();
}

function send(i) {
  if (busy[i] || !wanted[i]) return;
  busy[i] = wanted[i];
  wanted[i] = null;
  workers[i % count].postMessage({ ...busy[i].task, id: i });
}

function answered(answer) {
  const i = answer.index;
  const { task, began } = busy[i];
  busy[i] = false;
  if (answer.failed) byId("failed").textContent = `${data.controllers[i].name} can't be simulated here: ${answer.failed}`;
  else {
    const { tEnd, steps } = task.grid;
    answer.t = Array.from(answer.starts, (k) => (k * tEnd) / steps);
    answer.began = began;
    runs[i] = answer;
    byId("failed").textContent = "";
  }
  send(i);
  show();
}

function show() {
  if (drawn) return;
  drawn = requestAnimationFrame(() => {
    drawn = 0;
    draw();
  });
}

function draw() {
  const live = runs.flatMap((run, i) => (run && setting.shown[i] ? [{ run, colour: i, dash: null, label: data.controllers[i].name }] : []));
  const kept = pinned
    ? pinned.runs.flatMap((run, i) => (run && setting.shown[i] ? [{ run, colour: i, dash: [4, 3], label: `${data.controllers[i].name}, pinned` }] : []))
    : [];
  const moved = data.numbers.some((number, i) => /^(plant|reference_model)/.test(number.path) && setting.values[i] !== number.value);
  charts.draw(panelsOf(data, [...live, ...kept], moved));
  figuresTable(live, kept);
  const waiting = busy.some(Boolean);
  document.body.dataset.state = waiting ? "busy" : "ready";
  if (!waiting && live.length) {
    document.body.dataset.milliseconds = Math.max(...live.map(({ run }) => performance.now() - run.began)).toFixed(1);
    document.body.dataset.simulating = live.map(({ run }) => run.milliseconds.toFixed(1)).join(" ");
    const ends = live.map(({ run, label }) => `${label} ${run.figures.diverged_at === null ? "stays bounded" : `diverges at ${brief(run.figures.diverged_at)} s`}`);
    byId("spoken").textContent = `${ends.join(", ")}.`;
  }
}

function brief(value) {
  if (value === null) return "–";
  if (Array.isArray(value)) return value.length ? value.map(brief).join(", ") : "–";
  return value === 0 ? "0" : String(Number(value.toPrecision(4)));
}

function figuresTable(live, kept) {
  const body = byId("figures");
  body.textContent = "";
  for (const { run, label } of [...live, ...kept]) {
    const row = body.insertRow();
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = label;
    row.append(head);
    const { figures } = run;
    if (figures.diverged_at !== null) {
      const cell = row.insertCell();
      cell.colSpan = Object.keys(NAMES).length;
      cell.textContent = `diverged at t = ${brief(figures.diverged_at)} s`;
    } else {
      for (const [key, name] of Object.entries(NAMES)) {
        const cell = row.insertCell();
        cell.dataset.label = name;
        cell.textContent = brief(figures[key]);
      }
    }
    row.dataset.figures = JSON.stringify(figures);
  }
}

function copied(text) {
  const dialog = byId("copy");
  byId("copied").value = text;
  dialog.showModal();
  byId("copied").select();
  navigator.clipboard?.writeText(text).catch(() => undefined); // a page from disk may not; the text is selected
}

const charts = new Charts(byId("charts"), (min, max) => {
  byId("from").value = brief(min);
  byId("to").value = brief(max);
});
const controls = built(byId("controls"), data, setting, changed);

byId("case-file").hidden = !data.case_file;
byId("case-file").addEventListener("click", () => copied(caseFileOf(data, setting)));
byId("python").addEventListener("click", () => copied(pythonOf(data, setting)));
byId("close").addEventListener("click", () => byId("copy").close());
byId("reset").addEventListener("click", () => {
  Object.assign(setting, initialSetting(data));
  controls.show();
  changed();
});
byId("pin").addEventListener("click", () => {
  pinned = pinned ? null : { runs: runs.slice() };
  byId("pin").setAttribute("aria-pressed", String(Boolean(pinned)));
  show();
});
for (const id of ["from", "to"]) {
  byId(id).addEventListener("change", () => {
    const [min, max] = [Number(byId("from").value), Number(byId("to").value)];
    if (min < max) charts.zoom(min, max);
  });
}
byId("whole").addEventListener("click", () => charts.whole());
window.addEventListener("resize", () => charts.resized());
window.addEventListener("hashchange", () => {
  Object.assign(setting, fromHash(data, location.hash.slice(1)));
  controls.show();
  request();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
request();
