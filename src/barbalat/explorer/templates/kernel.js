// A module's time loop, called as the native kernel is: arrays lie one after another in its memory.

const PAGE_BYTES = 65536;

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

  call(blocks, steps, at, start, sampleEvery) {
    const big = BigInt;
    this.exports.barbalat_loop(
      big(blocks), big(steps), at.state, at.parameters, at.signals, at.out, big(start), 0, 0, big(0), 0, 0, big(0), big(1),
      big(sampleEvery), big(1),
    );
  }
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
