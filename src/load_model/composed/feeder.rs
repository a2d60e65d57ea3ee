//! A series impedance between the measured bus and the load.
//!
//! In units of V0 and P0, with `Z = R + jX` and `u` the phasor at the measured bus:
//!
//! ```text
//! u_L = u - Z i,   i = conj((P_L + j Q_L)/u_L)                       (1)
//! P + j Q = u conj i                                                 (2)
//! ```
//!
//! At rest `i0 = 1 - j Q0/P0`, so `u_L0 = 1 - Z i0` and the load draws what is left: P0 and Q0 hold. The
//! load sees `u_L / u_L0`. A capacitor at the load is part of the load's `d_z`, exactly. (1) is solved by a fixed-point iteration in which the current through the
//! motor's stator branch, nearly all of the feedback, is taken implicitly.

use super::{complex, motor::Motor};
use crate::numerics::Elementary;

/// Constants of the feeder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feeder<S> {
    /// `R`.
    pub resistance: S,
    /// `X`.
    pub reactance: S,
}

impl<S: Elementary> Feeder<S> {
    /// No feeder.
    #[must_use]
    pub fn none() -> Self {
        Self {
            resistance: S::constant(0.0),
            reactance: S::constant(0.0),
        }
    }

    /// `|u_L0|^2`.
    #[must_use]
    pub fn load_voltage_square(&self, rest_reactive: f64) -> S {
        complex::square(self.load_voltage(rest_reactive))
    }

    /// `u_L0`.
    fn load_voltage(&self, rest_reactive: f64) -> [S; 2] {
        let current = [S::constant(1.0), S::constant(-rest_reactive)];
        let drop = complex::product([self.resistance, self.reactance], current);
        [S::constant(1.0) - drop[0], -drop[1]]
    }
}

/// Steps of the iteration; it gains a digit or more per step where there is a solution.
const STEPS_MAX: usize = 60;
/// Steps after the value has converged, for the derivatives.
const STEPS_AFTER: usize = 2;
/// Square of the voltage below which the current does not rise any further.
const VOLTAGE_SQUARE_MIN: f64 = 0.01;

/// A feeder at its operating point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Network<S> {
    impedance: [S; 2],
    /// `u_L0`.
    rest: [S; 2],
    /// Active and reactive power of the load at rest.
    rest_power: [S; 2],
    rest_reactive: f64,
    /// Admittance taken implicitly, and `1/(1 + Z Y)`.
    implicit: [S; 2],
    divisor: [S; 2],
}

impl<S: Elementary> Network<S> {
    pub(super) fn new(
        feeder: &Feeder<S>,
        rest_reactive: f64,
        motor_share: S,
        motor: &Motor<S>,
    ) -> Self {
        let one = S::constant(1.0);
        let impedance = [feeder.resistance, feeder.reactance];
        let current = [one, S::constant(-rest_reactive)];
        let rest = feeder.load_voltage(rest_reactive);
        let power = complex::product(rest, complex::conjugate(current));
        let square = complex::square(rest);
        let scale = motor_share * power[0] / square;
        let implicit = motor.admittance.map(|y| y * scale);
        let loop_gain = complex::product(impedance, implicit);
        Self {
            impedance,
            rest,
            rest_power: power,
            rest_reactive,
            implicit,
            divisor: complex::inverse([loop_gain[0] + 1.0, loop_gain[1]]),
        }
    }

    /// Solves (1) for the load's own phasor `u_L / u_L0`, starting from `guess`; `load` gives power
    /// over P0 as if the load were at the measured bus. `None` when there is no solution nearby.
    pub(super) fn load_phasor(
        &self,
        u: [S; 2],
        guess: [S; 2],
        load: impl Fn([S; 2]) -> [S; 2],
    ) -> Option<[S; 2]> {
        let mut at = complex::product(guess, self.rest);
        let mut after = 0;
        for _ in 0..STEPS_MAX {
            let own = complex::quotient(at, self.rest);
            let current = self.current(at, load(own));
            let explicit = complex::difference(current, complex::product(self.implicit, at));
            let drop = complex::product(self.impedance, explicit);
            let next = complex::product(complex::difference(u, drop), self.divisor);
            let moved = (next[0] - at[0]).value().hypot((next[1] - at[1]).value());
            at = next;
            if !moved.is_finite() {
                return None;
            }
            if moved < 1e-11 {
                after += 1;
                if after > STEPS_AFTER {
                    return Some(complex::quotient(at, self.rest));
                }
            }
        }
        None
    }

    /// (2) for a load with this phasor and power over P0.
    pub(super) fn power(&self, u: [S; 2], own: [S; 2], load: [S; 2]) -> [S; 2] {
        let current = self.current(complex::product(own, self.rest), load);
        complex::product(u, complex::conjugate(current))
    }

    fn current(&self, at: [S; 2], load: [S; 2]) -> [S; 2] {
        let square = complex::square(at);
        let weight = if square.value() < VOLTAGE_SQUARE_MIN {
            S::constant(1.0 / VOLTAGE_SQUARE_MIN)
        } else {
            S::constant(1.0) / square
        };
        let active = self.rest_power[0] * load[0];
        let reactive = self.rest_power[1] + self.rest_power[0] * (load[1] + -self.rest_reactive);
        // conj(P + jQ) u / |u|^2
        complex::product([active, -reactive], at).map(|part| part * weight)
    }
}
