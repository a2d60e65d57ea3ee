//! A local fit of a composed model from a given start.

use nalgebra::{DMatrix, DVector};

use super::{
    coordinates::Coordinates,
    covariance::EventCovariance,
    problem::ComposedProblem,
    rows::{EventRows, Scatter},
};
use crate::{
    identification::intake::PreparedEvent,
    load_model::composed::ComposedModel,
    numerics::{Objective, local_solver},
};

/// Settings of a composed fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComposedFitOptions {
    /// What varies from event to event.
    pub scatter: Scatter,
    /// How often the covariances are renewed at most. Default 2; at least 1.
    pub rounds_max: usize,
    /// The rounds end when one lowers the objective by less than this share. Default 1e-3.
    pub settled_relative: f64,
    /// The local solver.
    pub local: local_solver::Options,
}

impl Default for ComposedFitOptions {
    fn default() -> Self {
        Self {
            scatter: Scatter::default(),
            rounds_max: 2,
            settled_relative: 1e-3,
            local: local_solver::Options {
                evaluations_max: 40,
                decrease_relative: 1e-5,
                step_relative: 1e-6,
                ..local_solver::Options::default()
            },
        }
    }
}

/// A fitted composed model.
#[derive(Clone, Debug)]
pub struct ComposedFit {
    /// The model.
    pub model: ComposedModel,
    /// Every parameter, in the model's order.
    pub parameters: Vec<f64>,
    /// Which parameters were free, as indices.
    pub free: Vec<usize>,
    /// Objective at the end: half the weighted squares plus priors.
    pub objective: f64,
    /// `r' Sigma^-1 r` of every event.
    pub squares: Vec<f64>,
    /// Minus twice the logarithm of the likelihood, up to a constant that is the same for every
    /// model of these events.
    pub minus_twice_log_likelihood: f64,
    /// Number of rows (samples of P and of Q).
    pub rows: usize,
    /// Covariance of the free parameters; `None` where the curvature is singular.
    pub covariance: Option<DMatrix<f64>>,
    /// Calls of the objective, one per joint simulation of all events.
    pub evaluations: u64,
}

impl ComposedFit {
    /// `chi^2 / N` of all events.
    #[must_use]
    pub fn chi_square_per_row(&self) -> f64 {
        self.squares.iter().sum::<f64>() / self.rows.max(1) as f64
    }

    /// Bayesian information criterion: `-2 ln L + k ln N`.
    #[must_use]
    pub fn bayesian_information(&self) -> f64 {
        self.minus_twice_log_likelihood + self.free.len() as f64 * (self.rows.max(1) as f64).ln()
    }

    /// The criterion by which structures compete: [`Self::bayesian_information`] plus what the priors
    /// say of the parameters, so that a shape nobody has seen pays for it.
    #[must_use]
    pub fn criterion(&self) -> f64 {
        let prior = 2.0 * self.objective - self.squares.iter().sum::<f64>();
        self.bayesian_information() + prior
    }

    /// Standard error of a free parameter.
    #[must_use]
    pub fn standard_error(&self, index: usize) -> Option<f64> {
        let place = self.free.iter().position(|i| *i == index)?;
        let variance = self.covariance.as_ref()?[(place, place)];
        (variance > 0.0).then(|| variance.sqrt())
    }
}

/// Fits the parameters `free` (indices, ascending) to the events from `start`. `None` when the
/// start cannot be simulated or the caller asked to stop.
#[must_use]
pub fn fit(
    events: &[PreparedEvent],
    model: &ComposedModel,
    start: &[f64],
    free: &[usize],
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<ComposedFit> {
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    fit_rows(&rows, model, start, free, options, cancel)
}

pub(super) fn fit_rows(
    rows: &[EventRows<'_>],
    model: &ComposedModel,
    start: &[f64],
    free: &[usize],
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<ComposedFit> {
    let coordinates = Coordinates::new(model, start, free);
    let bounds = coordinates.bounds();
    let mut x = coordinates.unknowns(start);
    let mut evaluations = 0;
    let mut before = f64::INFINITY;
    for round in 1..=options.rounds_max.max(1) {
        let problem = problem_at(rows, model, &coordinates, &x, &options.scatter, cancel)?;
        let found = local_solver::minimise(&problem, &bounds, &x, &options.local, cancel).ok()?;
        evaluations += found.cost.evaluations();
        x.clone_from(&found.x);
        let settled = before - found.value < options.settled_relative * found.value;
        if settled || round >= options.rounds_max {
            return finished(rows, model, &coordinates, &x, options, evaluations, cancel);
        }
        before = found.value;
    }
    None
}

fn problem_at<'a>(
    rows: &'a [EventRows<'a>],
    model: &'a ComposedModel,
    coordinates: &'a Coordinates,
    x: &DVector<f64>,
    scatter: &Scatter,
    cancel: &'a (dyn Fn() -> bool + Sync),
) -> Option<ComposedProblem<'a>> {
    let parameters = coordinates.parameters(x);
    let covariance = |event: &EventRows<'_>| event.covariance(model, &parameters, scatter).ok()?;
    Some(ComposedProblem {
        model,
        events: rows,
        covariances: rows.iter().map(covariance).collect::<Option<_>>()?,
        coordinates,
        cancel,
    })
}

fn finished(
    rows: &[EventRows<'_>],
    model: &ComposedModel,
    coordinates: &Coordinates,
    x: &DVector<f64>,
    options: &ComposedFitOptions,
    evaluations: u64,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<ComposedFit> {
    let problem = problem_at(rows, model, coordinates, x, &options.scatter, cancel)?;
    let parameters = coordinates.parameters(x);
    let expansion = problem.expansion(x)?;
    let squares = problem.squares(&parameters)?;
    let determinants: f64 = problem
        .covariances
        .iter()
        .map(EventCovariance::log_determinant)
        .sum();
    let slopes = DVector::from_vec(coordinates.slopes(&parameters));
    let covariance = expansion.curvature.cholesky().map(|factor| {
        let inverse = factor.inverse();
        DMatrix::from_fn(slopes.len(), slopes.len(), |i, j| {
            slopes[i] * inverse[(i, j)] * slopes[j]
        })
    });
    Some(ComposedFit {
        model: model.clone(),
        free: coordinates.indices(),
        objective: expansion.value,
        minus_twice_log_likelihood: squares.iter().sum::<f64>() + determinants,
        squares,
        rows: rows.iter().map(EventRows::count).sum(),
        covariance,
        evaluations,
        parameters,
    })
}

/// `r' Sigma^-1 r` of every event under given parameters, what varies from event to event
/// marginalised: the misfit of events that were not fitted. `None` when one cannot be simulated.
#[must_use]
pub fn squares(
    events: &[PreparedEvent],
    model: &ComposedModel,
    parameters: &[f64],
    scatter: &Scatter,
) -> Option<Vec<f64>> {
    let square = |event: &PreparedEvent| {
        let rows = EventRows::new(event);
        let covariance = rows.covariance(model, parameters, scatter).ok()??;
        let residual = rows.residual(model, parameters).ok()?;
        Some(covariance.square(&residual))
    };
    events.iter().map(square).collect()
}
