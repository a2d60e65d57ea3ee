//! Frequency deviation of the terminal phasor.

use super::series::{Series, bridged};
use std::f64::consts::PI;

/// Samples each side over which the deviation is averaged.
const HALF_MEAN: usize = 2;

/// Relative deviation from the frequency before the event: central difference of the smoothed
/// angle, bridged across edges (a phase jump is not a frequency), averaged over five samples.
pub(super) fn deviation(angle: &[f64], to_edge: &[f64], series: &Series) -> Vec<f64> {
    let n = angle.len();
    let turns_per_sample = 2.0 * PI * series.nominal_hz / series.rate_fps;
    let slope: Vec<f64> = (0..n)
        .map(|k| {
            let (a, b) = (k.saturating_sub(1), (k + 1).min(n - 1));
            (angle[b] - angle[a]) / ((b - a).max(1) as f64 * turns_per_sample)
        })
        .collect();
    let reach = series.samples_per_cycle() + 1.0;
    let jumps: Vec<bool> = to_edge.iter().map(|d| *d <= reach).collect();
    let bridged = bridged(&slope, &jumps).unwrap_or_else(|| vec![0.0; n]);
    (0..n)
        .map(|k| {
            let around = k.saturating_sub(HALF_MEAN)..(k + HALF_MEAN + 1).min(n);
            let count = around.len() as f64;
            bridged[around].iter().sum::<f64>() / count
        })
        .collect()
}
