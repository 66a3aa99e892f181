// Measurement noise: rows of standard Gaussian numbers from the simulator's stream, kept for the next run up to a limit.

const MEMBER = 0n; // barbalat run uses the stream of this member for every controller
const MOST_DRAWN = 8e6; // numbers: 64 MB

export class Noise {
  constructor(kernel, { seed, channels, hold }) {
    Object.assign(this, { kernel, seed: BigInt(seed), channels, hold });
    this.known = new Map();
    this.kept = 0;
  }

  // The rows of noise that these steps need, beginning with the first.
  rows(start, steps) {
    const first = Math.floor(start / this.hold);
    return this.from(first, Math.floor((start + steps - 1) / this.hold) - first + 1);
  }

  from(first, count) {
    const key = `${first} ${count}`;
    if (this.known.has(key)) return this.known.get(key);
    const [out] = this.kernel.laidOut([count * this.channels]);
    this.kernel.exports.barbalat_normal(this.seed, MEMBER, BigInt(first), BigInt(count), out);
    const found = this.kernel.view(out, count * this.channels).slice();
    if (this.kept + found.length <= MOST_DRAWN) {
      this.known.set(key, found);
      this.kept += found.length;
    }
    return found;
  }
}
