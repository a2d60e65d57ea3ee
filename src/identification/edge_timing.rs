//! When exactly the voltage jumped, where the voltages themselves leave it open.
//!
//! Between two unfiltered samples a jump may happen anywhere; P and Q after it tell when: the motor's
//! flux has moved for that long. Behind a filter shorter than a few samples the one or two voltages that hold the
//! jump tell its instant with a deviation of their own, and P and Q at the same samples tell the rest. The instants
//! are nuisance parameters of the instrument, one per jump, each within its own samples. They are estimated at a
//! given model, for fitted and held-out events alike, and never change a parameter of the load directly.

use nalgebra::{DMatrix, DVector};

use super::{
    evaluate::EventModel,
    intake::{Edge, PreparedEvent},
};

/// Prior standard deviation of an instant, samples: that of a uniform distribution over one
/// interval.
const PRIOR_DEVIATION: f64 = 0.29;
/// Least deviation that a filter leaves, samples: its shape is known no better.
const FILTERED_DEVIATION_LEAST: f64 = 0.01;
/// Step of the difference quotients, samples.
const DIFFERENCE: f64 = 0.02;
/// Least distance of an instant from the samples around it, and of two instants, samples.
const LEAST_DISTANCE: f64 = 0.02;
const LEAST_APART: f64 = 0.1;
/// Rounds of the Gauss-Newton iteration at most.
const ROUNDS_MAX: usize = 8;

/// The event with its jumps where `model` explains P and Q best; as it is where they have no say, or nothing is
/// gained.
#[must_use]
pub fn align(model: &dyn EventModel, event: &PreparedEvent) -> PreparedEvent {
    if !event.instants_open() {
        return event.clone();
    }
    let prior = priors(event);
    let start: Vec<f64> = event.edges.iter().map(|e| e.position).collect();
    let mut at = start.clone();
    for _ in 0..ROUNDS_MAX {
        let Some(step) = gauss_newton_step(model, event, &at, &prior) else {
            break;
        };
        let moved: Vec<f64> = (at.iter().zip(&event.edges).zip(step.iter()))
            .map(|((at, edge), step)| kept_between(edge, at + step))
            .collect();
        if moved.windows(2).any(|pair| pair[1] - pair[0] < LEAST_APART) {
            break;
        }
        let largest = moved.iter().zip(&at).map(|(a, b)| (a - b).abs());
        let largest = largest.fold(0.0, f64::max);
        at = moved;
        if largest < 1e-3 {
            break;
        }
    }
    let misfit = |at: &[f64]| {
        let left = residuals(model, event, at).map_or(f64::INFINITY, |r| r.norm_squared());
        let apart = at.iter().zip(&prior).map(|(at, p)| p.pull(*at).powi(2));
        left + apart.sum::<f64>()
    };
    if misfit(&at) <= misfit(&start) {
        event.with_edge_positions(&at)
    } else {
        event.clone()
    }
}

/// What is known of an instant before P and Q are looked at, samples.
struct Prior {
    expected: f64,
    deviation: f64,
}

impl Prior {
    /// Distance from what was expected, in deviations.
    fn pull(&self, at: f64) -> f64 {
        (at - self.expected) / self.deviation
    }
}

fn priors(event: &PreparedEvent) -> Vec<Prior> {
    let prior = |edge: &Edge| {
        if event.instants_unseen() {
            Prior {
                expected: 0.5 * (edge.left + edge.right) as f64,
                deviation: PRIOR_DEVIATION,
            }
        } else {
            Prior {
                expected: edge.position,
                deviation: edge.deviation.max(FILTERED_DEVIATION_LEAST),
            }
        }
    };
    event.edges.iter().map(prior).collect()
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
    prior: &[Prior],
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
    let precision = DVector::from_iterator(at.len(), prior.iter().map(|p| p.deviation.powi(-2)));
    let curvature = jacobian.transpose() * &jacobian + DMatrix::from_diagonal(&precision);
    let pull = DVector::from_fn(at.len(), |i, _| prior[i].pull(at[i]) / prior[i].deviation);
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
