// As a new user would, in the bundled demonstration: `node walk.mjs PROGRAM PLACE [FOLDER]`. From the list of sites by clicks to the hidden effect of
// the site that the list names first, one more click adds it; then P and Q of the model have to lie on the measurement. Every page on the way is kept in several sizes and colours in
// `shots`; with FOLDER the pictures of the README are put there. Ends with 1 when a check fails.
import { mkdirSync, statSync } from "node:fs";
import { join } from "node:path";
import { chromium } from "playwright-core";
import { demonstrate } from "./daemon.mjs";

const [program, place, folder] = process.argv.slice(2);
const shots = process.env.LOADMODELD_SHOTS ?? "shots", asked = process.env.LOADMODELD_WALK_SITE;
const CLICKS_MAX = 5, PICTURE_BYTES_MAX = 200000, PICTURE_WIDTH = 1040;
// Beyond what any machine takes for the fits and diagnoses of the demonstration.
const LIMIT_MS = 1200000;
const VIEWS = {
  "1280-light": { viewport: { width: 1280, height: 900 }, colorScheme: "light" },
  "1920-dark": { viewport: { width: 1920, height: 1080 }, colorScheme: "dark" },
  "phone-light": { viewport: { width: 390, height: 844 }, colorScheme: "light", isMobile: true, deviceScaleFactor: 2 },
  "phone-dark": { viewport: { width: 390, height: 844 }, colorScheme: "dark", isMobile: true, deviceScaleFactor: 2 },
};

let failures = 0;
function check(good, what) {
  console.log(`${good ? "ok    " : "FAILED"} ${what}`);
  if (!good) failures += 1;
}

mkdirSync(shots, { recursive: true });
const begun = Date.now(), since = () => `${((Date.now() - begun) / 1000).toFixed(0)} s`;
const { address, stop } = await demonstrate(program, place);
const json = async (path) => { const answer = await fetch(address + path); return answer.ok ? answer.json() : null; };
let site = asked;
const of = (rest) => `/sites/${site}/${rest}`;
async function until(what, ready) {
  for (const end = Date.now() + LIMIT_MS; Date.now() < end; await new Promise((resolve) => setTimeout(resolve, 500))) {
    const found = await ready();
    if (found) { console.log(`      ${what} after ${since()}`); return found; }
  }
  throw new Error(`${what} did not come within ${LIMIT_MS / 1000} s`);
}

const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync"],
});
const contexts = Object.fromEntries(await Promise.all(Object.entries(VIEWS).map(async ([name, view]) => [name, await browser.newContext(view)])));
const complaints = [];

const drawn = (page) => page.waitForFunction(() => [...document.querySelectorAll("figure.chart[data-source]")].every((figure) => figure.dataset.ready));

// The address in every size and colour.
let number = 0;
async function look(name, url) {
  number += 1;
  for (const [view, context] of Object.entries(contexts)) {
    const page = await context.newPage();
    await page.goto(url, { waitUntil: "load" });
    await drawn(page);
    await page.screenshot({ path: join(shots, `walk-${number}-${name}-${view}.png`), fullPage: true });
    await page.close();
  }
}

// The page from its head to the end of one chart.
async function picture(page, chart, name) {
  if (!folder) return;
  await drawn(page);
  await page.evaluate(() => document.activeElement?.blur());
  const end = await page.locator(chart).evaluate((figure) => figure.getBoundingClientRect().bottom + scrollY);
  const path = join(folder, name);
  await page.screenshot({ path, fullPage: true, clip: { x: 0, y: 0, width: PICTURE_WIDTH, height: Math.ceil(end) + 12 } });
  const { size } = statSync(path);
  check(size < PICTURE_BYTES_MAX, `${name} has ${Math.round(size / 1000)} kB of ${PICTURE_BYTES_MAX / 1000}`);
}

