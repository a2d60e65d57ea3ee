//! The staircase: structure after structure, and what the error does.

use super::{
    event::padded,
    figure::{Figure, Ink, Mark, Panel, Shape},
    overview::extent,
};
use crate::{
    diagnosis::{Improvement, ImprovementStep},
    identification::ErrorSummary,
};

const WIDTH_PX: u32 = 760;

/// Error over noise after every step on the three sets of events, with the noise floor.
pub(super) fn staircase(improvement: &Improvement) -> Figure {
    let steps = &improvement.steps;
    let floor = improvement.last.noise_floor.max(1e-3).log10();
    let mut marks = vec![Mark::Level {
        at: floor,
        ink: Ink::Onset,
    }];
    let mut heights = vec![floor];
    for (of, ink, shape, radius_quarter_px) in SETS {
        let points: Vec<(f64, f64)> = (steps.iter().enumerate())
            .filter_map(|(k, step)| Some((k as f64, height(of(step)?))))
            .collect();
        heights.extend(points.iter().map(|point| point.1));
        marks.push(Mark::Line {
            points: stairs(&points),
            ink,
            width_quarter_px: 6,
        });
        marks.push(Mark::Points {
            points,
            ink,
            shape,
            radius_quarter_px,
        });
    }
    for (k, step) in steps.iter().enumerate() {
        marks.push(Mark::Label {
            at: (k as f64, height(step.errors.quoted())),
            text: step_in_words(step, k == 0),
        });
    }
    let (low, high) = padded(extent(heights.into_iter()));
    Figure {
        id: "staircase".to_owned(),
        title: "Staircase".to_owned(),
        description: description(steps),
        width_px: WIDTH_PX,
        horizontal: (-0.4, (steps.len() as f64 - 0.2).max(0.8)),
        horizontal_title: "step".to_owned(),
        counts: true,
        panels: vec![Panel {
            title: "Error over noise, event parts".to_owned(),
            height_px: 300,
            // Room for labels above and below.
            vertical: (low - 0.12 * (high - low), high + 0.12 * (high - low)),
            logarithmic: true,
            marks,
        }],
    }
}

type Chosen = fn(&ImprovementStep) -> Option<&ErrorSummary>;
/// Fitted, gate, untouched.
const SETS: [(Chosen, Ink, Shape, u32); 3] = [
    (|step| Some(&step.errors.fit), Ink::Measured, Shape::Dot, 16),
    (
        |step| step.errors.gate.as_ref(),
        Ink::Rival,
        Shape::Ring,
        18,
    ),
    (
        |step| step.errors.untouched.as_ref(),
        Ink::Model,
        Shape::Triangle,
        22,
    ),
];

fn height(summary: &ErrorSummary) -> f64 {
    summary.error_to_noise.max(1e-3).log10()
}

/// A level until the next step, then straight up or down.
fn stairs(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mut stairs = Vec::with_capacity(2 * points.len());
    for (k, &(x, y)) in points.iter().enumerate() {
        if k > 0 {
            stairs.push((x, points[k - 1].1));
        }
        stairs.push((x, y));
    }
    stairs
}

/// What a step did, in a few characters.
#[must_use]
pub fn step_in_words(step: &ImprovementStep, first: bool) -> String {
    let added = step.added.iter().map(|effect| format!("+ {effect}"));
    let dropped = step
        .dropped
        .iter()
        .map(|effect| format!("\u{2212} {effect}"));
    let words: Vec<String> = added.chain(dropped).collect();
    match words.as_slice() {
        [] if first => "start".to_owned(),
        [] => "no change".to_owned(),
        words => words.join(" "),
    }
}

fn description(steps: &[ImprovementStep]) -> String {
    let each: Vec<String> = (steps.iter().enumerate())
        .map(|(k, step)| {
            let error = step.errors.quoted().error_to_noise;
            format!("step {k}, {}: {error:.2}", step_in_words(step, k == 0))
        })
        .collect();
    let set = (steps.last()).map_or("fitted", |step| step.errors.quoted_set());
    format!(
        "Error over noise after every step, {set} events: {}.",
        each.join("; ")
    )
}
