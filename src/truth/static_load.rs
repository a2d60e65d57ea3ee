//! Static load: polynomials of the voltage, equations (10) of the reference paper without a motor.

use super::{Phasor, load::Part};

/// Shares of constant impedance and constant current; the rest is constant power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Zip {
    /// Share of P that goes with the square of the voltage.
    pub active_impedance: f64,
    /// Share of P that goes with the voltage.
    pub active_current: f64,
    /// Share of Q that goes with the square of the voltage.
    pub reactive_impedance: f64,
    /// Share of Q that goes with the voltage.
    pub reactive_current: f64,
}

/// A ZIP load at its operating point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StaticLoad {
    pub(super) zip: Zip,
    /// Voltage before the event, pu.
    pub(super) initial_voltage_pu: f64,
    /// Power before the event, pu.
    pub(super) initial: Phasor,
}

impl StaticLoad {
    /// Complex power at voltage magnitude `voltage_pu`.
    pub(super) fn power(&self, voltage_pu: f64) -> Phasor {
        let v = voltage_pu / self.initial_voltage_pu;
        let polynomial = |z: f64, i: f64| z * v * v + i * v + (1.0 - z - i); // (10)
        let zip = &self.zip;
        Phasor::new(
            self.initial.re * polynomial(zip.active_impedance, zip.active_current),
            self.initial.im * polynomial(zip.reactive_impedance, zip.reactive_current),
        )
    }
}

impl Part for StaticLoad {
    fn states(&self) -> usize {
        0
    }

    fn initial_state(&self) -> Vec<f64> {
        Vec::new()
    }

    fn current(&self, voltage: Phasor, _state: &[f64]) -> Phasor {
        (self.power(voltage.norm()) / voltage).conj()
    }

    fn derivatives(&self, _voltage: Phasor, _state: &[f64], _slope: &mut [f64]) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_static_load_draws_what_the_polynomial_says() {
        let load = StaticLoad {
            zip: Zip {
                active_impedance: 0.3,
                active_current: 0.5,
                reactive_impedance: 0.9,
                reactive_current: 0.1,
            },
            initial_voltage_pu: 0.98,
            initial: Phasor::new(0.5, -0.1),
        };
        let voltage = Phasor::from_polar(0.49, 0.3);
        let power = voltage * load.current(voltage, &[]).conj();
        // v = 0.5: P = 0.5 (0.3 x 0.25 + 0.5 x 0.5 + 0.2) = 0.5 x 0.525 = 0.2625,
        // Q = -0.1 (0.9 x 0.25 + 0.1 x 0.5 + 0) = -0.0275.
        assert!(
            (power - Phasor::new(0.2625, -0.0275)).norm() < 1e-14,
            "{power}"
        );
        assert!((load.power(0.98) - load.initial).norm() < 1e-15);
    }
}
