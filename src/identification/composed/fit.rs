//! A local fit of a composed model from a given start.

use std::sync::Mutex;

use nalgebra::{DMatrix, DVector};

use super::{
    coordinates::Coordinates,
    covariance::EventCovariance,
    operating_point::LINEAR_COUNT,
    problem::{ComposedProblem, Linearised},
    relay_walk,
    rows::{EventRows, Scatter, random_effects},
};
use crate::{
    identification::{evaluate::Curves, intake::PreparedEvent},
    load_model::composed::{Accuracy, ComposedModel},
    numerics::{LocalSolution, Objective, local_solver, local_solver::Termination},
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

/// A coarse fit ends when a step promises less than this share of the objective: about one unit of it
/// where the noise is reached, a tenth of what separates two structures by the criterion ...
const COARSE_DECREASE_RELATIVE: f64 = 3e-4;
/// ... or after so many calls.
const COARSE_EVALUATIONS_MAX: u64 = 16;
/// A start that leaves more than this per row is first brought nearer with the noise alone.
const APPROACHED: f64 = 4.0;
/// While more than that is left the relays' settings are walked, at most so often, ...
const WALKS_MAX: usize = 4;
/// ... as long as that lowers the objective by this share.
const WALK_WORTH: f64 = 0.02;
/// What is wanted is told with what varies from event to event; with the noise alone this many times as much.
const WANTED_OF_NOISE_ALONE: f64 = 10.0;
/// What leaves more than this per row is simulated roughly: there effects are looked for and fitted by
/// what is far greater.
pub(super) const ROUGH_ABOVE: f64 = 4.0;
/// A fit that leaves more than this per row is no nearer to the truth for being exact.
const FAR: f64 = 25.0;

impl ComposedFitOptions {
    /// Enough to tell which of many starts and candidates are worth a fit to the end.
    #[must_use]
    pub fn coarse(&self) -> Self {
        let local = local_solver::Options {
            evaluations_max: self.local.evaluations_max.min(COARSE_EVALUATIONS_MAX),
            decrease_relative: self.local.decrease_relative.max(COARSE_DECREASE_RELATIVE),
            ..self.local
        };
        Self {
            rounds_max: 1,
            local,
            ..*self
        }
    }

    /// The same, for fits that are given up where `squares` (weighted, of all events) are out of reach.
    #[must_use]
    pub fn wanting(&self, squares: f64) -> Self {
        let wanted = 0.5 * squares;
        Self {
            local: local_solver::Options {
                wanted,
                ..self.local
            },
            ..*self
        }
    }

    /// Whether it is one of [`Self::coarse`].
    fn is_coarse(&self) -> bool {
        self.rounds_max <= 1
    }
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
    /// Whether the fit was given up because what was wanted of it is out of reach.
    pub given_up: bool,
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
        self.bayesian_information() + self.prior()
    }

    /// Minus twice the logarithm of the posterior density, up to a constant.
    #[must_use]
    pub fn minus_twice_log_posterior(&self) -> f64 {
        self.minus_twice_log_likelihood + self.prior()
    }

    fn prior(&self) -> f64 {
        2.0 * self.objective - self.squares.iter().sum::<f64>()
    }

    /// Standard error of a free parameter.
    #[must_use]
    pub fn standard_error(&self, index: usize) -> Option<f64> {
        let place = self.free.iter().position(|i| *i == index)?;
        let variance = self.covariance.as_ref()?[(place, place)];
        (variance > 0.0).then(|| variance.sqrt())
    }
}

