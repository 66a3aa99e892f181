// The judge of barbalat run. It turns the memory that a kernel keeps after the loop's states into a verdict and its sentence.
// The kernel's own operations update the memory (judge/appended.py). The rules are those of judge/judged.py and
// run/engine/judging.py; their numbers are in the page's data.

import { eigenvalues } from "./spectrum.js";
import { CHUNK_STEPS, tailStart } from "./grid.js";

// The judge's memory before the tail and after the whole run, accessed by the names of its rows.
export class Kept {
  constructor(judge, beforeTail, whole) {
    Object.assign(this, { judge, places: placesOf(judge.rows), beforeTail, whole });
  }

  of(name) {
    return this.whole.subarray(...this.places[name]);
  }

  inTail(name) {
    const before = this.beforeTail.subarray(...this.places[name]);
    return Array.from(this.of(name), (value, i) => value - before[i]);
  }

  // The range of each control; swings are judged as fractions of it.
  ranges() {
    return Array.from(this.of("range"), (one, j) => Math.max(one, this.roundings(j)));
  }

  // The reversals of each control in the tail; 0 for a control that moves only by rounding errors.
  reversals() {
    return this.inTail("reversals").map((count, j) => (this.of("range")[j] > this.roundings(j) ? count : 0));
  }

  roundings(j) {
    const whole = (name) => [this.beforeTail, this.whole].map((kept) => kept[this.places[name][0] + j]);
    return this.judge.leastRange * Math.max(0, ...[...whole("low"), ...whole("high")].map(Math.abs).filter(Number.isFinite));
  }
}

export function placesOf(rows) {
  let start = 0;
  return Object.fromEntries(rows.map(([name, size]) => [name, [start, start += size]]));
}

// Resets the given rows of the memory to their initial values, as at the start of a tail or a window.
export function renew(judge, memory, rows) {
  for (const row of rows) memory[row] = judge.begins[row];
}

// The scale of each component, as in judge/scale.py, with the response to the disturbances of the case file.
// The list judge.initial has, for each component, the rows of its states and their factors. It is empty if an output is measured.
function scaleOf({ judge, states }, kept) {
  const model = Array.from(kept.of("largest y_m"));
  const most = Math.max(0, ...model);
  const found = model.map((one, i) => {
    const moves = one > judge.rounding * most ? one : 0;
    const initial = (judge.initial[i] ?? []).reduce((sum, [row, factor]) => sum + factor * states[row], 0);
    const other = Math.max(Math.abs(initial), judge.noise[i], judge.answer[i]);
    return moves > judge.resting * other ? moves : other;
  });
  return found.map((one, i) => (one > 0 ? one : found.reduce((sum, other, j) => sum + judge.spread[i][j] * other, 0)));
}

// held: the values at which the signals are held while a suspect is examined. cyclesOf(band, held) is called only for suspects.
export function verdictOf(task, kept, diverged, recorded, held, cyclesOf) {
  const { judge, grid } = task;
  const scale = scaleOf(task, kept);
  const follows = judge.names.map((name, i) => judge.follows[name] ?? judge.followsShare * scale[i]);
  const limits = judge.names.map((name, i) => judge.lost[name] ?? (scale[i] > 0 ? judge.lostShare * scale[i] : Infinity));
  const lost = diverged !== null || !limits.every((limit, i) => kept.of("largest y")[i] <= limit);
  const error = Array.from(kept.of("largest e"));
  const within = error.every((one, i) => one <= follows[i]);
  const suspect = !lost && (judge.closely || kept.reversals().some((count) => count > judge.fewestReversals));
  const cycle = suspect ? cyclesOf(kept.ranges().map((one) => judge.cycle * one), held) : null;
  const kind = lost ? "lost" : cycle ? "limit cycle" : within ? "follows" : "off";
  const [worst, other] = toldOf(judge, kind, error, follows);
  const of = (i) => ({ component: judge.names[i], unit: judge.units[i], error: error[i], band: follows[i], scale: scale[i], followsShare: judge.followsShare });
  const found = {
    leastSaid: judge.leastSaid, kind, cycle, worst, ...of(worst), beside: other === null ? null : of(other),
    atLimit: sharesOf(kept, "at limit", judge.limited, grid.steps + 1), atRateLimit: sharesOf(kept, "at rate limit", judge.rateLimited, grid.steps + 1),
    lostAt: lost ? earliest([diverged, lostAt(task, kept, recorded, limits)]) : null,
  };
  const said = { ...found, inputUnit: (cycle && judge.inputUnits[cycle.input]) || "" };
  return { ...said, sentence: sentenceOf(said) };
}

