//! Cross-correlation of a residual with the voltage.

use super::{Channel, CrossCorrelation, EventSeries, autocorrelation::autocorrelation};

/// Longest lag, seconds.
const LAG_MAX_S: f64 = 1.0;
/// Lags of the autocorrelations in the band at most: beyond, they are noise.
const BAND_LAGS_MAX: usize = 400;
/// Fewest samples that give a correlation.
const SAMPLES_MIN: usize = 20;
/// Two-sided 95 % quantile of the normal distribution.
const QUANTILE_95: f64 = 1.959_963_984_540_054;

/// Correlation of the residual with the voltage deviation at lags of up to a second, over the event
/// part away from edges. None with fewer than 20 samples or where one of both is constant.
///
/// The band is `1.96 sqrt(sum_j rho_r(j) rho_v(j) / n)` over all lags `j`: the variance of a
/// cross-correlation of independent series (Bartlett 1935; Box, Jenkins, Reinsel, Time Series
/// Analysis, section 12.1.3), with the estimated autocorrelations.
pub(super) fn cross_correlation(
    series: &EventSeries,
    channel: Channel,
) -> Option<CrossCorrelation> {
    let from = series.onset();
    let told = |k: usize| series.tells_of_the_load(channel, k) && series.voltage[k].is_finite();
    let masked = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (from..series.len())
            .map(|k| if told(k) { value(k) } else { f64::NAN })
            .collect()
    };
    let residual = masked(&|k| series.channel(channel).residual(k));
    let voltage = masked(&|k| series.voltage[k]);
    let count = residual.iter().filter(|x| x.is_finite()).count();
    if count < SAMPLES_MIN {
        return None;
    }
    let (r, v) = (centred(&residual), centred(&voltage));
    let square = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>();
    let scale = (square(&r) * square(&v)).sqrt();
    if scale <= f64::MIN_POSITIVE {
        return None;
    }
    let reach = lag_samples(series.interval_s(), r.len() / 4);
    let (lags, correlation) = (-reach..=reach)
        .map(|lag| {
            (
                lag as f64 * series.interval_s(),
                shifted(&r, &v, lag) / scale,
            )
        })
        .unzip();
    let lags_max = (r.len() / 4).min(BAND_LAGS_MAX);
    let products = autocorrelation(&residual, lags_max)
        .into_iter()
        .zip(autocorrelation(&voltage, lags_max))
        .map(|(a, b)| a * b);
    let sum = 2.0 * products.sum::<f64>() - 1.0;
    Some(CrossCorrelation {
        channel,
        lags_s: lags,
        correlation,
        // Less than white noise is an accident of the estimates.
        band: (QUANTILE_95 * (sum.max(1.0) / count as f64).sqrt()).min(1.0),
    })
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_possible_wrap,
    reason = "clamped in the same expression; a series is shorter than 2^63"
)]
fn lag_samples(interval_s: f64, most: usize) -> isize {
    (LAG_MAX_S / interval_s).round().clamp(0.0, most as f64) as isize
}

fn centred(values: &[f64]) -> Vec<f64> {
    let finite: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    let mean = finite.iter().sum::<f64>() / finite.len().max(1) as f64;
    let zeroed = |x: &f64| if x.is_finite() { x - mean } else { 0.0 };
    values.iter().map(zeroed).collect()
}

/// `sum_k r[k + lag] v[k]`.
fn shifted(r: &[f64], v: &[f64], lag: isize) -> f64 {
    let by = lag.unsigned_abs();
    let (later, earlier) = if lag >= 0 { (r, v) } else { (v, r) };
    let pairs = later.iter().skip(by).zip(earlier);
    pairs.map(|(a, b)| a * b).sum()
}
