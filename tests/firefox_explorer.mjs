// Opens pages in Firefox by WebDriver BiDi, moves every slider, and prints of each setting what the page shows, as JSON.
//   node firefox_explorer.mjs FIREFOX PAGE ...        with puppeteer-core where it is looked for

import puppeteer from "puppeteer-core";

const [executablePath, ...pages] = process.argv.slice(2);
const SETTINGS = 3;

const browser = await puppeteer.launch({ browser: "firefox", executablePath, headless: true });
const told = [];
for (const page of pages) {
  const tab = await browser.newPage();
  const said = [];
  tab.on("console", (message) => said.push(`console: ${message.text()}`));
  tab.on("pageerror", (error) => said.push(`error: ${error.message}`));
  await tab.goto(page);
  for (let k = 0; k <= SETTINGS; k++) {
    if (k > 0) await tab.evaluate(moved, k);
    await tab.waitForFunction(() => document.body.dataset.state === "ready" && document.querySelector("#figures tr"), { timeout: 120000 });
    told.push({ page, said: said.splice(0), ...await tab.evaluate(shown) });
  }
  await tab.close();
}
await browser.close();
console.log(JSON.stringify(told));

// Every slider, some to the right and some to the left.
function moved(k) {
  document.querySelectorAll("#controls input[type=range]").forEach((slider, i) => {
    slider.value = Number(slider.value) + ((i + k) % 2 ? 1 : -1) * Math.ceil(0.05 * Number(slider.max));
    slider.dispatchEvent(new Event("input"));
  });
}

function shown() {
  document.querySelector("#case-file").click();
  const text = document.querySelector("#copied").value;
  document.querySelector("#close").click();
  const rows = [...document.querySelectorAll("#figures tr")];
  return { text, figures: Object.fromEntries(rows.map((row) => [row.cells[0].textContent, JSON.parse(row.dataset.figures)])) };
}
