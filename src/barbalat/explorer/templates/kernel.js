// A module's time loop, called as the native kernel is: arrays lie one after another in its memory.

const PAGE_BYTES = 65536;
const TAPS = 3; // remembered values that a step gets back of each delayed channel

export class Kernel {
  constructor(bytes) {
    this.exports = new WebAssembly.Instance(new WebAssembly.Module(bytes)).exports;
    this.free = Math.ceil(this.exports.free() / 8) * 8;
  }

  // Addresses of arrays of so many doubles each.
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

// The smooth signals' values at times, a row for each.
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
