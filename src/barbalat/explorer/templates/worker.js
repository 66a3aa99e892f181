// Simulates one setting of one controller at a time. Kernels and the table of commands are kept for the next setting.

import { bytesOf } from "./bytes.js";
import { CHUNK_STEPS, segmentsOf, Table } from "./grid.js";
import { Drawing } from "./faults.js";
import { computedValues, Kernel, ringRows } from "./kernel.js";
import { Noise } from "./noise.js";
import { Totals } from "./figures.js";
import { Continued, cycleOf, heldIn, Kept, renew, slowestPeriod, verdictOf } from "./judge.js";
import { conditionOf } from "./impulse.js";
import { stabilityOf, Watch } from "./stability.js";

const TELL_EVERY = 100; // ms between two reports of progress
const kernels = new Map();
const conditions = new Map(); // the last condition of each controller
let table = null;
let noise = null;

function kernelOf(name, text) {
  if (!kernels.has(name)) kernels.set(name, new Kernel(bytesOf(text)));
  return kernels.get(name);
}

function tableFor(task) {
  const { grid, signals } = task;
  const key = `${task.tableKey} ${task.nodes} ${Array.from(signals.parameters)}`;
  if (table === null || table.key !== key) {
    const kernel = kernelOf("signals", signals.module);
    const drawing = signals.drawing && new Drawing(kernelOf("drawing", signals.drawing.module), signals.drawing);
    const smooth = (times) => computedValues(kernel, drawing, signals, times);
    table = new Table(grid, smooth, signals, task.nodes, task.shape.pieces);
    table.key = key;
  }
  return table;
}

function noiseFor(task) {
  const key = `${task.noise.seed} ${task.noise.hold}`;
  if (noise === null || noise.key !== key) {
    noise = new Noise(kernelOf("noise", task.noise.module), task.noise);
    noise.key = key;
  }
  return noise;
}

// The interpolation weights of a delay that is not a whole number of steps. They are the last parameters.
function weightsOf({ between, parameters }) {
  const kernel = kernelOf(between.name, between.module);
  const count = parameters.length - between.first;
  const [row, out] = kernel.laidOut([1, count]);
  kernel.view(row, 1)[0] = between.fraction;
  kernel.call(1, 1, { state: row, parameters: row, signals: row, out }, 0, 0);
  return kernel.view(out, count).slice();
}

// Lays out the arrays in the kernel's memory and fills them with the initial values of a run.
function begun(kernel, task, longest, most, noisy, windows) {
  const { shape, lag } = task;
  const remembered = lag ? ringRows(lag) * shape.delayed : 0;
  const size = shape.states + shape.accumulators;
  const sizes = [shape.states, task.parameters.length, lag ? 1 : 0, remembered, longest, most * size, noisy, windows];
  const [state, parameters, lags, ring, signals, out, noise, watched] = kernel.laidOut(sizes);
  const at = { state, parameters, lags, ring, signals, out, noise, watched, hold: task.noise ? task.noise.hold : 1 };
  kernel.view(state, shape.states).set(task.states);
  kernel.view(parameters, task.parameters.length).set(task.parameters);
  if (task.between) kernel.view(parameters, task.parameters.length).set(weightsOf(task), task.between.first);
  const history = lag ? task.past.flatMap((value) => Array(shape.delayed / task.past.length).fill(value)) : [];
  return { at, mask: lag ? kernel.remember(lag, at, history) : 0n, ringAt: remembered };
}

// The states that a scheme reports at the end, after a sampled controller has acted there. A step of zero length computes them.
function reportedAtEnd(kernel, task, at, mask, finalState) {
  if (!Object.keys(task.reported).length) return {};
  kernel.view(at.state, finalState.length).set(finalState);
  kernel.view(at.parameters, task.parameters.length)[task.dtRow] = 0;
  kernel.call(1, 1, at, task.grid.steps, task.sampleEvery, mask);
  const state = kernel.view(at.state, finalState.length);
  return Object.fromEntries(Object.entries(task.reported).map(([name, rows]) => [`${name}_final`, rows.map((row) => state[row])]));
}

