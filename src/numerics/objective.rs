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
    /// The objective at several points, each as [`value`](Self::value) would give it to within the
    /// rounding that the implementation documents; one that can evaluate points side by side does so
    /// here.
    fn values(&self, points: &[DVector<f64>]) -> Vec<Option<f64>> {
        points.iter().map(|x| self.value(x)).collect()
    }
    /// The objective with its derivatives.
    fn expansion(&self, x: &DVector<f64>) -> Option<Expansion>;
    /// The objective with its derivatives at several points, as [`values`](Self::values).
    fn expansions(&self, points: &[DVector<f64>]) -> Vec<Option<Expansion>> {
        points.iter().map(|x| self.expansion(x)).collect()
    }
}

/// A box: `lower <= x <= upper`, component by component.
#[derive(Clone, Debug, PartialEq)]
pub struct Bounds {
    /// Lower bounds.
    pub lower: DVector<f64>,
    /// Upper bounds.
    pub upper: DVector<f64>,
}

impl Bounds {
    /// Number of components.
    pub fn dimension(&self) -> usize {
        self.lower.len()
    }

    /// The point of the box nearest to `x`, component by component.
    pub fn clamped(&self, x: &DVector<f64>) -> DVector<f64> {
        DVector::from_fn(x.len(), |i, _| self.clamp(i, x[i]))
    }

    /// The same, and a component within rounding of a bound (1e-15 of the span) put on it, so
    /// that being on a bound can be asked with `<=`.
    pub(super) fn snapped(&self, x: &DVector<f64>) -> DVector<f64> {
        let spans = self.spans();
        DVector::from_fn(x.len(), |i, _| {
            let rounding = 1e-15 * spans[i].max(x[i].abs());
            if x[i] <= self.lower[i] + rounding {
                self.lower[i]
            } else if x[i] >= self.upper[i] - rounding {
                self.upper[i]
            } else {
                x[i]
            }
        })
    }

    /// Component `i` moved into its interval.
    pub fn clamp(&self, i: usize, value: f64) -> f64 {
        value.min(self.upper[i]).max(self.lower[i])
    }

    /// Whether every component lies within its interval.
    pub fn contains(&self, x: &DVector<f64>) -> bool {
        (0..x.len()).all(|i| self.lower[i] <= x[i] && x[i] <= self.upper[i])
    }

    /// What counts as a long way along each coordinate: the width of its interval, and 1 where the
    /// interval is unbounded or a single point.
    pub fn spans(&self) -> DVector<f64> {
        (&self.upper - &self.lower).map(|width| {
            if width.is_finite() && width > 0.0 {
                width
            } else {
                1.0
            }
        })
    }
}

/// What a solver cost, in calls of the objective and in steps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cost {
    /// Calls of [`Objective::value`].
    pub values: u64,
    /// Calls of [`Objective::expansion`].
    pub expansions: u64,
    /// Steps that were taken.
    pub steps_accepted: u64,
    /// Steps that were tried and not taken.
    pub steps_rejected: u64,
}

impl Cost {
    /// Calls of the objective, with or without derivatives.
    pub fn evaluations(&self) -> u64 {
        self.values + self.expansions
    }
}

impl std::ops::AddAssign for Cost {
    fn add_assign(&mut self, other: Self) {
        self.values += other.values;
        self.expansions += other.expansions;
        self.steps_accepted += other.steps_accepted;
        self.steps_rejected += other.steps_rejected;
    }
}

/// A setting outside its range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutOfRange {
    /// Name of the setting.
    pub field: &'static str,
    /// Its value.
    pub value: f64,
    /// What is allowed.
    pub allowed: &'static str,
}

impl OutOfRange {
    pub(super) fn check(
        field: &'static str,
        value: f64,
        is_allowed: bool,
        allowed: &'static str,
    ) -> Result<(), Self> {
        if is_allowed {
            Ok(())
        } else {
            Err(Self {
                field,
                value,
                allowed,
            })
        }
    }
}

impl std::fmt::Display for OutOfRange {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            field,
            value,
            allowed,
        } = self;
        write!(formatter, "{field} = {value} is out of range: {allowed}")
    }
}

impl std::error::Error for OutOfRange {}

/// An objective that counts its calls and answers only with finite numbers.
pub(super) struct Counted<'a> {
    objective: &'a dyn Objective,
    /// Calls and steps so far.
    pub(super) cost: Cost,
}

impl<'a> Counted<'a> {
    pub(super) fn new(objective: &'a dyn Objective) -> Self {
        Self {
            objective,
            cost: Cost::default(),
        }
    }

    /// The objective, if it exists at `x` and is finite.
    pub(super) fn value(&mut self, x: &DVector<f64>) -> Option<f64> {
        self.cost.values += 1;
        self.objective.value(x).filter(|value| value.is_finite())
    }

    /// The objective at several points, as [`value`](Self::value).
    pub(super) fn values(&mut self, points: &[DVector<f64>]) -> Vec<Option<f64>> {
        self.cost.values += points.len() as u64;
        let mut values = self.objective.values(points);
        for value in &mut values {
            *value = value.filter(|value| value.is_finite());
        }
        values
    }

    /// The objective with its derivatives, if all of them are finite.
    pub(super) fn expansion(&mut self, x: &DVector<f64>) -> Option<Expansion> {
        self.cost.expansions += 1;
        finite_expansion(self.objective.expansion(x))
    }
}

/// An expansion, if all of its numbers are finite.
pub(super) fn finite_expansion(expansion: Option<Expansion>) -> Option<Expansion> {
    expansion.filter(|at| {
        at.value.is_finite()
            && at.gradient.iter().all(|g| g.is_finite())
            && at.curvature.iter().all(|h| h.is_finite())
    })
}
