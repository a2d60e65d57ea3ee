//! From a solution to named parameters with standard errors, bounds and the valley that the data
//! leave open.

use nalgebra::DMatrix;

use super::{
    OperatingPoint, ParameterEstimate,
    fit::FitSolution,
    joint_problem::{LINEAR, OUTER, OUTER_NAMES, ProblemOptions, outer_bounds},
    plausibility,
    precision::{Precision, held},
    quantities::{DERIVED, PARAMETERS, Quantity, gradient, parameters_at},
    valley::Valley,
};
use crate::load_model::LoadBase;

/// A parameter counts as determined when its standard error is below this share of the width of
/// its bounds.
const DETERMINED_SHARE: f64 = 0.25;

/// Parameters, derived quantities, rank and condition of a solution.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimates {
    /// The paper's parameters.
    pub parameters: Vec<ParameterEstimate>,
    /// Engineering units and identifiable coordinates.
    pub derived: Vec<ParameterEstimate>,
    /// Rank of the scaled sensitivity matrix of the eight identifiable directions.
    pub rank: usize,
    /// Its condition number.
    pub condition: f64,
    /// What a reader should know of single values: implausible ones, open directions.
    pub notes: Vec<String>,
}

/// The eight coordinates of ZIP and motor at a solution of any structure.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Located {
    /// Three outer and five linear unknowns.
    pub(super) coordinates: Vec<f64>,
    /// Which of them lie on a bound.
    pub(super) held: Vec<bool>,
}

impl From<&FitSolution> for Located {
    fn from(solution: &FitSolution) -> Self {
        Self {
            coordinates: coordinates_of(solution),
            held: held(solution),
        }
    }
}

/// Names the parameters of a solution at an operating point.
#[must_use]
pub fn estimates(
    solution: &FitSolution,
    options: &ProblemOptions,
    operating_point: &OperatingPoint,
    nominal_hz: f64,
    precision: &Precision,
) -> Estimates {
    let located = Located::from(solution);
    estimates_at(&located, options, operating_point, nominal_hz, precision)
}

/// The same for the coordinates of a solution of any structure.
pub(super) fn estimates_at(
    located: &Located,
    options: &ProblemOptions,
    operating_point: &OperatingPoint,
    nominal_hz: f64,
    precision: &Precision,
) -> Estimates {
    let base = LoadBase {
        v0_pu: operating_point.v0_pu,
        p0_pu: operating_point.p0_pu,
        q0_pu: operating_point.q0_pu,
        nominal_hz,
    };
    let coordinates = &located.coordinates;
    let covariance = &precision.covariance;
    let at = |x: &[f64], x_own: f64| parameters_at(x, x_own, &base);
    let valley = Valley::new(
        |x_own| at(coordinates, x_own),
        options.static_shares.is_some(),
    );
    let x_own = valley.representative();
    let report = |quantity: &Quantity| {
        let value_at = |x: &[f64]| (quantity.value)(&at(x, x_own));
        let slope = gradient(coordinates, value_at);
        let variance = (slope.transpose() * covariance * &slope)[0];
        let error = variance.sqrt();
        let interval =
            (quantity.in_valley).then(|| valley.interval(quantity, |x| at(coordinates, x)));
        let width = quantity.bounds.1 - quantity.bounds.0;
        let determined = error.is_finite() && error < DETERMINED_SHARE * width;
        ParameterEstimate {
            name: quantity.name.to_owned(),
            meaning: quantity.meaning.to_owned(),
            value: value_at(coordinates),
            unit: quantity.unit.to_owned(),
            lower: quantity.bounds.0,
            upper: quantity.bounds.1,
            standard_error: (determined && !quantity.in_valley).then_some(error),
            at_bound: false,
            identifiable: determined && !quantity.in_valley,
            interval,
        }
    };
    let mut parameters: Vec<ParameterEstimate> = PARAMETERS.iter().map(&report).collect();
    mark_bounds(&mut parameters, &located.held);
    let mut derived: Vec<ParameterEstimate> = DERIVED.iter().map(&report).collect();
    derived.extend(coordinate_estimates(located, options, covariance));
    let free = located.held.iter().filter(|held| !**held).count();
    let mut notes = plausibility::notes(&parameters, &derived);
    notes.extend(plausibility::precision_notes(precision, free));
    if !valley.within_boxes {
        notes.push(
            "no reactance of the plausible range meets the boxes of T0', X and X'".to_owned(),
        );
    }
    Estimates {
        parameters,
        derived,
        rank: precision.rank,
        condition: precision.condition,
        notes,
    }
}

