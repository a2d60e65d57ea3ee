//! The composite ZIP and induction-motor model: equation (10) in the coordinates the data
//! determine, and the conversion to the reference paper's nine parameters (11).
//!
//! Normalised by V0 and P0, with `v = |u|` and the motor's output of
//! [`MotorCoordinates::simulate`](super::MotorCoordinates::simulate):
//!
//! ```text
//! P/P0 - 1      = Kpm (p - 1)   + c_z (v^2 - 1) + c_i (v - 1)         (10)
//! Q/P0 - Q0/P0  = Kpm (q - q_0) + d_z (v^2 - 1) + d_i (v - 1)         (10)
//! ```
//!
//! linear in the five coefficients. `d_z` holds the ZIP's own `Q_Z` and the motor's `Kpm / x`: the
//! two cannot be told apart from P and Q (the exact null direction). Nothing divides by `Q_ZIP0`.

use super::MotorCoordinates;
use std::f64::consts::PI;

/// The linear coefficients, all relative to P0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinearCoefficients {
    /// Motor share `Kpm` of P0.
    pub motor_share: f64,
    /// `c_z`: constant-impedance part of the static active power.
    pub active_quadratic: f64,
    /// `c_i`: constant-current part of the static active power.
    pub active_linear: f64,
    /// `d_z`: what grows with the square of the voltage in Q, motor magnetisation included.
    pub reactive_quadratic: f64,
    /// `d_i`: constant-current part of the static reactive power.
    pub reactive_linear: f64,
}

impl LinearCoefficients {
    /// Number of coefficients.
    pub const COUNT: usize = 5;

    /// In the order of the fields.
    #[must_use]
    pub const fn from_array(x: [f64; Self::COUNT]) -> Self {
        Self {
            motor_share: x[0],
            active_quadratic: x[1],
            active_linear: x[2],
            reactive_quadratic: x[3],
            reactive_linear: x[4],
        }
    }

    /// In the order of the fields.
    #[must_use]
    pub const fn to_array(self) -> [f64; Self::COUNT] {
        [
            self.motor_share,
            self.active_quadratic,
            self.active_linear,
            self.reactive_quadratic,
            self.reactive_linear,
        ]
    }
}

/// The operating point to which load-base parameters refer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadBase {
    /// Voltage before the disturbance, pu.
    pub v0_pu: f64,
    /// Active power before the disturbance, pu, positive.
    pub p0_pu: f64,
    /// Reactive power before the disturbance, pu.
    pub q0_pu: f64,
    /// Nominal frequency, Hz.
    pub nominal_hz: f64,
}

/// The reference paper's parameters (11) with the two eliminated shares, per unit on the load base
/// at one operating point, and the same motor in a study engineer's units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZipImParameters {
    /// Inertia `M`, pu s^2/rad.
    pub m: f64,
    /// Transient open-circuit time constant `T0'`, s.
    pub t0_prime_s: f64,
    /// Reactance `X`, pu.
    pub x_pu: f64,
    /// Transient reactance `X'`, pu.
    pub x_prime_pu: f64,
    /// Motor share `Kpm`.
    pub kpm: f64,
    /// Constant-impedance, constant-current, constant-power share of `P_ZIP0`.
    pub p_shares: [f64; 3],
    /// The same of `Q_ZIP0`; not finite when `Q_ZIP0` is zero.
    pub q_shares: [f64; 3],
    /// Static active power before the disturbance, pu.
    pub p_zip0_pu: f64,
    /// Static reactive power before the disturbance, pu; negative with capacitors.
    pub q_zip0_pu: f64,
    /// Inertia constant on the motor's own initial power, s.
    pub inertia_h_s: f64,
    /// `X` on the base of the motor's own initial power and V0.
    pub x_motor_base: f64,
    /// `X'` on the base of the motor's own initial power and V0.
    pub x_prime_motor_base: f64,
    /// Slip before the disturbance, pu, positive for a motor.
    pub slip: f64,
    /// Static voltage (pu of V0) below which the motor cannot carry its torque: pull-out.
    pub critical_voltage: f64,
}