// The loop's Jacobian at each of these steps of the run, with the given states.
function matricesAt(task, commands, steps, states) {
  const { spectrum } = task;
  const [size, timed, nonzeros] = [task.own, commands.count, spectrum.rows.length];
  const channels = task.noise ? task.noise.channels : 0;
  const signals = commands.at(steps);
  const drawn = channels ? steps.map((step) => noiseFor(task).rows(step, 1)) : [];
  const width = size + timed + channels;
  const kernel = kernelOf(`spectrum ${task.module.replace(/ [^ ]*$/, "")}`, spectrum.module);
  const [parameters, rows, out] = kernel.laidOut([task.parameters.length, steps.length * width, steps.length * nonzeros]);
  kernel.view(parameters, task.parameters.length).set(task.parameters);
  const view = kernel.view(rows, steps.length * width);
  steps.forEach((_, i) => {
    view.set(states[i].subarray(0, size), i * width);
    view.set(signals.subarray(i * timed, (i + 1) * timed), i * width + size);
    if (channels) view.set(drawn[i], i * width + size + timed);
  });
  if (steps.length) kernel.call(steps.length, 1, { state: parameters, parameters, signals: rows, out }, 0, 0);
  const entries = kernel.view(out, steps.length * nonzeros);
  return steps.map((_, k) => {
    const matrix = new Float64Array(size * size);
    for (let e = 0; e < nonzeros; e++) matrix[spectrum.rows[e] * size + spectrum.columns[e]] = entries[k * nonzeros + e];
    return matrix;
  });
}

// Repeats parts of a run bit for bit. It starts from a recorded step or, with a delay, from t = 0, since the record does not
// contain the delayed values. A place is {step, state, ring}.
class Replay {
  constructor(task, kernel, commands, starts, recorded, size) {
    Object.assign(this, { task, kernel, commands, starts, recorded, size });
  }

  known(step) {
    const { starts, recorded, size, task } = this;
    let k = 0;
    if (!task.lag) while (k + 1 < starts.length && starts[k + 1] <= step) k++;
    return this.advance({ step: starts[k], state: recorded.slice(k * size, k * size + task.shape.states), ring: null }, step);
  }

  advance(place, stop, watch = new Watch(this.task.shape.states, place.step, Math.max(stop, place.step + 1), CHUNK_STEPS)) {
    const { task, kernel, commands } = this;
    let { step, state, ring } = place;
    while (step < stop) {
      const count = Math.min(CHUNK_STEPS, stop - step);
      const rows = commands.made(step, step + count);
      const drawn = task.noise ? noiseFor(task).rows(step, count) : [];
      const { at, mask, ringAt } = begun(kernel, task, rows.length, 1, drawn.length, watch.rows.length);
      kernel.view(at.state, state.length).set(state);
      if (ring) kernel.view(at.ring, ringAt).set(ring);
      kernel.view(at.signals, rows.length).set(rows);
      kernel.view(at.noise, drawn.length).set(drawn);
      watched(kernel, at, watch);
      kernel.call(1, count, at, step, task.sampleEvery, mask);
      state = kernel.view(at.state, state.length).slice();
      ring = task.lag ? kernel.view(at.ring, ringAt).slice() : null;
      watch.rows.set(kernel.view(at.watched, watch.rows.length));
      step += count;
    }
    return { step, state, ring };
  }

  // All steps from begin to stop - 1, each before a sampled controller acts: the Jacobian does not depend on the held control.
  every(known, begin, stop) {
    const found = { steps: [], states: [] };
    for (let place = this.advance(known, begin); place.step < stop; place = this.advance(place, place.step + 1)) {
      found.steps.push(place.step);
      found.states.push(place.state);
    }
    return found;
  }
}

function watched(kernel, at, watch) {
  Object.assign(at, { watchFirst: watch.first, watchWindow: watch.window });
  kernel.view(at.watched, watch.rows.length).set(watch.rows);
}