/// The eight coordinates of a solution: three outer, five linear.
pub(super) fn coordinates_of(solution: &FitSolution) -> Vec<f64> {
    solution
        .found
        .local
        .x
        .iter()
        .copied()
        .chain(solution.point.linear)
        .collect()
}

/// Names of the coordinates, in order.
pub(super) fn coordinate_names() -> Vec<&'static str> {
    OUTER_NAMES
        .iter()
        .copied()
        .chain(["Kpm", "c_z", "c_i", "d_z", "d_i"])
        .collect()
}

/// Names of the coordinates on a bound.
pub(super) fn names_at_bound(solution: &FitSolution) -> Vec<String> {
    coordinate_names()
        .into_iter()
        .zip(held(solution))
        .filter(|(_, held)| *held)
        .map(|(name, _)| name.to_owned())
        .collect()
}

fn mark_bounds(parameters: &mut [ParameterEstimate], held: &[bool]) {
    let depends = |name: &str| -> &[usize] {
        match name {
            "M" => &[1, 2],
            "T0_prime" => &[0, 2],
            "X_prime" => &[2],
            "Kpm" => &[3],
            "Pz" => &[4],
            "Pi" => &[5],
            "Qz" => &[6],
            "Qi" => &[7],
            _ => &[],
        }
    };
    for parameter in parameters {
        parameter.at_bound = depends(&parameter.name).iter().any(|&i| held[i]);
        if parameter.at_bound {
            // The bound decided, not the data.
            parameter.standard_error = None;
            parameter.identifiable = false;
        }
    }
}

/// The identifiable coordinates themselves: what the data determine.
fn coordinate_estimates(
    located: &Located,
    options: &ProblemOptions,
    covariance: &DMatrix<f64>,
) -> Vec<ParameterEstimate> {
    let bounds = outer_bounds();
    let Located { coordinates, held } = located;
    let meanings = [
        "ln of alpha = X/(X' T0'), 1/s",
        "ln of nu = (1/X' - 1/X)/M on the motor's own base, 1/s^2",
        "loading 2 X X' Kpm P0/((X - X') V0^2) of (13)",
        "motor share of P0",
        "static P: coefficient of v^2, of P0",
        "static P: coefficient of v, of P0",
        "Q: coefficient of v^2 with the motor's Kpm/X, of P0",
        "Q: coefficient of v, of P0",
    ];
    (0..OUTER + LINEAR)
        .map(|i| {
            let (lower, upper) = if i < OUTER {
                (bounds.lower[i], bounds.upper[i])
            } else {
                (
                    options.linear_lower[i - OUTER],
                    options.linear_upper[i - OUTER],
                )
            };
            let error = covariance[(i, i)].sqrt();
            let determined =
                !held[i] && error.is_finite() && error < DETERMINED_SHARE * (upper - lower);
            ParameterEstimate {
                name: format!("coordinate_{}", coordinate_names()[i]),
                meaning: meanings[i].to_owned(),
                value: coordinates[i],
                unit: "1".to_owned(),
                lower,
                upper,
                standard_error: determined.then_some(error),
                at_bound: held[i],
                identifiable: determined,
                interval: None,
            }
        })
        .collect()
}
