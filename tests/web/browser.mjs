// The pages in Chromium: `node browser.mjs ADDRESS SITE`. Ends with 1 when a check fails.
import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import { chromium } from "playwright-core";

const [address, site] = process.argv.slice(2);
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
// The demo fits and diagnoses meanwhile; nothing else here waits longer than a page takes.
const WORK_LIMIT_MS = Number(process.env.LOADMODELD_WORK_LIMIT_S ?? 1500) * 1000;
const VIEWS = {
  "1280-light": { viewport: { width: 1280, height: 900 }, colorScheme: "light" },
  "1920-dark": { viewport: { width: 1920, height: 1080 }, colorScheme: "dark" },
  "phone-light": { viewport: { width: 390, height: 844 }, colorScheme: "light", isMobile: true },
  "phone-dark": { viewport: { width: 390, height: 844 }, colorScheme: "dark", isMobile: true },
};

let failures = 0;
function check(good, what) {
  console.log(`${good ? "ok    " : "FAILED"} ${what}`);
  if (!good) failures += 1;
}

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync"],
});

// Everything a page complains of or asks others for.
function watch(context) {
  const complaints = [];
  context.on("page", (page) => {
    page.on("console", (message) => {
      if (["error", "warning"].includes(message.type())) complaints.push(`${page.url()}: ${message.text()}`);
    });
    page.on("pageerror", (error) => complaints.push(`${page.url()}: ${error.message}`));
    page.on("request", (request) => {
      const url = request.url();
      if (!url.startsWith(address) && !url.startsWith("data:") && !url.startsWith("blob:")) complaints.push(`asked ${url}`);
    });
  });
  return complaints;
}

async function json(path) {
  const answer = await fetch(address + path);
  return answer.ok ? answer.json() : null;
}

async function until(what, ready) {
  const end = Date.now() + WORK_LIMIT_MS;
  while (Date.now() < end) {
    const found = await ready();
    if (found) return found;
    await new Promise((resolve) => setTimeout(resolve, 1000));
  }
  throw new Error(`${what} did not come within ${WORK_LIMIT_MS / 1000} s`);
}

// Joint fit and diagnosis are there: the rest needs no waiting.
async function settled() {
  await until("a joint fit", async () => (await json(`/sites/${site}/structure.json`))?.steps.length > 0);
  await until("a diagnosis", async () => (await json(`/sites/${site}/diagnosis.json`))?.diagnosis);
}

async function deepest() {
  const { events } = await json(`/sites/${site}/events.json`);
  const depth = (row) => row.event.lowest_voltage_pu ?? 9;
  return events.sort((a, b) => depth(a) - depth(b))[0].event.event;
}

async function everyScreen(paths) {
  for (const [view, settings] of Object.entries(VIEWS)) {
    const context = await browser.newContext(settings), complaints = watch(context);
    for (const [name, path] of Object.entries(paths)) {
      const page = await context.newPage();
      const answer = await page.goto(address + path, { waitUntil: "load" });
      check(answer.status() === 200, `${name} ${view} is there`);
      await charts(page);
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      check(wide <= 0, `${name} ${view} is not wider than the window (${wide} px)`);
      await page.screenshot({ path: `shots/${name}-${view}.png`, fullPage: true });
      await page.close();
    }
    check(complaints.length === 0, `${view}: no error, no breach of the policy, nothing from elsewhere ${complaints.slice(0, 3).join("; ")}`);
    await context.close();
  }
}

async function charts(page) {
  await page.waitForFunction(() => [...document.querySelectorAll("figure.chart[data-source]")].every((f) => f.dataset.ready), null, { timeout: 15000 });
}

async function accessible(paths) {
  for (const scheme of ["light", "dark"]) {
    const context = await browser.newContext({ bypassCSP: true, colorScheme: scheme, viewport: { width: 1280, height: 900 } });
    for (const [name, path] of Object.entries(paths)) {
      const page = await context.newPage();
      await page.goto(address + path, { waitUntil: "load" });
      await charts(page);
      await page.evaluate(axe);
      const { violations } = await page.evaluate(() => window.axe.run());
      const told = violations.map((v) => `${v.id} (${v.nodes.length}): ${v.nodes[0].target}`);
      check(violations.length === 0, `${name} ${scheme} is accessible ${told.join("; ")}`);
      await page.close();
    }
    await context.close();
  }
}

