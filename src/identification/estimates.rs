//! From a solution to named parameters with standard errors, bounds and the valley that the data
//! leave open.

use nalgebra::{DMatrix, DVector};

use super::{
    OperatingPoint, ParameterEstimate,
    fit::FitSolution,
    joint_problem::{LINEAR, OUTER, OUTER_NAMES, ProblemOptions, outer_bounds},
};
use crate::load_model::{LinearCoefficients, LoadBase, MotorCoordinates, ZipImParameters};

/// Reactance on the motor's own base that stands for the null direction. Chosen: the middle of
/// 2.5 to 4 given for aggregated motors in the WECC composite load model records; any value
/// describes P and Q equally well.
const X_MOTOR_BASE: f64 = 3.0;
/// Plausible range of that reactance on the motor's own base: what bounds the published interval.
const X_MOTOR_BASE_RANGE: (f64, f64) = (1.0, 6.0);
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
}

/// One reported quantity as a function of the coordinates.
struct Quantity {
    name: &'static str,
    meaning: &'static str,
    unit: &'static str,
    bounds: (f64, f64),
    /// Whether it moves along the null direction.
    in_valley: bool,
    value: fn(&ZipImParameters) -> f64,
}

const PARAMETERS: &[Quantity] = &[
    quantity(
        "M",
        "motor inertia",
        "pu s^2/rad",
        (0.0, 10.0),
        false,
        |p| p.m,
    ),
    quantity(
        "T0_prime",
        "transient open-circuit time constant",
        "s",
        (0.001, 4.0),
        true,
        |p| p.t0_prime_s,
    ),
    quantity(
        "X",
        "motor reactance Xs + Xm",
        "pu",
        (0.001, 20.0),
        true,
        |p| p.x_pu,
    ),
    quantity(
        "X_prime",
        "motor transient reactance",
        "pu",
        (0.001, 4.0),
        true,
        |p| p.x_prime_pu,
    ),
    quantity(
        "Kpm",
        "motor share of the active power",
        "1",
        (0.02, 0.95),
        false,
        |p| p.kpm,
    ),
    quantity(
        "Pz",
        "constant-impedance share of static P",
        "1",
        (-2.0, 3.0),
        false,
        |p| p.p_shares[0],
    ),
    quantity(
        "Pi",
        "constant-current share of static P",
        "1",
        (-2.0, 3.0),
        false,
        |p| p.p_shares[1],
    ),
    quantity(
        "Pp",
        "constant-power share of static P",
        "1",
        (-2.0, 3.0),
        false,
        |p| p.p_shares[2],
    ),
    quantity(
        "Qz",
        "constant-impedance share of static Q",
        "1",
        (-20.0, 20.0),
        true,
        |p| p.q_shares[0],
    ),
    quantity(
        "Qi",
        "constant-current share of static Q",
        "1",
        (-20.0, 20.0),
        true,
        |p| p.q_shares[1],
    ),
    quantity(
        "Qq",
        "constant-power share of static Q",
        "1",
        (-20.0, 20.0),
        true,
        |p| p.q_shares[2],
    ),
];

const DERIVED: &[Quantity] = &[
    quantity(
        "inertia_h",
        "inertia constant on the motor's own power",
        "s",
        (0.0, 10.0),
        false,
        |p| p.inertia_h_s,
    ),
    quantity(
        "x_motor_base",
        "X on the motor's own power",
        "pu",
        X_MOTOR_BASE_RANGE,
        true,
        |p| p.x_motor_base,
    ),
    quantity(
        "x_prime_motor_base",
        "X' on the motor's own power",
        "pu",
        (0.001, 1.0),
        true,
        |p| p.x_prime_motor_base,
    ),
    quantity(
        "slip",
        "slip before the disturbance",
        "1",
        (0.0, 1.0),
        false,
        |p| p.slip,
    ),
    quantity(
        "critical_voltage",
        "static pull-out voltage",
        "pu of V0",
        (0.0, 1.0),
        false,
        |p| p.critical_voltage,
    ),
    quantity(
        "P_ZIP0",
        "static active power before the disturbance",
        "pu",
        (0.0, 10.0),
        false,
        |p| p.p_zip0_pu,
    ),
    quantity(
        "Q_ZIP0",
        "static reactive power, capacitors included",
        "pu",
        (-10.0, 10.0),
        true,
        |p| p.q_zip0_pu,
    ),
];

const fn quantity(
    name: &'static str,
    meaning: &'static str,
    unit: &'static str,
    bounds: (f64, f64),
    in_valley: bool,
    value: fn(&ZipImParameters) -> f64,
) -> Quantity {
    Quantity {
        name,
        meaning,
        unit,
        bounds,
        in_valley,
        value,
    }
}

