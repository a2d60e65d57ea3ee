//! Numbers side by side in vector registers, with the arithmetic that the series needs.
//!
//! Every operation is the scalar one lane by lane and none is contracted (no fused multiply-add), so a
//! lane has the bits of the scalar run on every instruction set.

mod spread;

use pulp::Simd;
use std::ops::{Add, Mul, Neg, Sub};

use crate::numerics::{Arithmetic, Scalar, Sensitivities};

pub(super) use spread::SpreadSlopes;

/// Most lanes of one vector register.
const REGISTER_LANES_MAX: usize = 8;
/// Most lanes side by side.
pub(super) const LANES_MAX: usize = REGISTER_LANES_MAX * 3;

/// `W` vector registers side by side.
#[derive(Clone, Copy, Debug)]
pub struct Lanes<S: Simd, const W: usize> {
    simd: S,
    v: [S::f64s; W],
}

/// One truth value per lane.
#[derive(Clone, Copy, Debug)]
pub struct Mask<S: Simd, const W: usize> {
    simd: S,
    m: [S::m64s; W],
}

impl<S: Simd, const W: usize> Lanes<S, W> {
    /// Number of lanes.
    pub(super) const COUNT: usize = W * S::F64_LANES;

    /// The same number in every lane.
    #[inline(always)]
    pub(super) fn splat(simd: S, value: f64) -> Self {
        Self {
            simd,
            v: [simd.splat_f64s(value); W],
        }
    }

    /// The first [`Self::COUNT`] numbers.
    #[inline(always)]
    pub(super) fn load(simd: S, from: &[f64]) -> Self {
        let mut all = Self::splat(simd, 0.0);
        let (head, _) = S::as_simd_f64s(&from[..Self::COUNT]);
        all.v[..W].copy_from_slice(&head[..W]);
        all
    }

    /// Stores the lanes in the first [`Self::COUNT`] numbers.
    #[inline(always)]
    pub(super) fn store(self, to: &mut [f64]) {
        let (head, _) = S::as_mut_simd_f64s(&mut to[..Self::COUNT]);
        head[..W].copy_from_slice(&self.v);
    }

    /// Absolute values.
    #[inline(always)]
    pub(super) fn abs(mut self) -> Self {
        for i in 0..W {
            self.v[i] = self.simd.abs_f64s(self.v[i]);
        }
        self
    }

    /// Each number, or `most` where it is larger.
    #[inline(always)]
    pub(super) fn least(self, most: f64) -> Self {
        let most = Self::splat(self.simd, most);
        most.less_than(self).select(most, self)
    }

    /// Whether each lane is less than the other's.
    #[inline(always)]
    pub(super) fn less_than(self, other: Self) -> Mask<S, W> {
        let simd = self.simd;
        let mut m = [simd.less_than_f64s(self.v[0], other.v[0]); W];
        // An iterator over the masks would not be inlined by force.
        #[allow(clippy::needless_range_loop, reason = "see above")]
        for i in 1..W {
            m[i] = simd.less_than_f64s(self.v[i], other.v[i]);
        }
        Mask { simd, m }
    }
}

impl<S: Simd, const W: usize> Mask<S, W> {
    /// Lanes true in both.
    #[inline(always)]
    pub(super) fn and(mut self, other: Self) -> Self {
        for i in 0..W {
            self.m[i] = self.simd.and_m64s(self.m[i], other.m[i]);
        }
        self
    }

    /// Lanes true in either.
    #[inline(always)]
    pub(super) fn or(mut self, other: Self) -> Self {
        for i in 0..W {
            self.m[i] = self.simd.or_m64s(self.m[i], other.m[i]);
        }
        self
    }

    /// Lanes true here and false in the other.
    #[inline(always)]
    pub(super) fn and_not(mut self, other: Self) -> Self {
        for i in 0..W {
            self.m[i] = self
                .simd
                .and_m64s(self.m[i], self.simd.not_m64s(other.m[i]));
        }
        self
    }

