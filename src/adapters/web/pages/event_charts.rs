//! The charts of an event.

use super::{
    super::plot::{Chart, Ink, Mark, Panel, Shape, padded, span_of},
    event_view::{Drawn, EventPage},
    failure_charts,
};
use crate::{
    adapters::report::axis::{Sets, beyond, clamped, cut_note, setting},
    disturbance::Window,
    identification::{
        Comparison,
        intake::{IntakeOptions, prepare},
    },
    measurement::Sample,
};

/// Half-width of the noise band in standard deviations.
const NOISE_BAND_SIGMA: f64 = 2.0;
/// Least height of the axes, so that noise on a constant does not fill them: pu and Hz.
const LEAST_PU: f64 = 0.004;
const LEAST_HZ: f64 = 0.02;

/// P or Q.
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

    pub(super) const fn title(self) -> &'static str {
        match self {
            Self::Active => "Active power P, pu",
            Self::Reactive => "Reactive power Q, pu",
        }
    }

    pub(super) fn model(self, comparison: &Comparison) -> &[f64] {
        match self {
            Self::Active => &comparison.active_model_pu,
            Self::Reactive => &comparison.reactive_model_pu,
        }
    }

    pub(super) fn measured(self, comparison: &Comparison) -> &[f64] {
        match self {
            Self::Active => &comparison.active_measured_pu,
            Self::Reactive => &comparison.reactive_measured_pu,
        }
    }

    fn noise(self, comparison: &Comparison) -> &[f64] {
        match self {
            Self::Active => &comparison.active_noise_pu,
            Self::Reactive => &comparison.reactive_noise_pu,
        }
    }

    /// Measured minus modelled, pu; NaN where the measurement is missing.
    pub(super) fn residual(self, comparison: &Comparison) -> Vec<f64> {
        let pairs = self.measured(comparison).iter().zip(self.model(comparison));
        pairs.map(|(measured, model)| measured - model).collect()
    }

    fn of(self, sample: &Sample) -> f64 {
        match self {
            Self::Active => sample.active_pu,
            Self::Reactive => sample.reactive_pu,
        }
    }
}

/// Name in the legend of what lies beyond an axis.
const CUT_OFF: &str = "beyond the axis: not used, or near an edge";

/// Values over time, and how they are drawn.
pub(super) type Series<'a> = (&'a [f64], &'a dyn Fn(Vec<f64>) -> Mark);

/// A panel whose axis is set by the samples that `sets` names, of every series; what lies beyond it
/// is drawn at its end, marked, and told in the title.
pub(super) struct Told<'a> {
    /// The horizontal axis, s.
    pub(super) time_s: &'a [f64],
    /// Whether each sample sets the axis.
    pub(super) sets: &'a [bool],
    /// Least height of the axis.
    pub(super) least: f64,
}

impl Told<'_> {
    /// A panel of series, the measured one or the residual first: its cut is told in the title.
    /// `behind` lies behind them, and `reach` is on the axis whatever they are.
    pub(super) fn panel(
        &self,
        (title, height): (String, u32),
        (behind, reach): (Vec<Mark>, &[f64]),
        series: &[Series<'_>],
    ) -> Panel {
        let mut told = reach.to_vec();
        for (values, _) in series {
            told.extend(setting(values, self.sets));
        }
        let vertical = padded(span_of(&told), self.least);
        let mut marks = behind;
        let mut cut: Vec<(f64, f64)> = Vec::new();
        for (values, mark) in series {
            let drawn = clamped(values, vertical);
            for k in beyond(values, vertical) {
                cut.extend(self.time_s.get(k).map(|&time| (time, drawn[k])));
            }
            marks.push(mark(drawn));
        }
        if !cut.is_empty() {
            let (x, y) = cut.into_iter().unzip();
            marks.push(Mark::Points {
                name: CUT_OFF.to_owned(),
                ink: Ink::Unused,
                shape: Shape::Ring,
                x: Some(x),
                y,
                shade: None,
            });
        }
        let first = series.first().map_or(&[][..], |(values, _)| values);
        let note = cut_note(first, self.time_s, vertical);
        Panel {
            title: format!("{title}{note}"),
            height,
            vertical,
            logarithmic: false,
            marks,
        }
    }
}

