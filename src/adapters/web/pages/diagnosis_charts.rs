//! Charts of a diagnosis.

use super::super::{
    plot::{Chart, Ink, Mark, Panel, Shape, padded, span_of},
    words,
};
use crate::adapters::wire::v1::DiagnosisV1;

/// Candidates drawn at most: the rest is in the table.
const DRAWN_MAX: usize = 8;
/// Segments as documents name them, and for reading.
const SEGMENTS: [(&str, &str); 5] = [
    ("before", "before"),
    ("during", "during"),
    ("early_recovery", "first 0.5 s after"),
    ("late", "until 2 s after"),
    ("after", "later"),
];

/// Every chart of the page.
pub(super) fn all(diagnosis: &DiagnosisV1) -> Vec<Chart> {
    vec![
        candidates(diagnosis),
        segments(diagnosis),
        ladder(diagnosis),
    ]
}

/// Whether there is anything to draw of the candidates.
pub(super) fn any_refitted(diagnosis: &DiagnosisV1) -> bool {
    let mut errors = diagnosis
        .candidates
        .iter()
        .filter_map(|candidate| candidate.held_out_error_after);
    errors.any(|error| error > 0.0)
}

/// Held-out misfit with each candidate, beside that without and the floor of misfits.
pub(super) fn candidates(diagnosis: &DiagnosisV1) -> Chart {
    let refitted = diagnosis.candidates.iter().filter_map(|candidate| {
        let after = candidate
            .held_out_error_after
            .filter(|error| *error > 0.0)?;
        Some((
            candidate.effect.clone(),
            candidate.held_out_error_before.unwrap_or(f64::NAN),
            after,
        ))
    });
    let rows: Vec<(String, f64, f64)> = refitted.take(DRAWN_MAX).collect();
    let x: Vec<f64> = (0..rows.len()).map(|k| k as f64).collect();
    let log = |value: f64| value.max(1e-3).log10();
    let before: Vec<f64> = rows.iter().map(|row| log(row.1)).collect();
    let after: Vec<f64> = rows.iter().map(|row| log(row.2)).collect();
    let floor = log(diagnosis.misfit_root_floor);
    let all: Vec<f64> = before
        .iter()
        .chain(&after)
        .copied()
        .chain([floor])
        .collect();
    let points = |name: &str, ink, shape, y: Vec<f64>| Mark::Points {
        name: name.to_owned(),
        ink,
        shape,
        x: None,
        y,
        shade: None,
    };
    let drops = x.iter().enumerate().map(|(k, &at)| Mark::Line {
        name: String::new(),
        ink: Ink::Unused,
        x: Some(vec![at, at]),
        y: vec![before[k], after[k]],
        dashed: true,
    });
    let mut marks = vec![Mark::Level {
        name: "a perfect model".to_owned(),
        ink: Ink::Mark,
        at: floor,
    }];
    marks.extend(drops);
    marks.push(points("without it", Ink::Measured, Shape::Ring, before));
    marks.push(points("with it", Ink::Model, Shape::Dot, after));
    Chart {
        id: "candidates".to_owned(),
        title: "What each effect does to the misfit of the events that decide".to_owned(),
        description:
            "Root of the misfit per sample (residual over the deviation that each sample has in the \
             fit) of the gate's events without and with each effect; the line is what a perfect model \
             leaves."
                .to_owned(),
        horizontal_title: "effect, best first".to_owned(),
        horizontal: (-0.5, rows.len().max(1) as f64 - 0.5),
        names: rows.iter().map(|row| words::effect(&row.0)).collect(),
        x,
        linked: None,
        panels: vec![Panel {
            title: "root of misfit per sample, gate's events".to_owned(),
            height: 200,
            vertical: padded(span_of(&all), 0.1),
            logarithmic: true,
            marks,
        }],
    }
}

