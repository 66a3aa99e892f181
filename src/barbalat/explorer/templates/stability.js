// Checks, as barbalat run does, whether a run stayed inside its solver's region of stability, and finds the step at which it
// left it.
//
// The kernel divides a run into some two thousand windows and keeps, for each, the state at which the modes are about the
// fastest. The spectrum is computed at these states. A window with an exit is simulated again in shorter windows, until the
// step is found.

import { look } from "./spectrum.js";

// The record of a kernel that watches a quantity: for each window a row with the largest value, the state and the step.
export class Watch {
  constructor(states, first, stop, window) {
    Object.assign(this, { first, window, width: states + 2 });
    this.rows = new Float64Array(Math.ceil((stop - first) / window) * this.width).fill(-Infinity);
  }

  static ofRun(task) {
    const { steps } = task.grid;
    return new Watch(task.shape.states, 0, steps + 1, windowOf(steps, task.watching.windows, task.watching.every));
  }

  // The steps, states and values of the quantity of those windows whose row was kept before the step ``stop``.
  kept(stop) {
    const found = { steps: [], states: [], values: [] };
    for (let at = 0; at < this.rows.length; at += this.width) {
      const step = this.rows[at + this.width - 1];
      if (!(this.rows[at] > -Infinity) || step >= stop) continue;
      found.values.push(this.rows[at]);
      found.states.push(this.rows.subarray(at + 1, at + this.width - 1));
      found.steps.push(step);
    }
    return found;
  }
}

// The smallest multiple of ``every`` for which ``count`` windows contain all steps.
export function windowOf(steps, count, every) {
  return every * Math.ceil(steps / (count * every));
}

// matricesAt(steps, states) returns the Jacobians. stop is the step of the divergence, or Infinity. again is a ``Replay``.
export function stabilityOf(task, watch, stop, matricesAt, again) {
  const { looks } = task.watching;
  const looked = ({ steps, states }) => matricesAt(steps, states).map((matrix) => look(matrix, task.own, task));
  const all = watch.kept(stop);
  const chosen = chosenOf(all.values, looks);
  const found = looked(part(all, chosen));
  const largest = found.reduce((most, one) => Math.max(most, one.largest), 0);
  const exit = found.findIndex((one) => one.outside);
  if (exit < 0) return { largest, from: null };
  const until = Array.from({ length: chosen[exit] + 1 }, (_, k) => k);
  return { largest, from: firstStep(task, firstOutside(part(all, until), looks, looked), watch.window, stop, looked, again) };
}

function part({ steps, states }, which) {
  return { steps: which.map((k) => steps[k]), states: which.map((k) => states[k]) };
}

// The windows that are examined: half of them are the stiffest ones, the other half is spread over the rest.
function chosenOf(values, looks) {
  const order = values.map((_, k) => k).sort((a, b) => values[b] - values[a] || a - b);
  const rest = order.slice(looks / 2).sort((a, b) => a - b);
  const count = Math.min(rest.length, looks / 2);
  const apart = (rest.length - 1) / (count - 1);
  const spread = Array.from({ length: count }, (_, i) => rest[i === count - 1 ? rest.length - 1 : Math.trunc(i * apart)]);
  return [...order.slice(0, looks / 2), ...spread].sort((a, b) => a - b);
}

// The first of the steps that is outside the region. The last one is known to be outside.
function firstOutside({ steps, states }, looks, looked) {
  for (let begin = 0; begin < steps.length; begin += looks) {
    const piece = { steps: steps.slice(begin, begin + looks), states: states.slice(begin, begin + looks) };
    const at = looked(piece).findIndex((one) => one.outside);
    if (at >= 0) return piece.steps[at];
  }
  return steps[steps.length - 1];
}

// The first step outside the region, in the window that contains the given step.
function firstStep(task, given, length, stop, looked, again) {
  const { looks, pieces, every } = task.watching;
  let [step, window] = [given, length];
  let begin = Math.floor(step / window) * window;
  const known = again.known(Math.max(begin - every + 1, 0));
  while (window > every) {
    window = windowOf(window, pieces, every);
    const watch = new Watch(task.shape.states, begin, step + 1, window);
    again.advance(again.advance(known, begin), step + 1, watch);
    step = firstOutside(watch.kept(stop), looks, looked);
    begin += Math.floor((step - begin) / window) * window;
  }
  return firstOutside(again.every(known, Math.max(step - every + 1, 0), step + 1), looks, looked);
}
