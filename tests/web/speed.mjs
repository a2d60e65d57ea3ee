// How fast the pages are: `node speed.mjs PROGRAM PLACE`. Not part of the gate: it measures the machine too.
import { execFileSync } from "node:child_process";
import { join } from "node:path";
import { chromium } from "playwright-core";
import { site, start, token } from "./daemon.mjs";

const [program, place] = process.argv.slice(2);
const ROWS = 10000, ROUNDS = 7;
const daemon = await start(program, place);
const { address } = daemon;
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"],
});
const middle = (list) => [...list].sort((a, b) => a - b)[Math.floor(list.length / 2)];
const told = (what, list, limit) => console.log(`${what}: median ${middle(list).toFixed(0)} ms, worst ${Math.max(...list).toFixed(0)} ms of ${limit}`);

// A dip of 0.2 s in 10,000 samples at 60 frames/s, with some noise that is the same every time.
function recording() {
  const lines = ["time_s,v_pu,freq_hz,p_pu,q_pu"];
  let state = 1;
  const noise = () => { state = (state * 48271) % 2147483647; return (state / 2147483647 - 0.5) * 1e-3; };
  for (let k = 0; k < ROWS; k++) {
    const dip = k >= 600 && k < 612 ? 0.3 : 0;
    lines.push([(k / 60).toFixed(4), (1 - dip + noise()).toFixed(5), "60", (0.9 * (1 - dip) + noise()).toFixed(5), (0.3 - dip / 2 + noise()).toFixed(5)].join(","));
  }
  return Buffer.from(lines.join("\n") + "\n");
}

async function until(ready) { while (!(await ready())) await new Promise((resolve) => setTimeout(resolve, 500)); }
async function json(path) { const answer = await fetch(address + path); return answer.ok ? answer.json() : null; }

// Milliseconds from asking to the first contentful paint, and until every chart can be zoomed.
async function paint(context, path) {
  const page = await context.newPage();
  await page.goto(address + path, { waitUntil: "load" });
  await page.waitForFunction(() => [...document.querySelectorAll("figure.chart[data-source]")].every((f) => f.dataset.ready));
  const found = await page.evaluate(() => new Promise((resolve) => {
    const ready = performance.now();
    const look = () => { const [entry] = performance.getEntriesByName("first-contentful-paint"); entry ? resolve([entry.startTime, ready]) : requestAnimationFrame(look); };
    look();
  }));
  return { page, first: found[0], ready: found[1] };
}

async function answers(what, path, limit) {
  const server = [], first = [];
  for (let k = 0; k < ROUNDS; k++) {
    const begin = performance.now();
    await (await fetch(address + path)).text();
    server.push(performance.now() - begin);
    const context = await browser.newContext({ viewport: { width: 1280, height: 900 } });
    first.push((await paint(context, path)).first);
    await context.close();
  }
  told(`${what}, whole answer of the server`, server, limit);
  told(`${what}, first paint`, first, limit);
}

await until(async () => (await json(`/sites/${site}/sets.json`))?.in_force);
await until(async () => (await json(`/sites/${site}/diagnosis.json`))?.diagnosis);
console.log(execFileSync("python3", ["fill.py", join(place, "store.sqlite"), site], { encoding: "utf8" }).trim());
await answers("5,000 events", "/sites/many/events", 300);
await answers("101 sites", "/sites", 300);

const owner = await browser.newContext();
const form = await owner.newPage();
await form.goto(`${address}/session?next=/sites/${site}/recordings`);
await form.getByLabel("Write token").fill(token);
await form.getByRole("button", { name: "Unlock" }).click();
await form.getByLabel("Recording", { exact: true }).waitFor();
const sent = performance.now();
await form.getByLabel("Recording", { exact: true }).setInputFiles({ name: "long.csv", mimeType: "text/csv", buffer: recording() });
await Promise.all([form.waitForURL(/recordings\/recording-/), form.getByRole("button", { name: "Compare with the model" }).click()]);
console.log(`a recording of ${ROWS} samples is sent, read, compared and shown in ${(performance.now() - sent).toFixed(0)} ms`);
const path = new URL(form.url()).pathname;
const cold = [], cached = [], coldReady = [], cachedReady = [], zooms = [];
for (let k = 0; k < ROUNDS; k++) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 } });
  const once = await paint(context, path), again = await paint(context, path);
  cold.push(once.first); coldReady.push(once.ready); cached.push(again.first); cachedReady.push(again.ready);
  zooms.push(...await again.page.evaluate(async () => {
    const buttons = [...document.querySelectorAll("#over-time .tools button")], times = [];
    const plus = buttons.find((b) => b.textContent === "+");
    for (let k = 0; k < 5; k++) {
      const begin = performance.now();
      plus.click();
      await new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve)));
      times.push(performance.now() - begin);
    }
    return times;
  }));
  await context.close();
}
told(`${ROWS} points x 6 series, first paint, nothing cached`, cold, 1500);
told(`${ROWS} points x 6 series, charts can be zoomed, nothing cached`, coldReady, 1500);
told(`${ROWS} points x 6 series, first paint, scripts cached`, cached, 700);
told(`${ROWS} points x 6 series, charts can be zoomed, scripts cached`, cachedReady, 700);
told("zoom until the frame is drawn", zooms, 100);
await browser.close();
await daemon.stop();
process.exit(0);
