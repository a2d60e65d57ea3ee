//! Trust-Tech: every local minimum, tier by tier, without chance.
//!
//! The method of "Trust-Tech based Parameter Estimation and its Application to Power System Load
//! Modeling", section 3.2 and the seven steps of section 5. From a known minimum a path is followed
//! along a search direction until the objective, having risen, falls again: the exit point. A
//! little beyond it the projected gradient system (8) is integrated into the neighbouring stability
//! region, and a local solver finishes. Every direction and its outcome is kept.
//!
//! All distances are in scaled coordinates: the width of the box is 1 along every coordinate.
//! Where the paper leaves freedom, [`Options`] names it; [`Options::paper`] is the plain form.

mod box_form;
mod constrained_form;
mod constrained_gradient;
mod constraints;
mod directions;
mod exit_point;
mod feasible_sqp;
mod known;
mod projected_gradient;
mod quotient_gradient;
mod record;
mod scaled;
mod slack_form;
mod tangent;
mod tiers;

use nalgebra::DVector;

use super::{Bounds, LocalSolution, Objective, local_solver, objective::OutOfRange};
use box_form::BoxForm;
use constrained_form::ConstrainedForm;
use scaled::Scaled;

pub use constraints::{Constraints, Unconstrained};
pub use directions::{UserDirection, UserDirectionKind};
pub use record::{DirectionOutcome, DirectionRecord, Ended, FoundSolution, Search};

/// How the bounds of the box are treated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Formulation {
    /// As bounds: paths slide along them, and the local solver knows them. Fast.
    #[default]
    Box,
    /// As inequalities with slack variables, the paper's (4)-(5).
    Slack,
}

/// Settings of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// How the bounds are treated. Default as a box; constraints beyond it ask for slacks.
    pub formulation: Formulation,
    /// First step of the exit-point search, as a fraction of the box. Default 0.02; within
    /// (0, 0.5].
    pub step: f64,
    /// Factor by which the step grows, once per step. Default 1.25; within [1, 10]. With 1 (the paper's
    /// form) no narrow valley is stepped over far from the minimum, at several times the cost.
    pub step_growth: f64,
    /// Largest number of steps along one direction. Default 200.
    pub steps_max: usize,
    /// How far beyond the exit point the local search starts, as a fraction of the way there: the
    /// 0.1 of the paper's step 5. Default 0.1; within [0, 1].
    pub overshoot: f64,
    /// Whether an exit counts only after the objective has risen along the direction, or has
    /// fallen by a thousandth. Default yes; without it, a minimum at the end of a flat valley
    /// "exits" with the first step.
    pub rise_required: bool,
    /// Steps of the projected gradient system between the exit point and the local solver.
    /// Default 4.
    pub gradient_steps: usize,
    /// Whether eigenvectors and user directions are followed both ways. Default yes.
    pub both_signs: bool,
    /// Whether every single coordinate and the way to the centre of the box are directions too.
    /// Default yes.
    pub box_directions: bool,
    /// Largest number of tiers. Default 4. Tier 0 are the starts' own minima.
    pub tiers_max: usize,
    /// Solutions whose objective exceeds this multiple of the best one's are kept but not explored
    /// further. Default infinite: every solution is explored; at least 1. Meant for objectives
    /// that are not negative.
    pub explore_within: f64,
    /// While the best objective is above this, nothing but the best solution is explored. Default infinite.
    pub describes_below: f64,
    /// Calls of the objective after which no further directions are begun; they are begun 16 at a
    /// time. Default 100 000.
    pub evaluations_max: u64,
    /// Decrease, relative to the objective, at which the local solver leaves a solution that is not
    /// worth exploring. Default 0: all solutions are as exact as `local` asks.
    pub coarse_decrease_relative: f64,
    /// Settings of the local solver.
    pub local: local_solver::Options,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            formulation: Formulation::Box,
            step: 0.02,
            step_growth: 1.25,
            steps_max: 200,
            overshoot: 0.1,
            rise_required: true,
            gradient_steps: 4,
            both_signs: true,
            box_directions: true,
            tiers_max: 4,
            explore_within: f64::INFINITY,
            describes_below: f64::INFINITY,
            evaluations_max: 100_000,
            coarse_decrease_relative: 0.0,
            local: local_solver::Options::default(),
        }
    }
}

impl Options {
    /// The settings themselves, when every one is within its range.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] names the first that is not.
    pub fn checked(self) -> Result<Self, OutOfRange> {
        OutOfRange::check(
            "step",
            self.step,
            0.0 < self.step && self.step <= 0.5,
            "(0, 0.5]",
        )?;
        let growth = self.step_growth;
        OutOfRange::check(
            "step_growth",
            growth,
            (1.0..=10.0).contains(&growth),
            "[1, 10]",
        )?;
        let overshoot = self.overshoot;
        OutOfRange::check(
            "overshoot",
            overshoot,
            (0.0..=1.0).contains(&overshoot),
            "[0, 1]",
        )?;
        self.local.checked()?;
        Ok(self)
    }

