// Lessons. Each has an initial setting, a goal that is checked after every run, and the claims that it illustrates.

import { caseSetting } from "./setting.js";

const WORDS = {
  max_abs_e: "largest error", tail_max_abs_e: "largest error in the tail", theta_hat_variation_rate: "variation of the estimates, 1/s",
};

function largest(figures, name) {
  const value = figures[name];
  if (value === null) return null;
  return Array.isArray(value) ? Math.max(...value) : value;
}

function compared(found, relation, wanted) {
  if (found === null || wanted === null) return false;
  return { "<": found < wanted, ">": found > wanted, "<=": found <= wanted * (1 + 1e-9), ">=": found >= wanted * (1 - 1e-9) }[relation];
}

function settingOf(data, setting, path) {
  const own = { "simulation.dt": setting.dt, "simulation.t_end": setting.tEnd, "plant.input.delay": setting.delay };
  return path in own ? own[path] : setting.values[data.numbers.findIndex((number) => number.path === path)];
}

function short(value) {
  return value === null ? "none: the run diverged" : String(Number(value.toPrecision(3)));
}

// Returns whether a check holds, and a phrase with the value found.
function judged(data, setting, figures, started, check) {
  if ("unprojected" in check) return [setting.projection[check.unprojected] === "off", "projection is on again"];
  if ("bounded" in check) {
    const { diverged_at: at, lost } = figures[check.bounded];
    const said = at === null ? "is lost" : `diverges at ${short(at)} s`;
    return [!lost, `${data.controllers[check.bounded].name} ${said}`];
  }
  if ("path" in check) {
    const value = settingOf(data, setting, check.path);
    const number = data.numbers.find((one) => one.path === check.path);
    const name = number ? number.label : { "simulation.dt": "the step", "plant.input.delay": "the delay" }[check.path];
    return [compared(value, check.relation, check.value), `${name} is ${value}`];
  }
  const found = largest(figures[check.controller], check.figure);
  const whole = { null: () => 1, start: () => largest(started[check.controller], check.figure) }[check.share]
    ?? (() => largest(figures[check.share], check.figure));
  const of = whole();
  const wanted = of === null ? null : check.value * of;
  const said = `${data.controllers[check.controller].name}: ${WORDS[check.figure]} ${short(found)}, wanted ${check.relation} ${short(wanted)}`;
  return [compared(found, check.relation, wanted), said];
}

export function reached(data, lesson, setting, figures, started) {
  const all = lesson.checks.map((check) => judged(data, setting, figures, started, check));
  return { holds: all.every(([holds]) => holds), missing: all.filter(([holds]) => !holds).map(([, said]) => said) };
}

export function withNumbers(data, setting, numbers) {
  for (const [path, value] of Object.entries(numbers)) {
    if (path === "simulation.dt") setting.dt = value;
    else if (path === "plant.input.delay") setting.delay = value;
    else setting.values[data.numbers.findIndex((number) => number.path === path)] = value;
  }
  return setting;
}

// The initial setting of the page or of one of its lessons.
export function beginningOf(data, key) {
  const setting = caseSetting(data);
  const lesson = lessonOf(data, key);
  if (!lesson) return setting;
  setting.lesson = lesson.key;
  setting.shown = lesson.shown.slice();
  for (const [i, side] of Object.entries(lesson.projection)) setting.projection[i] = side;
  return withNumbers(data, setting, lesson.numbers);
}

export function lessonOf(data, key) {
  return data.lessons.find((lesson) => lesson.key === key) || null;
}

function claimOf(claim) {
  const row = document.createElement("li");
  const name = document.createElement(claim.place ? "a" : "code");
  if (claim.place) name.href = claim.place;
  name.textContent = claim.id;
  row.append(name);
  if (claim.finding) {
    const finding = document.createElement("b");
    finding.textContent = claim.finding;
    row.append(`: ${claim.statement}. Finding: `, finding, `. ${claim.headline}`);
  } else row.append(`: “${claim.statement}”. barbalat claims ${claim.id} measures this.`);
  return row;
}

// The list of lessons above the settings. begin(key) starts a lesson and example(lesson) sets its solution.
export class Lessons {
  constructor(root, data, begin, example) {
    this.root = root;
    this.data = data;
    this.started = null;
    root.hidden = data.lessons.length === 0;
    if (root.hidden) return;
    const at = (name) => root.querySelector(`[data-part=${name}]`);
    this.parts = Object.fromEntries(["choice", "text", "goal", "said", "claims", "again", "example", "body"].map((name) => [name, at(name)]));
    const none = new Option("choose one, or move the sliders freely", "");
    this.parts.choice.append(none, ...data.lessons.map((lesson) => new Option(lesson.title, lesson.key)));
    this.parts.choice.addEventListener("change", () => begin(this.parts.choice.value));
    this.parts.again.addEventListener("click", () => begin(this.parts.choice.value));
    this.parts.example.addEventListener("click", () => example(lessonOf(data, this.parts.choice.value)));
  }

  // Starts a lesson from its beginning. Its first runs are the reference for goals that are fractions of a starting value.
  begun(key) {
    this.started = null;
    this.lesson = lessonOf(this.data, key);
    if (this.root.hidden) return;
    const { choice, text, goal, said, claims, body } = this.parts;
    choice.value = this.lesson ? key : "";
    body.hidden = !this.lesson;
    said.textContent = "";
    delete this.root.dataset.goal;
    if (!this.lesson) return;
    text.textContent = this.lesson.text;
    goal.textContent = this.lesson.goal;
    claims.replaceChildren(...this.lesson.claims.map(claimOf));
  }

  // Checks the goal after runs. figures are those of each controller, null for one that is not simulated.
  told(setting, figures) {
    if (!this.lesson) return;
    const needed = this.lesson.shown.flatMap((shown, i) => (shown ? [i] : []));
    if (needed.some((i) => !figures[i])) return;
    this.started ??= figures.slice();
    const { holds, missing } = reached(this.data, this.lesson, setting, figures, this.started);
    this.root.dataset.goal = holds ? "reached" : "open";
    this.parts.said.textContent = holds ? "Reached." : `Not yet: ${missing.join("; ")}.`;
  }
}
