// The table of metrics, one row per run. Its cells are reused as long as the runs stay the same.

const NAMES = {
  max_abs_e: "max |e|", tail_max_abs_e: "max |e|, tail", rms_e: "RMS e", max_abs_u: "max |u|", theta_hat_final: "estimates at the end",
  theta_hat_variation_rate: "variation, 1/s",
};

function brief(value) {
  if (value === null) return "–";
  if (Array.isArray(value)) return value.length ? value.map(brief).join(", ") : "–";
  return value === 0 ? "0" : String(Number(value.toPrecision(4)));
}

// The effect of the step on the run: the largest h |eigenvalue|, and whether the run stays in the method's region of stability.
function carried(numerics) {
  if (!numerics) return "barbalat run judges it";
  const { hLambda, unstable } = numerics;
  return `${brief(hLambda)}: ${unstable === null ? "inside" : `outside the region of stability from ${brief(unstable)} s`}`;
}

// A run's verdict, and whether it needs a finer step: the spectrum at single instants alone does not decide this.
export function verdictText({ verdict, numerics }) {
  const open = numerics && numerics.unstable !== null;
  return `${verdict.sentence}${open ? `, outside the solver's region of stability from ${brief(numerics.unstable)} s: not settled without a finer step h` : ""}`;
}

// The sentences of run/results/findings.py for recorded signals that end before the run.
export function heldText({ signals, controllers }, tEnd) {
  const { commands } = controllers[0].shape;
  return signals.points.flatMap((points, i) => {
    const last = points ? points.times.length - 1 : 0;
    if (!points || !(points.times[last] < tEnd)) return [];
    const what = i < commands ? "The recorded command" : "A recorded disturbance";
    return [`${what} ends at t = ${brief(points.times[last])} s and is held at its last value, ${brief(points.values[last])}, until t = ${tEnd} s.`];
  });
}

export class Figures {
  constructor(body) {
    this.body = body;
  }

  show(parts) {
    while (this.body.rows.length > parts.length) this.body.deleteRow(-1);
    parts.forEach(({ run, label }, i) => this.put(this.body.rows[i] ?? this.body.insertRow(), run, label));
  }

  put(row, { figures, numerics }, label) {
    const diverged = figures.diverged_at !== null;
    const look = `${label} ${diverged}`;
    if (row.dataset.look !== look) {
      row.dataset.look = look;
      row.replaceChildren(Object.assign(document.createElement("th"), { scope: "row", textContent: label }));
      for (const name of [...(diverged ? [""] : Object.values(NAMES)), "h|λ|"]) row.insertCell().dataset.label = name;
      if (diverged) row.cells[1].colSpan = Object.keys(NAMES).length;
    }
    if (diverged) row.cells[1].textContent = `diverged at t = ${brief(figures.diverged_at)} s`;
    else Object.keys(NAMES).forEach((key, j) => { row.cells[j + 1].textContent = brief(figures[key]); });
    row.cells[row.cells.length - 1].textContent = carried(numerics);
    row.dataset.numerics = JSON.stringify(numerics);
    row.dataset.figures = JSON.stringify(figures);
  }
}
