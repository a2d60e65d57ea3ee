// The pages in Chromium: `node browser.mjs PROGRAM PLACE`. Ends with 1 when a check fails.
import { createRequire } from "node:module";
import { readFileSync, mkdirSync } from "node:fs";
import { request } from "node:http";
import { join } from "node:path";
import { chromium } from "playwright-core";
import { effect, site, start, token } from "./daemon.mjs";

const [program, place] = process.argv.slice(2);
const shots = process.env.LOADMODELD_SHOTS ?? "shots";
const axe = readFileSync(createRequire(import.meta.url).resolve("axe-core/axe.min.js"), "utf8");
// Fits and diagnoses of the generated site take seconds on a free machine; nothing else here waits longer than a page takes.
const WORK_LIMIT_MS = Number(process.env.LOADMODELD_WORK_LIMIT_S ?? 600) * 1000;
// Of what ends sooner a page may show nothing but the end.
const NEWS_MS = 10_000;
const PAGE_LIMIT_MS = 30000;
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

mkdirSync(shots, { recursive: true });
const begun = Date.now();
const daemon = await start(program, place, { approval: true });
const { address } = daemon;
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync"],
});
const of = (rest) => `/sites/${site}/${rest}`;

// Everything a page complains of or asks others for.
function watch(context) {
  const complaints = [];
  context.on("page", (page) => {
    page.on("console", (message) => {
      // Chromium notes that a page was refused, which is what was asked for.
      if (["error", "warning"].includes(message.type()) && !message.location().url.endsWith("/events/nothing")) complaints.push(`${page.url()}: ${message.text()} (${message.location().url})`);
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

// A click, and the page that it leads to. Waiting for a load after the click may find the page before loaded.
async function follow(page, locator) {
  await Promise.all([page.waitForEvent("load"), locator.click()]);
}

// The same for a form's button: what the form's POST was answered with.
async function press(page, button) {
  const [answer] = await Promise.all([
    page.waitForResponse((answer) => answer.request().method() === "POST"),
    follow(page, button),
  ]);
  return answer;
}

async function until(what, ready) {
  const end = Date.now() + WORK_LIMIT_MS;
  while (Date.now() < end) {
    const found = await ready();
    if (found) return found;
    await new Promise((resolve) => setTimeout(resolve, 500));
  }
  throw new Error(`${what} did not come within ${WORK_LIMIT_MS / 1000} s; the daemon said:\n${daemon.log.slice(-20).join("\n")}`);
}

async function visit(context, path) {
  const page = await context.newPage();
  const answer = await page.goto(address + path, { waitUntil: "load" });
  await charts(page);
  return { page, answer };
}

async function charts(page) {
  await page.waitForFunction(() => [...document.querySelectorAll("figure.chart[data-source]")].every((f) => f.dataset.ready), null, { timeout: PAGE_LIMIT_MS });
}

async function everyScreen(paths) {
  for (const [view, settings] of Object.entries(VIEWS)) {
    const context = await browser.newContext(settings), complaints = watch(context);
    for (const [name, path] of Object.entries(paths)) {
      const { page, answer } = await visit(context, path);
      check(answer.status() === (name === "refused" ? 404 : 200), `${name} ${view} is there`);
      const wide = await page.evaluate(() => document.documentElement.scrollWidth - document.documentElement.clientWidth);
      check(wide <= 0, `${name} ${view} is not wider than the window (${wide} px)`);
      await page.screenshot({ path: join(shots, `${name}-${view}.png`), fullPage: true });
      await page.close();
    }
    check(complaints.length === 0, `${view}: no error, no breach of the policy, nothing from elsewhere ${complaints.slice(0, 3).join("; ")}`);
    await context.close();
  }
}

async function accessible(paths) {
  for (const scheme of ["light", "dark"]) {
    const context = await browser.newContext({ bypassCSP: true, colorScheme: scheme, viewport: { width: 1280, height: 900 } });
    for (const [name, path] of Object.entries(paths)) {
      const { page } = await visit(context, path);
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
    check(text.length > (name === "refused" ? 40 : 100), `${name} tells its content without scripts`);
    if (name === "event") {
      const box = await page.locator("figure.chart svg").first().boundingBox();
      check(box !== null && box.height > 200, "the event is drawn without scripts");
      await page.screenshot({ path: join(shots, "event-without-scripts.png"), fullPage: true });
    }
    await page.close();
  }
  await context.close();
}

// Both twins of every view, numbers behind every chart, and all that can be used within reach of the key Tab.
async function complete(paths) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 } });
  for (const [name, path] of Object.entries(paths)) {
    if (name === "refused") continue;
    const [bare, query] = path.split("?");
    if (name !== "session") for (const [ending, type] of [[".json", "application/json"], [".csv", "text/csv"]]) {
      const answer = await fetch(address + bare + ending + (query ? `?${query}` : ""));
      check(answer.status === 200 && answer.headers.get("content-type").startsWith(type), `${name} has a twin ${ending}`);
    }
    const { page } = await visit(context, path);
    const [drawn, untold] = await page.evaluate(() => {
      const figures = [...document.querySelectorAll("figure.chart")];
      return [figures.length, figures.filter((figure) => !figure.querySelector("details table tbody tr td")).map((figure) => figure.id)];
    });
    check(untold.length === 0, `${name}: a table of numbers behind each of ${drawn} charts ${untold.join(", ")}`);
    const wanted = await page.evaluate(() => {
      const all = [...document.querySelectorAll("a[href], button, input, select, textarea, summary, [tabindex='0']")].filter((e) => e.checkVisibility() && !e.disabled && e.type !== "hidden");
      all.forEach((element, k) => { element.dataset.stop = k; });
      return all.length;
    });
    const reached = new Set();
    for (let k = 0; k < wanted + 20 && reached.size < wanted; k++) {
      await page.keyboard.press("Tab");
      reached.add(await page.evaluate(() => document.activeElement?.dataset.stop ?? null));
      reached.delete(null);
    }
    check(reached.size === wanted, `${name}: the key Tab reaches ${reached.size} of ${wanted}`);
    await page.close();
  }
  await context.close();
}

// Whether it becomes true within the time that a page may take: the browser acts on input in its own time.
async function holds(page, condition, argument) {
  return page.waitForFunction(condition, argument, { timeout: PAGE_LIMIT_MS }).then(() => true, () => false);
}

// Both charts over time show the same stretch, whatever changed it.
async function zoom(path) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 } });
  const { page } = await visit(context, path);
  const canvas = page.locator("#over-time canvas").first();
  await canvas.scrollIntoViewIfNeeded();
  const box = await canvas.boundingBox();
  const before = await page.evaluate(() => document.querySelector("#over-time canvas").toDataURL());
  await page.mouse.move(box.x + 150, box.y + 60);
  await page.mouse.down();
  await page.mouse.move(box.x + 320, box.y + 60, { steps: 4 });
  await page.mouse.up();
  check(await holds(page, () => location.hash.startsWith("#time=")), "a stretch drawn by the mouse is shown, and the address says so");
  check(await holds(page, (earlier) => document.querySelector("#over-time canvas").toDataURL() !== earlier, before), "all panels are drawn anew");
  await page.mouse.move(box.x + 400, box.y + 60);
  check(await page.locator("#over-time .readout").isVisible(), "values are told under the pointer");
  const hash = await page.evaluate(() => location.hash);
  const { page: again } = await visit(context, path + hash);
  check(await holds(again, (stretch) => location.hash === stretch, hash), "the address shows the same stretch again");
  await page.bringToFront();
  await page.locator("#over-time .plot").focus();
  await page.keyboard.press("0");
  check(await holds(page, () => location.hash === ""), "the key 0 shows everything again");
  await page.keyboard.press("+");
  check(await holds(page, () => location.hash.startsWith("#time=")), "the key + zooms");
  await context.close();
}

