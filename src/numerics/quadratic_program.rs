//! Small convex quadratic programs, by the dual active-set method.
//!
//! ```text
//! minimise   x'Hx / 2 + g'x
//! subject to lower <= x <= upper,   E x = e,   A x <= b
//! ```
//!
//! The method of Goldfarb and Idnani (Mathematical Programming 27, 1983): start from the
//! unconstrained minimum, add the most violated constraint, and drop those whose multiplier
//! would change its sign on the way; the objective rises with every step, so that no set of active
//! constraints comes back. It needs no feasible start and ends by itself when there is none. Made
//! for n up to a dozen and some dozen constraints; O(n^2) per step, all of it dense.
//!
//! Variables are scaled to a unit diagonal of `H`. Where `H` is singular or nearly so (smallest
//! squared pivot below 1e-9), a ridge of 1e-8 (relative to that diagonal) is added, and its effect
//! taken away again by proximal iterations: among several minima one near the origin of the scaled
//! variables results. A problem that falls without limit along an unbounded flat direction is not
//! detected: its solution is merely very large (1e8).

use nalgebra::{Cholesky, DMatrix, DVector};

use super::Bounds;

mod dual_active_set;

use dual_active_set::{DualActiveSet, Row};

/// Rows of linear constraints: `matrix x <= right`, or `= right`.
#[derive(Clone, Debug, PartialEq)]
pub struct LinearConstraints {
    /// One constraint per row.
    pub matrix: DMatrix<f64>,
    /// Right-hand sides.
    pub right: DVector<f64>,
}

impl LinearConstraints {
    /// No constraints on `dimension` unknowns.
    pub fn none(dimension: usize) -> Self {
        Self {
            matrix: DMatrix::zeros(0, dimension),
            right: DVector::zeros(0),
        }
    }
}

/// A quadratic program. Bounds may be infinite.
#[derive(Clone, Debug, PartialEq)]
pub struct QuadraticProgram {
    /// `H`, symmetric and positive semidefinite, n x n.
    pub hessian: DMatrix<f64>,
    /// `g`, length n.
    pub gradient: DVector<f64>,
    /// The box.
    pub bounds: Bounds,
    /// `E x = e`.
    pub equalities: LinearConstraints,
    /// `A x <= b`.
    pub inequalities: LinearConstraints,
}

/// One constraint of a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Constraint {
    /// `x_i >= lower_i`.
    Lower(usize),
    /// `x_i <= upper_i`.
    Upper(usize),
    /// Row of `E x = e`.
    Equality(usize),
    /// Row of `A x <= b`.
    Inequality(usize),
}

/// A constraint that holds with equality at the solution, and its multiplier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ActiveConstraint {
    /// The constraint.
    pub constraint: Constraint,
    /// `mu` in `Hx + g + sum(mu a) = 0`, with `a` the gradient of the constraint written as `<=`
    /// (minus the unit vector for a lower bound). Not negative except for equalities.
    pub multiplier: f64,
}

/// The minimum of a program.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The minimiser.
    pub x: DVector<f64>,
    /// `x'Hx / 2 + g'x`.
    pub value: f64,
    /// Active constraints, in the order of the program: equalities, inequalities, lower bounds,
    /// upper bounds. Of linearly dependent ones a subset.
    pub active: Vec<ActiveConstraint>,
    /// Ridge that was needed, relative to the diagonal of `H`; 0 for a definite `H`.
    pub ridge: f64,
    /// Steps of the active-set method.
    pub steps: usize,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Failure {
    /// No point satisfies all constraints: this one contradicts some of the others.
    Infeasible {
        /// The constraint; of those that contradict each other the one that was added last.
        constraint: Constraint,
        /// By how much it is missed where the others hold, in its own units.
        violation: f64,
    },
    /// `H` has a negative eigenvalue.
    NotConvex,
    /// A number is not finite (other than an infinite bound), or the sizes do not match.
    Malformed,
    /// The method did not end within its limit of steps; only rounding can cause this.
    StepsExhausted {
        /// The limit.
        limit: usize,
    },
}

/// Smallest squared pivot of the scaled `H` (unit diagonal) without a ridge.
const PIVOT_MIN: f64 = 1e-9;
/// Ridge relative to a unit diagonal: the geometric middle between rounding and the curvature.
const RIDGE: f64 = 1e-8;
/// Proximal iterations; each divides the ridge's effect on an eigenvalue c by `1 + c / 1e-8`.
const PROXIMAL_STEPS_MAX: usize = 10;

