//! The dual active-set iterations of Goldfarb and Idnani (1983), in their notation: `z` is the
//! primal and `-r` the dual step direction of the constraint being added.

use nalgebra::{DMatrix, DVector};

use super::{ActiveConstraint, Constraint, Failure};

/// `normal'y >= right`, in scaled variables and with a normal of length 1.
pub(super) struct Row {
    constraint: Constraint,
    normal: DVector<f64>,
    right: f64,
    /// Length of the normal before it was scaled to 1.
    length: f64,
}

impl Row {
    /// `gradient'x <= right` with `x = units y`.
    pub(super) fn at_most(
        constraint: Constraint,
        gradient: &DVector<f64>,
        right: f64,
        units: &DVector<f64>,
    ) -> Self {
        let scaled = gradient.component_mul(units);
        // An empty row is kept: it is either always or never satisfied.
        let length = if scaled.norm() > 0.0 {
            scaled.norm()
        } else {
            1.0
        };
        Self {
            constraint,
            normal: -scaled / length,
            right: -right / length,
            length,
        }
    }

    fn is_equality(&self) -> bool {
        matches!(self.constraint, Constraint::Equality(_))
    }

    fn slack(&self, y: &DVector<f64>) -> f64 {
        self.normal.dot(y) - self.right
    }

    /// Slack that cannot be told from 0 at `y`.
    fn rounding(&self, y: &DVector<f64>) -> f64 {
        1e-12 * (1.0 + self.right.abs() + y.norm())
    }
}

/// A row held with equality. `sign` is -1 for an equality that is approached from above.
struct Held {
    row: usize,
    sign: f64,
    multiplier: f64,
}

pub(super) struct DualActiveSet<'a> {
    hessian: &'a DMatrix<f64>,
    /// `L` with `H = L L'`.
    factor: &'a DMatrix<f64>,
    rows: &'a [Row],
    y: DVector<f64>,
    held: Vec<Held>,
    /// Orthonormal basis of the held normals times `inv(L)`, one column each.
    basis: Vec<DVector<f64>>,
    /// Their upper triangular coefficients in that basis: `inv(L) N = Q R`, column by column.
    triangle: Vec<DVector<f64>>,
    pub(super) steps: usize,
    steps_max: usize,
}

/// Part of a normal outside the span of the held ones, relative to its length, below which it
/// counts as linearly dependent. Twice orthogonalised, rounding leaves 1e-15.
const DEPENDENT: f64 = 1e-11;

impl<'a> DualActiveSet<'a> {
    pub(super) fn new(
        hessian: &'a DMatrix<f64>,
        factor: &'a DMatrix<f64>,
        rows: &'a [Row],
    ) -> Self {
        Self {
            hessian,
            factor,
            rows,
            y: DVector::zeros(hessian.nrows()),
            held: Vec::new(),
            basis: Vec::new(),
            triangle: Vec::new(),
            steps: 0,
            steps_max: 100 + 10 * (hessian.nrows() + rows.len()),
        }
    }

    /// The minimiser of `y'Hy / 2 + gradient'y` over the rows.
    pub(super) fn minimise(&mut self, gradient: &DVector<f64>) -> Result<DVector<f64>, Failure> {
        self.y = self.back(&self.forth(&-gradient));
        for row in 0..self.rows.len() {
            if self.rows[row].is_equality() {
                self.enforce(row)?;
            }
        }
        while let Some(row) = self.most_violated() {
            self.enforce(row)?;
        }
        self.polish(gradient);
        Ok(self.y.clone())
    }

    /// What is held at the end, in the order of the rows.
    pub(super) fn active_constraints(&self) -> Vec<ActiveConstraint> {
        let mut held: Vec<&Held> = self.held.iter().collect();
        held.sort_by_key(|held| held.row);
        held.into_iter()
            .map(|held| ActiveConstraint {
                constraint: self.rows[held.row].constraint,
                multiplier: held.sign * held.multiplier / self.rows[held.row].length,
            })
            .collect()
    }

    fn most_violated(&self) -> Option<usize> {
        let mut worst = None;
        let mut lowest = 0.0;
        for (index, row) in self.rows.iter().enumerate() {
            let slack = row.slack(&self.y);
            let is_held = self.held.iter().any(|held| held.row == index);
            if slack < lowest && slack < -row.rounding(&self.y) && !is_held {
                (lowest, worst) = (slack, Some(index));
            }
        }
        worst
    }