// A form with files: its content type and its bytes, so that they can be sent as they are.
function form(files) {
  const boundary = "part-of-the-form", parts = [`--${boundary}\r\ncontent-disposition: form-data; name="csrf"\r\n\r\n\r\n`];
  for (const [name, bytes] of Object.entries(files)) parts.push(`--${boundary}\r\ncontent-disposition: form-data; name="files"; filename="${name}"\r\n\r\n`, bytes, "\r\n");
  return { type: `multipart/form-data; boundary=${boundary}`, bytes: Buffer.concat([...parts, `--${boundary}--\r\n`].map((part) => Buffer.from(part))) };
}

// Sends all before it reads, as browsers do, and reads to the end.
function post(path, { type, bytes }, headers = {}) {
  return new Promise((resolve, reject) => {
    const asked = request(address + path, { method: "POST", agent: false, headers: { "content-type": type, "content-length": bytes.length, ...headers } }, (answer) => {
      const read = []; answer.on("data", (part) => read.push(part));
      answer.on("end", () => resolve({ status: answer.statusCode, type: answer.headers["content-type"] ?? "", text: Buffer.concat(read).toString() })).on("error", reject);
    });
    asked.on("error", reject); asked.end(bytes);
  });
}

async function refusals(event) {
  const words = (text) => ({ type: "application/x-www-form-urlencoded", bytes: Buffer.from(text) });
  const own = { origin: address };
  const wanted = [
    [await fetch(address + "/sites/no%2Fsuch"), 404, "a site that is not there"],
    [await fetch(address + of("events/nothing")), 404, "an event that is not there"],
    [await fetch(address + of("events/%00%ff")), 400, "an event whose name is no text"],
    [await fetch(address + of("sets/first")), 400, "a version that is no number"],
    [await fetch(address + of("diagnoses/999")), 404, "a diagnosis that is not there"],
    [await fetch(address + of(`events/${event}?model=magic`)), 400, "a model that is none"],
    [await fetch(address + of("compare?event=a")), 400, "one event to compare"],
    [await fetch(address + of("events?sort=colour")), 400, "a column that is not there"],
    [await fetch(address + "/elsewhere"), 404, "an address that leads nowhere"],
    [await fetch(address + "/sites?sort=colour"), 400, "an order that is not there"],
    [await fetch(address + of("events?page=0")), 400, "a page before the first"],
    [await fetch(address + of("events/" + "x".repeat(5000))), 404, "an event with a name of 5,000 letters"],
    [await fetch(address + "/api/v1/sites/substation/sets/first"), 400, "a version of the API that is no number"],
    [await fetch(address + "/api/v1/events?before_ns=x"), 400, "a time of the API that is no number"],
    [await fetch(address + of("diagnosis?with=magic")), 404, "an effect that was not tried"],
    [await fetch(address + of("diagnosis?event=nothing")), 404, "an event that was not diagnosed"],
    [await post("/session", words("token=wrong"), own), 403, "a wrong token"],
    [await post("/session", words(`token=${token}`), { origin: "http://evil.example" }), 403, "a token sent by another site"],
    [await post(of("structure"), words(`csrf=&add=${effect}`), own), 403, "a change without the token"],
    [await post(of("structure"), words("x".repeat(100000)), own), 413, "a form of 100 kB"],
    [await post(of("structure"), words("x".repeat(20000000)), own), 413, "a form of 20 MB"],
    [await post(of("structure"), words("nonsense=1"), own), 422, "a form of other fields"],
    [await post(of("events"), words(""), own), 405, "a form where none is"],
    [await fetch(address + "/api/v1/sites/substation/structure", { method: "POST", body: "{}", headers: { authorization: "Bearer wrong", "content-type": "application/json" } }), 401, "a wrong token of the API"],
  ];
  for (const [answer, status, what] of wanted) {
    check(answer.status === status, `${what} is refused with ${answer.status} of ${status}`);
    const type = answer instanceof Response ? answer.headers.get("content-type") : answer.type;
    check(/^text\/html|^application\/json/.test(type), `${what}: the reason is a page or JSON (${type})`);
  }
  const text = await (await fetch(address + of("sets/first"))).text();
  check(text.includes("is not the number of a version"), "a refusal says what is wrong");
}

