//! The objective of a joint fit: three nonlinear unknowns outside, the linear coefficients inside.
//!
//! For each event the weighted columns of the linear model (10) and the measurement form a small
//! Gram matrix; the events' matrices are summed, the linear coefficients follow from a convex
//! quadratic program under their bounds (variable projection), and the reduced gradient and
//! Gauss-Newton curvature of the outer unknowns come from the same matrices.
//!
//! The composition of a load differs a little from event to event, and so does its measured
//! operating point. Both are random effects with constant spread, marginalised exactly by
//! Woodbury's identity on the Gram matrices: no extra simulation, and events whose composition
//! deviates do not bend the shared parameters.

mod linear;
mod options;
mod simulated;

use std::sync::atomic::{AtomicU64, Ordering};

use nalgebra::{DMatrix, DVector, SMatrix};
use rayon::prelude::*;

use super::{
    gram::{COLUMNS, EventColumns, Gram, KeptSeries, Y},
    intake::PreparedEvent,
};
use crate::{
    load_model::{
        Infeasible, LinearCoefficients, MotorCoordinates,
        induction_motor::{Effort, LaneScalar, simulate_batch, simulate_batch_with_slopes},
    },
    numerics::{Bounds, Expansion, Objective, Scalar, Sensitivities},
};

use linear::{LinearMatrix, LinearVector, null_space};
pub use options::ProblemOptions;
pub(super) use simulated::Simulated;

/// Outer unknowns: ln alpha, ln nu, kappa.
pub const OUTER: usize = 3;
/// A number with its derivatives by the outer unknowns.
pub(super) type OuterSensitivities = Sensitivities<{ OUTER.div_ceil(2) }>;
/// Linear coefficients.
pub const LINEAR: usize = LinearCoefficients::COUNT;
/// Random effects of an event: its linear coefficients and its two operating-point offsets.
const RANDOM: usize = LINEAR + 2;

/// Bounds of the static shares `P_Z` and `P_P` in the paper's box (14).
pub const PAPER_SHARES: (f64, f64) = (0.1, 0.9);
/// Least motor share in the paper's box (14).
const PAPER_MOTOR_SHARE_MIN: f64 = 0.1;

/// Points that [`JointProblem`] simulates at once: their outputs fit into a processor's own cache.
const POINTS_AT_ONCE: usize = 64;
/// The same with sensitivities, which are four times as many numbers.
const EXPANSIONS_AT_ONCE: usize = 16;

/// Names of the outer unknowns, in order.
pub const OUTER_NAMES: [&str; OUTER] = ["ln_alpha", "ln_nu", "kappa"];

/// Search box of the outer unknowns: alpha 0.5 to 300 1/s, nu 0.5 to 40000 1/s^2, kappa 0.01 to
/// 0.995. It contains the rows of the paper's Table 1 and every motor of `docs/validation.md`; a flux that settles
/// within 3 ms cannot be told from an instant one at any usual reporting rate.
#[must_use]
pub fn outer_bounds() -> Bounds {
    Bounds {
        lower: DVector::from_vec(vec![0.5_f64.ln(), 0.5_f64.ln(), 0.01]),
        upper: DVector::from_vec(vec![300.0_f64.ln(), 40_000.0_f64.ln(), 0.995]),
    }
}

/// The joint problem of some events.
pub struct JointProblem<'a> {
    events: &'a [PreparedEvent],
    /// Of each event, what does not depend on the motor.
    columns: Vec<EventColumns<'a>>,
    options: ProblemOptions,
    cancel: &'a (dyn Fn() -> bool + Sync),
    simulations: AtomicU64,
    sensitivity_simulations: AtomicU64,
}

impl std::fmt::Debug for JointProblem<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("JointProblem")
            .field("events", &self.events.len())
            .field("options", &self.options)
            .finish_non_exhaustive()
    }
}

