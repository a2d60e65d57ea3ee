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
    pub(super) kind: DirectionKind,
}

/// Which of the two dynamical systems a direction belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DirectionKind {
    /// The projected gradient system: within a feasible component (phase II).
    Gradient,
    /// The quotient gradient system: from one feasible component to another (phase I).
    Quotient,
}

/// Cosine beyond which two directions are one: an angle of 1e-4.
const SAME_COSINE: f64 = 1.0 - 5e-9;

/// Collects directions and leaves out those that are already there.
pub(super) struct Directions {
    both_signs: bool,
    kind: DirectionKind,
    list: Vec<Direction>,
}

impl Directions {
    pub(super) fn new(options: &Options) -> Self {
        Self {
            both_signs: options.both_signs,
            kind: DirectionKind::Gradient,
            list: Vec::new(),
        }
    }

    /// The kind of the directions that are added from now on.
    pub(super) fn set_kind(&mut self, kind: DirectionKind) {
        self.kind = kind;
    }

    /// Eigenvectors of the symmetric matrix `curvature`, the flattest first; each with the sign
    /// that makes its largest component positive.
    pub(super) fn add_eigenvectors(&mut self, curvature: &DMatrix<f64>) {
        let everything = DMatrix::identity(curvature.nrows(), curvature.nrows());
        self.add_eigenvectors_within(curvature, &everything);
    }

    /// The same for a matrix that acts on the columns of `basis`.
    pub(super) fn add_eigenvectors_within(
        &mut self,
        curvature: &DMatrix<f64>,
        basis: &DMatrix<f64>,
    ) {
        let eigen = SymmetricEigen::new(curvature.clone());
        let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        for (number, column) in (1..).zip(order) {
            let vector = basis * eigen.eigenvectors.column(column);
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
        let is_known =
            |known: &Direction| known.kind == self.kind && known.unit.dot(&unit) > SAME_COSINE;
        if unit.iter().all(|component| component.is_finite()) && !self.list.iter().any(is_known) {
            let kind = self.kind;
            let label = match kind {
                DirectionKind::Gradient => label,
                DirectionKind::Quotient => format!("component {label}"),
            };
            self.list.push(Direction { label, unit, kind });
        }
    }

    pub(super) fn into_list(self) -> Vec<Direction> {
        self.list
    }
}