// The component that the verdict names, and a second one that it mentions, or null, as in Judged._told.
function toldOf(judge, kind, error, follows) {
  const worst = worstOf(error, follows, error.map((_, i) => i));
  if (!judge.declared.length || kind === "lost") return [worst, null];
  const first = worstOf(error, follows, judge.declared);
  if (first === worst || error[worst] <= judge.leastBeside * follows[worst]) return [worst, null];
  return kind === "off" && error[first] <= follows[first] ? [worst, first] : [first, worst];
}

function worstOf(error, follows, among) {
  const against = among.map((i) => (error[i] > 0 ? error[i] / follows[i] : Number.isNaN(error[i]) ? Infinity : 0));
  return among[against.indexOf(Math.max(...against))];
}

function sharesOf(kept, name, which, instants) {
  let k = 0;
  return which.map((has) => (has ? kept.of(name)[k++] / instants : 0));
}

function earliest(times) {
  const known = times.filter((one) => one !== null);
  return known.length ? Math.min(...known) : null;
}

// The first recorded instant at which a component had exceeded its limit [s], or null.
function lostAt({ shape, judge, grid, own }, kept, { rows, starts }, limits) {
  const [first] = kept.places["largest y"];
  const size = shape.states + shape.accumulators;
  for (let k = 0; k < starts.length; k++) {
    if (limits.some((limit, i) => rows[k * size + own + first + i] > limit)) return (starts[k] * grid.tEnd) / grid.steps;
  }
  return null;
}

// The held values of the signals, as in judge/held.py, from steps of the tail. A clock keeps running; intermittent faults end.
export function heldIn(task, commands) {
  const { judge, grid } = task;
  const begin = tailStart(grid.steps);
  const count = Math.min(judge.instants, grid.steps - begin + 1);
  const steps = Array.from({ length: count }, (_, i) => begin + Math.round((i * (grid.steps - begin)) / Math.max(count - 1, 1)));
  const values = commands.at(steps);
  return Array.from({ length: commands.count }, (_, j) => {
    const own = steps.map((_, i) => values[i * commands.count + j]);
    if (judge.passing[j]) return 0;
    return judge.clock[j] ? NaN : own.reduce((most, one) => (Math.abs(one) > Math.abs(most) ? one : most));
  });
}

// The longest period of the model's modes [s], 0 if it has none. The model's matrix is a block of the loop's Jacobian.
export function slowestPeriod({ model, own, judge }, jacobian) {
  if (!jacobian) return judge.slowest;
  const { rows } = model;
  const block = Float64Array.from(rows.flatMap((i) => rows.map((j) => jacobian[i * own + j])));
  const found = eigenvalues(block, rows.length);
  if (!found) return judge.slowest;
  const rates = Array.from(found.re, (re, i) => Math.hypot(re, found.im[i])).filter((rate) => rate > 0);
  return rates.length ? (2 * Math.PI) / Math.min(...rates) : 0;
}

// Continues the run in windows with everything held, as in judge/cycles.py. Returns the limit cycle that is largest relative
// to its control's range, or null.
export function cycleOf(task, kept, slowest, going, band) {
  const { judge, grid, dt } = task;
  const tail = grid.tEnd - (tailStart(grid.steps) * grid.tEnd) / grid.steps;
  const reversals = Math.max(...kept.reversals());
  const periods = reversals > 0 ? (judge.fewestCycles * 2 * tail) / reversals : 0;
  const longest = judge.longestShare * grid.tEnd;
  const steps = Math.max(Math.round(Math.min(Math.max(judge.slowestPeriods * slowest, periods) || longest, longest) / dt), 1);
  const seen = [];
  if (steps >= judge.firstPieces) {
    const end = (i) => Math.floor((i * steps) / judge.firstPieces);
    const pieces = Array.from({ length: judge.firstPieces }, (_, i) => going.window(end(i + 1) - end(i)));
    if (quiet(pieces, band)) return null;
    seen.push(together(pieces));
  }
  do seen.push(going.window(steps)); while (seen.length < judge.fewestWindows || (seen.length < judge.mostWindows && !decided(judge, seen, band)));
  const which = cycling(judge, seen, band);
  const last = seen[seen.length - 1];
  if (!which.some(Boolean)) return null;
  const turned = Math.max(...last.reversals), windows = Math.ceil((2 * judge.fewestCycles) / turned);
  const { times, path } = going.traced(windows * steps, Math.floor(judge.samplesEachReversal * windows * turned));
  const against = which.map((is, j) => (is ? last.swing[j] / kept.ranges()[j] : -1));
  const input = against.indexOf(Math.max(...against));
  return { input, amplitude: last.swing[input] / 2, frequency: frequencyOf(times, path.map((row) => row[input])) };
}

