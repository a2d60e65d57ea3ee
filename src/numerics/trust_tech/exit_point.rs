//! The exit-point search of section 3.2.

use nalgebra::DVector;

use super::Options;

/// A path along one direction.
pub(super) struct ExitSearch {
    /// Distance from the solution and objective at every point.
    pub(super) profile: Vec<(f64, f64)>,
    pub(super) end: PathEnd,
}

/// How a path ended.
pub(super) enum PathEnd {
    /// At the first point at which the objective fell.
    Exit { point: DVector<f64> },
    /// Without one.
    NoExit { at_distance: f64, diverged: bool },
}

impl ExitSearch {
    /// A path that could not begin.
    pub(super) fn nowhere(value: f64) -> Self {
        ended(vec![(0.0, value)], 0.0, false)
    }

    pub(super) fn exit_distance(&self) -> Option<f64> {
        match self.end {
            PathEnd::Exit { .. } => self.profile.last().map(|&(distance, _)| distance),
            PathEnd::NoExit { .. } => None,
        }
    }
}

/// A fall or rise below this fraction of the objective is rounding.
const ROUNDING: f64 = 1e-13;
/// A step that the constraints shorten below this fraction of its length leads nowhere: the path
/// has run into a corner.
const PROGRESS_MIN: f64 = 0.01;

/// A fall below the solution by this fraction of its objective counts as an exit even without a
/// rise before it: the first step went over the crest. Flat valleys fall by less.
const FALL_WITHOUT_RISE: f64 = 1e-3;

/// `(x, y) -> x + P(x)(y - x)`; none where there is no such point.
pub(super) type Projection<'a> = &'a dyn Fn(&DVector<f64>, &DVector<f64>) -> Option<DVector<f64>>;

/// Walks from `start` along `unit` until the objective, `value`, falls.
///
/// Each step goes a little along the direction, `y = x + tau d` (step 1); `project(x, y)` brings it
/// back into the feasible set, `x + P(x)(y - x)` (step 2; none when it cannot); then the direction
/// is turned to point from the start to where the path now is, `d = (x - x_s) / |x - x_s|`
/// (step 3), so that the path moves away from the start even where the constraints bend it.
pub(super) fn find_exit(
    start: (&DVector<f64>, f64),
    unit: &DVector<f64>,
    options: &Options,
    project: Projection<'_>,
    value: &mut dyn FnMut(&DVector<f64>) -> Option<f64>,
) -> ExitSearch {
    let (origin, value_at_origin) = start;
    let mut value_before = value_at_origin;
    let (mut x, mut unit, mut step) = (origin.clone(), unit.clone(), options.step);
    let (mut profile, mut risen, mut distance) = (vec![(0.0, value_before)], false, 0.0);
    for _ in 0..options.steps_max {
        let y = &x + &unit * step; // step 1
        let Some(next) = project(&x, &y) else {
            // step 2
            return ended(profile, distance, false);
        };
        if (&next - &x).norm() < PROGRESS_MIN * step {
            break;
        }
        let Some(value_next) = value(&next) else {
            return ended(profile, distance, true);
        };
        let away = &next - origin;
        distance = away.norm();
        profile.push((distance, value_next));
        let rounding = ROUNDING * value_before.abs();
        let falls = value_next < value_before - rounding;
        let is_far_below = value_next < value_at_origin - FALL_WITHOUT_RISE * value_at_origin.abs();
        if falls && (risen || is_far_below || !options.rise_required) {
            return ExitSearch {
                profile,
                end: PathEnd::Exit { point: next },
            };
        }
        risen |= value_next > value_before + rounding;
        if distance > 0.0 {
            unit = away / distance; // step 3
        }
        (x, value_before) = (next, value_next);
        step *= options.step_growth;
    }
    ended(profile, distance, false)
}

fn ended(profile: Vec<(f64, f64)>, at_distance: f64, diverged: bool) -> ExitSearch {
    ExitSearch {
        profile,
        end: PathEnd::NoExit {
            at_distance,
            diverged,
        },
    }
}
