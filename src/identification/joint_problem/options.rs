//! Settings of the joint problem.

use super::LINEAR;

/// Settings of the joint problem.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProblemOptions {
    /// Bounds of the linear coefficients relative to P0, in the order of [`LinearCoefficients`](crate::load_model::LinearCoefficients).
    /// Default: wide (`effects.md`: measured appliances go far outside the paper's box).
    pub linear_lower: [f64; LINEAR],
    /// Upper bounds.
    pub linear_upper: [f64; LINEAR],
    /// Bounds of the shares `P_Z` and `P_P` of the static active power, as in the paper's box (14),
    /// which also raises the least motor share to 0.1. Default none. The shares of the static
    /// reactive power have no such box here: they depend on the reactance that the data leave open.
    pub static_shares: Option<(f64, f64)>,
    /// Standard deviation of the linear coefficients from event to event, relative to P0.
    /// Default 0.025 for the motor share, 0.02 for the others; 0 = the same in every event.
    pub composition_spread: [f64; LINEAR],
    /// Standard deviation of a weak prior on the static coefficients around 0.2: it decides only
    /// what the data leave open. Default 1.
    pub static_prior_deviation: f64,
}

impl Default for ProblemOptions {
    fn default() -> Self {
        Self {
            linear_lower: [0.02, -0.4, -0.8, -1.5, -2.0],
            linear_upper: [0.95, 1.2, 1.4, 2.0, 2.5],
            static_shares: None,
            composition_spread: [0.025, 0.02, 0.02, 0.02, 0.02],
            static_prior_deviation: 1.0,
        }
    }
}
