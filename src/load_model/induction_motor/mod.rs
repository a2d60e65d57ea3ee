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
//! Not in this module: stator resistance, saturation, a torque that depends on speed.

#![allow(
    clippy::inline_always,
    reason = "vector instructions come out only where the whole chain of calls is one function"
)]

mod advance;
mod batch;
mod input_pieces;
mod lanes;
mod radau;
mod taylor;

use super::{TerminalInput, terminal::DENSE_POINTS};
use crate::numerics::{Arithmetic, Scalar};
pub use batch::{BatchInput, BatchSink, Effort, simulate_batch, simulate_batch_with_slopes};
pub use lanes::{LaneScalar, Slopes};

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

    /// Largest error of P and of Q, on the motor's own initial power, that [`Self::simulate`] makes over
    /// this input by its choice of steps: its difference to a run with a hundredth of the tolerance.
    /// Costs about three simulations.
    ///
    /// # Errors
    ///
    /// [`Infeasible`] when there is no steady state to start from.
    pub fn estimate_error(&self, input: &TerminalInput) -> Result<[f64; 2], Infeasible> {
        let (mut usual, mut finer) = (MotorOutput::default(), MotorOutput::default());
        self.simulate_to(1.0, input, &mut usual)?;
        self.simulate_to(0.01, input, &mut finer)?;
        let largest = |x: &[S], y: &[S]| {
            let differences = x.iter().zip(y).map(|(x, y)| (x.value() - y.value()).abs());
            differences.fold(0.0, |most: f64, d| if d <= most { most } else { d })
        };
        Ok([
            largest(&usual.active, &finer.active),
            largest(&usual.reactive, &finer.reactive),
        ])
    }

    /// As [`Self::simulate`], with another tolerance per step relative to its own.
    fn simulate_to(
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
                let mut part = if parts == 1 {
                    *piece
                } else {
                    piece.shortened(parts)
                };
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
mod reference_tests;
#[cfg(test)]
mod tests;
