//! Forward-mode derivatives in vector registers, two to a register.
//!
//! As [`Dual`](super::Dual), whose numbers it gives bit by bit; but an array of derivatives is taken
//! apart by the compiler and its elements are packed again as they happen to meet, which costs more
//! than the arithmetic. Registers of two are what every 64-bit x86 processor has.

#![allow(
    clippy::inline_always,
    reason = "a simulation is nothing but these operations"
)]

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{
    Elementary, Scalar,
    kernel::{Kernel, in_registers},
};

/// Two numbers side by side.
#[cfg(target_arch = "x86_64")]
mod pair {
    use core::arch::x86_64::__m128d;

    use pulp::core_arch::x86::Sse2;

    /// The compiler knows the answer; nothing is asked when the program runs.
    #[inline(always)]
    #[allow(
        clippy::expect_used,
        reason = "SSE2 is part of the 64-bit instruction set"
    )]
    fn sse2() -> Sse2 {
        Sse2::try_new().expect("SSE2 is part of the 64-bit instruction set")
    }

    #[derive(Clone, Copy, Debug)]
    pub(super) struct Pair(__m128d);

    impl Pair {
        #[inline(always)]
        pub(super) fn new([first, second]: [f64; 2]) -> Self {
            Self(sse2()._mm_set_pd(second, first))
        }

        #[inline(always)]
        pub(super) fn numbers(self) -> [f64; 2] {
            let second = sse2()._mm_unpackhi_pd(self.0, self.0);
            [sse2()._mm_cvtsd_f64(self.0), sse2()._mm_cvtsd_f64(second)]
        }

        #[inline(always)]
        pub(super) fn plus(self, other: Self) -> Self {
            Self(sse2()._mm_add_pd(self.0, other.0))
        }

        #[inline(always)]
        pub(super) fn minus(self, other: Self) -> Self {
            Self(sse2()._mm_sub_pd(self.0, other.0))
        }

        #[inline(always)]
        pub(super) fn times(self, factor: f64) -> Self {
            Self(sse2()._mm_mul_pd(self.0, sse2()._mm_set1_pd(factor)))
        }

        #[inline(always)]
        pub(super) fn negative(self) -> Self {
            Self(sse2()._mm_xor_pd(self.0, sse2()._mm_set1_pd(-0.0)))
        }
    }
}

/// Two numbers side by side.
#[cfg(not(target_arch = "x86_64"))]
mod pair {
    #[derive(Clone, Copy, Debug)]
    pub(super) struct Pair([f64; 2]);

    impl Pair {
        #[inline(always)]
        pub(super) fn new(numbers: [f64; 2]) -> Self {
            Self(numbers)
        }

        #[inline(always)]
        pub(super) fn numbers(self) -> [f64; 2] {
            self.0
        }

        #[inline(always)]
        pub(super) fn plus(self, other: Self) -> Self {
            Self([self.0[0] + other.0[0], self.0[1] + other.0[1]])
        }

        #[inline(always)]
        pub(super) fn minus(self, other: Self) -> Self {
            Self([self.0[0] - other.0[0], self.0[1] - other.0[1]])
        }

        #[inline(always)]
        pub(super) fn times(self, factor: f64) -> Self {
            Self([self.0[0] * factor, self.0[1] * factor])
        }

        #[inline(always)]
        pub(super) fn negative(self) -> Self {
            Self([-self.0[0], -self.0[1]])
        }
    }
}

use pair::Pair;

/// A value and its derivatives with respect to `2 PAIRS` unknowns.
#[derive(Clone, Copy, Debug)]
pub struct Sensitivities<const PAIRS: usize> {
    /// Value.
    pub value: f64,
    pairs: [Pair; PAIRS],
}

impl<const PAIRS: usize> Sensitivities<PAIRS> {
    /// Number of derivatives.
    pub const COUNT: usize = 2 * PAIRS;

    /// A value with its derivatives; those not given are zero, those beyond [`Self::COUNT`] left out.
    #[must_use]
    pub fn new(value: f64, derivatives: &[f64]) -> Self {
        let at = |i: usize| derivatives.get(i).copied().unwrap_or(0.0);
        let mut pairs = [Pair::new([0.0; 2]); PAIRS];
        for (i, pair) in pairs.iter_mut().enumerate() {
            *pair = Pair::new([at(2 * i), at(2 * i + 1)]);
        }
        Self { value, pairs }
    }

    /// Unknown number `index` with its value.
    #[must_use]
    pub fn variable(value: f64, index: usize) -> Self {
        let mut whole = Self::constant(value);
        if let Some(pair) = whole.pairs.get_mut(index / 2) {
            let first = index.is_multiple_of(2);
            *pair = Pair::new(if first { [1.0, 0.0] } else { [0.0, 1.0] });
        }
        whole
    }

    /// The derivative with respect to unknown number `index`, 0 beyond [`Self::COUNT`].
    #[inline(always)]
    #[must_use]
    pub fn derivative(&self, index: usize) -> f64 {
        let pair = self.pairs.get(index / 2);
        pair.map_or(0.0, |pair| pair.numbers()[index % 2])
    }

    /// The first derivatives; zero where there are fewer.
    #[inline(always)]
    pub(super) fn first<const N: usize>(&self) -> [f64; N] {
        let mut all = [0.0; N];
        for i in 0..PAIRS.min(N / 2) {
            [all[2 * i], all[2 * i + 1]] = self.pairs[i].numbers();
        }
        all
    }

