//! The reference paper's own formulation: nine parameters (11) in the box (14) under (13).
//!
//! The parameters refer to the load base at the median operating point of the events, and an event
//! with another load or voltage has the same motor on its own base: the model of
//! [`JointProblem`], only with its eight coordinates written as functions of nine parameters.
//! With `G = 1/X' - 1/X` and `b = Kpm P0 / V0^2`
//!
//! ```text
//! alpha = X / (X' T0'),  nu = V0^2 G / M,  kappa = 2 b / G                       (9), (12)
//! c_z = Pz (1 - Kpm),  c_i = (1 - Pz - Pp)(1 - Kpm)                              (10)
//! q   = Q0/P0 - Kpm (1/(b X) + G/(2b) (1 - sqrt(1 - kappa^2)))                   Q_ZIP0 / P0
//! d_z = Qz q + Kpm/(b X),  d_i = (1 - Qz - Qq) q                                 (10)
//! ```
//!
//! Derivatives follow by the chain rule from the three sensitivities of the motor.

use nalgebra::{DMatrix, DVector};

use super::{
    OperatingPoint,
    joint_problem::{JointPoint, JointProblem, LINEAR, OUTER},
};
use crate::{
    load_model::{LinearCoefficients, LoadBase, MotorCoordinates, ZipImParameters},
    numerics::{Bounds, Dual, Expansion, Objective, Scalar, trust_tech::Constraints},
};

/// Number of parameters (11).
pub const PAPER: usize = 9;
/// Their names, in the order of (11).
pub const PAPER_NAMES: [&str; PAPER] = [
    "M", "T0_prime", "X", "X_prime", "Kpm", "Pz", "Pp", "Qz", "Qq",
];
/// The box (14).
const LOWER: [f64; PAPER] = [0.001, 0.001, 0.001, 0.001, 0.1, 0.1, 0.1, 0.1, 0.1];
const UPPER: [f64; PAPER] = [10.0, 4.0, 4.0, 4.0, 0.95, 0.9, 0.9, 0.9, 4.0];
/// Parameters that span decades: `M`, `T0'`, `X`, `X'`.
const DECADES: usize = 4;
/// Where (13) is drawn: at 1 itself the initial angle has no derivative. As in
/// [`outer_bounds`](super::joint_problem::outer_bounds).
const KAPPA_MAX: f64 = 0.995;
/// `X` on the motor's own base at which a start of the reduced formulation is taken into the box.
const START_X_MOTOR_BASE: f64 = 3.0;

/// Whether the four parameters that span decades are searched as they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// As they are: the paper's form. A hundredth of the box (14) is then 0.1 of `M`, 60 times the
    /// inertia of the motors in the paper's Table 1.
    Linear,
    /// In natural logarithms.
    Logarithmic,
}

/// A joint problem in the paper's parameters.
#[derive(Debug)]
pub struct PaperProblem<'a> {
    joint: &'a JointProblem<'a>,
    base: OperatingPoint,
    scale: Scale,
}

/// Motor coordinates and linear coefficients.
struct Mapped<S> {
    motor: MotorCoordinates<S>,
    linear: [S; LINEAR],
}

impl<'a> PaperProblem<'a> {
    /// `joint` in the paper's parameters at the operating point `base`.
    #[must_use]
    pub const fn new(joint: &'a JointProblem<'a>, base: OperatingPoint, scale: Scale) -> Self {
        Self { joint, base, scale }
    }

