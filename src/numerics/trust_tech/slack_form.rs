//! The slack-variable form (4)-(5) of a constrained problem.
//!
//! With `x = [p, s]` every inequality `h_j(p) <= 0` becomes the equality
//!
//! ```text
//! H_j(x) = h_j(p) + s_j^2 = 0                                                  (4)
//! min f(p)   subject to   H(x) = 0                                             (5)
//! ```
//!
//! The bounds of the box are inequalities like all others. `p` is in scaled coordinates (the box is
//! one unit wide) and every constraint is divided by the typical length of its gradient, so that a
//! slack of 1 means about one width of the box.

use nalgebra::{DMatrix, DVector};

use super::constraints::Constraints;
use crate::numerics::Bounds;

/// Largest `|H_i|` of a point that counts as feasible.
pub(super) const FEASIBLE: f64 = 1e-10;

/// Distance to a constraint, in widths of the box, from which on it holds nothing.
const FREE: f64 = 1e-6;

pub(super) struct SlackForm<'a> {
    constraints: &'a dyn Constraints,
    spans: &'a DVector<f64>,
    /// The box in scaled coordinates.
    pub(super) bounds: &'a Bounds,
    /// One over the typical gradient of each constraint.
    weights: DVector<f64>,
    /// Coordinates with a finite lower bound.
    bounded_below: Vec<usize>,
    /// Coordinates with a finite upper bound.
    bounded_above: Vec<usize>,
}

impl<'a> SlackForm<'a> {
    pub(super) fn new(
        constraints: &'a dyn Constraints,
        spans: &'a DVector<f64>,
        bounds: &'a Bounds,
    ) -> Self {
        let finite = |bound: &DVector<f64>| -> Vec<usize> {
            (0..bound.len()).filter(|&i| bound[i].is_finite()).collect()
        };
        let own = constraints.equalities() + constraints.inequalities();
        let mut form = Self {
            constraints,
            spans,
            bounds,
            weights: DVector::from_element(own, 1.0),
            bounded_below: finite(&bounds.lower),
            bounded_above: finite(&bounds.upper),
        };
        form.weights = form.typical_weights();
        form
    }

    /// `n_p`.
    pub(super) fn parameters(&self) -> usize {
        self.spans.len()
    }

    /// `n_e`.
    pub(super) fn equalities(&self) -> usize {
        self.constraints.equalities()
    }

    /// Constraints of the problem itself, without those of the box.
    pub(super) fn own_constraints(&self) -> usize {
        self.weights.len()
    }

    /// `n_e + n_i`, with the box.
    pub(super) fn constraints(&self) -> usize {
        self.own_constraints() + self.bounded_below.len() + self.bounded_above.len()
    }

    /// `p` of `x = [p, s]`.
    pub(super) fn parameters_of(&self, x: &DVector<f64>) -> DVector<f64> {
        x.rows(0, self.parameters()).into_owned()
    }

    /// `x` with the slacks that `p` needs: `s_j = sqrt(max(-h_j, 0))`.
    pub(super) fn lifted(&self, p: &DVector<f64>) -> Option<DVector<f64>> {
        self.lifted_above(p, 0.0)
    }

    /// The same with no slack below `slack_min`. A slack of 0 stays 0 under (6) and (8), and holds
    /// `p` on its constraint: who wants to leave it has to begin with more.
    pub(super) fn lifted_above(&self, p: &DVector<f64>, slack_min: f64) -> Option<DVector<f64>> {
        let h = self.all_values(p)?;
        let n = self.parameters();
        let slack = |i: usize| {
            (-h[self.equalities() + i - n])
                .max(0.0)
                .sqrt()
                .max(slack_min)
        };
        let length = n + self.constraints() - self.equalities();
        Some(DVector::from_fn(length, |i, _| {
            if i < n { p[i] } else { slack(i) }
        }))
    }

    /// `H(x)` (4).
    pub(super) fn values(&self, x: &DVector<f64>) -> Option<DVector<f64>> {
        let mut h = self.all_values(&self.parameters_of(x))?;
        let (n, fixed) = (self.parameters(), self.equalities());
        for j in fixed..h.len() {
            h[j] += x[n + j - fixed].powi(2); // (4)
        }
        Some(h)
    }

