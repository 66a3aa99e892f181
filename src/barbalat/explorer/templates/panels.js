// The panels of barbalat run: motion with model and command, error, control and estimates.

// The panels of the runs that are shown. A series is {t, label, low, high?, colour, dash}; that of a run also has the run's
// name and ``gone``, true if the run has diverged.
export function panelsOf(data, shown, moved) {
  const errors = shown.map((part) => ({ ...part, t: part.run.t, low: largestError(data, part.run) }));
  return [
    ...data.controllers[0].panels.map((panel) => motion(data, shown, moved, panel)),
    { title: "Largest |eᵢ| between two recorded instants", series: errors, log: true },
    { title: "Control u", series: shown.flatMap((part) => envelopes(data, part, "u", (j) => `u${j + 1}`)) },
    ...data.controllers.flatMap((controller, index) => {
      const own = shown.filter(({ run }) => run.index === index);
      const none = !own.length || !(controller.estimates.length + controller.beside.length);
      return none ? [] : [estimates(data, own, moved, controller)];
    }),
  ];
}

function motion(data, shown, moved, panel) {
  const series = shown.map((part) => {
    const at = data.controllers[part.run.index];
    return { ...part, t: part.run.t, low: at.output ? middle(part.run, at, "y", 0) : rows(part.run, at.x[panel.state]) };
  });
  const { output } = data.controllers[0];
  const what = output ? "Output y" : `State x${panel.state + 1}`;
  const title = `${what}${panel.name ? ` = ${panel.name}` : ""}, model and command`;
  const live = shown.filter(({ dash }) => !dash);
  const end = ({ run }) => run.starts[run.starts.length - 1] ?? -1;
  const first = (live.length ? live : shown).reduce((best, one) => (best && end(best) >= end(one) ? best : one), null); // the longest
  if (!first) return { title, series };
  const { run } = first;
  const at = data.controllers[run.index];
  let model = null;
  if (at.output) {
    const e = middle(run, at, "e", 0);
    model = middle(run, at, "y", 0).map((v, i) => v - e[i]);
  } else model = rows(run, at.x_m[panel.state]);
  series.push({ t: run.t, low: model, colour: "ink", dash: [6, 4], label: "model" });
  for (const { index, gain } of panel.commands) {
    const scale = moved ? 1 : gain; // the gain is that of the case's own model
    const value = run.t.map((_, i) => scale * run.r[i * run.timed + index]);
    const label = Math.abs(scale - 1) < 1e-3 ? "command" : `${Number(scale.toPrecision(4))} × command`;
    series.push({ t: run.t, low: value, colour: "quiet", dash: [2, 3], label });
  }
  return { title, series };
}

function estimates(data, own, moved, controller) {
  const names = controller.estimates;
  const { beside } = controller;
  const series = own.flatMap(({ run, dash, name, gone }) => [
    ...envelopes(data, { run, dash, name, gone, colour: null, label: null }, "theta_hat", (j) => names[j]),
    ...beside.map(({ label, row }, k) => ({ t: run.t, low: rows(run, row), colour: names.length + k, dash, label, name, gone })),
  ]);
  const known = controller.true && controller.true.length === names.length ? controller.true : names.map(() => null);
  const { t } = own[0].run;
  let said = moved; // a changed plant has other true values, which are not known here
  [...known, ...beside.map((one) => one.true)].forEach((value, i) => {
    if (moved || value === null) return;
    series.push({ t, low: t.map(() => value), colour: i, dash: [2, 3], label: said ? null : "true values" });
    said = true;
  });
  return { title: `${controller.name}: estimates`, series };
}

function largestError(data, run) {
  const at = data.controllers[run.index];
  const found = new Float64Array(run.t.length).fill(Number.MIN_VALUE);
  for (const side of ["min", "max"]) {
    for (const part of entries(run, at, "e", side)) {
      for (let i = 0; i < found.length; i++) if (!(Math.abs(part[i]) <= found[i])) found[i] = Math.abs(part[i]);
    }
  }
  return found;
}

// The values of one recorded row at all instants.
function rows(run, row) {
  const found = new Float64Array(run.t.length);
  for (let i = 0; i < found.length; i++) found[i] = run.recorded[i * run.size + row];
  return found;
}

function place(at, quantity, side) {
  let row = at.shape.states;
  for (const [name, operation, size] of at.operations) {
    if (name === quantity && operation === side) return [row, size];
    row += size;
  }
  return [row, 0];
}

function entries(run, at, quantity, side) {
  const [row, size] = place(at, quantity, side);
  return Array.from({ length: size }, (_, j) => rows(run, row + j));
}

function middle(run, at, quantity, j) {
  const [low, high] = ["min", "max"].map((side) => entries(run, at, quantity, side)[j]);
  return low.map((v, i) => (v + high[i]) / 2);
}

function envelopes(data, { run, colour, dash, label, name, gone }, quantity, nameOf) {
  const at = data.controllers[run.index];
  const [low, high] = ["min", "max"].map((side) => entries(run, at, quantity, side));
  return low.map((values, j) => ({
    t: run.t, low: values, high: high[j], colour: colour ?? j, dash, name, gone,
    label: low.length > 1 || label === null ? `${label ? `${label}, ` : ""}${nameOf(j)}` : label,
  }));
}
