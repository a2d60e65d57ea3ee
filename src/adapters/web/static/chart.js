// Charts that zoom and tell values: each takes the place of the server's drawing in its figure.
import { HEAD, LEFT, Panel, RIGHT, fixed, foot, lowerBound, missing, significant } from "./draw.js";

const INKS = ["measured", "model", "rival", "third", "noise", "edge", "mark", "unused"];
const documents = new Map(); // address -> promise of its charts
const charts = []; // those on the page

// Figures that have not been upgraded yet.
export function upgrade(root) {
  for (let k = charts.length - 1; k >= 0; k--) if (!charts[k].figure.isConnected) { charts[k].stop(); charts.splice(k, 1); }
  documents.clear();
  for (const figure of root.querySelectorAll("figure.chart[data-source]")) {
    const address = figure.dataset.source;
    if (!documents.has(address)) documents.set(address, fetch(address).then((answer) => answer.ok ? answer.json() : Promise.reject(answer.status)).then(unpacked));
    documents.get(address).then((document) => {
      const chart = document.charts.find((chart) => chart.id === figure.id);
      if (chart && figure.isConnected) charts.push(new Chart(figure, chart));
    }, () => { /* the drawing of the server stays */ });
  }
}

function decoded(base64) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(base64);
  const text = atob(base64), bytes = new Uint8Array(text.length);
  for (let k = 0; k < text.length; k++) bytes[k] = text.charCodeAt(k);
  return bytes;
}

// Long lists of numbers come as base64 of 32-bit floats, lowest byte first as in every machine that browsers run on; a gap is no number.
function unpacked(document) {
  const list = (packed) => packed?.f32 ? new Float32Array(decoded(packed.f32).buffer) : packed;
  for (const chart of document.charts) {
    chart.x = list(chart.x);
    for (const panel of chart.panels) for (const mark of panel.marks) for (const name of ["x", "y", "low", "high", "shade"]) if (name in mark) mark[name] = list(mark[name]);
  }
  return document;
}

class Chart {
  constructor(figure, data) {
    this.figure = figure; this.data = data; this.hidden = new Set(); this.hover = null;
    this.whole = data.horizontal; this.horizontal = [...data.horizontal];
    this.plot = figure.querySelector(".plot");
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", data.title + ". Keys: + and - zoom, arrows move, 0 shows everything.");
    this.readout = document.createElement("div"); this.readout.className = "readout"; this.readout.hidden = true;
    const svg = this.plot.querySelector("svg"); svg.setAttribute("aria-hidden", "true"); svg.style.display = "none";
    // What follows the pointer is drawn on a canvas of its own above the other.
    this.overlay = document.createElement("canvas"); this.overlay.className = "overlay"; this.overlay.setAttribute("aria-hidden", "true");
    this.plot.append(this.canvas, this.overlay, this.readout);
    this.tools(); this.legend(); this.listen();
    // The observer tells the first size too, which is drawn already.
    this.resized = new ResizeObserver(() => { if (this.plot.clientWidth !== this.drawnWidth) this.draw(); }); this.resized.observe(this.plot);
    this.themed = () => { this.colours = null; this.draw(); };
    document.addEventListener("theme", this.themed);
    const asked = new URLSearchParams(location.hash.slice(1)).get(this.key());
    if (asked) { const [a, b] = asked.split("_").map(Number); if (b > a) this.horizontal = [a, b]; }
    this.paint(); figure.dataset.ready = "yes";
  }

  stop() { cancelAnimationFrame(this.frame); this.resized.disconnect(); document.removeEventListener("theme", this.themed); }
  key() { return this.data.linked ?? this.data.id; }
  group() { return this.data.linked ? charts.filter((c) => c.data.linked === this.data.linked) : [this]; }

  tools() {
    const bar = document.createElement("span"); bar.className = "tools";
    const button = (text, title, act) => { const b = document.createElement("button"); b.type = "button"; b.textContent = text; b.title = title; b.setAttribute("aria-label", title); b.addEventListener("click", act); bar.append(b); };
    if (this.data.names.length) { button("PNG", "Save as PNG picture", () => this.save()); this.figure.querySelector("figcaption").append(bar); return; }
    button("+", "Zoom in", () => this.zoom(0.5)); button("\u2212", "Zoom out", () => this.zoom(2));
    button("\u25c2", "Earlier", () => this.move(-0.25)); button("\u25b8", "Later", () => this.move(0.25));
    if (this.data.linked === "time") button("0\u20132 s", "Show 0\u20132 s, the first two seconds", () => this.show(Math.max(this.whole[0], -0.2), Math.min(this.whole[1], 2)));
    button("all", "Show all", () => this.show(...this.whole)); button("PNG", "Save as PNG picture", () => this.save());
    this.figure.querySelector("figcaption").append(bar);
  }

