// Draws the charts of a report, each from the data that follow its element in the page.

/* global uPlot, document, window, getComputedStyle, atob */

import { Charts, colours, inked } from "../../pictures/templates/charts.js";

function arraysOf(texts) {
  return texts.map((text) => {
    const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    return Float64Array.from(new Float32Array(bytes.buffer));
  });
}

const drawn = [];

function overTime(root, { groups, arrays }) {
  const all = arraysOf(arrays);
  for (const panels of groups) {
    const part = root.appendChild(Object.assign(document.createElement("div"), { className: "charts" }));
    const charts = new Charts(part);
    charts.draw(panels.map((panel) => ({
      ...panel,
      series: panel.series.map((one) => ({ ...one, t: all[one.t], low: all[one.low], high: one.high === undefined ? undefined : all[one.high] })),
    })));
    drawn.push(charts);
  }
}

const MARKS = ["circle", "square"]; // at the phase margin's frequency and at the gain margin's frequency

// Draws loop transfer functions L. L itself, S = 1/(1 + L) and T = L/(1 + L) are computed from |L| and the phase of L.
function overFrequency(root, { loops, window: shown, arrays }) {
  const all = arraysOf(arrays);
  const known = loops.map((loop) => {
    const [w, size, phase] = [all[loop.w], all[loop.size], all[loop.phase]];
    const [re, im] = [Math.cos, Math.sin].map((part) => size.map((v, i) => v * part((phase[i] * Math.PI) / 180)));
    const S = re.map((v, i) => 1 / Math.max(Math.hypot(1 + v, im[i]), 1e-300));
    return { ...loop, w, size, phase, re, im, S, T: size.map((v, i) => v * S[i]) };
  });
  const [first, last] = [Math.min(...known.map(({ w }) => w[0])), Math.max(...known.map(({ w }) => w[w.length - 1]))];
  const level = (value) => ({ t: [first, last], low: [value, value], colour: "quiet", dash: [2, 3], width: 1 });
  const lines = (of, dash = null) => known.map((loop) => ({ t: loop.w, low: loop[of], colour: loop.colour, dash: dash ?? loop.dash, width: loop.width }));
  const captions = known.map(({ caption, colour, dash, width }) => ({ t: [first, last], low: [null, null], label: caption, colour, dash, width }));
  const over = (pick, ...names) => pick(...known.flatMap((loop) => names.map((name) => loop[name].reduce((a, b) => pick(a, b)))));
  const [lowest, highest, largest] = [over(Math.min, "phase"), over(Math.max, "phase"), Math.max(1, over(Math.max, "S", "T"))];
  const panels = [
    { title: "|L|", x: "frequency [rad/s]", log: true, whole: true, series: [...lines("size"), level(1), ...captions] },
    { title: "Phase of L [degrees]", x: "frequency [rad/s]", limits: [Math.max(lowest, -720) - 15, Math.min(highest, 360) + 15], series: [...lines("phase"), level(-180)] },
    { title: "|S| (solid) and |T| (dashed)", x: "frequency [rad/s]", log: true, limits: [1e-3, 2 * largest], series: [...lines("S"), ...lines("T", [6, 4]), level(1)] },
  ];
  const charts = new Charts(root, () => {}, true);
  charts.draw(panels);
  panels.slice(0, 2).forEach((_, k) => marked(charts.plots[k], known, (loop, i) => [loop.w[i], k ? loop.phase[i] : loop.size[i]]));
  drawn.push(charts, nyquist(root, known, shown));
}

// Marks the frequencies of the margins whenever the plot is drawn.
function marked(plot, loops, at) {
  (plot.hooks.draw ??= []).push(() => {
    const theme = colours();
    for (const loop of loops) {
      loop.marks.forEach((i, k) => i !== null && mark(plot, ...at(loop, i), MARKS[k], inked(theme, loop.colour)));
    }
  });
  plot.redraw();
}

function mark(plot, x, y, shape, colour) {
  const { ctx, bbox } = plot;
  const [at, over] = [plot.valToPos(x, "x", true), plot.valToPos(y, "y", true)];
  if (!(at >= bbox.left && at <= bbox.left + bbox.width && over >= bbox.top && over <= bbox.top + bbox.height)) return;
  const r = 3.5 * uPlot.pxRatio;
  ctx.fillStyle = colour;
  ctx.beginPath();
  if (shape === "circle") ctx.arc(at, over, r, 0, 2 * Math.PI);
  else ctx.rect(at - r, over - r, 2 * r, 2 * r);
  ctx.fill();
}

// Draws L in the complex plane around -1, with its mirror image (dotted) and the unit circle.
function nyquist(root, loops, [left, right, low, high]) {
  const theme = colours();
  const figure = root.appendChild(document.createElement("figure"));
  figure.append(Object.assign(document.createElement("figcaption"), { textContent: "Nyquist: L around −1, Im L over Re L" }));
  const box = figure.appendChild(Object.assign(document.createElement("div"), { className: "panel square" }));
  const size = () => ({ width: Math.max(box.clientWidth, 200), height: Math.max(box.clientWidth, 200) });
  const axis = { stroke: theme.ink, grid: { stroke: theme.rule, width: 1 }, ticks: { stroke: theme.rule } };
  const angles = Array.from({ length: 181 }, (_, k) => (k * Math.PI) / 90);
  const draw = (plot) => {
    const { ctx, bbox } = plot;
    const curve = (xs, ys, colour, width, dash) => {
      ctx.strokeStyle = colour;
      ctx.lineWidth = width * uPlot.pxRatio;
      ctx.setLineDash((dash || []).map((v) => v * uPlot.pxRatio));
      ctx.beginPath();
      xs.forEach((x, i) => ctx.lineTo(...[plot.valToPos(x, "x", true), plot.valToPos(ys[i], "y", true)].map((v) => Math.max(-1e6, Math.min(1e6, v)))));
      ctx.stroke();
    };
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    curve(angles.map(Math.cos), angles.map(Math.sin), theme.quiet, 1, [2, 3]);
    for (const [dx, dy] of [[0.08, 0], [0, 0.08]]) curve([-1 - dx, -1 + dx], [-dy, dy], theme.ink, 1.6);
    for (const loop of loops) {
      curve(loop.re, loop.im, inked(theme, loop.colour), loop.width, loop.dash);
      curve(loop.re, loop.im.map((v) => -v), inked(theme, loop.colour), 0.8, [2, 3]);
      loop.marks.forEach((i, k) => i !== null && mark(plot, loop.re[i], loop.im[i], MARKS[k], inked(theme, loop.colour)));
    }
    ctx.restore();
  };
  const plot = new uPlot({
    ...size(), legend: { show: false }, cursor: { show: false }, series: [{}, { show: false }], axes: [axis, axis],
    scales: { x: { time: false, range: () => [left, right] }, y: { range: () => [low, high] } }, hooks: { draw: [draw] },
  }, [[left, right], [null, null]], box);
  return { resized: () => plot.setSize(size()) };
}

for (const root of document.querySelectorAll(".charts[data-kind]")) {
  const data = JSON.parse(root.nextElementSibling.textContent);
  if (root.dataset.kind === "time") { root.className = ""; overTime(root, data); } else overFrequency(root, data);
}
window.addEventListener("resize", () => { for (const one of drawn) one.resized(); });
