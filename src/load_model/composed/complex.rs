//! Complex numbers as pairs of scalars.

use crate::numerics::Scalar;

/// Sum.
pub(in crate::load_model) fn sum<S: Scalar>(x: [S; 2], y: [S; 2]) -> [S; 2] {
    [x[0] + y[0], x[1] + y[1]]
}

/// Difference.
pub(in crate::load_model) fn difference<S: Scalar>(x: [S; 2], y: [S; 2]) -> [S; 2] {
    [x[0] - y[0], x[1] - y[1]]
}

/// Product.
pub(in crate::load_model) fn product<S: Scalar>(x: [S; 2], y: [S; 2]) -> [S; 2] {
    [x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]]
}

/// Complex conjugate.
pub(in crate::load_model) fn conjugate<S: Scalar>(x: [S; 2]) -> [S; 2] {
    [x[0], -x[1]]
}

/// Square of the modulus.
pub(in crate::load_model) fn square<S: Scalar>(x: [S; 2]) -> S {
    x[0] * x[0] + x[1] * x[1]
}

/// `Re(x conj y)`.
pub(in crate::load_model) fn dot<S: Scalar>(x: [S; 2], y: [S; 2]) -> S {
    x[0] * y[0] + x[1] * y[1]
}

/// Reciprocal.
pub(in crate::load_model) fn inverse<S: Scalar>(x: [S; 2]) -> [S; 2] {
    let scale = S::constant(1.0) / square(x);
    [x[0] * scale, -(x[1] * scale)]
}

/// Quotient.
pub(in crate::load_model) fn quotient<S: Scalar>(x: [S; 2], y: [S; 2]) -> [S; 2] {
    let scale = S::constant(1.0) / square(y);
    product(x, conjugate(y)).map(|part| part * scale)
}

/// Modulus, with a finite slope at 0; exact from 1e-7 on.
pub(in crate::load_model) fn modulus<S: Scalar>(x: [S; 2]) -> S {
    (square(x) + 1e-30).sqrt()
}
