//! Inner products of long columns, several sums side by side.
//!
//! The order of summation is fixed, so that the result does not depend on the instruction set.

use nalgebra::DMatrix;
use pulp::Arch;

/// Partial sums of one product.
const LANES: usize = 16;

/// `A' A`.
#[must_use]
pub fn gram(a: &DMatrix<f64>) -> DMatrix<f64> {
    let count = a.ncols();
    let mut products = DMatrix::zeros(count, count);
    Arch::new().dispatch(|| {
        for j in 0..count {
            for i in 0..=j {
                products[(i, j)] = dot(column(a, i), column(a, j));
            }
        }
    });
    products.fill_lower_triangle_with_upper_triangle();
    products
}

/// `A' B`; the matrices have as many rows.
#[must_use]
pub fn cross(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut products = DMatrix::zeros(a.ncols(), b.ncols());
    Arch::new().dispatch(|| {
        for j in 0..b.ncols() {
            for i in 0..a.ncols() {
                products[(i, j)] = dot(column(a, i), column(b, j));
            }
        }
    });
    products
}

#[inline]
fn column(a: &DMatrix<f64>, index: usize) -> &[f64] {
    let rows = a.nrows();
    a.as_slice()
        .get(index * rows..(index + 1) * rows)
        .unwrap_or(&[])
}

#[allow(
    clippy::inline_always,
    reason = "compiled for the instruction set of its caller"
)]
#[inline(always)]
fn dot(x: &[f64], y: &[f64]) -> f64 {
    let mut sums = [0.0; LANES];
    let (xs, ys) = (x.chunks_exact(LANES), y.chunks_exact(LANES));
    let rest: f64 = xs
        .remainder()
        .iter()
        .zip(ys.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in xs.zip(ys) {
        for lane in 0..LANES {
            sums[lane] += x[lane] * y[lane];
        }
    }
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_are_those_of_the_matrices() {
        let a = DMatrix::from_fn(53, 4, |i, j| ((i * 7 + j * 3) % 11) as f64 - 4.5);
        let b = DMatrix::from_fn(53, 3, |i, j| ((i * 5 + j) % 13) as f64 * 0.25);
        assert!((gram(&a) - a.transpose() * &a).amax() < 1e-10);
        assert!((cross(&a, &b) - a.transpose() * &b).amax() < 1e-10);
        assert_eq!(cross(&a, &a), gram(&a));
    }
}