async function unlock(context) {
  const page = await context.newPage();
  await page.goto(address + of("structure"));
  await page.getByRole("link", { name: "Unlock it with the write token" }).click();
  await page.getByLabel("Write token").fill("not the token at all");
  await page.getByRole("button", { name: "Unlock" }).click();
  check(await page.getByText("That is not the token.").isVisible(), "a wrong token is asked for again");
  await page.getByLabel("Write token").fill(token);
  await page.getByRole("button", { name: "Unlock" }).click();
  await page.waitForURL(address + of("structure"));
  check(await page.getByRole("button", { name: "Add and refit" }).isVisible(), "the token unlocks changes");
  await page.close();
}

// As a new user would: from the list of sites, by clicks.
async function addTheEffect(context) {
  const complaints = watch(context);
  const page = await context.newPage();
  await page.goto(`${address}/`);
  let clicks = 0;
  const click = (locator) => { clicks += 1; return follow(page, locator); };
  check(await page.getByRole("link", { name: `${site} lacks ${effect.replaceAll("_", " ")}` }).isVisible(), "the list says where to look first");
  await click(page.getByRole("link", { name: site, exact: true }));
  await click(page.getByRole("link", { name: "Diagnosis", exact: true }));
  const answers = (await json(of("diagnosis.json"))).diagnosis.answer_set;
  check(answers.includes(effect), `the diagnosis names ${answers.join(", ")}`);
  check(clicks <= 5, `the effect is found with ${clicks} clicks`);
  const words = effect.replaceAll("_", " ");
  await charts(page);
  check(await page.locator("#before-after canvas").first().isVisible(), "what it would do to the model is drawn before it is added");
  const { drawn } = await json(of("diagnosis.json"));
  check(drawn.effect === effect && drawn.with.error_to_noise < 0.8 * drawn.without.error_to_noise,
    `with ${drawn.effect} the error over noise would fall from ${drawn.without.error_to_noise.toFixed(2)} to ${drawn.with.error_to_noise.toFixed(2)}`);
  const begun_ms = Date.now();
  await click(page.getByRole("button", { name: new RegExp(`[Aa]dd ${words}`) }));
  check(page.url() === address + of("structure"), `one more adds it and shows the staircase: ${page.url()}`);
  await page.evaluate(() => {
    window.notReloaded = true; window.progress = [];
    const note = () => { const text = document.querySelector("#work")?.textContent; if (text) window.progress.push(text); };
    note(); new MutationObserver(note).observe(document.querySelector("main"), { childList: true, subtree: true });
  });
  await page.waitForFunction((name) => document.querySelector("#staircase")?.textContent.includes(name), `+ ${words}`, { timeout: WORK_LIMIT_MS });
  const lasted_ms = Date.now() - begun_ms;
  await charts(page);
  check(await page.evaluate(() => window.notReloaded === true), "the staircase shows the step without a reload");
  const progress = await page.evaluate(() => window.progress.filter((text) => text.includes("Fitting") && text.includes("simulations")));
  // A fit may be done before a page has had its news.
  check(progress.length > 0 || lasted_ms < NEWS_MS, `how far a fit of ${lasted_ms} ms is was shown ${new Set(progress).size} times: ${progress.at(-1)}`);
  const { steps } = await json(of("structure.json"));
  const [before, after] = [steps.at(-2), steps.at(-1)].map((s) => s.held_out_error_to_noise ?? s.error_to_noise);
  check(after < 0.8 * before, `the error over noise falls from ${before.toFixed(2)} to ${after.toFixed(2)}`);
  check(await page.locator("#before-after canvas").first().isVisible(), "measurement, before and after are drawn together");
  await page.screenshot({ path: join(shots, "staircase.png"), fullPage: true });
  check(complaints.length === 0, `no complaint on the way ${complaints.slice(0, 3).join("; ")}`);
  await page.close();
}

