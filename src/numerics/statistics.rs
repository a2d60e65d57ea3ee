//! Location, spread and noise of samples, most of them indifferent to outliers.
//!
//! All functions ignore the order of their input except the two noise estimates, which live on it.
//! Values that are not finite are left out; of nothing, there is no statistic (`None`).

/// Standard deviation of a normal distribution over its median absolute deviation:
/// `1 / inverse_normal(3/4)`.
const NORMAL_SIGMA_PER_MAD: f64 = 1.482_602_218_505_602;

/// The middle value; the mean of the two middle ones for an even number.
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// The value below which a fraction `probability` of the values lies, interpolated linearly between
/// order statistics (type 7 of Hyndman and Fan 1996, the usual default). A probability outside
/// [0, 1] counts as the nearer of the two.
pub fn quantile(values: &[f64], probability: f64) -> Option<f64> {
    let mut sorted = finite(values);
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let position = probability.clamp(0.0, 1.0) * last as f64;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "between 0 and the last index"
    )]
    let below = position.floor() as usize;
    let above = (below + 1).min(last);
    let fraction = position - below as f64;
    Some(sorted[below] + fraction * (sorted[above] - sorted[below]))
}

/// Standard deviation estimated from the median absolute deviation from the median: right for
/// normal noise, and unmoved by outliers as long as they are fewer than half.
pub fn mad_sigma(values: &[f64]) -> Option<f64> {
    let values = finite(values);
    let middle = median(&values)?;
    let deviations: Vec<f64> = values.iter().map(|value| (value - middle).abs()).collect();
    Some(NORMAL_SIGMA_PER_MAD * median(&deviations)?)
}

/// Arithmetic mean (with Neumaier's compensated sum, so that it does not depend on cancellation).
pub fn mean(values: &[f64]) -> Option<f64> {
    let values = finite(values);
    (!values.is_empty()).then(|| sum(&values) / values.len() as f64)
}

/// Sample standard deviation (`n - 1` in the denominator), in two passes; needs two values.
pub fn standard_deviation(values: &[f64]) -> Option<f64> {
    let values = finite(values);
    let middle = mean(&values)?;
    let degrees = values.len().checked_sub(1).filter(|degrees| *degrees > 0)?;
    let squares: Vec<f64> = values
        .iter()
        .map(|value| (value - middle).powi(2))
        .collect();
    Some((sum(&squares) / degrees as f64).sqrt())
}

/// Square root of the mean square.
pub fn root_mean_square(values: &[f64]) -> Option<f64> {
    let squares: Vec<f64> = finite(values).iter().map(|value| value * value).collect();
    Some(mean(&squares)?.sqrt())
}

/// A mean and its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WeightedMean {
    /// `sum(w x) / sum(w)`.
    pub mean: f64,
    /// `1 / sqrt(sum(w))`: the standard error when every weight is one over the variance.
    pub standard_error: f64,
}

/// Mean of `(value, weight)` pairs. Pairs with a weight that is not positive are left out.
pub fn weighted_mean(pairs: &[(f64, f64)]) -> Option<WeightedMean> {
    let usable = pairs
        .iter()
        .filter(|(value, weight)| value.is_finite() && weight.is_finite() && *weight > 0.0);
    let (products, weights): (Vec<f64>, Vec<f64>) = usable
        .map(|(value, weight)| (value * weight, *weight))
        .unzip();
    let total = sum(&weights);
    (total > 0.0).then(|| WeightedMean {
        mean: sum(&products) / total,
        standard_error: 1.0 / total.sqrt(),
    })
}

/// Standard deviation of white noise on a signal that changes slowly, from the differences of
/// neighbours: `MAD(x[k+1] - x[k]) / sqrt(2)`. A constant slope does not count (it shifts the
/// median), rare jumps do not either. A pair with a value that is not finite is left out.
pub fn noise_sigma_from_first_differences(values: &[f64]) -> Option<f64> {
    let differences: Vec<f64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // The difference of two independent values has twice the variance of one.
    Some(mad_sigma(&differences)? / 2.0_f64.sqrt())
}

/// The same from second differences, `MAD(x[k+1] - 2 x[k] + x[k-1]) / sqrt(6)`: blind to changing
/// slopes too, and to curvature that stays the same.
pub fn noise_sigma_from_second_differences(values: &[f64]) -> Option<f64> {
    let differences: Vec<f64> = values
        .windows(3)
        .map(|triple| triple[2] - 2.0 * triple[1] + triple[0])
        .collect();
    // Variance 1 + 4 + 1 of the combination of three independent values.
    Some(mad_sigma(&differences)? / 6.0_f64.sqrt())
}

