//! From windows to a parameter set: prepare, split, fit jointly, validate on what was held out.

use super::{
    Bases, Cost, DirectionRecord, ErrorSummary, IdentificationError, OperatingPoint, ParameterSet,
    Solution, Verdict,
    composed_estimates::composed_estimates,
    edge_timing::align,
    estimates::{self, Estimates},
    evaluate::{StaticModel, errors},
    fit::{Fit, FitSolution, SearchOptions},
    hold_out::held_out,
    intake::{IntakeOptions, PreparedEvent, prepare},
    joint_problem::{LINEAR, OUTER, ProblemOptions},
    on_windows::no_response,
    paper_problem::{PAPER, PAPER_NAMES},
    precision::Precision,
    robust::RobustLoss,
    scan_comparison::ScanComparison,
    site_fit::{FittedSite, fit_site},
    solution::Ended,
    validate::{Evidence, ValidationOptions, largest_voltage_change, validate},
};
use crate::{
    disturbance::Window,
    load_model::{Ranges, Structure},
    measurement::Site,
};

/// Which events are held out.
#[derive(Clone, Debug, PartialEq)]
pub enum Split {
    /// This share of the events, chosen by a stable hash and balanced over depth.
    Share(f64),
    /// Exactly these events are fitted and these held out; others are left aside.
    Named {
        /// Events to fit.
        fitted: Vec<String>,
        /// Events to hold out.
        held_out: Vec<String>,
    },
}

/// Settings of an identification; each group belongs to one step of the path.
#[derive(Clone, Debug, PartialEq)]
pub struct IdentificationOptions {
    /// Preparation of the windows.
    pub intake: IntakeOptions,
    /// Bounds, priors and random effects.
    pub problem: ProblemOptions,
    /// Global search.
    pub search: SearchOptions,
    /// Held-out events. Default: a third.
    pub split: Split,
    /// Validation.
    pub validation: ValidationOptions,
    /// Whether samples with large residuals count less, and how. Default: no.
    pub robust: Option<RobustLoss>,
    /// Bounds and priors of the site's parameters; linear coefficients have theirs in `problem`, too.
    /// Default: as declared.
    pub ranges: Ranges,
}

impl Default for IdentificationOptions {
    fn default() -> Self {
        Self {
            intake: IntakeOptions::default(),
            problem: ProblemOptions::default(),
            search: SearchOptions::default(),
            split: Split::Share(0.33),
            validation: ValidationOptions::default(),
            robust: None,
            ranges: Ranges::default(),
        }
    }
}

/// What an identification produced.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// The parameter set, validated, with version 0.
    pub set: ParameterSet,
    /// Every local solution found, best first.
    pub solutions: Vec<Solution>,
    /// Every search direction and its outcome.
    pub directions: Vec<DirectionRecord>,
    /// Why the search ended.
    pub ended: Ended,
    /// What a scan says of the search, where one was asked for.
    pub scan: Option<ScanComparison>,
    /// What it cost; `seconds` is left at 0, time is not known here.
    pub cost: Cost,
    /// Events that could not be used, with the reason.
    pub refused: Vec<(String, String)>,
}

