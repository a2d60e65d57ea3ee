//! Third-order induction motor, equations (9), (10), (12), (13) of the reference paper, in
//! Cartesian flux form.
//!
//! With `x`, `x'` the reactances on the base of the motor's own initial power and voltage,
//! `alpha = x / (x' T0')`, `G = 1/x' - 1/x`, `w = E'/V0 / (1 - x'/x)` and `s` the rotor speed against
//! the frame of the terminal phasor `u`:
//!
//! ```text
//! dw/dt = -alpha w + alpha u + j s w                        (9), first two lines
//! ds/dt = -nu (Im(w conj u) - b0),   nu = G / m             (9), third line, T_m = 1
//! p     = -G Im(w conj u)                                   (10)
//! q     =  G (|u|^2 - Re(u conj w)) + |u|^2 / x             (10)
//! b0    = -kappa / 2,  a0 = (1 + sqrt(1 - kappa^2)) / 2,  s0 = alpha b0 / a0      (12)
//! kappa = 2 x x' / (x - x') = 2 / G <= 1                    (13)
//! ```
//!
//! Bilinear, without the polar form's singularity at `E' = 0`. Only `alpha`, `nu` and `kappa`
//! enter the dynamics; `1/x` appears only in `|u|^2 / x`, which a constant-impedance load absorbs
//! exactly (`identification::estimates` reports that valley).
//!
//! Not in this file: stator resistance, saturation, a torque that depends on speed.

mod advance;
mod batch;
mod input_pieces;
mod lanes;
mod radau;
mod taylor;

use super::{TerminalInput, terminal::DENSE_POINTS};
use crate::numerics::{Arithmetic, Scalar};
pub use batch::{BatchSink, Effort, simulate_batch};

use advance::{Mover, State};
use input_pieces::for_each_piece;

/// The three numbers that determine the motor's dynamics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorCoordinates<S> {
    /// Inverse transient time constant `x / (x' T0')`, 1/s.
    pub alpha_per_s: S,
    /// Ratio `G / m` of synchronising strength to inertia, 1/s^2 (`m` in pu s^2/rad).
    pub nu_per_s2: S,
    /// Loading `2 x x' / (x - x')` against the pull-out torque, 0 to 1.
    pub kappa: S,
}

/// Why no steady state exists.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("no steady state: constraint {constraint} violated by {violation}")]
pub struct Infeasible {
    /// By how much the constraint is violated, `> 0`.
    pub violation: f64,
    /// Equation number in the reference paper.
    pub constraint: &'static str,
}

/// What the motor draws at the output instants of the input, on its own initial power.
#[derive(Clone, Debug, PartialEq)]
pub struct MotorOutput<S> {
    /// Active power, 1 at rest.
    pub active: Vec<S>,
    /// Reactive power without the part `|u|^2 / x`, which is linear in `|u|^2`.
    pub reactive: Vec<S>,
}

impl<S> Default for MotorOutput<S> {
    fn default() -> Self {
        Self {
            active: Vec::new(),
            reactive: Vec::new(),
        }
    }
}

impl<S: Scalar> MotorCoordinates<S> {
    /// Flux and slip speed at rest: `[a0, b0, s0]` (12).
    ///
    /// # Errors
    ///
    /// [`Infeasible`] when the motor cannot carry its initial power (13).
    pub fn steady_state(&self) -> Result<[S; 3], Infeasible> {
        let violation = self.kappa.value() - 1.0;
        // Written so that NaN is infeasible too.
        if !(violation < 0.0 && self.kappa.value() > 0.0) {
            return Err(Infeasible {
                violation,
                constraint: "(13)",
            });
        }
        let root = (S::constant(1.0) - self.kappa * self.kappa).sqrt();
        let a0 = (root + 1.0) * 0.5;
        let b0 = self.kappa * -0.5;
        Ok([a0, b0, self.alpha_per_s * b0 / a0])
    }

