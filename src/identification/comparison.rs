//! Model against measurement, sample by sample: what plots and reports are made of.

use super::{EventErrors, evaluate::Curves, intake::PreparedEvent};
use crate::{disturbance::Window, measurement::Sample};

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

/// Puts a simulated event beside its measurement, in per unit of the load base.
pub(super) fn compare_event(
    window: &Window,
    event: &PreparedEvent,
    curves: &Curves,
    errors: EventErrors,
) -> Comparison {
    let samples = &window.record.samples;
    let onset = event.event_start.min(event.len().saturating_sub(1));
    let scaled = |x: &[f64]| x.iter().map(|y| y * event.p0_pu).collect::<Vec<_>>();
    let measured = |value: fn(&Sample) -> f64| {
        samples
            .iter()
            .map(|s| if s.usable() { value(s) } else { f64::NAN })
            .collect::<Vec<_>>()
    };
    let noise = |relative: f64| vec![relative * event.p0_pu; event.len()];
    Comparison {
        event: event.id.clone(),
        onset_ns: window.record.time_ns(onset),
        time_s: (0..event.len())
            .map(|k| (k as f64 - onset as f64) / event.rate_fps)
            .collect(),
        voltage_pu: measured(|s| s.voltage_pu),
        frequency_hz: measured(|s| s.frequency_hz),
        active_measured_pu: measured(|s| s.active_pu),
        active_model_pu: scaled(&curves.active),
        reactive_measured_pu: measured(|s| s.reactive_pu),
        reactive_model_pu: scaled(&curves.reactive),
        active_noise_pu: noise(event.active_noise),
        reactive_noise_pu: noise(event.reactive_noise),
        used: event.used.clone(),
        near_edge: event.near_edge.clone(),
        errors,
    }
}
