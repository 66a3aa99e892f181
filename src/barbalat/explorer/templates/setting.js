// The values of the sliders, and the parameters of the modules that follow from them, which are copied or looked up.

import { doublesOf } from "./bytes.js";

const HELD_POINTS = 300; // points recorded while a slider is held, a few pixels apart; every solver step is still computed

export function readData(text) {
  const data = JSON.parse(text);
  for (const number of data.numbers) number.values = doublesOf(number.values);
  const grids = [...(data.signals.grids ?? []), ...data.numbers.flatMap((number) => number.grids ?? [])];
  data.signals.parameters = doublesOf(data.signals.parameters);
  for (const points of data.signals.points) {
    if (points) Object.assign(points, { times: doublesOf(points.times), values: doublesOf(points.values) });
  }
  for (const grid of grids) {
    for (const key of ["cuts", "values", "last"]) grid[key] = doublesOf(grid[key]);
  }
  for (const one of Object.values(data.delay?.weights ?? {})) one.whole = doublesOf(one.whole);
  for (const controller of data.controllers) {
    controller.judge.begins = doublesOf(controller.judge.begins);
    if (controller.condition) {
      controller.condition.parameters = doublesOf(controller.condition.parameters);
      for (const effect of Object.values(controller.condition.effects)) effect.table = effect.table && doublesOf(effect.table);
    }
    for (const variant of Object.values(controller.variants)) {
      variant.parameters = doublesOf(variant.parameters);
      variant.states = doublesOf(variant.states);
      for (const effect of Object.values(variant.effects)) effect.table = effect.table && doublesOf(effect.table);
    }
  }
  return data;
}

// The setting of the case itself.
export function caseSetting(data) {
  const { t_end: tEnd, dt, solver } = data.simulation;
  return {
    values: data.numbers.map((number) => number.value), tEnd, dt, solver, delay: data.delay ? data.delay.value : 0,
    projection: data.controllers.map((controller) => controller.projection),
    shown: data.controllers.map(() => true), lesson: "", held: false,
  };
}

// A sentence that says why the value is rejected, or "" if it is admissible.
export function refusal(number, value) {
  const { values, label, without } = number;
  const [low, high] = [values[0], values[values.length - 1]];
  if (!Number.isFinite(value)) return `${label}: write a number, such as ${number.value}.`;
  if (value < low || value > high) return `${label} must be from ${low} to ${high} here, got ${value}.`;
  if (without.includes(value) || (value === 0 && !values.includes(0))) return `${label} can't be ${value}, because that would be a different system.`;
  return "";
}

// Two numbers may change the same entry of a loop. Returns a sentence if the other one has been moved already, else "".
export function exclusion(data, setting, i, value) {
  const number = data.numbers[i];
  const { t_end: tEnd, dt } = data.simulation;
  if (number.grids && value !== number.value && (setting.dt !== dt || setting.tEnd !== tEnd)) {
    return `For a different ${number.label}, the times of the command's jumps are known only for h = ${dt} s and a horizon of ${tEnd} s: restore those first.`;
  }
  const other = data.numbers[number.excludes.find((k) => setting.values[k] !== data.numbers[k].value)];
  if (!other || value === number.value) return "";
  return `${number.label} changes the same entries of the loop as ${other.label} (${other.group}): set the latter back to ${other.value} first.`;
}

// The value that is set: the given one if it is only copied, else the nearest value whose consequences are tabulated.
export function taken(number, value) {
  if (number.copied && !(number.whole && !Number.isInteger(value))) return value;
  const apart = (one) => Math.abs(number.log ? Math.log(one / value) : one - value);
  return number.values.reduce((best, one) => (apart(one) < apart(best) ? one : best), number.values[0]);
}

// Splits a delay into whole steps and a fraction of a step. If the number of steps is within rounding error of an integer, that
// integer is used.
function stepsOf(delay, dt) {
  const steps = delay / dt;
  const nearest = Math.round(steps);
  const lag = Math.abs(steps - nearest) <= 1e-9 * Math.max(1, steps) ? nearest : Math.floor(steps);
  const fraction = Math.max(steps - lag, 0);
  return { lag, fraction: fraction * dt <= 1e-9 * delay ? 0 : fraction };
}

