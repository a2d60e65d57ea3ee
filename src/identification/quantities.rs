//! What is reported of a solution, each quantity as a function of the coordinates the data determine
//! and of the reactance along the null direction.

use nalgebra::DVector;

use super::joint_problem::{LINEAR, OUTER};
use crate::load_model::{LinearCoefficients, LoadBase, MotorCoordinates, ZipImParameters};

/// Reactance on the motor's own base that stands for the null direction. Chosen: the middle of
/// 2.5 to 4 given for aggregated motors in the WECC composite load model records; any value
/// describes P and Q equally well.
pub(super) const X_MOTOR_BASE: f64 = 3.0;
/// Plausible range of that reactance on the motor's own base: what bounds the published interval.
pub(super) const X_MOTOR_BASE_RANGE: (f64, f64) = (1.0, 6.0);

/// One reported quantity as a function of the coordinates.
pub(super) struct Quantity {
    pub(super) name: &'static str,
    pub(super) meaning: &'static str,
    pub(super) unit: &'static str,
    pub(super) bounds: (f64, f64),
    /// Whether it moves along the null direction.
    pub(super) in_valley: bool,
    pub(super) value: fn(&ZipImParameters) -> f64,
}

/// The paper's parameters (11) and the two shares that the sum rule leaves.
pub(super) const PARAMETERS: &[Quantity] = &[
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

/// Quantities in a study engineer's units.
pub(super) const DERIVED: &[Quantity] = &[
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

/// The parameters at `coordinates` (three outer, five linear unknowns) with the reactance
/// `x_motor_base` on the motor's own base.
pub(super) fn parameters_at(
    coordinates: &[f64],
    x_motor_base: f64,
    base: &LoadBase,
) -> ZipImParameters {
    let motor = MotorCoordinates {
        alpha_per_s: coordinates[0].exp(),
        nu_per_s2: coordinates[1].exp(),
        kappa: coordinates[2],
    };
    let mut linear = [0.0; LINEAR];
    linear.copy_from_slice(&coordinates[OUTER..OUTER + LINEAR]);
    let linear = LinearCoefficients::from_array(linear);
    ZipImParameters::new(&motor, &linear, base, x_motor_base)
}

/// Central differences: the conversions are smooth and cheap.
pub(super) fn gradient(at: &[f64], value: impl Fn(&[f64]) -> f64) -> DVector<f64> {
    DVector::from_fn(at.len(), |i, _| {
        let h = 1e-6 * at[i].abs().max(1e-2);
        let mut moved = at.to_vec();
        moved[i] = at[i] + h;
        let above = value(&moved);
        moved[i] = at[i] - h;
        (above - value(&moved)) / (2.0 * h)
    })
}
