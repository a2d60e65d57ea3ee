//! Figures over all events: how the error grows with severity, and where on the voltage axis the
//! residual lies.

use super::{
    decimate,
    event::{Power, padded},
    figure::{Figure, Ink, Mark, Panel, Shape},
    number,
};
use crate::identification::{Comparison, Judgement};

const WIDTH_PX: u32 = 620;
/// Residuals against voltage are thinned voltage by voltage, so that the few samples of a dip stay
/// while the many at rest do not fill the page.
const SCATTER_BINS: usize = 60;
const SCATTER_POINTS_PER_BIN_MAX: usize = 24;

/// Error to noise of every event against its lowest voltage.
pub(super) fn severity_ladder(judgement: &Judgement, comparisons: &[Comparison]) -> Figure {
    let rungs: Vec<_> = comparisons
        .iter()
        .map(|c| Rung::new(judgement, c))
        .collect();
    let horizontal = padded(extent(rungs.iter().map(|rung| rung.voltage)));
    let heights = rungs
        .iter()
        .flat_map(|rung| [rung.all, rung.away])
        .chain([0.0]);
    let vertical = padded(extent(heights));
    Figure {
        id: "severity".to_owned(),
        title: "Severity ladder".to_owned(),
        description: ladder_description(&rungs),
        width_px: WIDTH_PX,
        horizontal,
        horizontal_title: "lowest voltage over voltage before the event".to_owned(),
        counts: false,
        panels: vec![Panel {
            title: "Residual over noise, event part (1 = noise alone)".to_owned(),
            height_px: 300,
            vertical,
            logarithmic: true,
            marks: ladder_marks(&rungs),
        }],
    }
}

/// One event on the ladder; heights are decimal logarithms.
struct Rung {
    voltage: f64,
    all: f64,
    away: f64,
    held_out: bool,
    label: String,
}

impl Rung {
    fn new(judgement: &Judgement, comparison: &Comparison) -> Self {
        let errors = &comparison.errors;
        Self {
            voltage: errors.lowest_voltage,
            all: errors.error_to_noise.max(1e-3).log10(),
            away: errors.error_to_noise_away_from_edges.max(1e-3).log10(),
            held_out: judgement.role(&comparison.event) == "held out",
            label: short_name(&comparison.event),
        }
    }
}

fn ladder_marks(rungs: &[Rung]) -> Vec<Mark> {
    let mut marks = vec![Mark::Level {
        at: 0.0,
        ink: Ink::Onset,
    }];
    for rung in rungs.iter().filter(|rung| rung.voltage.is_finite()) {
        let ink = if rung.held_out {
            Ink::Model
        } else {
            Ink::Measured
        };
        let shape = if rung.held_out {
            Shape::Triangle
        } else {
            Shape::Dot
        };
        marks.push(Mark::Line {
            points: vec![(rung.voltage, rung.away), (rung.voltage, rung.all)],
            ink,
            width_quarter_px: 4,
        });
        marks.push(Mark::Points {
            points: vec![(rung.voltage, rung.all)],
            ink,
            shape: Shape::Ring,
            radius_quarter_px: 14,
        });
        marks.push(Mark::Points {
            points: vec![(rung.voltage, rung.away)],
            ink,
            shape,
            radius_quarter_px: if rung.held_out { 22 } else { 16 },
        });
        if rung.away.is_finite() {
            marks.push(Mark::Label {
                at: (rung.voltage, rung.away),
                text: rung.label.clone(),
            });
        }
    }
    marks
}

fn ladder_description(rungs: &[Rung]) -> String {
    let deepest = rungs
        .iter()
        .filter(|rung| rung.voltage.is_finite())
        .min_by(|a, b| a.voltage.total_cmp(&b.voltage));
    let deepest = deepest.map_or_else(String::new, |rung| {
        format!(
            " The deepest, {}, falls to {} and has {} away from edges.",
            rung.label,
            number::fixed(rung.voltage, 3),
            number::significant(10_f64.powf(rung.away), 3)
        )
    });
    format!(
        "Residual over noise of {} events against their lowest voltage: filled marks without the \
         samples near voltage edges, rings with them; dots fitted, triangles held out.{deepest}",
        rungs.len()
    )
}