/// A point of the joint problem with its linear coefficients and everything derived from them.
#[derive(Clone, Debug)]
pub struct JointPoint {
    /// Half the weighted sum of squares, priors and random effects included.
    pub objective: f64,
    /// Linear coefficients at their constrained optimum.
    pub linear: [f64; LINEAR],
    /// Which linear coefficients lie on a bound.
    pub linear_at_bound: [bool; LINEAR],
    /// Directions in which the linear coefficients may still move, one per column.
    pub linear_free: DMatrix<f64>,
    /// Gauss-Newton matrix of outer and linear unknowns together.
    pub information: DMatrix<f64>,
    /// Gradient with respect to the outer unknowns.
    pub gradient: DVector<f64>,
}

impl<'a> JointProblem<'a> {
    /// A problem over `events`; `cancel` makes every evaluation fail once it returns true. Sums once what
    /// does not depend on the motor: make a problem once and evaluate it often.
    #[must_use]
    pub fn new(
        events: &'a [PreparedEvent],
        options: ProblemOptions,
        cancel: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        let columns = events.iter().map(EventColumns::new).collect();
        Self {
            events,
            columns,
            options,
            cancel,
            simulations: AtomicU64::new(0),
            sensitivity_simulations: AtomicU64::new(0),
        }
    }

    /// The settings.
    #[must_use]
    pub const fn options(&self) -> &ProblemOptions {
        &self.options
    }

    /// Plain simulations and simulations with sensitivities so far, one event each.
    pub fn simulations(&self) -> (u64, u64) {
        (
            self.simulations.load(Ordering::Relaxed),
            self.sensitivity_simulations.load(Ordering::Relaxed),
        )
    }

    /// Evaluates the problem with exact sensitivities.
    pub fn point(&self, x: &DVector<f64>) -> Option<JointPoint> {
        self.solve(&self.sensitivity_sums(x)?)
            .filter(|p| p.objective.is_finite())
    }

    /// The same with given linear coefficients instead of the best ones; and the gradient with
    /// respect to them.
    pub(super) fn point_at(
        &self,
        x: &DVector<f64>,
        linear: [f64; LINEAR],
    ) -> Option<(JointPoint, DVector<f64>)> {
        let sums = self.sensitivity_sums(x)?;
        let (h, g) = self.linear_system(&total(&sums));
        let gradient = h * LinearVector::from(linear) + g;
        let point = self.point_with(&sums, (&h, &g), linear);
        let gradient = DVector::from_column_slice(gradient.as_slice());
        point.objective.is_finite().then_some((point, gradient))
    }

    /// The problem at outer unknowns `x` and linear coefficients that need not be optimal: value,
    /// gradient and Gauss-Newton matrix with respect to the eight of them, outer ones first.
    pub fn expansion_at(&self, x: &DVector<f64>, linear: &[f64; LINEAR]) -> Option<Expansion> {
        let (point, inner) = self.point_at(x, *linear)?;
        let mut gradient = DVector::zeros(OUTER + LINEAR);
        gradient.rows_mut(0, OUTER).copy_from(&point.gradient);
        gradient.rows_mut(OUTER, LINEAR).copy_from(&inner);
        Some(Expansion {
            value: point.objective,
            gradient,
            curvature: point.information,
        })
    }

    /// The best linear coefficients at outer unknowns `x`: one plain simulation per event.
    pub(super) fn linear(&self, x: &DVector<f64>) -> Option<[f64; LINEAR]> {
        let sum = self.plain_sum(x)?;
        let (h, g) = self.linear_system(&sum);
        self.linear_optimum(&h, &g)
    }

    /// The objective with given linear coefficients.
    pub(super) fn value_at(&self, x: &DVector<f64>, linear: [f64; LINEAR]) -> Option<f64> {
        let sum = self.plain_sum(x)?;
        let (h, g) = self.linear_system(&sum);
        let value = self.objective(&sum, &h, &g, &linear);
        value.is_finite().then_some(value)
    }

    /// The Gram matrix of each event with sensitivities, random effects removed.
    fn sensitivity_sums(&self, x: &DVector<f64>) -> Option<Vec<Marginal>> {
        self.sensitivity_sums_of(std::slice::from_ref(x), Effort::Exact)
            .pop()
            .flatten()
    }

