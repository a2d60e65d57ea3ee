//! Complex numbers as pairs of scalars.

#![allow(
    clippy::inline_always,
    reason = "compiled as part of the simulation that calls it"
)]

use crate::numerics::{Arithmetic, Scalar};

/// Sum.
#[inline(always)]
pub(in crate::load_model) fn sum<S: Arithmetic>(x: [S; 2], y: [S; 2]) -> [S; 2] {
    [x[0] + y[0], x[1] + y[1]]
}

/// Difference.
#[inline(always)]
pub(in crate::load_model) fn difference<S: Arithmetic>(x: [S; 2], y: [S; 2]) -> [S; 2] {
    [x[0] - y[0], x[1] - y[1]]
}

/// Product.
#[inline(always)]
pub(in crate::load_model) fn product<S: Arithmetic>(x: [S; 2], y: [S; 2]) -> [S; 2] {
    [x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]]
}

/// Multiple.
#[inline(always)]
pub(in crate::load_model) fn scaled<S: Arithmetic>(x: [S; 2], by: S) -> [S; 2] {
    [x[0] * by, x[1] * by]
}

/// A constant.
#[inline(always)]
pub(in crate::load_model) fn constant<S: Scalar>(x: [f64; 2]) -> [S; 2] {
    [S::constant(x[0]), S::constant(x[1])]
}

/// Complex conjugate.
#[inline(always)]
pub(in crate::load_model) fn conjugate<S: Arithmetic>(x: [S; 2]) -> [S; 2] {
    [x[0], -x[1]]
}

/// Square of the modulus.
#[inline(always)]
pub(in crate::load_model) fn square<S: Arithmetic>(x: [S; 2]) -> S {
    x[0] * x[0] + x[1] * x[1]
}

/// `Re(x conj y)`.
#[inline(always)]
pub(in crate::load_model) fn dot<S: Arithmetic>(x: [S; 2], y: [S; 2]) -> S {
    x[0] * y[0] + x[1] * y[1]
}

/// Reciprocal.
#[inline(always)]
pub(in crate::load_model) fn inverse<S: Scalar>(x: [S; 2]) -> [S; 2] {
    let scale = S::constant(1.0) / square(x);
    [x[0] * scale, -(x[1] * scale)]
}

/// Quotient.
#[inline(always)]
pub(in crate::load_model) fn quotient<S: Scalar>(x: [S; 2], y: [S; 2]) -> [S; 2] {
    let scale = S::constant(1.0) / square(y);
    let [re, im] = product(x, conjugate(y));
    [re * scale, im * scale]
}

/// Modulus, with a finite slope at 0; exact from 1e-7 on.
#[inline(always)]
pub(in crate::load_model) fn modulus<S: Scalar>(x: [S; 2]) -> S {
    (square(x) + 1e-30).sqrt()
}
