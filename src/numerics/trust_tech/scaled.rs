//! Coordinates in which the box is one unit wide.

use nalgebra::{DMatrix, DVector};

use crate::numerics::{Bounds, Expansion, LocalSolution, Objective};

/// The objective in coordinates `u = x / span`.
pub(super) struct Scaled<'a> {
    pub(super) objective: &'a dyn Objective,
    pub(super) spans: DVector<f64>,
}

impl<'a> Scaled<'a> {
    pub(super) fn new(objective: &'a dyn Objective, bounds: &Bounds) -> Self {
        Self {
            objective,
            spans: bounds.spans(),
        }
    }

    /// The box in scaled coordinates.
    pub(super) fn unit_bounds(&self, bounds: &Bounds) -> Bounds {
        Bounds {
            lower: bounds.lower.component_div(&self.spans),
            upper: bounds.upper.component_div(&self.spans),
        }
    }

    /// A solution in scaled coordinates, in the caller's.
    pub(super) fn unscaled(&self, solution: &LocalSolution, bounds: &Bounds) -> LocalSolution {
        LocalSolution {
            x: bounds.snapped(&solution.x.component_mul(&self.spans)),
            gradient: solution.gradient.component_div(&self.spans),
            curvature: DMatrix::from_fn(self.spans.len(), self.spans.len(), |i, j| {
                solution.curvature[(i, j)] / (self.spans[i] * self.spans[j])
            }),
            ..solution.clone()
        }
    }

    pub(super) fn scaled_curvature(&self, curvature: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(curvature.nrows(), curvature.ncols(), |i, j| {
            curvature[(i, j)] * self.spans[i] * self.spans[j]
        })
    }
}

impl Objective for Scaled<'_> {
    fn dimension(&self) -> usize {
        self.objective.dimension()
    }

    fn value(&self, u: &DVector<f64>) -> Option<f64> {
        self.objective.value(&u.component_mul(&self.spans))
    }

    fn values(&self, points: &[DVector<f64>]) -> Vec<Option<f64>> {
        let points: Vec<_> = (points.iter())
            .map(|u| u.component_mul(&self.spans))
            .collect();
        self.objective.values(&points)
    }

    fn expansion(&self, u: &DVector<f64>) -> Option<Expansion> {
        Some(self.scaled(&self.objective.expansion(&u.component_mul(&self.spans))?))
    }

    fn expansions(&self, points: &[DVector<f64>]) -> Vec<Option<Expansion>> {
        let points: Vec<_> = (points.iter())
            .map(|u| u.component_mul(&self.spans))
            .collect();
        let expansions = self.objective.expansions(&points).into_iter();
        expansions.map(|at| Some(self.scaled(&at?))).collect()
    }
}

impl Scaled<'_> {
    fn scaled(&self, at: &Expansion) -> Expansion {
        Expansion {
            value: at.value,
            gradient: at.gradient.component_mul(&self.spans),
            curvature: self.scaled_curvature(&at.curvature),
        }
    }
}
