//! Numbers side by side in vector registers, with the arithmetic that the series needs.
//!
//! Every operation is the scalar one lane by lane and none is contracted (no fused multiply-add), so a
//! lane has the bits of the scalar run on every instruction set.

use pulp::Simd;
use std::ops::{Add, Mul, Neg, Sub};

/// Most lanes of one vector register.
pub(super) const REGISTER_LANES_MAX: usize = 8;

/// `W` vector registers side by side.
#[derive(Clone, Copy)]
pub(super) struct Lanes<S: Simd, const W: usize> {
    simd: S,
    v: [S::f64s; W],
}

/// One truth value per lane.
#[derive(Clone, Copy)]
pub(super) struct Mask<S: Simd, const W: usize> {
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
