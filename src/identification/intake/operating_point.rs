//! The operating point before the event, and where "before" ends.

use super::series::{Series, median, noise_sigma};
use std::f64::consts::PI;

/// Mean values before the event.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PreEvent {
    /// Number of samples before the event; the event part of the window starts here.
    pub(super) samples: usize,
    /// Whether the operating point was at rest long enough to be measured. If not, the first
    /// samples stand in for it and the fit leaves it free.
    pub(super) steady: bool,
    pub(super) voltage: f64,
    pub(super) active: f64,
    pub(super) reactive: f64,
    pub(super) frequency_hz: f64,
    /// Slope of the angle, radians per sample.
    pub(super) angle_slope: f64,
    /// Angle of the first sample on that slope, radians.
    pub(super) angle: f64,
}

/// Departure of the smoothed voltage that ends the pre-event part, relative.
const VOLTAGE_DEPARTURE: f64 = 0.003;
/// Departure of the smoothed frequency that ends it, Hz.
const FREQUENCY_DEPARTURE_HZ: f64 = 0.012;
/// Time at the start of a window that is taken as undisturbed, seconds.
const REFERENCE_S: f64 = 0.4;
/// Fewest samples from which an operating point is measured.
const SAMPLES_MIN: usize = 5;
/// Range of the voltage before the event, relative, above which there was no rest.
const STEADY_RANGE: f64 = 0.01;
/// Samples that stand in for the operating point where there is no steady part.
const STAND_IN: usize = 2;

/// Finds the pre-event part: it ends before the first edge (and the half cycle or more that a
/// phasor filter smears it), before a slow departure, and before the detector's onset.
pub(super) fn find(series: &Series, at_edge: &[bool], onset: usize) -> PreEvent {
    let margin = margin_samples(series);
    let first_edge = at_edge
        .iter()
        .position(|edge| *edge)
        .unwrap_or(series.len());
    let mut end = (first_edge + 1).min(onset.max(1)).saturating_sub(margin);
    if let Some(slow) = slow_departure(series, end) {
        end = end.min(slow.saturating_sub(margin));
    }
    let good = (0..end).filter(|&k| !series.bad[k]).count();
    let steady = good >= SAMPLES_MIN && voltage_range(series, end) <= STEADY_RANGE;
    let end = if steady {
        end
    } else {
        STAND_IN.min(series.len())
    };
    means(series, end, steady)
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "samples per cycle lie between 1 and some hundred"
)]
fn margin_samples(series: &Series) -> usize {
    series.samples_per_cycle().ceil() as usize + 1
}

/// Highest minus lowest seven-sample mean of the usable voltage before `end`, relative to the
/// highest: noise alone is no motion.
fn voltage_range(series: &Series, end: usize) -> f64 {
    const MEAN: usize = 7;
    let good: Vec<f64> = (0..end)
        .filter(|&k| !series.bad[k])
        .map(|k| series.voltage[k])
        .collect();
    let means = good
        .windows(MEAN.min(good.len()).max(1))
        .map(|part| part.iter().sum::<f64>() / part.len() as f64);
    let (low, high) = means.fold((f64::INFINITY, 0.0_f64), |(low, high), mean| {
        (low.min(mean), high.max(mean))
    });
    if high > 0.0 {
        (high - low) / high
    } else {
        f64::INFINITY
    }
}

/// First sample at which a seven-sample mean of voltage or frequency has left its start value.
fn slow_departure(series: &Series, end: usize) -> Option<usize> {
    const HALF: usize = 3;
    let reference = reference_samples(series).min(end / 3).max(2 * HALF + 1);
    if end < reference + HALF {
        return None;
    }
    let middle = |x: &[f64]| median(&x[..reference]);
    let (v0, f0) = (middle(&series.voltage), middle(&series.frequency_hz));
    let v_limit = (5.0 * noise_sigma(&series.voltage[..reference])).max(VOLTAGE_DEPARTURE * v0);
    let f_limit =
        (6.0 * noise_sigma(&series.frequency_hz[..reference])).max(FREQUENCY_DEPARTURE_HZ);
    let mean =
        |x: &[f64], k: usize| x[k - HALF..=k + HALF].iter().sum::<f64>() / (2 * HALF + 1) as f64;
    (reference..end - HALF).find(|&k| {
        (mean(&series.voltage, k) - v0).abs() > v_limit
            || (mean(&series.frequency_hz, k) - f0).abs() > f_limit
    })
}

/// Samples at the start of a window that are taken as undisturbed: 0.4 s.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "some dozen to some hundred samples"
)]
fn reference_samples(series: &Series) -> usize {
    (REFERENCE_S * series.rate_fps) as usize
}

fn means(series: &Series, end: usize, steady: bool) -> PreEvent {
    let good: Vec<usize> = (0..end).filter(|&k| !series.bad[k]).collect();
    // A window that starts with bad samples has bridged values there: better than none.
    let chosen = if good.is_empty() {
        (0..end).collect()
    } else {
        good
    };
    let mean = |x: &[f64]| chosen.iter().map(|&k| x[k]).sum::<f64>() / chosen.len().max(1) as f64;
    let frequency_hz = mean(&series.frequency_hz);
    let angle_slope = if steady {
        regression_slope(&chosen, &series.angle)
    } else {
        2.0 * PI * (frequency_hz - series.nominal_hz) / series.rate_fps
    };
    let centre = chosen.iter().sum::<usize>() as f64 / chosen.len().max(1) as f64;
    PreEvent {
        samples: end,
        steady,
        voltage: mean(&series.voltage),
        active: mean(&series.active),
        reactive: mean(&series.reactive),
        frequency_hz,
        angle_slope,
        angle: mean(&series.angle) - angle_slope * centre,
    }
}

fn regression_slope(at: &[usize], values: &[f64]) -> f64 {
    let n = at.len() as f64;
    let centre = at.iter().sum::<usize>() as f64 / n;
    let mean = at.iter().map(|&k| values[k]).sum::<f64>() / n;
    let (mut top, mut bottom) = (0.0, 0.0);
    for &k in at {
        let x = k as f64 - centre;
        top += x * (values[k] - mean);
        bottom += x * x;
    }
    if bottom > 0.0 { top / bottom } else { 0.0 }
}
