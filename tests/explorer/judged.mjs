// Simulates a page's controllers outside of a browser, and prints what the page says of each, as JSON.
//   node judged.mjs TEMPLATES DATA.json

import { readFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

globalThis.self = {}; // a worker's own name for itself
const [, , templates, file] = process.argv;
const from = (name) => import(pathToFileURL(`${templates}/${name}`).href);
const [{ readData, caseSetting, taskOf }, { simulated }] = await Promise.all(["setting.js", "worker.js"].map(from));
const data = readData(readFileSync(file, "utf8"));
const setting = caseSetting(data);
const found = data.controllers.map(({ name, shape, judge }, i) => {
  const { numerics, verdict, figures, starts, recorded, milliseconds } = simulated(taskOf(data, setting, i));
  const [own, size] = [shape.states - judge.begins.length, shape.states + shape.accumulators]; // between them the judge's rows
  const finite = recorded.every((value, k) => Number.isFinite(value) || (k % size >= own && k % size < shape.states));
  return [name, { numerics, verdict, figures, instants: starts.length, finite, milliseconds }];
});
process.stdout.write(JSON.stringify(Object.fromEntries(found)));
