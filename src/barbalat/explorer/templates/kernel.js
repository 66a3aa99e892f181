import { faultValues } from "./faults.js";

// A module's time loop, called as the native kernel is: arrays lie one after another in its memory.

const PAGE_BYTES = 65536;
const TAPS = 3; // remembered values that a step gets back of each delayed channel

export class Kernel {
  constructor(bytes) {
    this.exports = new WebAssembly.Instance(new WebAssembly.Module(bytes)).exports;
    this.free = this.exports.memory.buffer.byteLength; // up to there the memory is the module's own
  }

  // Addresses of arrays with these numbers of doubles.
  laidOut(sizes) {
    const at = [];
    let end = this.free;
    for (const size of sizes) {
      at.push(end);
      end += 8 * size;
    }
    const missing = end - this.exports.memory.buffer.byteLength;
    if (missing > 0) this.exports.memory.grow(Math.ceil(missing / PAGE_BYTES));
    return at;
  }

  view(address, size) {
    return new Float64Array(this.exports.memory.buffer, address, size);
  }

  // What is on its way at t = 0: the history, for as many steps as a lag needs; returns the ring's mask.
  remember(lag, at, history) {
    new BigInt64Array(this.exports.memory.buffer, at.lags, 1)[0] = BigInt(lag);
    const rows = ringRows(lag);
    const ring = this.view(at.ring, rows * history.length);
    for (let i = 0; i < ring.length; i++) ring[i] = history[i % history.length];
    return BigInt(rows - TAPS);
  }

  call(blocks, steps, at, start, sampleEvery, mask = 0n) {
    const big = BigInt;
    this.exports.barbalat_loop(
      big(blocks), big(steps), at.state, at.parameters, at.signals, at.out, big(start), at.lags || 0, at.ring || 0, mask, at.noise || 0, at.watched || 0,
      big(at.watchFirst || 0), big(at.watchWindow || 1), big(sampleEvery), big(at.hold || 1),
    );
  }
}

// Steps that a ring for this lag holds: a power of two, and the first ones again.
export function ringRows(lag) {
  return 2 ** Math.ceil(Math.log2(lag + TAPS)) - 1 + TAPS;
}

// Linear between the points of a record, as NumPy's interp has it, and constant outside; times increase.
export function interpolated({ times, values }, at) {
  const last = times.length - 1;
  const found = new Float64Array(at.length);
  let j = 0;
  at.forEach((t, i) => {
    while (j < last && times[j + 1] <= t) j++;
    const between = t > times[j] && j < last;
    found[i] = between ? ((values[j + 1] - values[j]) / (times[j + 1] - times[j])) * (t - times[j]) + values[j] : values[j];
  });
  return found;
}

// The computed signals' values at times, a row for each: those of formulas, of records, and of faults.
export function computedValues(kernel, drawing, signals, times) {
  const computed = signals.points.map((points, i) => ({ points, fault: signals.faults[i] })).filter((_, i) => signals.smooth[i]);
  const formulas = computed.filter(({ points, fault }) => !points && !fault).length;
  const byFormula = formulas ? smoothValues(kernel, signals.parameters, formulas, times) : [];
  if (formulas === computed.length) return byFormula;
  const found = new Float64Array(times.length * computed.length);
  let formula = 0;
  computed.forEach(({ points, fault }, j) => {
    const apart = points ? interpolated(points, times) : fault ? faultValues(drawing, fault, times) : null;
    const [values, every, first] = apart ? [apart, 1, 0] : [byFormula, formulas, formula++];
    for (let i = 0; i < times.length; i++) found[i * computed.length + j] = values[i * every + first];
  });
  return found;
}

// The formulas' values at times, a row for each.
export function smoothValues(kernel, parameters, channels, times) {
  const most = 65536;
  const found = new Float64Array(times.length * channels);
  const size = Math.min(most, times.length);
  const [p, t, out] = kernel.laidOut([parameters.length, size, size * channels]);
  kernel.view(p, parameters.length).set(parameters);
  for (let first = 0; first < times.length; first += most) {
    const part = times.subarray(first, first + most);
    kernel.view(t, part.length).set(part);
    kernel.call(part.length, 1, { state: p, parameters: p, signals: t, out }, 0, 0);
    found.set(kernel.view(out, part.length * channels), first * channels);
  }
  return found;
}
