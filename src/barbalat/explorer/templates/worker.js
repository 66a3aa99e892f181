// Simulates one setting of one controller after another; kernels and the table of commands are kept.

import { bytesOf } from "./bytes.js";
import { segmentsOf, Table } from "./grid.js";
import { computedValues, Kernel, ringRows } from "./kernel.js";
import { Noise } from "./noise.js";
import { Totals } from "./figures.js";
import { conditionOf } from "./impulse.js";
import { stiffness } from "./spectrum.js";

const MOST_INSTANTS = 600; // at which the Jacobian is evaluated: its largest entries say where the spectrum is looked at
const kernels = new Map();
const conditions = new Map(); // by controller, the last one
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
    const smooth = (times) => computedValues(kernel, signals, times);
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

// Of a delay between two steps, by its fraction of one; they stand last among the parameters.
function weightsOf({ between, parameters }) {
  const kernel = kernelOf(between.name, between.module);
  const count = parameters.length - between.first;
  const [row, out] = kernel.laidOut([1, count]);
  kernel.view(row, 1)[0] = between.fraction;
  kernel.call(1, 1, { state: row, parameters: row, signals: row, out }, 0, 0);
  return kernel.view(out, count).slice();
}

// Arrays in the kernel's memory, filled with what a run begins from.
function begun(kernel, task, longest, most, noisy) {
  const { shape, lag } = task;
  const remembered = lag ? ringRows(lag) * shape.delayed : 0;
  const size = shape.states + shape.accumulators;
  const sizes = [shape.states, task.parameters.length, lag ? 1 : 0, remembered, longest, most * size, noisy];
  const [state, parameters, lags, ring, signals, out, noise] = kernel.laidOut(sizes);
  const at = { state, parameters, lags, ring, signals, out, noise, hold: task.noise ? task.noise.hold : 1 };
  kernel.view(state, shape.states).set(task.states);
  kernel.view(parameters, task.parameters.length).set(task.parameters);
  if (task.between) kernel.view(parameters, task.parameters.length).set(weightsOf(task), task.between.first);
  const history = lag ? task.past.flatMap((value) => Array(shape.delayed / task.past.length).fill(value)) : [];
  return { at, mask: lag ? kernel.remember(lag, at, history) : 0n };
}

// What a scheme reports of its state at the end, after a sampled controller has acted there: by a step of no length.
function reportedAtEnd(kernel, task, at, mask, finalState) {
  if (!Object.keys(task.reported).length) return {};
  kernel.view(at.state, finalState.length).set(finalState);
  kernel.view(at.parameters, task.parameters.length)[task.dtRow] = 0;
  kernel.call(1, 1, at, task.grid.steps, task.sampleEvery, mask);
  const state = kernel.view(at.state, finalState.length);
  return Object.fromEntries(Object.entries(task.reported).map(([name, rows]) => [`${name}_final`, rows.map((row) => state[row])]));
}

// Of the loop along the run, from the states at recorded instants and the signals there.
function stiffnessAlong(task, recorded, signals, starts, size) {
  if (!task.spectrum) return null;
  const { states } = task.shape;
  const [kept, channels] = [starts.length, task.noise ? task.noise.channels : 0];
  const count = Math.min(kept, MOST_INSTANTS);
  const timed = signals.length / (kept || 1);
  const [width, nonzeros] = [states + timed + channels, task.spectrum.rows.length];
  const which = Array.from({ length: count }, (_, i) => (count < 2 ? 0 : Math.round((i * (kept - 1)) / (count - 1))));
  const drawn = channels ? which.map((k) => noiseFor(task).rows(starts[k], 1)) : [];
  const kernel = kernelOf(`spectrum ${task.module.replace(/ [^ ]*$/, "")}`, task.spectrum.module);
  const [parameters, rows, out] = kernel.laidOut([task.parameters.length, count * width, count * nonzeros]);
  kernel.view(parameters, task.parameters.length).set(task.parameters);
  const view = kernel.view(rows, count * width);
  which.forEach((k, i) => {
    view.set(recorded.subarray(k * size, k * size + states), i * width);
    view.set(signals.subarray(k * timed, (k + 1) * timed), i * width + states);
    if (channels) view.set(drawn[i], i * width + states + timed);
  });
  kernel.call(count, 1, { state: parameters, parameters, signals: rows, out }, 0, 0);
  const { largest, from } = stiffness(task.spectrum, kernel.view(out, count * nonzeros), count, states, task);
  return { largest, from: from === null ? null : which[from] };
}

// Most sliders leave it as it is.
function conditionFor({ index, condition }) {
  const key = condition.parameters.join();
  if (conditions.get(index)?.key !== key) conditions.set(index, { key, value: conditionOf({ ...condition, kernels }) });
  return conditions.get(index).value;
}

export function simulated(task) {
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
  const { at, mask } = begun(kernel, task, longest * commands.width, Math.max(...segments.map((one) => one.blocks)), noisy);
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
  for (const one of segments) {
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
  }
  const finalState = kernel.view(at.state, shape.states).slice();
  let reported = {};
  if (bounded) {
    kernel.view(at.signals, commands.width).set(commands.final());
    disturb(grid.steps, 1);
    kernel.call(1, 1, at, grid.steps, task.sampleEvery, mask);
    totals.mergeFinal(kernel.view(at.out, size), shape.states);
    reported = reportedAtEnd(kernel, task, at, mask, finalState);
  }
  const found = stiffnessAlong(task, recorded, signals.subarray(0, kept * timed), starts.subarray(0, kept), size);
  const unstable = found && found.from !== null ? (starts[found.from] * grid.tEnd) / grid.steps : null;
  return {
    condition: task.condition && conditionFor(task), numerics: found && { hLambda: found.largest, unstable }, timed,
    figures: { ...totals.figures(grid, finalState.subarray(...task.thetaHat)), ...reported }, size, stepping,
    recorded: recorded.subarray(0, kept * size).slice(), starts: starts.slice(0, kept), r: signals.slice(0, kept * timed),
    milliseconds: performance.now() - began,
  };
}

if (typeof document === "undefined") {
  self.onmessage = ({ data }) => {
    try {
      const found = simulated(data);
      self.postMessage({ id: data.id, index: data.index, ...found }, [found.recorded.buffer, found.starts.buffer, found.r.buffer]);
    } catch (error) {
      self.postMessage({ id: data.id, index: data.index, failed: String(error) });
    }
  };
}