/// Names the parameters of a solution at an operating point. `reduced_chi_square` scales the
/// standard errors where the fit is worse than the assumed noise.
#[must_use]
pub fn estimates(
    solution: &FitSolution,
    options: &ProblemOptions,
    operating_point: &OperatingPoint,
    nominal_hz: f64,
    reduced_chi_square: f64,
) -> Estimates {
    let base = LoadBase {
        v0_pu: operating_point.v0_pu,
        p0_pu: operating_point.p0_pu,
        q0_pu: operating_point.q0_pu,
        nominal_hz,
    };
    let coordinates = coordinates_of(solution);
    let (covariance, rank, condition) = covariance(solution, reduced_chi_square.max(1.0));
    let at = |x: &[f64], x_own: f64| {
        let motor = MotorCoordinates {
            alpha_per_s: x[0].exp(),
            nu_per_s2: x[1].exp(),
            kappa: x[2],
        };
        let mut linear = [0.0; LINEAR];
        linear.copy_from_slice(&x[OUTER..]);
        ZipImParameters::new(
            &motor,
            &LinearCoefficients::from_array(linear),
            &base,
            x_own,
        )
    };
    let report = |quantity: &Quantity| {
        let value_at = |x: &[f64], x_own| (quantity.value)(&at(x, x_own));
        let slope = gradient(&coordinates, |x| value_at(x, X_MOTOR_BASE));
        let variance = (slope.transpose() * &covariance * &slope)[0];
        let error = variance.sqrt();
        let interval =
            (quantity.in_valley).then(|| valley(quantity, |x_own| at(&coordinates, x_own)));
        let width = quantity.bounds.1 - quantity.bounds.0;
        let determined = error.is_finite() && error < DETERMINED_SHARE * width;
        ParameterEstimate {
            name: quantity.name.to_owned(),
            meaning: quantity.meaning.to_owned(),
            value: value_at(&coordinates, X_MOTOR_BASE),
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
    mark_bounds(&mut parameters, solution);
    let mut derived: Vec<ParameterEstimate> = DERIVED.iter().map(&report).collect();
    derived.extend(coordinate_estimates(
        solution,
        options,
        &coordinates,
        &covariance,
    ));
    Estimates {
        parameters,
        derived,
        rank,
        condition,
    }
}

/// Range of a quantity along the null direction. Where the static reactive power passes through zero
/// on the way its shares pass through infinity: nothing can be said of them.
fn valley(quantity: &Quantity, at: impl Fn(f64) -> ZipImParameters) -> (f64, f64) {
    const POINTS: u32 = 40;
    let (from, to) = X_MOTOR_BASE_RANGE;
    let points: Vec<ZipImParameters> = (0..=POINTS)
        .map(|i| at(from + (to - from) * f64::from(i) / f64::from(POINTS)))
        .collect();
    let sign = |p: &ZipImParameters| p.q_zip0_pu > 0.0;
    let is_share = ["Qz", "Qi", "Qq"].contains(&quantity.name);
    if is_share && points.iter().any(|p| sign(p) != sign(&points[0])) {
        return quantity.bounds;
    }
    let values = points.iter().map(quantity.value);
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    })
}

fn coordinates_of(solution: &FitSolution) -> Vec<f64> {
    solution
        .found
        .local
        .x
        .iter()
        .copied()
        .chain(solution.point.linear)
        .collect()
}

/// Covariance of outer and linear unknowns; those on a bound are held. Rank and condition refer to
/// the information matrix scaled to a unit diagonal.
fn covariance(solution: &FitSolution, scale: f64) -> (DMatrix<f64>, usize, f64) {
    let size = OUTER + LINEAR;
    let held = held(solution);
    let free: Vec<usize> = (0..size).filter(|&i| !held[i]).collect();
    if free.is_empty() {
        // Every unknown on a bound: the data determine nothing.
        return (
            DMatrix::from_element(size, size, f64::NAN),
            0,
            f64::INFINITY,
        );
    }
    let information = &solution.point.information;
    let deviation: Vec<f64> = free
        .iter()
        .map(|&i| information[(i, i)].max(1e-300).sqrt())
        .collect();
    let scaled = DMatrix::from_fn(free.len(), free.len(), |i, j| {
        information[(free[i], free[j])] / (deviation[i] * deviation[j])
    });
    let eigen = scaled.symmetric_eigen();
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    // 1e-10 of the largest eigenvalue: below that, rounding of the Gram sums decides.
    let known: Vec<bool> = eigen
        .eigenvalues
        .iter()
        .map(|e| *e > 1e-10 * largest)
        .collect();
    let rank = known.iter().filter(|k| **k).count();
    let smallest = eigen
        .eigenvalues
        .iter()
        .zip(&known)
        .filter(|(_, known)| **known)
        .map(|(e, _)| *e)
        .fold(f64::INFINITY, f64::min);
    let mut covariance = DMatrix::zeros(size, size);
    for (e, vector) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        // A direction the data leave open has no finite variance.
        let variance = if *e > 1e-10 * largest {
            scale / e
        } else {
            f64::INFINITY
        };
        for i in 0..free.len() {
            for j in 0..free.len() {
                let product = vector[i] * vector[j];
                if product != 0.0 {
                    covariance[(free[i], free[j])] +=
                        variance * product / (deviation[i] * deviation[j]);
                }
            }
        }
    }
    (covariance, rank, (largest / smallest).sqrt())
}

fn held(solution: &FitSolution) -> Vec<bool> {
    let bounds = outer_bounds();
    let x = &solution.found.local.x;
    let spans = bounds.spans();
    (0..OUTER)
        .map(|i| {
            let close = 1e-9 * spans[i];
            x[i] - bounds.lower[i] <= close || bounds.upper[i] - x[i] <= close
        })
        .chain(solution.point.linear_at_bound)
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

fn mark_bounds(parameters: &mut [ParameterEstimate], solution: &FitSolution) {
    let held = held(solution);
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
    solution: &FitSolution,
    options: &ProblemOptions,
    coordinates: &[f64],
    covariance: &DMatrix<f64>,
) -> Vec<ParameterEstimate> {
    let bounds = outer_bounds();
    let held = held(solution);
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

/// Central differences: the conversion is smooth and cheap.
fn gradient(at: &[f64], value: impl Fn(&[f64]) -> f64) -> DVector<f64> {
    DVector::from_fn(at.len(), |i, _| {
        let h = 1e-6 * at[i].abs().max(1e-2);
        let mut moved = at.to_vec();
        moved[i] = at[i] + h;
        let above = value(&moved);
        moved[i] = at[i] - h;
        (above - value(&moved)) / (2.0 * h)
    })
}