function quiet(pieces, band) {
  const [before, last] = pieces.slice(-2);
  const within = pieces.slice(1).every((one) => one.swing.every((value, j) => value <= band[j]));
  return within && last.swing.every((value, j) => value <= before.swing[j]) && !pieces.some((one) => one.lost);
}

function together(pieces) {
  const each = (name, take) => pieces[0][name].map((_, j) => take(...pieces.map((one) => one[name][j])));
  const [low, high] = [each("low", Math.min), each("high", Math.max)];
  const reversals = each("reversals", (...counts) => counts.reduce((sum, count) => sum + count, 0));
  return { low, high, swing: high.map((value, j) => value - low[j]), reversals, lost: pieces.some((one) => one.lost) };
}

function swings({ swing, reversals, lost }, band) {
  return swing.map((one, j) => one > band[j] && reversals[j] >= 2 && !lost);
}

function decided(judge, seen, band) {
  const [before, last] = seen.slice(-2);
  const moves = swings(last, band);
  return last.lost || last.swing.every((one, j) => Math.abs(one - before.swing[j]) <= judge.steadyShare * one || !moves[j]);
}

function cycling(judge, seen, band) {
  const [earlier, before, last] = seen.slice(-3);
  return swings(last, band).map((moves, j) => {
    const change = Math.log(last.swing[j] / before.swing[j]);
    const changeBefore = Math.log(before.swing[j] / earlier.swing[j]);
    const ends = Math.abs(change) <= judge.levellingShare * Math.abs(changeBefore) || change * changeBefore < 0;
    return moves && Math.abs(change) <= -Math.log(judge.keptShare) && (ends || Math.abs(change) <= judge.steadyShare);
  });
}

// The frequency at which a control rises from the lowest to the highest quarter of its swing [rad/s].
function frequencyOf(times, values) {
  const [low, high] = values.reduce(([least, most], v) => [Math.min(least, v), Math.max(most, v)], [Infinity, -Infinity]);
  const up = [];
  let side = 0;
  values.forEach((v, k) => {
    const here = v > low + 0.75 * (high - low) ? 1 : v < low + 0.25 * (high - low) ? -1 : 0;
    if (here === 1 && side === -1) up.push(times[k]);
    if (here) side = here;
  });
  return up.length > 1 ? (2 * Math.PI * (up.length - 1)) / (up[up.length - 1] - up[0]) : 0;
}

// A run beyond its end: commands and disturbances are held, and the measurement has no noise. The function
// advance(blocks, length, step, table) advances the loop and returns the rows of its blocks. The argument state is the whole state,
// with the memory after the loop's own states.
export class Continued {
  constructor(task, held, state, good, advance) {
    Object.assign(this, { task, held, state, good, advance, step: task.grid.steps, places: placesOf(task.judge.rows) });
  }

  table(count) {
    const { nodes, grid, shape } = this.task;
    const width = this.held.length * nodes.length + (shape.pieces ? 3 : 0);
    const found = new Float64Array(count * width);
    for (let i = 0; i < count; i++) {
      nodes.forEach((node, n) => this.held.forEach((value, j) => {
        found[i * width + n * this.held.length + j] = Number.isNaN(value) ? ((this.step + i + node) * grid.tEnd) / grid.steps : value;
      }));
      if (shape.pieces) found.fill(1, (i + 1) * width - 3, (i + 1) * width);
    }
    return found;
  }

  call(blocks, length) {
    const { out, state } = this.advance(blocks, length, this.step, this.state, this.table(blocks * length));
    this.state = state;
    this.step += blocks * length;
    return out;
  }

  window(steps) {
    const { task: { judge, own, shape }, places } = this;
    const memory = () => this.state.subarray(own, own + judge.begins.length);
    const before = memory().slice();
    renew(judge, memory(), judge.renewed.window);
    let good = 0;
    for (let done = 0; done < steps;) {
      const count = Math.min(CHUNK_STEPS, steps - done);
      good += this.call(1, count)[shape.states + this.good];
      done += count;
    }
    const after = memory();
    const of = (name, from = after) => Array.from(from.subarray(...places[name]));
    const [low, high] = [of("low"), of("high")];
    const turned = of("reversals").map((value, j) => value - of("reversals", before)[j]);
    return { low, high, swing: high.map((value, j) => value - low[j]), reversals: turned, lost: good < steps };
  }

