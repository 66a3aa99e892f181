// Panels as in barbalat run: motion with model and command, error, control, estimates; all show the same interval.

/* global uPlot */

const HEIGHT = 220;

function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(name).trim();
  return { lines: [0, 1, 2, 3, 4, 5].map((i) => of(`--line-${i}`)), ink: of("--ink"), quiet: of("--quiet"), rule: of("--rule") };
}

// The panels' series, from the runs that are shown; each is {t, label, low, high?, colour, dash, width}.
export function panelsOf(data, shown, moved) {
  const found = [];
  const one = data.controllers[0];
  for (const panel of one.panels) {
    const series = [];
    for (const { run, colour, dash, label } of shown) {
      const at = data.controllers[run.index];
      const value = at.output ? middle(run, at, "y", 0) : rows(run, at.x[panel.state]);
      series.push({ t: run.t, low: value, colour, dash, label });
    }
    const first = shown.find(({ dash }) => !dash) || shown[0];
    if (first) {
      const { run } = first;
      const at = data.controllers[run.index];
      const y = at.output ? middle(run, at, "y", 0) : null;
      const e = at.output ? middle(run, at, "e", 0) : null;
      const model = at.output ? y.map((v, i) => v - e[i]) : rows(run, at.x_m[panel.state]);
      series.push({ t: run.t, low: model, colour: "ink", dash: [6, 4], label: "model" });
      for (const { index, gain } of panel.commands) {
        const scale = moved ? 1 : gain; // the model's gain at rest is the case's
        const value = run.t.map((_, i) => scale * run.r[i * at.shape.commands + index]);
        const label = Math.abs(scale - 1) < 1e-3 ? "command" : `${Number(scale.toPrecision(4))} × command`;
        series.push({ t: run.t, low: value, colour: "quiet", dash: [2, 3], label });
      }
    }
    found.push({ title: one.output ? "Output y, model and command" : `State x${panel.state + 1}, model and command`, series });
  }
  const errors = shown.map(({ run, colour, dash, label }) => {
    const at = data.controllers[run.index];
    const [low, high] = ["min", "max"].map((side) => entries(run, at, "e", side));
    const largest = run.t.map((_, i) => {
      const all = low.map((part, j) => Math.max(Math.abs(part[i]), Math.abs(high[j][i])));
      return Math.max(...all, Number.MIN_VALUE);
    });
    return { t: run.t, low: largest, colour, dash, label };
  });
  found.push({ title: "Largest |eᵢ| between two recorded instants", series: errors, log: true });
  found.push({ title: "Control u", series: shown.flatMap((part) => envelopes(data, part, "u", "u")) });
  for (const [index, controller] of data.controllers.entries()) {
    const own = shown.filter(({ run }) => run.index === index);
    if (!own.length || controller.theta_hat[1] === controller.theta_hat[0]) continue;
    const series = own.flatMap(({ run, dash }) => envelopes(data, { run, dash, colour: null, label: null }, "theta_hat", "θ̂"));
    const count = controller.theta_hat[1] - controller.theta_hat[0];
    if (controller.true && controller.true.length === count && !moved) {
      controller.true.forEach((value, i) => {
        const { t } = own[0].run;
        series.push({ t, low: t.map(() => value), colour: i, dash: [2, 3], label: i ? null : "true values" });
      });
    }
    found.push({ title: `${controller.name}: estimates`, series });
  }
  return found;
}

