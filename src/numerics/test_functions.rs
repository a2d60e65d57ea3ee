//! Functions with published minima, for the tests of every solver here.

use nalgebra::{DMatrix, DVector};

use super::{Bounds, Expansion, Objective};

/// Residuals and their Jacobian.
pub(super) type Residuals = (DVector<f64>, DMatrix<f64>);

/// Half the sum of squares of residuals, with the Gauss-Newton curvature.
pub(super) struct LeastSquares<F> {
    pub(super) dimension: usize,
    /// Residuals and their Jacobian.
    pub(super) residuals: F,
}

impl<F: Fn(&[f64]) -> Residuals + Sync> Objective for LeastSquares<F> {
    fn dimension(&self) -> usize {
        self.dimension
    }

    fn value(&self, x: &DVector<f64>) -> Option<f64> {
        let (r, _) = (self.residuals)(x.as_slice());
        Some(0.5 * r.norm_squared())
    }

    fn expansion(&self, x: &DVector<f64>) -> Option<Expansion> {
        let (r, j) = (self.residuals)(x.as_slice());
        Some(Expansion {
            value: 0.5 * r.norm_squared(),
            gradient: j.transpose() * &r,
            curvature: j.transpose() * &j,
        })
    }
}

/// A function of `N` unknowns with its value, gradient and Hessian; `None` outside its domain.
pub(super) struct Smooth<const N: usize> {
    pub(super) of: fn([f64; N]) -> Option<Derivatives<N>>,
}

pub(super) struct Derivatives<const N: usize> {
    pub(super) value: f64,
    pub(super) gradient: [f64; N],
    pub(super) hessian: [[f64; N]; N],
}

impl<const N: usize> Objective for Smooth<N> {
    fn dimension(&self) -> usize {
        N
    }

    fn value(&self, x: &DVector<f64>) -> Option<f64> {
        (self.of)(std::array::from_fn(|i| x[i])).map(|at| at.value)
    }

    fn expansion(&self, x: &DVector<f64>) -> Option<Expansion> {
        (self.of)(std::array::from_fn(|i| x[i])).map(|at| Expansion {
            value: at.value,
            gradient: DVector::from_fn(N, |i, _| at.gradient[i]),
            curvature: DMatrix::from_fn(N, N, |i, j| at.hessian[i][j]),
        })
    }
}

pub(super) fn bounds(lower: &[f64], upper: &[f64]) -> Bounds {
    Bounds {
        lower: DVector::from_row_slice(lower),
        upper: DVector::from_row_slice(upper),
    }
}

pub(super) fn point(x: &[f64]) -> DVector<f64> {
    DVector::from_row_slice(x)
}

/// Largest difference between the derivatives of `objective` at `x` and central differences of its
/// value and gradient, relative to the size of each.
pub(super) fn derivative_error(objective: &dyn Objective, x: &DVector<f64>) -> (f64, f64) {
    let at = objective.expansion(x).unwrap();
    let n = x.len();
    let (mut gradient, mut hessian) = (DVector::zeros(n), DMatrix::zeros(n, n));
    for i in 0..n {
        // The step balances truncation (h^2) against rounding (1e-16 / h).
        let h = 1e-5 * x[i].abs().max(1.0);
        let (mut ahead, mut behind) = (x.clone(), x.clone());
        ahead[i] += h;
        behind[i] -= h;
        let (ahead, behind) = (
            objective.expansion(&ahead).unwrap(),
            objective.expansion(&behind).unwrap(),
        );
        gradient[i] = (ahead.value - behind.value) / (2.0 * h);
        hessian.set_column(i, &((ahead.gradient - behind.gradient) / (2.0 * h)));
    }
    (
        (&gradient - &at.gradient).amax() / at.gradient.amax().max(1.0),
        (&hessian - &at.curvature).amax() / at.curvature.amax().max(1.0),
    )
}

