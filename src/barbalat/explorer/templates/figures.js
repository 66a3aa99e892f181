// The metrics of a run, merged block by block in the simulator's order.

import { tailStart } from "./grid.js";

const RESETS = { min: Infinity, max: -Infinity, sum: 0, steps: 0, alive: 1 };

export class Totals {
  constructor(operations) {
    this.rows = {};
    this.operations = [];
    for (const [quantity, operation, size] of operations) {
      this.rows[`${quantity} ${operation}`] = [this.operations.length, this.operations.length + size];
      for (let i = 0; i < size; i++) this.operations.push([quantity, operation]);
    }
    this.head = Float64Array.from(this.operations, ([, operation]) => RESETS[operation]);
    this.tail = this.head.slice();
    this.divergedStep = null;
  }

  merge(segment, out, states) {
    const total = segment.inTail ? this.tail : this.head;
    const size = states + total.length;
    this.operations.forEach(([, operation], i) => {
      let found = RESETS[operation];
      for (let block = 0; block < segment.blocks; block++) {
        const value = out[block * size + states + i];
        if (operation === "min") found = value < found || Number.isNaN(value) ? value : found;
        else if (operation === "max") found = value > found || Number.isNaN(value) ? value : found;
        else if (operation === "sum") found = block === 0 ? value : found + value;
      }
      if (operation === "min") total[i] = Math.min(total[i], found);
      else if (operation === "max") total[i] = Math.max(total[i], found);
      else if (operation === "sum") total[i] += found;
    });
    const steps = states + this.rows["good steps"][0];
    for (let block = 0; block < segment.blocks; block++) {
      const good = out[block * size + steps];
      if (good < segment.length) {
        this.divergedStep = segment.start + block * segment.length + good + 1;
        return false;
      }
    }
    return true;
  }

  mergeFinal(out, states) {
    this.operations.forEach(([quantity, operation], i) => {
      const value = out[states + i];
      if (operation === "min") this.tail[i] = Math.min(this.tail[i], value);
      else if (operation === "max") this.tail[i] = Math.max(this.tail[i], value);
      else if (quantity === "e^2") this.tail[i] += value;
    });
  }

  figures(grid, thetaHat) {
    const { steps, tEnd } = grid;
    const gone = this.divergedStep !== null;
    const part = (total, name) => Array.from(total.subarray(...this.rows[name]));
    const largest = (name, totals) => {
      const each = totals.map((total) => {
        const low = part(total, `${name} min`);
        return part(total, `${name} max`).map((high, i) => Math.max(-low[i], high));
      });
      return each[0].map((_, i) => Math.max(...each.map((one) => one[i])));
    };
    const finite = (values) => values.map((v) => (gone || !Number.isFinite(v) ? null : v));
    const both = [this.head, this.tail];
    const tailTime = tEnd - (tailStart(steps) * tEnd) / steps;
    const squares = part(this.head, "e^2 sum").map((v, i) => v + part(this.tail, "e^2 sum")[i]);
    const u = finite(largest("u", both));
    const found = {
      diverged_at: gone ? (this.divergedStep * tEnd) / steps : null,
      max_abs_e: finite(largest("e", both)),
      rms_e: finite(squares.map((v) => Math.sqrt(v / (steps + 1)))),
      tail_max_abs_e: finite(largest("e", [this.tail])),
      max_abs_u: u.length === 1 ? u[0] : u,
      theta_hat_final: finite(Array.from(thetaHat)),
      theta_hat_tail_min: finite(part(this.tail, "theta_hat min")),
      theta_hat_tail_max: finite(part(this.tail, "theta_hat max")),
      theta_hat_variation_rate: finite(part(this.tail, "variation sum").map((v) => (tailTime ? v / tailTime : 0))),
    };
    const y = this.rows["y min"];
    if (y[1] > y[0]) found.max_abs_y = finite(largest("y", both))[0];
    return found;
  }
}
