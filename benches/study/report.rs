//! What the program and the scan found, side by side.

use std::{error::Error, fs, path::Path};

use loadmodeld::{
    identification::{
        evaluate::FittedModel,
        intake::PreparedEvent,
        joint_problem::{JointPoint, JointProblem, motor_coordinates},
    },
    load_model::LinearCoefficients,
    numerics::LocalSolution,
};
use nalgebra::DVector;
use serde_json::json;

use super::{
    problems::{Problem, SAMPLES},
    scan,
};

/// Objectives are compared relative to themselves, but not finer than relative to this: noise of
/// 0.01 % of P0 where 0.1 % is assumed.
const OBJECTIVE_FLOOR: f64 = SAMPLES as f64 * 0.01;
/// Two solutions are one model when half the squared distance of their curves, in standard
/// deviations, is below this (a tenth of a standard deviation) ...
const SAME_CURVES: f64 = 0.005;
/// ... or below this part of the objective, which a misfit of the model makes large.
const SAME_CURVES_SHARE: f64 = 1e-5;
/// Share above the best within which every solution must be found.
const COMPLETE_WITHIN: f64 = 0.05;
/// Share above the best within which it is counted how many are found.
const COUNTED_WITHIN: f64 = 1.0;
/// Share above the best at which it counts as beaten.
const BEATEN: f64 = 1e-3;

/// A solution of either method.
#[derive(Clone, Debug)]
pub struct Found {
    pub x: [f64; 3],
    pub linear: [f64; 5],
    pub without_motor: bool,
    pub objective: f64,
    pub tier: Option<usize>,
}

/// A problem and what became of it.
#[derive(Clone, Debug, Default)]
pub struct Outcome {
    pub index: usize,
    pub family: &'static str,
    pub noise: f64,
    pub second_motor: bool,
    pub objective_of_truth: Option<f64>,
    pub fit: Vec<Found>,
    pub scan: Vec<Found>,
    /// Solutions of the scan within 5 % of the best that the fit lacks.
    pub missed: Vec<Found>,
    /// Such solutions from which a stricter polish goes on to what the fit has.
    pub no_minima: usize,
    /// Solutions of the scan within twice the best, and how many of them the fit lacks.
    pub within_double: usize,
    pub missed_within_double: usize,
    /// Solutions of the fit within 5 % of the best that the scan lacks.
    pub only_fit: Vec<Found>,
    pub fit_cpu_s: f64,
    pub scan_cpu_s: f64,
    pub directions: usize,
    pub simulations: u64,
    pub sensitivity_simulations: u64,
}

impl Found {
    pub fn new(x: &[f64], point: &JointPoint, tier: Option<usize>) -> Self {
        Self {
            x: [x[0], x[1], x[2]],
            linear: point.linear,
            // Not at the upper one: there the motor is all that matters.
            without_motor: point.linear_at_bound[0] && point.linear[0] < 0.5,
            objective: point.objective,
            tier,
        }
    }

    /// P and Q over P0 in standard deviations.
    fn curves(&self, event: &PreparedEvent) -> Option<Vec<f64>> {
        let model = FittedModel {
            motor: motor_coordinates(&DVector::from_column_slice(&self.x)),
            linear: LinearCoefficients::from_array(self.linear),
        };
        let curves = model.simulate(event).ok()?;
        let active = curves.active.iter().zip(&event.active_deviation);
        let reactive = curves.reactive.iter().zip(&event.reactive_deviation);
        Some(active.chain(reactive).map(|(y, d)| y / d).collect())
    }
}

impl Outcome {
    pub fn best_of_fit(&self) -> f64 {
        self.fit
            .iter()
            .map(|f| f.objective)
            .fold(f64::INFINITY, f64::min)
    }

    pub fn best_of_scan(&self) -> f64 {
        self.scan
            .iter()
            .map(|f| f.objective)
            .fold(f64::INFINITY, f64::min)
    }

    /// Excess of the fit's best over the scan's best, relative; negative where the fit is better.
    pub fn excess(&self) -> f64 {
        let scan = self.best_of_scan();
        (self.best_of_fit() - scan) / scan.max(OBJECTIVE_FLOOR)
    }
}

