// Makes a slider and a field for each number, and switches for the other settings. All are labelled form controls.

import { delayRefusal, exclusion, gridRefusal, refusal, taken } from "./setting.js";

function made(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  element.append(...children);
  return element;
}

function nearest(values, value) {
  let best = 0;
  values.forEach((one, i) => { if (Math.abs(one - value) < Math.abs(values[best] - value)) best = i; });
  return best;
}

// The positions of the slider are the given values, which are spaced evenly or logarithmically.
function row(id, label, values, read, offer) {
  const slider = made("input", { type: "range", id: `${id}-slider`, min: 0, max: values.length - 1, step: 1, "aria-label": label });
  const field = made("input", { type: "text", inputmode: "decimal", id, autocomplete: "off", "aria-describedby": `${id}-said` });
  const said = made("p", { id: `${id}-said`, class: "said", role: "status" });
  const show = () => {
    const value = read();
    slider.value = nearest(values, value);
    slider.setAttribute("aria-valuetext", String(value));
    field.value = String(value);
    field.removeAttribute("aria-invalid");
    said.textContent = "";
  };
  const give = (value) => {
    const sentence = offer(value);
    if (!sentence) show();
    else said.textContent = sentence;
    return !sentence;
  };
  slider.addEventListener("input", () => { if (!give(values[Number(slider.value)])) slider.value = nearest(values, read()); });
  field.addEventListener("change", () => {
    if (!give(field.value.trim() === "" ? NaN : Number(field.value.trim().replace(",", ".")))) field.setAttribute("aria-invalid", "true");
  });
  show();
  return { element: made("div", { class: "number" }, made("label", { for: id }, label), field, slider, said), show };
}

function choice(id, label, choices, read, offer) {
  const select = made("select", { id }, ...choices.map(([value, text]) => made("option", { value }, text)));
  select.addEventListener("change", () => offer(select.value));
  const show = () => { select.value = read(); };
  show();
  return { element: made("div", { class: "choice" }, made("label", { for: id }, label), select), show };
}

function tick(id, label, read, offer) {
  const box = made("input", { type: "checkbox", id });
  box.addEventListener("change", () => offer(box.checked));
  const show = () => { box.checked = read(); };
  show();
  return { element: made("div", { class: "tick" }, box, made("label", { for: id }, label)), show };
}

function gridValues(data, setting) {
  const { grids } = data.signals;
  if (grids) {
    const of = (key, other) => grids.filter((grid) => grid[other] === data.simulation[other]).map((grid) => grid[key]).sort((a, b) => a - b);
    return { dt: of("dt", "t_end"), tEnd: of("t_end", "dt") };
  }
  const { t_end: tEnd, dt } = data.simulation;
  const steps = [0.1, 0.2, 0.25, 0.5, 1, 2, 2.5, 4, 5, 8, 10, 20, 25, 40, 50, 100].map((f) => Number((f * dt).toPrecision(12)));
  const ends = [0.05, 0.1, 0.2, 0.25, 0.5, 0.75, 1, 1.5, 2, 3, 4, 5].map((f) => Number((f * tEnd).toPrecision(12)));
  return { dt: steps.filter((one) => !gridRefusal(data, tEnd, one, setting)), tEnd: ends.filter((one) => !gridRefusal(data, one, dt, setting)) };
}

// Delays from a tenth of the case's own delay to ten times that delay, but none shorter than the case's step.
function delayValues(data) {
  const { delay, simulation: { dt } } = data;
  const found = [];
  for (let k = -20; k <= 20; k++) {
    const one = k === 0 ? delay.value : Number((delay.value * 10 ** (k / 20)).toPrecision(2));
    if (one >= dt && one !== found[found.length - 1]) found.push(one);
  }
  return found;
}

// Fewer points are recorded while a slider is held. The full record is made when it is released.
function holding(root, setting, changed) {
  root.addEventListener("pointerdown", (event) => { setting.held = event.target.type === "range"; });
  for (const name of ["pointerup", "pointercancel"]) {
    addEventListener(name, () => {
      if (!setting.held) return;
      setting.held = false;
      changed();
    });
  }
}

// Builds the controls. changed() is called after every change of the setting.
export function built(root, data, setting, changed) {
  holding(root, setting, changed);
  const groups = new Map();
  const all = [];
  const add = (name, part) => {
    if (!groups.has(name)) groups.set(name, []);
    groups.get(name).push(part.element);
    all.push(part);
  };
  data.controllers.forEach((controller, i) => {
    add(controller.name, tick(`shown-${i}`, `simulate ${controller.name}`, () => setting.shown[i], (on) => { setting.shown[i] = on; changed(); }));
    if (Object.keys(controller.variants).length > 1) {
      const offer = (on) => { setting.projection[i] = on ? "on" : "off"; changed(); };
      add(controller.name, tick(`projection-${i}`, "projection", () => setting.projection[i] === "on", offer));
    }
  });
  data.numbers.forEach((number, i) => {
    const offer = (value) => {
      const sentence = refusal(number, value) || exclusion(data, setting, i, value);
      if (sentence) return sentence;
      setting.values[i] = taken(number, value);
      changed();
      return "";
    };
    add(number.group, row(`number-${i}`, number.label, Array.from(number.values), () => setting.values[i], offer));
  });
  if (data.delay && data.delay.slider) {
    const offer = (value) => {
      const sentence = delayRefusal(data, setting, value);
      if (sentence) return sentence;
      setting.delay = value;
      changed();
      return "";
    };
    add("Plant", row("delay", "delay at the plant's input, s", delayValues(data), () => setting.delay, offer));
  }
  const values = gridValues(data, setting);
  for (const [key, label] of [["tEnd", "horizon, s"], ["dt", "step h, s"]]) {
    if (values[key].length < 2) continue;
    const offer = (value) => {
      const next = { tEnd: setting.tEnd, dt: setting.dt, [key]: value };
      const sentence = gridRefusal(data, next.tEnd, next.dt, setting);
      if (sentence) return sentence;
      setting[key] = value;
      changed();
      return "";
    };
    add("Simulation", row(key, label, values[key], () => setting[key], offer));
  }
  const solvers = Object.keys(data.solvers).map((name) => [name, name]);
  add("Simulation", choice("solver", "solver", solvers, () => setting.solver, (name) => { setting.solver = name; changed(); }));
  let place = 0;
  for (const [name, elements] of groups) {
    const wide = matchMedia("(min-width: 761px)").matches;
    const open = wide ? place < data.controllers.length || ["Command", "Simulation"].includes(name) : false;
    const group = made("details", open ? { open: "" } : {}, made("summary", {}, name), ...elements);
    root.append(group);
    place += 1;
  }
  return { show: () => all.forEach((part) => part.show()) };
}