    /// Adds a violated row, dropping held ones where their multipliers would turn negative.
    fn enforce(&mut self, index: usize) -> Result<(), Failure> {
        let row = &self.rows[index];
        let sign = if row.is_equality() && row.slack(&self.y) > 0.0 {
            -1.0
        } else {
            1.0
        };
        let image = self.forth(&(&row.normal * sign));
        let mut multiplier = 0.0;
        loop {
            self.steps += 1;
            if self.steps > self.steps_max {
                return Err(Failure::StepsExhausted {
                    limit: self.steps_max,
                });
            }
            let slack = sign * row.slack(&self.y);
            let (coefficients, rest) = self.decomposed(&image);
            let dual = self.triangle_solved(&coefficients); // r
            let dependent = rest.norm() <= DEPENDENT * image.norm() || image.norm() <= 0.0;
            if dependent && slack >= -row.rounding(&self.y) {
                return Ok(());
            }
            let full = if dependent {
                f64::INFINITY
            } else {
                -slack / rest.norm_squared()
            };
            let (partial, blocking) = self.first_to_vanish(&dual);
            let length = full.min(partial);
            if length.is_infinite() {
                let violation = -slack * row.length;
                return Err(Failure::Infeasible {
                    constraint: row.constraint,
                    violation,
                });
            }
            if !dependent {
                self.y += self.back(&rest) * length; // z = inv(L') rest
            }
            for (held, r) in self.held.iter_mut().zip(dual.iter()) {
                held.multiplier -= length * r;
            }
            multiplier += length;
            match blocking {
                Some(position) if partial < full => self.drop(position),
                _ => {
                    self.held.push(Held {
                        row: index,
                        sign,
                        multiplier,
                    });
                    self.extend_basis(&coefficients, &rest);
                    return Ok(());
                }
            }
        }
    }

    /// Length of the dual step at which the first held inequality's multiplier reaches 0, and its
    /// position.
    fn first_to_vanish(&self, dual: &DVector<f64>) -> (f64, Option<usize>) {
        let mut first = (f64::INFINITY, None);
        for (position, held) in self.held.iter().enumerate() {
            if dual[position] > 0.0 && !self.rows[held.row].is_equality() {
                let length = (held.multiplier / dual[position]).max(0.0);
                if length < first.0 {
                    first = (length, Some(position));
                }
            }
        }
        first
    }

    fn drop(&mut self, position: usize) {
        self.held.remove(position);
        self.basis.clear();
        self.triangle.clear();
        for index in 0..self.held.len() {
            let held = &self.held[index];
            let image = self.forth(&(&self.rows[held.row].normal * held.sign));
            let (coefficients, rest) = self.decomposed(&image);
            self.extend_basis(&coefficients, &rest);
        }
    }

    fn extend_basis(&mut self, coefficients: &DVector<f64>, rest: &DVector<f64>) {
        let norm = rest.norm();
        let column = coefficients.clone().push(norm);
        self.triangle.push(column);
        self.basis.push(rest / norm);
    }

    /// Coefficients in the basis, and what is left outside its span (Gram-Schmidt, twice).
    fn decomposed(&self, image: &DVector<f64>) -> (DVector<f64>, DVector<f64>) {
        let mut coefficients = DVector::zeros(self.basis.len());
        let mut rest = image.clone();
        for _ in 0..2 {
            for (i, unit) in self.basis.iter().enumerate() {
                let along = unit.dot(&rest);
                coefficients[i] += along;
                rest.axpy(-along, unit, 1.0);
            }
        }
        (coefficients, rest)
    }

    /// `inv(R) right`.
    fn triangle_solved(&self, right: &DVector<f64>) -> DVector<f64> {
        let mut solved = right.clone();
        for i in (0..solved.len()).rev() {
            solved[i] /= self.triangle[i][i];
            for row in 0..i {
                solved[row] -= self.triangle[i][row] * solved[i];
            }
        }
        solved
    }

    /// Solves the optimality conditions of the held rows once more, directly: the steps have
    /// started from an unconstrained minimum that may lie very far away. Kept only where it
    /// leaves every multiplier and every row in order.
    fn polish(&mut self, gradient: &DVector<f64>) {
        let (n, q) = (self.y.len(), self.held.len());
        let mut matrix = DMatrix::zeros(n + q, n + q);
        matrix.view_mut((0, 0), (n, n)).copy_from(self.hessian);
        let mut right = DVector::zeros(n + q);
        right.rows_mut(0, n).copy_from(&-gradient);
        for (position, held) in self.held.iter().enumerate() {
            let row = &self.rows[held.row];
            for i in 0..n {
                matrix[(i, n + position)] = -held.sign * row.normal[i];
                matrix[(n + position, i)] = held.sign * row.normal[i];
            }
            right[n + position] = held.sign * row.right;
        }
        let Some(solved) = matrix.lu().solve(&right) else {
            return;
        };
        let y = solved.rows(0, n).into_owned();
        let multipliers_in_order = self.held.iter().enumerate().all(|(position, held)| {
            solved[n + position] >= 0.0 || self.rows[held.row].is_equality()
        });
        let rows_in_order = self.rows.iter().all(|row| {
            row.is_equality() || row.slack(&y) >= -row.rounding(&y).max(row.rounding(&self.y))
        });
        if multipliers_in_order && rows_in_order && y.iter().all(|a| a.is_finite()) {
            self.y = y;
            for (position, held) in self.held.iter_mut().enumerate() {
                held.multiplier = solved[n + position];
            }
        }
    }

    /// `inv(L) vector`.
    fn forth(&self, vector: &DVector<f64>) -> DVector<f64> {
        self.factor
            .solve_lower_triangular(vector)
            .unwrap_or_else(|| vector.clone())
    }

    /// `inv(L') vector`.
    fn back(&self, vector: &DVector<f64>) -> DVector<f64> {
        self.factor
            .tr_solve_lower_triangular(vector)
            .unwrap_or_else(|| vector.clone())
    }
}
