//! What a solver may ask of a function to be minimised.

use nalgebra::{DMatrix, DVector};

/// Value, gradient and curvature of an objective at one point.
#[derive(Clone, Debug, PartialEq)]
pub struct Expansion {
    /// Objective.
    pub value: f64,
    /// Gradient, length n.
    pub gradient: DVector<f64>,
    /// Symmetric positive semidefinite n x n approximation of the Hessian (Gauss-Newton), or the
    /// Hessian itself.
    pub curvature: DMatrix<f64>,
}

/// A function to be minimised. `None` means that it does not exist at this point: infeasible or
/// not finite.
pub trait Objective: Sync {
    /// Number of unknowns.
    fn dimension(&self) -> usize;
    /// The objective.
    fn value(&self, x: &DVector<f64>) -> Option<f64>;
    /// The objective with its derivatives.
    fn expansion(&self, x: &DVector<f64>) -> Option<Expansion>;
}

/// A box: `lower <= x <= upper`, component by component.
#[derive(Clone, Debug, PartialEq)]
pub struct Bounds {
    /// Lower bounds.
    pub lower: DVector<f64>,
    /// Upper bounds.
    pub upper: DVector<f64>,
}