/// Fits the parameters `free` (indices, ascending) to the events from `start`: no worse by the posterior
/// than where it begins, or, far from the events, than where the noise alone leads. `None` when the start
/// cannot be simulated or the caller asked to stop.
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
    let coordinates = Coordinates::new(model, start, free);
    let place = Place::new(&rows, model, &coordinates, options, cancel);
    let mut fitting = Fitting::new(place, options, start);
    // A sketch is so short that it may as well go the whole way by fine steps.
    if !options.is_coarse() && fitting.left()? > APPROACHED {
        // The way there is far longer than what rough steps miss.
        let of = |event| EventRows::with_accuracy(event, Accuracy::Rough);
        let rough: Vec<EventRows<'_>> = events.iter().map(of).collect();
        let place = Place::new(&rough, model, &coordinates, options, cancel);
        let mut roughly = Fitting::new(place, options, start);
        if roughly.approach().is_some() {
            fitting.x = roughly.x;
            fitting.lowest = None;
            fitting.evaluations += roughly.evaluations;
        }
    }
    fitting.completed()
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
    let place = Place::new(rows, model, &coordinates, options, cancel);
    Fitting::new(place, options, start).completed()
}

/// The first part of a fit: where the noise alone leads from a start that is far from the events, and what is
/// left there per row.
pub(super) fn approached(
    rows: &[EventRows<'_>],
    model: &ComposedModel,
    start: &[f64],
    free: &[usize],
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<(Vec<f64>, f64)> {
    let coordinates = Coordinates::new(model, start, free);
    let place = Place::new(rows, model, &coordinates, options, cancel);
    let mut fitting = Fitting::new(place, options, start);
    let left = fitting.come_near()?;
    Some((coordinates.parameters(&fitting.x), left))
}

/// Everything at `parameters` as they are, nothing fitted. `None` when they cannot be simulated.
pub(super) fn unfitted(
    rows: &[EventRows<'_>],
    model: &ComposedModel,
    parameters: &[f64],
    free: &[usize],
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<ComposedFit> {
    let coordinates = Coordinates::new(model, parameters, free);
    let place = Place::new(rows, model, &coordinates, options, cancel);
    let (fit, _) = place.finished(&coordinates.unknowns(parameters), None, 0)?;
    Some(fit)
}

/// A fit under way.
struct Fitting<'a> {
    place: Place<'a>,
    options: &'a ComposedFitOptions,
    coarse: local_solver::Options,
    x: DVector<f64>,
    /// The simulation at `x`, where it is known.
    lowest: Option<Linearised>,
    evaluations: u64,
    given_up: bool,
}

impl<'a> Fitting<'a> {
    fn new(place: Place<'a>, options: &'a ComposedFitOptions, start: &[f64]) -> Self {
        Self {
            place,
            options,
            coarse: options.coarse().local,
            x: place.coordinates.unknowns(start),
            lowest: None,
            evaluations: 0,
            given_up: false,
        }
    }

    /// All of a fit.
    fn completed(mut self) -> Option<ComposedFit> {
        let left = self.come_near()?;
        let begun = self.finished()?;
        if left > FAR {
            return Some(begun);
        }
        // Renewed covariances may find the end of a round above where it began.
        let settled = self.settle();
        let most = begun.minus_twice_log_posterior();
        let lower = |fit: &ComposedFit| fit.minus_twice_log_posterior() <= most;
        Some(settled.filter(lower).unwrap_or(ComposedFit {
            given_up: self.given_up,
            ..begun
        }))
    }

    /// What the start leaves per row.
    fn left(&mut self) -> Option<f64> {
        let problem = self.place.problem(&self.x, self.lowest.take())?;
        let squares: f64 = problem.known_squares()?.iter().sum();
        self.lowest = problem.into_lowest();
        let count: usize = self.place.rows.iter().map(EventRows::count).sum();
        Some(squares / count as f64)
    }

    /// [`Self::approach`] where the start is far from the events. What is left per row.
    fn come_near(&mut self) -> Option<f64> {
        let left = self.left()?;
        if left > APPROACHED {
            self.approach()
        } else {
            Some(left)
        }
    }

    /// Comes near with the noise alone. With what varies from event to event marginalised, a model that
    /// misses by many times that variation slides along it for nothing, and the covariances, renewed,
    /// find it farther away than it was. What is left per row, noise alone.
    fn approach(&mut self) -> Option<f64> {
        let scatter = Scatter {
            composition: [0.0; LINEAR_COUNT],
            motor_share: 0.0,
            effect_share: 0.0,
        };
        let place = Place {
            scatter: &scatter,
            ..self.place
        };
        let settings = local_solver::Options {
            evaluations_max: self.options.local.evaluations_max,
            wanted: WANTED_OF_NOISE_ALONE * self.coarse.wanted,
            ..self.coarse
        };
        let coordinates = self.place.coordinates;
        let bounds = coordinates.bounds();
        let count: usize = self.place.rows.iter().map(EventRows::count).sum();
        let mut walks = if self.options.is_coarse() {
            0
        } else {
            WALKS_MAX
        };
        loop {
            let problem = place.problem(&self.x, self.lowest.take())?;
            let found =
                local_solver::minimise(&problem, &bounds, &self.x, &settings, place.cancel).ok()?;
            self.evaluations += found.cost.evaluations();
            self.x = found.x;
            let left = 2.0 * found.value / count as f64;
            if walks == 0 || left < APPROACHED {
                self.lowest = problem.into_lowest();
                return Some(left);
            }
            walks -= 1;
            let begun = (self.x.clone(), found.value);
            let (x, value) = relay_walk::walk(&problem, place.model, coordinates, begun);
            self.lowest = problem.into_lowest();
            if value > (1.0 - WALK_WORTH) * found.value {
                return Some(left);
            }
            self.x = x;
        }
    }

    /// Rounds of fits, each with the covariances of where the one before ended.
    fn settle(&mut self) -> Option<ComposedFit> {
        let bounds = self.place.coordinates.bounds();
        let mut before = f64::INFINITY;
        let count: usize = self.place.rows.iter().map(EventRows::count).sum();
        let first = local_solver::Options {
            evaluations_max: self.options.local.evaluations_max,
            ..self.coarse
        };
        for round in 1..=self.options.rounds_max.max(1) {
            let problem = self.place.problem(&self.x, self.lowest.take())?;
            let cancel = self.place.cancel;
            let mut solve = |x: &DVector<f64>, settings: &local_solver::Options| {
                let found = local_solver::minimise(&problem, &bounds, x, settings, cancel).ok()?;
                self.evaluations += found.cost.evaluations();
                Some(found)
            };
            let local = &self.options.local;
            let mut found = solve(&self.x, if round == 1 { &first } else { local })?;
            let far = 2.0 * found.value > FAR * count as f64;
            // Where steps of no length lead down, finer ones and the same covariances do not either.
            let mut stuck = is_stuck(&found);
            if round == 1 && !far && !stuck && !is_given_up(&found) && *local != first {
                found = solve(&found.x, local)?;
                stuck = false;
            }
            self.given_up = is_given_up(&found);
            self.x = found.x;
            self.lowest = problem.into_lowest();
            let settled = before - found.value < self.options.settled_relative * found.value;
            if far || stuck || settled || self.given_up {
                break;
            }
            before = found.value;
        }
        self.finished()
    }

    fn finished(&mut self) -> Option<ComposedFit> {
        let (fit, lowest) = self
            .place
            .finished(&self.x, self.lowest.take(), self.evaluations)?;
        self.lowest = lowest;
        Some(ComposedFit {
            given_up: self.given_up,
            ..fit
        })
    }
}

/// Whether what was wanted is out of reach.
fn is_given_up(found: &LocalSolution) -> bool {
    matches!(found.termination, Termination::OutOfReach { .. })
}

/// Whether steps were tried and none lowered the objective.
fn is_stuck(found: &LocalSolution) -> bool {
    found.cost.steps_accepted == 0 && found.cost.steps_rejected > 0
}

/// What stays the same in a fit.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) rows: &'a [EventRows<'a>],
    pub(super) model: &'a ComposedModel,
    pub(super) coordinates: &'a Coordinates,
    pub(super) scatter: &'a Scatter,
    pub(super) cancel: &'a (dyn Fn() -> bool + Sync),
}

impl<'a> Place<'a> {
    pub(super) fn new(
        rows: &'a [EventRows<'a>],
        model: &'a ComposedModel,
        coordinates: &'a Coordinates,
        options: &'a ComposedFitOptions,
        cancel: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        Self {
            rows,
            model,
            coordinates,
            scatter: &options.scatter,
            cancel,
        }
    }

    /// The problem with the covariances of a point, from memory where `known` is that point.
    pub(super) fn problem(
        &self,
        x: &DVector<f64>,
        known: Option<Linearised>,
    ) -> Option<ComposedProblem<'a>> {
        let parameters = self.coordinates.parameters(x);
        let mut wanted = self.coordinates.indices();
        for (index, _) in random_effects(self.model, &parameters, self.scatter) {
            if !wanted.contains(&index) {
                wanted.push(index);
            }
        }
        let point = match known.filter(|known| known.serves(&parameters, &wanted)) {
            Some(known) => known,
            None => Linearised::new(self.rows, self.model, parameters, wanted, self.cancel)?,
        };
        Some(ComposedProblem {
            model: self.model,
            events: self.rows,
            covariances: point.covariances(self.rows, self.model, self.scatter)?,
            coordinates: self.coordinates,
            cancel: self.cancel,
            lowest: Mutex::new(Some((point, f64::INFINITY))),
        })
    }

    pub(super) fn finished(
        &self,
        x: &DVector<f64>,
        known: Option<Linearised>,
        evaluations: u64,
    ) -> Option<(ComposedFit, Option<Linearised>)> {
        let problem = self.problem(x, known)?;
        let parameters = self.coordinates.parameters(x);
        let expansion = problem.expansion(x)?;
        let covariances = &problem.covariances;
        let squares = problem.known_squares()?;
        let determinants: f64 = covariances
            .iter()
            .map(EventCovariance::log_determinant)
            .sum();
        let slopes = DVector::from_vec(self.coordinates.slopes(&parameters));
        let free = self.coordinates.indices();
        let covariance = expansion.curvature.cholesky().map(|factor| {
            let inverse = factor.inverse();
            DMatrix::from_fn(slopes.len(), slopes.len(), |i, j| {
                slopes[i] * inverse[(i, j)] * slopes[j]
            })
        });
        let fit = ComposedFit {
            model: self.model.clone(),
            free,
            objective: expansion.value,
            minus_twice_log_likelihood: squares.iter().sum::<f64>() + determinants,
            squares,
            rows: self.rows.iter().map(EventRows::count).sum(),
            covariance,
            evaluations,
            given_up: false,
            parameters,
        };
        Some((fit, problem.into_lowest()))
    }
}

