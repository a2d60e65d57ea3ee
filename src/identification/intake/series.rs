//! The channels of a window as plain series, gaps bridged for the model's input and remembered.

use crate::{measurement::Record, numerics::statistics};
use std::f64::consts::PI;

/// Channels of one window. Bridged values serve the model's input only; `bad` keeps them out of
/// the fit.
#[derive(Clone, Debug)]
pub(super) struct Series {
    pub(super) rate_fps: f64,
    pub(super) nominal_hz: f64,
    pub(super) voltage: Vec<f64>,
    /// Unwrapped angle in the nominal frame, radians.
    pub(super) angle: Vec<f64>,
    pub(super) frequency_hz: Vec<f64>,
    pub(super) active: Vec<f64>,
    pub(super) reactive: Vec<f64>,
    pub(super) bad: Vec<bool>,
}

impl Series {
    /// Reads the channels; `None` when no sample is usable.
    pub(super) fn read(record: &Record) -> Option<Self> {
        let bad: Vec<bool> = record.samples.iter().map(|s| !s.usable()).collect();
        let channel = |value: fn(&crate::measurement::Sample) -> f64| {
            bridged(&record.samples.iter().map(value).collect::<Vec<_>>(), &bad)
        };
        let frequency_hz = channel(|s| s.frequency_hz)?;
        let angle = if record.has_angle() {
            let raw: Vec<f64> = record.samples.iter().map(|s| s.angle_rad).collect();
            bridged(&unwrapped(&raw, &bad), &bad)?
        } else {
            integrated(&frequency_hz, record.nominal_hz, record.rate_fps)
        };
        Some(Self {
            rate_fps: record.rate_fps,
            nominal_hz: record.nominal_hz,
            voltage: channel(|s| s.voltage_pu)?,
            angle,
            frequency_hz,
            active: channel(|s| s.active_pu)?,
            reactive: channel(|s| s.reactive_pu)?,
            bad,
        })
    }

    pub(super) fn len(&self) -> usize {
        self.bad.len()
    }

    /// Bridges again after more samples were found bad.
    pub(super) fn bridge_again(&mut self) {
        for channel in [
            &mut self.voltage,
            &mut self.angle,
            &mut self.frequency_hz,
            &mut self.active,
            &mut self.reactive,
        ] {
            if let Some(filled) = bridged(channel, &self.bad) {
                *channel = filled;
            }
        }
    }

    /// Samples per nominal cycle, at least one.
    pub(super) fn samples_per_cycle(&self) -> f64 {
        (self.rate_fps / self.nominal_hz).max(1.0)
    }
}

/// Linear between good neighbours, constant beyond the first and last good sample.
pub(super) fn bridged(values: &[f64], bad: &[bool]) -> Option<Vec<f64>> {
    let good: Vec<usize> = (0..values.len()).filter(|&k| !bad[k]).collect();
    let (&first, &last) = (good.first()?, good.last()?);
    let mut out = values.to_vec();
    out[..first].fill(values[first]);
    out[last..].fill(values[last]);
    for pair in good.windows(2) {
        let (a, b) = (pair[0], pair[1]);
        for (step, bridge) in (1..).zip(&mut out[a + 1..b]) {
            let share = f64::from(step) / (b - a) as f64;
            *bridge = values[a] + share * (values[b] - values[a]);
        }
    }
    Some(out)
}

/// Removes jumps of whole turns between good samples.
fn unwrapped(angle: &[f64], bad: &[bool]) -> Vec<f64> {
    let mut out = angle.to_vec();
    let mut previous: Option<f64> = None;
    for (value, _) in out.iter_mut().zip(bad).filter(|(_, bad)| !**bad) {
        if let Some(before) = previous {
            *value -= 2.0 * PI * ((*value - before) / (2.0 * PI)).round();
        }
        previous = Some(*value);
    }
    out
}

/// Angle from frequency by the trapezoidal rule; phase jumps are lost.
fn integrated(frequency_hz: &[f64], nominal_hz: f64, rate_fps: f64) -> Vec<f64> {
    let mut angle = 0.0;
    let mut out = vec![0.0; frequency_hz.len()];
    for k in 1..frequency_hz.len() {
        let mean = 0.5 * (frequency_hz[k - 1] + frequency_hz[k]) - nominal_hz;
        angle += 2.0 * PI * mean / rate_fps;
        out[k] = angle;
    }
    out
}

/// Noise of a series from its second differences, which a slow trend does not touch; 0 where
/// there are too few samples.
pub(super) fn noise_sigma(values: &[f64]) -> f64 {
    statistics::noise_sigma_from_second_differences(values).unwrap_or(0.0)
}

/// Median; 0 of nothing.
pub(super) fn median(values: &[f64]) -> f64 {
    statistics::median(values).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_bridged_linearly_and_ends_are_held() {
        let bad = [true, false, true, true, false, true];
        let filled = bridged(&[f64::NAN, 1.0, f64::NAN, f64::NAN, 4.0, f64::NAN], &bad).unwrap();
        assert_eq!(filled, [1.0, 1.0, 2.0, 3.0, 4.0, 4.0]);
        assert!(bridged(&[f64::NAN], &[true]).is_none());
    }

    #[test]
    fn an_angle_is_unwrapped_across_a_gap() {
        let angle = [3.0, f64::NAN, -3.0, -2.9];
        let out = unwrapped(&angle, &[false, true, false, false]);
        assert!((out[2] - (2.0 * PI - 3.0)).abs() < 1e-12);
        assert!((out[3] - (2.0 * PI - 2.9)).abs() < 1e-12);
    }

    #[test]
    fn a_trend_is_not_noise() {
        let trend: Vec<f64> = (0..50).map(|k| 3.0 * f64::from(k)).collect();
        assert!(noise_sigma(&trend) < 1e-12);
    }
}
