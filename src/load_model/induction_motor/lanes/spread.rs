//! One number with its derivatives in a single register.

use pulp::Simd;
use std::ops::{Add, Mul, Neg, Sub};

use super::{InLanes, LANES_MAX, Lanes, Mask, REGISTER_LANES_MAX, SLOPES, Slopes};

/// One number with its derivatives: the value in every lane of its registers, the derivatives in the first lanes of
/// theirs. Half the work of [`Sloped`](super::Sloped) in registers of the same size, with its bits. Needs registers of
/// at least as many lanes as there are derivatives.
#[derive(Clone, Copy, Debug)]
pub(in super::super) struct SpreadSlopes<S: Simd, const W: usize> {
    value: Lanes<S, W>,
    slopes: Lanes<S, W>,
}

impl<S: Simd, const W: usize> InLanes<S, W> for SpreadSlopes<S, W> {
    type Alone = Slopes;
    const PARTS: usize = 1 + SLOPES;

    /// Every lane has the same number.
    #[inline(always)]
    fn gather(simd: S, of: &dyn Fn(usize) -> Slopes) -> Self {
        let number = of(0);
        let slope = |lane| {
            if lane < SLOPES {
                number.derivative(lane)
            } else {
                0.0
            }
        };
        Self {
            value: Lanes::splat(simd, number.value),
            slopes: Lanes::gather(simd, &slope),
        }
    }

    #[inline(always)]
    fn scatter(self, to: &mut [Slopes]) {
        let mut parts = [[0.0; LANES_MAX]; 2];
        self.value.store(&mut parts[0]);
        self.slopes.store(&mut parts[1]);
        let number = Slopes::new(parts[0][0], &parts[1][..SLOPES]);
        for to in to.iter_mut().take(Lanes::<S, W>::COUNT) {
            *to = number;
        }
    }

    #[inline(always)]
    fn constant(value: Lanes<S, W>) -> Self {
        Self {
            value,
            slopes: Lanes::splat(value.simd, 0.0),
        }
    }

    #[inline(always)]
    fn part(self, index: usize) -> Lanes<S, W> {
        if index == 0 {
            return self.value;
        }
        let mut slopes = [0.0; REGISTER_LANES_MAX];
        let (head, _) = S::as_mut_simd_f64s(&mut slopes);
        head[0] = self.slopes.v[0];
        Lanes::splat(self.value.simd, slopes[index - 1])
    }

    #[inline(always)]
    fn select(mask: Mask<S, W>, yes: Self, no: Self) -> Self {
        Self {
            value: mask.select(yes.value, no.value),
            slopes: mask.select(yes.slopes, no.slopes),
        }
    }
}

impl<S: Simd, const W: usize> Add for SpreadSlopes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, other: Self) -> Self {
        self.value = self.value + other.value;
        self.slopes = self.slopes + other.slopes;
        self
    }
}

impl<S: Simd, const W: usize> Sub for SpreadSlopes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, other: Self) -> Self {
        self.value = self.value - other.value;
        self.slopes = self.slopes - other.slopes;
        self
    }
}

impl<S: Simd, const W: usize> Mul for SpreadSlopes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        Self {
            value: self.value * other.value,
            slopes: self.slopes * other.value + other.slopes * self.value,
        }
    }
}

impl<S: Simd, const W: usize> Neg for SpreadSlopes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        self.value = -self.value;
        self.slopes = -self.slopes;
        self
    }
}

impl<S: Simd, const W: usize> Mul<f64> for SpreadSlopes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, factor: f64) -> Self {
        self.value = self.value * factor;
        self.slopes = self.slopes * factor;
        self
    }
}

impl<S: Simd, const W: usize> Add<f64> for SpreadSlopes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, term: f64) -> Self {
        self.value = self.value + term;
        self
    }
}
