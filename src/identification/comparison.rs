//! Model against measurement, sample by sample: what plots and reports are made of.

use super::EventErrors;

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
