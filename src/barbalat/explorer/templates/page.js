// The page: stores the setting, sends changed simulations to the workers and shows their results.

/* global document, location, history, navigator, Blob, Worker, URL */

import { readData, taskOf } from "./setting.js";
import { beginningOf, Lessons, withNumbers } from "./lessons.js";
import { fromHash, toHash } from "./address.js";
import { caseFileOf, pythonOf } from "./copies.js";
import { Charts } from "./charts.js";
import { panelsOf } from "./panels.js";
import { Figures, heldText, verdictText } from "./table.js";
import { built } from "./controls.js";

const byId = (id) => document.getElementById(id);
const data = readData(byId("data").textContent);
const setting = beginningOf(data, "");
const runs = data.controllers.map(() => null);
const keys = data.controllers.map(() => "");
const wanted = data.controllers.map(() => null);
const busy = data.controllers.map(() => false);
const costs = data.controllers.map(() => 0);
const behind = data.controllers.map(() => null); // what a controller has been waiting for since its last result
const results = document.querySelectorAll(".result");
let asked = 0;
let pinned = null;
let drawn = 0;
let drawnAt = 0;
const PATIENCE = 150; // ms without a picture, after which finished runs are drawn before the others have arrived
const LATE = 300; // ms without a result, after which the page says that it shows the previous setting
let following = null; // the setting that follows once the lesson's initial setting has been simulated

const source = URL.createObjectURL(new Blob([JSON.parse(byId("worker").textContent)], { type: "text/javascript" }));
const count = Math.max(1, Math.min(data.controllers.length, navigator.hardwareConcurrency || 1));
const idle = Array.from({ length: count }, started);

function started() {
  const worker = new Worker(source);
  worker.onerror = (event) => { byId("failed").textContent = `This browser can't run the page's simulations: ${event.message}`; };
  worker.onmessage = ({ data: answer }) => {
    if ("done" in answer) {
      busy[answer.index].done = answer.done;
      showProgress();
      return;
    }
    idle.push(worker);
    answered(answer);
    send();
  };
  return worker;
}

function changed() {
  following = null;
  history.replaceState(null, "", `#${toHash(data, setting)}`);
  request();
}

// Stops the simulation of a controller whose result nothing will show.
function abandon(i) {
  if (!waits(i)) return;
  if (busy[i]) {
    const { worker } = busy[i];
    worker.onmessage = null; // the last message may already be on its way
    worker.terminate();
    idle.push(started());
  }
  [busy[i], wanted[i], behind[i], keys[i]] = [false, null, null, ""];
}

// A lesson begins: no result of the setting before it arrives any more.
function abandonAll() {
  data.controllers.forEach((_, i) => abandon(i));
}

function request() {
  const before = keys.join();
  data.controllers.forEach((_, i) => {
    if (!setting.shown[i]) {
      abandon(i);
      return;
    }
    const task = taskOf(data, setting, i);
    const key = [task.module, task.tableKey, task.signals.parameters, task.parameters, task.states, task.lag, task.between?.fraction, task.recordPoints, task.condition?.parameters].join(" ");
    if (key === keys[i]) return;
    keys[i] = key;
    wanted[i] = { task, began: performance.now() };
    if (!behind[i]) awaited(i);
  });
  if (keys.join() !== before) asked += 1;
  send();
  document.body.dataset.state = "busy";
  if (!waiting()) show();
}

function waits(i) {
  return Boolean(busy[i] || wanted[i]);
}

function waiting() {
  return data.controllers.some((_, i) => waits(i));
}

// Says so if a controller's next result takes long.
function awaited(i) {
  const next = {};
  behind[i] = next;
  setTimeout(() => { if (behind[i] === next) sayRunning(i); }, LATE);
}

// Marks the results on the page as those of an earlier setting. The first setting has none.
function sayRunning(i) {
  const steps = (busy[i] || wanted[i]).task.grid.steps.toLocaleString("en");
  showProgress();
  const earlier = asked > 1 && drawnAt > 0;
  byId("running").textContent = `Running ${steps} steps …${earlier ? " The panels show the previous setting." : ""}`;
  for (const one of results) {
    one.setAttribute("aria-busy", "true");
    one.classList.toggle("earlier", earlier);
  }
}