// A recording of the reader's own: an event of the site, taken out as COMTRADE and sent back.
async function sendRecording(context, event) {
  const exported = await fetch(address + of(`events/${event}.cff`));
  const bytes = Buffer.from(await exported.arrayBuffer());
  check(exported.status === 200 && bytes.toString("latin1").startsWith("--- file type: CFG ---"), "an event is exported as COMTRADE");
  const page = await context.newPage(), send = async (name, buffer) => {
    await page.goto(address + of("recordings"));
    await page.getByLabel("Recording", { exact: true }).setInputFiles({ name, mimeType: "application/octet-stream", buffer });
    return (await press(page, page.getByRole("button", { name: "Compare with the model" }))).status();
  };
  check(await send("hello.csv", Buffer.from("hello")) === 400, "what is no recording is refused");
  check((await page.locator("main").innerText()).includes("time_s"), "and the reason is told");
  check(await send("mine.cff", bytes) === 303, "a COMTRADE file is taken");
  check((await page.locator("h1").innerText()).includes("mine.cff"), "and drawn under its name");
  await charts(page);
  check(await page.locator("#over-time canvas").first().isVisible(), "with the model beside it");
  await page.screenshot({ path: join(shots, "recording.png"), fullPage: true });
  const [origin, cookie] = [address, (await context.cookies()).map((c) => `${c.name}=${c.value}`).join("; ")];
  const huge = Buffer.alloc(17 * 1024 * 1024, "0");
  check((await post(of("recordings"), form({ "huge.csv": huge }), { origin, cookie })).status === 413, "17 MiB are refused to a program that sends all before it reads");
  // The page says so before anything is sent; a browser that sends it nevertheless sees why it was refused.
  await page.goto(address + of("recordings"));
  await page.getByLabel("Recording", { exact: true }).setInputFiles({ name: "huge.csv", mimeType: "text/csv", buffer: huge });
  check(await page.getByLabel("Recording", { exact: true }).evaluate((field) => field.validationMessage.includes("16 MiB")), "files that are too large are told of before they are sent");
  await page.getByLabel("Recording", { exact: true }).evaluate((field) => { field.form.noValidate = true; });
  const told = await press(page, page.getByRole("button", { name: "Compare with the model" }));
  check(told.status() === 413 && (await page.locator("main").innerText()).includes("16 MiB"), `the browser sees why 17 MiB are refused: ${told.status()}`);
  const kept = (await json(of("recordings.json"))).recordings.map((recording) => recording.file);
  check(kept.length === 1 && kept[0] === "mine.cff", `only what was read is kept: ${kept.join(", ")}`);
  const small = form({ "small.csv": Buffer.from("time_s") });
  for (const [headers, who] of [[{ origin }, "a stranger's recording"], [{ origin: "http://evil.example", cookie }, "a recording sent by another site"], [{ origin, cookie }, "a recording without the form's word"]]) {
    const { status } = await post(of("recordings"), small, headers);
    check(status === 403, `${who} is refused with ${status} of 403`);
  }
  await page.close();
}