    /// The box (14) in search coordinates.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        Bounds {
            lower: self.to_search(&LOWER),
            upper: self.to_search(&UPPER),
        }
    }

    /// The nine parameters at a point of the search.
    #[must_use]
    pub fn parameters(&self, x: &DVector<f64>) -> [f64; PAPER] {
        std::array::from_fn(|i| if self.is_log(i) { x[i].exp() } else { x[i] })
    }

    /// Coordinates of the joint problem: the outer ones and the linear coefficients.
    #[must_use]
    pub fn coordinates(&self, x: &DVector<f64>) -> (DVector<f64>, [f64; LINEAR]) {
        let at = self.mapped(self.parameters(x));
        (outer(&at.motor), at.linear)
    }

    /// Everything at a point, in the joint problem's coordinates; bounds are the box's (14).
    pub fn point(&self, x: &DVector<f64>) -> Option<JointPoint> {
        let (outer, linear) = self.coordinates(x);
        let (mut point, _) = self.joint.point_at(&outer, linear)?;
        let active = self.active_bounds(x);
        let held = ["Kpm", "Pz", "Pp", "Qz", "Qq"].map(|name| active.iter().any(|a| a == name));
        point.linear_at_bound = held;
        Some(point)
    }

    /// Names of the parameters on a bound of (14), and `(13)` where that constraint is active.
    #[must_use]
    pub fn active_bounds(&self, x: &DVector<f64>) -> Vec<String> {
        let bounds = self.bounds();
        let spans = bounds.spans();
        let on_bound = |i: &usize| {
            let close = 1e-9 * spans[*i];
            x[*i] - bounds.lower[*i] <= close || bounds.upper[*i] - x[*i] <= close
        };
        let names = (0..PAPER).filter(on_bound).map(|i| PAPER_NAMES[i]);
        let kappa = self.mapped(self.parameters(x)).motor.kappa;
        let overloaded = (kappa >= KAPPA_MAX - 1e-6).then_some("(13)");
        names.chain(overloaded).map(str::to_owned).collect()
    }

    /// The point of the search nearest to a model of the joint problem.
    #[must_use]
    pub fn start(&self, motor: &MotorCoordinates<f64>, linear: [f64; LINEAR]) -> DVector<f64> {
        let base = LoadBase {
            v0_pu: self.base.v0_pu,
            p0_pu: self.base.p0_pu,
            q0_pu: self.base.q0_pu,
            nominal_hz: 50.0, // enters slip and H only, which are not used here
        };
        let linear = LinearCoefficients::from_array(linear);
        let p = ZipImParameters::new(motor, &linear, &base, START_X_MOTOR_BASE);
        let nine = [
            p.m,
            p.t0_prime_s,
            p.x_pu,
            p.x_prime_pu,
            p.kpm,
            p.p_shares[0],
            p.p_shares[2],
            p.q_shares[0],
            p.q_shares[2],
        ];
        let within: [f64; PAPER] = std::array::from_fn(|i| {
            let finite = if nine[i].is_finite() { nine[i] } else { 0.5 };
            finite.clamp(LOWER[i], UPPER[i])
        });
        self.to_search(&within)
    }

    const fn is_log(&self, i: usize) -> bool {
        i < DECADES && matches!(self.scale, Scale::Logarithmic)
    }

    fn to_search(&self, p: &[f64; PAPER]) -> DVector<f64> {
        DVector::from_fn(PAPER, |i, _| if self.is_log(i) { p[i].ln() } else { p[i] })
    }

    fn mapped<S: Scalar>(&self, p: [S; PAPER]) -> Mapped<S> {
        let [m, t0_prime, x, x_prime, kpm, p_z, p_p, q_z, q_q] = p;
        let one = S::constant(1.0);
        let v0_square = self.base.v0_pu * self.base.v0_pu;
        let g = one / x_prime - one / x;
        let b = kpm * (self.base.p0_pu / v0_square);
        let kappa = b * 2.0 / g; // (13)
        let root = (one - kappa * kappa).sqrt();
        let p_zip = one - kpm;
        let magnetising = kpm / (b * x);
        let q0 = S::constant(self.base.q0_pu / self.base.p0_pu);
        let q_zip = q0 - magnetising - kpm * (g / b) * (one - root) * 0.5;
        Mapped {
            motor: MotorCoordinates {
                alpha_per_s: x / (x_prime * t0_prime),
                nu_per_s2: g * v0_square / m,
                kappa,
            },
            linear: [
                kpm,
                p_z * p_zip,
                (one - p_z - p_p) * p_zip,
                q_z * q_zip + magnetising,
                (one - q_z - q_q) * q_zip,
            ],
        }
    }

    /// Derivatives of the joint problem's eight coordinates, 8 x 9.
    fn jacobian(&self, x: &DVector<f64>) -> DMatrix<f64> {
        let p = self.parameters(x);
        let at = self.mapped(std::array::from_fn(|i| Dual::<PAPER>::variable(p[i], i)));
        let rows: [Dual<PAPER>; OUTER + LINEAR] = {
            let motor = [at.motor.alpha_per_s, at.motor.nu_per_s2, at.motor.kappa];
            std::array::from_fn(|i| {
                if i < OUTER {
                    motor[i]
                } else {
                    at.linear[i - OUTER]
                }
            })
        };
        DMatrix::from_fn(OUTER + LINEAR, PAPER, |i, j| {
            // The first two coordinates are logarithms.
            let of_coordinate = if i < 2 { 1.0 / rows[i].value() } else { 1.0 };
            let of_parameter = if self.is_log(j) { p[j] } else { 1.0 };
            rows[i].derivatives[j] * of_coordinate * of_parameter
        })
    }
}

