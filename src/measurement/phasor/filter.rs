//! The one-cycle filter of a single waveform.

use std::f64::consts::{PI, TAU};

/// A complex number in rectangular form, as few operations as are needed here.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Complex {
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
}

impl Complex {
    /// A complex number from its parts.
    #[must_use]
    pub const fn new(re: f64, im: f64) -> Self {
        Self { re, im }
    }

    /// `magnitude` at `angle_rad`.
    #[must_use]
    pub fn polar(magnitude: f64, angle_rad: f64) -> Self {
        let (sin, cos) = angle_rad.sin_cos();
        Self::new(magnitude * cos, magnitude * sin)
    }

    /// Magnitude.
    #[must_use]
    pub fn magnitude(self) -> f64 {
        self.re.hypot(self.im)
    }

    /// Angle, radians, -pi to pi.
    #[must_use]
    pub fn angle_rad(self) -> f64 {
        self.im.atan2(self.re)
    }

    /// Complex conjugate.
    #[must_use]
    pub fn conjugate(self) -> Self {
        Self::new(self.re, -self.im)
    }

    /// Product with a real number.
    #[must_use]
    pub fn scale(self, factor: f64) -> Self {
        Self::new(self.re * factor, self.im * factor)
    }
}

impl std::ops::Add for Complex {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self::new(self.re + other.re, self.im + other.im)
    }
}

impl std::ops::Mul for Complex {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        Self::new(
            self.re * other.re - self.im * other.im,
            self.re * other.im + self.im * other.re,
        )
    }
}

/// Weights that turn the samples under one window into a phasor. The weights depend on the sample
/// times only and serve all channels.
#[derive(Clone, Debug)]
pub(super) struct Window {
    /// Index of the first sample under the window.
    first: usize,
    /// Weight of each sample on the cosine and the sine part.
    weights: Vec<Complex>,
}

impl Window {
    /// The window of one nominal cycle centred on `centre_s`; none where the samples do not cover
    /// it or are too few to fix a constant and a sine wave.
    ///
    /// The phasor `X` (effective value, turning frame) minimises
    ///
    /// ```text
    /// sum_n w_n (x_n - c - sqrt(2) Re[X exp(j w0 t_n)])^2                                     (1)
    /// ```
    ///
    /// over `c` and `X`, where `w_n` is the part of sample n's cell (halfway to its neighbours)
    /// that lies under the window. With a whole number N of equidistant samples per cycle the
    /// normal equations of (1) are diagonal and the result is the discrete Fourier transform
    ///
    /// ```text
    /// X = sqrt(2)/N sum_n w_n x_n exp(-j w0 t_n)                                              (2)
    /// ```
    ///
    /// wherever the window starts; a constant and all harmonics below half the sampling rate are
    /// rejected exactly. With any other number of samples, (1) is still exact for a constant and
    /// the fundamental. Cost: one pass over the samples under the window and a 3 x 3 system.
    pub(super) fn at(time_s: &[f64], centre_s: f64, nominal_hz: f64) -> Option<Self> {
        const SAMPLES_MIN: usize = 4;
        let half_s = 0.5 / nominal_hz;
        let (low_s, high_s) = (centre_s - half_s, centre_s + half_s);
        let first = time_s.partition_point(|&t| t < low_s).saturating_sub(1);
        let mut cells = Vec::new();
        let mut covered_s = 0.0;
        for index in first..time_s.len() {
            let (start_s, end_s) = cell(time_s, index)?;
            if start_s >= high_s {
                break;
            }
            let weight = (end_s.min(high_s) - start_s.max(low_s)).max(0.0);
            covered_s += weight;
            cells.push(weight);
        }
        // The cells tile the axis: anything less than the whole window means an end was reached.
        let whole_s = 2.0 * half_s;
        if covered_s < whole_s * (1.0 - 1e-6) || cells.len() < SAMPLES_MIN {
            return None;
        }
        let basis: Vec<[f64; 3]> = (first..first + cells.len())
            .map(|index| {
                let (sin, cos) = (TAU * nominal_hz * (time_s[index] - centre_s)).sin_cos();
                [1.0, cos, -sin]
            })
            .collect();
        let inverse = inverse(&gram(&basis, &cells))?;
        let weights = basis.iter().zip(&cells).map(|(row, weight)| {
            let part = |k: usize| -> f64 { (0..3).map(|l| inverse[k][l] * row[l]).sum() };
            Complex::new(part(1), part(2)).scale(weight / std::f64::consts::SQRT_2)
        });
        Some(Self {
            first,
            weights: weights.collect(),
        })
    }

    /// The phasor of one channel (effective value) against the window's centre; NaN when a sample
    /// under the window is.
    pub(super) fn phasor(&self, values: &[f64]) -> Complex {
        let samples = &values[self.first..self.first + self.weights.len()];
        let terms = self.weights.iter().zip(samples);
        terms.fold(Complex::default(), |sum, (weight, value)| {
            sum + weight.scale(*value)
        })
    }
}

