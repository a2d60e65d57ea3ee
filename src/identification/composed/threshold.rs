//! How far a fitted threshold is determined: between the dips that it divides the objective is flat.

use nalgebra::DVector;

use super::{
    coordinates::Coordinates,
    fit::{ComposedFit, Place},
    screening::Step,
};
use crate::numerics::Objective;

/// The objective may rise by this within the interval: two standard errors.
const RISE: f64 = 2.0;
/// Step of the walk to both sides, pu.
const STEP: f64 = 0.01;
/// Steps at most to each side.
const STEPS_MAX: usize = 15;
/// Bisections of the last step.
const BISECTIONS: usize = 3;
/// An interval narrower than this is left to the covariance, pu.
const NARROW: f64 = 0.01;

/// A fit whose threshold lies in the middle of the interval in which the objective hardly changes, with
/// the variance of a uniform distribution over it. As it was where that interval is narrow.
pub(super) fn settled(step: &Step<'_>, fit: ComposedFit) -> ComposedFit {
    centred(step, &fit).unwrap_or(fit)
}

fn centred(step: &Step<'_>, fit: &ComposedFit) -> Option<ComposedFit> {
    let index = step.threshold()?;
    let place = fit.free.iter().position(|i| *i == index)?;
    let coordinates = Coordinates::new(step.model, &fit.parameters, &fit.free);
    let x = coordinates.unknowns(&fit.parameters);
    let fixed = Place {
        rows: step.rows,
        model: step.model,
        coordinates: &coordinates,
        scatter: &step.options.scatter,
        cancel: step.cancel,
    };
    let problem = fixed.problem(&x, None)?;
    let bounds = coordinates.bounds();
    let at = |value: f64| {
        let mut moved: DVector<f64> = x.clone();
        moved[place] = value;
        moved
    };
    let limit = problem.value(&x)? + RISE;
    let inside = |value: f64| problem.value(&at(value)).is_some_and(|v| v < limit);
    let reach = |direction: f64, end: f64| {
        let (mut known, mut beyond) = (x[place], None);
        for k in 1..=STEPS_MAX {
            let next = direction * STEP * k as f64 + x[place];
            if direction * (next - end) > 0.0 {
                break;
            }
            if !inside(next) {
                beyond = Some(next);
                break;
            }
            known = next;
        }
        let Some(mut beyond) = beyond else {
            return known;
        };
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (known + beyond);
            if inside(middle) {
                known = middle;
            } else {
                beyond = middle;
            }
        }
        known
    };
    let (low, high) = (
        reach(-1.0, bounds.lower[place]),
        reach(1.0, bounds.upper[place]),
    );
    let width = high - low;
    if width < NARROW {
        return None;
    }
    let middle = at(0.5 * (low + high));
    let (mut moved, _) = fixed.finished(&middle, None, fit.evaluations)?;
    if let Some(covariance) = &mut moved.covariance {
        covariance.row_mut(place).fill(0.0);
        covariance.column_mut(place).fill(0.0);
        covariance[(place, place)] = width * width / 12.0;
    }
    Some(moved)
}