    /// Objective up to which a solution is explored when the best one's is `best`.
    #[must_use]
    pub fn worth_exploring_below(&self, best: f64) -> f64 {
        if best > self.describes_below {
            best
        } else if self.explore_within.is_finite() {
            best + (self.explore_within - 1.0) * best.abs()
        } else {
            f64::INFINITY
        }
    }

    /// The plain form of the paper: slack variables, a constant step, one sign of each eigenvector, no directions
    /// but eigenvectors and the user's.
    pub fn paper() -> Self {
        Self {
            formulation: Formulation::Slack,
            step_growth: 1.0,
            rise_required: false,
            gradient_steps: 20,
            both_signs: false,
            box_directions: false,
            ..Self::default()
        }
    }
}

/// Gives more starts for what was found.
pub type MoreStarts<'a> = &'a (dyn Fn(&[FoundSolution]) -> Vec<DVector<f64>> + Sync);

/// Where a search begins.
#[derive(Clone, Copy)]
pub struct Starts<'a> {
    /// What tier 0 begins with.
    pub first: &'a [DVector<f64>],
    /// More starts, asked for once, with what was found until then: after the tiers have ended, or amid them when
    /// half of the calls of the problem are used up that the options allow. From the new solutions they lead to,
    /// if any, the tiers go on.
    pub second: Option<MoreStarts<'a>>,
}

impl<'a> Starts<'a> {
    /// These starts and no others.
    pub fn only(first: &'a [DVector<f64>]) -> Self {
        Self {
            first,
            second: None,
        }
    }
}

impl std::fmt::Debug for Starts<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Starts")
            .field("first", &self.first)
            .finish_non_exhaustive()
    }
}

/// Searches the box `bounds` for every local minimum of `problem`.
///
/// The local solver is applied to every start (tier 0), then every direction of every solution of
/// a tier is explored, until a tier brings nothing new or a limit is reached. `same` says whether
/// two solutions are one; of two that are, the lower is kept under the first one's number.
/// Directions are explored in parallel on the current rayon pool. Deterministic: the same input
/// gives the same bits on any number of threads.
///
/// `cancel` is asked between calls of `problem`; what was found until then is returned.
pub fn search(
    problem: &dyn Objective,
    bounds: &Bounds,
    starts: &Starts<'_>,
    user_directions: &[UserDirection],
    same: &(dyn Fn(&LocalSolution, &LocalSolution) -> bool + Sync),
    options: &Options,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Search {
    match options.formulation {
        Formulation::Box => {
            let form = BoxForm::new(problem, bounds, user_directions, options, cancel);
            tiers::explore(&form, starts, same, options, cancel)
        }
        Formulation::Slack => {
            let problem = ConstrainedProblem {
                objective: problem,
                constraints: &Unconstrained,
                bounds,
            };
            search_constrained(&problem, starts, user_directions, same, options, cancel)
        }
    }
}

/// A problem with constraints beyond its box.
#[derive(Clone, Copy)]
pub struct ConstrainedProblem<'a> {
    /// The objective.
    pub objective: &'a dyn Objective,
    /// The constraints.
    pub constraints: &'a dyn Constraints,
    /// The box. It should be finite: it says what a long way is.
    pub bounds: &'a Bounds,
}

impl std::fmt::Debug for ConstrainedProblem<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("ConstrainedProblem")
            .field("bounds", &self.bounds)
            .finish_non_exhaustive()
    }
}

/// Searches for every local minimum of a constrained problem, in every feasible component.
///
/// As [`search`], with the slack-variable form whatever the options say: starts are first brought
/// to a feasible component by the quotient gradient system, paths and local solver stay on the
/// constraint surface, and from every solution directions are followed across infeasible ground to
/// other components too (phase I; their labels begin with `component`, their profiles show the
/// energy (7) instead of the objective). Distances include the slacks.
pub fn search_constrained(
    problem: &ConstrainedProblem<'_>,
    starts: &Starts<'_>,
    user_directions: &[UserDirection],
    same: &(dyn Fn(&LocalSolution, &LocalSolution) -> bool + Sync),
    options: &Options,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Search {
    let scaled = Scaled::new(problem.objective, problem.bounds);
    let unit_bounds = scaled.unit_bounds(problem.bounds);
    let form = ConstrainedForm::new(
        problem,
        &scaled,
        &unit_bounds,
        user_directions,
        options,
        cancel,
    );
    tiers::explore(&form, starts, same, options, cancel)
}

#[cfg(test)]
mod tests;
