//! Search directions (step 3 of section 5): eigenvectors of the curvature, and the user's own.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::Options;

/// A direction the caller wants to see followed from every solution.
#[derive(Clone, Debug, PartialEq)]
pub struct UserDirection {
    /// What the records call it.
    pub label: String,
    /// Where it leads.
    pub kind: UserDirectionKind,
}

/// Where a user's direction leads. In the unscaled coordinates of the problem.
#[derive(Clone, Debug, PartialEq)]
pub enum UserDirectionKind {
    /// Along a vector; both ways with [`Options::both_signs`].
    Along(DVector<f64>),
    /// From the solution towards a point.
    Towards(DVector<f64>),
}

/// A direction to be followed: a unit vector in scaled coordinates.
pub(super) struct Direction {
    pub(super) label: String,
    pub(super) unit: DVector<f64>,
}

/// Cosine beyond which two directions are one: an angle of 1e-4.
const SAME_COSINE: f64 = 1.0 - 5e-9;

/// Collects directions and leaves out those that are already there.
pub(super) struct Directions {
    both_signs: bool,
    list: Vec<Direction>,
}

impl Directions {
    pub(super) fn new(options: &Options) -> Self {
        Self {
            both_signs: options.both_signs,
            list: Vec::new(),
        }
    }

    /// Eigenvectors of the symmetric matrix `curvature`, the flattest first; each with the sign
    /// that makes its largest component positive.
    pub(super) fn add_eigenvectors(&mut self, curvature: &DMatrix<f64>) {
        let eigen = SymmetricEigen::new(curvature.clone());
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        for (number, column) in (1..).zip(order) {
            let vector = eigen.eigenvectors.column(column).into_owned();
            let largest = vector[vector.iamax()];
            self.add_line(
                &format!("eigenvector {number}"),
                &(vector * largest.signum()),
            );
        }
    }

    /// Each coordinate by itself.
    pub(super) fn add_coordinates(&mut self, dimension: usize) {
        for i in 0..dimension {
            let vector = DVector::from_fn(dimension, |row, _| if row == i { 1.0 } else { 0.0 });
            self.add_line(&format!("coordinate {}", i + 1), &vector);
        }
    }

    /// A direction and, with both signs, its opposite.
    pub(super) fn add_line(&mut self, name: &str, vector: &DVector<f64>) {
        self.add(format!("{name} +"), vector);
        if self.both_signs {
            self.add(format!("{name} -"), &-vector);
        }
    }

    /// A direction, unless it has no length or is there already.
    pub(super) fn add(&mut self, label: String, vector: &DVector<f64>) {
        let Some(unit) = vector.try_normalize(f64::MIN_POSITIVE) else {
            return;
        };
        let finite = unit.iter().all(|component| component.is_finite());
        if finite
            && !self
                .list
                .iter()
                .any(|known| known.unit.dot(&unit) > SAME_COSINE)
        {
            self.list.push(Direction { label, unit });
        }
    }

    pub(super) fn into_list(self) -> Vec<Direction> {
        self.list
    }
}
