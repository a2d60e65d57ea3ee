//! Static load: polynomials of the voltage, with what real static loads do besides.

use super::frequency::FrequencyTracker;
use crate::truth::{
    Phasor,
    load::{Part, Terminal},
};

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

/// How a static load follows the frequency.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct FrequencyDependence {
    /// Relative change of P over relative change of frequency.
    pub(in crate::truth) active: f64,
    /// Relative change of Q over relative change of frequency.
    pub(in crate::truth) reactive: f64,
    /// Lag with which the load notices the frequency, s.
    pub(in crate::truth) lag_s: f64,
    /// Nominal angular frequency.
    pub(in crate::truth) nominal_rad_s: f64,
}

/// A static load at its operating point.
///
/// ```text
/// (1)  P = P0 (1 + r_p t) (z v^2 + (i v + p) g(V)) (1 + K_pf df),  v = V/V0;  Q likewise
/// (2)  g = 1 above V_c;  1 - 2 ((V - V_c)/V_c)^2 down to V_c/2;  2 (V/V_c)^2 below
/// ```
///
/// Sources: the polynomial: equations (10) of the reference paper; (2): the elliptical conversion
/// of constant power at PQBRAK in positive-sequence programs, as in the catalogue of effects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct StaticLoad {
    zip: Zip,
    initial_voltage: Phasor,
    initial: Phasor,
    /// `V_c`, pu; 0 for none.
    pub(in crate::truth) conversion_pu: f64,
    /// Kpf and Kqf.
    pub(in crate::truth) frequency: Option<FrequencyDependence>,
    /// Drift of P and of Q, share per second.
    pub(in crate::truth) ramp_per_s: (f64, f64),
}

impl StaticLoad {
    /// A ZIP load that draws `initial` at `voltage` and nothing else.
    pub(in crate::truth) fn plain(zip: Zip, voltage: Phasor, initial: Phasor) -> Self {
        Self {
            zip,
            initial_voltage: voltage,
            initial,
            conversion_pu: 0.0,
            frequency: None,
            ramp_per_s: (0.0, 0.0),
        }
    }

    /// Complex power at the terminals as they are, `deviation` being the frequency's.
    fn power(&self, at: Terminal, deviation: f64) -> Phasor {
        let voltage_pu = at.voltage.norm();
        let v = voltage_pu / self.initial_voltage.norm();
        let kept = conversion(voltage_pu, self.conversion_pu);
        let polynomial = |z: f64, i: f64| z * v * v + (i * v + 1.0 - z - i) * kept;
        let zip = &self.zip;
        let (active, reactive) = self.frequency.map_or((1.0, 1.0), |f| {
            (1.0 + f.active * deviation, 1.0 + f.reactive * deviation)
        });
        let drift = |per_s: f64| 1.0 + per_s * at.time_s;
        let p = polynomial(zip.active_impedance, zip.active_current) * active;
        let q = polynomial(zip.reactive_impedance, zip.reactive_current) * reactive;
        Phasor::new(
            self.initial.re * p * drift(self.ramp_per_s.0), // (1)
            self.initial.im * q * drift(self.ramp_per_s.1),
        )
    }

    fn tracker(&self) -> Option<FrequencyTracker> {
        self.frequency.map(|f| FrequencyTracker {
            nominal_rad_s: f.nominal_rad_s,
            lag_s: f.lag_s,
        })
    }
}

/// Share of a constant power or current that is left at low voltage, equation (2).
fn conversion(voltage_pu: f64, below_pu: f64) -> f64 {
    if voltage_pu >= below_pu {
        1.0
    } else if voltage_pu >= 0.5 * below_pu {
        1.0 - 2.0 * ((voltage_pu - below_pu) / below_pu).powi(2)
    } else {
        2.0 * (voltage_pu / below_pu).powi(2)
    }
}

impl Part for StaticLoad {
    fn states(&self) -> usize {
        usize::from(self.frequency.is_some())
    }

    fn initial_state(&self) -> Vec<f64> {
        vec![self.initial_voltage.arg(); self.states()]
    }

    fn current(&self, at: Terminal, state: &[f64]) -> Phasor {
        let deviation = match (self.tracker(), state) {
            (Some(tracker), [angle]) => tracker.deviation(at.voltage, *angle),
            _ => 0.0,
        };
        (self.power(at, deviation) / at.voltage).conj()
    }

