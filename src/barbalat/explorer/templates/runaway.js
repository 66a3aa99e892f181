// Whether an error grows out of all proportion to the end, short of divergence: the test of run/results/findings.py.

const OUT_OF_PROPORTION = 1e3;
const STILL_GROWING = 1.2;

// reached: the largest |e| of each recorded interval, and of the last instant. motion: the model's largest value at recorded
// instants. Null for a run that stays in proportion.
export function runawayOf(reached, motion) {
  const size = motion || reached[0] || 0;
  const quarter = Math.floor(reached.length / 4);
  if (quarter === 0 || size === 0) return null;
  const largest = (from, to) => reached.subarray(from, to).reduce((most, value) => Math.max(most, value), -Infinity);
  const n = reached.length;
  const [last, before] = [largest(n - quarter, n), largest(n - 2 * quarter, n - quarter)];
  return last > OUT_OF_PROPORTION * size && last > STILL_GROWING * before ? { max_abs_e: last, over_model: last / size } : null;
}

// The largest magnitude of what the model gives out, over rows of `size` numbers that begin with the states.
export function motionOf({ rows, weights }, recorded, size) {
  let most = 0;
  for (let at = 0; at < recorded.length; at += size) {
    let output = 0;
    rows.forEach((row, i) => {
      if (weights) output += weights[i] * recorded[at + row];
      else most = Math.max(most, Math.abs(recorded[at + row]));
    });
    most = Math.max(most, Math.abs(output));
  }
  return most;
}

// The largest |e| in each row.
export function reachedIn([first, stop], [firstMax], recorded, size) {
  const found = new Float64Array(recorded.length / size);
  found.forEach((_, k) => {
    for (let i = 0; i < stop - first; i++) {
      found[k] = Math.max(found[k], -recorded[k * size + first + i], recorded[k * size + firstMax + i]);
    }
  });
  return found;
}