async function walk() {
  await until("the first jobs", async () => (await json("/sites.json"))?.sites.length > 0);
  await look("sites-at-work", `${address}/`);
  await until("a diagnosis of every site", async () => { const list = await json("/sites.json"); return list?.sites.every((row) => row.diagnosis); });

  const page = await contexts["1280-light"].newPage();
  page.on("console", (message) => { if (["error", "warning"].includes(message.type())) complaints.push(message.text()); });
  page.on("pageerror", (error) => complaints.push(error.message));
  await page.goto(`${address}/`);
  let clicks = 0;
  const click = async (name, locator) => { clicks += 1; await Promise.all([page.waitForEvent("load"), locator.click()]); await look(name, page.url()); };
  await look("sites", page.url());
  const lead = page.locator("p.lead", { hasText: "Where to look first" });
  console.log(`      ${await lead.innerText()}`);
  await click("diagnosis", lead.getByRole("link", asked ? { name: new RegExp(`^${asked} lacks`) } : {}).first());
  site = /sites\/([^/]+)\/diagnosis/.exec(page.url())[1];
  const { diagnosis } = await json(of("diagnosis.json")), [effect] = diagnosis.answer_set, words = effect.replaceAll("_", " ");
  await drawn(page);
  check(clicks <= CLICKS_MAX && await page.locator(".verdict-sentence").getByText(words).first().isVisible(), `the effect is on the page of ${site} after ${clicks} clicks: ${await page.locator(".verdict-sentence").innerText()}`);
  const { drawn: trial } = await json(of("diagnosis.json"));
  check(trial.effect === effect, `drawn before it is added: ${trial.without.error_to_noise.toFixed(2)} to ${trial.with.error_to_noise.toFixed(2)} times the noise`);
  await click("added", page.getByRole("button", { name: /^Add / }));
  check(page.url() === address + of("structure"), `one more click adds it, without a token: ${page.url()}`);
  await page.waitForFunction((name) => document.querySelector("#staircase")?.textContent.includes(name), `+ ${words}`, { timeout: LIMIT_MS });
  console.log(`      the step is drawn in the open page after ${since()}`);
  const { steps, noise_floor: perfect } = await json(of("structure.json")), [before, after] = steps.slice(-2);
  for (const [name, at] of [["without", before], ["with", after]]) console.log(`      ${name} it on held-out events: P ${at.held_out_eps_p_percent.toFixed(3)} %, Q ${at.held_out_eps_q_percent.toFixed(3)} %, ${at.held_out_error_to_noise.toFixed(2)} times the noise, ${at.held_out_error_to_noise_away_from_edges.toFixed(2)} away from edges`);
  const least = after.held_out_error_to_noise_away_from_edges;
  check(least < 3 * perfect && least < before.held_out_error_to_noise_away_from_edges / 5, `away from edges ${least.toFixed(2)} times the noise are left; a perfect model leaves ${perfect.toFixed(2)}`);
  await look("staircase", page.url());
  const { in_force: version } = await until("the decision", async () => { const sets = await json(of("sets.json")); return sets?.decisions.length > 1 && sets; });
  check(version !== null, `version ${version} is in force`);
  const worst = [...diagnosis.failures].sort((a, b) => b.error_to_noise - a.error_to_noise)[0].event;
  const [plain] = steps, both = `${of(`events/${worst}`)}?with=fit-${plain.fit}`;
  await look("event-with-both", address + both);
  for (const rest of ["events", `events/${worst}`, "solutions", "sets", "sets/1", "diagnosis"]) await look(rest.split("/")[0], address + of(rest));
  check(complaints.length === 0, `no complaint on the way ${complaints.slice(0, 3).join("; ")}`);

  const paper = await browser.newPage({ viewport: { width: PICTURE_WIDTH, height: 900 }, colorScheme: "light" });
  await paper.goto(address + of("structure"));
  await picture(paper, "#before-after", "page-staircase.png");
  await paper.goto(`${address}${of(`events/${worst}`)}?model=fit-${plain.fit}`);
  await picture(paper, "#over-time", "page-event.png");
}

let thrown = null;
try { await walk(); } catch (error) { thrown = error; } finally { await browser.close(); await stop(); }
if (thrown) throw thrown;
console.log(`${failures === 0 ? "every check passed" : `${failures} checks failed`} in ${since()}`);
process.exit(failures === 0 ? 0 : 1);
