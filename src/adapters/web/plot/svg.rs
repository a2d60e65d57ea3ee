//! A chart as an inline `<svg>`: what is seen before the script has come, or without it.

use std::fmt::Write;

use maud::{Markup, PreEscaped, html};

use super::{
    Chart, Ink, Mark, Panel, Shape,
    scale::{logarithmic_ticks, ticks},
    table,
};
use crate::adapters::report::{decimate::envelope, number};

/// Width of the drawing in its own units; the page scales it.
const WIDTH: f64 = 960.0;
const LEFT: f64 = 64.0;
const RIGHT: f64 = 14.0;
/// Room for the title of a panel.
const HEAD: f64 = 24.0;
/// Room for the horizontal axis with names of one line, and for each further line.
const FOOT: f64 = 40.0;
const LINE: f64 = 14.0;
/// Characters of one line of a name.
const NAME_CHARACTERS: usize = 14;
/// Points of one curve at most; above it a curve is drawn by its extremes.
const POINTS_MAX: usize = 1500;
/// Steps of the colour that tells a point's time.
const SHADES: f64 = 7.0;

/// The chart with its legend and the numbers behind it. `source` is where the script finds the
/// chart's numbers; none leaves the drawing as it is.
pub(in super::super) fn figure(chart: &Chart, source: Option<&str>) -> Markup {
    let (title_id, description_id) = (format!("{}-title", chart.id), format!("{}-desc", chart.id));
    html! {
        figure.chart id=(chart.id) data-source=[source] {
            figcaption { span.chart-title { (chart.title) } (legend(chart)) }
            div.plot tabindex="0" role="group" aria-label=(chart.title) {
                svg viewBox={ "0 0 " (WIDTH) " " (height(chart)) } role="img"
                    aria-labelledby={ (title_id) " " (description_id) } {
                    title id=(title_id) { (chart.title) }
                    desc id=(description_id) { (chart.description) }
                    (PreEscaped(drawing(chart)))
                }
            }
            details { summary { "Numbers behind this chart" } (table::tables(chart)) }
        }
    }
}

/// Whether scripts will ask for the numbers of a figure of this page.
pub(in super::super) fn has_figure(page: &Markup) -> bool {
    page.0.contains(" data-source=\"")
}

fn legend(chart: &Chart) -> Markup {
    html! {
        span.legend {
            @for (name, ink) in chart.legend() {
                span.key { i class={ "swatch ink-" (ink.name()) } {} (name) }
            }
        }
    }
}

fn height(chart: &Chart) -> f64 {
    let panels: f64 = chart
        .panels
        .iter()
        .map(|p| f64::from(p.height) + HEAD)
        .sum();
    panels + FOOT + LINE * (name_lines(chart) - 1) as f64
}

/// From data to drawing coordinates within one panel.
struct Frame<'a> {
    chart: &'a Chart,
    panel: &'a Panel,
    top: f64,
}

impl Frame<'_> {
    fn x(&self, value: f64) -> f64 {
        let (low, high) = self.chart.horizontal;
        LEFT + (value - low) / (high - low) * (WIDTH - LEFT - RIGHT)
    }

    fn y(&self, value: f64) -> f64 {
        let (low, high) = self.panel.vertical;
        self.top + (high - value) / (high - low) * f64::from(self.panel.height)
    }

    fn bottom(&self) -> f64 {
        self.top + f64::from(self.panel.height)
    }
}

fn drawing(chart: &Chart) -> String {
    let mut out = String::new();
    let mut top = 0.0;
    for (index, panel) in chart.panels.iter().enumerate() {
        let frame = Frame {
            chart,
            panel,
            top: top + HEAD,
        };
        let last = index + 1 == chart.panels.len();
        axes(&mut out, &frame, last);
        let clip = format!("{}-{index}", chart.id);
        add(
            &mut out,
            format_args!(
                "<clipPath id=\"{clip}\"><rect x=\"{LEFT}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{}\"/></clipPath><g clip-path=\"url(#{clip})\">",
                frame.top,
                WIDTH - LEFT - RIGHT,
                panel.height,
            ),
        );
        for behind in [true, false] {
            for mark in panel.marks.iter().filter(|m| m.lies_behind() == behind) {
                draw(&mut out, &frame, mark);
            }
        }
        out.push_str("</g>");
        top += f64::from(panel.height) + HEAD;
    }
    out
}

/// Writing into a string cannot fail.
fn add(out: &mut String, words: std::fmt::Arguments<'_>) {
    let _infallible = out.write_fmt(words);
}

fn text(out: &mut String, (x, y): (f64, f64), class: &str, words: &str) {
    let words = html! { (words) }.into_string();
    add(
        out,
        format_args!("<text x=\"{x:.1}\" y=\"{y:.1}\" class=\"{class}\">{words}</text>"),
    );
}