    /// Whether no lane is true.
    #[inline(always)]
    pub(super) fn none(self) -> bool {
        let mut any = self.m[0];
        for i in 1..W {
            any = self.simd.or_m64s(any, self.m[i]);
        }
        self.simd.first_true_m64s(any) >= S::F64_LANES
    }

    /// Lanes of `yes` where true, of `no` elsewhere.
    #[inline(always)]
    pub(super) fn select(self, yes: Lanes<S, W>, no: Lanes<S, W>) -> Lanes<S, W> {
        let mut out = no;
        for i in 0..W {
            out.v[i] = self.simd.select_f64s(self.m[i], yes.v[i], no.v[i]);
        }
        out
    }
}

impl<S: Simd, const W: usize> Add for Lanes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, other: Self) -> Self {
        for i in 0..W {
            self.v[i] = self.simd.add_f64s(self.v[i], other.v[i]);
        }
        self
    }
}

impl<S: Simd, const W: usize> Sub for Lanes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, other: Self) -> Self {
        for i in 0..W {
            self.v[i] = self.simd.sub_f64s(self.v[i], other.v[i]);
        }
        self
    }
}

impl<S: Simd, const W: usize> Mul for Lanes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, other: Self) -> Self {
        for i in 0..W {
            self.v[i] = self.simd.mul_f64s(self.v[i], other.v[i]);
        }
        self
    }
}

impl<S: Simd, const W: usize> Neg for Lanes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        for i in 0..W {
            self.v[i] = self.simd.neg_f64s(self.v[i]);
        }
        self
    }
}

impl<S: Simd, const W: usize> Mul<f64> for Lanes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        self * Self::splat(self.simd, factor)
    }
}

impl<S: Simd, const W: usize> Add<f64> for Lanes<S, W> {
    type Output = Self;
    #[inline(always)]
    fn add(self, term: f64) -> Self {
        self + Self::splat(self.simd, term)
    }
}

/// Derivatives that a number in lanes may carry.
pub(super) const SLOPES: usize = 3;

/// A number with the derivatives that lanes carry.
pub type Slopes = Sensitivities<{ SLOPES.div_ceil(2) }>;

/// `W` vector registers of numbers, each with its derivatives: lane by lane the arithmetic of
/// [`Sensitivities`], with its bits.
#[derive(Clone, Copy, Debug)]
pub struct Sloped<S: Simd, const W: usize> {
    value: Lanes<S, W>,
    slopes: [Lanes<S, W>; SLOPES],
}

/// A number that can be simulated in lanes beside others of its kind.
pub trait LaneScalar: Scalar {
    /// Derivatives that it carries.
    const DERIVATIVES: usize;
    /// Many of them.
    type InLanes<S: Simd, const W: usize>: InLanes<S, W, Alone = Self>;
    /// Derivative number `index`.
    fn slope(self, index: usize) -> f64;
}

/// Numbers of one kind side by side.
pub trait InLanes<S: Simd, const W: usize>: Arithmetic {
    /// One of them.
    type Alone: Scalar;
    /// The value and its derivatives.
    const PARTS: usize;
    /// One number per lane.
    fn gather(simd: S, of: &dyn Fn(usize) -> Self::Alone) -> Self;
    /// One number of each lane.
    fn scatter(self, to: &mut [Self::Alone]);
    /// Numbers without derivatives.
    fn constant(value: Lanes<S, W>) -> Self;
    /// The value at 0, its derivatives from 1 on.
    fn part(self, index: usize) -> Lanes<S, W>;
    /// Lanes of `yes` where true, of `no` elsewhere.
    fn select(mask: Mask<S, W>, yes: Self, no: Self) -> Self;
}

impl LaneScalar for f64 {
    const DERIVATIVES: usize = 0;
    type InLanes<S: Simd, const W: usize> = Lanes<S, W>;

    fn slope(self, _: usize) -> f64 {
        0.0
    }
}

impl LaneScalar for Slopes {
    const DERIVATIVES: usize = SLOPES;
    type InLanes<S: Simd, const W: usize> = Sloped<S, W>;

    fn slope(self, index: usize) -> f64 {
        self.derivative(index)
    }
}

