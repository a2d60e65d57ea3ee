//! The reference paper's own form: nine parameters (11) in the box (14), V0 = P0 = 1.

use loadmodeld::{
    identification::{intake::PreparedEvent, joint_problem::OUTER},
    load_model::MotorOutput,
    numerics::{Dual, Scalar},
};
use nalgebra::{DMatrix, DVector};

use crate::reduced_form::{reactive_at_rest, rows, weighted, with_sensitivities};

/// M, T0', X, X', Kpm, Pz, Pp, Qz, Qp.
pub const PARAMETERS: usize = 9;
type Jet = Dual<PARAMETERS>;

/// Lower and upper bounds (14).
pub const BOUNDS: [[f64; PARAMETERS]; 2] = [
    [0.001, 0.001, 0.001, 0.001, 0.1, 0.1, 0.1, 0.1, 0.1],
    [10.0, 4.0, 4.0, 4.0, 0.95, 0.9, 0.9, 0.9, 4.0],
];

/// Why the residuals do not exist.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Undefined {
    /// `X' < X` or (13) is violated.
    Infeasible,
    /// The simulation is not finite.
    NotFinite,
}

/// The coordinates of the simulation and the linear coefficients, with their derivatives.
fn coordinates(theta: &[f64], q0_over_p0: f64) -> Result<([Jet; OUTER], [Jet; 5]), Undefined> {
    let [m, t0, x, xp, kpm, p_z, p_p, q_z, q_p] =
        std::array::from_fn::<_, PARAMETERS, _>(|i| Jet::variable(theta[i], i));
    let one = Jet::constant(1.0);
    let strength = one / xp - one / x;
    if !(strength.value() > 0.0) {
        return Err(Undefined::Infeasible);
    }
    let kappa = kpm * 2.0 / strength; // (13)
    if !(kappa.value() < 1.0) {
        return Err(Undefined::Infeasible);
    }
    // Value ln y, derivative y'/y.
    let logarithm = |y: Jet| y * (1.0 / y.value()) + (y.value().ln() - 1.0);
    let outer = [logarithm(x / (xp * t0)), logarithm(strength / m), kappa];
    let p_zip0 = one - kpm;
    let q_zip0 = Jet::constant(q0_over_p0) - one / x - kpm * reactive_at_rest(kappa); // (12)
    let linear = [
        kpm,
        p_z * p_zip0,
        (one - p_z - p_p) * p_zip0,
        q_z * q_zip0 + one / x,
        (one - q_z - q_p) * q_zip0,
    ];
    Ok((outer, linear))
}

/// Weighted residuals (model minus measurement, P samples then Q samples) and their Jacobian.
pub fn residuals_and_jacobian(
    event: &PreparedEvent,
    theta: &[f64],
) -> Result<(DVector<f64>, DMatrix<f64>), Undefined> {
    let (outer, linear) = coordinates(theta, event.q0_pu / event.p0_pu)?;
    let motor = with_sensitivities(&outer.map(Scalar::value));
    let mut out = MotorOutput::default();
    (motor.simulate(&event.input, &mut out)).map_err(|_| Undefined::Infeasible)?;
    let rest = reactive_at_rest(motor.kappa);
    let beta = linear.map(Scalar::value);
    let n = event.len();
    let mut jacobian = DMatrix::zeros(2 * n, PARAMETERS);
    let residuals = weighted(event, |k| {
        let (active, reactive) = (out.active[k], out.reactive[k] - rest);
        let rows = rows(event.voltage[k], active.value(), reactive.value());
        let slopes = [active.derivatives, reactive.derivatives];
        let deviations = [event.active_deviation[k], event.reactive_deviation[k]];
        for channel in 0..2 {
            for i in 0..PARAMETERS {
                let by_outer: f64 = (0..OUTER)
                    .map(|j| beta[0] * slopes[channel][j] * outer[j].derivatives[i])
                    .sum();
                let by_linear: f64 = (0..5)
                    .map(|j| rows[channel][j] * linear[j].derivatives[i])
                    .sum();
                jacobian[(channel * n + k, i)] = (by_outer + by_linear) / deviations[channel];
            }
        }
        rows.map(|row| row.iter().zip(beta).map(|(a, b)| a * b).sum())
    });
    if residuals
        .iter()
        .chain(jacobian.iter())
        .all(|r| r.is_finite())
    {
        Ok((residuals, jacobian))
    } else {
        Err(Undefined::NotFinite)
    }
}

/// Half the sum of squared residuals, without derivatives.
pub fn value(event: &PreparedEvent, theta: &[f64]) -> Result<f64, Undefined> {
    let (outer, linear) = coordinates(theta, event.q0_pu / event.p0_pu)?;
    let x = DVector::from_fn(OUTER, |i, _| outer[i].value());
    let motor = loadmodeld::identification::joint_problem::motor_coordinates(&x);
    let mut out = MotorOutput::default();
    (motor.simulate(&event.input, &mut out)).map_err(|_| Undefined::Infeasible)?;
    let rest = reactive_at_rest(motor.kappa);
    let beta = linear.map(Scalar::value);
    let residuals = weighted(event, |k| {
        rows(event.voltage[k], out.active[k], out.reactive[k] - rest)
            .map(|row| row.iter().zip(beta).map(|(a, b)| a * b).sum())
    });
    let value = 0.5 * residuals.norm_squared();
    if value.is_finite() {
        Ok(value)
    } else {
        Err(Undefined::NotFinite)
    }
}