impl QuadraticProgram {
    /// The minimum.
    ///
    /// # Errors
    ///
    /// See [`Failure`].
    pub fn minimise(&self) -> Result<Solution, Failure> {
        if !self.is_well_formed() {
            return Err(Failure::Malformed);
        }
        let n = self.gradient.len();
        let units = self.units();
        let scaled = DMatrix::from_fn(n, n, |i, j| self.hessian[(i, j)] * units[i] * units[j]);
        let gradient = self.gradient.component_mul(&units);
        let rows = self.rows(&units);
        let (regular, factor, ridge) = factorised(scaled)?;

        let mut method = DualActiveSet::new(&regular, &factor, &rows);
        let mut y = method.minimise(&gradient)?;
        let mut steps = method.steps;
        for _ in 0..PROXIMAL_STEPS_MAX {
            if ridge == 0.0 {
                break;
            }
            method = DualActiveSet::new(&regular, &factor, &rows);
            let next = method.minimise(&(&gradient - &y * ridge))?;
            steps += method.steps;
            let moved = (&next - &y).amax();
            y = next;
            // Rounding of a problem whose unconstrained minimum may be 1e8 away.
            if moved <= 1e-12 * y.amax() {
                break;
            }
        }
        Ok(self.solution(&y, &units, &method, ridge, steps))
    }

    fn solution(
        &self,
        y: &DVector<f64>,
        units: &DVector<f64>,
        method: &DualActiveSet<'_>,
        ridge: f64,
        steps: usize,
    ) -> Solution {
        let active = method.active_constraints();
        let mut x = self.bounds.clamped(&y.component_mul(units));
        for held in &active {
            match held.constraint {
                Constraint::Lower(i) => x[i] = self.bounds.lower[i],
                Constraint::Upper(i) => x[i] = self.bounds.upper[i],
                Constraint::Equality(_) | Constraint::Inequality(_) => {}
            }
        }
        Solution {
            value: 0.5 * (&self.hessian * &x).dot(&x) + self.gradient.dot(&x),
            x,
            active,
            ridge,
            steps,
        }
    }

    /// Length of a scaled unit along each coordinate: curvature 1 where there is any.
    fn units(&self) -> DVector<f64> {
        let spans = self.bounds.spans();
        let root = |i: usize| self.hessian[(i, i)].max(0.0).sqrt();
        let largest = (0..spans.len())
            .map(|i| root(i) * spans[i])
            .fold(0.0, f64::max);
        // A coordinate without curvature is measured by its interval.
        let floor = if largest > 0.0 { 1e-6 * largest } else { 1.0 };
        DVector::from_fn(spans.len(), |i, _| 1.0 / root(i).max(floor / spans[i]))
    }

    /// Every finite constraint as `normal'y >= right` with a normal of length 1.
    fn rows(&self, units: &DVector<f64>) -> Vec<Row> {
        let n = units.len();
        let mut rows = Vec::new();
        for i in 0..self.equalities.right.len() {
            let row = self.equalities.matrix.row(i).transpose();
            let right = self.equalities.right[i];
            rows.push(Row::at_most(Constraint::Equality(i), &row, right, units));
        }
        for i in 0..self.inequalities.right.len() {
            let row = self.inequalities.matrix.row(i).transpose();
            let right = self.inequalities.right[i];
            rows.push(Row::at_most(Constraint::Inequality(i), &row, right, units));
        }
        let along =
            |i: usize, sign: f64| DVector::from_fn(n, |row, _| if row == i { sign } else { 0.0 });
        for i in (0..n).filter(|&i| self.bounds.lower[i].is_finite()) {
            let right = -self.bounds.lower[i];
            rows.push(Row::at_most(
                Constraint::Lower(i),
                &along(i, -1.0),
                right,
                units,
            ));
        }
        for i in (0..n).filter(|&i| self.bounds.upper[i].is_finite()) {
            let right = self.bounds.upper[i];
            rows.push(Row::at_most(
                Constraint::Upper(i),
                &along(i, 1.0),
                right,
                units,
            ));
        }
        rows
    }

    fn is_well_formed(&self) -> bool {
        let n = self.gradient.len();
        let fits = |rows: &LinearConstraints| {
            rows.matrix.shape() == (rows.right.len(), n)
                && rows
                    .matrix
                    .iter()
                    .chain(rows.right.iter())
                    .all(|a| a.is_finite())
        };
        self.hessian.shape() == (n, n)
            && self.bounds.lower.len() == n
            && self.bounds.upper.len() == n
            && self
                .hessian
                .iter()
                .chain(self.gradient.iter())
                .all(|a| a.is_finite())
            && self.bounds.lower.iter().all(|a| *a < f64::INFINITY)
            && self.bounds.upper.iter().all(|a| *a > f64::NEG_INFINITY)
            && fits(&self.equalities)
            && fits(&self.inequalities)
    }
}

/// `H` with the ridge it needs, its lower Cholesky factor, and the ridge.
fn factorised(mut hessian: DMatrix<f64>) -> Result<(DMatrix<f64>, DMatrix<f64>, f64), Failure> {
    let well_conditioned = |factor: &DMatrix<f64>| {
        factor
            .diagonal()
            .iter()
            .all(|pivot| pivot * pivot >= PIVOT_MIN)
    };
    if let Some(factor) = Cholesky::new(hessian.clone()).map(Cholesky::unpack)
        && well_conditioned(&factor)
    {
        return Ok((hessian, factor, 0.0));
    }
    for i in 0..hessian.nrows() {
        hessian[(i, i)] += RIDGE;
    }
    let factor = Cholesky::new(hessian.clone()).ok_or(Failure::NotConvex)?;
    Ok((hessian, factor.unpack(), RIDGE))
}

#[cfg(test)]
mod tests;
