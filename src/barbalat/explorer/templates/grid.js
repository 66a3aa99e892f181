// A run's steps, cut into calls of the kernel as the simulator cuts them, and the table of commands on them.

const CHUNK_STEPS = 32768;

function roundHalfEven(value) {
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

// Rows of the table: of whole steps, or of pieces where a signal breaks inside of one.
function rowsOf(grid) {
  const cuts = grid.cuts ? grid.cuts.length / 3 : 0;
  const count = grid.steps + cuts;
  const begins = new Float64Array(count);
  const ends = new Float64Array(count);
  const beginTime = new Float64Array(count);
  const endTime = new Float64Array(count);
  const opens = new Uint8Array(count);
  const closes = new Uint8Array(count);
  const first = cuts ? new Int32Array(grid.steps + 1) : null;
  const { steps, tEnd } = grid;
  let row = 0;
  let cut = 0;
  for (let k = 0; k < steps; k++) {
    if (first) first[k] = row;
    let place = k;
    let time = (k * tEnd) / steps;
    opens[row] = 1;
    for (; cut < cuts && grid.cuts[3 * cut] === k; cut++) {
      begins[row] = place;
      beginTime[row] = time;
      place = grid.cuts[3 * cut + 1];
      time = grid.cuts[3 * cut + 2];
      ends[row] = place;
      endTime[row] = time;
      row++;
    }
    begins[row] = place;
    beginTime[row] = time;
    ends[row] = k + 1;
    closes[row] = 1;
    endTime[row] = ((k + 1) * tEnd) / steps;
    row++;
  }
  if (first) first[steps] = row;
  return { count, begins, ends, opens, closes, beginTime, endTime, first };
}

// smooth: times -> values, a row for each time. nodes: the fractions of a step at which a method needs the commands.
export function tableOf(grid, smooth, signals, nodes, pieces) {
  const { steps, tEnd } = grid;
  const rows = rowsOf(grid);
  const q = signals.smooth.length;
  const smoothAt = signals.smooth.flatMap((is, i) => (is ? [i] : []));
  const keptAt = signals.smooth.flatMap((is, i) => (is ? [] : [i]));
  const width = q * nodes.length + (pieces ? 3 : 0);
  const table = new Float64Array(rows.count * width);
  nodes.forEach((node, n) => {
    if (smoothAt.length === 0) return;
    let times = node === 0 ? rows.beginTime : rows.endTime;
    if (node !== 0 && node !== 1) {
      times = new Float64Array(rows.count);
      for (let i = 0; i < rows.count; i++) times[i] = ((rows.begins[i] + node * (rows.ends[i] - rows.begins[i])) * tEnd) / steps;
    }
    const values = smooth(times);
    for (let i = 0; i < rows.count; i++) {
      for (let j = 0; j < smoothAt.length; j++) table[i * width + n * q + smoothAt[j]] = values[i * smoothAt.length + j];
    }
  });
  if (keptAt.length) {
    const places = nodes.map((node) => [0, 0.5, 1].indexOf(node));
    for (let run = 0; run < grid.starts.length; run++) {
      const stop = run + 1 < grid.starts.length ? grid.starts[run + 1] : rows.count;
      for (let i = grid.starts[run]; i < stop; i++) {
        places.forEach((place, n) => {
          keptAt.forEach((at, j) => {
            table[i * width + n * q + at] = grid.values[(run * 3 + place) * keptAt.length + j];
          });
        });
      }
    }
  }
  if (pieces) {
    for (let i = 0; i < rows.count; i++) {
      table[(i + 1) * width - 3] = rows.ends[i] - rows.begins[i];
      table[(i + 1) * width - 2] = rows.opens[i];
      table[(i + 1) * width - 1] = rows.closes[i];
    }
  }
  const final = new Float64Array(width);
  const atEnd = smoothAt.length ? smooth(new Float64Array([tEnd])) : [];
  nodes.forEach((_, n) => {
    smoothAt.forEach((at, j) => { final[n * q + at] = atEnd[j]; });
    keptAt.forEach((at, j) => { final[n * q + at] = grid.last[j]; });
  });
  if (pieces) final.fill(1, width - 3);
  return { table, width, final, first: rows.first };
}