impl<S: Simd, const W: usize> InLanes<S, W> for Lanes<S, W> {
    type Alone = f64;
    const PARTS: usize = 1;

    #[inline(always)]
    fn gather(simd: S, of: &dyn Fn(usize) -> f64) -> Self {
        Self::load(simd, &std::array::from_fn::<f64, LANES_MAX, _>(of))
    }

    #[inline(always)]
    fn scatter(self, to: &mut [f64]) {
        self.store(to);
    }

    #[inline(always)]
    fn constant(value: Self) -> Self {
        value
    }

    #[inline(always)]
    fn part(self, _: usize) -> Self {
        self
    }

    #[inline(always)]
    fn select(mask: Mask<S, W>, yes: Self, no: Self) -> Self {
        mask.select(yes, no)
    }
}

impl<S: Simd, const W: usize> InLanes<S, W> for Sloped<S, W> {
    type Alone = Slopes;
    const PARTS: usize = 1 + SLOPES;

    #[inline(always)]
    fn gather(simd: S, of: &dyn Fn(usize) -> Self::Alone) -> Self {
        Self {
            value: Lanes::gather(simd, &|lane| of(lane).value),
            slopes: std::array::from_fn(|i| Lanes::gather(simd, &|lane| of(lane).derivative(i))),
        }
    }

    #[inline(always)]
    fn scatter(self, to: &mut [Self::Alone]) {
        let mut parts = [[0.0; LANES_MAX]; 1 + SLOPES];
        for (i, part) in parts.iter_mut().enumerate() {
            self.part(i).store(part);
        }
        for (lane, to) in to.iter_mut().enumerate().take(Lanes::<S, W>::COUNT) {
            *to = Sensitivities::new(parts[0][lane], &[1, 2, 3].map(|i: usize| parts[i][lane]));
        }
    }

    #[inline(always)]
    fn constant(value: Lanes<S, W>) -> Self {
        Self {
            value,
            slopes: [Lanes::splat(value.simd, 0.0); SLOPES],
        }
    }

    #[inline(always)]
    fn part(self, index: usize) -> Lanes<S, W> {
        if index == 0 {
            self.value
        } else {
            self.slopes[index - 1]
        }
    }

    #[inline(always)]
    fn select(mask: Mask<S, W>, yes: Self, no: Self) -> Self {
        let mut out = no;
        out.value = mask.select(yes.value, no.value);
        for i in 0..SLOPES {
            out.slopes[i] = mask.select(yes.slopes[i], no.slopes[i]);
        }
        out
    }
}

impl<S: Simd, const W: usize> Add for Sloped<S, W> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, other: Self) -> Self {
        self.value = self.value + other.value;
        for i in 0..SLOPES {
            self.slopes[i] = self.slopes[i] + other.slopes[i];
        }
        self
    }
}

impl<S: Simd, const W: usize> Sub for Sloped<S, W> {
    type Output = Self;
    #[inline(always)]
    fn sub(mut self, other: Self) -> Self {
        self.value = self.value - other.value;
        for i in 0..SLOPES {
            self.slopes[i] = self.slopes[i] - other.slopes[i];
        }
        self
    }
}

impl<S: Simd, const W: usize> Mul for Sloped<S, W> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let mut out = self;
        out.value = self.value * other.value;
        for i in 0..SLOPES {
            out.slopes[i] = self.slopes[i] * other.value + other.slopes[i] * self.value;
        }
        out
    }
}

impl<S: Simd, const W: usize> Neg for Sloped<S, W> {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        self.value = -self.value;
        for i in 0..SLOPES {
            self.slopes[i] = -self.slopes[i];
        }
        self
    }
}

impl<S: Simd, const W: usize> Mul<f64> for Sloped<S, W> {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, factor: f64) -> Self {
        self.value = self.value * factor;
        for i in 0..SLOPES {
            self.slopes[i] = self.slopes[i] * factor;
        }
        self
    }
}

impl<S: Simd, const W: usize> Add<f64> for Sloped<S, W> {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, term: f64) -> Self {
        self.value = self.value + term;
        self
    }
}