    /// The same for several points, simulated side by side; none has bits that depend on the others.
    fn sensitivity_sums_of(
        &self,
        points: &[DVector<f64>],
        effort: Effort,
    ) -> Vec<Option<Vec<Marginal>>> {
        let motors: Vec<_> = points.iter().map(sensitive_coordinates).collect();
        let of_event = |event: &EventColumns<'_>, series: &mut [f64], motor: &Motor| {
            event.sensitivity_gram(series, reactive_at_rest(motor))
        };
        self.sensitivity_simulations
            .fetch_add((points.len() * self.events.len()) as u64, Ordering::Relaxed);
        self.marginals(&motors, OUTER, &of_event, &|motors, event, kept| {
            simulate_batch_with_slopes(motors, &event.input, effort, kept)
        })
    }

    /// The objective, given the sum of the Gram matrices.
    fn value_of(&self, sum: &Gram) -> Option<f64> {
        let (h, g) = self.linear_system(sum);
        let beta = self.linear_optimum(&h, &g)?;
        let value = self.objective(sum, &h, &g, &beta);
        value.is_finite().then_some(value)
    }

    /// The Gram matrices of all events without sensitivities, random effects removed.
    fn plain_sum(&self, x: &DVector<f64>) -> Option<Gram> {
        self.plain_sums(std::slice::from_ref(x), Effort::Exact)
            .pop()
            .flatten()
    }

    /// As [`plain_sum`](Self::plain_sum) for several points, bit by bit: simulated side by side, each
    /// summed by itself.
    fn plain_sums(&self, points: &[DVector<f64>], effort: Effort) -> Vec<Option<Gram>> {
        let motors: Vec<_> = points.iter().map(motor_coordinates).collect();
        let of_event =
            |event: &EventColumns<'_>, series: &mut [f64], motor: &MotorCoordinates<f64>| {
                event.plain_gram(series, reactive_at_rest(motor))
            };
        self.simulations
            .fetch_add((points.len() * self.events.len()) as u64, Ordering::Relaxed);
        let marginals = self.marginals(&motors, 0, &of_event, &|motors, event, kept| {
            simulate_batch(motors, &event.input, effort, kept)
        });
        (marginals.iter().map(|events| Some(total(events.as_ref()?)))).collect()
    }

    /// Of each motor, every event's Gram matrix without its random effects; none where an event has no
    /// steady state. Events are simulated in parallel.
    fn marginals<A: LaneScalar + Sync>(
        &self,
        motors: &[MotorCoordinates<A>],
        derivatives: usize,
        gram: &GramOf<'_, A>,
        simulate: &Simulate<'_, A>,
    ) -> Vec<Option<Vec<Marginal>>> {
        let of_events: Vec<Vec<Option<Marginal>>> = (self.events.par_iter())
            .zip(&self.columns)
            .map(|(event, columns)| {
                if (self.cancel)() {
                    return motors.iter().map(|_| None).collect();
                }
                let length = columns.series_length();
                let mut kept = KeptSeries::new(motors.len(), derivatives, length);
                let verdicts = simulate(motors, columns, &mut kept);
                (motors.iter().zip(verdicts).zip(kept.of_motors()))
                    .map(|((motor, verdict), series)| {
                        verdict.ok()?;
                        Some(self.marginal(event, &gram(columns, series, motor)))
                    })
                    .collect()
            })
            .collect();
        let mut of_motors: Vec<Option<Vec<Marginal>>> =
            motors.iter().map(|_| Some(Vec::new())).collect();
        for of_event in of_events {
            for (all, more) in of_motors.iter_mut().zip(of_event) {
                *all = all.take().zip(more).map(|(mut all, more)| {
                    all.push(more);
                    all
                });
            }
        }
        of_motors
    }

    /// Removes the random effects: `G_aa - G_af (I + G_ff)^-1 G_fa`, with the random columns scaled
    /// by their standard deviations.
    fn marginal(&self, event: &PreparedEvent, gram: &Gram) -> Marginal {
        let mut deviation = [0.0; RANDOM];
        deviation[..LINEAR].copy_from_slice(&self.options.composition_spread);
        deviation[LINEAR..].fill(event.operating_point_deviation);
        let index = |f: usize| OUTER + f;
        let mut inner = SMatrix::<f64, RANDOM, RANDOM>::identity();
        let mut cross = SMatrix::<f64, RANDOM, COLUMNS>::zeros();
        for i in 0..RANDOM {
            for j in 0..RANDOM {
                inner[(i, j)] += deviation[i] * gram[(index(i), index(j))] * deviation[j];
            }
            for c in 0..COLUMNS {
                cross[(i, c)] = deviation[i] * gram[(index(i), c)];
            }
        }
        // Identity plus a Gram matrix is positive definite.
        match inner.cholesky() {
            Some(factor) => {
                let effects = factor.solve(&cross);
                Marginal {
                    gram: gram - cross.transpose() * effects,
                    share_deviation: std::array::from_fn(|c| deviation[0] * effects[(0, c)]),
                }
            }
            None => Marginal {
                gram: Gram::repeat(f64::NAN),
                share_deviation: [f64::NAN; COLUMNS],
            },
        }
    }

    fn values_to(&self, points: &[DVector<f64>], effort: Effort) -> Vec<Option<f64>> {
        let mut values = Vec::with_capacity(points.len());
        for some in points.chunks(POINTS_AT_ONCE) {
            let sums = self.plain_sums(some, effort).into_iter();
            values.extend(sums.map(|sum| self.value_of(&sum?)));
        }
        values
    }

    fn points_to(&self, points: &[DVector<f64>], effort: Effort) -> Vec<Option<JointPoint>> {
        let mut found = Vec::with_capacity(points.len());
        for some in points.chunks(EXPANSIONS_AT_ONCE) {
            let sums = self.sensitivity_sums_of(some, effort).into_iter();
            found.extend(sums.map(|sums| self.solve(&sums?).filter(|p| p.objective.is_finite())));
        }
        found
    }

    fn expansions_to(&self, points: &[DVector<f64>], effort: Effort) -> Vec<Option<Expansion>> {
        let points = self.points_to(points, effort).into_iter();
        points.map(|point| Some(point?.expansion())).collect()
    }

    fn solve(&self, sums: &[Marginal]) -> Option<JointPoint> {
        let (h, g) = self.linear_system(&total(sums));
        let beta = self.linear_optimum(&h, &g)?;
        Some(self.point_with(sums, (&h, &g), beta))
    }

    fn point_with(
        &self,
        sums: &[Marginal],
        (h, g): (&LinearMatrix, &LinearVector),
        beta: [f64; LINEAR],
    ) -> JointPoint {
        let sum = &total(sums);
        let share = beta[0];
        let size = OUTER + LINEAR;
        let scale = |i: usize| if i < OUTER { share } else { 1.0 };
        let mut information =
            DMatrix::from_fn(size, size, |i, j| scale(i) * sum[(i, j)] * scale(j));
        let (weights, _) = self.prior();
        for (i, w) in weights.iter().enumerate() {
            information[(OUTER + i, OUTER + i)] += w;
        }
        // Each event with the share it has most probably: the random columns move with the outer
        // unknowns too.
        let gradient = DVector::from_fn(OUTER, |i, _| {
            let of_event = |event: &Marginal| {
                let slope = residual(&beta, |c| event.gram[(i, c)]);
                -(share + residual(&beta, |c| event.share_deviation[c])) * slope
            };
            sums.iter().map(of_event).sum::<f64>()
        });
        let at_bound = std::array::from_fn(|i| {
            let (mut low, high) = (self.options.linear_lower[i], self.options.linear_upper[i]);
            if i == 0 && self.options.static_shares.is_some() {
                low = low.max(PAPER_MOTOR_SHARE_MIN);
            }
            let close = 1e-9 * (high - low);
            beta[i] - low <= close || high - beta[i] <= close
        });
        JointPoint {
            objective: self.objective(sum, h, g, &beta),
            linear: beta,
            linear_at_bound: at_bound,
            linear_free: null_space(&self.active_rows(&beta, at_bound)),
            information,
            gradient,
        }
    }

    /// The events.
    pub(super) const fn events(&self) -> &'a [PreparedEvent] {
        self.events
    }
}