/// Neumaier's compensated sum (1974): its error does not grow with the number of terms.
pub fn sum(values: &[f64]) -> f64 {
    let (mut total, mut lost) = (0.0_f64, 0.0);
    for &value in values {
        let next = total + value;
        lost += if total.abs() >= value.abs() {
            (total - next) + value
        } else {
            (value - next) + total
        };
        total = next;
    }
    total + lost
}

fn finite(values: &[f64]) -> Vec<f64> {
    values
        .iter()
        .copied()
        .filter(|value| value.is_finite())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(found: Option<f64>, expected: f64, tolerance: f64) {
        let found = found.unwrap();
        assert!(
            (found - expected).abs() <= tolerance,
            "{found} instead of {expected}"
        );
    }

    /// A thousand numbers that are normal to three digits: quantiles of the logistic distribution
    /// would not do, so the sum of twelve uniform numbers, shuffled by a linear congruence.
    fn nearly_normal() -> Vec<f64> {
        let mut state = 12_345_u64;
        let mut uniform = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..4000)
            .map(|_| (0..12).map(|_| uniform()).sum::<f64>() - 6.0)
            .collect()
    }

    #[test]
    fn quantiles_interpolate_between_order_statistics() {
        let values = [4.0, 1.0, 3.0, 2.0];
        assert_near(median(&values), 2.5, 0.0);
        assert_near(quantile(&values, 0.25), 1.75, 0.0); // numpy.quantile
        assert_near(quantile(&values, 0.0), 1.0, 0.0);
        assert_near(quantile(&values, 7.0), 4.0, 0.0);
        assert_near(median(&[5.0, f64::NAN, 1.0, 3.0]), 3.0, 0.0);
    }

    #[test]
    fn there_is_no_statistic_of_nothing() {
        for empty in [&[][..], &[f64::NAN, f64::INFINITY]] {
            assert_eq!(median(empty), None);
            assert_eq!(mad_sigma(empty), None);
            assert_eq!(mean(empty), None);
            assert_eq!(root_mean_square(empty), None);
            assert_eq!(standard_deviation(empty), None);
            assert_eq!(noise_sigma_from_first_differences(empty), None);
            assert_eq!(noise_sigma_from_second_differences(empty), None);
        }
        assert_eq!(weighted_mean(&[(1.0, 0.0)]), None);
        assert_eq!(standard_deviation(&[1.0]), None);
    }

    #[test]
    fn mean_and_deviation_survive_a_large_offset() {
        // 4, 7, 13, 16: mean 10, sum of squares 36 + 9 + 9 + 36 = 90, over 3 is 30.
        let shifted = [4.0, 7.0, 13.0, 16.0].map(|value| value + 1e9);
        assert_near(mean(&shifted), 1e9 + 10.0, 0.0);
        assert_near(standard_deviation(&shifted), 30.0_f64.sqrt(), 1e-9);
        assert_near(mean(&[1.0, 1e100, 1.0, -1e100]), 0.5, 0.0);
    }

    #[test]
    fn weighted_mean_of_two_measurements() {
        // Variances 1 and 4: (10 + 20/4) / (1 + 1/4) = 12, error 1 / sqrt(1.25).
        let found = weighted_mean(&[(10.0, 1.0), (20.0, 0.25), (f64::NAN, 1.0)]).unwrap();
        assert_near(Some(found.mean), 12.0, 1e-15);
        assert_near(Some(found.standard_error), 0.8_f64.sqrt(), 1e-15);
    }

    #[test]
    fn mad_sigma_ignores_a_third_of_outliers() {
        let mut values = nearly_normal();
        // 4000 values: the estimate scatters by about 1.17 / sqrt(2 * 4000) = 2 %.
        assert_near(mad_sigma(&values), 1.0, 0.05);
        values.extend(std::iter::repeat_n(1e6, 400));
        assert_near(mad_sigma(&values), 1.0, 0.2);
    }

    #[test]
    fn noise_is_told_from_slope_curvature_and_jumps() {
        let signal = |k: usize| 1e-2 * k as f64 + if k > 1000 { 50.0 } else { 0.0 };
        let values: Vec<f64> = nearly_normal()
            .iter()
            .enumerate()
            .map(|(k, noise)| signal(k) + 0.5 * noise)
            .collect();
        assert_near(noise_sigma_from_first_differences(&values), 0.5, 0.03);
        assert_near(noise_sigma_from_second_differences(&values), 0.5, 0.03);
        let curved: Vec<f64> = values
            .iter()
            .enumerate()
            .map(|(k, value)| value + 1e-3 * (k * k) as f64)
            .collect();
        assert_near(noise_sigma_from_second_differences(&curved), 0.5, 0.03);
    }
}
