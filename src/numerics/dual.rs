//! Forward-mode derivatives: one arithmetic for values and for exact sensitivities.
//!
//! A model written once over [`Scalar`] runs with `f64` for its value and with [`Dual`] for its
//! value and its derivatives. The value part of a dual run does the same operations in the same
//! order as the plain run, so both give the same bits.

#![allow(
    clippy::inline_always,
    reason = "a simulation is nothing but these operations"
)]

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::kernel::Kernel;

/// What a polynomial right-hand side needs of its numbers. Besides every [`Scalar`], lanes of numbers
/// side by side have it.
pub trait Arithmetic:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
    + Mul<f64, Output = Self>
    + Add<f64, Output = Self>
{
}

impl<T> Arithmetic for T where
    T: Copy
        + Add<Output = T>
        + Sub<Output = T>
        + Mul<Output = T>
        + Neg<Output = T>
        + Mul<f64, Output = T>
        + Add<f64, Output = T>
{
}

/// Numbers a model can be simulated in.
pub trait Scalar: Arithmetic + Div<Output = Self> {
    /// A constant.
    fn constant(value: f64) -> Self;
    /// The value without derivatives.
    fn value(self) -> f64;
    /// Square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// Exponential function.
    #[must_use]
    fn exp(self) -> Self;
    /// A formula of several numbers, taken from where they are, in the widest registers where that serves.
    #[inline(always)]
    fn through<const N: usize, const M: usize>(
        kernel: &impl Kernel<N, M>,
        x: [&Self; N],
    ) -> [Self; M] {
        kernel.apply(x.map(|x| *x))
    }
}

impl Scalar for f64 {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn value(self) -> f64 {
        self
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self::sqrt(self)
    }

    #[inline(always)]
    fn exp(self) -> Self {
        Self::exp(self)
    }
}

/// A value and its derivatives with respect to `N` unknowns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<const N: usize> {
    /// Value.
    pub value: f64,
    /// Partial derivatives.
    pub derivatives: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// Unknown number `index` with its value.
    #[must_use]
    pub const fn variable(value: f64, index: usize) -> Self {
        let mut derivatives = [0.0; N];
        derivatives[index] = 1.0;
        Self { value, derivatives }
    }

    #[inline(always)]
    fn chain(self, value: f64, slope: f64) -> Self {
        Self {
            value,
            derivatives: self.derivatives.map(|d| d * slope),
        }
    }

    #[inline(always)]
    fn combine(self, other: Self, value: f64, slope: f64, slope_other: f64) -> Self {
        let mut derivatives = self.derivatives;
        for (d, o) in derivatives.iter_mut().zip(other.derivatives) {
            *d = *d * slope + o * slope_other;
        }
        Self { value, derivatives }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let mut derivatives = self.derivatives;
        for (d, o) in derivatives.iter_mut().zip(other.derivatives) {
            *d += o;
        }
        Self {
            value: self.value + other.value,
            derivatives,
        }
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let mut derivatives = self.derivatives;
        for (d, o) in derivatives.iter_mut().zip(other.derivatives) {
            *d -= o;
        }
        Self {
            value: self.value - other.value,
            derivatives,
        }
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.combine(other, self.value * other.value, other.value, self.value)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let quotient = self.value / other.value;
        self.combine(other, quotient, 1.0 / other.value, -quotient / other.value)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self.chain(self.value * factor, factor)
    }
}

impl<const N: usize> Add<f64> for Dual<N> {
    type Output = Self;

    #[inline(always)]
    fn add(self, term: f64) -> Self {
        Self {
            value: self.value + term,
            derivatives: self.derivatives,
        }
    }
}

impl<const N: usize> Scalar for Dual<N> {
    fn constant(value: f64) -> Self {
        Self {
            value,
            derivatives: [0.0; N],
        }
    }

    fn value(self) -> f64 {
        self.value
    }

    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, 0.5 / root)
    }

    fn exp(self) -> Self {
        let power = self.value.exp();
        self.chain(power, power)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn formula<S: Scalar>(x: S, y: S) -> S {
        (x * y + 1.5).sqrt() / (y - x.exp() * 0.25) - -x
    }

    #[test]
    fn derivatives_agree_with_central_differences() {
        let (x, y, h) = (0.7, 2.3, 1e-6);
        let exact = formula(Dual::<2>::variable(x, 0), Dual::<2>::variable(y, 1));
        let by_x = (formula(x + h, y) - formula(x - h, y)) / (2.0 * h);
        let by_y = (formula(x, y + h) - formula(x, y - h)) / (2.0 * h);
        // Central differences with h = 1e-6 are good to about 1e-9 here.
        assert!((exact.derivatives[0] - by_x).abs() < 1e-8);
        assert!((exact.derivatives[1] - by_y).abs() < 1e-8);
    }

    #[test]
    fn the_value_of_a_dual_run_has_the_bits_of_the_plain_run() {
        let exact = formula(Dual::<2>::variable(0.7, 0), Dual::<2>::variable(2.3, 1));
        assert_eq!(exact.value.to_bits(), formula(0.7, 2.3).to_bits());
    }
}