/// Sorts out repetitions and holds the two lists against each other.
pub fn compare(
    problem: &Problem,
    joint: &JointProblem<'_>,
    fit: &[Found],
    scan: &[LocalSolution],
) -> Outcome {
    let scanned: Vec<Found> = (scan.iter())
        .filter_map(|s| Some(Found::new(s.x.as_slice(), &joint.point(&s.x)?, None)))
        .collect();
    let event = &problem.event;
    let scanned = distinct(scanned, event);
    let fitted = distinct(fit.to_vec(), event);
    let best = (fitted.iter().chain(&scanned))
        .map(|f| f.objective)
        .fold(f64::INFINITY, f64::min);
    let near = |list: &[Found], share: f64| -> Vec<Found> {
        let limit = best + share * best.max(OBJECTIVE_FLOOR);
        let near = list.iter().filter(|f| f.objective <= limit);
        near.cloned().collect()
    };
    let lacking = |list: Vec<Found>, other: &[Found]| -> Vec<Found> {
        list.into_iter()
            .filter(|f| !other.iter().any(|o| same(f, o, event)))
            .collect()
    };
    // What a stricter polish leaves is no minimum, and what it leads to may be known.
    let mut seeming = lacking(near(&scanned, COMPLETE_WITHIN), &fitted);
    let count = seeming.len();
    seeming.retain(|f| {
        let followed = scan::followed(joint, &f.x);
        let end =
            followed.and_then(|s| Some(Found::new(s.x.as_slice(), &joint.point(&s.x)?, None)));
        end.is_none_or(|end| !fitted.iter().any(|o| same(&end, o, event)))
    });
    let truth = DVector::from_column_slice(&problem.truth.parameters.coordinates());
    Outcome {
        index: problem.index,
        family: problem.truth.family.name(),
        noise: problem.noise,
        second_motor: problem.truth.second_motor.is_some(),
        objective_of_truth: joint.point(&truth).map(|p| p.objective),
        no_minima: count - seeming.len(),
        missed: seeming,
        within_double: near(&scanned, COUNTED_WITHIN).len(),
        missed_within_double: lacking(near(&scanned, COUNTED_WITHIN), &fitted).len(),
        only_fit: lacking(near(&fitted, COMPLETE_WITHIN), &scanned),
        fit: fitted,
        scan: scanned,
        ..Outcome::default()
    }
}

fn distinct(mut list: Vec<Found>, event: &PreparedEvent) -> Vec<Found> {
    list.sort_by(|a, b| a.objective.total_cmp(&b.objective));
    let mut kept: Vec<Found> = Vec::new();
    for found in list {
        if !kept.iter().any(|k| same(k, &found, event)) {
            kept.push(found);
        }
    }
    kept
}

/// Whether two solutions describe the same load: their curves agree.
fn same(a: &Found, b: &Found, event: &PreparedEvent) -> bool {
    let objective = a.objective.min(b.objective);
    let limit = SAME_CURVES.max(SAME_CURVES_SHARE * objective);
    if (a.objective - b.objective).abs() > 0.1 * objective.max(OBJECTIVE_FLOOR) {
        return false;
    }
    // With the motor share at its least value the rest of the motor means nothing.
    if a.without_motor && b.without_motor && (a.objective - b.objective).abs() < 0.02 * objective {
        return true;
    }
    match (a.curves(event), b.curves(event)) {
        (Some(p), Some(q)) => {
            let square: f64 = p.iter().zip(&q).map(|(p, q)| (p - q).powi(2)).sum();
            0.5 * square < limit
        }
        _ => false,
    }
}

