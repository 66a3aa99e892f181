// Estimates ||W_b (1 - C)||_1 theta_max by simulating the impulse response and integrating the modulus of each component.

import { bytesOf } from "./bytes.js";
import { Kernel } from "./kernel.js";

const STEP = 0.02; // as a fraction of the reciprocal of the matrix's norm
const BLOCK = 4096; // steps between two checks of the decay
const MOST_BLOCKS = 1000;
const DECAYED = 1e-7; // fraction of the first state at which the integration ends

export function conditionOf({ module, parameters, states, filter, kernels }) {
  if (!kernels.has(module)) kernels.set(module, new Kernel(bytesOf(module)));
  const kernel = kernels.get(module);
  const parts = {};
  let from = 0;
  for (const [name, size] of [["Am", states * states], ["b", states], ["A", filter * filter], ["B", filter], ["C", filter]]) {
    parts[name] = parameters.subarray(from, from + size);
    from += size;
  }
  const bounds = parameters.subarray(from);
  const half = bounds.length / 2;
  let thetaMax = 0;
  for (let i = 0; i < half; i++) thetaMax += Math.max(Math.abs(bounds[i]), Math.abs(bounds[half + i]));
  const step = STEP / norm(parts, states, filter);
  const [state, given, out] = kernel.laidOut([states + filter, parameters.length + 1, 2 * states + filter]);
  const first = Float64Array.from([...parts.b, ...parts.B]);
  kernel.view(state, first.length).set(first);
  kernel.view(given, parameters.length + 1).set([...parameters, step]);
  const sums = new Float64Array(states);
  const largest = (values) => values.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  for (let k = 0; k < MOST_BLOCKS; k++) {
    kernel.call(1, BLOCK, { state, parameters: given, signals: given, out }, 0, 0);
    const found = kernel.view(out, 2 * states + filter);
    for (let i = 0; i < states; i++) sums[i] += found[states + filter + i];
    const now = kernel.view(state, first.length);
    if (largest(now) <= DECAYED * largest(first)) return largest(sums) * thetaMax;
  }
  return null; // the response has not decayed: the slowest time constant is far longer than the fastest one
}

function norm({ Am, b, A, C }, states, filter) {
  const sum = (values) => values.reduce((total, value) => total + Math.abs(value), 0);
  const rows = [];
  for (let i = 0; i < states; i++) rows.push(sum(Am.subarray(i * states, (i + 1) * states)) + Math.abs(b[i]) * sum(C));
  for (let i = 0; i < filter; i++) rows.push(sum(A.subarray(i * filter, (i + 1) * filter)));
  return Math.max(...rows);
}
