//! How far each sample of P and Q can be trusted.

use nalgebra::Complex;

use super::series::{Series, noise_sigma};

/// Noise and weights of one channel, relative to P0.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ChannelWeights {
    /// Noise before the event.
    pub(super) noise: f64,
    /// Standard deviation assumed at each sample in the fit.
    pub(super) deviation: Vec<f64>,
}

/// What the model cannot be expected to follow at any sample: discretisation of the input.
/// Chosen; insensitive between 0.0003 and 0.0008.
const DISCRETISATION: f64 = 0.0005;
/// Least noise quoted: the resolution below which a figure says nothing about the load.
pub(super) const NOISE_LEAST: f64 = 1e-4;
/// Samples each side over which the motion of the voltage is taken.
const REACH: usize = 2;

/// Error of P and Q per unit of error of the voltage: `Kpm / X'` of an ordinary load.
const GAIN: f64 = 2.0;

/// Error of P and Q per unit of local motion that is left near jumps with the filter in the model.
/// None is needed for the truth simulator's sites; an independent simulator (RAMSES) leaves up to 0.07 in the
/// middle of a jump and half of it one sample later: its static load lags by 3 ms. Kpm moves by less than
/// one standard error between 0.03 and 0.06.
const FILTERED_SHARE: f64 = 0.03;

/// How well the voltage behind each sample is known.
pub(super) struct InputUncertainty {
    /// Measured phasors.
    pub(super) phasor: Vec<Complex<f64>>,
    /// Their relative noise.
    pub(super) voltage_noise: f64,
    /// Standard deviation of the smoothed voltage, relative.
    pub(super) deviation: Vec<f64>,
    /// What the filter leaves unexplained of the voltage, relative.
    pub(super) mismatch: Vec<f64>,
    /// Samples close to a motion that is neither smooth nor a jump behind the filter: V and P
    /// through the filter do not match there sample by sample.
    pub(super) unexplained: Vec<bool>,
    /// Samples whose window, or that of a neighbour, holds a jump behind a filter.
    pub(super) behind_filter: Vec<bool>,
}

/// Weights from the noise before the event and the error that the voltage passes on. Near motion that
/// nothing explains a term grows with it; `edge_share` is the error per unit of local motion.
pub(super) fn channel(
    values: &[f64],
    pre_event: usize,
    input: &InputUncertainty,
    edge_share: f64,
) -> ChannelWeights {
    let quiet = if pre_event >= 20 {
        &values[..pre_event]
    } else {
        values
    };
    let noise = noise_sigma(quiet)
        .max(deviation_from_line(&values[..pre_event]))
        .max(NOISE_LEAST);
    let phasor = &input.phasor;
    let n = phasor.len();
    let deviation = (0..n)
        .map(|k| {
            let passed_on = GAIN * input.deviation[k].hypot(input.mismatch[k]);
            let mut square = noise.powi(2) + DISCRETISATION.powi(2) + passed_on.powi(2);
            let share = if input.unexplained[k] {
                edge_share
            } else if input.behind_filter[k] {
                FILTERED_SHARE
            } else {
                0.0
            };
            if share > 0.0 {
                square += (share * local_motion(phasor, k, input.voltage_noise)).powi(2);
            }
            square.sqrt()
        })
        .collect();
    ChannelWeights { noise, deviation }
}

/// How far the phasor (relative to V0) moves within the samples next to sample `k`, beyond its noise: the
/// standard deviation of P and of Q at a sample near a jump grows with it.
#[must_use]
pub fn local_motion(phasor: &[Complex<f64>], k: usize, noise: f64) -> f64 {
    let around = k.saturating_sub(REACH)..(k + REACH + 1).min(phasor.len());
    let motion = around
        .map(|i| (phasor[i] - phasor[k]).norm())
        .fold(0.0, f64::max);
    (motion - 4.0 * noise - 0.004).max(0.0)
}

/// Root mean square distance from the regression line: catches noise that is correlated from
/// sample to sample, which differences do not see (phasors of overlapping windows).
fn deviation_from_line(values: &[f64]) -> f64 {
    let n = values.len();
    if n < 4 {
        return 0.0;
    }
    let centre = (n - 1) as f64 / 2.0;
    let mean = values.iter().sum::<f64>() / n as f64;
    let bottom: f64 = (0..n).map(|k| (k as f64 - centre).powi(2)).sum();
    let slope = values
        .iter()
        .enumerate()
        .map(|(k, y)| (k as f64 - centre) * (y - mean))
        .sum::<f64>()
        / bottom;
    let sum: f64 = values
        .iter()
        .enumerate()
        .map(|(k, y)| (y - mean - slope * (k as f64 - centre)).powi(2))
        .sum();
    (sum / (n - 2) as f64).sqrt()
}

/// Whether sample `k` may enter the fit: good, and not behind a gap that hides what the voltage did.
pub(super) fn used(series: &Series, behind_gap: &[bool]) -> Vec<bool> {
    let flags = series.bad.iter().zip(behind_gap);
    flags.map(|(bad, behind)| !bad && !behind).collect()
}