// The condition of a controller. It is computed again only if its parameters have changed; most sliders do not change them.
function conditionFor({ index, condition }) {
  const key = condition.parameters.join();
  if (conditions.get(index)?.key !== key) conditions.set(index, { key, value: conditionOf({ ...condition, kernels }) });
  return conditions.get(index).value;
}

// Simulates a task. told(fraction) is called with the fraction of the steps that are done.
export function simulated(task, told = () => undefined) {
  const began = performance.now();
  const { grid, shape } = task;
  const commands = tableFor(task);
  const segments = segmentsOf(grid.steps, task.recordPoints);
  const size = shape.states + shape.accumulators;
  const stopOf = (one) => one.start + one.blocks * one.length;
  const longest = Math.max(1, ...segments.map((one) => commands.rowsBefore(stopOf(one)) - commands.rowsBefore(one.start)));
  const kernel = kernelOf(task.module, task.code);
  const steps = (one) => one.blocks * one.length;
  const drawn = task.noise ? noiseFor(task) : null;
  const noisy = drawn ? (2 + Math.ceil(Math.max(...segments.map(steps)) / drawn.hold)) * drawn.channels : 0;
  const watch = task.spectrum ? Watch.ofRun(task) : null;
  const windows = watch ? watch.rows.length : 0;
  const { at, mask, ringAt } = begun(kernel, task, longest * commands.width, Math.max(...segments.map((one) => one.blocks)), noisy, windows);
  if (watch) watched(kernel, at, watch);
  const disturb = (start, count) => {
    if (!drawn) return;
    const values = drawn.rows(start, count);
    kernel.view(at.noise, values.length).set(values);
  };
  const totals = new Totals(task.operations);
  const blocks = segments.reduce((sum, one) => sum + one.blocks, 0);
  const recorded = new Float64Array(blocks * size);
  const starts = new Float64Array(blocks);
  const timed = commands.count;
  const signals = new Float64Array(blocks * timed);
  let kept = 0;
  let bounded = true;
  let stepping = 0;
  let beforeTail = null;
  const memory = () => kernel.view(at.state + 8 * task.own, task.judge.begins.length);
  for (const one of segments) {
    if (one.inTail && !beforeTail) {
      beforeTail = memory().slice();
      renew(task.judge, memory(), task.judge.renewed.tail);
    }
    const rows = commands.rows(one.start, stopOf(one));
    kernel.view(at.signals, rows.length).set(rows);
    disturb(one.start, steps(one));
    const called = performance.now();
    kernel.call(one.blocks, one.length, at, one.start, task.sampleEvery, mask);
    stepping += performance.now() - called;
    const out = kernel.view(at.out, one.blocks * size);
    recorded.set(out, kept * size);
    const before = commands.rowsBefore(one.start);
    for (let i = 0; i < one.blocks; i++) {
      const step = one.start + i * one.length;
      starts[kept + i] = step;
      const row = (commands.rowsBefore(step) - before) * commands.width;
      for (let j = 0; j < timed; j++) signals[(kept + i) * timed + j] = rows[row + j];
    }
    kept += one.blocks;
    bounded = totals.merge(one, out, shape.states);
    if (!bounded) break;
    told(stopOf(one) / grid.steps);
  }
  const finalState = kernel.view(at.state, shape.states).slice();
  const ring = task.lag ? kernel.view(at.ring, ringAt).slice() : null;
  let reported = {};
  let whole = memory().slice();
  const keep = () => watch?.rows.set(kernel.view(at.watched, windows));
  if (bounded) {
    kernel.view(at.signals, commands.width).set(commands.final());
    disturb(grid.steps, 1);
    kernel.call(1, 1, at, grid.steps, task.sampleEvery, mask);
    const last = Float64Array.from(kernel.view(at.out, size));
    totals.mergeFinal(last, shape.states);
    whole = memory().slice();
    keep();
    reported = reportedAtEnd(kernel, task, at, mask, finalState);
  }
  if (!bounded) keep();
  const stop = totals.divergedStep ?? Infinity;
  const shown = keptBefore(stop, starts.subarray(0, kept), segments);
  const found = { recorded: recorded.subarray(0, shown * size).slice(), starts: starts.slice(0, shown), r: signals.slice(0, shown * timed) };
  const all = { rows: recorded.subarray(0, kept * size), starts: starts.subarray(0, kept) };
  const verdict = verdictFor(task, kernel, commands, totals, new Kept(task.judge, beforeTail ?? whole, whole), all, { state: finalState, ring });
  return {
    verdict, condition: task.condition && conditionFor(task), numerics: watch && judged(task, kernel, commands, watch, stop, all.rows, all.starts),
    timed, figures: { ...totals.figures(grid, finalState.subarray(...task.thetaHat)), ...reported }, size, stepping, ...found,
    milliseconds: performance.now() - began,
  };
}

