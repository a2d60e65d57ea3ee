//! Where the voltage jumps: fault inception, clearing, switching.

use super::series::{Series, median, noise_sigma};

/// An edge stands out of its surroundings by this many noise deviations. Chosen; insensitive
/// between 6 and 10.
const EDGE_SIGMAS: f64 = 8.0;
/// Least jump of ln|V| + j angle that counts as an edge.
const EDGE_LEAST: f64 = 0.012;
/// Samples over which the ordinary motion is taken, each side.
const SURROUNDINGS: usize = 7;

/// For each step between neighbouring samples, whether it belongs to an edge.
pub(super) fn steps_at_edges(series: &Series) -> Vec<bool> {
    let steps = log_phasor_steps(series);
    let sigma = input_noise(series);
    let threshold = (EDGE_SIGMAS * sigma).max(EDGE_LEAST);
    let n = steps.len();
    (0..n)
        .map(|k| {
            let from = k.saturating_sub(SURROUNDINGS);
            let to = (k + SURROUNDINGS + 1).min(n);
            let ordinary = |part: usize| {
                let around: Vec<f64> = steps[from..to].iter().map(|s| s[part]).collect();
                median(&around)
            };
            let [re, im] = steps[k];
            (re - ordinary(0)).hypot(im - ordinary(1)) > threshold
        })
        .collect()
}

/// For each sample, the distance to the nearest edge in samples; infinite without one.
pub(super) fn distance_to_edge(at_edge: &[bool], samples: usize) -> Vec<f64> {
    let middles: Vec<f64> = (0..at_edge.len())
        .filter(|&k| at_edge[k])
        .map(|k| k as f64 + 0.5)
        .collect();
    (0..samples)
        .map(|k| {
            middles
                .iter()
                .map(|m| (m - k as f64).abs())
                .fold(f64::INFINITY, f64::min)
        })
        .collect()
}

/// Noise of ln|V| + j angle per part: the larger of the two.
pub(super) fn input_noise(series: &Series) -> f64 {
    let log: Vec<f64> = series.voltage.iter().map(|v| v.max(1e-3).ln()).collect();
    noise_sigma(&log).max(noise_sigma(&series.angle))
}

fn log_phasor_steps(series: &Series) -> Vec<[f64; 2]> {
    (1..series.len())
        .map(|k| {
            let ratio = series.voltage[k].max(1e-3) / series.voltage[k - 1].max(1e-3);
            [ratio.ln(), series.angle[k] - series.angle[k - 1]]
        })
        .collect()
}