export function delayRefusal(data, setting, delay) {
  if (!Number.isFinite(delay)) return `Delay: write a number, such as ${data.delay.value}.`;
  const most = setting.tEnd;
  if (delay < setting.dt || delay > most) return `The delay must be from one step, ${setting.dt} s, to the horizon, ${most} s, got ${delay}.`;
  return "";
}

// The parts of the loop that act at sample times of their own, each as [name, sample time in s].
function clocksOf(data) {
  const sampled = data.controllers.filter(({ rhythm }) => rhythm).map(({ name, rhythm }) => [name, rhythm]);
  return data.noise ? [...sampled, ["the noise", data.noise.sample_time]] : sampled;
}

// The grid with the command's jumps for this horizon and step; undefined if none is known.
function gridOf(data, { values, tEnd, dt }) {
  const own = data.simulation;
  const j = data.numbers.findIndex((number, i) => number.grids && values[i] !== number.value);
  if (j >= 0) return dt === own.dt && tEnd === own.t_end ? data.numbers[j].grids[data.numbers[j].values.indexOf(values[j])] : undefined;
  return data.signals.grids.find((grid) => grid.dt === dt && grid.t_end === tEnd);
}

// Why this horizon and step are rejected, or "". The last argument gives the other values of the setting.
export function gridRefusal(data, tEnd, dt, { values, delay }) {
  if (![tEnd, dt, tEnd / dt].every((one) => one > 0 && one < Infinity)) return "Horizon and step must be positive numbers.";
  const steps = Math.round(tEnd / dt);
  if (steps > data.simulation.most_steps) return `That is ${steps} steps, but a page computes at most ${data.simulation.most_steps}.`;
  if (steps < 8 || Math.abs(steps * dt - tEnd) > 1e-9 * tEnd) return `The step must divide the horizon; ${tEnd / Math.max(steps, 8)} would.`;
  for (const [name, time] of clocksOf(data)) {
    const every = Math.round(time / dt);
    if (every < 1 || Math.abs(every * dt - time) > 1e-9 * time) return `The step must divide the sample time of ${name}, ${time} s.`;
    if (time > tEnd) return `The horizon must be at least the sample time of ${name}, ${time} s.`;
  }
  const jitters = drawnFaults(data, { values }).flatMap((fault) => (fault?.kind === "jitter" ? [fault.time] : []));
  if (jitters.some((time) => time < dt * (1 - 1e-9))) return `The step must be at most a jitter's time, ${Math.min(...jitters)} s.`;
  if (delay && stepsOf(delay, dt).lag < 1) return `The step must be at most the delay, ${delay} s.`;
  if (data.signals.grids && !gridOf(data, { values, tEnd, dt })) return jumpRefusal(data, values);
  return "";
}

// The module and the parameters with which a condition's impulse response is simulated; null if this setting has no condition.
function conditionTask(data, setting, controller, side) {
  const { condition } = controller;
  if (!condition || side !== controller.projection) return null;
  if (condition.lost.some((j) => setting.values[j] !== data.numbers[j].value)) return null;
  const parameters = condition.parameters.slice();
  for (const [j, effect] of Object.entries(condition.effects)) {
    const [value, number] = [setting.values[j], data.numbers[j]];
    if (value === number.value) continue;
    const from = number.values.indexOf(value) * effect.p.length;
    effect.p.forEach((row, k) => { parameters[row] = effect.table ? effect.table[from + k] : value; });
  }
  return { module: condition.module, parameters, states: condition.states, filter: condition.filter };
}

// The rows of the signals that jump, rescaled by the setting's values of the numbers that they are proportional to.
function scaledGrid(data, setting, grid) {
  const moved = data.numbers.flatMap((number, j) => (number.scales.length && setting.values[j] !== number.value ? [j] : []));
  if (!grid || !moved.length) return grid;
  const channels = grid.last.length;
  const found = { ...grid, values: grid.values.slice(), last: grid.last.slice() };
  for (const j of moved) {
    const { scales, value } = data.numbers[j];
    for (const part of [found.values, found.last]) {
      for (const channel of scales) {
        for (let i = channel; i < part.length; i += channels) part[i] = (part[i] / value) * setting.values[j];
      }
    }
  }
  return found;
}

