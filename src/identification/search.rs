//! Trust-Tech on a joint problem, in either formulation.

use nalgebra::DVector;

use super::{
    DirectionRecord,
    evaluate::FittedModel,
    fit::{FitSolution, SearchOptions},
    intake::PreparedEvent,
    joint_problem::{JointProblem, LINEAR, OUTER, motor_coordinates, outer_bounds},
    paper_problem::PaperProblem,
};
use crate::{
    load_model::LinearCoefficients,
    numerics::{
        Bounds, LocalSolution, grid_scan,
        trust_tech::{self, ConstrainedProblem, Ended, FoundSolution, Starts},
    },
};

/// What a search brought.
pub(super) struct Located {
    pub(super) solutions: Vec<FitSolution>,
    pub(super) directions: Vec<DirectionRecord>,
    pub(super) ended: Ended,
}

/// Start inside the physical range, where no cell of the scan is feasible: an aggregated motor of
/// ordinary data (`effects.md`).
const PHYSICAL_START: [f64; OUTER] = [3.4, 7.0, 0.4];

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
            let model = |x: &DVector<f64>| fitted_model(problem, x, problem.linear(x)?);
            let (Some(a), Some(b)) = (model(&a.x), model(&b.x)) else {
                return f64::INFINITY;
            };
            outputs_apart(&a, &b, problem.events())
        };
        is_same(a, b, &bounds, close)
    };
    let first = scan_starts(
        problem,
        &bounds,
        (options.start_cells, options.starts_max),
        cancel,
    );
    let second = |found: &[FoundSolution]| {
        let worth = competing(found, options.trust_tech.explore_within);
        if options.second_starts_max == 0 || worth < 2 {
            return Vec::new();
        }
        let cells = (options.second_start_cells, options.second_starts_max);
        scan_starts(problem, &bounds, cells, cancel)
    };
    let found = trust_tech::search(
        problem,
        &bounds,
        &Starts {
            first: &first,
            second: &second,
        },
        &[],
        &same,
        &options.trust_tech,
        cancel,
    );
    let solution = |found: &FoundSolution| {
        let point = problem.point(&found.local.x)?;
        Some(FitSolution {
            found: found.clone(),
            model: fitted_model(problem, &found.local.x, point.linear)?,
            point,
            paper: None,
        })
    };
    Located {
        solutions: found.solutions.iter().filter_map(solution).collect(),
        directions: found.directions,
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
            let models = (
                fitted_model(problem, &xa, la),
                fitted_model(problem, &xb, lb),
            );
            match models {
                (Some(a), Some(b)) => outputs_apart(&a, &b, problem.events()),
                _ => f64::INFINITY,
            }
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
            model: fitted_model(problem, &x, linear)?,
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

/// Number of solutions that are worth exploring.
fn competing(found: &[FoundSolution], within: f64) -> usize {
    let values = || found.iter().map(|f| f.local.value);
    let best = values().fold(f64::INFINITY, f64::min);
    values().filter(|value| *value <= within * best).count()
}

/// The lowest cells of a scan that no neighbour undercuts; the physical start where none is
/// feasible.
fn scan_starts(
    problem: &JointProblem<'_>,
    bounds: &Bounds,
    (cells, at_most): ([usize; OUTER], usize),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Vec<DVector<f64>> {
    let grid = grid_scan::scan(problem, bounds, &cells, cancel);
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

#[allow(
    clippy::unnecessary_wraps,
    reason = "its callers chain it with what may not exist"
)]
pub(super) fn fitted_model(
    problem: &JointProblem<'_>,
    x: &DVector<f64>,
    linear: [f64; LINEAR],
) -> Option<FittedModel> {
    Some(FittedModel {
        motor: motor_coordinates(x),
        linear: LinearCoefficients::from_array(linear),
        frequency_scaled_power: problem.options().frequency_scaled_power,
    })
}
