//! The rows of one event: every used sample of P, then of Q, as residuals and derivative columns.

use nalgebra::{DMatrix, DVector};

use super::covariance::EventCovariance;
use crate::{
    identification::{intake::PreparedEvent, joint_problem::ProblemOptions},
    load_model::{
        composed::{ComposedModel, Drive, Response, SimulationError},
        effect::{Place, Role},
        effects,
    },
};

/// First of the linear coefficients in a composed model's vector.
const LINEAR_FIRST: usize = 3;
/// Linear coefficients: motor share, `c_z`, `c_i`, `d_z`, `d_i`.
const LINEAR_COUNT: usize = 5;
/// Spread of an effect's share from event to event, relative to the share.
const EFFECT_SPREAD_RELATIVE: f64 = 0.06;

/// What varies from event to event, as standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// Of the linear coefficients, relative to P0.
    pub composition: [f64; LINEAR_COUNT],
    /// Of an effect's share of the load, relative to that share.
    pub effect_share: f64,
}

impl Default for Scatter {
    fn default() -> Self {
        Self {
            composition: ProblemOptions::default().composition_spread,
            effect_share: EFFECT_SPREAD_RELATIVE,
        }
    }
}

/// An event with everything that does not change during a fit.
#[derive(Clone, Debug)]
pub(super) struct EventRows<'a> {
    event: &'a PreparedEvent,
    /// Used samples.
    used: Vec<usize>,
    measured: DVector<f64>,
    deviations: Vec<f64>,
}

impl<'a> EventRows<'a> {
    pub(super) fn new(event: &'a PreparedEvent) -> Self {
        let used: Vec<usize> = (0..event.len()).filter(|&k| event.used[k]).collect();
        let both = |p: &[f64], q: &[f64]| -> Vec<f64> {
            let active = used.iter().map(|&k| p[k]);
            active.chain(used.iter().map(|&k| q[k])).collect()
        };
        Self {
            measured: DVector::from_vec(both(&event.active, &event.reactive)),
            deviations: both(&event.active_deviation, &event.reactive_deviation),
            used,
            event,
        }
    }

    /// Number of rows.
    pub(super) fn count(&self) -> usize {
        self.measured.len()
    }

    fn simulate(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        wanted: &[usize],
    ) -> Result<Response, SimulationError> {
        let event = self.event;
        let (own, slopes) = model.on_event_base(parameters, event.v0_pu, event.p0_pu);
        let mut response = model.simulate(&own, wanted, &drive(event))?;
        let columns = (response.active_derivatives.iter_mut())
            .zip(&mut response.reactive_derivatives)
            .zip(wanted);
        for ((active, reactive), index) in columns {
            for derivative in active.iter_mut().chain(reactive) {
                *derivative *= slopes[*index];
            }
        }
        Ok(response)
    }

    /// Measured minus modelled.
    pub(super) fn residual(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
    ) -> Result<DVector<f64>, SimulationError> {
        let response = self.simulate(model, parameters, &[])?;
        Ok(&self.measured - self.stacked(&response.active, &response.reactive))
    }

    /// Derivatives of the modelled rows, one column per wanted parameter, and the residual as the
    /// last column.
    pub(super) fn expanded(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        wanted: &[usize],
    ) -> Result<DMatrix<f64>, SimulationError> {
        let response = self.simulate(model, parameters, wanted)?;
        let mut rows = DMatrix::zeros(self.count(), wanted.len() + 1);
        let derivatives = response
            .active_derivatives
            .iter()
            .zip(&response.reactive_derivatives);
        for (column, (p, q)) in derivatives.enumerate() {
            rows.set_column(column, &self.stacked(p, q));
        }
        let residual = &self.measured - self.stacked(&response.active, &response.reactive);
        rows.set_column(wanted.len(), &residual);
        Ok(rows)
    }

    /// The covariance at a point of the search.
    pub(super) fn covariance(
        &self,
        model: &ComposedModel,
        parameters: &[f64],
        scatter: &Scatter,
    ) -> Result<Option<EventCovariance>, SimulationError> {
        let mut wanted: Vec<usize> = (LINEAR_FIRST..LINEAR_FIRST + LINEAR_COUNT).collect();
        let mut spread = scatter.composition.to_vec();
        for (index, value) in shares(model, parameters) {
            wanted.push(index);
            spread.push(scatter.effect_share * value.abs());
        }
        let rows = self.expanded(model, parameters, &wanted)?;
        let mut random = DMatrix::zeros(self.count(), wanted.len() + 2);
        for (column, spread) in spread.iter().enumerate() {
            random.set_column(column, &(rows.column(column) * *spread));
        }
        let outputs = self.event.chain.output_voltage().len();
        let (one, none) = (vec![1.0; outputs], vec![0.0; outputs]);
        let offset = self.event.operating_point_deviation;
        random.set_column(wanted.len(), &(self.stacked(&one, &none) * offset));
        random.set_column(wanted.len() + 1, &(self.stacked(&none, &one) * offset));
        Ok(EventCovariance::new(&self.deviations, &random))
    }

    /// P and Q at the output instants as the instrument reports them, at the used samples.
    fn stacked(&self, active: &[f64], reactive: &[f64]) -> DVector<f64> {
        let measured = self.event.chain.measured(active, reactive);
        let channel = |c: usize| self.used.iter().map(move |&k| (k, c));
        let rows = channel(0).chain(channel(1)).map(|(k, c)| measured[k][c]);
        DVector::from_iterator(2 * self.used.len(), rows)
    }
}

/// What drives a composed model in an event.
pub(super) fn drive(event: &PreparedEvent) -> Drive<'_> {
    Drive {
        terminal: &event.input,
        frequency_deviation: event.chain.output_frequency_deviation(),
        reactive_at_rest: event.q0_pu / event.p0_pu,
    }
}

/// Amplitudes that are shares of the load and not absent: they vary with its composition.
fn shares(model: &ComposedModel, parameters: &[f64]) -> Vec<(usize, f64)> {
    let is_share = |p: &crate::load_model::composed::ModelParameter| {
        let one_sided = matches!(p.declaration.role, Role::OneSidedAmplitude { .. });
        let effect = p.effect.and_then(effects::find);
        one_sided && effect.is_some_and(|e| e.declaration().acts_on(Place::Power))
    };
    let all = model.parameters().iter().zip(parameters).enumerate();
    all.filter(|(_, (p, value))| is_share(p) && !p.declaration.neutral.eq(*value))
        .map(|(index, (_, value))| (index, *value))
        .collect()
}