/// `event_07` becomes `07`; anything else stays, cut to what fits beside a mark.
pub(super) fn short_name(event: &str) -> String {
    let tail = event.rsplit(['_', '/', '@']).next().unwrap_or(event);
    tail.chars().take(12).collect()
}

/// Residuals of P and Q of the event parts against voltage, away from edges.
pub(super) fn residual_against_voltage(id: &str, comparisons: &[&Comparison]) -> Figure {
    let voltages = comparisons
        .iter()
        .flat_map(|c| judged(c).map(|k| c.voltage_pu[k]));
    let horizontal = padded(extent(voltages));
    Figure {
        id: id.to_owned(),
        title: "Residual against voltage".to_owned(),
        description: format!(
            "Measured minus modelled power against the voltage at the same instant, event parts of \
             {} events, samples near voltage edges left out. The table below holds the means by \
             voltage.",
            comparisons.len()
        ),
        width_px: WIDTH_PX,
        horizontal,
        horizontal_title: "voltage V, pu".to_owned(),
        counts: false,
        panels: Power::BOTH
            .into_iter()
            .map(|power| scatter_panel(power, comparisons))
            .collect(),
    }
}

fn scatter_panel(power: Power, comparisons: &[&Comparison]) -> Panel {
    let mut points = Vec::new();
    for comparison in comparisons {
        let residual = power.residual(comparison);
        points.extend(judged(comparison).map(|k| (comparison.voltage_pu[k], residual[k])));
    }
    let (low, high) = extent(points.iter().map(|(_, residual)| *residual));
    let half = low.abs().max(high.abs());
    Panel {
        title: format!("Residual of {}, pu", power.letter()),
        height_px: 150,
        vertical: padded(if half.is_finite() {
            (-half, half)
        } else {
            (-1e-3, 1e-3)
        }),
        logarithmic: false,
        marks: vec![
            Mark::Level {
                at: 0.0,
                ink: Ink::Axis,
            },
            Mark::Points {
                points: thinned_by_voltage(&points),
                ink: Ink::Model,
                shape: Shape::Dot,
                radius_quarter_px: 7,
            },
        ],
    }
}

pub(super) fn thinned_by_voltage(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let (low, high) = extent(points.iter().map(|(voltage, _)| *voltage));
    let width = (high - low) / SCATTER_BINS as f64;
    let mut kept = Vec::new();
    for bin in 0..SCATTER_BINS {
        let from = low + bin as f64 * width;
        let last = bin + 1 == SCATTER_BINS;
        let inside: Vec<_> = (0..points.len())
            .filter(|&k| points[k].0 >= from && (points[k].0 < from + width || last))
            .collect();
        let chosen = decimate::thinned(&inside, SCATTER_POINTS_PER_BIN_MAX);
        kept.extend(chosen.into_iter().map(|k| points[k]));
    }
    kept
}

/// Means of the residuals by voltage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct VoltageBin {
    pub(super) from_pu: f64,
    pub(super) to_pu: f64,
    pub(super) samples: usize,
    /// Mean residual of P and of Q, pu.
    pub(super) mean_pu: [f64; 2],
    /// Root mean square residual of P and of Q, pu.
    pub(super) rms_pu: [f64; 2],
}