/// An event's Gram matrix without its random effects.
struct Marginal {
    gram: Gram,
    /// The event's most probable deviation from the shared motor share, as a linear form of the
    /// columns: applied to the residual.
    share_deviation: [f64; COLUMNS],
}

fn total(sums: &[Marginal]) -> Gram {
    sums.iter()
        .fold(Gram::zeros(), |sum, event| sum + event.gram)
}

/// A linear form of the columns, applied to `measured - linear model`.
fn residual(beta: &[f64; LINEAR], form: impl Fn(usize) -> f64) -> f64 {
    let explained: f64 = (0..LINEAR).map(|j| form(OUTER + j) * beta[j]).sum();
    form(Y) - explained
}

impl JointPoint {
    /// Value, gradient and curvature of the outer unknowns.
    fn expansion(&self) -> Expansion {
        Expansion {
            value: self.objective,
            curvature: self.reduced_curvature(),
            gradient: self.gradient.clone(),
        }
    }

    /// Curvature of the outer unknowns once the free linear coefficients follow: Schur complement.
    #[must_use]
    pub fn reduced_curvature(&self) -> DMatrix<f64> {
        let outer = self.information.view((0, 0), (OUTER, OUTER)).into_owned();
        if self.linear_free.ncols() == 0 {
            return outer;
        }
        let free = &self.linear_free;
        let linear = self.information.view((OUTER, OUTER), (LINEAR, LINEAR));
        let inner = free.transpose() * linear * free;
        let cross = free.transpose() * self.information.view((OUTER, 0), (LINEAR, OUTER));
        match inner.cholesky() {
            Some(factor) => &outer - cross.transpose() * factor.solve(&cross),
            None => outer,
        }
    }
}

