// Drawing of one panel on a canvas, in CSS pixels. The same marks as the server's drawing.
export const LEFT = 64, RIGHT = 14, HEAD = 24, FOOT = 40;

// A name in lines of at most about 14 characters, broken between words.
export function lines(name) {
  const found = [];
  for (const word of name.split(" ")) {
    if (found.length && found.at(-1).length + word.length < 14) found.push(found.pop() + " " + word); else found.push(word);
  }
  return found;
}

// Room below the last panel.
export function foot(chart) { return FOOT + 14 * (Math.max(1, ...chart.names.map((name) => lines(name).length)) - 1); }

export function ticks(low, high, count) {
  const span = high - low;
  if (!(span > 0) || !isFinite(span)) return { values: [], decimals: 0 };
  const raw = span / count, power = 10 ** Math.floor(Math.log10(raw));
  const steps = [10, 5, 2, 1, 0.5, 0.2, 0.1].map((f) => f * power), wide = steps.filter((s) => s >= raw * (1 - 1e-9)).length - 1;
  const several = (s) => Math.ceil(low / s) < Math.floor(high / s + 1e-9); // one number alone does not tell the scale
  const step = steps.slice(Math.max(0, wide)).find(several) ?? power;
  const values = [];
  for (let k = Math.ceil(low / step); k <= Math.floor(high / step + 1e-9) && values.length < 64; k++) values.push(k * step);
  return { values, decimals: Math.min(9, Math.max(0, -Math.floor(Math.log10(step)))) };
}

// Places on an axis of decimal logarithms: powers of ten, with 2 and 5 times them where there is room.
export function logarithmicTicks(low, high, count) {
  const span = high - low, factors = span * 3 <= count + 1 ? [1, 2, 5] : [1], values = [];
  if (!(span > 0) || span > 64) return values;
  for (let power = Math.floor(low); power <= high; power++) for (const factor of factors) {
    const place = power + Math.log10(factor);
    if (place >= low && place <= high) values.push(place);
  }
  // On a piece of one power round numbers, whose places are nearly even there.
  return values.length < 3 && span < 1 ? ticks(10 ** low, 10 ** high, count).values.map(Math.log10) : values;
}

// What stands at a place of a logarithmic axis, without the last digits' rounding.
function numberAt(logarithm) {
  const digit = 10 ** (Math.floor(logarithm) - 2), value = Math.round(10 ** logarithm / digit) * digit;
  return Math.abs(value) >= 1e6 || Math.abs(value) < 1e-4 ? value.toExponential(1) : String(Number(value.toPrecision(3)));
}

// A gap in a list: null where the list came as text, no number where it came as bytes.
export function missing(value) { return value === null || value !== value; }

export function fixed(value, decimals) {
  const text = value.toFixed(decimals);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "\u2212");
}

export function significant(value, digits) {
  if (missing(value) || !isFinite(value)) return "\u2013";
  if (value === 0) return "0";
  const size = Math.floor(Math.log10(Math.abs(value)));
  if (size < -4 || size >= 6) return value.toExponential(digits - 1).replaceAll("-", "\u2212");
  return fixed(value, Math.min(20, Math.max(0, digits - 1 - size)));
}

// Index of the first x that is not below `value`.
export function lowerBound(x, value) {
  let low = 0, high = x.length;
  while (low < high) { const middle = (low + high) >> 1; if (x[middle] < value) low = middle + 1; else high = middle; }
  return low;
}

export class Panel {
  constructor(chart, panel, context, colours, box, view) {
    Object.assign(this, { chart, panel, context, colours, box, view });
    this.low = view.vertical[0]; this.high = view.vertical[1];
  }
  x(value) { const [a, b] = this.view.horizontal; return this.box.left + (value - a) / (b - a) * this.box.width; }
  y(value) { return this.box.top + (this.high - value) / (this.high - this.low) * this.box.height; }

