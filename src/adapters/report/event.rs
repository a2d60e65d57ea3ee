//! The figure of one event: voltage, frequency, powers and residuals over one time axis, for the
//! whole window and for the seconds in which most happens.

use super::{
    axis::{Sets, clamped, cut_note, setting},
    decimate,
    figure::{Figure, Ink, Mark, Panel, Shape},
    number,
};
use crate::identification::Comparison;

/// Points per curve; above it a curve is drawn by its extremes.
const CURVE_POINTS_MAX: usize = 1500;
const FIGURE_WIDTH_PX: u32 = 620;
/// The close-up begins this long before the onset ...
const LEAD_S: f64 = 0.15;
/// ... ends this long after the last edge that follows another one within the same time ...
const TAIL_S: f64 = 0.6;
/// ... and is drawn only where it is shorter than this share of the window.
const CLOSE_UP_SHARE_MAX: f64 = 0.5;
/// Half-width of the noise band in standard deviations.
const NOISE_BAND_SIGMA: f64 = 2.0;

/// P or Q of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Power {
    Active,
    Reactive,
}

impl Power {
    pub(super) const BOTH: [Self; 2] = [Self::Active, Self::Reactive];

    pub(super) const fn letter(self) -> &'static str {
        match self {
            Self::Active => "P",
            Self::Reactive => "Q",
        }
    }

    pub(super) fn measured(self, comparison: &Comparison) -> &[f64] {
        match self {
            Self::Active => &comparison.active_measured_pu,
            Self::Reactive => &comparison.reactive_measured_pu,
        }
    }

    pub(super) fn model(self, comparison: &Comparison) -> &[f64] {
        match self {
            Self::Active => &comparison.active_model_pu,
            Self::Reactive => &comparison.reactive_model_pu,
        }
    }

    pub(super) fn noise(self, comparison: &Comparison) -> &[f64] {
        match self {
            Self::Active => &comparison.active_noise_pu,
            Self::Reactive => &comparison.reactive_noise_pu,
        }
    }

    /// Measured minus modelled, pu; NaN where the measurement is missing.
    pub(super) fn residual(self, comparison: &Comparison) -> Vec<f64> {
        self.measured(comparison)
            .iter()
            .zip(self.model(comparison))
            .map(|(measured, model)| measured - model)
            .collect()
    }
}

/// The figures of one event: the whole window, and a close-up where one shows more.
pub(super) fn figures(
    id: &str,
    comparison: &Comparison,
    rival: Option<&Comparison>,
) -> Vec<Figure> {
    let whole = whole_span(comparison);
    let mut figures = vec![figure(
        format!("{id}-whole"),
        "whole window",
        comparison,
        rival,
        whole,
    )];
    if let Some(span) = close_up_span(comparison, whole) {
        figures.push(figure(
            format!("{id}-close"),
            "close-up",
            comparison,
            rival,
            span,
        ));
    }
    figures
}

fn whole_span(comparison: &Comparison) -> (f64, f64) {
    let first = comparison.time_s.first().copied().unwrap_or(0.0);
    let last = comparison.time_s.last().copied().unwrap_or(1.0);
    (first, last.max(first + f64::EPSILON.sqrt()))
}

fn close_up_span(comparison: &Comparison, whole: (f64, f64)) -> Option<(f64, f64)> {
    let mut last_edge = 0.0;
    for (&time, &edge) in comparison.time_s.iter().zip(&comparison.near_edge) {
        if edge && time > last_edge && time < last_edge + TAIL_S {
            last_edge = time;
        }
    }
    let span = (whole.0.max(-LEAD_S), whole.1.min(last_edge + TAIL_S));
    (span.1 - span.0 < CLOSE_UP_SHARE_MAX * (whole.1 - whole.0)).then_some(span)
}

fn figure(
    id: String,
    view: &str,
    comparison: &Comparison,
    rival: Option<&Comparison>,
    span: (f64, f64),
) -> Figure {
    let seen = Seen::new(comparison, span);
    let mut panels = vec![
        input_panel(&seen, "Voltage V, pu", &comparison.voltage_pu),
        input_panel(&seen, "Frequency f, Hz", &comparison.frequency_hz),
    ];
    for power in Power::BOTH {
        panels.push(power_panel(&seen, power, rival));
        panels.push(residual_panel(&seen, power, rival));
    }
    Figure {
        id,
        title: format!("Event {}, {view}", comparison.event),
        description: description(comparison, span),
        width_px: FIGURE_WIDTH_PX,
        horizontal: span,
        horizontal_title: "time from onset, s".to_owned(),
        counts: false,
        panels,
    }
}

