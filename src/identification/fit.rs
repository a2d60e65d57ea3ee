//! The global search over a joint problem: deterministic starts, Trust-Tech, solutions named apart.

use nalgebra::DVector;

use super::{
    Cost, DirectionOutcome, DirectionRecord,
    evaluate::FittedModel,
    intake::PreparedEvent,
    joint_problem::{
        JointPoint, JointProblem, OUTER, ProblemOptions, motor_coordinates, outer_bounds,
    },
};
use crate::{
    load_model::LinearCoefficients,
    numerics::{LocalSolution, Objective, trust_tech},
};

/// Settings of the search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SearchOptions {
    /// Settings of Trust-Tech.
    pub trust_tech: trust_tech::Options,
    /// How many of the coarse grid's local minima become starts, besides the physical start.
    /// Default 3; 0 to 64.
    pub grid_starts: usize,
}

impl Default for SearchOptions {
    fn default() -> Self {
        let mut options = trust_tech::Options {
            tiers_max: 3,
            step: 0.04,
            // What lies behind a local solution with half as much squared error again describes
            // another load.
            explore_within: 1.5,
            evaluations_max: 1000,
            ..trust_tech::Options::default()
        };
        // The objective is a sum of squares of some thousand samples: a relative decrease below
        // 1e-8 moves no parameter by a hundredth of its standard error.
        options.local.decrease_relative = 1e-8;
        options.local.step_relative = 1e-7;
        options.local.evaluations_max = 120;
        Self {
            trust_tech: options,
            grid_starts: 3,
        }
    }
}

/// A local solution of a joint fit.
#[derive(Clone, Debug)]
pub struct FitSolution {
    /// How it was found.
    pub found: trust_tech::FoundSolution,
    /// Everything at that point.
    pub point: JointPoint,
    /// The model.
    pub model: FittedModel,
}

/// The outcome of a joint fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Local solutions, best first.
    pub solutions: Vec<FitSolution>,
    /// Every direction, in order of exploration.
    pub directions: Vec<DirectionRecord>,
    /// Cost.
    pub cost: Cost,
}

/// Start inside the physical range: an aggregated motor of ordinary data (`effects.md`).
const PHYSICAL_START: [f64; OUTER] = [3.4, 7.0, 0.4];
/// Coarse grid of starts: ln alpha, ln nu, kappa.
const GRID: [&[f64]; OUTER] = [
    &[0.7, 2.0, 3.3, 4.6, 5.8],
    &[2.0, 4.2, 6.2, 8.0, 9.8],
    &[0.15, 0.45, 0.8],
];
/// Two solutions are one when their outer coordinates differ by less than this share of the box.
const SAME_COORDINATES: f64 = 2e-3;
/// ... or when the quadratic model of the objective between them differs by less than this: a
/// tenth of a standard deviation in every direction.
const SAME_OBJECTIVE: f64 = 0.005;

/// Solutions without a motor are one when their objectives differ by less than this share.
const NO_MOTOR_SHARE: f64 = 0.02;