// A set that passed waits for a person: whoever has the token approves it by the page's button.
async function approve(context, version) {
  const waiting = (list) => list.decisions.find((decision) => decision.awaiting_approval);
  await until("a set that waits for approval", async () => waiting(await json(of("sets.json"))));
  const page = await context.newPage();
  await page.goto(address + of("sets"));
  check(await page.getByText("awaits approval").first().isVisible(), `version ${version} is not in force before somebody approves it`);
  await page.screenshot({ path: join(shots, `sets-awaiting-${version}.png`), fullPage: true });
  await page.getByLabel("Comment").first().fill("looked at in the browser test");
  await press(page, page.getByRole("button", { name: "Approve" }).first());
  check(!waiting(await json(of("sets.json"))), "it is approved by its button");
  // A set is in force once it has been published, which follows the approval.
  await until(`version ${version} in force`, async () => (await json(of("sets.json"))).in_force === version);
  check((await page.locator("main").innerText()).includes("looked at in the browser test"), "and the page tells by whom and why");
  await page.close();
}

async function rollBack(context) {
  const page = await context.newPage();
  await page.goto(address + of("sets"));
  await page.screenshot({ path: join(shots, "sets-two.png"), fullPage: true });
  await press(page, page.getByRole("button", { name: "Put in force again" }));
  await until("version 1 in force again", async () => (await json(of("sets.json"))).in_force === 1);
  console.log("ok     an older version is put in force again by its button");
  await page.close();
}

let thrown = null;
try {
  await until("a joint fit", async () => (await json(of("structure.json")))?.steps.length > 0);
  await until("a diagnosis", async () => (await json(of("diagnosis.json")))?.diagnosis);
  console.log(`fitted and diagnosed after ${((Date.now() - begun) / 1000).toFixed(0)} s`);
  const context = await browser.newContext({ viewport: { width: 1280, height: 900 } });
  await unlock(context);
  await approve(context, 1);
  const { events } = await json(of("events.json"));
  const depth = (row) => row.event.lowest_voltage_pu ?? 9;
  const event = [...events].sort((a, b) => depth(a) - depth(b))[0].event.event;
  const paths = {
    sites: "/sites", events: of("events"), event: of(`events/${event}`),
    compare: of(`compare?event=${events[0].event.event}&event=${events[1].event.event}`),
    diagnosis: of("diagnosis"), structure: of("structure"), solutions: of("solutions"), sets: of("sets"), set: of("sets/1"), recordings: of("recordings"),
    streams: "/streams", health: "/health", session: "/session",
    refused: of("events/nothing"),
  };
  await refusals(event);
  await everyScreen(paths);
  await accessible(paths);
  await withoutScripts(paths);
  await complete(paths);
  await zoom(paths.event);
  await addTheEffect(context);
  await approve(context, 2);
  await sendRecording(context, event);
  await rollBack(context);
} catch (error) {
  thrown = error;
} finally {
  await browser.close();
  await daemon.stop();
}
if (thrown) throw thrown;
console.log(`${failures === 0 ? "every check passed" : `${failures} checks failed`} in ${((Date.now() - begun) / 1000).toFixed(0)} s`);
process.exit(failures === 0 ? 0 : 1);