/// Fits `structure` to the windows jointly, holds some of them out, validates on those.
///
/// Deterministic: the same windows and options give the same bytes, whatever the number of threads
/// and whatever the order of the windows. `cancel` is asked between simulations.
///
/// # Errors
///
/// See [`IdentificationError`].
pub fn identify(
    site: &Site,
    windows: &[Window],
    structure: &[String],
    options: &IdentificationOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Identification, IdentificationError> {
    conclude(
        site,
        fit_site(windows, structure, options, cancel)?,
        options,
    )
}

/// What is said of a fitted site: errors, parameters with their precision, verdict, solutions.
///
/// # Errors
///
/// [`IdentificationError::NoSolution`] when the search found none, or the model cannot be simulated
/// on an event.
pub fn conclude(
    site: &Site,
    site_fit: FittedSite,
    options: &IdentificationOptions,
) -> Result<Identification, IdentificationError> {
    let best = site_fit.best()?;
    let problem = &site_fit.problem;
    let model = site_fit.model(best);
    let model = model.as_ref();
    let aligned = |events: &[PreparedEvent]| events.iter().map(|e| align(model, e)).collect();
    let (fitted, held): (Vec<_>, Vec<_>) = (aligned(&site_fit.measured), aligned(&site_fit.held));
    let reference = StaticModel::fit(&fitted);
    let infeasible = |_| no_response(model, fitted.iter().chain(&held));
    let fit_errors = errors(model, &reference, &fitted).map_err(infeasible)?;
    let held_errors = if held.is_empty() {
        None
    } else {
        Some(errors(model, &reference, &held).map_err(infeasible)?)
    };
    let operating_point = site_fit.operating_point;
    let hz = site.nominal_hz;
    let (mut estimates, precision) = if let Some(composed) = &site_fit.composed {
        composed_estimates(composed, problem, &operating_point, hz)
    } else {
        let precision = site_fit.precision(best);
        let named = estimates::estimates(best, problem, &operating_point, hz, &precision);
        (named, precision)
    };
    estimates.derived.extend(site_fit.trend.estimates());
    estimates.notes.extend(site_fit.robust_note());
    estimates.notes.extend(site_fit.best_only_note());
    estimates.notes.extend(site_fit.window_note());
    estimates.notes.extend(site_fit.edge_notes());
    let evidence = Evidence {
        model,
        largest_change_fitted: largest_voltage_change(&fitted),
        held_out: &held,
        fit_errors: &fit_errors,
        held_out_errors: held_errors.as_ref(),
        motor_share_determined: determined(&estimates, "Kpm"),
        slip: derived(&estimates, "slip"),
    };
    let verdict = validate(&evidence, &options.validation).map_err(infeasible)?;
    let solutions = solution_records(&site_fit.found, problem, &operating_point, hz);
    let set = assemble(
        site,
        &site_fit.structure,
        (estimates, &precision),
        operating_point,
        (&fitted, fit_errors),
        (&held, held_errors),
        verdict,
    );
    Ok(Identification {
        set,
        solutions,
        directions: site_fit.found.directions,
        ended: site_fit.found.ended,
        scan: site_fit.found.scan,
        cost: site_fit.found.cost,
        refused: site_fit.refused,
    })
}

/// Prepares every window that can be; the others with the reason. Sorted by name, so that the order
/// of arrival does not reach the sums.
#[must_use]
pub fn prepare_all(
    windows: &[Window],
    options: &IntakeOptions,
) -> (Vec<PreparedEvent>, Vec<(String, String)>) {
    let options = options.for_windows(windows);
    let (mut events, mut refused) = (Vec::new(), Vec::new());
    for window in windows {
        match prepare(window, &options) {
            Ok(event) => events.push(event),
            Err(reason) => refused.push((window.id.clone(), reason.to_string())),
        }
    }
    events.sort_by(|a, b| a.id.cmp(&b.id));
    (events, refused)
}

pub(super) fn split(
    events: Vec<PreparedEvent>,
    split: &Split,
) -> Result<(Vec<PreparedEvent>, Vec<PreparedEvent>), IdentificationError> {
    match split {
        Split::Share(share) => {
            let keys: Vec<(&str, f64)> = events
                .iter()
                .map(|e| (e.id.as_str(), e.lowest_voltage))
                .collect();
            let chosen = held_out(&keys, *share);
            let (mut fitted, mut held) = (Vec::new(), Vec::new());
            for (i, event) in events.into_iter().enumerate() {
                if chosen.contains(&i) {
                    held.push(event);
                } else {
                    fitted.push(event);
                }
            }
            Ok((fitted, held))
        }
        Split::Named { fitted, held_out } => {
            for name in fitted.iter().chain(held_out) {
                if !events.iter().any(|e| e.id == *name) {
                    let usable: Vec<&str> = events.iter().map(|e| e.id.as_str()).collect();
                    return Err(IdentificationError::UnknownEvent {
                        event: name.clone(),
                        usable: usable.join(", "),
                    });
                }
            }
            let take = |names: &[String]| {
                events
                    .iter()
                    .filter(|e| names.contains(&e.id))
                    .cloned()
                    .collect::<Vec<_>>()
            };
            let fit = if fitted.is_empty() {
                events
                    .iter()
                    .filter(|e| !held_out.contains(&e.id))
                    .cloned()
                    .collect()
            } else {
                take(fitted)
            };
            if fit.is_empty() {
                return Err(IdentificationError::NoUsableEvent {
                    refused: Vec::new(),
                });
            }
            Ok((fit, take(held_out)))
        }
    }
}

/// The operating point to which a set fitted to these events refers.
#[must_use]
pub fn median_operating_point(events: &[PreparedEvent]) -> OperatingPoint {
    let median = |value: fn(&PreparedEvent) -> f64| {
        let mut values: Vec<f64> = events.iter().map(value).collect();
        values.sort_by(f64::total_cmp);
        let (a, b) = (values[(values.len() - 1) / 2], values[values.len() / 2]);
        0.5 * (a + b)
    };
    OperatingPoint {
        v0_pu: median(|e| e.v0_pu),
        p0_pu: median(|e| e.p0_pu),
        q0_pu: median(|e| e.q0_pu),
    }
}

pub(super) fn reduced_chi_square(best: &FitSolution, events: &[PreparedEvent]) -> f64 {
    let rows: usize = events.iter().map(PreparedEvent::rows).sum();
    let freedom = rows.saturating_sub(OUTER + LINEAR).max(1) as f64;
    2.0 * best.point.objective / freedom
}

fn determined(estimates: &Estimates, name: &str) -> bool {
    estimates
        .parameters
        .iter()
        .any(|p| p.name == name && p.identifiable)
}

fn derived(estimates: &Estimates, name: &str) -> f64 {
    let found = estimates.derived.iter().find(|d| d.name == name);
    found.map_or(f64::NAN, |d| d.value)
}

fn solution_records(
    fit: &Fit,
    problem: &ProblemOptions,
    operating_point: &OperatingPoint,
    nominal_hz: f64,
) -> Vec<Solution> {
    fit.solutions
        .iter()
        .map(|solution| {
            let precision = Precision::of_noise(solution, 1.0);
            let named =
                estimates::estimates(solution, problem, operating_point, nominal_hz, &precision);
            let coordinates = solution
                .found
                .local
                .x
                .iter()
                .copied()
                .chain(solution.point.linear);
            Solution {
                id: solution.found.id,
                tier: solution.found.tier,
                found_from: solution.found.found_from,
                direction: solution.found.direction,
                objective: solution.point.objective,
                parameters: (named.parameters.into_iter())
                    .map(|p| {
                        let value = paper_value(solution, &p.name).unwrap_or(p.value);
                        (p.name, value)
                    })
                    .collect(),
                coordinates: estimates::coordinate_names()
                    .into_iter()
                    .map(str::to_owned)
                    .zip(coordinates)
                    .collect(),
                at_bound: match &solution.paper {
                    Some((_, active)) => active.clone(),
                    None => estimates::names_at_bound(solution),
                },
            }
        })
        .collect()
}

/// A parameter where the paper's formulation put it; elsewhere the null direction leaves it open.
fn paper_value(solution: &FitSolution, name: &str) -> Option<f64> {
    let (nine, _) = solution.paper.as_ref()?;
    let value = |name: &str| {
        let index = (0..PAPER).find(|&i| PAPER_NAMES[i] == name)?;
        Some(nine[index])
    };
    match name {
        "Pi" => Some(1.0 - value("Pz")? - value("Pp")?),
        "Qi" => Some(1.0 - value("Qz")? - value("Qq")?),
        _ => value(name),
    }
}

fn assemble(
    site: &Site,
    structure: &Structure,
    (estimates, precision): (Estimates, &Precision),
    operating_point: OperatingPoint,
    (fitted, fit): (&[PreparedEvent], ErrorSummary),
    (held, held_out): (&[PreparedEvent], Option<ErrorSummary>),
    verdict: Verdict,
) -> ParameterSet {
    let ids = |events: &[PreparedEvent]| events.iter().map(|e| e.id.clone()).collect();
    ParameterSet {
        site: site.name.clone(),
        version: 0,
        structure: structure.names(),
        structure_versions: structure.versions(),
        parameters: estimates.parameters,
        derived: estimates.derived,
        bases: Bases {
            s_base_mva: site.s_base_mva,
            v_base_kv: site.v_base_kv,
            nominal_hz: site.nominal_hz,
        },
        operating_point,
        fitted_events: ids(fitted),
        held_out_events: ids(held),
        fit,
        held_out,
        verdict,
        rank: estimates.rank,
        condition: estimates.condition,
        inflation: precision.inflation.to_vec(),
        notes: estimates.notes,
        software_version: env!("CARGO_PKG_VERSION").to_owned(),
    }
}