// The verdict on a run that ended in this state and with this ring of delayed values.
function verdictFor(task, kernel, commands, totals, kept, recorded, { state, ring }) {
  const { steps, tEnd } = task.grid;
  const diverged = totals.divergedStep === null ? null : (totals.divergedStep * tEnd) / steps;
  const cyclesOf = (band, held) => {
    const jacobian = task.spectrum && matricesAt(task, commands, [0], [task.states])[0];
    const going = new Continued(task, held, state.slice(), totals.rows["good steps"][0], furtherOf(task, kernel, ring));
    return cycleOf(task, kept, slowestPeriod(task, jacobian), going, band);
  };
  return verdictOf(task, kept, diverged, recorded, heldIn(task, commands), cyclesOf);
}

// Returns a function that continues the loop with a given table and without noise. It keeps the delayed values between calls.
function furtherOf(task, kernel, ring) {
  const { shape } = task;
  let past = ring;
  return (blocks, length, step, state, table) => {
    const watch = new Watch(shape.states, step, step + blocks * length, CHUNK_STEPS);
    const quiet = task.noise ? (2 + Math.ceil((blocks * length) / task.noise.hold)) * task.noise.channels : 0;
    const { at, mask, ringAt } = begun(kernel, task, table.length, blocks, quiet, watch.rows.length);
    kernel.view(at.state, state.length).set(state);
    if (past) kernel.view(at.ring, ringAt).set(past);
    kernel.view(at.signals, table.length).set(table);
    kernel.view(at.noise, quiet).fill(0);
    watched(kernel, at, watch);
    kernel.call(blocks, length, at, step, task.sampleEvery, mask);
    past = past && kernel.view(at.ring, ringAt).slice();
    const size = blocks * (shape.states + shape.accumulators);
    return { out: kernel.view(at.out, size).slice(), state: kernel.view(at.state, state.length).slice() };
  };
}

// The number of recorded blocks that end before the divergence.
function keptBefore(stop, starts, segments) {
  if (stop === Infinity) return starts.length;
  let [count, at] = [0, 0];
  for (const { blocks, length } of segments) {
    for (let i = 0; i < blocks && at < starts.length; i++, at++) if (starts[at] + length < stop) count = at + 1;
  }
  return count;
}

// The effect of the step on the run: the largest h |lambda|, and the time [s] at which the method first amplified a mode that
// the equations do not amplify.
function judged(task, kernel, commands, watch, stop, recorded, starts) {
  const again = new Replay(task, kernel, commands, starts, recorded, task.shape.states + task.shape.accumulators);
  const { largest, from } = stabilityOf(task, watch, stop, (steps, states) => matricesAt(task, commands, steps, states), again);
  return { hLambda: largest, unstable: from === null ? null : (from * task.grid.tEnd) / task.grid.steps };
}

if (typeof document === "undefined") {
  self.onmessage = ({ data }) => {
    try {
      let said = performance.now();
      const found = simulated(data, (done) => {
        if (performance.now() - said < TELL_EVERY) return;
        said = performance.now();
        self.postMessage({ index: data.index, done });
      });
      self.postMessage({ id: data.id, index: data.index, ...found }, [found.recorded.buffer, found.starts.buffer, found.r.buffer]);
    } catch (error) {
      self.postMessage({ id: data.id, index: data.index, failed: String(error) });
    }
  };
}