// The faults, drawn with the numbers of this setting.
function drawnFaults(data, { values }) {
  const faults = structuredClone(data.signals.faults);
  data.numbers.forEach(({ drawn, value }, j) => {
    if (!drawn || values[j] === value) return;
    const [signal, keys] = drawn;
    const last = keys.length - 1;
    keys.slice(0, last).reduce((part, key) => part[key], faults[signal])[keys[last]] = values[j];
  });
  return faults;
}

function jumpRefusal(data, values) {
  const { t_end: tEnd, dt } = data.simulation;
  const moved = data.numbers.find((number, i) => number.grids && values[i] !== number.value);
  if (moved) return `The times of the command's jumps and corners are known only for the case's step and horizon: set ${moved.label} back to ${moved.value} first.`;
  const of = (key, other) => data.signals.grids.filter((grid) => grid[other] === data.simulation[other]).map((grid) => grid[key]).sort((a, b) => a - b);
  return `The command has jumps or corners, whose times are known for h = ${of("dt", "t_end").join(", ")} s with the horizon ${tEnd} s, and for horizons of `
    + `${of("t_end", "dt").join(", ")} s with h = ${dt} s.`;
}

function joined(first, second) {
  const found = new Float64Array(first.length + second.length);
  found.set(first);
  found.set(second, first.length);
  return found;
}

export function recordPoints(data, setting) {
  return setting.held ? Math.min(HELD_POINTS, data.simulation.record_points) : data.simulation.record_points;
}

export function taskOf(data, setting, index) {
  const controller = data.controllers[index];
  const side = controller.variants[setting.projection[index]] ? setting.projection[index] : controller.projection;
  const variant = controller.variants[side];
  const parameters = variant.parameters.slice();
  const states = variant.states.slice();
  const signals = { ...data.signals, parameters: data.signals.parameters.slice(), faults: drawnFaults(data, setting), grids: null };
  data.numbers.forEach((number, j) => {
    const value = setting.values[j];
    for (const place of number.signals) signals.parameters[place] = value;
    const effect = variant.effects[j];
    if (!effect || value === number.value) return;
    const width = effect.p.length + effect.s.length;
    const from = number.values.indexOf(value) * width;
    const at = (k) => (effect.table ? effect.table[from + k] : value);
    effect.p.forEach((row, k) => { parameters[row] = at(k); });
    effect.s.forEach((row, k) => { states[row] = at(effect.p.length + k); });
  });
  const dtRow = parameters.length - 1; // a controller without projection has fewer numbers
  parameters[dtRow] = setting.dt;
  const { lag, fraction } = setting.delay ? stepsOf(setting.delay, setting.dt) : { lag: 0, fraction: 0 };
  const steps = Math.round(setting.tEnd / setting.dt);
  const known = scaledGrid(data, setting, data.signals.grids && gridOf(data, setting));
  const scaled = data.numbers.flatMap((number, j) => (number.scales.length || number.grids ? [setting.values[j]] : []));
  return {
    index, parameters: lag ? joined(parameters, data.delay.weights[setting.solver].whole) : parameters, signals, lag,
    states: joined(states, controller.judge.begins), own: states.length, judge: { ...data.judge, ...controller.judge },
    between: fraction ? { fraction, name: `weights ${setting.solver}`, module: data.delay.weights[setting.solver].module, first: parameters.length } : null,
    grid: { steps, tEnd: setting.tEnd, ...known },
    tableKey: `${setting.tEnd} ${steps} ${scaled} ${JSON.stringify(signals.faults)}`, nodes: data.solvers[setting.solver].nodes,
    polynomial: data.solvers[setting.solver].polynomial, spectrum: variant.spectrum, watching: data.watching, condition: conditionTask(data, setting, controller, side), dt: setting.dt, recordPoints: recordPoints(data, setting),
    module: `${index} ${side} ${setting.solver}`, code: variant.modules[setting.solver], shape: controller.shape, past: controller.past,
    reported: controller.reported, dtRow,
    operations: controller.operations, model: controller.model, thetaHat: controller.theta_hat,
    noise: data.noise && { ...data.noise, hold: Math.round(data.noise.sample_time / setting.dt) },
    sampleEvery: controller.jitters ? 1 : controller.rhythm ? Math.round(controller.rhythm / setting.dt) : 0,
  };
}

