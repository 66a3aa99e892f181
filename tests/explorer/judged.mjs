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
const found = data.controllers.map(({ name }, i) => {
  const { numerics, runaway, figures, starts, recorded, milliseconds } = simulated(taskOf(data, setting, i));
  return [name, { numerics, runaway, figures, instants: starts.length, finite: recorded.every(Number.isFinite), milliseconds }];
});
process.stdout.write(JSON.stringify(Object.fromEntries(found)));
