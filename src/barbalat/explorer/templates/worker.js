// Simulates one setting of one controller after another; kernels and the table of commands are kept.

import { bytesOf, doublesOf } from "./bytes.js";
import { segmentsOf, tableOf } from "./grid.js";
import { Kernel, smoothValues } from "./kernel.js";
import { Totals } from "./figures.js";

const kernels = new Map();
let tables = { key: "" };

function kernelOf(name, text) {
  if (!kernels.has(name)) kernels.set(name, new Kernel(bytesOf(text)));
  return kernels.get(name);
}

function tableFor(task) {
  const { grid, signals } = task;
  const key = `${task.tableKey} ${task.nodes} ${Array.from(signals.parameters)}`;
  if (tables.key !== key) {
    const kernel = kernelOf("signals", signals.module);
    const channels = signals.smooth.filter(Boolean).length;
    const smooth = (times) => smoothValues(kernel, signals.parameters, channels, times);
    tables = { key, ...tableOf(grid, smooth, signals, task.nodes, task.shape.pieces) };
  }
  return tables;
}

export function simulated(task) {
  const began = performance.now();
  const { grid, shape } = task;
  const commands = tableFor(task);
  const segments = segmentsOf(grid.steps, task.recordPoints);
  const size = shape.states + shape.accumulators;
  const rowsAt = (k) => (commands.first ? commands.first[k] : k);
  let longest = 1;
  let most = 1;
  for (const one of segments) {
    longest = Math.max(longest, rowsAt(one.start + one.blocks * one.length) - rowsAt(one.start));
    most = Math.max(most, one.blocks);
  }
  const kernel = kernelOf(task.module, task.code);
  const places = kernel.laidOut([shape.states, shape.parameters, longest * commands.width, most * size]);
  const at = { state: places[0], parameters: places[1], signals: places[2], out: places[3] };
  kernel.view(at.state, shape.states).set(task.states);
  kernel.view(at.parameters, shape.parameters).set(task.parameters);
  const totals = new Totals(task.operations);
  const blocks = segments.reduce((sum, one) => sum + one.blocks, 0);
  const recorded = new Float64Array(blocks * size);
  const starts = new Float64Array(blocks);
  let kept = 0;
  let bounded = true;
  for (const one of segments) {
    const [from, to] = [rowsAt(one.start), rowsAt(one.start + one.blocks * one.length)];
    kernel.view(at.signals, (to - from) * commands.width).set(commands.table.subarray(from * commands.width, to * commands.width));
    kernel.call(one.blocks, one.length, at, one.start, task.sampleEvery);
    const out = kernel.view(at.out, one.blocks * size);
    recorded.set(out, kept * size);
    for (let i = 0; i < one.blocks; i++) starts[kept + i] = one.start + i * one.length;
    kept += one.blocks;
    bounded = totals.merge(one, out, shape.states);
    if (!bounded) break;
  }
  const finalState = kernel.view(at.state, shape.states).slice();
  if (bounded) {
    kernel.view(at.signals, commands.width).set(commands.final);
    kernel.call(1, 1, at, grid.steps, task.sampleEvery);
    totals.mergeFinal(kernel.view(at.out, size), shape.states);
  }
  const r = new Float64Array(kept * shape.commands);
  for (let i = 0; i < kept; i++) {
    for (let j = 0; j < shape.commands; j++) r[i * shape.commands + j] = commands.table[rowsAt(starts[i]) * commands.width + j];
  }
  const figures = totals.figures(grid, finalState.subarray(...task.thetaHat));
  return {
    figures, recorded: recorded.subarray(0, kept * size).slice(), starts: starts.subarray(0, kept).slice(), r, size,
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