  draw(last, hidden) {
    const c = this.context, { left, top, width, height } = this.box;
    this.axes(last);
    c.save(); c.beginPath(); c.rect(left, top, width, height); c.clip();
    const behind = ["strip", "band", "upright", "level"];
    const shown = this.panel.marks.filter((m) => !hidden.has(m.name));
    for (const mark of shown.filter((m) => behind.includes(m.kind))) this[mark.kind](mark);
    for (const mark of shown.filter((m) => !behind.includes(m.kind))) this[mark.kind](mark);
    c.restore();
  }

  axes(last) {
    const c = this.context, { left, top, width, height } = this.box, col = this.colours;
    c.font = "600 12px system-ui, 'DejaVu Sans', sans-serif"; c.fillStyle = col.text; c.textAlign = "left"; c.textBaseline = "alphabetic";
    c.fillText(this.panel.title, left, top - 8, width);
    c.font = "12px system-ui, 'DejaVu Sans', sans-serif"; c.fillStyle = col.dim; c.strokeStyle = col.grid; c.lineWidth = 1;
    const count = Math.max(3, Math.min(7, Math.floor(height / 30)));
    const vertical = this.panel.logarithmic ? { values: logarithmicTicks(this.low, this.high, count), decimals: 0 } : ticks(this.low, this.high, count);
    c.textAlign = "right"; c.textBaseline = "middle";
    for (const value of vertical.values) {
      const y = Math.round(this.y(value)) + 0.5;
      c.beginPath(); c.moveTo(left, y); c.lineTo(left + width, y); c.stroke();
      c.fillText(this.panel.logarithmic ? numberAt(value) : fixed(value, vertical.decimals), left - 6, y);
    }
    const [a, b] = this.view.horizontal, names = this.chart.names;
    const horizontal = names.length ? { values: names.map((_, k) => k).filter((k) => k >= a && k <= b), decimals: 0 } : ticks(a, b, Math.max(2, Math.floor(width / 90)));
    c.textAlign = "center"; c.textBaseline = "top";
    for (const value of horizontal.values) {
      const x = Math.round(this.x(value)) + 0.5;
      c.beginPath(); c.moveTo(x, top); c.lineTo(x, top + height); c.stroke();
      if (last) lines(names.length ? names[value] : fixed(value, horizontal.decimals)).forEach((line, k) => c.fillText(line, x, top + height + 6 + 14 * k));
    }
    if (last) { c.fillStyle = col.text; c.fillText(this.chart.horizontal_title, left + width / 2, top + height + foot(this.chart) - 17, width); }
    c.strokeStyle = col.axis; c.beginPath(); c.moveTo(left + 0.5, top); c.lineTo(left + 0.5, top + height + 0.5); c.lineTo(left + width, top + height + 0.5); c.stroke();
  }

  // From just before to just after what is visible; x ascends where the chart's own x is meant.
  range(mark) {
    const x = mark.x ?? this.chart.x;
    if (mark.x) return [x, 0, x.length];
    const [a, b] = this.view.horizontal;
    return [x, Math.max(0, lowerBound(x, a) - 1), Math.min(x.length, lowerBound(x, b) + 1)];
  }

  line(mark) {
    const c = this.context, [x, from, to] = this.range(mark), y = mark.y;
    c.strokeStyle = this.colours[mark.ink]; c.lineWidth = mark.ink === "measured" ? 2.6 : 1.6; c.lineJoin = "round"; c.setLineDash(mark.dashed ? [6, 3] : []);
    c.beginPath();
    // The scales, taken out of the loop over ten thousand points.
    const [a, b] = this.view.horizontal, { left, top, width, height } = this.box, across = width / (b - a), down = height / (this.high - this.low), level = this.high;
    const dense = to - from > 3 * width;
    let drawing = false, column = NaN, low = 0, high = 0;
    for (let k = from; k < to; k++) {
      const value = y[k];
      if (missing(value)) { drawing = false; continue; }
      const px = left + (x[k] - a) * across, py = top + (level - value) * down;
      if (!drawing) { c.moveTo(px, py); drawing = true; column = Math.floor(px); low = high = py; continue; }
      if (dense && Math.floor(px) === column) { // extremes of one column of pixels
        if (py < low || py > high) { c.lineTo(px, py); if (py < low) low = py; else high = py; }
      } else { c.lineTo(px, py); column = Math.floor(px); low = high = py; }
    }
    c.stroke(); c.setLineDash([]);
  }

