//! The profile likelihood of one quantity as a figure.

use super::{
    figure::{Figure, Ink, Mark, Panel, Shape},
    number::significant,
};
use crate::{
    adapters::report::ReportError,
    identification::{
        Profile,
        profile::{LEVELS, Limit},
    },
};

const WIDTH_PX: u32 = 720;
/// Rise at the top of the figure: beyond the 95 % level.
const RISE_TOP: f64 = 6.5;
const ROOT_TOP: f64 = 2.7;

/// The figure as an SVG file: the rise of the misfit with its confidence levels, and its signed root,
/// which is straight where a standard error tells all.
///
/// # Errors
///
/// [`ReportError::Drawing`] when the figure cannot be drawn.
pub fn profile_svg(profile: &Profile) -> Result<String, ReportError> {
    let curve: Vec<(f64, f64)> = (profile.points.iter()).map(|p| (p.value, p.rise)).collect();
    let root: Vec<(f64, f64)> = (profile.points.iter())
        .map(|p| (p.value, p.root().copysign(p.value - profile.estimate)))
        .collect();
    let (from, to) = (
        curve.first().map_or(0.0, |p| p.0),
        curve.last().map_or(1.0, |p| p.0),
    );
    let margin = 0.03 * (to - from).max(1e-9 * from.abs().max(1e-9));
    let unit = match profile.unit.as_str() {
        "1" => String::new(),
        unit => format!(", {unit}"),
    };
    let figure = Figure {
        id: format!("profile-{}", profile.name),
        title: format!("Profile likelihood of {}", profile.name),
        description: description(profile),
        width_px: WIDTH_PX,
        horizontal: (from - margin, to + margin),
        horizontal_title: format!("{} ({}{unit})", profile.name, profile.meaning),
        counts: false,
        panels: vec![
            Panel {
                title: "rise of the misfit; lines at 68 and 95 %".to_owned(),
                height_px: 240,
                vertical: (-0.2, RISE_TOP),
                logarithmic: false,
                marks: rise_marks(profile, curve),
            },
            Panel {
                title: "signed root; straight where standard errors hold".to_owned(),
                height_px: 160,
                vertical: (-ROOT_TOP, ROOT_TOP),
                logarithmic: false,
                marks: root_marks(profile, root),
            },
        ],
    };
    figure.document()
}

fn description(profile: &Profile) -> String {
    let intervals: Vec<String> = (profile.intervals.iter())
        .map(|i| {
            format!(
                "{:.0} %: {} to {}",
                100.0 * i.level,
                significant(i.lower.value(), 4),
                significant(i.upper.value(), 4)
            )
        })
        .collect();
    format!(
        "Estimate {}; confidence intervals {}.",
        significant(profile.estimate, 4),
        intervals.join(", ")
    )
}

fn rise_marks(profile: &Profile, curve: Vec<(f64, f64)>) -> Vec<Mark> {
    let shown = |(x, y): (f64, f64)| (x, if y <= RISE_TOP { y } else { f64::NAN });
    let points: Vec<(f64, f64)> = (curve.iter().copied())
        .filter(|p| p.1 <= RISE_TOP)
        .collect();
    let mut marks = Vec::new();
    if let [narrow, wide] = profile.intervals.as_slice() {
        for interval in [wide, narrow] {
            marks.push(Mark::Strip {
                from: interval.lower.value(),
                to: interval.upper.value(),
                ink: Ink::Noise,
            });
            for limit in [interval.lower, interval.upper] {
                if let Limit::Bound(at) | Limit::Open(at) = limit {
                    marks.push(Mark::Upright {
                        at,
                        ink: Ink::Unused,
                    });
                }
            }
        }
    }
    for (_, quantile) in LEVELS {
        marks.push(Mark::Level {
            at: quantile,
            ink: Ink::Onset,
        });
    }
    marks.push(Mark::Upright {
        at: profile.estimate,
        ink: Ink::Measured,
    });
    marks.push(Mark::Line {
        points: curve.into_iter().map(shown).collect(),
        ink: Ink::Model,
        width_quarter_px: 8,
    });
    marks.push(Mark::Points {
        points,
        ink: Ink::Model,
        shape: Shape::Dot,
        radius_quarter_px: 10,
    });
    marks
}

fn root_marks(profile: &Profile, root: Vec<(f64, f64)>) -> Vec<Mark> {
    let straight = |root: f64| (profile.estimate + root * profile.standard_error, root);
    let within = |(_, y): &(f64, f64)| y.abs() <= ROOT_TOP;
    let span = (
        root.first().map_or(0.0, |p| p.0),
        root.last().map_or(0.0, |p| p.0),
    );
    let tangent: Vec<(f64, f64)> = [-2.0, 2.0]
        .map(straight)
        .into_iter()
        .filter(|(x, _)| (span.0..=span.1).contains(x))
        .collect();
    vec![
        Mark::Line {
            points: tangent,
            ink: Ink::Rival,
            width_quarter_px: 4,
        },
        Mark::Line {
            points: root.into_iter().filter(within).collect(),
            ink: Ink::Model,
            width_quarter_px: 8,
        },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::profile::{ConfidenceInterval, ProfilePoint};

    #[test]
    fn the_figure_is_a_file_of_its_own_and_says_the_intervals() {
        let point = |value: f64| ProfilePoint {
            value,
            rise: (value - 0.5).powi(2) / 0.01,
            coordinates: vec![0.0; 8],
            x_motor_base: 3.0,
        };
        let interval = |level: f64, half: f64| ConfidenceInterval {
            level,
            lower: Limit::Reached(0.5 - half),
            upper: Limit::Bound(0.5 + half),
        };
        let profile = Profile {
            name: "Kpm".to_owned(),
            meaning: "motor share of the active power".to_owned(),
            unit: "1".to_owned(),
            estimate: 0.5,
            standard_error: 0.1,
            points: (0..=20)
                .map(|i| point(0.25 + 0.025 * f64::from(i)))
                .collect(),
            intervals: vec![interval(0.68, 0.1), interval(0.95, 0.196)],
            variance_factor: 1.0,
            fall: 0.0,
        };
        let svg = profile_svg(&profile).unwrap();
        assert!(svg.starts_with("<svg xmlns=") && !svg.contains("var(--"));
        assert!(svg.contains("95 %: 0.3040 to 0.6960"), "{}", &svg[..400]);
    }
}
