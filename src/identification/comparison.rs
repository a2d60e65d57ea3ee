//! Model against measurement, sample by sample: what plots and reports are made of.

use super::{ErrorSummary, EventErrors};

/// One event, measured and modelled. All vectors have the same length.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Event identifier.
    pub event: String,
    /// Onset of the event, UTC nanoseconds.
    pub onset_ns: i64,
    /// Time relative to the onset, seconds.
    pub time_s: Vec<f64>,
    /// Measured voltage, pu; NaN where missing.
    pub voltage_pu: Vec<f64>,
    /// Measured frequency, Hz; NaN where missing.
    pub frequency_hz: Vec<f64>,
    /// Measured active power, pu; NaN where missing.
    pub active_measured_pu: Vec<f64>,
    /// Modelled active power, pu.
    pub active_model_pu: Vec<f64>,
    /// Measured reactive power, pu; NaN where missing.
    pub reactive_measured_pu: Vec<f64>,
    /// Modelled reactive power, pu.
    pub reactive_model_pu: Vec<f64>,
    /// Standard deviation of the noise of P, pu, sample by sample.
    pub active_noise_pu: Vec<f64>,
    /// Standard deviation of the noise of Q, pu.
    pub reactive_noise_pu: Vec<f64>,
    /// Whether the sample entered the fit.
    pub used: Vec<bool>,
    /// Whether the sample lies within two cycles of a voltage edge.
    pub near_edge: Vec<bool>,
    /// The errors.
    pub errors: EventErrors,
}

/// The errors of several events as one summary: over all used samples, and the ratios to the noise
/// over the event parts.
#[must_use]
pub fn summarise(comparisons: &[Comparison]) -> ErrorSummary {
    let active = |c: &Comparison, k: usize| (c.active_measured_pu[k], c.active_model_pu[k]);
    let reactive = |c: &Comparison, k: usize| (c.reactive_measured_pu[k], c.reactive_model_pu[k]);
    ErrorSummary {
        eps_p_percent: eps_percent(comparisons, active),
        eps_q_percent: eps_percent(comparisons, reactive),
        error_to_noise: error_to_noise(comparisons, |_, _| true),
        error_to_noise_away_from_edges: error_to_noise(comparisons, |c, k| !c.near_edge[k]),
        events: comparisons.iter().map(|c| c.errors.clone()).collect(),
    }
}

/// `100 sqrt(sum (y_m - y)^2 / sum y_m^2)` over the used samples of all events.
fn eps_percent(
    comparisons: &[Comparison],
    values: impl Fn(&Comparison, usize) -> (f64, f64),
) -> f64 {
    let (mut errors, mut squares) = (0.0, 0.0);
    for comparison in comparisons {
        for k in (0..comparison.used.len()).filter(|k| comparison.used[*k]) {
            let (measured, modelled) = values(comparison, k);
            errors += (measured - modelled).powi(2);
            squares += measured.powi(2);
        }
    }
    100.0 * (errors / squares).sqrt()
}

/// Root mean square of residual over noise floor, both channels, from the onsets on.
fn error_to_noise(comparisons: &[Comparison], counts: impl Fn(&Comparison, usize) -> bool) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for c in comparisons {
        let used = |k: &usize| c.used[*k] && c.time_s[*k] >= 0.0 && counts(c, *k);
        for k in (0..c.used.len()).filter(used) {
            let p = (c.active_measured_pu[k] - c.active_model_pu[k]) / c.active_noise_pu[k];
            let q = (c.reactive_measured_pu[k] - c.reactive_model_pu[k]) / c.reactive_noise_pu[k];
            sum += p * p + q * q;
            count += 2.0;
        }
    }
    (sum / count).sqrt()
}
