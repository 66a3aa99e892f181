// Stores the setting in the page's address, as the differences from the initial setting of the case or of the named lesson.

import { delayRefusal, exclusion, gridRefusal, refusal, taken } from "./setting.js";
import { beginningOf } from "./lessons.js";

export function toHash(data, setting) {
  const initial = beginningOf(data, setting.lesson);
  const said = new URLSearchParams();
  if (setting.lesson) said.set("lesson", setting.lesson);
  data.numbers.forEach((number, i) => { if (setting.values[i] !== initial.values[i]) said.set(number.path, setting.values[i]); });
  for (const key of ["tEnd", "dt", "solver", "delay"]) if (setting[key] !== initial[key]) said.set(key, setting[key]);
  setting.projection.forEach((side, i) => { if (side !== initial.projection[i]) said.set(`projection.${i}`, side); });
  setting.shown.forEach((shown, i) => { if (shown !== initial.shown[i]) said.set(`shown.${i}`, shown ? "1" : "0"); });
  return said.toString();
}

// Values that the link does not contain keep their initial value.
export function fromHash(data, text) {
  const said = new URLSearchParams(text);
  const setting = beginningOf(data, said.get("lesson"));
  data.numbers.forEach((number, i) => {
    const value = said.has(number.path) ? Number(said.get(number.path)) : setting.values[i];
    if (!refusal(number, value) && !exclusion(data, setting, i, value)) setting.values[i] = taken(number, value);
  });
  const [tEnd, dt, delay] = ["tEnd", "dt", "delay"].map((key) => (said.has(key) ? Number(said.get(key)) : setting[key]));
  const late = data.delay && delayRefusal(data, { tEnd, dt }, delay);
  if (!late && !gridRefusal(data, tEnd, dt, { values: setting.values, delay })) Object.assign(setting, { tEnd, dt, delay });
  if (data.solvers[said.get("solver")]) setting.solver = said.get("solver");
  data.controllers.forEach((controller, i) => {
    if (controller.variants[said.get(`projection.${i}`)]) setting.projection[i] = said.get(`projection.${i}`);
    if (said.has(`shown.${i}`)) setting.shown[i] = said.get(`shown.${i}`) === "1";
  });
  return setting;
}
