// The panels of a page, which all show the same interval. If only the data change, the existing plots are updated.

/* global uPlot, document, getComputedStyle */

import { gestures } from "./zoom.js";

const HEIGHT = 220;

export function colours() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(name).trim();
  return { lines: [0, 1, 2, 3, 4, 5].map((i) => of(`--line-${i}`)), ink: of("--ink"), quiet: of("--quiet"), rule: of("--rule") };
}

export function inked(theme, name) {
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

// Ticks at powers of ten only; lines between them would hide the curves.
function decades(_, __, low, high) {
  const first = Math.ceil(Math.log10(low));
  const every = Math.max(1, Math.ceil((Math.log10(high) - first) / 6));
  const found = [];
  for (let k = first; k <= Math.floor(Math.log10(high)); k += every) found.push(10 ** k);
  return found;
}

// The same ticks on both sides of zero, for a scale that is logarithmic beyond 1.
function signedDecades(_, __, low, high) {
  const beyond = (end) => (end > 1 ? decades(null, null, 1, end).filter((v) => v > 1) : []);
  return [...beyond(-low).map((v) => -v).reverse(), 0, ...beyond(high)];
}

// The columns of a panel's series on a common grid of times.
function columnsOf(panel) {
  const columns = panel.series.flatMap((one) => (one.high ? [[one.t, one.high], [one.t, one.low]] : [[one.t, one.low]]));
  const first = panel.series[0]?.t ?? new Float64Array(1);
  if (panel.series.every(({ t }) => t === first || sameTimes(t, first))) return [first, ...columns.map(([, values]) => values)];
  return uPlot.join(columns);
}

function sameTimes(one, two) {
  return one.length === two.length && one[one.length - 1] === two[two.length - 1] && one.every((t, i) => t === two[i]);
}

const BESIDE = 0.25; // space above and below the bounded runs, as a fraction of their range, if another run diverges
const LARGEST_SHOWN = 20; // upper end of a logarithmic axis, as a multiple of the bounded runs' largest value

// A panel's scale: its own limits if it has any, else the range of the bounded runs; logarithmic beyond 1 if all runs diverge.
export function scaleOf(panel) {
  if (panel.limits) return { distr: panel.log ? 3 : panel.signed ? 4 : 1, range: () => panel.limits };
  if (panel.signed) return { distr: 4 };
  const columns = panel.series.flatMap((one) => (one.high ? [one.gone, one.gone] : [one.gone]));
  const runs = panel.series.filter(({ gone }) => gone !== undefined);
  const lost = runs.filter(({ gone }) => gone);
  if (!lost.length || lost.length === runs.length) {
    const all = columns.map(() => false);
    if (panel.log) return { distr: 3, range: (plot) => rangeOf(plot, all, true, 2) }; // zero is not on a logarithmic axis
    return lost.length ? { distr: 4 } : {};
  }
  return { distr: panel.log ? 3 : 1, range: (plot) => rangeOf(plot, columns, panel.log, LARGEST_SHOWN) };
}

// The range, over the interval that is shown, of all columns except those of runs that diverge. A logarithmic range extends
// to `beyond` times the largest value.
function rangeOf(plot, columns, log, beyond) {
  const [from, to] = plot.series[0].idxs ?? [0, plot.data[0].length - 1];
  let [low, high] = [Infinity, -Infinity];
  columns.forEach((gone, k) => {
    if (gone) return;
    for (let i = from; i <= to; i++) {
      const value = plot.data[k + 1][i];
      if (value === null || value === undefined || (log && value <= Number.MIN_VALUE)) continue;
      [low, high] = [Math.min(low, value), Math.max(high, value)];
    }
  });
  if (!(high >= low)) return log ? [1e-3, 1] : [-1, 1];
  if (log) return [low / 2, beyond * high];
  const room = BESIDE * (high - low) || 0.1 * Math.max(Math.abs(high), 1e-3);
  return [low - room, high + room];
}

// The appearance of a panel without its data.
function lookOf(panel, theme) {
  const series = panel.series.map((one) => [one.label, one.colour, one.dash, Boolean(one.high), one.gone]);
  return JSON.stringify([panel.title, panel.note, panel.log, series, theme]);
}

// Returns a phrase that names the lost runs of a panel.
function goneFrom(panel) {
  const runs = panel.series.filter(({ gone }) => gone !== undefined);
  const lost = runs.filter(({ gone }) => gone);
  if (!lost.length) return "";
  if (lost.length === runs.length) return panel.log ? "" : "lost: logarithmic beyond 1";
  return `lost, beyond the edge: ${[...new Set(lost.map(({ label, name }) => name ?? label))].join(", ")}`;
}

// Panels over time, or over frequency on a logarithmic axis, whose shown range is given in decades.
export class Charts {
  constructor(root, onZoom = () => {}, overFrequency = false) {
    this.root = root;
    this.onZoom = onZoom;
    this.overFrequency = overFrequency;
    this.plots = [];
    this.looks = [];
    this.window = null;
    this.zooming = false;
  }

  draw(panels) {
    const theme = colours();
    const looks = panels.map((panel) => lookOf(panel, theme));
    this.zooming = true;
    if (looks.join() === this.looks.join()) panels.forEach((panel, i) => this.plots[i].setData(columnsOf(panel), !this.window));
    else this.rebuild(panels, theme);
    this.looks = looks;
    if (this.window) {
      const [min, max] = this.back(this.window);
      for (const plot of this.plots) plot.setScale("x", { min, max });
    }
    this.zooming = false;
    if (!this.window) this.told();
  }

  rebuild(panels, theme) {
    for (const plot of this.plots) plot.destroy();
    this.root.textContent = "";
    const boxes = panels.map((panel) => this.framed(panel, theme)); // all frames are made first, so that the width of the columns is known
    this.plots = panels.map((panel, i) => this.plotted(panel, theme, boxes[i]));
  }

  framed(panel, theme) {
    const figure = document.createElement("figure");
    const title = document.createElement("figcaption");
    title.textContent = panel.title;
    const beyond = goneFrom(panel);
    if (beyond) title.append(Object.assign(document.createElement("small"), { textContent: ` (${beyond})` }));
    const box = document.createElement("div");
    box.className = "panel";
    box.tabIndex = 0;
    box.setAttribute("role", "group");
    box.setAttribute("aria-label", `${panel.title}; its metrics are in the table. Plus and minus zoom, the arrow keys move, and 0 shows the whole run`);
    gestures(box, this);
    if (panel.note) title.append(Object.assign(document.createElement("small"), { textContent: ` (${panel.note})` }));
    if (panel.whole) figure.className = "whole";
    figure.append(title, box, legendOf(panel, theme));
    this.root.append(figure);
    return box;
  }

  plotted(panel, theme, box) {
    const series = [{ label: "t, s" }];
    const bands = [];
    for (const one of panel.series) {
      const style = {
        stroke: inked(theme, one.colour), dash: one.dash || undefined, width: one.width ?? 1.4, points: { show: false }, spanGaps: true,
      };
      series.push({ label: one.label || "", ...style });
      if (one.high) {
        bands.push({ series: [series.length - 1, series.length], fill: `${inked(theme, one.colour)}55` });
        series.push({ label: "", ...style });
      }
    }
    const axis = { stroke: theme.ink, grid: { stroke: theme.rule, width: 1 }, ticks: { stroke: theme.rule } };
    const scale = scaleOf(panel);
    const splits = { 3: decades, 4: signedDecades }[scale.distr];
    const values = (_, at) => at.map((v) => (v === 0 ? "0" : v.toExponential(0)));
    const byDecades = { splits, filter: (_, at) => at, values };
    const along = this.overFrequency ? { ...axis, splits: decades, filter: (_, at) => at, values } : axis;
    return new uPlot({
      width: Math.max(box.clientWidth, 200), height: HEIGHT, legend: { show: false },
      scales: { x: { time: false, distr: this.overFrequency ? 3 : 1 }, y: scale },
      axes: [{ ...along, ...(panel.x ? { label: panel.x, size: 32, labelSize: 16, labelGap: 0 } : {}) }, { ...axis, size: 64, label: panel.y, labelSize: 20, ...(splits ? byDecades : {}) }], cursor: { drag: { x: true, y: false } }, series, bands,
      hooks: { setScale: [(self, key) => key === "x" && this.zoomed(self)] },
    }, columnsOf(panel), box);
  }

  // Called after a zoom by dragging, or after a double click, which shows the whole run.
  zoomed(from) {
    if (this.zooming) return;
    const { min, max } = from.scales.x;
    if (min !== null && max !== null) this.zoom(...this.along([min, max]));
  }

  // Converts between values on the axis and positions along it (logarithms over frequency).
  along(ends) {
    return this.overFrequency ? ends.map(Math.log10) : ends;
  }

  back(ends) {
    return this.overFrequency ? ends.map((end) => 10 ** end) : ends;
  }

  // The ends of the whole run.
  ends() {
    const whole = this.plots[0]?.data[0];
    return whole?.length ? this.along([whole[0], whole[whole.length - 1]]) : null;
  }

  // Shows this interval, limited to the run, in all panels.
  zoom(min, max) {
    const ends = this.ends();
    if (!ends || !(max > min)) return;
    const [low, high] = [Math.max(min, ends[0]), Math.min(max, ends[1])];
    if (!(high > low)) return;
    this.window = low <= ends[0] && high >= ends[1] ? null : [low, high];
    const [from, to] = this.back([low, high]);
    this.zooming = true;
    for (const plot of this.plots) plot.batch(() => plot.setScale("x", { min: from, max: to }));
    this.zooming = false;
    this.onZoom(low, high);
  }

  told() {
    const ends = this.ends();
    if (ends) this.onZoom(...ends); // a run that diverges within its first recorded interval has no instants to show
  }

  // The interval that the panels show.
  shown() {
    return this.window ?? this.ends() ?? [0, 1];
  }

  whole() {
    const ends = this.ends();
    if (ends) this.zoom(...ends);
  }

  resized() {
    for (const plot of this.plots) plot.setSize({ width: Math.max(plot.root.parentElement.clientWidth, 200), height: HEIGHT });
  }
}
