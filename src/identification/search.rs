//! Trust-Tech on a joint problem, in either formulation.

use nalgebra::DVector;

use super::{
    DirectionRecord,
    evaluate::FittedModel,
    fit::{BestOnly, FitSolution, SearchOptions},
    intake::PreparedEvent,
    joint_problem::{JointProblem, LINEAR, OUTER, Simulated, motor_coordinates, outer_bounds},
    paper_problem::PaperProblem,
};
use crate::{
    load_model::LinearCoefficients,
    numerics::{
        Bounds, LocalSolution, Objective,
        grid_scan::{self, GridScan},
        local_solver,
        trust_tech::{
            self, ConstrainedProblem, DirectionOutcome, Ended, FoundSolution, Search, Starts,
        },
    },
};

/// What a search brought.
pub(super) struct Located {
    pub(super) solutions: Vec<FitSolution>,
    pub(super) directions: Vec<DirectionRecord>,
    pub(super) ended: Ended,
    pub(super) best_only: Option<BestOnly>,
}

/// Start inside the physical range, where no cell of the scan is feasible: an aggregated motor of
/// ordinary data (`effects.md`).
const PHYSICAL_START: [f64; OUTER] = [3.4, 7.0, 0.4];

/// Cells of a scan of the box's face of least alpha, made where a solution that is worth exploring lies on
/// it: a rotor that swings undamped leaves a row of minima along nu, closer to one another than the cells of
/// the other scans.
const UNDAMPED_CELLS: [usize; OUTER] = [1, 96, 24];
/// A best solution that leaves more than this (weighted squares per row) describes nothing: the objective is
/// then made of the model's own oscillations, in valleys that the tiers step over.
const DESCRIBES_PER_ROW: f64 = 100.0;
/// Motors whose objectives differ by at most this cannot be told apart: two standard deviations.
const TOLD_APART: f64 = 2.0;
/// Cells of the scans where nothing describes the events, and starts from each: of the box, ...
const UNDESCRIBED_BOX: ([usize; OUTER], usize) = ([28, 28, 12], 64);
/// ... of its face of least alpha, ...
const UNDESCRIBED_FACE: ([usize; OUTER], usize) = ([1, 192, 24], 256);
/// ... and of that face's edge of least kappa.
const UNDESCRIBED_EDGE: ([usize; OUTER], usize) = ([1, 384, 1], 128);
/// Decreases of the objective, relative and absolute, that are not worth a step before solutions are made
/// exact: far below what tells two solutions apart.
const ROUGH_DECREASE: f64 = 1e-5;
const ROUGH_DECREASE_ABSOLUTE: f64 = 1e-3;

/// Two solutions are one when their outer coordinates differ by less than this share of the box.
const SAME_COORDINATES: f64 = 2e-3;
/// ... or when the quadratic model of the objective between them differs by less than this: a
/// tenth of a standard deviation in every direction.
const SAME_OBJECTIVE: f64 = 0.005;
/// ... or when their outputs do: half the weighted square of the difference, as a share of the
/// objective. A hundredth of the residual.
const SAME_OUTPUTS: f64 = 1e-4;
/// Solutions whose objectives differ by more than this share are not compared any further.
const SAME_VALUE: f64 = 5e-3;

