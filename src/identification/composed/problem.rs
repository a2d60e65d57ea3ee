//! The objective of a composed model over several events.

use std::sync::Mutex;

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{
    coordinates::Coordinates,
    covariance::{EventCovariance, Products},
    rows::{EventRows, Scatter, random_effects},
};
use crate::{
    load_model::composed::ComposedModel,
    numerics::{Expansion, Objective},
};

/// Every event's derivative columns and residual at one point: all that objective, gradient, curvature
/// and covariances need of a simulation.
pub(super) struct Linearised {
    parameters: Vec<f64>,
    /// The parameter of each column.
    wanted: Vec<usize>,
    /// Of every event: the derivative columns and, last, the residual.
    rows: Vec<DMatrix<f64>>,
}

impl Linearised {
    /// At `parameters`, by the parameters `wanted`. The events are simulated side by side.
    pub(super) fn new(
        events: &[EventRows<'_>],
        model: &ComposedModel,
        parameters: Vec<f64>,
        wanted: Vec<usize>,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        let expanded = |event: &EventRows<'_>| {
            if cancel() {
                return None;
            }
            event.expanded(model, &parameters, &wanted).ok()
        };
        let rows = events.par_iter().map(expanded).collect::<Option<_>>()?;
        Some(Self {
            parameters,
            wanted,
            rows,
        })
    }

    /// Whether it is that of `parameters`, with the columns `wanted`.
    pub(super) fn serves(&self, parameters: &[f64], wanted: &[usize]) -> bool {
        let same = |(x, y): (&f64, &f64)| x.to_bits() == y.to_bits();
        self.parameters.iter().zip(parameters).all(same)
            && wanted.iter().all(|w| self.wanted.contains(w))
    }

    /// The covariances of the events here.
    pub(super) fn covariances(
        &self,
        events: &[EventRows<'_>],
        model: &ComposedModel,
        scatter: &Scatter,
    ) -> Option<Vec<EventCovariance>> {
        let random = random_effects(model, &self.parameters, scatter);
        let both = events.iter().zip(&self.rows);
        let at = (model, &self.parameters[..]);
        both.map(|(event, rows)| event.covariance_of((rows, &self.wanted), &random, at))
            .collect()
    }

    /// `sum_e r' Sigma^-1 r` for each event.
    pub(super) fn squares(&self, covariances: &[EventCovariance]) -> Vec<f64> {
        let both = self.rows.iter().zip(covariances);
        both.map(|(rows, covariance)| {
            covariance.square(&rows.column(self.wanted.len()).into_owned())
        })
        .collect()
    }

    /// Where the columns of some parameters and the residual are.
    fn places(&self, parameters: &[usize]) -> Option<Vec<usize>> {
        let place = |index: &usize| self.wanted.iter().position(|w| w == index);
        let mut places: Vec<usize> = parameters.iter().map(place).collect::<Option<_>>()?;
        places.push(self.wanted.len());
        Some(places)
    }

    /// Sum of the events' `A' Sigma^-1 A`, `A` being the columns of some parameters and the residual.
    fn gram(&self, covariances: &[EventCovariance], parameters: &[usize]) -> Option<DMatrix<f64>> {
        let places = self.places(parameters)?;
        let all = places.iter().copied().eq(0..=self.wanted.len());
        let grams: Vec<DMatrix<f64>> = self
            .rows
            .par_iter()
            .zip(covariances)
            .map(|(rows, covariance)| {
                if all {
                    covariance.gram(rows)
                } else {
                    covariance.gram(&rows.select_columns(&places))
                }
            })
            .collect();
        // In the order of the events, whatever the order in which they were done.
        let mut grams = grams.into_iter();
        let first = grams.next()?;
        Some(grams.fold(first, |sum, gram| sum + gram))
    }
}

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
    /// The lowest point that was expanded, with its value.
    pub(super) lowest: Mutex<Option<(Linearised, f64)>>,
}

impl ComposedProblem<'_> {
    /// The lowest point that was expanded.
    pub(super) fn into_lowest(self) -> Option<Linearised> {
        let lowest = self.lowest.into_inner().ok()?;
        lowest.map(|(point, _)| point)
    }

    /// `r' Sigma^-1 r` of every event at the lowest point that was expanded.
    pub(super) fn known_squares(&self) -> Option<Vec<f64>> {
        let lowest = self.lowest.lock().ok()?;
        Some(lowest.as_ref()?.0.squares(&self.covariances))
    }

    /// Products of every event's random effects, derivative columns and residual at the lowest point that was expanded.
    pub(super) fn products(&self) -> Option<Vec<Products>> {
        let lowest = self.lowest.lock().ok()?;
        let (point, _) = lowest.as_ref()?;
        let places = point.places(&self.coordinates.indices())?;
        let both = self.covariances.iter().zip(&point.rows);
        Some(
            both.map(|(covariance, rows)| covariance.products(&rows.select_columns(&places)))
                .collect(),
        )
    }

    /// `sum_e r' Sigma^-1 r` for each event.
    fn squares(&self, parameters: &[f64]) -> Option<Vec<f64>> {
        let square = |(event, covariance): (&EventRows<'_>, &EventCovariance)| {
            if (self.cancel)() {
                return None;
            }
            let residual = event.residual(self.model, parameters).ok()?;
            Some(covariance.square(&residual))
        };
        let both = self.events.par_iter().zip(&self.covariances);
        both.map(square).collect()
    }

    /// The point of `parameters`, from memory if it is there.
    fn linearised(&self, parameters: &[f64], wanted: &[usize]) -> Option<Linearised> {
        let mut known = self.lowest.lock().ok()?;
        let serves = |(point, _): &mut (Linearised, f64)| point.serves(parameters, wanted);
        if let Some((point, _)) = known.take_if(serves) {
            return Some(point);
        }
        drop(known);
        let (parameters, wanted) = (parameters.to_vec(), wanted.to_vec());
        Linearised::new(self.events, self.model, parameters, wanted, self.cancel)
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
        let point = self.linearised(&parameters, &wanted)?;
        let sum = point.gram(&self.covariances, &wanted)?;
        let slopes = self.coordinates.slopes(&parameters);
        let (prior, prior_gradient, precision) = self.coordinates.prior(x);
        let value = 0.5 * sum[(count, count)] + prior;
        if let Ok(mut lowest) = self.lowest.lock()
            && lowest.as_ref().is_none_or(|(_, known)| value <= *known)
        {
            *lowest = Some((point, value));
        }
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