/// The table and every failure, as markdown.
pub fn print(outcomes: &[Outcome]) {
    println!(
        "| family | problems | best beaten by > 0.1 % | solutions missed within 5 % | seeming ones | missed within twice the best | scan's best worse by > 0.1 % | solutions only the fit has | median fit CPU ms | 90 % | median directions |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for family in ["box", "table_1", "beyond", "all"] {
        let of: Vec<&Outcome> = (outcomes.iter())
            .filter(|o| family == "all" || o.family == family)
            .collect();
        let count = |is: &dyn Fn(&Outcome) -> bool| of.iter().filter(|o| is(o)).count();
        println!(
            "| {family} | {} | {} | {} in {} | {} | {} of {} | {} | {} | {:.1} | {:.1} | {:.0} |",
            of.len(),
            count(&|o| o.excess() > BEATEN),
            of.iter().map(|o| o.missed.len()).sum::<usize>(),
            count(&|o| !o.missed.is_empty()),
            of.iter().map(|o| o.no_minima).sum::<usize>(),
            of.iter().map(|o| o.missed_within_double).sum::<usize>(),
            of.iter().map(|o| o.within_double).sum::<usize>(),
            count(&|o| o.excess() < -BEATEN),
            of.iter().map(|o| o.only_fit.len()).sum::<usize>(),
            quantile(&of, 0.5, |o| 1e3 * o.fit_cpu_s),
            quantile(&of, 0.9, |o| 1e3 * o.fit_cpu_s),
            quantile(&of, 0.5, |o| o.directions as f64),
        );
    }
    println!(
        "\nScan: median {:.0} ms.",
        quantile(&outcomes.iter().collect::<Vec<_>>(), 0.5, |o| 1e3
            * o.scan_cpu_s)
    );
    println!(
        "\n| problem | family | noise | second motor | fit's best | scan's best | excess % | missed: objective at (ln alpha, ln nu, kappa; Kpm) |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for outcome in outcomes {
        if outcome.excess() <= BEATEN && outcome.missed.is_empty() {
            continue;
        }
        let missed: Vec<String> = (outcome.missed.iter())
            .map(|f| {
                let [a, n, k] = f.x;
                format!(
                    "{:.4} at ({a:.3}, {n:.3}, {k:.4}; {:.3})",
                    f.objective, f.linear[0]
                )
            })
            .collect();
        println!(
            "| {} | {} | {} | {} | {:.5} | {:.5} | {:.3} | {} |",
            outcome.index,
            outcome.family,
            outcome.noise,
            outcome.second_motor,
            outcome.best_of_fit(),
            outcome.best_of_scan(),
            100.0 * outcome.excess(),
            missed.join("; ")
        );
    }
}

fn quantile(outcomes: &[&Outcome], share: f64, value: impl Fn(&Outcome) -> f64) -> f64 {
    let mut values: Vec<f64> = outcomes.iter().map(|o| value(o)).collect();
    values.sort_by(f64::total_cmp);
    let at = (share * values.len().saturating_sub(1) as f64).round() as usize;
    values.get(at).copied().unwrap_or(f64::NAN)
}

/// Everything, for other programs.
pub fn write_json(file: &Path, seed: u64, outcomes: &[Outcome]) -> Result<(), Box<dyn Error>> {
    let found = |list: &[Found]| -> Vec<serde_json::Value> {
        list.iter()
            .map(|f| {
                json!({
                    "objective": f.objective, "x": f.x, "linear": f.linear,
                    "without_motor": f.without_motor, "tier": f.tier,
                })
            })
            .collect()
    };
    let problems: Vec<_> = (outcomes.iter())
        .map(|o| {
            json!({
                "index": o.index, "family": o.family, "noise": o.noise,
                "second_motor": o.second_motor, "objective_of_truth": o.objective_of_truth,
                "excess": o.excess(), "fit": found(&o.fit), "scan": found(&o.scan),
                "within_double": o.within_double, "missed_within_double": o.missed_within_double,
                "missed": found(&o.missed), "only_fit": found(&o.only_fit),
                "fit_cpu_s": o.fit_cpu_s, "scan_cpu_s": o.scan_cpu_s,
                "directions": o.directions, "simulations": o.simulations,
                "sensitivity_simulations": o.sensitivity_simulations,
            })
        })
        .collect();
    let text = serde_json::to_string_pretty(&json!({ "seed": seed, "problems": problems }))?;
    fs::write(file, text)?;
    Ok(())
}
