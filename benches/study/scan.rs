//! A dense scan of the search box with a polish of every local minimum of the grid: a check of the
//! search that shares nothing with it but objective and local solver.

use loadmodeld::{
    identification::joint_problem::{JointProblem, OUTER, outer_bounds},
    numerics::{LocalSolution, Objective, local_solver},
};
use nalgebra::DVector;

/// Points asked for at once.
const CHUNK: usize = 64;

/// Every minimum reached from a local minimum of the grid (26 neighbours), best first, not yet
/// freed of repetitions.
pub fn minima(problem: &JointProblem<'_>, shape: [usize; OUTER]) -> Vec<LocalSolution> {
    let bounds = outer_bounds();
    let point = |at: [usize; OUTER]| {
        DVector::from_fn(OUTER, |i, _| {
            let share = at[i] as f64 / (shape[i] - 1) as f64;
            bounds.lower[i] + share * (bounds.upper[i] - bounds.lower[i])
        })
    };
    let cells: Vec<[usize; OUTER]> = (0..shape[0])
        .flat_map(|a| (0..shape[1]).flat_map(move |b| (0..shape[2]).map(move |c| [a, b, c])))
        .collect();
    let mut values = Vec::with_capacity(cells.len());
    for chunk in cells.chunks(CHUNK) {
        let points: Vec<_> = chunk.iter().map(|cell| point(*cell)).collect();
        let of_chunk = problem.values(&points).into_iter();
        values.extend(of_chunk.map(|value| value.unwrap_or(f64::INFINITY)));
    }
    let options = local_solver::Options::default();
    let mut minima: Vec<LocalSolution> = (cells.iter())
        .filter(|cell| is_minimum(&values, shape, **cell))
        .filter_map(|cell| {
            local_solver::minimise(problem, &bounds, &point(*cell), &options, &|| false).ok()
        })
        .filter(|solution| solution.termination.is_feasible())
        .collect();
    minima.sort_by(|a, b| a.value.total_cmp(&b.value));
    minima
}

/// Where the local solver comes to from the end of a polish with tolerances of rounding's size.
pub fn followed(problem: &JointProblem<'_>, x: &[f64; OUTER]) -> Option<LocalSolution> {
    let options = local_solver::Options {
        evaluations_max: 20_000,
        decrease_relative: 1e-16,
        step_relative: 1e-18,
        ..local_solver::Options::default()
    };
    let start = DVector::from_column_slice(x);
    local_solver::minimise(problem, &outer_bounds(), &start, &options, &|| false).ok()
}

fn is_minimum(values: &[f64], shape: [usize; OUTER], cell: [usize; OUTER]) -> bool {
    let index = |at: [usize; OUTER]| (at[0] * shape[1] + at[1]) * shape[2] + at[2];
    let around = |i: usize| cell[i].saturating_sub(1)..=(cell[i] + 1).min(shape[i] - 1);
    let here = values[index(cell)];
    here.is_finite()
        && around(0).all(|a| around(1).all(|b| around(2).all(|c| values[index([a, b, c])] >= here)))
}
