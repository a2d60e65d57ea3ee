// What scripts add to every page: dark or light by hand, charts that zoom, news of the site.
import { upgrade } from "./chart.js";

const root = document.documentElement;

function theme() {
  const button = document.getElementById("theme");
  const dark = () => root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  button.hidden = false;
  button.addEventListener("click", () => {
    root.dataset.theme = dark() ? "light" : "dark";
    try { localStorage.setItem("theme", root.dataset.theme); } catch (_) { /* not kept */ }
    document.dispatchEvent(new Event("theme"));
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => document.dispatchEvent(new Event("theme")));
}

// Whether the reader is filling in a form, or holds something open that new content would close.
function occupied() {
  const busy = document.activeElement && document.activeElement.closest("form");
  const entered = (field) => field.type === "file" ? field.files.length > 0 : ["text", "search", "number", "password"].includes(field.type) && field.value !== field.defaultValue;
  return Boolean(busy || [...document.querySelectorAll("main input")].some(entered) || document.querySelector(".plot[data-pressed], main input:checked, main details[open]"));
}

// The page again, without losing the reader's place: its content is replaced unless the reader is occupied, before it was asked for or since.
async function refresh() {
  if (occupied()) return false;
  const answer = await fetch(location.href, { headers: { accept: "text/html" } });
  if (!answer.ok) return false;
  const fresh = new DOMParser().parseFromString(await answer.text(), "text/html");
  if (occupied()) return false;
  document.querySelector("main").replaceChildren(...fresh.querySelector("main").childNodes);
  document.title = fresh.title;
  upgrade(document);
  return true;
}

// How far the jobs of the site are.
function work(jobs) {
  const place = document.getElementById("work"); if (!place) return;
  place.replaceChildren(...jobs.map((job) => {
    const line = document.createElement("p"), bar = document.createElement("progress");
    bar.setAttribute("aria-label", "Under way"); if (job.share !== null) bar.value = job.share;
    line.append(bar, " " + job.text); return line;
  }));
}

function live() {
  const address = document.body.dataset.live;
  if (!address) return;
  const sign = document.getElementById("live");
  const source = new EventSource(address);
  let first = true;
  source.addEventListener("open", () => { sign.hidden = false; sign.textContent = "live"; sign.classList.remove("old"); });
  source.addEventListener("error", () => { sign.textContent = "not connected"; sign.classList.add("old"); });
  source.addEventListener("work", (event) => work(JSON.parse(event.data)));
  source.addEventListener("change", async () => {
    if (first) { first = false; return; }
    if (document.querySelector("main [data-keep]") || !(await refresh())) sign.textContent = "news: reload";
  });
  addEventListener("pagehide", () => source.close());
}

// Two ticked boxes are enough.
function pairs() {
  document.addEventListener("change", (event) => {
    const box = event.target;
    if (!(box instanceof HTMLInputElement) || box.type !== "checkbox" || box.name !== "event") return;
    const ticked = [...box.form.querySelectorAll('input[name="event"]:checked')];
    if (ticked.length > 2) ticked.find((other) => other !== box).checked = false;
  });
  document.addEventListener("change", (event) => {
    const select = event.target;
    if (select instanceof HTMLSelectElement && select.closest("form.filter")) select.form.requestSubmit();
  });
}

// Files that are too large are not sent at all: the answer would come after the last byte.
function sizes() {
  document.addEventListener("change", (event) => {
    const field = event.target, most = Number(field.dataset?.bytesMax);
    if (!most || !field.files) return;
    const bytes = [...field.files].reduce((sum, file) => sum + file.size, 0);
    field.setCustomValidity(bytes > most ? `The files are too large: together they may have ${Math.round(most / 1048576)} MiB.` : "");
    field.reportValidity();
  });
}

theme();
sizes();
live();
pairs();
upgrade(document);
