//! What of the scores of an effect depends on the fitted model alone.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

use super::{
    coordinates::Coordinates,
    covariance::{EventCovariance, Weighted},
    fit::ComposedFit,
    rows::{EventRows, Scatter},
};
use crate::load_model::composed::ComposedModel;

/// Of every event the derivative columns of what was free, the residual and the covariance; and what the
/// priors say.
pub(super) struct Base {
    pub(super) events: Vec<BaseOfEvent>,
    prior: PriorOfBase,
    /// Information of the data and the priors on what was free; none where it is singular.
    information: Option<Cholesky<f64, Dyn>>,
    /// What pulls at it ...
    pull: DVector<f64>,
    /// ... and the weighted squares that are left, as the columns' products give them.
    square: f64,
}

/// The priors of what was free, in the parameters' own units. A threshold between two dips has no slope:
/// its prior is all that holds it.
struct PriorOfBase {
    /// Squared distance from the centres, in deviations.
    square: f64,
    /// What pulls each parameter away from its centre.
    gradient: DVector<f64>,
    precision: DVector<f64>,
}

pub(super) struct BaseOfEvent {
    /// Derivative columns and, last, the residual.
    rows: Weighted,
    pub(super) residual: DVector<f64>,
    covariance: EventCovariance,
    /// Lowest voltage that the load sees.
    pub(super) lowest_voltage_pu: f64,
}

/// Weighted products of columns that are added to an event, or to all of them.
#[derive(Clone, Debug)]
pub(super) struct Added {
    /// With the base's columns and, last, its residual.
    with_base: DMatrix<f64>,
    with_each_other: DMatrix<f64>,
}

/// The least-squares problem of added columns when everything in the base follows.
pub(super) struct Projected {
    /// Information on the added columns and, last, the residual.
    pub(super) information: DMatrix<f64>,
    /// The diagonal of that where nothing follows.
    pub(super) own: DVector<f64>,
    /// Products of the base's columns with the added ones and, last, the residual.
    pub(super) cross: DMatrix<f64>,
    pub(super) factor: Cholesky<f64, Dyn>,
}

impl Base {
    /// Of a fit to the events; `None` where one cannot be simulated.
    pub(super) fn new(
        rows: &[EventRows<'_>],
        fit: &ComposedFit,
        scatter: &Scatter,
    ) -> Option<Self> {
        let count = fit.free.len();
        let of = |event: &EventRows<'_>| {
            let expanded = event
                .expanded(&fit.model, &fit.parameters, &fit.free)
                .ok()?;
            let covariance = (event.covariance(&fit.model, &fit.parameters, scatter)).ok()??;
            Some(BaseOfEvent {
                residual: expanded.column(count).into_owned(),
                rows: covariance.weighted(&expanded),
                covariance,
                lowest_voltage_pu: (event.lowest_voltage_at_load_pu(&fit.model, &fit.parameters))
                    .ok()?,
            })
        };
        let events: Vec<BaseOfEvent> = rows.iter().map(of).collect::<Option<_>>()?;
        let prior = PriorOfBase::new(fit);
        let mut sum = DMatrix::zeros(count + 1, count + 1);
        for event in &events {
            sum += event.rows.product(&event.rows);
        }
        let mut information = sum.view((0, 0), (count, count)).into_owned();
        for i in 0..count {
            // What the base leaves undetermined must not be divided by.
            information[(i, i)] = information[(i, i)] * (1.0 + 1e-9) + prior.precision[i];
        }
        Some(Self {
            information: information.cholesky(),
            pull: sum.view((0, count), (count, 1)).column(0) - &prior.gradient,
            square: sum[(count, count)] + prior.square,
            events,
            prior,
        })
    }

    /// `sum r' Sigma^-1 r` and the squared distance from the priors, without any effect.
    pub(super) fn left(&self) -> f64 {
        let events = self.events.iter();
        let squares: f64 = events.map(|e| e.covariance.square(&e.residual)).sum();
        squares + self.prior.square
    }

    /// `sum r' Sigma^-1 r` of a model with the covariances of this one.
    pub(super) fn squares(
        &self,
        rows: &[EventRows<'_>],
        model: &ComposedModel,
        parameters: &[f64],
    ) -> Option<f64> {
        let square = |(event, base): (&EventRows<'_>, &BaseOfEvent)| {
            let residual = event.residual(model, parameters).ok()?;
            Some(base.covariance.square(&residual))
        };
        let squares: Option<Vec<f64>> = rows.iter().zip(&self.events).map(square).collect();
        Some(squares?.iter().sum())
    }

    /// The problem of columns that were added to all events.
    pub(super) fn projected(&self, added: &Added) -> Option<Projected> {
        let factor = self.information.clone()?;
        let (before, count) = (self.pull.len(), added.with_each_other.ncols());
        let mut own = DMatrix::zeros(count + 1, count + 1);
        own.view_mut((0, 0), (count, count))
            .copy_from(&added.with_each_other);
        for i in 0..count {
            let with_residual = added.with_base[(before, i)];
            own[(i, count)] = with_residual;
            own[(count, i)] = with_residual;
        }
        own[(count, count)] = self.square;
        let mut cross = DMatrix::zeros(before, count + 1);
        cross
            .columns_mut(0, count)
            .copy_from(&added.with_base.rows(0, before));
        cross.set_column(count, &self.pull);
        Some(Projected {
            information: &own - cross.tr_mul(&factor.solve(&cross)),
            own: own.diagonal(),
            cross,
            factor,
        })
    }
}

impl BaseOfEvent {
    /// What some columns add to the event.
    pub(super) fn added(&self, columns: &DMatrix<f64>) -> Added {
        let columns = self.covariance.weighted(columns);
        Added {
            with_base: self.rows.product(&columns),
            with_each_other: columns.product(&columns),
        }
    }
}

impl Added {
    /// The sum over events.
    #[must_use]
    pub(super) fn plus(self, other: &Self) -> Self {
        Self {
            with_base: self.with_base + &other.with_base,
            with_each_other: self.with_each_other + &other.with_each_other,
        }
    }
}

impl PriorOfBase {
    fn new(fit: &ComposedFit) -> Self {
        let coordinates = Coordinates::new(&fit.model, &fit.parameters, &fit.free);
        let slopes = DVector::from_vec(coordinates.slopes(&fit.parameters));
        let (half_square, gradient, precision) =
            coordinates.prior(&coordinates.unknowns(&fit.parameters));
        Self {
            square: 2.0 * half_square,
            gradient: gradient.component_div(&slopes),
            precision: precision.component_div(&slopes.component_mul(&slopes)),
        }
    }
}