/// Every chart of the page, in its order.
pub(super) fn charts(page: &EventPage) -> Vec<Chart> {
    let Some(window) = &page.window else {
        return Vec::new();
    };
    let mut charts = vec![over_time(page, window)];
    if let Some(model) = &page.model {
        charts.push(against_voltage(model));
        if let Some(failure) = &model.judged.failure {
            let rival = page
                .rival
                .as_ref()
                .and_then(|rival| rival.judged.failure.as_ref());
            charts.push(failure_charts::segments(
                &failure.segments,
                rival.map(|f| &f.segments[..]),
            ));
            charts.extend(failure_charts::cross_correlation(
                &failure.cross_correlations,
            ));
        }
    }
    charts
}

fn time_of(window: &Window) -> Vec<f64> {
    let onset = window.onset as f64;
    (0..window.record.samples.len())
        .map(|k| (k as f64 - onset) / window.record.rate_fps)
        .collect()
}

fn channel(window: &Window, value: impl Fn(&Sample) -> f64) -> Vec<f64> {
    let samples = window.record.samples.iter();
    samples
        .map(|s| if s.usable() { value(s) } else { f64::NAN })
        .collect()
}

fn over_time(page: &EventPage, window: &Window) -> Chart {
    // The model's clock begins at its own onset: the edge it found, not where the trigger stood.
    let x = page
        .model
        .as_ref()
        .map_or_else(|| time_of(window), |m| m.comparison().time_s.clone());
    let backdrop = backdrop(page.model.as_ref().map(Drawn::comparison));
    let input = |title: &str, y: Vec<f64>, least: f64| Panel {
        title: title.to_owned(),
        height: 110,
        vertical: padded(span_of(&y), least),
        logarithmic: false,
        marks: [backdrop.clone(), vec![line("measured", Ink::Measured, y)]].concat(),
    };
    let mut panels = vec![
        input("Voltage V, pu", channel(window, |s| s.voltage_pu), LEAST_PU),
        input(
            "Frequency f, Hz",
            channel(window, |s| s.frequency_hz),
            LEAST_HZ,
        ),
    ];
    for power in Power::BOTH {
        panels.push(power_panel(page, window, power, &backdrop));
        if let Some(model) = &page.model {
            panels.push(residual_panel(
                named(model),
                page.rival.as_ref().map(named),
                power,
                &backdrop,
            ));
        }
    }
    let horizontal = (
        x.first().copied().unwrap_or(0.0),
        x.last().copied().unwrap_or(1.0),
    );
    Chart {
        id: "over-time".to_owned(),
        title: "Measurement and model over time".to_owned(),
        description: description(page),
        horizontal_title: "time from onset, s".to_owned(),
        horizontal,
        names: Vec::new(),
        x,
        linked: Some("time"),
        panels,
    }
}

fn description(page: &EventPage) -> String {
    let lowest = page.summary.lowest_voltage_pu;
    let base = format!(
        "Voltage, frequency, active and reactive power over time. Lowest voltage {lowest:.3} per unit."
    );
    page.model.as_ref().map_or(base.clone(), |model| {
        let errors = &model.comparison().errors;
        format!(
            "{base} With the model {} and what is left between them; error of P {:.2} percent, of Q {:.2} percent, {:.1} times the noise.",
            model.model.label, errors.eps_p_percent, errors.eps_q_percent, errors.error_to_noise,
        )
    })
}

fn line(name: &str, ink: Ink, y: Vec<f64>) -> Mark {
    Mark::Line {
        name: name.to_owned(),
        ink,
        x: None,
        y,
        dashed: false,
    }
}

