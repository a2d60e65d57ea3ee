//! Formulas that numbers with derivatives go through in the widest registers of the processor.
//!
//! [`Sensitivities`] are registers of two, which need no dispatch. A formula worth a call, as a step of an
//! integration, is carried out with all eight derivatives in one register of eight or two of four instead.
//! Every operation is that of [`Sensitivities`], lane by lane and none contracted, so the bits are the same.

#![allow(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]

use std::ops::{Add, Mul, Neg, Sub};

use pulp::{Arch, Simd, WithSimd};

use super::{Arithmetic, Sensitivities};

/// A formula of `N` numbers that gives `M`.
pub trait Kernel<const N: usize, const M: usize> {
    /// The formula; to be inlined by force, with all that it calls.
    fn apply<T: Arithmetic>(&self, x: [T; N]) -> [T; M];
}

/// Derivatives that fill the widest registers.
const LANES: usize = 8;

/// `kernel` of numbers with [`LANES`] derivatives in the widest registers, of others as they are.
pub(super) fn in_registers<const PAIRS: usize, const N: usize, const M: usize>(
    kernel: &impl Kernel<N, M>,
    x: [&Sensitivities<PAIRS>; N],
) -> [Sensitivities<PAIRS>; M] {
    if Sensitivities::<PAIRS>::COUNT == LANES {
        Arch::new().dispatch(Returning::<_, PAIRS, N, M>(Call { kernel, x }))
    } else {
        kernel.apply(x.map(|x| *x))
    }
}

struct Call<'a, K, const PAIRS: usize, const N: usize> {
    kernel: &'a K,
    x: [&'a Sensitivities<PAIRS>; N],
}

/// A call whose number of results is known.
struct Returning<'a, K, const PAIRS: usize, const N: usize, const M: usize>(Call<'a, K, PAIRS, N>);

impl<K: Kernel<N, M>, const PAIRS: usize, const N: usize, const M: usize> WithSimd
    for Returning<'_, K, PAIRS, N, M>
{
    type Output = [Sensitivities<PAIRS>; M];

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Call { kernel, x } = self.0;
        match S::F64_LANES {
            8 => wide::<S, K, 1, PAIRS, N, M>(simd, kernel, x),
            4 => wide::<S, K, 2, PAIRS, N, M>(simd, kernel, x),
            _ => kernel.apply(x.map(|x| *x)),
        }
    }
}

#[inline(always)]
fn wide<
    S: Simd,
    K: Kernel<N, M>,
    const W: usize,
    const PAIRS: usize,
    const N: usize,
    const M: usize,
>(
    simd: S,
    kernel: &K,
    x: [&Sensitivities<PAIRS>; N],
) -> [Sensitivities<PAIRS>; M] {
    let mut numbers = [Wide::<S, W>::constant(simd, 0.0); N];
    for i in 0..N {
        numbers[i] = Wide::load(simd, x[i]);
    }
    let found = kernel.apply(numbers);
    let mut out = [Sensitivities::<PAIRS>::new(0.0, &[]); M];
    for i in 0..M {
        out[i] = found[i].store();
    }
    out
}

/// A value with its derivatives in `W` registers.
#[derive(Clone, Copy)]
struct Wide<S: Simd, const W: usize> {
    simd: S,
    value: f64,
    slopes: [S::f64s; W],
}

impl<S: Simd, const W: usize> Wide<S, W> {
    #[inline(always)]
    fn constant(simd: S, value: f64) -> Self {
        Self {
            simd,
            value,
            slopes: [simd.splat_f64s(0.0); W],
        }
    }

    #[inline(always)]
    fn load<const PAIRS: usize>(simd: S, from: &Sensitivities<PAIRS>) -> Self {
        let mut number = Self::constant(simd, from.value);
        let derivatives: [f64; LANES] = from.first();
        let (head, _) = S::as_simd_f64s(&derivatives);
        number.slopes[..W].copy_from_slice(&head[..W]);
        number
    }

    #[inline(always)]
    fn store<const PAIRS: usize>(self) -> Sensitivities<PAIRS> {
        let mut derivatives = [0.0; LANES];
        let (head, _) = S::as_mut_simd_f64s(&mut derivatives);
        head[..W].copy_from_slice(&self.slopes);
        Sensitivities::with_first(self.value, &derivatives)
    }
}

impl<S: Simd, const W: usize> Add for Wide<S, W> {
    type Output = Self;

    #[inline(always)]
    fn add(mut self, other: Self) -> Self {
        self.value += other.value;
        for i in 0..W {
            self.slopes[i] = self.simd.add_f64s(self.slopes[i], other.slopes[i]);
        }
        self
    }
}

impl<S: Simd, const W: usize> Sub for Wide<S, W> {
    type Output = Self;

    #[inline(always)]
    fn sub(mut self, other: Self) -> Self {
        self.value -= other.value;
        for i in 0..W {
            self.slopes[i] = self.simd.sub_f64s(self.slopes[i], other.slopes[i]);
        }
        self
    }
}

impl<S: Simd, const W: usize> Mul for Wide<S, W> {
    type Output = Self;

    #[inline(always)]
    fn mul(mut self, other: Self) -> Self {
        let simd = self.simd;
        let (own, others) = (simd.splat_f64s(self.value), simd.splat_f64s(other.value));
        self.value *= other.value;
        for i in 0..W {
            self.slopes[i] = simd.add_f64s(
                simd.mul_f64s(self.slopes[i], others),
                simd.mul_f64s(other.slopes[i], own),
            );
        }
        self
    }
}

impl<S: Simd, const W: usize> Neg for Wide<S, W> {
    type Output = Self;

    #[inline(always)]
    fn neg(mut self) -> Self {
        self.value = -self.value;
        for i in 0..W {
            self.slopes[i] = self.simd.neg_f64s(self.slopes[i]);
        }
        self
    }
}

impl<S: Simd, const W: usize> Mul<f64> for Wide<S, W> {
    type Output = Self;

    #[inline(always)]
    fn mul(mut self, factor: f64) -> Self {
        let factors = self.simd.splat_f64s(factor);
        self.value *= factor;
        for i in 0..W {
            self.slopes[i] = self.simd.mul_f64s(self.slopes[i], factors);
        }
        self
    }
}

impl<S: Simd, const W: usize> Add<f64> for Wide<S, W> {
    type Output = Self;

    #[inline(always)]
    fn add(mut self, term: f64) -> Self {
        self.value += term;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::Scalar;

    struct Formula;

    impl Kernel<3, 2> for Formula {
        #[inline(always)]
        fn apply<T: Arithmetic>(&self, [x, y, z]: [T; 3]) -> [T; 2] {
            let w = x * y - z * 0.3 + 1.5;
            [w * w + -x, (z - y * x) * w]
        }
    }

    #[test]
    fn formulas_give_the_same_bits_in_wide_registers() {
        let slopes = |of: usize| -> [f64; 8] {
            std::array::from_fn(|i| ((7 * i + 3 * of) % 11) as f64 * 0.37 - 1.3)
        };
        let x = [0.7, 2.3, 1.9].map(|value: f64| {
            Sensitivities::<4>::new(value, &slopes(value.to_bits().count_ones() as usize))
        });
        let found = Sensitivities::through(&Formula, x.each_ref());
        let expected = Formula.apply(x);
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!(found.value.to_bits(), expected.value.to_bits());
            for lane in 0..8 {
                let [found, expected] = [found, expected].map(|x| x.derivative(lane).to_bits());
                assert_eq!(found, expected, "{lane}");
            }
        }
    }
}