/// Fits the events jointly. `None` when no start is feasible.
#[must_use]
pub fn fit(
    events: &[PreparedEvent],
    problem: ProblemOptions,
    search: &SearchOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Fit> {
    let problem = JointProblem::new(events, problem, cancel);
    let bounds = outer_bounds();
    let spans = bounds.spans();
    let no_motor = |x: &DVector<f64>| problem.point(x).is_some_and(|p| p.linear_at_bound[0]);
    let same = |a: &LocalSolution, b: &LocalSolution| {
        let step = &b.x - &a.x;
        let close = (step.iter().zip(spans.iter())).all(|(d, w)| d.abs() < SAME_COORDINATES * w);
        let rise = 0.5 * (step.transpose() * &a.curvature * &step)[0];
        let apart = (a.value - b.value).abs();
        close
            || (rise < SAME_OBJECTIVE && apart < SAME_OBJECTIVE)
            // With the motor share at its least value the motor's coordinates mean nothing.
            || (apart < NO_MOTOR_SHARE * a.value && no_motor(&a.x) && no_motor(&b.x))
    };
    let starts = starts(&problem, search.grid_starts);
    let found = trust_tech::search(
        &problem,
        &bounds,
        &starts,
        &[],
        &same,
        &search.trust_tech,
        cancel,
    );
    let mut solutions: Vec<FitSolution> = found
        .solutions
        .iter()
        .filter_map(|found| {
            let point = problem.point(&found.local.x)?;
            let model = FittedModel {
                motor: motor_coordinates(&found.local.x),
                linear: LinearCoefficients::from_array(point.linear),
                frequency_scaled_power: problem.options().frequency_scaled_power,
            };
            Some(FitSolution {
                found: found.clone(),
                point,
                model,
            })
        })
        .collect();
    solutions.sort_by(|a, b| {
        a.point
            .objective
            .total_cmp(&b.point.objective)
            .then(a.found.id.cmp(&b.found.id))
    });
    let (simulations, sensitivity_simulations) = problem.simulations();
    (!solutions.is_empty()).then(|| Fit {
        solutions,
        directions: found.directions.iter().map(direction_record).collect(),
        cost: Cost {
            simulations,
            sensitivity_simulations,
            seconds: 0.0,
        },
    })
}

fn starts(problem: &JointProblem<'_>, count: usize) -> Vec<DVector<f64>> {
    let mut starts = vec![DVector::from_column_slice(&PHYSICAL_START)];
    if count == 0 {
        return starts;
    }
    let shape = GRID.map(<[f64]>::len);
    let value = |at: [usize; OUTER]| {
        let x = DVector::from_fn(OUTER, |i, _| GRID[i][at[i]]);
        problem.value(&x).unwrap_or(f64::INFINITY)
    };
    let index = |at: [usize; OUTER]| (at[0] * shape[1] + at[1]) * shape[2] + at[2];
    let mut values = vec![f64::INFINITY; shape.iter().product()];
    let mut cells = Vec::with_capacity(values.len());
    for a in 0..shape[0] {
        for b in 0..shape[1] {
            for c in 0..shape[2] {
                values[index([a, b, c])] = value([a, b, c]);
                cells.push([a, b, c]);
            }
        }
    }
    let mut minima: Vec<[usize; OUTER]> = cells
        .into_iter()
        .filter(|&cell| is_grid_minimum(&values, &shape, &index, cell))
        .collect();
    minima.sort_by(|&a, &b| values[index(a)].total_cmp(&values[index(b)]));
    starts.extend(
        minima
            .into_iter()
            .take(count)
            .map(|at| DVector::from_fn(OUTER, |i, _| GRID[i][at[i]])),
    );
    starts
}

fn is_grid_minimum(
    values: &[f64],
    shape: &[usize; OUTER],
    index: &impl Fn([usize; OUTER]) -> usize,
    cell: [usize; OUTER],
) -> bool {
    let here = values[index(cell)];
    here.is_finite()
        && (0..OUTER).all(|axis| {
            [-1_isize, 1].iter().all(|step| {
                let mut neighbour = cell;
                match cell[axis].checked_add_signed(*step) {
                    Some(at) if at < shape[axis] => neighbour[axis] = at,
                    _ => return true,
                }
                values[index(neighbour)] >= here
            })
        })
}

fn direction_record(record: &trust_tech::DirectionRecord) -> DirectionRecord {
    DirectionRecord {
        from: record.from,
        direction: record.direction,
        label: record.label.clone(),
        exit_distance: record.exit_distance,
        outcome: match record.outcome {
            trust_tech::DirectionOutcome::NewSolution(id) => DirectionOutcome::NewSolution(id),
            trust_tech::DirectionOutcome::KnownSolution(id) => DirectionOutcome::KnownSolution(id),
            trust_tech::DirectionOutcome::NoExitPoint {
                at_distance,
                diverged,
            } => DirectionOutcome::NoExitPoint {
                at_distance,
                diverged,
            },
            trust_tech::DirectionOutcome::LocalSolverInfeasible => {
                DirectionOutcome::LocalSolverInfeasible
            }
        },
    }
}