// The progress of the slowest run, without words, since a live region would read each of them out.
function showProgress() {
  const done = data.controllers.flatMap((_, i) => (waits(i) ? [busy[i].done ?? 0] : []));
  byId("running").style.setProperty("--done", `${(100 * Math.min(...done)).toFixed()}%`);
}

function sayDone() {
  byId("running").textContent = "";
  for (const one of results) {
    one.removeAttribute("aria-busy");
    one.classList.remove("earlier");
  }
}

// Sends tasks to the free workers, beginning with the one that took longest last time.
function send() {
  while (idle.length) {
    const free = wanted.flatMap((one, i) => (one && !busy[i] ? [i] : []));
    if (!free.length) return;
    const i = free.reduce((best, one) => (costs[one] > costs[best] ? one : best));
    busy[i] = { ...wanted[i], worker: idle.pop() };
    wanted[i] = null;
    busy[i].worker.postMessage({ ...busy[i].task, id: i });
  }
}

function answered(answer) {
  const i = answer.index;
  const { task, began } = busy[i];
  busy[i] = false;
  behind[i] = null;
  if (wanted[i]) awaited(i);
  if (answer.failed) {
    runs[i] = null;
    byId("failed").textContent = `${data.controllers[i].name} can't be simulated here: ${answer.failed}`;
  } else {
    const { tEnd, steps } = task.grid;
    answer.t = answer.starts.map((k) => (k * tEnd) / steps);
    answer.began = began;
    answer.coarse = task.recordPoints < data.simulation.record_points;
    runs[i] = answer;
    costs[i] = answer.milliseconds;
    byId("failed").textContent = "";
  }
  if (!waiting() || performance.now() - drawnAt > PATIENCE) show();
}

function show() {
  if (drawn) return;
  drawn = requestAnimationFrame(() => {
    drawn = 0;
    draw();
  });
}

// Whether a run is so large that the panels are scaled to the other runs.
function beyondAll({ figures, verdict }) {
  return figures.diverged_at !== null || (verdict.kind === "lost" && !(figures.max_abs_e[verdict.worst] <= data.judge.lostShare * verdict.scale));
}

function labelled(of, dash, after) {
  return of.flatMap((run, i) => {
    if (!run || !setting.shown[i]) return [];
    const name = `${data.controllers[i].name}${after}`;
    return [{ run, colour: i, dash, label: name, name, gone: beyondAll(run) }];
  });
}

function draw() {
  const begun = performance.now();
  const live = labelled(runs, null, "");
  const kept = pinned ? labelled(pinned.runs, [4, 3], ", pinned") : [];
  const moved = data.numbers.some((number, i) => /^(plant|reference_model)/.test(number.path) && setting.values[i] !== number.value);
  charts.draw(panelsOf(data, [...live, ...kept], moved));
  figures.show([...live, ...kept]);
  byId("conditions").replaceChildren(...[...live, ...kept].filter(({ run }) => data.controllers[run.index].condition).map(conditionText));
  byId("verdicts").replaceChildren(...[...live, ...kept].map(verdictLine), ...heldText(data, setting.tEnd).map((text) => line(text, "note")));
  byId("coarse").style.visibility = live.some(({ run }) => run.coarse) ? "visible" : "hidden"; // it keeps its space, so that the layout does not jump
  drawnAt = performance.now();
  document.body.dataset.drawing = (drawnAt - begun).toFixed(1);
  if (!waiting()) {
    sayDone();
    settled(live);
  }
  document.body.dataset.state = waiting() || drawn ? "busy" : "ready";
}

function line(text, className) {
  return Object.assign(document.createElement("p"), { className, textContent: text });
}