  traced(steps, samples) {
    const { own, shape } = this.task;
    const [farthest, direction] = [this.places.farthest, this.places.direction];
    const length = Math.min(Math.max(Math.floor(steps / Math.max(samples, 1)), 1), CHUNK_STEPS);
    const [blocks, most] = [Math.floor(steps / length), Math.floor(CHUNK_STEPS / length)];
    const size = shape.states + shape.accumulators;
    const found = { times: [], path: [] };
    for (let begin = 0; begin < blocks; begin += most) {
      const count = Math.min(most, blocks - begin);
      const at = this.step;
      const out = this.call(count, length);
      for (let i = 0; i < count; i++) {
        found.times.push((at + i * length) * this.task.dt);
        const kept = out.subarray(i * size + own, (i + 1) * size);
        found.path.push(Array.from(kept.subarray(...farthest), (value, j) => value * kept[direction[0] + j]));
      }
    }
    return found;
  }
}

// The given number of decimal digits, and the power of ten of the first one. An exact half is rounded to even, as in Python.
function digitsOf(value, digits) {
  const [mantissa, exponent] = Math.abs(value).toExponential(90).split("e");
  const exact = mantissa.replace(".", "");
  const [kept, rest] = [BigInt(exact.slice(0, digits)), exact.slice(digits)];
  const half = `5${"0".repeat(rest.length - 1)}`;
  const up = rest > half || (rest === half && kept % 2n === 1n);
  const found = String(kept + (up ? 1n : 0n));
  return [found.slice(0, digits), Number(exponent) + found.length - digits];
}

function positional(found, power) {
  if (power >= found.length - 1) return found + "0".repeat(power - found.length + 1);
  const all = power < 0 ? "0".repeat(-power) + found : found;
  const point = Math.max(power, 0) + 1;
  return `${all.slice(0, point)}.${all.slice(point)}`.replace(/\.?0+$/, "");
}

// Formats a number with this many digits, as Python's %g does.
export function brief(value, digits = 3) {
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "nan" : value < 0 ? "-inf" : "inf";
  if (value === 0) return "0";
  const sign = value < 0 ? "-" : "";
  const [found, power] = digitsOf(value, digits);
  if (power >= -4 && power < digits) return sign + positional(found, power);
  return `${sign}${positional(found, 0)}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
}

// Formats a fraction as a percentage with two digits, without an exponent.
export function percent(share) {
  return share === 0 ? "0 %" : `${positional(...digitsOf(100 * share, 2))} %`;
}

export function sentenceOf(verdict) {
  const said = [saidOf(verdict)];
  for (const [shares, what] of [[verdict.atLimit, "limits"], [verdict.atRateLimit, "rate limit"]]) {
    const share = Math.max(0, ...shares);
    if (share >= verdict.leastSaid) said.push(`at its ${what} ${percent(share)} of the time`);
  }
  return said.join(", ");
}

function saidOf(verdict) {
  const { kind, cycle, inputUnit, beside, lostAt: at } = verdict;
  if (kind === "lost") return at === null ? "lost" : `lost at t = ${brief(at, 4)} s`;
  if (cycle) return `limit cycle, u swings by ±${brief(cycle.amplitude)}${inputUnit ? ` ${inputUnit}` : ""}${cycle.frequency ? ` at ${brief(cycle.frequency)} rad/s` : ""}`;
  if (kind === "follows") return `follows within ${deviation(verdict, beside)}${beside ? `, ${deviation(beside, true)}` : ""}`;
  if (!beside) return `off by ${deviation(verdict, true)}`;
  if (beside.error > beside.band) return `off by ${deviation(verdict, true)} and by ${deviation(beside, true)}`;
  return `within ${deviation(beside, true)}, but off by ${deviation(verdict, true)}`;
}

// Describes a deviation in words, as Deviation.said in judge/verdict.py does.
function deviation({ component, unit, error, band, followsShare, scale }, named) {
  const [found, where] = [`${brief(error)}${unit ? ` ${unit}` : ""}`, ` in ${component}`];
  if (band !== followsShare * scale) return `${found}${named ? where : ""} (band ${brief(band)}${unit ? ` ${unit}` : ""})`;
  if (!(scale > 0)) return `${found}${where}${error > 0 ? " (nothing sets its scale)" : ""}`;
  return `${percent(error / scale)}${named ? where : ""}`;
}
