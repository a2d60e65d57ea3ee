//! What a search leaves behind.

use nalgebra::DVector;

use crate::numerics::{Cost, LocalSolution};

/// One local solution and how it was found.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundSolution {
    /// Number within the search, 1 = found first.
    pub id: usize,
    /// Tier in which it was found; 0 from a start.
    pub tier: usize,
    /// Solution whose direction led here; none from a start.
    pub found_from: Option<usize>,
    /// Number of that direction at that solution.
    pub direction: Option<usize>,
    /// The solution.
    pub local: LocalSolution,
}

/// How a search direction ended (Table 2 of the reference paper as a type).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DirectionOutcome {
    /// The local solver reached a minimum not seen before: this one.
    NewSolution(usize),
    /// It reached a minimum already in the set: this one.
    KnownSolution(usize),
    /// The objective never fell again on the way.
    NoExitPoint {
        /// Distance from the solution at which the search ended.
        at_distance: f64,
        /// Whether it ended because the objective ceased to exist (the paper's `inf`); otherwise it
        /// reached the bounds or the largest number of steps.
        diverged: bool,
    },
    /// The local solver met the edge of the objective's domain and found no way on (the paper's
    /// `*`).
    LocalSolverInfeasible,
}

/// One search direction.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionRecord {
    /// Solution it started from.
    pub from: usize,
    /// Number of the direction at that solution, from 1.
    pub direction: usize,
    /// Where the direction came from: `eigenvector 1 +`, `coordinate 2 -`, a user's label.
    pub label: String,
    /// Distance from the solution to the exit point; none without one.
    pub exit_distance: Option<f64>,
    /// The exit point, in the caller's coordinates; none without one.
    pub exit_point: Option<DVector<f64>>,
    /// How it ended.
    pub outcome: DirectionOutcome,
    /// Distance from the solution and objective, at every point of the exit-point search; begins
    /// with the solution itself. The last point is the exit point, if there is one.
    pub profile: Vec<(f64, f64)>,
}

/// Why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// This tier brought nothing new: every direction of every solution has been explored.
    NothingNew {
        /// The tier.
        tier: usize,
    },
    /// The last allowed tier still brought something new.
    TiersExhausted {
        /// Tiers allowed.
        limit: usize,
    },
    /// The calls of the objective reached their limit; directions were left unexplored.
    EvaluationsExhausted {
        /// Calls made.
        evaluations: u64,
        /// Calls allowed.
        limit: u64,
    },
    /// From no start did the local solver reach a solution.
    NoSolution,
    /// The caller asked to stop.
    Cancelled,
}

/// Everything a search found, in a fixed order.
#[derive(Clone, Debug, PartialEq)]
pub struct Search {
    /// Every distinct solution, in order of discovery.
    pub solutions: Vec<FoundSolution>,
    /// Every direction, in the order in which it was explored.
    pub directions: Vec<DirectionRecord>,
    /// What all of it cost.
    pub cost: Cost,
    /// Why it ended.
    pub ended: Ended,
}

impl Search {
    /// The solution of lowest objective; the one found first among equals.
    pub fn best(&self) -> Option<&FoundSolution> {
        self.solutions.iter().reduce(|best, next| {
            if next.local.value < best.local.value {
                next
            } else {
                best
            }
        })
    }
}