fn outer(motor: &MotorCoordinates<f64>) -> DVector<f64> {
    DVector::from_vec(vec![
        motor.alpha_per_s.ln(),
        motor.nu_per_s2.ln(),
        motor.kappa,
    ])
}

impl Objective for PaperProblem<'_> {
    fn dimension(&self) -> usize {
        PAPER
    }

    fn value(&self, x: &DVector<f64>) -> Option<f64> {
        let (outer, linear) = self.coordinates(x);
        // Without a steady state the logarithms do not exist either.
        let exists = outer.iter().all(|x| x.is_finite());
        (exists.then(|| self.joint.value_at(&outer, linear)))?
    }

    fn expansion(&self, x: &DVector<f64>) -> Option<Expansion> {
        let (outer, linear) = self.coordinates(x);
        if !outer.iter().all(|x| x.is_finite()) {
            return None;
        }
        let (point, linear_gradient) = self.joint.point_at(&outer, linear)?;
        let jacobian = self.jacobian(x);
        let gradient = DVector::from_iterator(
            OUTER + LINEAR,
            (point.gradient.iter())
                .chain(linear_gradient.iter())
                .copied(),
        );
        Some(Expansion {
            value: point.objective,
            gradient: jacobian.tr_mul(&gradient),
            curvature: jacobian.tr_mul(&point.information) * &jacobian,
        })
    }
}

/// `X' - X <= 0` and (13) as `2 X X' Kpm P0 / V0^2 - kappa_max (X - X') <= 0`, which exists at
/// `X = X'` too.
impl Constraints for PaperProblem<'_> {
    fn equalities(&self) -> usize {
        0
    }

    fn inequalities(&self) -> usize {
        2
    }

    fn values(&self, x: &DVector<f64>) -> Option<DVector<f64>> {
        let [_, _, reactance, transient, kpm, ..] = self.parameters(x);
        let load = 2.0 * self.base.p0_pu / (self.base.v0_pu * self.base.v0_pu);
        let margin = reactance - transient;
        Some(DVector::from_vec(vec![
            -margin,
            load * reactance * transient * kpm - KAPPA_MAX * margin, // (13)
        ]))
    }

    fn jacobian(&self, x: &DVector<f64>) -> Option<DMatrix<f64>> {
        let [_, _, reactance, transient, kpm, ..] = self.parameters(x);
        let load = 2.0 * self.base.p0_pu / (self.base.v0_pu * self.base.v0_pu);
        let mut rows = DMatrix::zeros(2, PAPER);
        rows[(0, 2)] = -1.0;
        rows[(0, 3)] = 1.0;
        rows[(1, 2)] = load * transient * kpm - KAPPA_MAX;
        rows[(1, 3)] = load * reactance * kpm + KAPPA_MAX;
        rows[(1, 4)] = load * reactance * transient;
        for (column, value) in [(2, reactance), (3, transient)] {
            if self.is_log(column) {
                rows.column_mut(column).scale_mut(value);
            }
        }
        Some(rows)
    }
}