fn dashed(name: &str, ink: Ink, y: Vec<f64>) -> Mark {
    Mark::Line {
        name: name.to_owned(),
        ink,
        x: None,
        y,
        dashed: true,
    }
}

/// The onset, and strips where samples lie near a voltage edge.
pub(super) fn backdrop(model: Option<&Comparison>) -> Vec<Mark> {
    let mut marks = vec![Mark::Upright { at: 0.0 }];
    let Some(comparison) = model else {
        return marks;
    };
    let time = &comparison.time_s;
    let mut index = 0;
    while index < time.len() {
        let run = comparison.near_edge[index..]
            .iter()
            .take_while(|near| **near)
            .count();
        if run > 0 {
            let (from, to) = (time[index], time[index + run - 1]);
            marks.push(Mark::Strip {
                name: "near an edge, not judged".to_owned(),
                from,
                to,
                ink: Ink::Edge,
            });
        }
        index += run.max(1);
    }
    marks
}

fn power_panel(page: &EventPage, window: &Window, power: Power, backdrop: &[Mark]) -> Panel {
    let measured = channel(window, |s| power.of(s));
    let (time_s, sets) = match &page.model {
        Some(model) => (
            model.comparison().time_s.clone(),
            powers(model.comparison()),
        ),
        None => (time_of(window), fitted(window)),
    };
    let told = Told {
        time_s: &time_s,
        sets: &sets,
        least: LEAST_PU,
    };
    let draw_measured = |y| line("measured", Ink::Measured, y);
    let mut series: Vec<Series<'_>> = vec![(&measured, &draw_measured)];
    let draw_rival = |y| {
        let label = page.rival.as_ref().map_or("", |rival| &rival.model.label);
        dashed(label, Ink::Rival, y)
    };
    if let Some(rival) = &page.rival {
        series.push((power.model(rival.comparison()), &draw_rival));
    }
    let draw_model = |y| {
        let label = page.model.as_ref().map_or("", |model| &model.model.label);
        line(label, Ink::Model, y)
    };
    if let Some(model) = &page.model {
        series.push((power.model(model.comparison()), &draw_model));
    }
    let head = (power.title().to_owned(), 200);
    told.panel(head, (backdrop.to_vec(), &[]), &series)
}

/// Which samples set the axis of powers.
pub(super) fn powers(comparison: &Comparison) -> Vec<bool> {
    Sets::Powers.each(&comparison.used, &comparison.near_edge)
}

/// The same where there is no model: as a fit would use the samples. None known, all of them.
fn fitted(window: &Window) -> Vec<bool> {
    prepare(window, &IntakeOptions::default()).map_or_else(
        |_| Vec::new(),
        |event| Sets::Powers.each(&event.used, &event.near_edge),
    )
}

/// A model beside the measurement, and its name in the legend.
pub(super) type Named<'a> = (&'a str, &'a Comparison);

fn named(drawn: &Drawn) -> Named<'_> {
    (&drawn.model.label, drawn.comparison())
}

/// What a model leaves within the band of the noise, beside what another one leaves.
pub(super) fn residual_panel(
    (name, comparison): Named<'_>,
    rival: Option<Named<'_>>,
    power: Power,
    backdrop: &[Mark],
) -> Panel {
    let half: Vec<f64> = power
        .noise(comparison)
        .iter()
        .map(|noise| NOISE_BAND_SIGMA * noise)
        .collect();
    let residual = power.residual(comparison);
    let of_rival = rival.map(|(_, comparison)| power.residual(comparison));
    let sets = Sets::Residuals.each(&comparison.used, &comparison.near_edge);
    let told = Told {
        time_s: &comparison.time_s,
        sets: &sets,
        least: LEAST_PU,
    };
    let draw = |y| line(name, Ink::Model, y);
    let draw_rival = |y| dashed(rival.map_or("", |(name, _)| name), Ink::Rival, y);
    let mut series: Vec<Series<'_>> = vec![(&residual, &draw)];
    if let Some(values) = &of_rival {
        series.push((values, &draw_rival));
    }
    let reach: Vec<f64> = half.iter().flat_map(|&half| [half, -half]).collect();
    let mut behind = backdrop.to_vec();
    behind.push(Mark::Band {
        name: "noise, two standard deviations".to_owned(),
        ink: Ink::Noise,
        x: None,
        low: half.iter().map(|half| -half).collect(),
        high: half,
    });
    let title = format!("{} measured minus model, pu", power.letter());
    told.panel((title, 100), (behind, &reach), &series)
}

