//! Elementary functions over [`Scalar`]: what physical models need beyond the four operations.
//!
//! Everything here is written so that the value of a [`Dual`] run has the bits of the plain run,
//! and so that a function which is meant to be exactly 0 or 1 outside its range is exactly that.

#![allow(
    clippy::inline_always,
    reason = "compiled for the instruction set of the simulation they are part of"
)]

use super::{Dual, Scalar};

/// Scalars with logarithm and circular functions.
pub trait Elementary: Scalar {
    /// Natural logarithm.
    #[must_use]
    fn ln(self) -> Self;
    /// Sine and cosine.
    #[must_use]
    fn sin_cos(self) -> [Self; 2];
}

impl Elementary for f64 {
    #[inline(always)]
    fn ln(self) -> Self {
        Self::ln(self)
    }

    #[inline(always)]
    fn sin_cos(self) -> [Self; 2] {
        let (sine, cosine) = Self::sin_cos(self);
        [sine, cosine]
    }
}

impl<const N: usize> Elementary for Dual<N> {
    #[inline(always)]
    fn ln(self) -> Self {
        scaled(self, self.value.ln(), 1.0 / self.value)
    }

    #[inline(always)]
    fn sin_cos(self) -> [Self; 2] {
        let (sine, cosine) = self.value.sin_cos();
        [scaled(self, sine, cosine), scaled(self, cosine, -sine)]
    }
}

#[inline(always)]
fn scaled<const N: usize>(x: Dual<N>, value: f64, slope: f64) -> Dual<N> {
    Dual {
        value,
        derivatives: x.derivatives.map(|d| d * slope),
    }
}

/// `base^exponent` for a positive base; exactly 1 for the exponent 0 or the base 1.
#[must_use]
#[inline(always)]
pub fn power<S: Elementary>(base: S, exponent: S) -> S {
    (base.ln() * exponent).exp()
}

/// The larger of `x` and a constant; at equality the derivatives of `x`.
#[must_use]
#[inline(always)]
pub fn at_least<S: Scalar>(x: S, floor: f64) -> S {
    if x.value() < floor {
        S::constant(floor)
    } else {
        x
    }
}

/// The smaller of `x` and a constant; at equality the derivatives of `x`.
#[must_use]
#[inline(always)]
pub fn at_most<S: Scalar>(x: S, ceiling: f64) -> S {
    if x.value() > ceiling {
        S::constant(ceiling)
    } else {
        x
    }
}

/// The smaller of two.
#[must_use]
#[inline(always)]
pub fn smaller<S: Scalar>(x: S, y: S) -> S {
    if y.value() < x.value() { y } else { x }
}

/// The larger of two.
#[must_use]
#[inline(always)]
pub fn larger<S: Scalar>(x: S, y: S) -> S {
    if y.value() > x.value() { y } else { x }
}

/// Rises from exactly 0 at `x <= 0` to exactly 1 at `x >= 1` as `3 x^2 - 2 x^3`, with a continuous
/// first derivative. A logistic curve would leave a trace at any distance, and a load at rest would
/// not be at rest.
#[must_use]
#[inline(always)]
pub fn smooth_step<S: Scalar>(x: S) -> S {
    if x.value() <= 0.0 {
        S::constant(0.0)
    } else if x.value() >= 1.0 {
        S::constant(1.0)
    } else {
        x * x * (x * -2.0 + 3.0)
    }
}

/// `(1 - e^-x) / x`: the mean of `e^-t` over `0..x`; 1 at 0.
#[must_use]
#[inline(always)]
pub fn mean_decay<S: Scalar>(x: S) -> S {
    // Below this the series is exact to 3e-17 relative; above it the difference loses 13 digits at
    // most of 16 only where x is itself below 1e-3.
    const SERIES_BELOW: f64 = 1e-2;
    if x.value().abs() < SERIES_BELOW {
        let term = |next: S, n: f64| x * (-1.0 / n) * next + 1.0;
        let inner = (3..=7)
            .rev()
            .fold(S::constant(1.0), |acc, n| term(acc, f64::from(n)));
        return term(inner, 2.0);
    }
    ((-x).exp() * -1.0 + 1.0) / x
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slope(f: impl Fn(f64) -> f64, x: f64) -> f64 {
        let h = 1e-5;
        (f(x + h) - f(x - h)) / (2.0 * h)
    }

    #[test]
    fn derivatives_agree_with_differences() {
        for x in [0.003, 0.2, 0.77] {
            let at = Dual::<1>::variable(x, 0);
            let pairs = [
                (at.ln().derivatives[0], slope(f64::ln, x)),
                (at.sin_cos()[0].derivatives[0], slope(f64::sin, x)),
                (at.sin_cos()[1].derivatives[0], slope(f64::cos, x)),
                (smooth_step(at).derivatives[0], slope(smooth_step, x)),
                (mean_decay(at).derivatives[0], slope(mean_decay, x)),
                (power(at, at).derivatives[0], slope(|y| power(y, y), x)),
            ];
            for (exact, difference) in pairs {
                // Central differences: h^2 times third derivatives, the largest that of ln at .003.
                assert!((exact - difference).abs() < 4e-3 * exact.abs().max(1.0) * 1e-2);
            }
        }
    }

    #[test]
    fn steps_and_powers_are_exact_where_they_are_meant_to_be() {
        assert_eq!(smooth_step(-0.1_f64).to_bits(), 0.0_f64.to_bits());
        assert_eq!(smooth_step(1.5_f64).to_bits(), 1.0_f64.to_bits());
        assert_eq!(power(0.3_f64, 0.0).to_bits(), 1.0_f64.to_bits());
        assert_eq!(power(1.0_f64, 3.7).to_bits(), 1.0_f64.to_bits());
    }

    #[test]
    fn mean_decay_is_continuous_where_the_series_ends() {
        for x in [1e-2_f64, 9.999_999e-3] {
            let reference = -(-x).exp_m1() / x;
            assert!((mean_decay(x) - reference).abs() < 1e-13);
        }
        assert!((mean_decay(0.0_f64) - 1.0).abs() < 1e-16);
    }
}
