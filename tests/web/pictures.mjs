// The pictures of the README, of the bundled demonstration: `node pictures.mjs PROGRAM PLACE FOLDER`. As a reader would: the diagnosis, its effect
// added by the page's button, the staircase; then the event that shows it most.
import { spawn } from "node:child_process";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { chromium } from "playwright-core";

const [program, place, folder] = process.argv.slice(2);
const SITE = "demo", WIDTH = 1100, LIMIT_MS = 900000;

const daemon = spawn(program, ["demo", "--http", "127.0.0.1:0", "--state", join(place, "state")], { stdio: ["ignore", "pipe", "pipe"] });
process.on("exit", () => daemon.kill("SIGKILL"));
for (const signal of ["SIGTERM", "SIGINT"]) process.on(signal, () => process.exit(1));
const address = await new Promise((resolve, reject) => {
  const told = [];
  daemon.on("exit", (code) => reject(new Error(`the demonstration ended with ${code}:\n${told.join("\n")}`)));
  for (const stream of [daemon.stdout, daemon.stderr]) createInterface({ input: stream }).on("line", (line) => {
    told.push(line);
    const found = /http:\/\/127\.0\.0\.1:\d+/.exec(line);
    if (found) resolve(found[0]);
  });
});
const json = async (path) => { const answer = await fetch(address + path); return answer.ok ? answer.json() : null; };
async function until(what, ready) {
  for (const end = Date.now() + LIMIT_MS; Date.now() < end; await new Promise((resolve) => setTimeout(resolve, 1000))) {
    const found = await ready();
    if (found) return found;
  }
  throw new Error(`${what} did not come`);
}

// The page from its head to the end of one chart.
async function take(page, chart, name) {
  await page.waitForFunction(() => [...document.querySelectorAll("figure.chart[data-source]")].every((figure) => figure.dataset.ready));
  await page.evaluate(() => document.activeElement?.blur());
  const end = await page.locator(chart).evaluate((figure) => figure.getBoundingClientRect().bottom + scrollY);
  await page.screenshot({ path: join(folder, name), fullPage: true, clip: { x: 0, y: 0, width: WIDTH, height: Math.ceil(end) + 12 } });
}

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"],
});
const page = await browser.newPage({ viewport: { width: WIDTH, height: 900 }, colorScheme: "light" });
const { diagnosis } = await until("a diagnosis", async () => { const found = await json(`/sites/${SITE}/diagnosis.json`); return found?.diagnosis && found; });
const [effect] = diagnosis.answer_set;
await page.goto(`${address}/sites/${SITE}/diagnosis`);
await page.getByRole("button", { name: /^Add / }).click();
await until("the step", async () => { const steps = (await json(`/sites/${SITE}/structure.json`))?.steps ?? []; return steps.at(-1)?.structure.includes(effect); });
// The plain model may have failed validation: then this is the first version.
await until("the version", async () => (await json(`/sites/${SITE}/sets.json`))?.in_force);
await page.goto(`${address}/sites/${SITE}/structure`);
await take(page, "#before-after", "page-staircase.png");
const [plain] = (await json(`/sites/${SITE}/structure.json`)).steps;
const [worst] = [...diagnosis.failures].sort((a, b) => b.error_to_noise - a.error_to_noise);
await page.goto(`${address}/sites/${SITE}/events/${worst.event}?model=fit-${plain.fit}`);
await take(page, "#over-time", "page-event.png");
await browser.close();
process.exit(0);
