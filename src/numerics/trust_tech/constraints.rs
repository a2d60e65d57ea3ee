//! Constraints beyond a box.

use nalgebra::{DMatrix, DVector};

/// `h_i(p) = 0` for the first [`equalities`](Self::equalities) components, `h_j(p) <= 0` for the
/// others: the constraints of (3). Twice differentiable; cheap next to the objective.
pub trait Constraints: Sync {
    /// Number of equality constraints, `n_e`.
    fn equalities(&self) -> usize;
    /// Number of inequality constraints, `n_i`.
    fn inequalities(&self) -> usize;
    /// `h(p)`, length `n_e + n_i`; none where it does not exist.
    fn values(&self, p: &DVector<f64>) -> Option<DVector<f64>>;
    /// Its Jacobian, `(n_e + n_i) x n`; none where it does not exist.
    fn jacobian(&self, p: &DVector<f64>) -> Option<DMatrix<f64>>;
}

/// No constraints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unconstrained;

impl Constraints for Unconstrained {
    fn equalities(&self) -> usize {
        0
    }

    fn inequalities(&self) -> usize {
        0
    }

    fn values(&self, _p: &DVector<f64>) -> Option<DVector<f64>> {
        Some(DVector::zeros(0))
    }

    fn jacobian(&self, p: &DVector<f64>) -> Option<DMatrix<f64>> {
        Some(DMatrix::zeros(0, p.len()))
    }
}