/// Effective value and phase of the nominal-frequency component of a waveform over one cycle
/// centred on `centre_s`, with phase zero for a cosine that peaks at `centre_s`. `time_s` must
/// increase and be as long as `values`; none where the samples do not cover the cycle.
#[must_use]
pub fn one_cycle_phasor(
    time_s: &[f64],
    values: &[f64],
    centre_s: f64,
    nominal_hz: f64,
) -> Option<Complex> {
    if values.len() < time_s.len() {
        return None;
    }
    Some(Window::at(time_s, centre_s, nominal_hz)?.phasor(values))
}

/// Gain of the one-cycle filter for a wave `deviation_hz` off nominal: sin(x) / x with
/// x = pi deviation / nominal.
pub(super) fn off_nominal_gain(deviation_hz: f64, nominal_hz: f64) -> f64 {
    let x = PI * deviation_hz / nominal_hz;
    if x.abs() < 1e-9 { 1.0 } else { x.sin() / x }
}

/// The part of the time axis that sample `index` stands for. The cells at the ends are as long on
/// the outside as on the inside.
fn cell(time_s: &[f64], index: usize) -> Option<(f64, f64)> {
    let now_s = time_s[index];
    let before = index.checked_sub(1).map(|i| now_s - time_s[i]);
    let after = time_s.get(index + 1).map(|next| next - now_s);
    let (before_s, after_s) = match (before, after) {
        (Some(before), Some(after)) => (before, after),
        (Some(only), None) | (None, Some(only)) => (only, only),
        (None, None) => return None,
    };
    Some((now_s - 0.5 * before_s, now_s + 0.5 * after_s))
}

fn gram(basis: &[[f64; 3]], weights: &[f64]) -> [[f64; 3]; 3] {
    let mut gram = [[0.0; 3]; 3];
    for (row, weight) in basis.iter().zip(weights) {
        for k in 0..3 {
            for l in 0..3 {
                gram[k][l] += weight * row[k] * row[l];
            }
        }
    }
    gram
}

/// Inverse of a symmetric positive definite 3 x 3 matrix by cofactors; none when it is singular to
/// working precision. The matrix is near diag(1, 1/2, 1/2) times the window, so cofactors are safe.
fn inverse(m: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let cofactor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * cofactor(0, c)).sum();
    let scale = m[0][0] * m[1][1] * m[2][2];
    if !determinant.is_finite() || determinant <= 1e-9 * scale {
        return None;
    }
    let mut inverse = [[0.0; 3]; 3];
    for (r, row) in inverse.iter_mut().enumerate() {
        for (c, value) in row.iter_mut().enumerate() {
            *value = cofactor(c, r) / determinant;
        }
    }
    Some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(rate_hz: f64, count: u32, wave: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let time_s: Vec<f64> = (0..count).map(|n| f64::from(n) / rate_hz).collect();
        let values = time_s.iter().map(|&t| wave(t)).collect();
        (time_s, values)
    }

    #[test]
    fn constant_and_sine_are_separated_exactly_at_any_sampling_rate_and_instant() {
        for rate_hz in [500.0, 1000.0, 1200.0, 2401.5, 30_707.244_140_625] {
            for centre_s in [0.05, 0.050_13, 0.061_7] {
                let wave = |t: f64| 7.0 + 100.0 * (TAU * 60.0 * (t - centre_s) + 0.4).cos();
                let (time_s, values) = samples(rate_hz, 4000, wave);
                let phasor = one_cycle_phasor(&time_s, &values, centre_s, 60.0).unwrap();
                let expected = 100.0 / std::f64::consts::SQRT_2;
                assert!(
                    (phasor.magnitude() - expected).abs() < 1e-9,
                    "{rate_hz} {phasor:?}"
                );
                assert!((phasor.angle_rad() - 0.4).abs() < 1e-11, "{rate_hz}");
            }
        }
    }

    #[test]
    fn harmonics_vanish_with_a_whole_number_of_samples_per_cycle() {
        let wave = |t: f64| (TAU * 100.0 * t).cos() + (TAU * 250.0 * t + 1.0).cos();
        let (time_s, values) = samples(1200.0, 200, wave);
        let phasor = one_cycle_phasor(&time_s, &values, 0.070_2, 50.0).unwrap();
        assert!(phasor.magnitude() < 1e-12, "{phasor:?}");
    }

    #[test]
    fn window_that_is_not_covered_by_samples_has_no_phasor() {
        let (time_s, values) = samples(1000.0, 100, f64::sin);
        assert!(one_cycle_phasor(&time_s, &values, 0.009, 50.0).is_none());
        assert!(one_cycle_phasor(&time_s, &values, 0.010, 50.0).is_some());
        assert!(one_cycle_phasor(&time_s, &values, 0.091, 50.0).is_none());
    }

    #[test]
    fn missing_sample_makes_the_windows_over_it_unknown() {
        let (time_s, mut values) = samples(1000.0, 100, f64::sin);
        values[50] = f64::NAN;
        assert!(
            one_cycle_phasor(&time_s, &values, 0.045, 50.0)
                .unwrap()
                .re
                .is_nan()
        );
        assert!(
            one_cycle_phasor(&time_s, &values, 0.030, 50.0)
                .unwrap()
                .re
                .is_finite()
        );
    }
}