function verdictLine({ run, label }) {
  const said = line("", "verdict");
  said.dataset.kind = run.verdict.kind;
  said.append(
    Object.assign(document.createElement("strong"), { textContent: `${label}: ` }),
    Object.assign(document.createElement("span"), { textContent: verdictText(run) }),
  );
  return said;
}

function conditionText({ run, label }) {
  const { condition } = run;
  const value = condition === null ? "no estimate at this setting" : `${Number(condition.toPrecision(4))} (estimate, by the simulated impulse response)`;
  const said = condition === null ? "" : condition < 1 ? ", which is below 1, so by this estimate the condition holds" : ", which is not below 1, so by this estimate the condition fails, and with it the bound (10)";
  const found = line(`${label}: condition ‖W_b (1 − C)‖₁ θ_max of Theorem 1 (ii): ${value}${said}.`, "note");
  found.dataset.condition = condition === null ? "" : String(condition);
  return found;
}

// Called when all runs of the setting have arrived and are drawn.
function settled(live) {
  const { dataset } = document.body;
  dataset.milliseconds = Math.min(Infinity, ...live.map(({ run }) => performance.now() - run.began)).toFixed(1);
  dataset.simulating = live.map(({ run }) => run.milliseconds.toFixed(1)).join(" ");
  dataset.stepping = live.map(({ run }) => run.stepping.toFixed(1)).join(" ");
  if (live.length) byId("spoken").textContent = `${live.map(({ run, label }) => `${label}: ${verdictText(run)}`).join("; ")}.`;
  lessons.told(setting, runs.map((run, i) => (run && setting.shown[i] ? { ...run.figures, lost: run.verdict.kind === "lost" } : null)));
  if (!following) return;
  Object.assign(setting, following);
  following = null;
  controls.show();
  request();
}

// Reads the setting from the address. If the address names a lesson and changes its setting, the lesson's initial setting is
// simulated first and the changed one after it.
function entered() {
  abandonAll();
  const given = fromHash(data, location.hash.slice(1));
  const beginning = beginningOf(data, given.lesson);
  following = given.lesson && toHash(data, given) !== toHash(data, beginning) ? given : null;
  lessons.begun(given.lesson);
  Object.assign(setting, following ? beginning : given);
  controls.show();
  request();
}

function begin(key) {
  abandonAll();
  lessons.begun(key);
  Object.assign(setting, beginningOf(data, key));
  controls.show();
  changed();
}

function copied(text) {
  byId("copied").value = text;
  byId("copy").showModal();
  byId("copied").select();
  navigator.clipboard?.writeText(text).catch(() => undefined); // a page opened from disk may be refused; the text is selected anyway
}

const figures = new Figures(byId("figures"));
const charts = new Charts(byId("charts"), (min, max) => {
  byId("from").value = Number(min.toPrecision(4));
  byId("to").value = Number(max.toPrecision(4));
});
const controls = built(byId("controls"), data, setting, changed);
const lessons = new Lessons(byId("lessons"), data, begin, (lesson) => {
  Object.assign(setting, withNumbers(data, beginningOf(data, lesson.key), lesson.example));
  controls.show();
  changed();
});

byId("fixed").textContent = data.fixed;
byId("about-u").textContent = data.about_u ? `max |u|: ${data.about_u}.` : "";
byId("case-file").hidden = !data.case_file;
byId("case-file").addEventListener("click", () => copied(caseFileOf(data, setting)));
byId("python").addEventListener("click", () => copied(pythonOf(data, setting)));
byId("close").addEventListener("click", () => byId("copy").close());
byId("reset").addEventListener("click", () => begin(""));
byId("pin").addEventListener("click", () => {
  pinned = pinned ? null : { runs: runs.slice() };
  byId("pin").setAttribute("aria-pressed", String(Boolean(pinned)));
  show();
});
for (const id of ["from", "to"]) byId(id).addEventListener("change", () => charts.zoom(Number(byId("from").value), Number(byId("to").value)));
byId("whole").addEventListener("click", () => charts.whole());
window.addEventListener("resize", () => charts.resized());
window.addEventListener("hashchange", entered);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
entered();
