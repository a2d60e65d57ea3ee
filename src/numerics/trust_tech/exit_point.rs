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

    /// The exit point, if there is one.
    pub(super) fn exit_point(&self) -> Option<&DVector<f64>> {
        match &self.end {
            PathEnd::Exit { point } => Some(point),
            PathEnd::NoExit { .. } => None,
        }
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

/// Points of a path that are evaluated together: a path does not depend on the objective until it
/// ends, and an objective may take several points at the price of one.
const POINTS_AHEAD: usize = 4;

/// Walks from `start` along `unit` until the objective, `values`, falls.
///
/// Each step goes a little along the direction, `y = x + tau d` (step 1); `project(x, y)` brings it
/// back into the feasible set, `x + P(x)(y - x)` (step 2; none when it cannot); then the direction
/// is turned to point from the start to where the path now is, `d = (x - x_s) / |x - x_s|`
/// (step 3), so that the path moves away from the start even where the constraints bend it.
pub(super) async fn find_exit(
    start: (&DVector<f64>, f64),
    unit: &DVector<f64>,
    options: &Options,
    project: Projection<'_>,
    values: &mut impl AsyncFnMut(&[DVector<f64>]) -> Vec<Option<f64>>,
) -> ExitSearch {
    let (origin, value_at_origin) = start;
    let mut path = Path::new(origin, unit, options, project);
    let mut value_before = value_at_origin;
    let (mut profile, mut risen, mut distance) = (vec![(0.0, value_before)], false, 0.0);
    loop {
        let points = path.next_points();
        if points.is_empty() {
            return ended(profile, distance, false);
        }
        for (point, value) in values(&points).await.into_iter().enumerate() {
            let Some(value) = value else {
                return ended(profile, distance, true);
            };
            distance = (&points[point] - origin).norm();
            profile.push((distance, value));
            let rounding = ROUNDING * value_before.abs();
            let falls = value < value_before - rounding;
            let is_far_below = value < value_at_origin - FALL_WITHOUT_RISE * value_at_origin.abs();
            if falls && (risen || is_far_below || !options.rise_required) {
                let point = points[point].clone();
                return ExitSearch {
                    profile,
                    end: PathEnd::Exit { point },
                };
            }
            risen |= value > value_before + rounding;
            value_before = value;
        }
    }
}

/// The points of a path, a few at a time.
struct Path<'a> {
    origin: &'a DVector<f64>,
    project: Projection<'a>,
    x: DVector<f64>,
    unit: DVector<f64>,
    step: f64,
    step_growth: f64,
    steps_left: usize,
}

impl<'a> Path<'a> {
    fn new(
        origin: &'a DVector<f64>,
        unit: &DVector<f64>,
        options: &Options,
        project: Projection<'a>,
    ) -> Self {
        Self {
            origin,
            project,
            x: origin.clone(),
            unit: unit.clone(),
            step: options.step,
            step_growth: options.step_growth,
            steps_left: options.steps_max,
        }
    }

    /// None are left when the constraints stop the path, or after the largest number of steps.
    fn next_points(&mut self) -> Vec<DVector<f64>> {
        let mut points = Vec::with_capacity(POINTS_AHEAD);
        while points.len() < POINTS_AHEAD && self.steps_left > 0 {
            let y = &self.x + &self.unit * self.step; // step 1
            let next = (self.project)(&self.x, &y); // step 2
            let moved = next.filter(|next| (next - &self.x).norm() >= PROGRESS_MIN * self.step);
            let Some(next) = moved else {
                self.steps_left = 0;
                break;
            };
            let away = &next - self.origin;
            let distance = away.norm();
            if distance > 0.0 {
                self.unit = away / distance; // step 3
            }
            self.x.copy_from(&next);
            self.step *= self.step_growth;
            self.steps_left -= 1;
            points.push(next);
        }
        points
    }
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
