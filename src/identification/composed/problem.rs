//! The objective of a composed model over several events.

use nalgebra::{DMatrix, DVector};

use super::{coordinates::Coordinates, covariance::EventCovariance, rows::EventRows};
use crate::{
    load_model::composed::ComposedModel,
    numerics::{Expansion, Objective},
};

/// Half the weighted sum of squares of all events plus the priors, at a fixed covariance:
///
/// ```text
/// F(x) = 1/2 sum_e (y_e - f_e(x))' Sigma_e^-1 (y_e - f_e(x)) + 1/2 sum_i ((x_i - m_i) / s_i)^2
/// ```
///
/// The covariances are those of one point of the search; [`fit`](super::fit) renews them until they
/// settle, so that gradient and objective always belong together.
pub(super) struct ComposedProblem<'a> {
    pub(super) model: &'a ComposedModel,
    pub(super) events: &'a [EventRows<'a>],
    pub(super) covariances: Vec<EventCovariance>,
    pub(super) coordinates: &'a Coordinates,
    pub(super) cancel: &'a (dyn Fn() -> bool + Sync),
}

impl ComposedProblem<'_> {
    /// `sum_e r' Sigma^-1 r` for each event.
    pub(super) fn squares(&self, parameters: &[f64]) -> Option<Vec<f64>> {
        let mut squares = Vec::with_capacity(self.events.len());
        for (event, covariance) in self.events.iter().zip(&self.covariances) {
            if (self.cancel)() {
                return None;
            }
            let residual = event.residual(self.model, parameters).ok()?;
            squares.push(covariance.square(&residual));
        }
        Some(squares)
    }
}

impl Objective for ComposedProblem<'_> {
    fn dimension(&self) -> usize {
        self.coordinates.count()
    }

    fn value(&self, x: &DVector<f64>) -> Option<f64> {
        let squares = self.squares(&self.coordinates.parameters(x))?;
        let (prior, _, _) = self.coordinates.prior(x);
        let value = 0.5 * squares.iter().sum::<f64>() + prior;
        value.is_finite().then_some(value)
    }

    fn expansion(&self, x: &DVector<f64>) -> Option<Expansion> {
        let count = self.dimension();
        let parameters = self.coordinates.parameters(x);
        let wanted = self.coordinates.indices();
        let mut sum = DMatrix::zeros(count + 1, count + 1);
        for (event, covariance) in self.events.iter().zip(&self.covariances) {
            if (self.cancel)() {
                return None;
            }
            let rows = event.expanded(self.model, &parameters, &wanted).ok()?;
            sum += covariance.gram(&rows);
        }
        let slopes = self.coordinates.slopes(&parameters);
        let (prior, prior_gradient, precision) = self.coordinates.prior(x);
        let value = 0.5 * sum[(count, count)] + prior;
        let gradient = DVector::from_fn(count, |i, _| {
            prior_gradient[i] - slopes[i] * sum[(i, count)]
        });
        let curvature = DMatrix::from_fn(count, count, |i, j| {
            let own = if i == j { precision[i] } else { 0.0 };
            slopes[i] * sum[(i, j)] * slopes[j] + own
        });
        value.is_finite().then_some(Expansion {
            value,
            gradient,
            curvature,
        })
    }
}
