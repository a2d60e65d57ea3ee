//! How much neighbouring values of a series with gaps say the same.

/// Autocorrelation of a series about its mean at lags 0, 1, ... `lags_max`; a value that is not
/// finite is a gap. Zero everywhere for a constant. Sums run over the pairs that exist and are
/// divided by the number of values, which keeps the function positive semidefinite without gaps.
pub(super) fn autocorrelation(values: &[f64], lags_max: usize) -> Vec<f64> {
    lags(values, lags_max).collect()
}

/// The same lag by lag: whoever needs the first few does not pay for the others.
fn lags(values: &[f64], lags_max: usize) -> impl Iterator<Item = f64> {
    let finite: Vec<f64> = values.iter().copied().filter(|x| x.is_finite()).collect();
    let mean = finite.iter().sum::<f64>() / finite.len().max(1) as f64;
    let centred: Vec<f64> = values
        .iter()
        .map(|x| if x.is_finite() { x - mean } else { 0.0 })
        .collect();
    let variance: f64 = centred.iter().map(|x| x * x).sum();
    (0..=lags_max).map(move |lag| {
        let pairs = centred.iter().zip(centred.iter().skip(lag));
        let sum: f64 = pairs.map(|(a, b)| a * b).sum();
        if variance > 0.0 { sum / variance } else { 0.0 }
    })
}

/// How many samples make one independent value: `1 + 2 sum rho`, up to the first lag at which the
/// autocorrelation is not positive (Geyer's initial positive sequence, cut at single lags); at least 1.
pub(super) fn samples_per_independent_value(values: &[f64]) -> f64 {
    let lags_max = values.len() / 4;
    let positive = lags(values, lags_max).skip(1).take_while(|r| *r > 0.0);
    1.0 + 2.0 * positive.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alternating_values_are_anticorrelated() {
        let values: Vec<f64> = (0..100)
            .map(|k| if k % 2 == 0 { 1.0 } else { -1.0 })
            .collect();
        let rho = autocorrelation(&values, 2);
        // 99 and 98 of 100 products exist.
        assert!(
            (rho[1] + 0.99).abs() < 1e-12 && (rho[2] - 0.98).abs() < 1e-12,
            "{rho:?}"
        );
        assert!((samples_per_independent_value(&values) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn blocks_of_equal_values_count_about_once() {
        // Signs of a quadratic residue sequence, each repeated ten times.
        let values: Vec<f64> = (0..1000_u64)
            .map(|k| {
                let residue = (k / 10).pow(2) % 103;
                if residue < 51 { 1.0 } else { -1.0 }
            })
            .collect();
        let count = samples_per_independent_value(&values);
        assert!((5.0..30.0).contains(&count), "{count}");
    }

    #[test]
    fn a_constant_and_nothing_have_no_correlation() {
        assert_eq!(autocorrelation(&[2.0; 5], 2), [0.0; 3]);
        assert_eq!(autocorrelation(&[], 1), [0.0; 2]);
        assert_eq!(autocorrelation(&[f64::NAN; 3], 1), [0.0; 2]);
    }
}
