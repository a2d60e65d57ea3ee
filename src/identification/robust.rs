//! Robust fits: samples that nothing near them explains count less.
//!
//! An outer loop over the ordinary fit. At a fitted model each sample's residual `u`, in units of its
//! assumed deviation and of a robust scale of its channel, gets a weight
//!
//! ```text
//! Huber:   w = 1 for |u| <= k, else k/|u|,      k = 1.345        (1)
//! Cauchy:  w = 1 / (1 + (u/c)^2),               c = 2.385        (2)
//! ```
//!
//! and its deviation is divided by `sqrt(w)`; then the fit is repeated. The constants give 95 % of the
//! efficiency of least squares on normal noise. Source: Holland and Welsch, Communications in
//! Statistics A6 (1977), table 1; Huber and Ronchetti, Robust Statistics (2009), section 7.8.
//!
//! An event whose composition or operating point deviates is no outlier: the part of a residual that
//! the random effects of the joint problem explain is taken out first.

use nalgebra::{DMatrix, DVector};

use super::{
    evaluate::{Curves, FittedModel},
    intake::PreparedEvent,
    joint_problem::{LINEAR, ProblemOptions},
};
use crate::{
    load_model::{Infeasible, LinearCoefficients},
    numerics::statistics::mad_sigma,
};

/// How samples with large residuals are weighted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RobustLoss {
    /// (1): convex; bounds the influence of an outlier.
    Huber {
        /// `k`, in standard deviations. 1.345.
        tuning: f64,
    },
    /// (2): far outliers lose all influence.
    Cauchy {
        /// `c`, in standard deviations. 2.385.
        tuning: f64,
    },
}

impl RobustLoss {
    /// Huber's with its usual constant.
    pub const HUBER: Self = Self::Huber { tuning: 1.345 };
    /// Cauchy's with its usual constant.
    pub const CAUCHY: Self = Self::Cauchy { tuning: 2.385 };

    /// Weight of a sample with the scaled residual `u`.
    #[must_use]
    pub fn weight(&self, u: f64) -> f64 {
        match *self {
            Self::Huber { tuning } => (tuning / u.abs()).min(1.0),
            Self::Cauchy { tuning } => 1.0 / (1.0 + (u / tuning).powi(2)),
        }
    }
}

/// Weights of one event's samples.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleWeights {
    /// Of P.
    pub active: Vec<f64>,
    /// Of Q.
    pub reactive: Vec<f64>,
}