/// The reduced formulation: three outer unknowns in a box.
pub(super) fn reduced(
    problem: &JointProblem<'_>,
    options: &SearchOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Located {
    let bounds = outer_bounds();
    let same = |a: &LocalSolution, b: &LocalSolution| {
        let close = || {
            let model = |x: &DVector<f64>| Some(fitted_model(x, problem.linear(x)?));
            let (Some(a), Some(b)) = (model(&a.x), model(&b.x)) else {
                return f64::INFINITY;
            };
            outputs_apart(&a, &b, problem.events())
        };
        is_same(a, b, &bounds, close)
    };
    let rough = Simulated::roughly(problem);
    let for_scan = Simulated::for_scan(problem);
    let exact = Simulated::exactly(problem);
    let grid = grid_scan::scan(&for_scan, &bounds, &options.start_cells, cancel);
    let first = lowest(&grid, options.starts_max);
    // Where no motor describes the events, or they do not tell motors apart, there are hundreds of
    // solutions, and no user of any but the best.
    let cells: Vec<f64> = (0..grid.len()).map(|index| grid.value(index)).collect();
    let alike = motors_do_not_differ(&cells);
    let mut options = *options;
    options.trust_tech.describes_below = match problem.events() {
        _ if alike => f64::NEG_INFINITY,
        events if events.len() > 1 => undescribed_above(events),
        _ => f64::INFINITY,
    };
    let options = &options;
    let second = |found: &[FoundSolution]| more_starts(problem, &for_scan, options, found, cancel);
    let found = trust_tech::search(
        &rough,
        &bounds,
        &Starts {
            first: &first,
            second: (options.second_starts_max > 0).then_some(&second),
        },
        &[],
        &same,
        &roughly(&options.trust_tech),
        cancel,
    );
    let worth = worth_exploring_below(&found.solutions, &options.trust_tech);
    let found = made_exact(&exact, found, worth, &same, &options.trust_tech, cancel);
    let solution = |found: &FoundSolution| {
        let is_worth = found.local.value <= worth;
        let simulated = if is_worth { &exact } else { &rough };
        let point = simulated.point(&found.local.x)?;
        Some(FitSolution {
            found: found.clone(),
            model: fitted_model(&found.local.x, point.linear),
            point,
            paper: None,
        })
    };
    let nothing = least(&found.solutions) > options.trust_tech.describes_below;
    let why = if alike {
        BestOnly::MotorsDoNotDiffer
    } else {
        BestOnly::NothingDescribes
    };
    Located {
        solutions: found.solutions.iter().filter_map(solution).collect(),
        directions: found.directions,
        ended: found.ended,
        best_only: nothing.then_some(why),
    }
}

/// Whether the events hardly tell motors apart: half of the cells or more lie close to the lowest. Cells without
/// a motor, which are infinite, tell nothing.
fn motors_do_not_differ(cells: &[f64]) -> bool {
    let lowest = cells.iter().copied().fold(f64::INFINITY, f64::min);
    let close = cells.iter().filter(|value| *value - lowest <= TOLD_APART);
    2 * close.count() >= cells.len()
}

/// The objective above which a solution describes nothing.
fn undescribed_above(events: &[PreparedEvent]) -> f64 {
    let rows: usize = events.iter().map(PreparedEvent::rows).sum();
    0.5 * DESCRIBES_PER_ROW * rows as f64
}

/// More starts for what was found: from a finer scan where solutions compete or nothing describes the events, and
/// from one of the face of least alpha where a solution that is worth exploring lies on it.
fn more_starts(
    problem: &JointProblem<'_>,
    for_scan: &dyn Objective,
    options: &SearchOptions,
    found: &[FoundSolution],
    cancel: &(dyn Fn() -> bool + Sync),
) -> Vec<DVector<f64>> {
    let bounds = outer_bounds();
    let worth = worth_exploring_below(found, &options.trust_tech);
    let worth: Vec<_> = (found.iter().filter(|f| f.local.value <= worth)).collect();
    let described = least(found) <= undescribed_above(problem.events());
    let (of_box, of_face) = if described {
        let starts = options.second_starts_max;
        (
            (options.second_start_cells, starts),
            (UNDAMPED_CELLS, 2 * starts),
        )
    } else {
        (UNDESCRIBED_BOX, UNDESCRIBED_FACE)
    };
    let mut starts = Vec::new();
    if worth.len() > 1 || !described {
        starts = scan_starts(for_scan, &bounds, of_box, cancel);
    }
    if (worth.iter()).any(|f| f.local.x[0] <= bounds.lower[0]) {
        let mut face = bounds;
        face.upper[0] = face.lower[0];
        starts.extend(scan_starts(for_scan, &face, of_face, cancel));
        if !described {
            face.upper[2] = face.lower[2];
            starts.extend(scan_starts(for_scan, &face, UNDESCRIBED_EDGE, cancel));
        }
    }
    starts
}

/// The settings of a search whose solutions are made exact afterwards.
fn roughly(options: &trust_tech::Options) -> trust_tech::Options {
    let mut rough = *options;
    let local = &mut rough.local;
    local.decrease_relative = local.decrease_relative.max(ROUGH_DECREASE);
    local.decrease_absolute = local.decrease_absolute.max(ROUGH_DECREASE_ABSOLUTE);
    rough
}

/// The search's solutions where the exact problem has them: the local solver once more from each whose
/// objective is at most `worth`. Two that turn out to be one become one.
fn made_exact(
    exactly: &Simulated<'_, '_>,
    found: Search,
    worth: f64,
    same: &dyn Fn(&LocalSolution, &LocalSolution) -> bool,
    options: &trust_tech::Options,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Search {
    let near = |solution: &&FoundSolution| solution.local.value <= worth;
    let starts: Vec<_> = (found.solutions.iter())
        .filter(near)
        .map(|solution| solution.local.x.clone())
        .collect();
    let polished =
        local_solver::minimise_all(exactly, &outer_bounds(), &starts, &options.local, cancel);
    let mut polished = polished.into_iter();
    let mut cost = found.cost;
    let mut solutions: Vec<FoundSolution> = Vec::new();
    // Of each solution by its number, less 1, the number it has in the end; 0 for none.
    let mut numbers = Vec::with_capacity(found.solutions.len());
    for mut solution in found.solutions {
        if near(&&solution) {
            let Some(exact) = polished.next().and_then(Result::ok) else {
                numbers.push(0);
                continue;
            };
            cost += exact.cost;
            if let Some(known) = solutions
                .iter_mut()
                .find(|known| same(&known.local, &exact))
            {
                numbers.push(known.id);
                if exact.value < known.local.value {
                    known.local = exact;
                }
                continue;
            }
            solution.local = exact;
        }
        solution.id = solutions.len() + 1;
        solution.found_from = solution.found_from.map(|from| numbers[from - 1]);
        numbers.push(solution.id);
        solutions.push(solution);
    }
    let renumbered = |mut record: DirectionRecord| {
        record.from = numbers[record.from - 1];
        record.outcome = match record.outcome {
            DirectionOutcome::NewSolution(old) | DirectionOutcome::KnownSolution(old)
                if numbers[old - 1] == 0 =>
            {
                DirectionOutcome::LocalSolverInfeasible
            }
            DirectionOutcome::NewSolution(old) => {
                let new = numbers[old - 1];
                if numbers[..old - 1].contains(&new) {
                    DirectionOutcome::KnownSolution(new)
                } else {
                    DirectionOutcome::NewSolution(new)
                }
            }
            DirectionOutcome::KnownSolution(old) => {
                DirectionOutcome::KnownSolution(numbers[old - 1])
            }
            other => other,
        };
        record
    };
    Search {
        directions: found.directions.into_iter().map(renumbered).collect(),
        solutions,
        cost,
        ended: found.ended,
    }
}

/// The paper's formulation: nine parameters, slack variables.
pub(super) fn paper(
    problem: &JointProblem<'_>,
    paper: &PaperProblem<'_>,
    options: &SearchOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Located {
    let (bounds, outer) = (paper.bounds(), outer_bounds());
    // Compared by what the data determine: along the null direction the nine differ at will.
    let same = |a: &LocalSolution, b: &LocalSolution| {
        let (xa, la) = paper.coordinates(&a.x);
        let (xb, lb) = paper.coordinates(&b.x);
        let projected = |x: &DVector<f64>, at: &LocalSolution| LocalSolution {
            x: x.clone(),
            gradient: DVector::zeros(OUTER),
            curvature: nalgebra::DMatrix::from_element(OUTER, OUTER, f64::INFINITY),
            ..at.clone()
        };
        let apart = || {
            let [a, b] = [fitted_model(&xa, la), fitted_model(&xb, lb)];
            outputs_apart(&a, &b, problem.events())
        };
        let close = |a: &f64, b: &f64| (a - b).abs() < SAME_COORDINATES;
        let linear_close = la.iter().zip(&lb).all(|(a, b)| close(a, b));
        let (a, b) = (projected(&xa, a), projected(&xb, b));
        (linear_close && close_coordinates(&a, &b, &outer)) || is_same(&a, &b, &outer, apart)
    };
    let starts = paper_starts(problem, paper, options, cancel);
    let constrained = ConstrainedProblem {
        objective: paper,
        constraints: paper,
        bounds: &bounds,
    };
    let found = trust_tech::search_constrained(
        &constrained,
        &Starts::only(&starts),
        &[],
        &same,
        &options.trust_tech,
        cancel,
    );
    let solution = |found: &FoundSolution| {
        let point = paper.point(&found.local.x)?;
        let (x, linear) = paper.coordinates(&found.local.x);
        let nine = paper.parameters(&found.local.x);
        let active = paper.active_bounds(&found.local.x);
        Some(FitSolution {
            model: fitted_model(&x, linear),
            found: FoundSolution {
                local: LocalSolution {
                    x,
                    gradient: point.gradient.clone(),
                    curvature: point.reduced_curvature(),
                    ..found.local.clone()
                },
                ..found.clone()
            },
            point,
            paper: Some((nine, active)),
        })
    };
    Located {
        solutions: found.solutions.iter().filter_map(solution).collect(),
        directions: found.directions,
        ended: found.ended,
        best_only: None,
    }
}

/// The starts of the reduced formulation, moved into the paper's box.
fn paper_starts(
    problem: &JointProblem<'_>,
    paper: &PaperProblem<'_>,
    options: &SearchOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Vec<DVector<f64>> {
    let cells = (options.start_cells, options.starts_max);
    let start = |x: &DVector<f64>| {
        let linear = problem.linear(x)?;
        Some(paper.start(&motor_coordinates(x), linear))
    };
    let starts = scan_starts(problem, &outer_bounds(), cells, cancel);
    starts.iter().filter_map(start).collect()
}

fn worth_exploring_below(found: &[FoundSolution], options: &trust_tech::Options) -> f64 {
    options.worth_exploring_below(least(found))
}

fn least(found: &[FoundSolution]) -> f64 {
    let values = found.iter().map(|f| f.local.value);
    values.fold(f64::INFINITY, f64::min)
}

/// The lowest cells of a scan that no neighbour undercuts; the physical start where none is
/// feasible.
fn scan_starts(
    problem: &dyn Objective,
    bounds: &Bounds,
    (cells, at_most): ([usize; OUTER], usize),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Vec<DVector<f64>> {
    lowest(&grid_scan::scan(problem, bounds, &cells, cancel), at_most)
}

fn lowest(grid: &GridScan, at_most: usize) -> Vec<DVector<f64>> {
    let minima = grid.minima().into_iter().take(at_most);
    let mut starts: Vec<_> = minima.map(|index| grid.point(index)).collect();
    if starts.is_empty() {
        starts.push(DVector::from_column_slice(&PHYSICAL_START));
    }
    starts
}

fn close_coordinates(a: &LocalSolution, b: &LocalSolution, bounds: &Bounds) -> bool {
    let apart = (&b.x - &a.x).component_div(&bounds.spans());
    apart.iter().all(|share| share.abs() < SAME_COORDINATES)
}

/// Whether two solutions are one model. `outputs` tells how far their outputs are apart; asked only
/// when nothing else decides.
pub(super) fn is_same(
    a: &LocalSolution,
    b: &LocalSolution,
    bounds: &Bounds,
    outputs: impl FnOnce() -> f64,
) -> bool {
    let apart = (a.value - b.value).abs();
    let larger = a.value.max(b.value);
    if apart > SAME_VALUE * larger + SAME_OBJECTIVE {
        return false;
    }
    let step = &b.x - &a.x;
    let rise = 0.5 * (step.transpose() * &a.curvature * &step)[0];
    close_coordinates(a, b, bounds)
        || (rise < SAME_OBJECTIVE && apart < SAME_OBJECTIVE)
        || outputs() < SAME_OUTPUTS * larger + SAME_OBJECTIVE
}

/// Half the weighted square of the difference of two models' outputs.
pub(super) fn outputs_apart(a: &FittedModel, b: &FittedModel, events: &[PreparedEvent]) -> f64 {
    let mut sum = 0.0;
    for event in events {
        let (Ok(a), Ok(b)) = (a.simulate(event), b.simulate(event)) else {
            return f64::INFINITY;
        };
        for k in (0..event.len()).filter(|&k| event.used[k]) {
            sum += ((a.active[k] - b.active[k]) / event.active_deviation[k]).powi(2);
            sum += ((a.reactive[k] - b.reactive[k]) / event.reactive_deviation[k]).powi(2);
        }
    }
    0.5 * sum
}

pub(super) fn fitted_model(x: &DVector<f64>, linear: [f64; LINEAR]) -> FittedModel {
    FittedModel {
        motor: motor_coordinates(x),
        linear: LinearCoefficients::from_array(linear),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_without_a_motor_do_not_make_motors_alike() {
        let none = f64::INFINITY;
        assert!(!motors_do_not_differ(&[none; 4]));
        assert!(!motors_do_not_differ(&[7.0, none, none]));
        assert!(!motors_do_not_differ(&[7.0, 10.0, 40.0]));
        assert!(motors_do_not_differ(&[7.0, 8.5, 40.0, none]));
    }
}
