//! The linear coefficients of a joint problem at one point of the outer unknowns.

use nalgebra::{DMatrix, DVector, SMatrix, SVector};

use super::{JointProblem, LINEAR, OUTER, PAPER_MOTOR_SHARE_MIN};
use crate::{
    identification::gram::{Gram, Y},
    numerics::{
        Bounds,
        quadratic_program::{LinearConstraints, QuadraticProgram},
    },
};

/// Matrix and right-hand side of the linear coefficients.
pub(super) type LinearMatrix = SMatrix<f64, LINEAR, LINEAR>;
pub(super) type LinearVector = SVector<f64, LINEAR>;
/// Smallest squared pivot of the linear system, its diagonal scaled to one, that needs no ridge: as in
/// [`QuadraticProgram`].
const DETERMINED: f64 = 1e-9;
/// Rounds of mending after which the general method takes over: of those that end, nearly all end in three.
const ROUNDS_MAX: usize = 8;

impl JointProblem<'_> {
    pub(super) fn prior(&self) -> ([f64; LINEAR], [f64; LINEAR]) {
        let precision = 1.0 / self.options.static_prior_deviation.powi(2);
        let mut weights = [precision; LINEAR];
        weights[0] = 0.0; // the motor share has bounds and no prior
        let middles = [0.0, 0.2, 0.2, 0.2, 0.0];
        (weights, middles)
    }

    pub(super) fn linear_system(&self, sum: &Gram) -> (LinearMatrix, LinearVector) {
        let (weights, middles) = self.prior();
        let h = LinearMatrix::from_fn(|i, j| {
            sum[(OUTER + i, OUTER + j)] + if i == j { weights[i] } else { 0.0 }
        });
        let g = LinearVector::from_fn(|i, _| -sum[(OUTER + i, Y)] - weights[i] * middles[i]);
        (h, g)
    }

    pub(super) fn linear_optimum(
        &self,
        h: &LinearMatrix,
        g: &LinearVector,
    ) -> Option<[f64; LINEAR]> {
        if let Some(optimum) = self.boxed_optimum(h, g) {
            return Some(optimum);
        }
        let mut lower = DVector::from_column_slice(&self.options.linear_lower);
        if self.options.static_shares.is_some() {
            lower[0] = lower[0].max(PAPER_MOTOR_SHARE_MIN);
        }
        let program = QuadraticProgram {
            hessian: DMatrix::from_column_slice(LINEAR, LINEAR, h.as_slice()),
            gradient: DVector::from_column_slice(g.as_slice()),
            bounds: Bounds {
                lower,
                upper: DVector::from_column_slice(&self.options.linear_upper),
            },
            equalities: LinearConstraints::none(LINEAR),
            inequalities: self.share_limits(),
        };
        // Fails only where the simulation was not finite.
        let x = program.minimise().ok()?.x;
        let mut beta = [0.0; LINEAR];
        beta.copy_from_slice(x.as_slice());
        Some(beta)
    }

    /// The minimum under the bounds alone, where it is well determined: by guessing which coefficients lie on
    /// which bound and mending the guess by the signs of the multipliers (a primal-dual active set). Where that ends it
    /// has the minimum, as the program is convex; it is many times cheaper than the general method, which
    /// is left with what does not end in a few rounds.
    fn boxed_optimum(&self, h: &LinearMatrix, g: &LinearVector) -> Option<[f64; LINEAR]> {
        if self.options.static_shares.is_some() {
            return None;
        }
        let units = LinearVector::from_fn(|i, _| 1.0 / h[(i, i)].sqrt());
        let scaled = LinearMatrix::from_fn(|i, j| h[(i, j)] * units[i] * units[j]);
        let gradient = g.component_mul(&units);
        let bound = |i: usize, of: &[f64; LINEAR]| of[i] / units[i];
        let (lower, upper) = (&self.options.linear_lower, &self.options.linear_upper);
        let mut held: [Option<f64>; LINEAR] = [None; LINEAR];
        for _ in 0..ROUNDS_MAX {
            let x = minimum_with_held(&scaled, &gradient, &held)?;
            let slope = scaled * x + gradient;
            let mended: [Option<f64>; LINEAR] = std::array::from_fn(|i| {
                let (low, high) = (bound(i, lower), bound(i, upper));
                match held[i] {
                    Some(at) if at <= low => (slope[i] >= 0.0).then_some(low),
                    Some(_) => (slope[i] <= 0.0).then_some(high),
                    None if x[i] < low => Some(low),
                    None => (x[i] > high).then_some(high),
                }
            });
            if mended == held {
                return Some(std::array::from_fn(|i| match held[i] {
                    Some(at) if at <= bound(i, lower) => lower[i],
                    Some(_) => upper[i],
                    None => x[i] * units[i],
                }));
            }
            held = mended;
        }
        None
    }

    /// The box (14) of `P_Z` and `P_P` in the linear coefficients: with `P_ZIP0 = 1 - Kpm`, both
    /// `c_z` and `1 - Kpm - c_z - c_i` lie between `low P_ZIP0` and `high P_ZIP0`.
    pub(in crate::identification) fn share_limits(&self) -> LinearConstraints {
        let Some((low, high)) = self.options.static_shares else {
            return LinearConstraints::none(LINEAR);
        };
        #[rustfmt::skip]
        let rows = [
            -low, -1.0,  0.0, 0.0, 0.0, // low (1 - K) <= c_z
            high,  1.0,  0.0, 0.0, 0.0, // c_z <= high (1 - K)
            1.0 - low, 1.0, 1.0, 0.0, 0.0, // low (1 - K) <= c_p
            high - 1.0, -1.0, -1.0, 0.0, 0.0, // c_p <= high (1 - K)
        ];
        LinearConstraints {
            matrix: DMatrix::from_row_slice(4, LINEAR, &rows),
            right: DVector::from_vec(vec![-low, high, 1.0 - low, high - 1.0]),
        }
    }

    /// Rows of the bounds and limits that hold with equality at `beta`.
    pub(super) fn active_rows(
        &self,
        beta: &[f64; LINEAR],
        at_bound: [bool; LINEAR],
    ) -> DMatrix<f64> {
        let limits = self.share_limits();
        let x = DVector::from_column_slice(beta);
        let mut rows: Vec<[f64; LINEAR]> = (0..LINEAR)
            .filter(|&i| at_bound[i])
            .map(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }))
            .collect();
        for (row, right) in limits.matrix.row_iter().zip(limits.right.iter()) {
            if (row * &x)[0] >= right - 1e-9 {
                rows.push(std::array::from_fn(|j| row[j]));
            }
        }
        DMatrix::from_fn(rows.len(), LINEAR, |i, j| rows[i][j])
    }

    pub(super) fn objective(
        &self,
        sum: &Gram,
        h: &LinearMatrix,
        g: &LinearVector,
        beta: &[f64; LINEAR],
    ) -> f64 {
        let x = LinearVector::from(*beta);
        let (weights, middles) = self.prior();
        let prior: f64 = weights.iter().zip(middles).map(|(w, m)| w * m * m).sum();
        0.5 * (sum[(Y, Y)] + prior) + 0.5 * (h * x).dot(&x) + g.dot(&x)
    }
}