fn axes(out: &mut String, frame: &Frame<'_>, last: bool) {
    let (chart, panel) = (frame.chart, frame.panel);
    text(out, (LEFT, frame.top - 8.0), "panel-title", &panel.title);
    let count = (panel.height / 30).clamp(3, 7);
    let (values, decimals) = if panel.logarithmic {
        (logarithmic_ticks(panel.vertical, count), 0)
    } else {
        ticks(panel.vertical, count)
    };
    for value in values {
        let y = frame.y(value);
        add(
            out,
            format_args!(
                "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{:.1}\"/>",
                WIDTH - RIGHT,
            ),
        );
        let label = if panel.logarithmic {
            number::short(number_at(value))
        } else {
            number::fixed(value, decimals)
        };
        text(out, (LEFT - 6.0, y + 4.0), "tick end", &label);
    }
    let (values, decimals) = horizontal_ticks(chart);
    for value in values {
        let x = frame.x(value);
        add(
            out,
            format_args!(
                "<path class=\"grid\" d=\"M{x:.1} {:.1}V{:.1}\"/>",
                frame.top,
                frame.bottom(),
            ),
        );
        if last {
            let label = named(chart, value).unwrap_or_else(|| number::fixed(value, decimals));
            for (place, line) in lines(&label).iter().enumerate() {
                let y = frame.bottom() + 17.0 + LINE * place as f64;
                text(out, (x, y), "tick middle", line);
            }
        }
    }
    add(
        out,
        format_args!(
            "<path class=\"axis\" d=\"M{LEFT} {:.1}V{:.1}H{:.1}\"/>",
            frame.top,
            frame.bottom(),
            WIDTH - RIGHT,
        ),
    );
    if last {
        let middle = f64::midpoint(LEFT, WIDTH - RIGHT);
        text(
            out,
            (
                middle,
                frame.bottom() + 35.0 + LINE * (name_lines(chart) - 1) as f64,
            ),
            "axis-title middle",
            &chart.horizontal_title,
        );
    }
}

/// What stands at a place of a logarithmic axis, without the last digits' rounding.
fn number_at(logarithm: f64) -> f64 {
    let value = 10_f64.powf(logarithm);
    let digit = 10_f64.powf(logarithm.floor() - 2.0);
    (value / digit).round() * digit
}

