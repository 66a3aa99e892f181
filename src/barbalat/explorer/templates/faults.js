// The faults of the samples over time, as in problem/faults.py and with the same random numbers.

import { roundHalfEven } from "./grid.js";

// Draws random numbers with the constants of the package's hash.
export class Drawing {
  constructor(kernel, { grid, signs }) {
    Object.assign(this, { kernel, grid, signs });
  }

  // Returns a number between 0 and 1 for each slot.
  uniform(seed, place, slots) {
    const [from, out] = this.kernel.laidOut([slots.length, slots.length]);
    this.kernel.view(from, slots.length).set(slots);
    this.kernel.exports.barbalat_uniform(BigInt(seed), BigInt(place), BigInt(slots.length), from, out);
    return this.kernel.view(out, slots.length).slice();
  }
}

// Whether the fault is present (1 or 0) at each tick of the time grid.
function there(drawing, { seed, place, share, burst, times }, ticks) {
  if (share !== null) {
    const long = burst === null ? 1 : Math.max(1, roundHalfEven(burst / drawing.grid));
    const slots = ticks.map((tick) => (tick - (tick % long)) / long);
    return drawing.uniform(seed, place, slots).map((value) => (value < share ? 1 : 0));
  }
  if (!times.length) return ticks.map(() => 1);
  const edges = times.map((interval) => interval.map((time) => roundHalfEven(time / drawing.grid)));
  return ticks.map((tick) => (edges.some(([start, end]) => tick >= start && tick < end) ? 1 : 0));
}

export function faultValues(drawing, fault, times) {
  const ticks = Float64Array.from(times, (time) => roundHalfEven(time / drawing.grid));
  const found = there(drawing, fault, ticks);
  if (fault.kind === "bias") return found.map((is) => (is ? fault.size : 0));
  if (fault.kind !== "spike" && fault.kind !== "jitter") return found;
  const drawn = drawing.uniform(fault.seed, fault.place + drawing.signs, ticks);
  if (fault.kind === "jitter") return found.map((is, i) => (is ? 2 * drawn[i] - 1 : 0));
  return found.map((is, i) => (is ? (drawn[i] < 0.5 ? fault.size : -fault.size) : 0));
}