fn description(comparison: &Comparison, span: (f64, f64)) -> String {
    let errors = &comparison.errors;
    format!(
        "Six panels over time from {} s to {} s after the onset: voltage, frequency, active power \
         measured and modelled, its residual, reactive power measured and modelled, its residual. \
         Lowest voltage {} of the voltage before the event. Error of P {} percent, of Q {} percent; \
         residual over noise {}, away from voltage edges {}.",
        number::fixed(span.0, 2),
        number::fixed(span.1, 2),
        number::fixed(errors.lowest_voltage, 3),
        number::significant(errors.eps_p_percent, 3),
        number::significant(errors.eps_q_percent, 3),
        number::significant(errors.error_to_noise, 3),
        number::significant(errors.error_to_noise_away_from_edges, 3),
    )
}

/// The samples of a comparison that a figure shows.
struct Seen<'a> {
    comparison: &'a Comparison,
    /// Index of the first sample shown.
    first: usize,
    /// Index after the last.
    end: usize,
}

impl<'a> Seen<'a> {
    fn new(comparison: &'a Comparison, span: (f64, f64)) -> Self {
        let time = &comparison.time_s;
        Self {
            comparison,
            first: time.partition_point(|&t| t < span.0),
            end: time.partition_point(|&t| t <= span.1),
        }
    }

    /// The shown samples of `values`, thinned to what a curve needs, as `(time, index)`.
    fn points(&self, values: &[f64]) -> Vec<(f64, f64)> {
        let shown = self.shown(values);
        decimate::envelope(shown, CURVE_POINTS_MAX)
            .into_iter()
            .map(|k| (self.comparison.time_s[self.first + k], shown[k]))
            .collect()
    }

    fn shown<'b>(&self, values: &'b [f64]) -> &'b [f64] {
        values.get(self.first..self.end).unwrap_or(&[])
    }

    fn curve(&self, values: &[f64], ink: Ink, width_quarter_px: u32) -> Mark {
        Mark::Line {
            points: self.points(values),
            ink,
            width_quarter_px,
        }
    }

    /// Strips over runs of samples near an edge, and the onset.
    fn backdrop(&self) -> Vec<Mark> {
        let time = &self.comparison.time_s;
        let mut marks = Vec::new();
        let mut index = self.first;
        while index < self.end {
            let run = self.comparison.near_edge[index..self.end]
                .iter()
                .take_while(|edge| **edge)
                .count();
            if run > 0 {
                marks.push(Mark::Strip {
                    from: time[index],
                    to: time[index + run - 1],
                    ink: Ink::Edge,
                });
            }
            index += run.max(1);
        }
        marks.push(Mark::Upright {
            at: 0.0,
            ink: Ink::Onset,
        });
        marks
    }

    /// Lowest and highest finite value of the shown samples of every series.
    fn extent(&self, series: &[&[f64]]) -> (f64, f64) {
        series
            .iter()
            .flat_map(|values| self.shown(values))
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &v| {
                (low.min(v), high.max(v))
            })
    }
}

fn input_panel(seen: &Seen<'_>, title: &str, values: &[f64]) -> Panel {
    let mut marks = seen.backdrop();
    marks.push(seen.curve(values, Ink::Measured, 6));
    Panel {
        title: title.to_owned(),
        height_px: 90,
        vertical: padded(seen.extent(&[values])),
        logarithmic: false,
        marks,
    }
}

fn power_panel(seen: &Seen<'_>, power: Power, rival: Option<&Comparison>) -> Panel {
    let comparison = seen.comparison;
    let measured = power.measured(comparison);
    let mut series = vec![measured, power.model(comparison)];
    let sets = Sets::Powers.each(&comparison.used, &comparison.near_edge);
    let told = setting(measured, &sets);
    series[0] = &told;
    if let Some(rival) = rival {
        series.push(power.model(rival));
    }
    let vertical = padded(seen.extent(&series));
    let drawn = &clamped(measured, vertical);
    let mut marks = seen.backdrop();
    marks.push(seen.curve(drawn, Ink::Measured, 8));
    // Few enough samples to see one by one: show that the curve is made of them.
    if seen.end - seen.first <= 180 {
        marks.push(Mark::Points {
            points: seen.points(drawn),
            ink: Ink::Measured,
            shape: Shape::Dot,
            radius_quarter_px: 9,
        });
    }
    if let Some(rival) = rival {
        marks.push(seen.curve(power.model(rival), Ink::Rival, 5));
    }
    marks.push(seen.curve(power.model(comparison), Ink::Model, 6));
    marks.push(unused_points(seen, drawn));
    let title = match power {
        Power::Active => "Active power P, pu",
        Power::Reactive => "Reactive power Q, pu",
    };
    let note = cut_note(
        seen.shown(measured),
        seen.shown(&comparison.time_s),
        vertical,
    );
    Panel {
        title: format!("{title}{note}"),
        height_px: 170,
        vertical,
        logarithmic: false,
        marks,
    }
}

