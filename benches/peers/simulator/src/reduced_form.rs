//! Residuals of the reduced problem: three nonlinear unknowns, the linear coefficients at their
//! constrained optimum (variable projection).

use loadmodeld::{
    identification::{
        intake::PreparedEvent,
        joint_problem::{LINEAR, OUTER, ProblemOptions},
    },
    load_model::{MotorCoordinates, MotorOutput},
    numerics::{
        Bounds, Dual, Scalar,
        quadratic_program::{LinearConstraints, QuadraticProgram},
    },
};
use nalgebra::{DMatrix, DVector};

/// Reactive power at rest on the motor's own power, without the part in 1/x (12).
pub fn reactive_at_rest<S: Scalar>(kappa: S) -> S {
    let root = (S::constant(1.0) - kappa * kappa).sqrt();
    (S::constant(1.0) - root) / kappa
}

/// The columns of the linear model (10) at sample `k`, P row then Q row.
pub fn rows(voltage: f64, active: f64, reactive_change: f64) -> [[f64; 5]; 2] {
    let (square, line) = (voltage * voltage - 1.0, voltage - 1.0);
    [
        [active - 1.0, square, line, 0.0, 0.0],
        [reactive_change, 0.0, 0.0, square, line],
    ]
}

/// The motor with its sensitivities.
pub fn with_sensitivities(x: &[f64]) -> MotorCoordinates<Dual<OUTER>> {
    MotorCoordinates {
        alpha_per_s: Dual::<OUTER>::variable(x[0], 0).exp(),
        nu_per_s2: Dual::<OUTER>::variable(x[1], 1).exp(),
        kappa: Dual::<OUTER>::variable(x[2], 2),
    }
}

/// Weighted residuals (model minus measurement, P samples then Q samples) at the best linear
/// coefficients, and their Jacobian in Kaufman's form: what the free linear coefficients can follow
/// is projected out.
pub fn residuals_and_jacobian(
    event: &PreparedEvent,
    options: &ProblemOptions,
    x: &[f64],
) -> Option<(DVector<f64>, DMatrix<f64>)> {
    let motor = with_sensitivities(x);
    let mut out = MotorOutput::default();
    motor.simulate(&event.input, &mut out).ok()?;
    let rest = reactive_at_rest(motor.kappa);
    let n = event.len();
    let mut slopes = DMatrix::zeros(2 * n, OUTER);
    let mut columns = DMatrix::zeros(2 * n, LINEAR);
    // The residuals of a load that does not respond at all.
    let mut residuals = weighted(event, |_| [0.0; 2]);
    for k in 0..n {
        let (active, reactive) = (out.active[k], out.reactive[k] - rest);
        let rows = rows(event.voltage[k], active.value(), reactive.value());
        let derivatives = [active.derivatives, reactive.derivatives];
        let deviations = [event.active_deviation[k], event.reactive_deviation[k]];
        for channel in 0..2 {
            let at = channel * n + k;
            for i in 0..OUTER {
                slopes[(at, i)] = derivatives[channel][i] / deviations[channel];
            }
            for i in 0..LINEAR {
                columns[(at, i)] = rows[channel][i] / deviations[channel];
            }
        }
    }
    let (lower, upper) = (&options.linear_lower, &options.linear_upper);
    let program = QuadraticProgram {
        hessian: columns.tr_mul(&columns),
        gradient: columns.tr_mul(&residuals),
        bounds: Bounds {
            lower: DVector::from_column_slice(lower),
            upper: DVector::from_column_slice(upper),
        },
        equalities: LinearConstraints::none(LINEAR),
        inequalities: LinearConstraints::none(LINEAR),
    };
    let beta = program.minimise().ok()?.x;
    residuals += &columns * &beta;
    let free: Vec<usize> = (0..LINEAR)
        .filter(|&i| {
            let close = 1e-9 * (upper[i] - lower[i]);
            beta[i] - lower[i] > close && upper[i] - beta[i] > close
        })
        .collect();
    let jacobian = without(&columns.select_columns(&free), slopes * beta[0]);
    let finite = residuals
        .iter()
        .chain(jacobian.iter())
        .all(|r| r.is_finite());
    finite.then_some((residuals, jacobian))
}

/// `matrix` less its projection on the columns of `free`.
fn without(free: &DMatrix<f64>, matrix: DMatrix<f64>) -> DMatrix<f64> {
    if free.ncols() == 0 {
        return matrix;
    }
    let eigen = free.tr_mul(free).symmetric_eigen();
    let largest = eigen.eigenvalues.max();
    let mut rest = matrix;
    for i in 0..free.ncols() {
        // Columns that are all but dependent have nothing that the others lack.
        if eigen.eigenvalues[i] > 1e-12 * largest {
            let direction = free * eigen.eigenvectors.column(i) / eigen.eigenvalues[i].sqrt();
            let along = direction.tr_mul(&rest);
            rest -= direction * along;
        }
    }
    rest
}

/// `(model - measurement) / deviation` from the model's changes of P and Q against rest.
pub fn weighted(event: &PreparedEvent, mut change: impl FnMut(usize) -> [f64; 2]) -> DVector<f64> {
    let n = event.len();
    let q0 = event.q0_pu / event.p0_pu;
    let mut residuals = DVector::zeros(2 * n);
    for k in 0..n {
        let [active, reactive] = change(k);
        residuals[k] = (1.0 + active - event.active[k]) / event.active_deviation[k];
        residuals[n + k] = (q0 + reactive - event.reactive[k]) / event.reactive_deviation[k];
    }
    residuals
}
