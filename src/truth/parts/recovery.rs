//! A load that recovers exponentially: thermostats, and taps further down that nobody models.
//!
//! ```text
//! (1)  dx/dt = -x/T + P0 (v^as - v^at)     x = 0 at rest
//! (2)  P = x/T + P0 v^at                   Q likewise with its own exponents
//! ```
//!
//! Source: D. Karlsson, D. J. Hill, "Modelling and identification of nonlinear dynamic loads in
//! power systems" (1994), in the form of the catalogue of effects.

use crate::truth::{
    Phasor,
    load::{Part, Terminal},
};

/// Settings of a recovering load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct RecoverySettings {
    /// Exponents of P and of Q once recovered.
    pub(in crate::truth) steady: (f64, f64),
    /// Exponents of P and of Q at once.
    pub(in crate::truth) transient: (f64, f64),
    /// T, s.
    pub(in crate::truth) time_constant_s: f64,
}

/// A recovering load at its operating point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct Recovery {
    pub(in crate::truth) settings: RecoverySettings,
    pub(in crate::truth) initial_voltage_pu: f64,
    pub(in crate::truth) initial: Phasor,
}

impl Part for Recovery {
    fn states(&self) -> usize {
        2
    }

    fn initial_state(&self) -> Vec<f64> {
        vec![0.0, 0.0]
    }

    fn current(&self, at: Terminal, state: &[f64]) -> Phasor {
        let v = at.voltage.norm() / self.initial_voltage_pu;
        let recovered = Phasor::new(state[0], state[1]) / self.settings.time_constant_s;
        let (active, reactive) = self.settings.transient;
        let transient = Phasor::new(
            self.initial.re * v.powf(active),
            self.initial.im * v.powf(reactive),
        );
        ((recovered + transient) / at.voltage).conj() // (2)
    }

    fn derivatives(&self, at: Terminal, state: &[f64], slope: &mut [f64]) {
        let v = at.voltage.norm() / self.initial_voltage_pu;
        let (steady, transient) = (self.settings.steady, self.settings.transient);
        let t = self.settings.time_constant_s;
        slope[0] = -state[0] / t + self.initial.re * (v.powf(steady.0) - v.powf(transient.0)); // (1)
        slope[1] = -state[1] / t + self.initial.im * (v.powf(steady.1) - v.powf(transient.1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_once_the_power_follows_one_exponent_and_in_the_end_the_other() {
        let recovery = Recovery {
            settings: RecoverySettings {
                steady: (0.0, 1.0),
                transient: (2.0, 2.0),
                time_constant_s: 3.0,
            },
            initial_voltage_pu: 1.0,
            initial: Phasor::new(0.4, 0.1),
        };
        let at = Terminal {
            time_s: 0.0,
            voltage: Phasor::new(0.9, 0.0),
        };
        let power = |state: &[f64]| at.voltage * recovery.current(at, state).conj();
        // At once 0.4 x 0.81 and 0.1 x 0.81; at rest x = T P0 (v^as - v^at), P = P0 v^as.
        assert!((power(&[0.0, 0.0]) - Phasor::new(0.324, 0.081)).norm() < 1e-14);
        let settled = [3.0 * 0.4 * (1.0 - 0.81), 3.0 * 0.1 * (0.9 - 0.81)];
        assert!((power(&settled) - Phasor::new(0.4, 0.09)).norm() < 1e-14);
        let mut slope = [1.0; 2];
        recovery.derivatives(at, &settled, &mut slope);
        assert!(slope.iter().all(|rate| rate.abs() < 1e-14), "{slope:?}");
    }
}