/// Six-hump camel (Dixon and Szego 1978): six minima in `[-3, 3] x [-2, 2]`.
pub(super) const SIX_HUMP_CAMEL: Smooth<2> = Smooth {
    of: |[x, y]| {
        Some(Derivatives {
            value: (4.0 - 2.1 * x.powi(2) + x.powi(4) / 3.0) * x.powi(2)
                + x * y
                + (-4.0 + 4.0 * y.powi(2)) * y.powi(2),
            gradient: [
                8.0 * x - 8.4 * x.powi(3) + 2.0 * x.powi(5) + y,
                x - 8.0 * y + 16.0 * y.powi(3),
            ],
            hessian: [
                [8.0 - 25.2 * x.powi(2) + 10.0 * x.powi(4), 1.0],
                [1.0, -8.0 + 48.0 * y.powi(2)],
            ],
        })
    },
};

/// Its minima (published to four decimals).
pub(super) const SIX_HUMP_CAMEL_MINIMA: [([f64; 2], f64); 6] = [
    ([0.0898, -0.7126], -1.0316),
    ([-0.0898, 0.7126], -1.0316),
    ([1.7036, -0.7961], -0.2155),
    ([-1.7036, 0.7961], -0.2155),
    ([1.6071, 0.5687], 2.1043),
    ([-1.6071, -0.5687], 2.1043),
];

/// Himmelblau (1972): four minima of value 0 in `[-5, 5]^2`.
pub(super) const HIMMELBLAU: Smooth<2> = Smooth {
    of: |[x, y]| {
        let (a, b) = (x.powi(2) + y - 11.0, x + y.powi(2) - 7.0);
        Some(Derivatives {
            value: a.powi(2) + b.powi(2),
            gradient: [4.0 * a * x + 2.0 * b, 2.0 * a + 4.0 * b * y],
            hessian: [
                [8.0 * x.powi(2) + 4.0 * a + 2.0, 4.0 * (x + y)],
                [4.0 * (x + y), 2.0 + 8.0 * y.powi(2) + 4.0 * b],
            ],
        })
    },
};

/// Its minima (published to six decimals).
pub(super) const HIMMELBLAU_MINIMA: [([f64; 2], f64); 4] = [
    ([3.0, 2.0], 0.0),
    ([-2.805_118, 3.131_312], 0.0),
    ([-3.779_310, -3.283_186], 0.0),
    ([3.584_428, -1.848_126], 0.0),
];

/// Branin (1972): three minima of value `10 / (8 pi)` in `[-5, 10] x [0, 15]`.
pub(super) const BRANIN: Smooth<2> = Smooth {
    of: |[x, y]| {
        let pi = std::f64::consts::PI;
        let (b, c, t) = (5.1 / (4.0 * pi * pi), 5.0 / pi, 1.0 / (8.0 * pi));
        let a = y - b * x.powi(2) + c * x - 6.0;
        let slope = -2.0 * b * x + c;
        Some(Derivatives {
            value: a.powi(2) + 10.0 * (1.0 - t) * x.cos() + 10.0,
            gradient: [2.0 * a * slope - 10.0 * (1.0 - t) * x.sin(), 2.0 * a],
            hessian: [
                [
                    2.0 * slope.powi(2) - 4.0 * a * b - 10.0 * (1.0 - t) * x.cos(),
                    2.0 * slope,
                ],
                [2.0 * slope, 2.0],
            ],
        })
    },
};

/// Its minima: `x = -pi, pi, 3 pi`.
pub(super) const BRANIN_MINIMA: [([f64; 2], f64); 3] = [
    ([-std::f64::consts::PI, 12.275], 0.397_887),
    ([std::f64::consts::PI, 2.275], 0.397_887),
    ([9.424_778, 2.475], 0.397_887),
];

/// Rastrigin (1974) with amplitude 10: one minimum in every unit cell, the lowest at the origin.
pub(super) fn rastrigin<const N: usize>() -> Smooth<N> {
    Smooth {
        of: |x| {
            let turn = 2.0 * std::f64::consts::PI;
            let mut hessian = [[0.0; N]; N];
            for (i, row) in hessian.iter_mut().enumerate() {
                row[i] = 2.0 + 10.0 * turn.powi(2) * (turn * x[i]).cos();
            }
            Some(Derivatives {
                value: x
                    .iter()
                    .map(|x| x.powi(2) + 10.0 - 10.0 * (turn * x).cos())
                    .sum(),
                gradient: x.map(|x| 2.0 * x + 10.0 * turn * (turn * x).sin()),
                hessian,
            })
        },
    }
}