    /// `J_H(x)`: the constraints' Jacobian, and `2 s_j` for the slacks.
    pub(super) fn jacobian(&self, x: &DVector<f64>) -> Option<DMatrix<f64>> {
        let (n, fixed) = (self.parameters(), self.equalities());
        let own = self.own_jacobian(&self.parameters_of(x))?;
        let mut jacobian = DMatrix::zeros(self.constraints(), x.len());
        jacobian.view_mut((0, 0), own.shape()).copy_from(&own);
        let (below, above) = (own.nrows(), own.nrows() + self.bounded_below.len());
        for (row, &i) in self.bounded_below.iter().enumerate() {
            jacobian[(below + row, i)] = -1.0;
        }
        for (row, &i) in self.bounded_above.iter().enumerate() {
            jacobian[(above + row, i)] = 1.0;
        }
        for j in fixed..self.constraints() {
            jacobian[(j, n + j - fixed)] = 2.0 * x[n + j - fixed];
        }
        Some(jacobian)
    }

    /// `h(p)` of the problem's own constraints, weighted.
    pub(super) fn own_values(&self, p: &DVector<f64>) -> Option<DVector<f64>> {
        let h = self.constraints.values(&p.component_mul(self.spans))?;
        h.iter()
            .all(|h| h.is_finite())
            .then(|| h.component_mul(&self.weights))
    }

    /// Whether none of the problem's own constraints holds `p` where it is.
    pub(super) fn is_free_of_own_constraints(&self, p: &DVector<f64>) -> bool {
        let is_slack = |h: &DVector<f64>| h.iter().all(|h| *h < -FREE);
        self.equalities() == 0 && self.own_values(p).as_ref().is_some_and(is_slack)
    }

    /// Its Jacobian with respect to scaled coordinates, weighted.
    pub(super) fn own_jacobian(&self, p: &DVector<f64>) -> Option<DMatrix<f64>> {
        let mut jacobian = self.constraints.jacobian(&p.component_mul(self.spans))?;
        for ((i, j), entry) in indexed(&mut jacobian) {
            *entry *= self.weights[i] * self.spans[j];
        }
        jacobian.iter().all(|a| a.is_finite()).then_some(jacobian)
    }

    /// `sum(lambda_i hessian(h_i))` over the problem's own constraints, by central differences of
    /// their Jacobian; the bounds have no curvature.
    pub(super) fn curvature(&self, p: &DVector<f64>, multipliers: &[f64]) -> Option<DMatrix<f64>> {
        let n = p.len();
        let mut curvature = DMatrix::zeros(n, n);
        if self.own_constraints() == 0 {
            return Some(curvature);
        }
        let multipliers = DVector::from_column_slice(&multipliers[..self.own_constraints()]);
        for i in 0..n {
            // In units of the box; the cube root of rounding balances it against truncation.
            let step = 1e-5;
            let (mut ahead, mut behind) = (p.clone(), p.clone());
            ahead[i] += step;
            behind[i] -= step;
            let change = self.own_jacobian(&ahead)? - self.own_jacobian(&behind)?;
            curvature.set_column(i, &(change.tr_mul(&multipliers) / (2.0 * step)));
        }
        Some((&curvature + curvature.transpose()) * 0.5)
    }

    /// `h(p)` of all constraints: the problem's own, then `lower - p`, then `p - upper`.
    fn all_values(&self, p: &DVector<f64>) -> Option<DVector<f64>> {
        let own = self.own_values(p)?;
        let below = self
            .bounded_below
            .iter()
            .map(|&i| self.bounds.lower[i] - p[i]);
        let above = self
            .bounded_above
            .iter()
            .map(|&i| p[i] - self.bounds.upper[i]);
        let all = own.iter().copied().chain(below).chain(above);
        Some(DVector::from_iterator(self.constraints(), all))
    }

    /// One over the mean gradient length at the centre of the box and half-way to its faces: at a
    /// single point a gradient may happen to vanish.
    fn typical_weights(&self) -> DVector<f64> {
        let n = self.parameters();
        let centre = DVector::from_fn(n, |i, _| {
            let middle = 0.5 * (self.bounds.lower[i] + self.bounds.upper[i]);
            if middle.is_finite() { middle } else { 0.0 }
        });
        let mut total = DVector::zeros(self.own_constraints());
        let mut probes = 0.0;
        for probe in 0..=2 * n {
            let mut p = centre.clone();
            if probe > 0 {
                p[(probe - 1) / 2] += if probe % 2 == 0 { 0.25 } else { -0.25 };
            }
            if let Some(jacobian) = self.own_jacobian(&p) {
                total += DVector::from_fn(total.len(), |i, _| jacobian.row(i).norm());
                probes += 1.0;
            }
        }
        total.map(|length| if length > 0.0 { probes / length } else { 1.0 })
    }
}

fn indexed(matrix: &mut DMatrix<f64>) -> impl Iterator<Item = ((usize, usize), &mut f64)> {
    let rows = matrix.nrows().max(1);
    matrix
        .iter_mut()
        .enumerate()
        .map(move |(k, entry)| ((k % rows, k / rows), entry))
}
