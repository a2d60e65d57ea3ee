// A daemon of its own with one generated site that hides an effect; the token is in `token`.
import { execFileSync, spawn } from "node:child_process";
import { mkdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { createInterface } from "node:readline";

export const site = "substation";
export const effect = "exponential_recovery";
export const token = "the-token-of-the-browser-tests";
const PREFIX = "pages";

const said = (entry) => { try { return JSON.parse(entry); } catch { return {}; } };

function configuration(place) {
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

// Address of the pages and what ends it. Six short events at 30 frames/s: a fit takes seconds.
export async function start(program, place) {
  mkdirSync(place, { recursive: true });
  writeFileSync(join(place, "token"), token);
  writeFileSync(join(place, "daemon.toml"), configuration(place));
  execFileSync(program, ["generate", "--site", site, "--out", place, "--seed", "3", "--effect", effect,
    "--events", "6", "--rate", "30", "--duration", "5", "--no-bad-samples"], { stdio: "ignore" });
  const daemon = spawn(program, ["run", "--config", join(place, "daemon.toml")], { stdio: ["ignore", "ignore", "pipe"] });
  // However this process ends, the daemon does not outlive it.
  process.on("exit", () => daemon.kill("SIGKILL"));
  for (const signal of ["SIGTERM", "SIGINT"]) process.on(signal, () => process.exit(1));
  const log = [];
  const ready = await new Promise((resolve, reject) => {
    daemon.on("exit", (code) => reject(new Error(`the daemon ended with ${code}:\n${log.join("\n")}`)));
    createInterface({ input: daemon.stderr }).on("line", (line) => {
      log.push(line);
      const entry = said(line);
      if (entry.message === "ready") resolve(entry);
    });
  });
  const endpoint = /tcp\/[^"\\]+/.exec(ready.zenoh)[0];
  execFileSync(program, ["replay", "--speed", "0", "--prefix", PREFIX, "--endpoint", endpoint, join(place, site)], { stdio: "ignore" });
  const stop = () => new Promise((resolve) => { daemon.removeAllListeners("exit"); daemon.on("exit", resolve); daemon.kill("SIGINT"); });
  return { address: `http://${ready.http}`, stop, log };
}
