//! What a fit leaves open because the objective is flat there: between the dips that a threshold divides,
//! and in a delay that no sample falls into. A solver that begins in such a place stays where it began.

use nalgebra::DVector;

use super::{coordinates::Coordinates, fit::ComposedFit, screening::Step};
use crate::{
    load_model::{
        effect::{Role, Scale},
        effects,
    },
    numerics::Objective,
};

/// The objective may rise by this within the interval: two standard errors, ...
const RISE: f64 = 2.0;
/// ... or by this share of the squares that are left, if that is more: residuals last, so that what single dips prefer by
/// less says nothing of where a threshold lies, while beyond an end of the interval another dip is reached.
const RISE_OF_LEFT: f64 = 0.003;
/// Step of the walk to both sides, pu.
const STEP: f64 = 0.01;
/// Steps at most to each side.
const STEPS_MAX: usize = 15;
/// Bisections of the last step.
const BISECTIONS: usize = 3;
/// An interval narrower than this is left to the covariance, pu.
const NARROW: f64 = 0.01;

/// A shape is open when its standard error is above this share of its prior's deviation.
const OPEN: f64 = 0.5;
/// Shares of the way to a prior's centre, the whole first.
const SHARES: [f64; 4] = [1.0, 0.75, 0.5, 0.25];

/// A fit whose open shapes are as the priors have them as far as the data allow, and whose threshold
/// lies in the middle of the interval in which the objective hardly changes, with
/// the variance of a uniform distribution over it. As it was where that interval is narrow.
pub(super) fn settled(step: &Step<'_>, fit: ComposedFit) -> ComposedFit {
    let fit = towards_priors(step, &fit).unwrap_or(fit);
    centred(step, &fit).unwrap_or(fit)
}

/// [`settled`], and the thresholds of the structure's other effects put into their middles as well: what is added last may
/// have been what held them at an end.
pub(super) fn settled_with_others(step: &Step<'_>, fit: ComposedFit) -> ComposedFit {
    let mut fit = settled(step, fit);
    let own = step.effect.declaration().name;
    let others = step.model.effect_names().filter(|name| *name != own);
    for effect in others.filter_map(effects::find) {
        let other = Step { effect, ..*step };
        fit = centred(&other, &fit).unwrap_or(fit);
    }
    fit
}

/// The fit with each open shape of the effect moved towards its prior's centre; `None` where no move
/// raises the posterior.
fn towards_priors(step: &Step<'_>, fit: &ComposedFit) -> Option<ComposedFit> {
    let parameters = step.model.parameters();
    let open = |&(_, &index): &(usize, &usize)| {
        let declared = &parameters[index].declaration;
        let own = parameters[index].effect == Some(step.effect.declaration().name);
        let scale = match declared.prior.scale {
            Scale::Linear => 1.0,
            Scale::Logarithmic => fit.parameters[index],
        };
        let error = fit.standard_error(index).map(|e| e / scale);
        own && declared.role == Role::Shape
            && error.is_none_or(|e| e > OPEN * declared.prior.deviation)
    };
    let places: Vec<usize> = (fit.free.iter().enumerate())
        .filter(open)
        .map(|(place, _)| place)
        .collect();
    if places.is_empty() {
        return None;
    }
    let coordinates = Coordinates::new(step.model, &fit.parameters, &fit.free);
    let fixed = step.place(&coordinates);
    let mut x = coordinates.unknowns(&fit.parameters);
    let problem = fixed.problem(&x, None)?;
    let (begun, centres) = (problem.value(&x)?, coordinates.centres());
    let mut least = begun;
    for place in places {
        let way = centres[place] - x[place];
        for share in SHARES {
            let mut moved = x.clone();
            moved[place] += share * way;
            if let Some(value) = problem.value(&moved).filter(|value| *value < least) {
                (x, least) = (moved, value);
                break;
            }
        }
    }
    if least >= begun {
        return None;
    }
    let (moved, _) = fixed.finished(&x, None, fit.evaluations)?;
    Some(moved)
}

fn centred(step: &Step<'_>, fit: &ComposedFit) -> Option<ComposedFit> {
    let index = step.threshold()?;
    let place = fit.free.iter().position(|i| *i == index)?;
    let coordinates = Coordinates::new(step.model, &fit.parameters, &fit.free);
    let x = coordinates.unknowns(&fit.parameters);
    let fixed = step.place(&coordinates);
    let problem = fixed.problem(&x, None)?;
    let bounds = coordinates.bounds();
    let at = |value: f64| {
        let mut moved: DVector<f64> = x.clone();
        moved[place] = value;
        moved
    };
    let left: f64 = fit.squares.iter().sum();
    let limit = problem.value(&x)? + RISE.max(0.5 * RISE_OF_LEFT * left);
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
