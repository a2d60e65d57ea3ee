//! The joint problem with one quantity held: sequential quadratic programming.
//!
//! Unknowns: three outer and five linear coordinates and the reactance on the motor's own base, all
//! in their boxes. Each step minimises the Gauss-Newton model of the objective under the linearised
//! condition (and the limits of the static shares where the problem has them), damped until the merit
//! `F + mu |q - c|` falls (Nocedal and Wright, Numerical Optimization, 2006, chapter 18).

use nalgebra::{DMatrix, DVector};

use super::{Scale, target::Target};
use crate::{
    identification::{
        joint_problem::{JointProblem, LINEAR, OUTER, outer_bounds},
        precision::SIZE,
    },
    load_model::LoadBase,
    numerics::{
        Bounds, Expansion,
        quadratic_program::{Constraint, LinearConstraints, QuadraticProgram},
    },
};

/// Steps at most; a neighbour's point is a good start, three to six are usual.
const STEPS_MAX: usize = 25;
/// A point is found when the model promises less than this of the objective, in units of a rise of
/// one.
const PROMISE: f64 = 1e-4;
/// ... and the condition is met to this share of the standard error.
const CONDITION: f64 = 1e-4;
/// Objective for moving the reactance through its whole range in one step: the data say nothing, and
/// the program needs a definite matrix.
const REACTANCE_WEIGHT: f64 = 1e-3;

/// A point on the profile.
#[derive(Clone, Debug)]
pub(super) struct Found {
    /// Coordinates and reactance.
    pub(super) at: DVector<f64>,
    /// Value of the quantity.
    pub(super) value: f64,
    /// Objective.
    pub(super) objective: f64,
}

/// The problem with a condition on one quantity.
pub(super) struct Constrained<'a> {
    problem: &'a JointProblem<'a>,
    target: &'a Target,
    base: LoadBase,
    scale: &'a Scale,
    bounds: Bounds,
}

impl<'a> Constrained<'a> {
    pub(super) fn new(
        problem: &'a JointProblem<'a>,
        target: &'a Target,
        base: LoadBase,
        scale: &'a Scale,
        reactance: (f64, f64),
    ) -> Self {
        let outer = outer_bounds();
        let options = problem.options();
        // Where the quantity does not depend on the reactance, it stays where it is.
        let open = target.in_valley();
        let range = |fixed: f64, end: f64| if open { end } else { fixed };
        let middle = 0.5 * (reactance.0 + reactance.1);
        let joined = |outer: &DVector<f64>, linear: &[f64; LINEAR], last: f64| {
            let all = outer.iter().chain(linear).copied().chain([last]);
            DVector::from_iterator(SIZE + 1, all)
        };
        let bounds = Bounds {
            lower: joined(
                &outer.lower,
                &options.linear_lower,
                range(middle, reactance.0),
            ),
            upper: joined(
                &outer.upper,
                &options.linear_upper,
                range(middle, reactance.1),
            ),
        };
        Self {
            problem,
            target,
            base,
            scale,
            bounds,
        }
    }

    /// The least objective with the quantity at `wanted`, from a point nearby. Where no step leads
    /// there the nearest point reached is returned; none when the problem cannot be evaluated.
    pub(super) fn solve(&self, from: &Found, wanted: f64) -> Option<Found> {
        let mut at = self.bounds.clamped(&from.at);
        let mut expansion = self.expansion(&at)?;
        let mut damping = 0.0;
        for _ in 0..STEPS_MAX {
            let Some((step, multiplier)) = self.step(&at, &expansion, wanted, damping) else {
                break;
            };
            let trial = &at + &step;
            let next = self.expansion(&trial)?;
            let weight = 2.0 * multiplier.abs();
            let missed = |x: &DVector<f64>| (self.value(x) - wanted).abs();
            let before = expansion.value + weight * missed(&at);
            let after = next.value + weight * missed(&trial);
            let small = self.scale.variance_factor * PROMISE;
            if after > before + small && damping < 1e6 {
                damping = (10.0 * damping).max(1e-2);
                continue;
            }
            damping *= 0.1;
            let settled =
                before - after < small && missed(&trial) < CONDITION * self.scale.standard_error;
            at = trial;
            expansion = next;
            if settled {
                break;
            }
        }
        Some(Found {
            value: self.value(&at),
            objective: expansion.value,
            at,
        })
    }

    fn value(&self, at: &DVector<f64>) -> f64 {
        self.target.value(at, &self.base)
    }

    fn expansion(&self, at: &DVector<f64>) -> Option<Expansion> {
        let mut linear = [0.0; LINEAR];
        linear.copy_from_slice(&at.as_slice()[OUTER..SIZE]);
        self.problem
            .expansion_at(&at.rows(0, OUTER).into_owned(), &linear)
    }

    /// The step and the multiplier of the condition.
    fn step(
        &self,
        at: &DVector<f64>,
        expansion: &Expansion,
        wanted: f64,
        damping: f64,
    ) -> Option<(DVector<f64>, f64)> {
        let mut hessian = DMatrix::zeros(SIZE + 1, SIZE + 1);
        hessian
            .view_mut((0, 0), (SIZE, SIZE))
            .copy_from(&expansion.curvature);
        for i in 0..SIZE {
            hessian[(i, i)] *= 1.0 + damping;
        }
        let range = (self.bounds.upper[SIZE] - self.bounds.lower[SIZE]).max(1e-6);
        hessian[(SIZE, SIZE)] = 2.0 * REACTANCE_WEIGHT * (1.0 + damping) / (range * range);
        let slope = self.target.gradient(at, &self.base);
        let program = QuadraticProgram {
            hessian,
            gradient: expansion.gradient.clone().push(0.0),
            bounds: Bounds {
                lower: &self.bounds.lower - at,
                upper: &self.bounds.upper - at,
            },
            equalities: LinearConstraints {
                matrix: DMatrix::from_row_slice(1, SIZE + 1, slope.as_slice()),
                right: DVector::from_element(1, wanted - self.value(at)),
            },
            inequalities: self.share_limits(at),
        };
        let solution = program.minimise().ok()?;
        let multiplier = solution
            .active
            .iter()
            .find(|a| matches!(a.constraint, Constraint::Equality(_)))
            .map_or(0.0, |a| a.multiplier);
        Some((solution.x, multiplier))
    }

    /// The limits of the static shares for a step from `at`.
    fn share_limits(&self, at: &DVector<f64>) -> LinearConstraints {
        let limits = self.problem.share_limits();
        let linear = at.rows(OUTER, LINEAR).into_owned();
        let room = &limits.right - &limits.matrix * linear;
        let mut matrix = DMatrix::zeros(limits.matrix.nrows(), SIZE + 1);
        matrix
            .view_mut((0, OUTER), (limits.matrix.nrows(), LINEAR))
            .copy_from(&limits.matrix);
        LinearConstraints {
            matrix,
            right: room,
        }
    }
}
