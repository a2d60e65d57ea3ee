//! Recognising, from a point on the way down, a solution that is known already.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::{Options, scaled::Scaled};
use crate::numerics::{Expansion, LocalSolution, local_solver::Guide};

/// Largest error of a known solution's quadratic model, relative to the rise it describes, at a
/// point that counts as lying in its basin. Chosen: where value and slope are both described to a
/// quarter there is no room for another minimum between. Insensitive between 0.1 and 0.4.
const MODEL_ERROR_MAX: f64 = 0.25;
/// Difference of two objectives, relative, that is no difference to a local solver.
const SAME_VALUE: f64 = 1e-6;

/// The solutions that are known while some directions are explored, in scaled coordinates.
pub(super) struct Known {
    basins: Vec<Basin>,
    exact_below: f64,
    decrease_relative: f64,
}

struct Basin {
    /// Index among the known solutions.
    index: usize,
    x: DVector<f64>,
    value: f64,
    gradient: DVector<f64>,
    curvature: DMatrix<f64>,
}

impl Known {
    /// `solutions` in the caller's coordinates. Those of which `minimum_of_the_box` says no, in scaled
    /// coordinates, are not recognised: a constraint makes them a minimum, which the objective's
    /// model knows nothing of. Nor are those whose model is not convex.
    pub(super) fn new<'s>(
        solutions: impl Iterator<Item = &'s LocalSolution>,
        scaled: &Scaled<'_>,
        options: &Options,
        minimum_of_the_box: impl Fn(&DVector<f64>) -> bool,
    ) -> Self {
        let mut best = f64::INFINITY;
        let mut basins = Vec::new();
        for (index, solution) in solutions.enumerate() {
            best = best.min(solution.value);
            let x = solution.x.component_div(&scaled.spans);
            let curvature = scaled.scaled_curvature(&solution.curvature);
            if minimum_of_the_box(&x) && is_convex(&curvature) {
                basins.push(Basin {
                    index,
                    x,
                    value: solution.value,
                    gradient: solution.gradient.component_mul(&scaled.spans),
                    curvature,
                });
            }
        }
        Self {
            basins,
            exact_below: options.worth_exploring_below(best),
            decrease_relative: options.coarse_decrease_relative,
        }
    }

    /// Index of the known solution whose basin the point lies in: its quadratic model describes
    /// both the value and the gradient at the point.
    pub(super) fn recognised(&self, x: &DVector<f64>, at: &Expansion) -> Option<usize> {
        let mut basins = self.basins.iter();
        basins
            .find(|basin| basin.describes(x, at))
            .map(|basin| basin.index)
    }

    /// What the local solver is told.
    pub(super) fn guide<'g>(
        &self,
        recognises: &'g dyn Fn(&DVector<f64>, &Expansion) -> bool,
    ) -> Guide<'g> {
        Guide {
            recognises,
            exact_below: self.exact_below,
            decrease_relative: self.decrease_relative,
        }
    }
}

/// Positive semidefinite, to rounding.
fn is_convex(curvature: &DMatrix<f64>) -> bool {
    let ridge = 1e-10 * curvature.diagonal().amax().max(f64::MIN_POSITIVE);
    let identity = DMatrix::identity(curvature.nrows(), curvature.nrows());
    Cholesky::new(curvature + identity * ridge).is_some()
}

impl Basin {
    fn describes(&self, x: &DVector<f64>, at: &Expansion) -> bool {
        let step = x - &self.x;
        let bend = &self.curvature * &step;
        let rise = at.value - self.value;
        let expected = self.gradient.dot(&step) + 0.5 * bend.dot(&step);
        let rounding = SAME_VALUE * self.value.abs();
        if rise < -rounding || (rise - expected).abs() > MODEL_ERROR_MAX * rise.abs() + rounding {
            return false;
        }
        // In the norm of the inverse diagonal half the square is a change of the objective.
        let diagonal = self.curvature.diagonal();
        let floor = 1e-12 * diagonal.amax().max(f64::MIN_POSITIVE);
        let promise = |gradient: &DVector<f64>| -> f64 {
            let terms = gradient.iter().zip(diagonal.iter());
            0.5 * terms.map(|(g, d)| g * g / d.max(floor)).sum::<f64>()
        };
        let error = promise(&(&at.gradient - &self.gradient - bend));
        error <= MODEL_ERROR_MAX.powi(2) * promise(&at.gradient) + rounding
    }
}
