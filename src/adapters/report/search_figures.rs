//! The search in pictures: the objective along directions (the paper's Figs. 2 and 4), and which
//! solution led to which.

use super::figure::{Figure, Ink, Mark, Panel, ReportError, Shape};
use crate::identification::{DirectionOutcome, DirectionRecord, Solution};

const WIDTH_PX: u32 = 760;

/// The objective along every direction from solution `from`, as an SVG file. Directions of the
/// quotient gradient system are left out: along them there is an energy instead.
///
/// # Errors
///
/// [`ReportError::Drawing`] when plotters refuses.
pub fn along_directions(
    from: usize,
    directions: &[DirectionRecord],
) -> Result<String, ReportError> {
    let shown: Vec<&DirectionRecord> = (directions.iter())
        .filter(|record| record.from == from && !record.label.starts_with("component"))
        .collect();
    let points = || shown.iter().flat_map(|record| &record.profile);
    let right = points().map(|p| p.0).fold(0.1, f64::max) * 1.08;
    let vertical = range(points().map(|p| logarithm(p.1)));
    let mut marks = Vec::new();
    for record in &shown {
        let curve: Vec<(f64, f64)> = (record.profile.iter())
            .map(|&(distance, value)| (distance, logarithm(value)))
            .collect();
        let (ink, shape) = look(record.outcome);
        if let Some(&end) = curve.last() {
            marks.push(Mark::Points {
                points: vec![end],
                ink,
                shape,
                radius_quarter_px: 18,
            });
            marks.push(Mark::Label {
                at: end,
                text: record.direction.to_string(),
            });
        }
        marks.push(Mark::Line {
            points: curve,
            ink,
            width_quarter_px: 6,
        });
    }
    Figure {
        id: format!("directions-{from}"),
        title: format!("Objective along the directions from solution {from}"),
        description:
            "One curve per search direction, numbered. Filled dot: the exit point led to a \
                      new solution; ring: to a known one; triangle: the local solver ended at the \
                      edge of the domain; cross: no exit point."
                .to_owned(),
        width_px: WIDTH_PX,
        horizontal: (0.0, right),
        horizontal_title: "distance from the solution, in widths of the box".to_owned(),
        counts: false,
        panels: vec![Panel {
            title: format!(
                "objective; dot: exit to a new solution, ring: to a known one, cross: no exit \
                 (solution {from})"
            ),
            height_px: 360,
            vertical,
            logarithmic: true,
            marks,
        }],
    }
    .document()
}

/// Every solution at its tier and objective, with a line from the one that led to it, as an SVG
/// file; thin lines lead to solutions that were known already.
///
/// # Errors
///
/// [`ReportError::Drawing`] when plotters refuses.
pub fn tiers(
    solutions: &[Solution],
    directions: &[DirectionRecord],
) -> Result<String, ReportError> {
    let place = |id: usize| {
        let found = solutions.iter().find(|solution| solution.id == id)?;
        Some((found.tier as f64, logarithm(found.objective)))
    };
    let mut marks = Vec::new();
    let mut join = |from: usize, to: usize, ink, width_quarter_px| {
        if let (Some(a), Some(b)) = (place(from), place(to)) {
            marks.push(Mark::Line {
                points: vec![a, b],
                ink,
                width_quarter_px,
            });
        }
    };
    for record in directions {
        match record.outcome {
            DirectionOutcome::KnownSolution(to) => join(record.from, to, Ink::Noise, 3),
            DirectionOutcome::NewSolution(to) => join(record.from, to, Ink::Model, 8),
            _ => {}
        }
    }
    for solution in solutions {
        let at = (solution.tier as f64, logarithm(solution.objective));
        marks.push(Mark::Points {
            points: vec![at],
            ink: Ink::Measured,
            shape: Shape::Dot,
            radius_quarter_px: 18,
        });
        marks.push(Mark::Label {
            at,
            text: solution.id.to_string(),
        });
    }
    let last = solutions.iter().map(|s| s.tier).max().unwrap_or(0) as f64;
    Figure {
        id: "tiers".to_owned(),
        title: "Solutions by tier".to_owned(),
        description:
            "Every local solution at its tier and objective; a thick line from the solution \
                      that led to it, thin lines to solutions known already."
                .to_owned(),
        width_px: WIDTH_PX,
        horizontal: (-0.3, last + 0.5),
        horizontal_title: "tier".to_owned(),
        counts: true,
        panels: vec![Panel {
            title: "objective; thick: led to a new solution, thin: to a known one".to_owned(),
            height_px: 300,
            vertical: range(solutions.iter().map(|s| logarithm(s.objective))),
            logarithmic: true,
            marks,
        }],
    }
    .document()
}

const fn look(outcome: DirectionOutcome) -> (Ink, Shape) {
    match outcome {
        DirectionOutcome::NewSolution(_) => (Ink::Model, Shape::Dot),
        DirectionOutcome::KnownSolution(_) => (Ink::Measured, Shape::Ring),
        DirectionOutcome::NoExitPoint { .. } => (Ink::Unused, Shape::Cross),
        DirectionOutcome::LocalSolverInfeasible => (Ink::Rival, Shape::Triangle),
    }
}

/// An objective of 0 has no logarithm; nothing measured has one of 1e-12.
fn logarithm(value: f64) -> f64 {
    value.max(1e-12).log10()
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values
        .filter(|v| v.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(v), high.max(v))
        });
    if low > high {
        return (0.0, 1.0);
    }
    let margin = 0.06 * (high - low).max(0.1);
    (low - margin, high + margin)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(direction: usize, outcome: DirectionOutcome) -> DirectionRecord {
        DirectionRecord {
            from: 1,
            direction,
            label: "eigenvector 1 +".to_owned(),
            exit_distance: None,
            exit_point: None,
            outcome,
            profile: vec![(0.0, 10.0), (0.1, 1e3), (0.2, 5e2)],
        }
    }

    #[test]
    fn pictures_of_the_search_stand_by_themselves() {
        let directions = [
            record(1, DirectionOutcome::NewSolution(2)),
            record(2, DirectionOutcome::LocalSolverInfeasible),
        ];
        let solution = |id, tier| Solution {
            id,
            tier,
            found_from: (tier > 0).then_some(1),
            direction: (tier > 0).then_some(1),
            objective: 10.0,
            parameters: Vec::new(),
            coordinates: Vec::new(),
            at_bound: Vec::new(),
        };
        let pictures = [
            along_directions(1, &directions).unwrap(),
            along_directions(7, &directions).unwrap(),
            tiers(&[solution(1, 0), solution(2, 1)], &directions).unwrap(),
        ];
        for svg in pictures {
            assert!(svg.starts_with("<svg xmlns="), "{svg}");
            assert!(!svg.contains("var(") && svg.ends_with("</svg>\n"), "{svg}");
        }
    }
}