    /// A value with its first derivatives.
    #[inline(always)]
    pub(super) fn with_first<const N: usize>(value: f64, derivatives: &[f64; N]) -> Self {
        let mut whole = Self::constant(value);
        for i in 0..PAIRS.min(N / 2) {
            whole.pairs[i] = Pair::new([derivatives[2 * i], derivatives[2 * i + 1]]);
        }
        whole
    }

    /// The same without the last two derivatives.
    #[inline(always)]
    #[must_use]
    pub fn without_last_pair(mut self) -> Self {
        if let Some(last) = self.pairs.last_mut() {
            *last = Pair::new([0.0; 2]);
        }
        self
    }

    /// All derivatives in order.
    pub fn derivatives(&self) -> impl Iterator<Item = f64> {
        self.pairs.iter().flat_map(|pair| pair.numbers())
    }

    #[inline(always)]
    fn chain(self, value: f64, slope: f64) -> Self {
        let mut pairs = self.pairs;
        for pair in &mut pairs {
            *pair = pair.times(slope);
        }
        Self { value, pairs }
    }

    #[inline(always)]
    fn combine(self, other: Self, value: f64, slope: f64, slope_other: f64) -> Self {
        let mut pairs = self.pairs;
        for (pair, other) in pairs.iter_mut().zip(other.pairs) {
            *pair = pair.times(slope).plus(other.times(slope_other));
        }
        Self { value, pairs }
    }
}

impl<const PAIRS: usize> Add for Sensitivities<PAIRS> {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let mut pairs = self.pairs;
        for (pair, other) in pairs.iter_mut().zip(other.pairs) {
            *pair = pair.plus(other);
        }
        Self {
            value: self.value + other.value,
            pairs,
        }
    }
}

impl<const PAIRS: usize> Sub for Sensitivities<PAIRS> {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let mut pairs = self.pairs;
        for (pair, other) in pairs.iter_mut().zip(other.pairs) {
            *pair = pair.minus(other);
        }
        Self {
            value: self.value - other.value,
            pairs,
        }
    }
}

impl<const PAIRS: usize> Mul for Sensitivities<PAIRS> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.combine(other, self.value * other.value, other.value, self.value)
    }
}

impl<const PAIRS: usize> Div for Sensitivities<PAIRS> {
    type Output = Self;

    #[inline(always)]
    fn div(self, other: Self) -> Self {
        let quotient = self.value / other.value;
        self.combine(other, quotient, 1.0 / other.value, -quotient / other.value)
    }
}

impl<const PAIRS: usize> Neg for Sensitivities<PAIRS> {
    type Output = Self;

    #[inline(always)]
    fn neg(self) -> Self {
        let mut pairs = self.pairs;
        for pair in &mut pairs {
            *pair = pair.negative();
        }
        Self {
            value: -self.value,
            pairs,
        }
    }
}

impl<const PAIRS: usize> Mul<f64> for Sensitivities<PAIRS> {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self.chain(self.value * factor, factor)
    }
}

impl<const PAIRS: usize> Add<f64> for Sensitivities<PAIRS> {
    type Output = Self;

    #[inline(always)]
    fn add(self, term: f64) -> Self {
        Self {
            value: self.value + term,
            pairs: self.pairs,
        }
    }
}

impl<const PAIRS: usize> Scalar for Sensitivities<PAIRS> {
    #[inline(always)]
    fn constant(value: f64) -> Self {
        Self {
            value,
            pairs: [Pair::new([0.0; 2]); PAIRS],
        }
    }

    #[inline(always)]
    fn value(self) -> f64 {
        self.value
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, 0.5 / root)
    }

    #[inline(always)]
    fn exp(self) -> Self {
        let power = self.value.exp();
        self.chain(power, power)
    }

    #[inline(always)]
    fn through<const N: usize, const M: usize>(
        kernel: &impl Kernel<N, M>,
        x: [&Self; N],
    ) -> [Self; M] {
        in_registers(kernel, x)
    }
}

impl<const PAIRS: usize> Elementary for Sensitivities<PAIRS> {
    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(self.value.ln(), 1.0 / self.value)
    }

    #[inline(always)]
    fn sin_cos(self) -> [Self; 2] {
        let (sine, cosine) = self.value.sin_cos();
        [self.chain(sine, cosine), self.chain(cosine, -sine)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::Dual;

    fn formula<S: Elementary>(x: S, y: S, z: S) -> S {
        let [sine, cosine] = (x * y + 1.5).sqrt().sin_cos();
        sine / (y - x.exp() * 0.25) - -x + cosine * z.ln()
    }

    #[test]
    fn values_and_derivatives_have_the_bits_of_dual_numbers() {
        let at = [0.7, 2.3, 1.9];
        let [x, y, z] = [0, 1, 2].map(|i| Dual::<3>::variable(at[i], i));
        let dual = formula(x, y, z);
        let [x, y, z] = [0, 1, 2].map(|i| Sensitivities::<2>::variable(at[i], i));
        let found = formula(x, y, z);
        assert_eq!(found.value.to_bits(), dual.value.to_bits());
        for (i, derivative) in dual.derivatives.into_iter().enumerate() {
            assert_eq!(found.derivative(i).to_bits(), derivative.to_bits());
        }
        assert!(found.derivative(3).abs() < 1e-300 && found.derivatives().count() == 4);
    }
}
