// Divides a run's steps into calls of the kernel, as the simulator does, and makes the table of commands for them.

export const CHUNK_STEPS = 32768;
const MOST_KEPT = 8e6; // largest number of table entries that a worker keeps for the next run: 64 MB

export function roundHalfEven(value) {
  const below = Math.floor(value);
  const rest = value - below;
  if (rest !== 0.5) return Math.round(value);
  return below % 2 === 0 ? below : below + 1;
}

export function segmentsOf(steps, recordPoints) {
  const length = Math.min(Math.max(1, roundHalfEven(steps / recordPoints)), CHUNK_STEPS);
  const perChunk = Math.max(1, Math.floor(CHUNK_STEPS / length));
  const tail = tailStart(steps);
  const found = [];
  for (const [start, stop] of [[0, tail], [tail, steps]]) {
    const whole = Math.floor((stop - start) / length);
    for (let first = 0; first < whole; first += perChunk) {
      found.push({ start: start + first * length, blocks: Math.min(perChunk, whole - first), length, inTail: start > 0 });
    }
    const rest = (stop - start) % length;
    if (rest) found.push({ start: stop - rest, blocks: 1, length: rest, inTail: start > 0 });
  }
  return found;
}

export function tailStart(steps) {
  return steps - Math.floor(steps / 4);
}

// The first index in 0 ... count for which past(index) holds. past must hold for all later indices as well.
function firstOf(count, past) {
  let [low, high] = [0, count];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (past(middle)) high = middle;
    else low = middle + 1;
  }
  return low;
}

// smooth(times) returns the values, one row per time. nodes are the fractions of a step at which a method needs the commands.
export class Table {
  constructor(grid, smooth, signals, nodes, pieces) {
    Object.assign(this, { grid, smooth, nodes, pieces, count: signals.smooth.length });
    this.smoothAt = signals.smooth.flatMap((is, i) => (is ? [i] : []));
    this.keptAt = signals.smooth.flatMap((is, i) => (is ? [] : [i]));
    this.width = this.count * nodes.length + (pieces ? 3 : 0);
    this.cuts = grid.cuts ? grid.cuts.length / 3 : 0;
    this.known = new Map();
    this.kept = 0;
  }

  // The number of rows before a step: one for each earlier step and one more for each break inside such a step.
  rowsBefore(step) {
    return step + firstOf(this.cuts, (i) => this.grid.cuts[3 * i] >= step);
  }

  rows(start, stop) {
    if (this.known.has(start)) return this.known.get(start);
    const found = this.made(start, stop);
    if (this.kept + found.length <= MOST_KEPT) {
      this.known.set(start, found);
      this.kept += found.length;
    }
    return found;
  }

  // The start of each row, in steps and in time, and whether a step starts there. A row ends where the next one starts.
  placed(start, stop) {
    const { steps, tEnd } = this.grid;
    const count = this.rowsBefore(stop) - this.rowsBefore(start);
    const places = new Float64Array(count + 1);
    const times = new Float64Array(count + 1);
    const whole = new Uint8Array(count + 1);
    let cut = firstOf(this.cuts, (i) => this.grid.cuts[3 * i] >= start);
    let row = 0;
    for (let k = start; k <= stop; k++) {
      places[row] = k;
      whole[row] = 1;
      times[row++] = (k * tEnd) / steps;
      for (; k < stop && cut < this.cuts && this.grid.cuts[3 * cut] === k; cut++) {
        places[row] = this.grid.cuts[3 * cut + 1];
        times[row++] = this.grid.cuts[3 * cut + 2];
      }
    }
    return { count, places, times, whole };
  }

  made(start, stop) {
    const { count, places, times, whole } = this.placed(start, stop);
    const table = new Float64Array(count * this.width);
    this.putSmooth(table, count, places, times);
    this.putKept(table, this.rowsBefore(start), count);
    if (!this.pieces) return table;
    for (let i = 0; i < count; i++) {
      const end = (i + 1) * this.width;
      table[end - 3] = places[i + 1] - places[i];
      table[end - 2] = whole[i];
      table[end - 1] = whole[i + 1];
    }
    return table;
  }

  putSmooth(table, count, places, times) {
    const { smoothAt, width } = this;
    const channels = smoothAt.length;
    if (!channels) return;
    const { steps, tEnd } = this.grid;
    const ends = this.smooth(times);
    this.nodes.forEach((node, n) => {
      let values = ends;
      if (node !== 0 && node !== 1) {
        const between = new Float64Array(count);
        for (let i = 0; i < count; i++) between[i] = ((places[i] + node * (places[i + 1] - places[i])) * tEnd) / steps;
        values = this.smooth(between);
      }
      const first = node === 1 ? channels : 0;
      for (let j = 0; j < channels; j++) {
        const at = n * this.count + smoothAt[j];
        for (let i = 0; i < count; i++) table[i * width + at] = values[first + i * channels + j];
      }
    });
  }

  putKept(table, before, count) {
    const { keptAt, width, grid } = this;
    if (!keptAt.length) return;
    const places = this.nodes.map((node) => [0, 0.5, 1].indexOf(node));
    let run = firstOf(grid.starts.length, (i) => grid.starts[i] > before) - 1;
    for (let i = 0; i < count; i++) {
      while (run + 1 < grid.starts.length && grid.starts[run + 1] <= before + i) run++;
      places.forEach((place, n) => {
        keptAt.forEach((at, j) => { table[i * width + n * this.count + at] = grid.values[(run * 3 + place) * keptAt.length + j]; });
      });
    }
  }

  // The values of the signals at the given steps, one row per step.
  at(steps) {
    const { grid, count, smoothAt, keptAt } = this;
    const found = new Float64Array(steps.length * count);
    const values = smoothAt.length ? this.smooth(Float64Array.from(steps, (k) => (k * grid.tEnd) / grid.steps)) : [];
    steps.forEach((k, i) => {
      smoothAt.forEach((at, j) => { found[i * count + at] = values[i * smoothAt.length + j]; });
      if (!keptAt.length) return;
      const before = this.rowsBefore(k);
      const run = firstOf(grid.starts.length, (row) => grid.starts[row] > before) - 1;
      keptAt.forEach((at, j) => { found[i * count + at] = grid.values[run * 3 * keptAt.length + j]; });
    });
    return found;
  }

  final() {
    const row = new Float64Array(this.width);
    const atEnd = this.smoothAt.length ? this.smooth(new Float64Array([this.grid.tEnd])) : [];
    this.nodes.forEach((_, n) => {
      this.smoothAt.forEach((at, j) => { row[n * this.count + at] = atEnd[j]; });
      this.keptAt.forEach((at, j) => { row[n * this.count + at] = this.grid.last[j]; });
    });
    if (this.pieces) row.fill(1, this.width - 3);
    return row;
  }
}