impl ZipImParameters {
    /// Converts from the coordinates the data determine. `x_motor_base` picks the representative
    /// along the null direction: any value describes the same P and Q.
    #[must_use]
    pub fn new(
        motor: &MotorCoordinates<f64>,
        linear: &LinearCoefficients,
        base: &LoadBase,
        x_motor_base: f64,
    ) -> Self {
        let g = 2.0 / motor.kappa;
        let x_prime_motor_base = 1.0 / (g + 1.0 / x_motor_base);
        let motor_power_pu = linear.motor_share * base.p0_pu;
        let to_load_base = base.v0_pu * base.v0_pu / motor_power_pu;
        let inertia_own_base = g / motor.nu_per_s2;
        let root = (1.0 - motor.kappa * motor.kappa).max(0.0).sqrt();
        let tangent = -motor.kappa / (1.0 + root); // tan(delta_0) = b0 / a0
        let q_motor0 = 1.0 / x_motor_base + g * 0.5 * (1.0 - root);
        let magnetising = linear.motor_share / x_motor_base;
        let q_zip0 = base.q0_pu / base.p0_pu - linear.motor_share * q_motor0;
        let p_zip0 = 1.0 - linear.motor_share;
        let shares = |quadratic: f64, linear: f64, total: f64| {
            let (z, i) = (quadratic / total, linear / total);
            [z, i, 1.0 - z - i]
        };
        let synchronous = 2.0 * PI * base.nominal_hz;
        Self {
            m: inertia_own_base * motor_power_pu,
            t0_prime_s: (1.0 + g * x_motor_base) / motor.alpha_per_s,
            x_pu: x_motor_base * to_load_base,
            x_prime_pu: x_prime_motor_base * to_load_base,
            kpm: linear.motor_share,
            p_shares: shares(linear.active_quadratic, linear.active_linear, p_zip0),
            q_shares: shares(
                linear.reactive_quadratic - magnetising,
                linear.reactive_linear,
                q_zip0,
            ),
            p_zip0_pu: p_zip0 * base.p0_pu,
            q_zip0_pu: q_zip0 * base.p0_pu,
            inertia_h_s: 0.5 * inertia_own_base * synchronous,
            x_motor_base,
            x_prime_motor_base,
            slip: -motor.alpha_per_s * tangent / synchronous,
            critical_voltage: motor.kappa.sqrt(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn site_truth_of_an_independent_simulator_maps_to_the_papers_parameters() {
        // 120 MVA motor at 0.75 loading, xs .1, xm 3, xr .12, rr .02, H .6 s, 60 Hz, on 100 MVA:
        // X = 3.1 * 100/120 = 2.58333, X' = (.1 + .12*3/3.12) * 100/120 = 0.179487,
        // T0' = 3.12 / (w0 .02) = 0.413803 s, M = 2 * .6 * 1.2 / w0 = 0.0038197.
        // With P0 = 1.5, Kpm = 0.6, V0 = 1: own base x = 2.58333 * 0.9 = 2.325, x' = 0.1615385.
        let (x, xp, t0, m) = (2.325, 0.161_538_46, 0.413_802_85, 0.003_819_72 / 0.9);
        let g = 1.0 / xp - 1.0 / x;
        let motor = MotorCoordinates {
            alpha_per_s: x / (xp * t0),
            nu_per_s2: g / m,
            kappa: 2.0 / g,
        };
        let linear = LinearCoefficients::from_array([0.6, 0.16, 0.12, 0.7, 0.1]);
        let base = LoadBase {
            v0_pu: 1.0,
            p0_pu: 1.5,
            q0_pu: 0.5,
            nominal_hz: 60.0,
        };
        let p = ZipImParameters::new(&motor, &linear, &base, x);
        assert!((p.x_pu - 2.583_333).abs() < 1e-5);
        assert!((p.x_prime_pu - 0.179_487).abs() < 1e-5);
        assert!((p.t0_prime_s - t0).abs() < 1e-8);
        assert!((p.m - 0.003_819_72).abs() < 1e-8);
        assert!((p.inertia_h_s - 0.6 * 1.2 / 0.9).abs() < 1e-4);
        assert!((p.p_shares[0] - 0.4).abs() < 1e-12 && (p.p_shares[2] - 0.3).abs() < 1e-12);
        // Q_ZIP0 + motor = Q0: the motor's Q from effects.md, V^2/X' (1 - (X-X')/X cos^2 d0).
        let delta = 0.5 * motor.kappa.asin();
        let q_motor = 0.6 * (1.0 - (x - xp) / x * delta.cos().powi(2)) / xp;
        assert!((p.q_zip0_pu / 1.5 + q_motor - 0.5 / 1.5).abs() < 1e-9);
    }

    #[test]
    fn the_representative_along_the_null_direction_changes_no_output() {
        // The ZIP's quadratic Q plus the motor's |u|^2 / x is d_z whatever x is chosen.
        let motor = MotorCoordinates {
            alpha_per_s: 35.0,
            nu_per_s2: 1300.0,
            kappa: 0.36,
        };
        let linear = LinearCoefficients::from_array([0.5, 0.2, 0.1, 0.4, 0.1]);
        let base = LoadBase {
            v0_pu: 0.98,
            p0_pu: 0.9,
            q0_pu: 0.3,
            nominal_hz: 60.0,
        };
        let quadratic = |x: f64| {
            let p = ZipImParameters::new(&motor, &linear, &base, x);
            p.q_shares[0] * p.q_zip0_pu / base.p0_pu + linear.motor_share / x
        };
        assert!((quadratic(2.0) - quadratic(4.0)).abs() < 1e-12);
    }
}