impl Objective for JointProblem<'_> {
    fn dimension(&self) -> usize {
        OUTER
    }

    fn value(&self, x: &DVector<f64>) -> Option<f64> {
        self.value_of(&self.plain_sum(x)?)
    }

    /// As [`value`](Self::value), bit by bit, whatever the other points: the motors are simulated side by
    /// side and everything after that is done for each point by itself.
    fn values(&self, points: &[DVector<f64>]) -> Vec<Option<f64>> {
        self.values_to(points, Effort::Exact)
    }

    fn expansion(&self, x: &DVector<f64>) -> Option<Expansion> {
        self.expansions(std::slice::from_ref(x)).pop().flatten()
    }

    fn expansions(&self, points: &[DVector<f64>]) -> Vec<Option<Expansion>> {
        self.expansions_to(points, Effort::Exact)
    }
}

/// How the series of a motor become an event's Gram matrix.
type GramOf<'s, A> =
    dyn Fn(&EventColumns<'_>, &mut [f64], &MotorCoordinates<A>) -> Gram + Sync + 's;

/// How the motors of some points are simulated on an event.
type Simulate<'s, A> = dyn Fn(&[MotorCoordinates<A>], &EventColumns<'_>, &mut KeptSeries) -> Vec<Result<(), Infeasible>>
    + Sync
    + 's;

type Motor = MotorCoordinates<OuterSensitivities>;

fn sensitive_coordinates(x: &DVector<f64>) -> Motor {
    MotorCoordinates {
        alpha_per_s: OuterSensitivities::variable(x[0], 0).exp(),
        nu_per_s2: OuterSensitivities::variable(x[1], 1).exp(),
        kappa: OuterSensitivities::variable(x[2], 2),
    }
}

/// The motor of a point of the search.
#[must_use]
pub fn motor_coordinates(x: &DVector<f64>) -> MotorCoordinates<f64> {
    MotorCoordinates {
        alpha_per_s: x[0].exp(),
        nu_per_s2: x[1].exp(),
        kappa: x[2],
    }
}

/// Reactive power at rest on the motor's own power, without the part in 1/x: `G (1 - a0)`.
pub(super) fn reactive_at_rest<S: Scalar>(motor: &MotorCoordinates<S>) -> S {
    let root = (S::constant(1.0) - motor.kappa * motor.kappa).sqrt();
    (S::constant(1.0) - root) / motor.kappa
}

#[cfg(test)]
mod tests;
