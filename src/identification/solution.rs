//! What a global search leaves behind: every solution, every direction, and what it cost.

/// One local solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// Number within the fit, 1 = found first.
    pub id: usize,
    /// Tier in which it was found; 0 for the start.
    pub tier: usize,
    /// Solution whose direction led here; none for a start.
    pub found_from: Option<usize>,
    /// Direction number at that solution.
    pub direction: Option<usize>,
    /// Objective: half the weighted sum of squares.
    pub objective: f64,
    /// Name and value of each parameter, in the order of the parameter set.
    pub parameters: Vec<(String, f64)>,
    /// Search coordinates and their values (identifiable coordinates).
    pub coordinates: Vec<(String, f64)>,
    /// Names of the parameters on a bound.
    pub at_bound: Vec<String>,
}

/// Why a search direction ended (Table 2 of the reference paper as a type).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DirectionOutcome {
    /// The local solver reached a minimum not seen before.
    NewSolution(usize),
    /// It reached a minimum already in the set.
    KnownSolution(usize),
    /// No exit point: the objective became non-finite, or kept rising up to the bound.
    NoExitPoint {
        /// Distance from the solution at which the search ended.
        at_distance: f64,
        /// Whether it ended because the objective became non-finite (the paper's `inf`).
        diverged: bool,
    },
    /// The local solver left the feasible set and did not return (the paper's `*`).
    LocalSolverInfeasible,
}

/// One search direction and its outcome.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionRecord {
    /// Solution it started from.
    pub from: usize,
    /// Number of the direction at that solution, from 1.
    pub direction: usize,
    /// Where the direction came from: `eigenvector 1 +`, `user 2`.
    pub label: String,
    /// Distance to the exit point in scaled coordinates; none without one.
    pub exit_distance: Option<f64>,
    /// How it ended.
    pub outcome: DirectionOutcome,
}

/// What a fit cost.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub struct Cost {
    /// Plain simulations of one event.
    pub simulations: u64,
    /// Simulations of one event with sensitivities.
    pub sensitivity_simulations: u64,
    /// Wall-clock seconds, measured by the caller; 0 when nobody measured.
    pub seconds: f64,
}