  legend() {
    for (const key of this.figure.querySelectorAll("span.key")) {
      const button = document.createElement("button"); button.type = "button"; button.className = "key"; button.append(...key.childNodes);
      const name = button.textContent; button.setAttribute("aria-pressed", "true"); button.title = "Show or hide " + name;
      button.addEventListener("click", () => {
        this.hidden.has(name) ? this.hidden.delete(name) : this.hidden.add(name);
        button.setAttribute("aria-pressed", String(!this.hidden.has(name))); this.draw();
      });
      key.replaceWith(button);
    }
  }

  listen() {
    const at = (event) => { const box = this.canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
    this.canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.shiftKey && document.activeElement !== this.plot) return; // the page scrolls
      event.preventDefault(); this.zoom(event.deltaY > 0 ? 1.25 : 0.8, this.value(at(event)[0]));
    }, { passive: false });
    this.canvas.addEventListener("pointerdown", (event) => {
      if (event.pointerType === "touch" || event.button !== 0) return;
      this.plot.focus({ preventScroll: true }); this.canvas.setPointerCapture(event.pointerId); this.pressed = { from: at(event)[0], shift: event.shiftKey, horizontal: [...this.horizontal] }; this.plot.dataset.pressed = "yes";
    });
    this.canvas.addEventListener("pointermove", (event) => {
      const [x] = at(event);
      if (this.pressed?.shift) {
        const [a, b] = this.pressed.horizontal, shift = (this.pressed.from - x) / this.width() * (b - a); this.show(a + shift, b + shift);
      } else for (const chart of this.group()) chart.point(this.value(x), chart === this ? x : null, chart === this && this.pressed ? this.value(this.pressed.from) : null);
    });
    this.canvas.addEventListener("pointerup", (event) => {
      const pressed = this.pressed; this.pressed = null; delete this.plot.dataset.pressed;
      if (!pressed || pressed.shift) return;
      const [x] = at(event); if (Math.abs(x - pressed.from) < 6) { this.draw(); return; }
      const ends = [this.value(pressed.from), this.value(x)].sort((a, b) => a - b); this.show(...ends);
    });
    this.canvas.addEventListener("pointerleave", () => { for (const chart of this.group()) chart.point(null, null, null); });
    this.canvas.addEventListener("dblclick", () => this.show(...this.whole));
    this.plot.addEventListener("keydown", (event) => {
      const acts = { "+": () => this.zoom(0.5), "=": () => this.zoom(0.5), "-": () => this.zoom(2), ArrowLeft: () => this.move(-0.1), ArrowRight: () => this.move(0.1), 0: () => this.show(...this.whole), Home: () => this.show(...this.whole) };
      if (acts[event.key] && !event.ctrlKey && !event.altKey && !event.metaKey) { event.preventDefault(); acts[event.key](); }
    });
  }

  width() { return Math.max(50, this.plot.clientWidth - LEFT - RIGHT); }
  value(x) { const [a, b] = this.horizontal; return a + (x - LEFT) / this.width() * (b - a); }
  zoom(factor, about) { const [a, b] = this.horizontal, c = about ?? (a + b) / 2; this.show(c - (c - a) * factor, c + (b - c) * factor); }
  move(share) { const [a, b] = this.horizontal, d = share * (b - a); this.show(a + d, b + d); }

  // All linked charts show the same stretch; the address remembers it.
  show(from, to) {
    const [low, high] = this.whole, least = (high - low) * 1e-4, span = Math.min(Math.max(to - from, least), high - low);
    const a = Math.min(Math.max(from, low), high - span), view = [a, a + span];
    for (const chart of this.group()) { chart.horizontal = [...view]; chart.draw(); }
    const all = span >= (high - low) * 0.9999, hash = new URLSearchParams(location.hash.slice(1));
    all ? hash.delete(this.key()) : hash.set(this.key(), view.map((v) => significant(v, 6).replace("\u2212", "-")).join("_"));
    history.replaceState(null, "", String(hash) ? "#" + hash : location.pathname + location.search);
  }

  palette() {
    const style = getComputedStyle(this.figure), get = (name) => style.getPropertyValue("--" + name).trim();
    const colours = { text: get("ink"), dim: get("dim"), grid: get("rule"), axis: get("strong-rule"), panel: get("panel") };
    for (const ink of INKS) colours[ink] = get(ink);
    for (let k = 0; k < 8; k++) colours["shade-" + k] = get("shade-" + k);
    return colours;
  }

  // Zoomed in, the vertical axis follows what is seen; never narrower than a fifth of the whole.
  vertical(panel) {
    const [a, b] = this.horizontal;
    if (this.data.names.length || (b - a) > 0.999 * (this.whole[1] - this.whole[0])) return panel.vertical;
    let low = Infinity, high = -Infinity;
    for (const mark of panel.marks) {
      if (this.hidden.has(mark.name)) continue;
      const x = mark.x ?? this.data.x;
      for (const values of [mark.y, mark.low, mark.high]) {
        if (values?.length === undefined || mark.kind === "label") continue;
        const first = mark.x ? 0 : lowerBound(x, a), end = mark.x ? x.length : lowerBound(x, b);
        for (let k = first; k < end; k++) { const v = values[k]; if (missing(v) || x[k] < a || x[k] > b) continue; if (v < low) low = v; if (v > high) high = v; }
      }
    }
    if (low > high) return panel.vertical;
    const least = (panel.vertical[1] - panel.vertical[0]) / 20, short = Math.max(0, least - (high - low)) / 2, margin = 0.06 * (high - low) + short;
    return [low - margin, high + margin];
  }

  // With the next frame, once for all that changes until then.
  draw() { this.frame ??= requestAnimationFrame(() => this.paint()); }

  paint() {
    cancelAnimationFrame(this.frame); this.frame = null;
    const width = this.drawnWidth = this.plot.clientWidth; if (!width) return;
    const height = this.data.panels.reduce((sum, p) => sum + p.height + HEAD, foot(this.data)), ratio = window.devicePixelRatio || 1;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== size[0] || this.canvas.height !== size[1]) for (const canvas of [this.canvas, this.overlay]) { [canvas.width, canvas.height] = size; canvas.style.height = height + "px"; }
    const context = this.canvas.getContext("2d"); context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.colours ??= this.palette();
    context.fillStyle = this.colours.panel; context.fillRect(0, 0, width, height);
    let top = 0;
    this.panels = this.data.panels.map((panel, k) => {
      const box = { left: LEFT, top: top + HEAD, width: width - LEFT - RIGHT, height: panel.height }; top += panel.height + HEAD;
      const drawn = new Panel(this.data, panel, context, this.colours, box, { horizontal: this.horizontal, vertical: this.vertical(panel) });
      drawn.draw(k + 1 === this.data.panels.length, this.hidden); return drawn;
    });
    this.cross();
  }

  // The pointer is at `value`; `selected` is where a stretch began.
  point(value, pixel, selected) { this.hover = value === null ? null : { value, pixel, selected }; this.cross(); }

  cross() {
    // Nothing is there and nothing is to be: an overlay that was never drawn on costs nothing.
    if (!this.hover && !this.crossed) return;
    this.crossed = this.hover !== null;
    const context = this.overlay.getContext("2d"), ratio = window.devicePixelRatio || 1;
    context.setTransform(ratio, 0, 0, ratio, 0, 0); context.clearRect(0, 0, this.overlay.width, this.overlay.height);
    this.readout.hidden = true; if (!this.hover || !this.panels) return;
    const { value, pixel, selected } = this.hover, first = this.panels[0], last = this.panels.at(-1), x = first.x(value);
    if (x < LEFT || x > LEFT + this.width()) return;
    const bottom = last.box.top + last.box.height;
    if (selected !== null) { const from = first.x(selected); context.fillStyle = this.colours.measured; context.globalAlpha = 0.2; context.fillRect(Math.min(from, x), HEAD, Math.abs(x - from), bottom - HEAD); context.globalAlpha = 1; }
    context.strokeStyle = this.colours.dim; context.lineWidth = 1; context.beginPath(); context.moveTo(x, HEAD); context.lineTo(x, bottom); context.stroke();
    if (pixel !== null && this.data.x.length) this.tell(value, x);
  }

  tell(value, x) {
    const all = this.data.x, sorted = this.sorted ??= all.every((v, k) => k === 0 || all[k - 1] <= v);
    let k = sorted ? lowerBound(all, value) : all.reduce((best, v, j) => Math.abs(v - value) < Math.abs(all[best] - value) ? j : best, 0);
    if (sorted && k > 0 && (k === all.length || value - all[k - 1] < all[k] - value)) k--;
    this.readout.replaceChildren();
    const head = document.createElement("b"); head.textContent = this.data.names.length ? this.data.names[Math.round(all[k])] : this.data.horizontal_title + ": " + fixed(all[k], 3); this.readout.append(head);
    for (const panel of this.data.panels) for (const mark of panel.marks) {
      if (mark.x || !mark.y || this.hidden.has(mark.name)) continue;
      const row = document.createElement("div"), number = panel.logarithmic && !missing(mark.y[k]) ? 10 ** mark.y[k] : mark.y[k];
      row.textContent = panel.title + (mark.name && panel.marks.filter((m) => m.y && m.name).length > 1 ? " \u00b7 " + mark.name : "") + ": " + significant(number, 4); this.readout.append(row);
    }
    this.readout.hidden = false;
    const right = x > this.plot.clientWidth / 2;
    this.readout.style.left = right ? "auto" : x + 14 + "px"; this.readout.style.right = right ? this.plot.clientWidth - x + 14 + "px" : "auto"; this.readout.style.top = "30px";
  }

  save() {
    this.paint();
    const link = document.createElement("a"); link.download = this.data.id + ".png"; link.href = this.canvas.toDataURL("image/png"); link.click();
  }
}
