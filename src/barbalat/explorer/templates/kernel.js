import { faultValues } from "./faults.js";

// Calls a module's time loop as the native kernel is called. The arrays are stored one after another in the module's memory.

const PAGE_BYTES = 65536;
const TAPS = 3; // stored values of each delayed channel that a step reads

export class Kernel {
  constructor(bytes) {
    this.exports = new WebAssembly.Instance(new WebAssembly.Module(bytes)).exports;
    this.free = this.exports.memory.buffer.byteLength; // the memory below this address belongs to the module
  }

  // Returns the addresses of arrays of the given sizes, in doubles.
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

  // Fills the delay's ring with the history before t = 0, for as many steps as the lag needs. Returns the ring's mask.
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

// The number of rows of a ring for this lag: a power of two, plus the copies of its first rows.
export function ringRows(lag) {
  return 2 ** Math.ceil(Math.log2(lag + TAPS)) - 1 + TAPS;
}

// Interpolates a record linearly between its points, as NumPy's interp does, and holds it constant outside. at must increase.
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

// The values of the computed signals (formulas, records and faults) at the given times, one row per time.
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

// The values of the formulas at the given times, one row per time.
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