/// Minimum of `x'Hx / 2 + g'x` with some of the unknowns held; none where it is not well determined.
fn minimum_with_held(
    h: &LinearMatrix,
    g: &LinearVector,
    held: &[Option<f64>; LINEAR],
) -> Option<LinearVector> {
    let fixed = LinearVector::from_fn(|i, _| held[i].unwrap_or(0.0));
    let pull = h * fixed + g;
    let (mut matrix, mut right) = (*h, -pull);
    for i in (0..LINEAR).filter(|&i| held[i].is_some()) {
        matrix.row_mut(i).fill(0.0);
        matrix.column_mut(i).fill(0.0);
        matrix[(i, i)] = 1.0;
        right[i] = fixed[i];
    }
    let factor = matrix.cholesky()?;
    let pivots = factor.l_dirty().diagonal();
    let determined = pivots.iter().all(|pivot| pivot * pivot >= DETERMINED);
    determined.then(|| factor.solve(&right))
}

/// Orthonormal basis of the vectors that every row maps to zero.
pub(super) fn null_space(rows: &DMatrix<f64>) -> DMatrix<f64> {
    let eigen = (rows.transpose() * rows).symmetric_eigen();
    // The rows have entries of order one: an eigenvalue is either that or rounding.
    let columns: Vec<_> = (0..LINEAR)
        .filter(|&i| eigen.eigenvalues[i] < 1e-9)
        .map(|i| eigen.eigenvectors.column(i).into_owned())
        .collect();
    DMatrix::from_fn(LINEAR, columns.len(), |i, j| columns[j][i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::joint_problem::ProblemOptions;

    #[test]
    fn the_optimum_under_the_box_is_that_of_the_general_method() {
        let problem = JointProblem::new(&[], ProblemOptions::default(), &|| false);
        let (mut state, mut on_bounds, mut ended) = (1_u64, 0, 0);
        let mut draw = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 11) as f64 / (1_u64 << 53) as f64 * 2.0 - 1.0
        };
        for _ in 0..300 {
            let root = LinearMatrix::from_fn(|_, _| draw());
            let h = root * root.transpose() * 1e4 + LinearMatrix::identity();
            let x = LinearVector::from_fn(|_, _| 3.0 * draw());
            let g = -(h * x);
            let Some(boxed) = problem.boxed_optimum(&h, &g) else {
                continue;
            };
            ended += 1;
            let program = QuadraticProgram {
                hessian: DMatrix::from_column_slice(LINEAR, LINEAR, h.as_slice()),
                gradient: DVector::from_column_slice(g.as_slice()),
                bounds: Bounds {
                    lower: DVector::from_column_slice(&problem.options.linear_lower),
                    upper: DVector::from_column_slice(&problem.options.linear_upper),
                },
                equalities: LinearConstraints::none(LINEAR),
                inequalities: LinearConstraints::none(LINEAR),
            };
            let general = program.minimise().unwrap();
            on_bounds += general.active.len();
            for (a, b) in boxed.iter().zip(general.x.iter()) {
                assert!((a - b).abs() < 1e-8, "{boxed:?} {general:?}");
            }
        }
        assert!(ended > 270 && on_bounds > 300, "{ended} {on_bounds}");
    }
}