    /// Integrates (9) over the input and evaluates (10) at its output instants, to a relative error
    /// below 1e-6 (`docs/validation.md`). Where the flux decays fast against the input's own pace by
    /// an implicit method, elsewhere by Taylor series; step lengths follow from error estimates.
    ///
    /// A rotor that has come to stand does not turn backwards; it starts again when the motor's torque
    /// exceeds the load's. A simulation that would take an absurd number of steps gives NaN.
    ///
    /// # Errors
    ///
    /// [`Infeasible`] when there is no steady state to start from.
    pub fn simulate(
        &self,
        input: &TerminalInput,
        out: &mut MotorOutput<S>,
    ) -> Result<(), Infeasible> {
        self.simulate_to(1.0, input, out)
    }

    /// As [`Self::simulate`], with another tolerance per step relative to its own.
    pub fn simulate_to(
        &self,
        accuracy: f64,
        input: &TerminalInput,
        out: &mut MotorOutput<S>,
    ) -> Result<(), Infeasible> {
        let rest = self.steady_state()?;
        let strength = S::constant(2.0) / self.kappa;
        out.active.clear();
        out.reactive.clear();
        out.active.reserve(input.output_count());
        out.reactive.reserve(input.output_count());
        let mut put = |state: &State<S>, u: [f64; 2]| {
            let [active, reactive] = power(strength, state.flux, u);
            out.active.push(active);
            out.reactive.push(reactive);
        };
        let samples = input.sample_count();
        let mut mover = Mover::new(self, rest, input, accuracy);
        let mut state = State {
            flux: [rest[0], rest[1]],
            speed: rest[2],
            standing: false,
        };
        let fine_s = input.sample_interval_s / input.points_per_sample as f64;
        let apart = input.points_per_sample / DENSE_POINTS;
        for sample in 0..samples {
            let origin = sample * input.points_per_sample;
            put(&state, input.point(origin));
            if sample + 1 == samples {
                break;
            }
            let dense = input.dense[sample];
            for_each_piece(input, sample, |piece, start, length| {
                // Output instants are ends of steps.
                let parts = if dense { (length / apart).max(1) } else { 1 };
                let mut part = if parts == 1 { *piece } else { piece.shortened(parts) };
                for i in 0..parts {
                    mover.advance(&mut state, &part, fine_s * (length / parts) as f64);
                    let end = start + (i + 1) * (length / parts);
                    let inside = end < origin + input.points_per_sample;
                    if dense && inside && (end - origin).is_multiple_of(apart) {
                        put(&state, input.point(end));
                    }
                    if i + 1 < parts {
                        part = part.next();
                    }
                }
            });
        }
        Ok(())
    }
}

