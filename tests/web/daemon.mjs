// Services for the scripts here: a daemon with one generated site that hides an effect (its token is in `token`), and the bundled demonstration.
import { execFileSync, spawn } from "node:child_process";
import { mkdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { createInterface } from "node:readline";

export const site = "substation";
export const effect = "exponential_recovery";
export const token = "the-token-of-the-browser-tests";
const PREFIX = "pages";

const said = (entry) => { try { return JSON.parse(entry); } catch { return {}; } };

function configuration(place, approval) {
  return `
[instance]
name = "pages"
[zenoh]
prefix = "${PREFIX}"
listen = ["tcp/127.0.0.1:0"]
[store]
path = "${join(place, "store.sqlite")}"
[http]
listen = "127.0.0.1:0"
token_file = "${join(place, "token")}"
[log]
format = "json"
[measurement]
silence_s = 1
[identification]
settle_s = 2
max_tiers = 1
[publishing]
manual_approval = ${approval}
[diagnosis]
enabled = true
max_refits = 3
[[site]]
name = "${site}"
s_base_mva = 200
v_base_kv = 23
nominal_hz = 60
`;
}

// Address of the pages and what ends it. Six short events at 30 frames/s: a fit takes seconds. With `approval` a set waits for a person's.
export async function start(program, place, { approval = false } = {}) {
  mkdirSync(place, { recursive: true });
  writeFileSync(join(place, "token"), token);
  writeFileSync(join(place, "daemon.toml"), configuration(place, approval));
  execFileSync(program, ["generate", "--site", site, "--out", place, "--seed", "3", "--effect", effect,
    "--events", "6", "--rate", "30", "--duration", "5", "--no-bad-samples"], { stdio: "ignore" });
  const served = serve(program, ["run", "--config", join(place, "daemon.toml")]);
  const ready = await served.says((line) => { const entry = said(line); return entry.message === "ready" && entry; });
  const endpoint = /tcp\/[^"\\]+/.exec(ready.zenoh)[0];
  execFileSync(program, ["replay", "--speed", "0", "--prefix", PREFIX, "--endpoint", endpoint, join(place, site)], { stdio: "ignore" });
  return { address: `http://${ready.http}`, stop: served.stop, log: served.log };
}

// The bundled demonstration, with a store of its own.
export async function demonstrate(program, place) {
  const served = serve(program, ["demo", "--http", "127.0.0.1:0", "--state", join(place, "state")]);
  const address = await served.says((line) => /http:\/\/127\.0\.0\.1:\d+/.exec(line)?.[0]);
  return { address, stop: served.stop, log: served.log };
}

// A process of ours: what it says, and what ends it.
function serve(program, words) {
  const child = spawn(program, words, { stdio: ["ignore", "pipe", "pipe"] });
  // However this process ends, the other does not outlive it.
  process.on("exit", () => child.kill("SIGKILL"));
  for (const signal of ["SIGTERM", "SIGINT"]) process.on(signal, () => process.exit(1));
  const log = [], listeners = new Set();
  for (const stream of [child.stdout, child.stderr]) createInterface({ input: stream }).on("line", (line) => {
    log.push(line);
    for (const listener of listeners) listener(line);
  });
  // The first thing that `found` makes of a line.
  const says = (found) => new Promise((resolve, reject) => {
    child.on("exit", (code) => reject(new Error(`${program} ${words[0]} ended with ${code}:\n${log.join("\n")}`)));
    listeners.add(function listener(line) { const value = found(line); if (value) { listeners.delete(listener); resolve(value); } });
  });
  const stop = () => new Promise((resolve) => { child.removeAllListeners("exit"); child.on("exit", resolve); child.kill("SIGINT"); });
  return { says, stop, log };
}