/// Measured samples that did not enter the fit for another reason than an edge.
fn unused_points(seen: &Seen<'_>, measured: &[f64]) -> Mark {
    let comparison = seen.comparison;
    let points = (seen.first..seen.end)
        .filter(|&k| !comparison.used[k] && !comparison.near_edge[k])
        .map(|k| (comparison.time_s[k], measured[k]))
        .collect();
    Mark::Points {
        points,
        ink: Ink::Unused,
        shape: Shape::Cross,
        radius_quarter_px: 14,
    }
}

fn residual_panel(seen: &Seen<'_>, power: Power, rival: Option<&Comparison>) -> Panel {
    let comparison = seen.comparison;
    let residual = power.residual(comparison);
    let rival_residual = rival.map(|rival| power.residual(rival));
    let half = residual_half_range(seen, power, &residual, rival_residual.as_deref());
    let mut marks = seen.backdrop();
    marks.push(noise_band(seen, power, half));
    marks.push(Mark::Level {
        at: 0.0,
        ink: Ink::Axis,
    });
    if let Some(values) = &rival_residual {
        marks.push(seen.curve(&clamped(values, (-half, half)), Ink::Rival, 5));
    }
    marks.push(seen.curve(&clamped(&residual, (-half, half)), Ink::Model, 6));
    Panel {
        title: format!(
            "Residual of {}, pu{}",
            power.letter(),
            cut_note(
                seen.shown(&residual),
                seen.shown(&comparison.time_s),
                (-half, half)
            )
        ),
        height_px: 96,
        vertical: (-half, half),
        logarithmic: false,
        marks,
    }
}

/// Residuals near edges may be far larger than all others, and would flatten them: they do not
/// set the axis. The noise band always fits twice.
fn residual_half_range(
    seen: &Seen<'_>,
    power: Power,
    residual: &[f64],
    rival: Option<&[f64]>,
) -> f64 {
    let comparison = seen.comparison;
    let noise = power.noise(comparison);
    let half = (seen.first..seen.end)
        .filter(|&k| Sets::Residuals.by(comparison.used[k], comparison.near_edge[k]))
        .flat_map(|k| {
            let other = rival.and_then(|values| values.get(k)).copied();
            [
                residual[k],
                2.0 * NOISE_BAND_SIGMA * noise[k],
                other.unwrap_or(0.0),
            ]
        })
        .filter(|reach| reach.is_finite())
        .fold(0.0, |half: f64, reach| half.max(reach.abs()));
    if half > 0.0 { 1.1 * half } else { 1e-3 }
}

fn noise_band(seen: &Seen<'_>, power: Power, half: f64) -> Mark {
    let noise = power.noise(seen.comparison);
    let points = seen
        .points(noise)
        .into_iter()
        .filter(|(_, sigma)| sigma.is_finite())
        .map(|(time, sigma)| {
            let reach = (NOISE_BAND_SIGMA * sigma).min(half);
            (time, -reach, reach)
        })
        .collect();
    Mark::Band {
        points,
        ink: Ink::Noise,
    }
}

/// A range with air above and below; of some width even for a constant or for nothing at all.
pub(super) fn padded((low, high): (f64, f64)) -> (f64, f64) {
    if low > high {
        return (0.0, 1.0);
    }
    let air = (0.08 * (high - low))
        .max(1e-3 * low.abs().max(high.abs()))
        .max(1e-6);
    (low - air, high + air)
}

#[cfg(test)]
mod tests {
    use super::{super::fixture, *};

    #[test]
    fn an_event_is_shown_whole_and_close_up_over_one_axis_per_view() {
        let comparison = fixture::comparison("event_01", 0.7);
        let figures = figures("e1", &comparison, None);
        assert_eq!(figures.len(), 2);
        assert_eq!(figures[0].panels.len(), 6);
        let (from, to) = figures[1].horizontal;
        assert!(from < 0.0 && to > 0.1 && to - from < 2.0, "{from} to {to}");
    }

    #[test]
    fn edges_do_not_set_the_residual_axis_and_the_cut_is_told() {
        let mut comparison = fixture::comparison("event_01", 0.7);
        let edge = comparison.near_edge.iter().position(|e| *e).unwrap();
        comparison.active_measured_pu[edge] += 5.0;
        let figures = figures("e1", &comparison, None);
        let panel = &figures[0].panels[3];
        assert!(panel.vertical.1 < 0.5, "{:?}", panel.vertical);
        assert!(panel.title.contains("cut off; 5.0 at"), "{}", panel.title);
    }

    #[test]
    fn an_event_without_a_single_number_is_still_drawn() {
        let mut comparison = fixture::comparison("empty", 0.7);
        comparison.active_measured_pu.fill(f64::NAN);
        comparison.voltage_pu.fill(f64::NAN);
        for figure in figures("e1", &comparison, None) {
            assert!(figure.markup().is_ok());
        }
    }

    #[test]
    fn an_event_without_samples_is_still_drawn() {
        let comparison = fixture::without_samples("none");
        for figure in figures("e1", &comparison, None) {
            assert!(figure.markup().is_ok());
        }
    }
}