/// The same residuals by voltage, in at most `count` bins of one width; empty bins left out.
pub(super) fn voltage_bins(comparisons: &[&Comparison], count: usize) -> Vec<VoltageBin> {
    let mut samples = Vec::new();
    for comparison in comparisons {
        let residuals = Power::BOTH.map(|power| power.residual(comparison));
        samples.extend(
            judged(comparison)
                .map(|k| (comparison.voltage_pu[k], [residuals[0][k], residuals[1][k]])),
        );
    }
    let (low, high) = extent(samples.iter().map(|(voltage, _)| *voltage));
    let width = (high - low) / count as f64;
    (0..count)
        .filter_map(|bin| {
            let (from_pu, to_pu) = (low + bin as f64 * width, low + (bin + 1) as f64 * width);
            let last = bin + 1 == count;
            let within = samples
                .iter()
                .filter(|(v, _)| *v >= from_pu && (*v < to_pu || last));
            summed_up(from_pu, to_pu, &within.map(|(_, r)| *r).collect::<Vec<_>>())
        })
        .collect()
}

fn summed_up(from_pu: f64, to_pu: f64, residuals: &[[f64; 2]]) -> Option<VoltageBin> {
    if residuals.is_empty() {
        return None;
    }
    let count = residuals.len() as f64;
    let mean = |of: &dyn Fn(f64) -> f64| {
        [0, 1].map(|channel| residuals.iter().map(|r| of(r[channel])).sum::<f64>() / count)
    };
    Some(VoltageBin {
        from_pu,
        to_pu,
        samples: residuals.len(),
        mean_pu: mean(&|r| r),
        rms_pu: mean(&|r| r * r).map(f64::sqrt),
    })
}

/// Samples of the event part that are used, away from edges, and complete.
fn judged(comparison: &Comparison) -> impl Iterator<Item = usize> {
    (0..comparison.time_s.len()).filter(|&k| {
        comparison.time_s[k] >= 0.0
            && comparison.used[k]
            && !comparison.near_edge[k]
            && comparison.voltage_pu[k].is_finite()
            && comparison.active_measured_pu[k].is_finite()
            && comparison.reactive_measured_pu[k].is_finite()
    })
}

pub(super) fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        })
}

#[cfg(test)]
mod tests {
    use super::{super::fixture, *};

    #[test]
    fn the_ladder_has_a_rung_for_every_event_and_tells_held_out_ones_apart() {
        let comparisons = [
            fixture::comparison("event_01", 0.9),
            fixture::comparison("event_03", 0.6),
        ];
        let figure = severity_ladder(&fixture::judgement(), &comparisons);
        let triangles = figure.panels[0].marks.iter().filter(|mark| {
            matches!(
                mark,
                Mark::Points {
                    shape: Shape::Triangle,
                    ..
                }
            )
        });
        assert_eq!(triangles.count(), 1);
        assert!(
            figure
                .description
                .contains("The deepest, 03, falls to 0.600")
        );
        assert!(figure.markup().is_ok());
    }

    #[test]
    fn thinning_keeps_the_few_samples_of_a_dip() {
        let points: Vec<_> = (0..5000)
            .map(|k| {
                if k % 1000 == 7 {
                    (0.6, 0.5)
                } else {
                    (1.0, 0.0)
                }
            })
            .collect();
        let kept = thinned_by_voltage(&points);
        assert_eq!(kept.iter().filter(|(voltage, _)| *voltage < 0.9).count(), 5);
        assert!(kept.len() <= 5 + SCATTER_POINTS_PER_BIN_MAX);
    }

    #[test]
    fn bins_hold_every_judged_sample_once() {
        let comparison = fixture::comparison("event_01", 0.7);
        let bins = voltage_bins(&[&comparison], 10);
        let samples: usize = bins.iter().map(|bin| bin.samples).sum();
        assert_eq!(samples, judged(&comparison).count());
        assert_eq!(bins.len(), 2, "the fixture has two voltage levels");
    }

    #[test]
    fn figures_of_nothing_are_drawn() {
        let nothing = fixture::without_samples("none");
        assert!(residual_against_voltage("r", &[&nothing]).markup().is_ok());
        assert!(voltage_bins(&[&nothing], 10).is_empty());
        let judgement = fixture::judgement();
        assert!(severity_ladder(&judgement, &[nothing]).markup().is_ok());
        assert!(severity_ladder(&judgement, &[]).markup().is_ok());
    }
}
