// The table of figures: a row for each run, in the same cells as long as the runs are the same ones.

const NAMES = {
  max_abs_e: "max |e|", tail_max_abs_e: "max |e|, tail", rms_e: "RMS e", max_abs_u: "max |u|", theta_hat_final: "estimates at the end",
  theta_hat_variation_rate: "variation, 1/s",
};

function brief(value) {
  if (value === null) return "–";
  if (Array.isArray(value)) return value.length ? value.map(brief).join(", ") : "–";
  return value === 0 ? "0" : String(Number(value.toPrecision(4)));
}

// What the step makes of the run: the largest h |eigenvalue| that was seen, and whether it stays in the method's region of stability.
function carried(numerics, diverged) {
  if (!numerics) return "barbalat run judges it";
  const { hLambda, unstable } = numerics;
  if (unstable === null) return `${brief(hLambda)}: inside`;
  // a true finite escape leaves every step's region just before it
  const said = diverged ? `outside the region of stability from ${brief(unstable)} s; whose the divergence is, barbalat run says` : `numerically unstable from ${brief(unstable)} s`;
  return `${brief(hLambda)}: ${said}`;
}

// With so many digits and no zeros behind them.
function rounded(value, digits) {
  return value.toPrecision(digits).replace(/\.(\d*?)0+(?=e|$)/, (_, kept) => (kept ? `.${kept}` : ""));
}

// The sentence of barbalat run.
export function runawayText(runaway) {
  return `|e| reaches ${rounded(runaway.max_abs_e, 3)}, ${rounded(runaway.over_model, 2)} times the model's motion, and still grows at the end: the run runs away, though it has not diverged`;
}

// How a run ends, for the status line; nothing is said of what comes after the horizon.
export function endOf({ figures, runaway }, tEnd) {
  if (figures.diverged_at !== null) return `diverges at ${figures.diverged_at} s`;
  if (runaway) return `runs away, though it has not diverged by ${tEnd} s: |e| reaches ${rounded(runaway.max_abs_e, 3)} and still grows`;
  return `neither diverges nor runs away up to ${tEnd} s`;
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
    row.cells[row.cells.length - 1].textContent = carried(numerics, diverged);
    row.dataset.numerics = JSON.stringify(numerics);
    row.dataset.figures = JSON.stringify(figures);
  }
}
