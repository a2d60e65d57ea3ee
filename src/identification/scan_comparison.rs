//! The check that nothing was missed: a scan that knows nothing of the search, its minima polished,
//! held against the solutions found.

use nalgebra::DVector;

use super::{
    fit::{FitSolution, SearchOptions},
    joint_problem::{JointProblem, OUTER, outer_bounds},
    search::{fitted_model, is_same, outputs_apart},
};
use crate::numerics::{LocalSolution, grid_scan, local_solver};

/// How finely a fit is checked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ScanCheck {
    /// Not at all.
    #[default]
    Off,
    /// With 12 x 16 x 8 cells.
    Coarse,
    /// With 28 x 28 x 12 cells.
    Dense,
}

impl ScanCheck {
    /// Cells along ln alpha, ln nu and kappa.
    #[must_use]
    pub const fn cells(self) -> Option<[usize; OUTER]> {
        match self {
            Self::Off => None,
            Self::Coarse => Some([12, 16, 8]),
            Self::Dense => Some([28, 28, 12]),
        }
    }
}

/// A minimum that the scan found.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanMinimum {
    /// Objective.
    pub objective: f64,
    /// Outer coordinates: ln alpha, ln nu, kappa.
    pub coordinates: [f64; OUTER],
    /// The solution of the search that it is; none where the search missed it.
    pub solution: Option<usize>,
}

/// The search's solutions held against a scan's minima. Only what lies within
/// [`within`](Self::within) is compared: farther up the search does not look for every minimum.
#[derive(Clone, Debug, PartialEq)]
pub struct ScanComparison {
    /// Cells along ln alpha, ln nu and kappa.
    pub cells: [usize; OUTER],
    /// Minima and solutions are compared up to this multiple of the lowest objective.
    pub within: f64,
    /// The scan's minima, lowest first.
    pub minima: Vec<ScanMinimum>,
    /// Solutions that only the search found.
    pub only_search: Vec<usize>,
    /// Calls of the objective that the scan and its descents cost.
    pub evaluations: u64,
}

impl ScanComparison {
    /// Scans and compares.
    #[must_use]
    pub fn new(
        problem: &JointProblem<'_>,
        solutions: &[FitSolution],
        cells: [usize; OUTER],
        options: &SearchOptions,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Self {
        let (polished, evaluations) = polished_minima(problem, cells, options, cancel);
        let lowest = (polished.iter().map(|m| m.value))
            .chain(solutions.iter().map(|s| s.point.objective))
            .fold(f64::INFINITY, f64::min);
        let within = options.trust_tech.explore_within.min(WITHIN_MAX);
        let mut minima: Vec<(LocalSolution, Option<usize>)> = Vec::new();
        for minimum in polished {
            if minimum.value > within * lowest || known(problem, &minima, &minimum) {
                continue;
            }
            let solution = (solutions.iter()).find(|s| same(problem, &s.found.local, &minimum));
            minima.push((minimum, solution.map(|s| s.found.id)));
        }
        let only_search = (solutions.iter())
            .filter(|s| s.point.objective <= within * lowest)
            .map(|s| s.found.id)
            .filter(|id| minima.iter().all(|(_, solution)| *solution != Some(*id)))
            .collect();
        let minima = (minima.into_iter())
            .map(|(minimum, solution)| ScanMinimum {
                objective: minimum.value,
                coordinates: std::array::from_fn(|i| minimum.x[i]),
                solution,
            })
            .collect();
        Self {
            cells,
            within,
            minima,
            only_search,
            evaluations,
        }
    }

    /// Minima of the scan that the search missed.
    pub fn missed(&self) -> impl Iterator<Item = &ScanMinimum> {
        self.minima.iter().filter(|m| m.solution.is_none())
    }
}

/// Largest multiple of the lowest objective up to which minima are compared, where the search
/// explores without limit.
const WITHIN_MAX: f64 = 1.5;

/// Every minimum of the scan, followed to its end, lowest first.
fn polished_minima(
    problem: &JointProblem<'_>,
    cells: [usize; OUTER],
    options: &SearchOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> (Vec<LocalSolution>, u64) {
    let bounds = outer_bounds();
    let grid = grid_scan::scan(problem, &bounds, &cells, cancel);
    let mut evaluations = grid.len() as u64;
    let mut polished = Vec::new();
    for index in grid.minima() {
        let start: DVector<f64> = grid.point(index);
        let local = &options.trust_tech.local;
        if let Ok(found) = local_solver::minimise(problem, &bounds, &start, local, cancel) {
            evaluations += found.cost.evaluations();
            if found.termination.is_minimum() {
                polished.push(found);
            }
        }
    }
    polished.sort_by(|a, b| a.value.total_cmp(&b.value));
    (polished, evaluations)
}

fn known(
    problem: &JointProblem<'_>,
    minima: &[(LocalSolution, Option<usize>)],
    minimum: &LocalSolution,
) -> bool {
    (minima.iter()).any(|(other, _)| same(problem, other, minimum))
}

fn same(problem: &JointProblem<'_>, a: &LocalSolution, b: &LocalSolution) -> bool {
    let outputs = || {
        let model = |x: &DVector<f64>| Some(fitted_model(x, problem.linear(x)?));
        match (model(&a.x), model(&b.x)) {
            (Some(a), Some(b)) => outputs_apart(&a, &b, problem.events()),
            _ => f64::INFINITY,
        }
    };
    is_same(a, b, &outer_bounds(), outputs)
}