/// A name in lines of at most about `NAME_CHARACTERS` characters, broken between words.
fn lines(name: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in name.split(' ') {
        match lines.last_mut() {
            Some(line) if line.len() + word.len() < NAME_CHARACTERS => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Lines of the longest name; 1 where the axis has numbers.
fn name_lines(chart: &Chart) -> usize {
    let counts = chart.names.iter().map(|name| lines(name).len());
    counts.max().unwrap_or(1)
}

fn horizontal_ticks(chart: &Chart) -> (Vec<f64>, usize) {
    if chart.names.is_empty() {
        ticks(chart.horizontal, 9)
    } else {
        ((0..chart.names.len()).map(|k| k as f64).collect(), 0)
    }
}

fn named(chart: &Chart, value: f64) -> Option<String> {
    let place = (0..chart.names.len()).find(|&k| (k as f64 - value).abs() < 0.5)?;
    chart.names.get(place).cloned()
}

#[allow(clippy::too_many_lines, reason = "one arm for each mark")]
fn draw(out: &mut String, frame: &Frame<'_>, mark: &Mark) {
    match mark {
        Mark::Line {
            ink, x, y, dashed, ..
        } => {
            let dashes = if *dashed { " dashed" } else { "" };
            let path = curve(frame, frame.chart.x_of(x.as_ref()), y);
            add(
                out,
                format_args!(
                    "<path class=\"line ink-{}{dashes}\" d=\"{path}\"/>",
                    ink.name()
                ),
            );
        }
        Mark::Points {
            ink,
            shape,
            x,
            y,
            shade,
            ..
        } => {
            let x = frame.chart.x_of(x.as_ref());
            points(out, frame, (*ink, *shape), (x, y, shade.as_deref()));
        }
        Mark::Band {
            ink, x, low, high, ..
        } => {
            let path = band(frame, frame.chart.x_of(x.as_ref()), low, high);
            add(
                out,
                format_args!("<path class=\"band ink-{}\" d=\"{path}\"/>", ink.name()),
            );
        }
        Mark::Bars {
            ink,
            x,
            y,
            base,
            half_width,
            ..
        } => {
            for (&x, &y) in x.iter().zip(y).filter(|(_, y)| y.is_finite()) {
                let (a, b) = (frame.y(*base), frame.y(y));
                let (left, right) = (frame.x(x - half_width), frame.x(x + half_width));
                add(
                    out,
                    format_args!(
                        "<rect class=\"bar ink-{}\" x=\"{left:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\"/>",
                        ink.name(),
                        a.min(b),
                        right - left,
                        (a - b).abs().max(0.5),
                    ),
                );
            }
        }
        Mark::Strip { from, to, ink, .. } => {
            let (left, right) = (frame.x(*from), frame.x(*to));
            add(
                out,
                format_args!(
                    "<rect class=\"strip ink-{}\" x=\"{left:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{}\"/>",
                    ink.name(),
                    frame.top,
                    (right - left).max(1.0),
                    frame.panel.height,
                ),
            );
        }
        Mark::Upright { at } => add(
            out,
            format_args!(
                "<path class=\"upright\" d=\"M{:.1} {:.1}V{:.1}\"/>",
                frame.x(*at),
                frame.top,
                frame.bottom(),
            ),
        ),
        Mark::Level { at, ink, .. } => add(
            out,
            format_args!(
                "<path class=\"level ink-{}\" d=\"M{LEFT} {:.1}H{:.1}\"/>",
                ink.name(),
                frame.y(*at),
                WIDTH - RIGHT,
            ),
        ),
        Mark::Label { x, y, text: words } => {
            text(out, (frame.x(*x) + 7.0, frame.y(*y) + 4.0), "label", words);
        }
    }
}

/// The path of a curve, broken where a value is missing.
fn curve(frame: &Frame<'_>, x: &[f64], y: &[f64]) -> String {
    let mut path = String::new();
    let mut pen_down = false;
    for k in envelope(y, POINTS_MAX) {
        let Some(&x) = x.get(k).filter(|_| y[k].is_finite()) else {
            pen_down = false;
            continue;
        };
        let letter = if pen_down { 'L' } else { 'M' };
        add(
            &mut path,
            format_args!("{letter}{:.1} {:.1}", frame.x(x), frame.y(y[k])),
        );
        pen_down = true;
    }
    path
}

fn band(frame: &Frame<'_>, x: &[f64], low: &[f64], high: &[f64]) -> String {
    let mut path = String::new();
    let kept = envelope(high, POINTS_MAX);
    let finite = |k: &usize| {
        x.get(*k).is_some() && low.get(*k).is_some_and(|v| v.is_finite()) && high[*k].is_finite()
    };
    let there = kept.iter().filter(|k| finite(k)).map(|&k| (x[k], high[k]));
    let back = kept
        .iter()
        .rev()
        .filter(|k| finite(k))
        .map(|&k| (x[k], low[k]));
    for (index, (x, y)) in there.chain(back).enumerate() {
        let letter = if index == 0 { 'M' } else { 'L' };
        add(
            &mut path,
            format_args!("{letter}{:.1} {:.1}", frame.x(x), frame.y(y)),
        );
    }
    if !path.is_empty() {
        path.push('Z');
    }
    path
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the steps of the colour in the same expression"
)]
fn points(
    out: &mut String,
    frame: &Frame<'_>,
    (ink, shape): (Ink, Shape),
    (x, y, shade): (&[f64], &[f64], Option<&[f64]>),
) {
    for k in envelope(y, POINTS_MAX) {
        let Some(&x) = x.get(k).filter(|x| x.is_finite() && y[k].is_finite()) else {
            continue;
        };
        let (x, y) = (frame.x(x), frame.y(y[k]));
        let class = shade.and_then(|shade| shade.get(k)).map_or_else(
            || format!("ink-{}", ink.name()),
            |s| format!("shade-{}", (s * SHADES).round().clamp(0.0, SHADES) as usize),
        );
        match shape {
            Shape::Dot => add(
                out,
                format_args!("<circle class=\"dot {class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\"/>"),
            ),
            Shape::Ring => add(
                out,
                format_args!(
                    "<circle class=\"ring {class}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4.5\"/>",
                ),
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_escaped_and_a_gap_breaks_the_curve() {
        let markup = figure(&super::super::example(), Some("/x.json")).into_string();
        assert!(
            !markup.contains("<script>") && !markup.contains("<b>"),
            "{markup}"
        );
        let line = markup
            .split("class=\"line ink-measured\" d=\"")
            .nth(1)
            .unwrap();
        let path = line.split('"').next().unwrap();
        assert_eq!(path.matches('M').count(), 2, "{path}");
    }

    #[test]
    fn a_drawing_carries_no_style_attribute() {
        let markup = figure(&super::super::example(), None).into_string();
        assert!(
            !markup.contains("style="),
            "the page's policy forbids it: {markup}"
        );
    }
}
