//! When exactly the voltage jumped, for samples that no filter has spread.
//!
//! Between two unfiltered samples a jump may happen anywhere; P and Q after it tell when: the motor's
//! flux has moved for that long. The instants are nuisance parameters of the instrument, one per
//! jump, each within its own sample interval. They are estimated at a given model, for fitted and
//! held-out events alike, and never change a parameter of the load directly.

use nalgebra::{DMatrix, DVector};

use super::{
    evaluate::EventModel,
    intake::{Edge, PreparedEvent},
};

/// Prior standard deviation of an instant, samples: that of a uniform distribution over one
/// interval.
const PRIOR_DEVIATION: f64 = 0.29;
/// Step of the difference quotients, samples.
const DIFFERENCE: f64 = 0.02;
/// Least distance of an instant from the samples around it, samples.
const LEAST_DISTANCE: f64 = 0.02;
/// Rounds of the Gauss-Newton iteration at most.
const ROUNDS_MAX: usize = 8;

/// The event with its jumps where `model` explains P and Q best.
#[must_use]
pub fn align(model: &dyn EventModel, event: &PreparedEvent) -> PreparedEvent {
    let middles: Vec<f64> = event
        .edges
        .iter()
        .map(|e| 0.5 * (e.left + e.right) as f64)
        .collect();
    let mut at: Vec<f64> = event.edges.iter().map(|e| e.position).collect();
    if !event.instants_open() {
        return event.clone();
    }
    for _ in 0..ROUNDS_MAX {
        let Some(step) = gauss_newton_step(model, event, &at, &middles) else {
            break;
        };
        let mut largest = 0.0_f64;
        for (position, (edge, step)) in at.iter_mut().zip(event.edges.iter().zip(step.iter())) {
            let moved = kept_between(edge, *position + step);
            largest = largest.max((moved - *position).abs());
            *position = moved;
        }
        if largest < 1e-3 {
            break;
        }
    }
    event.with_edge_positions(&at)
}

/// The instant, moved to where it lies between the edge's samples.
pub(super) fn kept_between(edge: &Edge, position: f64) -> f64 {
    position.clamp(
        edge.left as f64 + LEAST_DISTANCE,
        edge.right as f64 - LEAST_DISTANCE,
    )
}

fn gauss_newton_step(
    model: &dyn EventModel,
    event: &PreparedEvent,
    at: &[f64],
    middles: &[f64],
) -> Option<DVector<f64>> {
    let residual = residuals(model, event, at)?;
    let columns: Option<Vec<DVector<f64>>> = (0..at.len())
        .map(|i| {
            let mut moved = at.to_vec();
            moved[i] += DIFFERENCE;
            Some((residuals(model, event, &moved)? - &residual) / DIFFERENCE)
        })
        .collect();
    let jacobian = DMatrix::from_columns(&columns?);
    let precision = 1.0 / (PRIOR_DEVIATION * PRIOR_DEVIATION);
    let curvature =
        jacobian.transpose() * &jacobian + DMatrix::identity(at.len(), at.len()) * precision;
    let pull = DVector::from_fn(at.len(), |i, _| precision * (at[i] - middles[i]));
    let gradient = jacobian.transpose() * residual + pull;
    Some(-curvature.cholesky()?.solve(&gradient))
}

fn residuals(model: &dyn EventModel, event: &PreparedEvent, at: &[f64]) -> Option<DVector<f64>> {
    let curves = model.curves(&event.with_edge_positions(at)).ok()?;
    let weighted = |k: usize| {
        [
            (curves.active[k] - event.active[k]) / event.active_deviation[k],
            (curves.reactive[k] - event.reactive[k]) / event.reactive_deviation[k],
        ]
    };
    let used = (0..event.len()).filter(|&k| event.used[k]);
    Some(DVector::from_vec(used.flat_map(weighted).collect()))
}