/// Active and reactive power (10) on the motor's own initial power, without `|u|^2 / x`.
#[inline(always)]
fn power<A: Arithmetic>(strength: A, [a, b]: [A; 2], [re, im]: [f64; 2]) -> [A; 2] {
    let active = strength * (a * im - b * re);
    let reactive = strength * (-(a * re + b * im) + (re * re + im * im));
    [active, reactive]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::Dual;

    const AN_ORDINARY_MOTOR: MotorCoordinates<f64> = MotorCoordinates {
        alpha_per_s: 35.0,
        nu_per_s2: 1300.0,
        kappa: 0.36,
    };

    /// A dip to `depth` between 0.5 s and 0.6 s with a phase jump, 60 samples per second.
    fn dip(depth: f64) -> TerminalInput {
        let (points, samples) = (16, 180);
        let phasor = |i: usize| {
            let t = i as f64 / (points as f64 * 60.0);
            let inside = (0.5..0.6).contains(&t);
            let (v, angle) = if inside {
                (depth, -0.2_f64)
            } else {
                (1.0, 0.0)
            };
            [v * angle.cos(), v * angle.sin()]
        };
        let grid: Vec<_> = (0..=(samples - 1) * points).map(phasor).collect();
        TerminalInput {
            real: grid.iter().map(|u| u[0]).collect(),
            imaginary: grid.iter().map(|u| u[1]).collect(),
            points_per_sample: points,
            sample_interval_s: 1.0 / 60.0,
            jumps: vec![true; samples - 1],
            dense: vec![false; samples - 1],
            synchronous_speed_rad_s: 376.99,
        }
    }

    #[test]
    fn undisturbed_terminal_leaves_every_state_at_rest() {
        let mut out = MotorOutput::default();
        AN_ORDINARY_MOTOR.simulate(&dip(1.0), &mut out).unwrap();
        // Only the 0.1 s with a phase jump moves it; before that it is at rest to rounding.
        assert!(out.active[..30].iter().all(|p| (p - 1.0).abs() < 1e-12));
    }

    #[test]
    fn steady_state_agrees_with_the_polar_formulas_of_the_paper() {
        // x = 3.1, x' = 0.2, by hand: sin(2 delta) = -2*3.1*0.2/2.9 = -0.427586,
        // delta = -0.220896; E' = 2.9/3.1 cos(delta) = 0.912743 ; w = E' e^(j delta) * 3.1/2.9.
        let kappa = 2.0 * 3.1 * 0.2 / 2.9;
        let at = MotorCoordinates {
            kappa,
            ..AN_ORDINARY_MOTOR
        };
        let [a0, b0, s0] = at.steady_state().unwrap();
        let delta = -0.5 * kappa.asin();
        assert!((a0 - delta.cos() * delta.cos()).abs() < 1e-12);
        assert!((b0 - delta.cos() * delta.sin()).abs() < 1e-12);
        assert!((s0 - at.alpha_per_s * delta.tan()).abs() < 1e-9);
    }

    #[test]
    fn an_overloaded_motor_has_no_steady_state() {
        let at = MotorCoordinates {
            kappa: 1.2,
            ..AN_ORDINARY_MOTOR
        };
        let error = at.steady_state().unwrap_err();
        assert!((error.violation - 0.2).abs() < 1e-12);
        assert!(
            MotorCoordinates {
                kappa: f64::NAN,
                ..at
            }
            .steady_state()
            .is_err()
        );
    }

    #[test]
    fn sensitivities_agree_with_differences() {
        let input = dip(0.6);
        let (alpha, nu, kappa) = (35.0_f64, 1300.0_f64, 0.36_f64);
        let at = MotorCoordinates {
            alpha_per_s: Dual::<3>::variable(alpha.ln(), 0).exp(),
            nu_per_s2: Dual::<3>::variable(nu.ln(), 1).exp(),
            kappa: Dual::<3>::variable(kappa, 2),
        };
        let mut exact = MotorOutput::default();
        at.simulate(&input, &mut exact).unwrap();
        let run = |d: [f64; 3]| {
            let mut out = MotorOutput::default();
            MotorCoordinates {
                alpha_per_s: (alpha.ln() + d[0]).exp(),
                nu_per_s2: (nu.ln() + d[1]).exp(),
                kappa: kappa + d[2],
            }
            .simulate(&input, &mut out)
            .unwrap();
            out
        };
        for i in 0..3 {
            let h = 1e-5;
            let mut step = [0.0; 3];
            step[i] = h;
            let (plus, minus) = (run(step), run(step.map(|x| -x)));
            for k in 0..exact.active.len() {
                let p = (plus.active[k] - minus.active[k]) / (2.0 * h);
                let q = (plus.reactive[k] - minus.reactive[k]) / (2.0 * h);
                // h^2 times third derivatives of order 10.
                assert!((exact.active[k].derivatives[i] - p).abs() < 1e-6);
                assert!((exact.reactive[k].derivatives[i] - q).abs() < 1e-6);
            }
        }
    }

    /// M, T0', X, X', Kpm of the rows of the reference paper's Table 1.
    const TABLE_1: [[f64; 5]; 9] = [
        [0.0015, 0.1963, 1.2901, 0.1228, 0.5024],
        [0.0024, 1.0852, 1.9606, 0.3837, 0.2102],
        [4.7646, 1.2844, 3.9603, 0.1022, 0.1000],
        [0.0016, 0.0402, 0.1434, 0.0700, 0.4998],
        [0.0015, 0.2524, 1.6960, 0.1256, 0.5024],
        [0.0010, 0.1294, 1.3634, 0.1243, 0.5449],
        [0.0015, 0.2702, 1.8553, 0.1261, 0.5049],
        [0.0015, 0.2331, 2.9249, 0.0990, 0.6469],
        [0.0018, 0.4246, 2.5739, 0.1261, 0.4907],
    ];

    /// A dip of 30 % that comes and goes within 0.2 s, without jumps.
    fn smooth_dip(rate_fps: usize) -> TerminalInput {
        let (points, samples) = (32, 2 * rate_fps + 1);
        let voltage = |i: usize| {
            let t = i as f64 / (points * rate_fps) as f64 - 0.5;
            if (0.0..0.2).contains(&t) {
                1.0 - 0.3 * (std::f64::consts::PI * t / 0.2).sin().powi(2)
            } else {
                1.0
            }
        };
        let real: Vec<f64> = (0..=(samples - 1) * points).map(voltage).collect();
        TerminalInput {
            imaginary: vec![0.0; real.len()],
            real,
            points_per_sample: points,
            sample_interval_s: 1.0 / rate_fps as f64,
            jumps: vec![false; samples - 1],
            dense: vec![false; samples - 1],
            synchronous_speed_rad_s: 376.99,
        }
    }

    #[test]
    fn steps_are_short_enough_for_the_motors_of_table_1() {
        const FINER: usize = 16;
        let (coarse, fine) = (smooth_dip(60), smooth_dip(60 * FINER));
        let mut worst = 0.0_f64;
        for [m, t0, x, x_prime, kpm] in TABLE_1 {
            let g = (1.0 / x_prime - 1.0 / x) / kpm;
            let motor = MotorCoordinates {
                alpha_per_s: x / (x_prime * t0),
                nu_per_s2: g * kpm / m,
                kappa: 2.0 / g,
            };
            let (mut by_sample, mut exact) = (MotorOutput::default(), MotorOutput::default());
            motor.simulate(&coarse, &mut by_sample).unwrap();
            motor.simulate(&fine, &mut exact).unwrap();
            for k in 0..by_sample.active.len() {
                let p = (by_sample.active[k] - exact.active[FINER * k]).abs();
                let q = (by_sample.reactive[k] - exact.reactive[FINER * k]).abs();
                worst = worst.max(p).max(q);
            }
        }
        assert!(
            worst < 6e-5,
            "largest difference to sixteen times finer steps: {worst:e}"
        );
    }

    #[test]
    fn dense_intervals_give_the_same_output_at_the_samples_and_more_between() {
        let plain = smooth_dip(60);
        let mut dense = plain.clone();
        for k in 30..40 {
            dense.dense[k] = true;
        }
        let (mut few, mut many) = (MotorOutput::default(), MotorOutput::default());
        AN_ORDINARY_MOTOR.simulate(&plain, &mut few).unwrap();
        AN_ORDINARY_MOTOR.simulate(&dense, &mut many).unwrap();
        let points = dense.output_points();
        assert_eq!(many.active.len(), dense.output_count());
        assert_eq!(points.len(), dense.output_count());
        for (point, active) in points.iter().zip(&many.active) {
            if point.is_multiple_of(dense.points_per_sample) {
                let sample = point / dense.points_per_sample;
                assert!((active - few.active[sample]).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn a_dip_that_stalls_the_rotor_stays_finite_and_stands_still() {
        let heavy = MotorCoordinates {
            alpha_per_s: 35.0,
            nu_per_s2: 40_000.0,
            kappa: 0.95,
        };
        let mut out = MotorOutput::default();
        heavy.simulate(&dip(0.05), &mut out).unwrap();
        assert!(
            out.active
                .iter()
                .chain(&out.reactive)
                .all(|x| x.is_finite())
        );
    }
}