/// What a fit makes of an event with the composition that the event most probably has: what is left beside the
/// measurement is noise, or something missing. Not a number at samples that are not used; `None` when
/// it cannot be simulated.
#[must_use]
pub fn with_own_composition(
    event: &PreparedEvent,
    fit: &ComposedFit,
    scatter: &Scatter,
) -> Option<Curves> {
    EventRows::new(event).with_own_composition(&fit.model, &fit.parameters, scatter)
}

/// How far the composition of every event most probably is from that of a fit, in the standard deviations that are assumed,
/// the largest of all its parts. `None` when one cannot be simulated.
#[must_use]
pub fn composition_deviations(
    events: &[PreparedEvent],
    fit: &ComposedFit,
    scatter: &Scatter,
) -> Option<Vec<f64>> {
    let of = |event: &PreparedEvent| {
        EventRows::new(event).composition_deviation(&fit.model, &fit.parameters, scatter)
    };
    events.iter().map(of).collect()
}

/// Events are followed as well where what is left of them rises by no more than two standard errors ...
const RISE: f64 = 4.0;
/// ... or by this share of it, if that is more: residuals last.
pub const RISE_OF_LEFT: f64 = 0.003;

/// Whether what is left of events is as little as the `least`, but for two standard errors or this share of it.
#[must_use]
pub fn follows_as_well(left: f64, least: f64, share: f64) -> bool {
    left <= least + RISE.max(share * least)
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