impl SampleWeights {
    /// Largest difference to other weights of the same event.
    #[must_use]
    pub fn largest_change(&self, other: &Self) -> f64 {
        let pairs = (self.active.iter().zip(&other.active))
            .chain(self.reactive.iter().zip(&other.reactive));
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    /// The event with its deviations divided by the square roots of the weights.
    #[must_use]
    pub fn applied_to(&self, event: &PreparedEvent) -> PreparedEvent {
        let mut weighted = event.clone();
        let divide = |deviation: &mut [f64], weights: &[f64]| {
            for (deviation, weight) in deviation.iter_mut().zip(weights) {
                *deviation /= weight.sqrt();
            }
        };
        divide(&mut weighted.active_deviation, &self.active);
        divide(&mut weighted.reactive_deviation, &self.reactive);
        weighted
    }

    /// How many used samples of either channel count less than half.
    #[must_use]
    pub fn below_half(&self, event: &PreparedEvent) -> usize {
        (0..event.len())
            .filter(|&k| event.used[k] && (self.active[k] < 0.5 || self.reactive[k] < 0.5))
            .count()
    }
}

/// Weights of the samples of `event` at `model`. The scale of a channel is the normalised median
/// absolute deviation of its residuals, and at least 1: a fit better than the assumed noise makes no
/// sample an outlier.
///
/// # Errors
///
/// [`Infeasible`] when the model cannot be simulated.
pub fn sample_weights(
    model: &FittedModel,
    event: &PreparedEvent,
    options: &ProblemOptions,
    loss: RobustLoss,
) -> Result<SampleWeights, Infeasible> {
    let residuals = residuals(model, event, options)?;
    let weigh = |channel: &[f64]| {
        let used: Vec<f64> = (channel.iter().zip(&event.used))
            .filter(|(_, used)| **used)
            .map(|(u, _)| *u)
            .collect();
        let scale = mad_sigma(&used).unwrap_or(1.0).max(1.0);
        channel.iter().map(|u| loss.weight(u / scale)).collect()
    };
    Ok(SampleWeights {
        active: weigh(&residuals.active),
        reactive: weigh(&residuals.reactive),
    })
}

/// Residuals over their assumed deviations once the event's own composition and operating point have
/// taken up what they can: ridge regression on the columns of the linear model, each with the spread
/// that the joint problem gives it, repeated once with Cauchy weights so that outliers do not pull.
fn residuals(
    model: &FittedModel,
    event: &PreparedEvent,
    options: &ProblemOptions,
) -> Result<Curves, Infeasible> {
    let modelled = model.simulate(event)?;
    let columns = columns(model, event, options, &modelled)?;
    let mut residual = weighted_difference(event, &modelled);
    let plain = residual.clone();
    let mut weights = DVector::from_element(residual.len(), 1.0);
    for _ in 0..3 {
        let size = columns.ncols();
        let weighted = DMatrix::from_fn(columns.nrows(), size, |i, j| columns[(i, j)] * weights[i]);
        let normal = weighted.transpose() * &columns + DMatrix::identity(size, size);
        let right = weighted.transpose() * &plain;
        let Some(factor) = normal.cholesky() else {
            break;
        };
        residual = &plain - &columns * factor.solve(&right);
        let scale = mad_sigma(residual.as_slice()).unwrap_or(1.0).max(1.0);
        weights = residual.map(|u| RobustLoss::CAUCHY.weight(u / scale));
    }
    let n = event.len();
    Ok(Curves {
        active: residual.rows(0, n).iter().copied().collect(),
        reactive: residual.rows(n, n).iter().copied().collect(),
    })
}

/// P then Q of every sample; zero where a sample is not used.
fn weighted_difference(event: &PreparedEvent, modelled: &Curves) -> DVector<f64> {
    let n = event.len();
    DVector::from_fn(2 * n, |i, _| {
        let k = i % n;
        if !event.used[k] {
            0.0
        } else if i < n {
            (event.active[k] - modelled.active[k]) / event.active_deviation[k]
        } else {
            (event.reactive[k] - modelled.reactive[k]) / event.reactive_deviation[k]
        }
    })
}

/// Columns of the random effects over the deviations, times their spreads. The model is linear in its
/// coefficients, so a difference of two simulations is exact.
fn columns(
    model: &FittedModel,
    event: &PreparedEvent,
    options: &ProblemOptions,
    modelled: &Curves,
) -> Result<DMatrix<f64>, Infeasible> {
    let n = event.len();
    let mut columns = DMatrix::zeros(2 * n, LINEAR + 2);
    for i in 0..LINEAR {
        let mut coefficients = model.linear.to_array();
        coefficients[i] += 1.0;
        let moved = FittedModel {
            linear: LinearCoefficients::from_array(coefficients),
            ..*model
        };
        let curves = moved.simulate(event)?;
        let spread = options.composition_spread[i];
        for k in (0..n).filter(|&k| event.used[k]) {
            columns[(k, i)] =
                spread * (curves.active[k] - modelled.active[k]) / event.active_deviation[k];
            columns[(n + k, i)] =
                spread * (curves.reactive[k] - modelled.reactive[k]) / event.reactive_deviation[k];
        }
    }
    let offset = event.operating_point_deviation;
    for k in (0..n).filter(|&k| event.used[k]) {
        columns[(k, LINEAR)] = offset / event.active_deviation[k];
        columns[(n + k, LINEAR + 1)] = offset / event.reactive_deviation[k];
    }
    Ok(columns)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_have_their_published_values() {
        // Huber at 2.69 = 2k: 1/2. Cauchy at c: 1/2; at 3c: 1/10.
        assert!((RobustLoss::HUBER.weight(2.69) - 0.5).abs() < 1e-12);
        assert!((RobustLoss::HUBER.weight(-1.0) - 1.0).abs() < 1e-12);
        assert!((RobustLoss::HUBER.weight(0.0) - 1.0).abs() < 1e-12);
        assert!((RobustLoss::CAUCHY.weight(2.385) - 0.5).abs() < 1e-12);
        assert!((RobustLoss::CAUCHY.weight(-7.155) - 0.1).abs() < 1e-12);
    }

    #[test]
    fn the_constants_give_95_percent_efficiency_on_normal_noise() {
        // Efficiency (E psi')^2 / E psi^2 with psi = u w(u), by the midpoint rule over +-8 sigma.
        for loss in [RobustLoss::HUBER, RobustLoss::CAUCHY] {
            let psi = |u: f64| u * loss.weight(u);
            let (mut slope, mut square, step) = (0.0, 0.0, 1e-3);
            for i in 0..16_000 {
                let u = -8.0 + (f64::from(i) + 0.5) * step;
                let density = (-0.5 * u * u).exp() / (2.0 * std::f64::consts::PI).sqrt();
                slope += density * (psi(u + 1e-5) - psi(u - 1e-5)) / 2e-5 * step;
                square += density * psi(u).powi(2) * step;
            }
            let efficiency = slope * slope / square;
            assert!((efficiency - 0.95).abs() < 1e-3, "{loss:?} {efficiency}");
        }
    }
}