/// Residuals against voltage: dark early, bright late.
fn against_voltage(model: &Drawn) -> Chart {
    let comparison = model.comparison();
    let kept: Vec<usize> = (0..comparison.time_s.len())
        .filter(|&k| comparison.time_s[k] >= 0.0 && comparison.used[k] && !comparison.near_edge[k])
        .collect();
    let last = comparison
        .time_s
        .last()
        .copied()
        .unwrap_or(1.0)
        .max(f64::MIN_POSITIVE);
    let pick = |values: &[f64]| kept.iter().map(|&k| values[k]).collect::<Vec<f64>>();
    let x = pick(&comparison.voltage_pu);
    // The first second holds most of what happens: the root spreads it over half of the colours.
    let shade: Vec<f64> = kept
        .iter()
        .map(|&k| (comparison.time_s[k] / last).sqrt())
        .collect();
    let panels = Power::BOTH.map(|power| {
        let y = pick(&power.residual(comparison));
        Panel {
            title: format!(
                "{} measured minus model, pu (dark at the onset, bright at the end)",
                power.letter()
            ),
            height: 170,
            vertical: padded(span_of(&y), LEAST_PU),
            logarithmic: false,
            marks: vec![
                Mark::Level {
                    name: String::new(),
                    ink: Ink::Unused,
                    at: 0.0,
                },
                Mark::Points {
                    name: String::new(),
                    ink: Ink::Model,
                    shape: Shape::Dot,
                    x: None,
                    y,
                    shade: Some(shade.clone()),
                },
            ],
        }
    });
    Chart {
        id: "against-voltage".to_owned(),
        title: "What is left, against voltage".to_owned(),
        description: "Residual of P and of Q from the onset on against voltage, away from voltage \
                      edges; the colour goes from dark at the onset to bright at the end."
            .to_owned(),
        horizontal_title: "voltage, pu".to_owned(),
        horizontal: padded(span_of(&x), LEAST_PU),
        names: Vec::new(),
        x,
        linked: None,
        panels: panels.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::report::fixture;

    #[test]
    fn a_bad_sample_does_not_set_the_axis_and_is_marked_at_its_end() {
        let mut comparison = fixture::comparison("event_01", 0.7);
        let at = comparison.time_s.len() - 5;
        comparison.used[at] = false;
        comparison.near_edge[at] = false;
        comparison.active_measured_pu[at] = 9.0;
        let sets = powers(&comparison);
        let told = Told {
            time_s: &comparison.time_s,
            sets: &sets,
            least: LEAST_PU,
        };
        let measured = |y| line("measured", Ink::Measured, y);
        let values = &comparison.active_measured_pu[..];
        let powers = told.panel(
            ("P".to_owned(), 9),
            (Vec::new(), &[]),
            &[(values, &measured)],
        );
        let residual = residual_panel(("model", &comparison), None, Power::Active, &[]);
        for panel in [powers, residual] {
            let (_, high) = panel.vertical;
            assert!(high < 3.0, "{:?}", panel.vertical);
            assert!(panel.title.contains("cut off; "), "{}", panel.title);
            let marked = panel.marks.iter().any(|mark| match mark {
                Mark::Points { name, y, .. } => name == CUT_OFF && y.contains(&high),
                _ => false,
            });
            assert!(marked, "{:?}", panel.marks);
        }
    }
}