/// Residual over noise by part of the events, all events together.
pub(super) fn segments(diagnosis: &DiagnosisV1) -> Chart {
    let bars = |channel: &str, ink, shift: f64| {
        let found = SEGMENTS
            .iter()
            .enumerate()
            .filter_map(|(place, (name, _))| {
                let wanted = |r: &&_| residual_is(r, name, channel);
                let residual = diagnosis.segments.iter().find(wanted)?;
                Some((place as f64 + shift, residual.to_noise))
            });
        let (x, y) = found.unzip();
        Mark::Bars {
            name: channel.to_owned(),
            ink,
            x,
            y,
            base: 0.0,
            half_width: 0.16,
        }
    };
    let highest = diagnosis
        .segments
        .iter()
        .map(|r| r.to_noise)
        .filter(|v| v.is_finite());
    Chart {
        id: "segments".to_owned(),
        title: "When it fails".to_owned(),
        description:
            "Root mean square of the residual over the noise by part of the event, over all events."
                .to_owned(),
        horizontal_title: "part of the event".to_owned(),
        horizontal: (-0.6, 4.6),
        names: SEGMENTS
            .iter()
            .map(|(_, name)| (*name).to_owned())
            .collect(),
        x: Vec::new(),
        linked: None,
        panels: vec![Panel {
            title: "residual over noise".to_owned(),
            height: 190,
            vertical: (0.0, 1.08 * highest.fold(1.0, f64::max)),
            logarithmic: false,
            marks: vec![
                Mark::Level {
                    name: "noise".to_owned(),
                    ink: Ink::Mark,
                    at: 1.0,
                },
                bars("P", Ink::Model, -0.2),
                bars("Q", Ink::Measured, 0.2),
            ],
        }],
    }
}

fn residual_is(
    r: &crate::adapters::wire::v1::SegmentResidualV1,
    segment: &str,
    channel: &str,
) -> bool {
    r.segment == segment && r.channel == channel
}

/// Error against depth: a threshold shows as a step.
pub(super) fn ladder(diagnosis: &DiagnosisV1) -> Chart {
    let x: Vec<f64> = diagnosis
        .failures
        .iter()
        .map(|f| f.lowest_voltage)
        .collect();
    let y: Vec<f64> = diagnosis
        .failures
        .iter()
        .map(|f| f.error_to_noise.max(1e-3).log10())
        .collect();
    let floor = diagnosis.misfit_root_floor.max(1e-3).log10();
    let all: Vec<f64> = y.iter().copied().chain([floor]).collect();
    Chart {
        id: "ladder".to_owned(),
        title: "Misfit against depth of the dip".to_owned(),
        description: "Root of the misfit per sample of each event against its lowest voltage; a step tells of a threshold."
            .to_owned(),
        horizontal_title: "lowest voltage over its value before the event".to_owned(),
        horizontal: padded(span_of(&x), 0.05),
        names: Vec::new(),
        x,
        linked: None,
        panels: vec![Panel {
            title: "root of misfit per sample".to_owned(),
            height: 190,
            vertical: padded(span_of(&all), 0.2),
            logarithmic: true,
            marks: vec![
                Mark::Level { name: "a perfect model".to_owned(), ink: Ink::Mark, at: floor },
                Mark::Points {
                    name: "event".to_owned(),
                    ink: Ink::Model,
                    shape: Shape::Dot,
                    x: None,
                    y,
                    shade: None,
                },
            ],
        }],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::wire::v1::examples;

    #[test]
    fn roots_of_misfit_are_drawn_with_the_floor_of_their_own_scale() {
        let diagnosis = DiagnosisV1::new(&examples::diagnosis(), 1);
        assert!(diagnosis.misfit_root_floor < 0.9, "of roots of misfit");
        for chart in [candidates(&diagnosis), ladder(&diagnosis)] {
            let panel = &chart.panels[0];
            assert!(panel.title.starts_with("root of misfit"), "{}", panel.title);
            let floor = panel.marks.iter().find_map(|mark| match mark {
                Mark::Level { at, .. } => Some(10_f64.powf(*at)),
                _ => None,
            });
            let floor = floor.unwrap();
            let own = diagnosis.misfit_root_floor;
            assert!((floor - own).abs() < 1e-9, "{floor} for {own}");
        }
    }
}