  band(mark) {
    const c = this.context, [x, from, to] = this.range(mark);
    c.fillStyle = this.colours[mark.ink]; c.globalAlpha = 0.28; c.beginPath();
    const step = Math.max(1, Math.floor((to - from) / (2 * this.box.width)));
    for (let k = from; k < to; k += step) c.lineTo(this.x(x[k]), this.y(mark.high[k]));
    for (let k = to - 1; k >= from; k -= step) c.lineTo(this.x(x[k]), this.y(mark.low[k]));
    c.closePath(); c.fill(); c.globalAlpha = 1;
  }

  points(mark) {
    const c = this.context, [a, b] = this.view.horizontal;
    const x = mark.x ?? this.chart.x;
    // Thousands of circles take a software renderer tenths of a second; squares of their size do not.
    const square = mark.shape === "dot" && x.length > 2000;
    for (let k = 0; k < x.length; k++) {
      if (missing(x[k]) || missing(mark.y[k]) || x[k] < a || x[k] > b) continue;
      const px = this.x(x[k]), py = this.y(mark.y[k]);
      const colour = mark.shade ? this.colours["shade-" + Math.round(mark.shade[k] * 7)] : this.colours[mark.ink];
      if (square) { c.fillStyle = colour; c.fillRect(px - 2.5, py - 2.5, 5, 5); continue; }
      c.fillStyle = c.strokeStyle = colour; c.lineWidth = 1.6; c.beginPath();
      if (mark.shape === "dot") { c.arc(px, py, 3, 0, 7); c.fill(); }
      else { c.arc(px, py, 4.5, 0, 7); c.stroke(); }
    }
  }

  bars(mark) {
    const c = this.context; c.fillStyle = this.colours[mark.ink]; c.globalAlpha = 0.9;
    mark.x.forEach((x, k) => {
      if (missing(mark.y[k])) return;
      const a = this.y(mark.base), b = this.y(mark.y[k]), left = this.x(x - mark.half_width);
      c.fillRect(left, Math.min(a, b), this.x(x + mark.half_width) - left, Math.max(0.5, Math.abs(a - b)));
    });
    c.globalAlpha = 1;
  }

  strip(mark) {
    const c = this.context, left = this.x(mark.from);
    c.fillStyle = this.colours[mark.ink]; c.globalAlpha = 0.3;
    c.fillRect(left, this.box.top, Math.max(1, this.x(mark.to) - left), this.box.height); c.globalAlpha = 1;
  }

  upright(mark) { this.rule(this.colours.mark, [2, 3], [mark.at, this.low], [mark.at, this.high], 1); }

  level(mark) { const [a, b] = this.view.horizontal; this.rule(this.colours[mark.ink], [6, 4], [a, mark.at], [b, mark.at], 1.2); }

  rule(colour, dash, from, to, width) {
    const c = this.context; c.strokeStyle = colour; c.lineWidth = width; c.setLineDash(dash);
    c.beginPath(); c.moveTo(this.x(from[0]), this.y(from[1])); c.lineTo(this.x(to[0]), this.y(to[1])); c.stroke(); c.setLineDash([]);
  }

  label(mark) {
    const c = this.context; c.fillStyle = this.colours.dim; c.font = "12px system-ui, 'DejaVu Sans', sans-serif"; c.textAlign = "left"; c.textBaseline = "middle";
    c.fillText(mark.text, this.x(mark.x) + 7, this.y(mark.y));
  }
}