    fn derivatives(&self, at: Terminal, state: &[f64], slope: &mut [f64]) {
        if let (Some(tracker), [angle], [rate]) = (self.tracker(), state, slope) {
            *rate = tracker.rate_rad_s(at.voltage, *angle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(voltage: Phasor) -> Terminal {
        Terminal {
            time_s: 0.0,
            voltage,
        }
    }

    fn load() -> StaticLoad {
        let zip = Zip {
            active_impedance: 0.3,
            active_current: 0.5,
            reactive_impedance: 0.9,
            reactive_current: 0.1,
        };
        StaticLoad::plain(zip, Phasor::new(0.98, 0.0), Phasor::new(0.5, -0.1))
    }

    fn power(load: &StaticLoad, voltage: Phasor, state: &[f64]) -> Phasor {
        voltage * load.current(at(voltage), state).conj()
    }

    #[test]
    fn a_static_load_draws_what_the_polynomial_says() {
        // v = 0.5: P = 0.5 (0.3 x 0.25 + 0.5 x 0.5 + 0.2) = 0.5 x 0.525 = 0.2625,
        // Q = -0.1 (0.9 x 0.25 + 0.1 x 0.5 + 0) = -0.0275.
        let drawn = power(&load(), Phasor::from_polar(0.49, 0.3), &[]);
        assert!((drawn - Phasor::new(0.2625, -0.0275)).norm() < 1e-14);
        let initial = power(&load(), Phasor::new(0.98, 0.0), &[]);
        assert!((initial - Phasor::new(0.5, -0.1)).norm() < 1e-15);
    }

    #[test]
    fn below_the_conversion_voltage_constant_power_and_current_fall_like_impedance() {
        let converting = StaticLoad {
            conversion_pu: 0.7,
            ..load()
        };
        // V = 0.49, V_c = 0.7: g = 1 - 2 (0.3)^2 = 0.82;
        // P = 0.5 (0.075 + (0.25 + 0.2) 0.82) = 0.5 x 0.444 = 0.222.
        let drawn = power(&converting, Phasor::new(0.49, 0.0), &[]);
        assert!((drawn.re - 0.222).abs() < 1e-14, "{drawn}");
        // V = 0.28 = 0.4 V_c: g = 2 x 0.16 = 0.32, halving V again quarters it.
        assert!((conversion(0.28, 0.7) - 0.32).abs() < 1e-15);
        assert!((conversion(0.14, 0.7) - 0.08).abs() < 1e-15);
        // Both branches meet at V_c/2 with 1/2.
        assert!((conversion(0.35, 0.7) - 0.5).abs() < 1e-15);
        let above = Phasor::new(0.75, 0.0);
        assert_eq!(power(&converting, above, &[]), power(&load(), above, &[]));
    }

    #[test]
    fn a_steady_frequency_changes_the_power_by_its_factor() {
        let w0 = 100.0 * std::f64::consts::PI;
        let following = StaticLoad {
            frequency: Some(FrequencyDependence {
                active: 1.5,
                reactive: -2.0,
                lag_s: 0.05,
                nominal_rad_s: w0,
            }),
            ..load()
        };
        // At 49.5 Hz the voltage turns by -pi rad/s and the tracked angle stays behind by
        // -pi x 0.05 = -0.157 rad: df = -0.01, P = 0.5 x 0.985, Q = -0.1 x 1.02.
        let lag = -std::f64::consts::PI * 0.05;
        let voltage = Phasor::from_polar(0.98, 0.4);
        let state = [0.4 - lag];
        let drawn = power(&following, voltage, &state);
        assert!(
            (drawn - Phasor::new(0.4925, -0.102)).norm() < 1e-12,
            "{drawn}"
        );
        let mut slope = [0.0];
        following.derivatives(at(voltage), &state, &mut slope);
        assert!((slope[0] + std::f64::consts::PI).abs() < 1e-12);
    }

    #[test]
    fn a_ramp_drifts_with_time() {
        let drifting = StaticLoad {
            ramp_per_s: (0.01, -0.02),
            ..load()
        };
        let later = Terminal {
            time_s: 5.0,
            voltage: Phasor::new(0.98, 0.0),
        };
        let drawn = later.voltage * drifting.current(later, &[]).conj();
        assert!(
            (drawn - Phasor::new(0.525, -0.09)).norm() < 1e-14,
            "{drawn}"
        );
    }
}