function rows(run, row) {
  return run.t.map((_, i) => run.recorded[i * run.size + row]);
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

function envelopes(data, { run, colour, dash, label }, quantity, symbol) {
  const at = data.controllers[run.index];
  const [low, high] = ["min", "max"].map((side) => entries(run, at, quantity, side));
  return low.map((values, j) => ({
    t: run.t, low: values, high: high[j], colour: colour ?? j, dash,
    label: low.length > 1 || label === null ? `${label ? `${label}, ` : ""}${symbol}${j + 1}` : label,
  }));
}

function inked(theme, name) {
  return typeof name === "number" ? theme.lines[name % theme.lines.length] : theme[name];
}

function legendOf(panel, theme) {
  const legend = document.createElement("ul");
  legend.className = "legend";
  const told = new Set();
  for (const one of panel.series) {
    const key = `${one.label} ${one.colour} ${one.dash}`;
    if (!one.label || told.has(key)) continue;
    told.add(key);
    const row = document.createElement("li");
    const mark = document.createElement("i");
    mark.style.borderTopColor = inked(theme, one.colour);
    mark.style.borderTopStyle = one.dash ? "dashed" : "solid";
    row.append(mark, one.label);
    legend.append(row);
  }
  return legend;
}

// Powers of ten alone: lines between them would hide what is drawn.
function decades(_, __, low, high) {
  const first = Math.ceil(Math.log10(low));
  const every = Math.max(1, Math.ceil((Math.log10(high) - first) / 6));
  const found = [];
  for (let k = first; k <= Math.floor(Math.log10(high)); k += every) found.push(10 ** k);
  return found;
}

export class Charts {
  constructor(root, onZoom) {
    this.root = root;
    this.onZoom = onZoom;
    this.plots = [];
    this.window = null;
    this.zooming = false;
  }

  draw(panels) {
    for (const plot of this.plots) plot.destroy();
    this.root.textContent = "";
    const theme = colours();
    const boxes = panels.map((panel) => this.framed(panel, theme)); // all of them: the columns' width is known then
    this.plots = panels.map((panel, i) => this.plotted(panel, theme, boxes[i]));
    if (this.window) this.zoom(...this.window);
  }

  framed(panel, theme) {
    const figure = document.createElement("figure");
    const title = document.createElement("figcaption");
    title.textContent = panel.title;
    const box = document.createElement("div");
    box.className = "panel";
    box.setAttribute("role", "img");
    box.setAttribute("aria-label", `${panel.title}; its figures stand in the table`);
    figure.append(title, box, legendOf(panel, theme));
    this.root.append(figure);
    return box;
  }

  plotted(panel, theme, box) {
    const colour = (name) => inked(theme, name);
    const series = [{ label: "t, s" }];
    const bands = [];
    const columns = [];
    for (const one of panel.series) {
      const style = { stroke: colour(one.colour), dash: one.dash || undefined, width: 1.4, points: { show: false }, spanGaps: true };
      series.push({ label: one.label || "", ...style });
      columns.push([one.t, one.high || one.low]);
      if (one.high) {
        bands.push({ series: [series.length - 1, series.length], fill: `${colour(one.colour)}55` });
        series.push({ label: "", ...style });
        columns.push([one.t, one.low]);
      }
    }
    const grid = panel.series.every((one) => one.t === panel.series[0].t);
    const joined = grid ? [panel.series[0]?.t ?? [0], ...columns.map(([, v]) => v)] : uPlot.join(columns);
    const axis = { stroke: theme.ink, grid: { stroke: theme.rule, width: 1 }, ticks: { stroke: theme.rule } };
    const plot = new uPlot({
      width: Math.max(box.clientWidth, 200), height: HEIGHT, legend: { show: false },
      scales: { x: { time: false }, y: panel.log ? { distr: 3 } : {} },
      axes: [axis, panel.log ? { ...axis, size: 64, splits: decades, filter: (_, at) => at, values: (_, at) => at.map((v) => v.toExponential(0)) } : { ...axis, size: 64 }], cursor: { drag: { x: true, y: false } }, series, bands,
      hooks: { setScale: [(self, key) => key === "x" && this.zoomed(self)] },
    }, joined, box);
    return plot;
  }

  zoomed(from) {
    if (this.zooming) return;
    const { min, max } = from.scales.x;
    if (min === null || max === null) return;
    this.zooming = true;
    const whole = from.data[0];
    const all = min <= whole[0] && max >= whole[whole.length - 1];
    this.window = all ? null : [min, max];
    for (const plot of this.plots) if (plot !== from) plot.setScale("x", { min, max });
    this.zooming = false;
    this.onZoom(min, max);
  }

  zoom(min, max) {
    this.plots[0]?.setScale("x", { min, max });
  }

  whole() {
    this.window = null;
    for (const plot of this.plots) plot.setData(plot.data);
  }

  resized() {
    for (const plot of this.plots) plot.setSize({ width: Math.max(plot.root.parentElement.clientWidth, 200), height: HEIGHT });
  }
}
