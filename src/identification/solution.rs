//! What a global search leaves behind: every solution, every direction, and what it cost.

pub use crate::numerics::trust_tech::{DirectionOutcome, DirectionRecord, Ended};

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