async function withoutScripts(paths) {
  const context = await browser.newContext({ javaScriptEnabled: false, viewport: { width: 1280, height: 900 } });
  for (const [name, path] of Object.entries(paths)) {
    const page = await context.newPage();
    await page.goto(address + path, { waitUntil: "load" });
    const text = await page.locator("main").innerText();
    check(text.length > 100, `${name} tells its content without scripts`);
    if (name === "event") {
      const box = await page.locator("figure.chart svg").first().boundingBox();
      check(box !== null && box.height > 200, "the event is drawn without scripts");
      await page.screenshot({ path: "shots/event-without-scripts.png", fullPage: true });
    }
    await page.close();
  }
  await context.close();
}

async function zoom(path) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 } });
  const page = await context.newPage();
  await page.goto(address + path, { waitUntil: "load" });
  await charts(page);
  const whole = page.url();
  const canvas = page.locator("#over-time canvas").first();
  await canvas.scrollIntoViewIfNeeded();
  const box = await canvas.boundingBox();
  await page.mouse.move(box.x + 150, box.y + 60);
  await page.mouse.down();
  await page.mouse.move(box.x + 320, box.y + 60, { steps: 4 });
  await page.mouse.up();
  check(page.url().includes("#time="), "a stretch drawn by the mouse is shown, and the address says so");
  const readout = page.locator("#over-time .readout");
  await page.mouse.move(box.x + 400, box.y + 60);
  check(await readout.isVisible(), "values are told under the pointer");
  await page.locator("#over-time .plot").focus();
  await page.keyboard.press("0");
  check(page.url() === whole, "the key 0 shows everything again");
  await page.keyboard.press("+");
  check(page.url().includes("#time="), "the key + zooms");
  const spent = await page.evaluate(() => {
    const button = [...document.querySelectorAll("#over-time .tools button")].find((b) => b.textContent === "+");
    const times = [];
    for (let k = 0; k < 5; k++) { const begin = performance.now(); button.click(); times.push(performance.now() - begin); }
    return Math.max(...times);
  });
  check(spent < 100, `zooming takes ${spent.toFixed(0)} ms of 100`);
  await context.close();
}

// As a new user would: from the list of sites, by clicks.
async function addTheEffect() {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 } });
  const complaints = watch(context);
  const page = await context.newPage();
  await page.goto(`${address}/`);
  let clicks = 0;
  const click = async (locator) => { clicks += 1; await locator.click(); await page.waitForLoadState("load"); };
  await click(page.getByRole("link", { name: site, exact: true }));
  await click(page.getByRole("link", { name: "Diagnosis", exact: true }));
  const answers = (await json(`/sites/${site}/diagnosis.json`)).diagnosis.answer_set;
  check(answers.length > 0, `the diagnosis names ${answers.join(", ")}`);
  if (answers.length === 0) return context.close();
  check(clicks <= 5, `the effect is found with ${clicks} clicks`);
  await click(page.getByRole("button", { name: /^Add .* to the model$/ }));
  check(page.url().includes("/structure"), "one more adds it and shows the staircase");
  await until("the fit with it", async () => {
    const { steps } = await json(`/sites/${site}/structure.json`);
    return steps.at(-1).structure.includes(answers[0]);
  });
  await page.waitForFunction((name) => document.querySelector("#staircase")?.textContent.includes(name), `+ ${answers[0].replaceAll("_", " ")}`, { timeout: 15000 });
  check(true, "the staircase shows the step without a reload");
  const { steps } = await json(`/sites/${site}/structure.json`);
  const [before, after] = [steps.at(-2), steps.at(-1)].map((s) => s.held_out_error_to_noise ?? s.error_to_noise);
  check(after < 0.5 * before, `the error over noise falls from ${before.toFixed(1)} to ${after.toFixed(1)}`);
  await page.screenshot({ path: "shots/staircase.png", fullPage: true });
  check(complaints.length === 0, `no complaint on the way ${complaints.slice(0, 3).join("; ")}`);
  await context.close();
}

await settled();
const event = await deepest();
const of = (rest) => `/sites/${site}/${rest}`;
const { events } = await json(of("events.json"));
const paths = {
  sites: "/sites", events: of("events"), event: of(`events/${event}`),
  compare: of(`compare?event=${events[0].event.event}&event=${events[1].event.event}`),
  diagnosis: of("diagnosis"), structure: of("structure"), solutions: of("solutions"), sets: of("sets"), health: "/health",
};
await everyScreen(paths);
await accessible(paths);
await withoutScripts(paths);
await zoom(paths.event);
await addTheEffect();
await browser.close();
console.log(failures === 0 ? "every check passed" : `${failures} checks failed`);
process.exit(failures === 0 ? 0 : 1);
