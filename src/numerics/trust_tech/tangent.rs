//! The tangent space of the constraint surface `H(x) = 0`, and the projection onto it.

use nalgebra::{DMatrix, DVector};

/// Tangent space at a point: the null space of `J_H`.
pub(super) struct Tangent {
    dimension: usize,
    /// Orthonormal basis of the rows of `J_H` (the normal space).
    normals: Vec<DVector<f64>>,
    /// Rows of `J_H` that are linearly independent of those before them, and their coefficients
    /// in that basis.
    rows: Vec<(usize, DVector<f64>)>,
    constraints: usize,
}

/// Part of a row outside the span of those before it below which it counts as dependent, relative
/// to its length and to the longest row.
const DEPENDENT: f64 = 1e-9;

impl Tangent {
    pub(super) fn new(jacobian: &DMatrix<f64>) -> Self {
        let longest = jacobian
            .row_iter()
            .map(|row| row.norm())
            .fold(0.0, f64::max);
        let mut tangent = Self {
            dimension: jacobian.ncols(),
            normals: Vec::new(),
            rows: Vec::new(),
            constraints: jacobian.nrows(),
        };
        for i in 0..jacobian.nrows() {
            let row = jacobian.row(i).transpose();
            let (coefficients, rest) = tangent.decomposed(&row);
            let length = rest.norm();
            if length > DEPENDENT * row.norm().max(longest) {
                tangent.normals.push(rest / length);
                tangent.rows.push((i, coefficients.push(length)));
            }
        }
        tangent
    }

    /// `P_H v` with `P_H = I - J'inv(JJ')J` (8).
    pub(super) fn project(&self, vector: &DVector<f64>) -> DVector<f64> {
        self.decomposed(vector).1
    }

    /// `lambda` that brings `gradient + J'lambda` nearest to 0; 0 for dependent constraints.
    pub(super) fn multipliers(&self, gradient: &DVector<f64>) -> Vec<f64> {
        let mut right = -self.decomposed(gradient).0;
        let mut multipliers = vec![0.0; self.constraints];
        for k in (0..self.rows.len()).rev() {
            let (row, column) = &self.rows[k];
            let lambda = right[k] / column[k];
            multipliers[*row] = lambda;
            for i in 0..k {
                right[i] -= column[i] * lambda;
            }
        }
        multipliers
    }

    /// `P_H B P_H`.
    pub(super) fn project_matrix(&self, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        let mut projected = matrix.clone();
        for _ in 0..2 {
            for j in 0..projected.ncols() {
                let column = self.project(&projected.column(j).into_owned());
                projected.set_column(j, &column);
            }
            projected.transpose_mut();
        }
        projected
    }

    /// An orthonormal basis of the tangent space: unit vectors, the one farthest from what is
    /// already spanned first.
    pub(super) fn basis(&self) -> Vec<DVector<f64>> {
        let mut spanned = Self {
            dimension: self.dimension,
            normals: self.normals.clone(),
            rows: Vec::new(),
            constraints: 0,
        };
        while spanned.normals.len() < self.dimension {
            let rests = (0..self.dimension).map(|i| {
                let unit = DVector::from_fn(self.dimension, |row, _| f64::from(u8::from(row == i)));
                spanned.project(&unit)
            });
            let farthest = rests.reduce(|best, next| {
                if next.norm() > best.norm() {
                    next
                } else {
                    best
                }
            });
            let Some(unit) = farthest.and_then(|rest| rest.try_normalize(DEPENDENT)) else {
                break;
            };
            spanned.normals.push(unit);
        }
        spanned.normals.split_off(self.normals.len())
    }

    /// Coefficients in the basis of the normals, and the rest (Gram-Schmidt, twice).
    fn decomposed(&self, vector: &DVector<f64>) -> (DVector<f64>, DVector<f64>) {
        let mut coefficients = DVector::zeros(self.normals.len());
        let mut rest = vector.clone();
        for _ in 0..2 {
            for (i, normal) in self.normals.iter().enumerate() {
                let along = normal.dot(&rest);
                coefficients[i] += along;
                rest.axpy(-along, normal, 1.0);
            }
        }
        (coefficients, rest)
    }
}
