//! Induction motor as a circuit with rotor flux linkages, stator transients neglected.
//!
//! In a frame that turns at nominal speed, on the motor's base, consumption positive:
//!
//! ```text
//! (1)  V = (R_s + j X_s) I_s + j X_m (I_s + I_r)                      stator
//! (2)  psi = X_m I_s + (X_r + X_m) I_r                                rotor flux linkage
//! (3)  d psi/dt = -w0 R_r I_r + j (w - w0) psi                        rotor voltage
//! (4)  T_e = (X_m / (X_r + X_m)) Im(conj(psi) I_s)                    air-gap torque
//! (5)  2 H d(w/w0)/dt = T_e - T_m                                     swing
//! ```
//!
//! States: |psi|, arg psi, w. Source: Kundur, "Power System Stability and Control" (1994), section
//! 7.2; with `E' = j X_m/(X_r + X_m) psi` the model is the third-order one of the reference paper,
//! equation (9), which the tests show.

use crate::truth::{
    Phasor, TruthError,
    load::{Part, Terminal},
};

/// Circuit constants on the motor's own base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorCircuit {
    /// Stator resistance, pu.
    pub stator_resistance: f64,
    /// Stator leakage reactance, pu.
    pub stator_reactance: f64,
    /// Magnetising reactance, pu.
    pub magnetising_reactance: f64,
    /// Rotor resistance, pu.
    pub rotor_resistance: f64,
    /// Rotor leakage reactance, pu.
    pub rotor_reactance: f64,
    /// Inertia constant of motor and drive, s.
    pub inertia_s: f64,
    /// Active power over rated apparent power at the operating point.
    pub load_factor: f64,
}

impl Default for MotorCircuit {
    /// A mixture of industrial and commercial motors. With the other defaults of a synthetic site
    /// its parameters on the load base lie inside the reference paper's box (14).
    fn default() -> Self {
        Self {
            stator_resistance: 0.0,
            stator_reactance: 0.10,
            magnetising_reactance: 2.2,
            rotor_resistance: 0.018,
            rotor_reactance: 0.14,
            inertia_s: 0.7,
            load_factor: 0.6,
        }
    }
}

/// The reference paper's motor parameters on the load base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadBaseParameters {
    /// M, pu s^2/rad.
    pub inertia: f64,
    /// T0', s.
    pub transient_open_circuit_time_constant_s: f64,
    /// X, pu.
    pub reactance: f64,
    /// X', pu.
    pub transient_reactance: f64,
}

impl MotorCircuit {
    /// `X = X_s + X_m` on the motor's base, pu.
    #[must_use]
    pub fn reactance(&self) -> f64 {
        self.stator_reactance + self.magnetising_reactance
    }

    /// `X' = X_s + X_m X_r/(X_m + X_r)` on the motor's base, pu.
    #[must_use]
    pub fn transient_reactance(&self) -> f64 {
        let (xm, xr) = (self.magnetising_reactance, self.rotor_reactance);
        self.stator_reactance + xm * xr / (xm + xr)
    }

    /// `T0' = (X_r + X_m)/(w0 R_r)`, s.
    #[must_use]
    pub fn transient_open_circuit_time_constant_s(&self, nominal_rad_s: f64) -> f64 {
        self.rotor_self_reactance() / (nominal_rad_s * self.rotor_resistance)
    }

    /// The paper's parameters for motors that draw `active_pu` of the load base before the event.
    #[must_use]
    pub fn on_load_base(&self, active_pu: f64, nominal_rad_s: f64) -> LoadBaseParameters {
        let rating = active_pu / self.load_factor;
        LoadBaseParameters {
            inertia: 2.0 * self.inertia_s * rating / nominal_rad_s,
            transient_open_circuit_time_constant_s: self
                .transient_open_circuit_time_constant_s(nominal_rad_s),
            reactance: self.reactance() / rating,
            transient_reactance: self.transient_reactance() / rating,
        }
    }

    fn rotor_self_reactance(&self) -> f64 {
        self.rotor_reactance + self.magnetising_reactance
    }

    /// Impedance at `slip`, pu of the motor's base.
    fn impedance(&self, slip: f64) -> Phasor {
        let magnetising = Phasor::new(0.0, self.magnetising_reactance);
        let rotor = Phasor::new(self.rotor_resistance / slip, self.rotor_reactance);
        let stator = Phasor::new(self.stator_resistance, self.stator_reactance);
        stator + magnetising * rotor / (magnetising + rotor)
    }

    /// Active power at `slip` and 1 pu voltage.
    fn active_at(&self, slip: f64) -> f64 {
        (Phasor::new(1.0, 0.0) / self.impedance(slip)).re
    }

    /// The slip, below that of the largest power, at which the motor takes its rated share.
    fn running_slip(&self, voltage_pu: f64) -> Result<f64, TruthError> {
        let demand = self.load_factor / voltage_pu.powi(2);
        let mut breakdown = 1e-5;
        while breakdown < 1.0 && self.active_at(1.01 * breakdown) > self.active_at(breakdown) {
            breakdown *= 1.01;
        }
        if self.active_at(breakdown) < demand {
            return Err(TruthError::NoEquilibrium {
                demand_pu: self.load_factor,
                largest_pu: self.active_at(breakdown) * voltage_pu.powi(2),
                voltage_pu,
            });
        }
        let (mut low, mut high) = (1e-9, breakdown);
        // 60 halvings exhaust the 53 bits of a double.
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.active_at(middle) < demand {
                low = middle;
            } else {
                high = middle;
            }
        }
        Ok(0.5 * (low + high))
    }
}

/// A group of motors at its operating point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct Motor {
    circuit: MotorCircuit,
    /// Rating over the load base.
    rating: f64,
    nominal_rad_s: f64,
    /// Load torque, pu of the motor's base; constant.
    load_torque: f64,
    initial_flux: Phasor,
    initial_speed_rad_s: f64,
}

impl Motor {
    /// Motors that draw `active_pu` of the load base at `voltage`, at rest in the nominal frame.
    ///
    /// # Errors
    ///
    /// [`TruthError::NoEquilibrium`] when the circuit cannot take that much.
    pub(in crate::truth) fn at_operating_point(
        circuit: MotorCircuit,
        active_pu: f64,
        voltage: Phasor,
        nominal_rad_s: f64,
    ) -> Result<Self, TruthError> {
        let slip = circuit.running_slip(voltage.norm())?;
        let stator = voltage / circuit.impedance(slip);
        let magnetising = Phasor::new(0.0, circuit.magnetising_reactance);
        let rotor_branch = Phasor::new(circuit.rotor_resistance / slip, circuit.rotor_reactance);
        let rotor = -stator * magnetising / (magnetising + rotor_branch);
        let flux = circuit.magnetising_reactance * stator + circuit.rotor_self_reactance() * rotor; // (2)
        Ok(Self {
            circuit,
            rating: active_pu / circuit.load_factor,
            nominal_rad_s,
            load_torque: torque(&circuit, flux, stator),
            initial_flux: flux,
            initial_speed_rad_s: (1.0 - slip) * nominal_rad_s,
        })
    }

    /// Stator current on the motor's base, from (1) and (2) with the rotor current eliminated.
    fn stator_current(&self, voltage: Phasor, flux: Phasor) -> Phasor {
        let behind = Phasor::new(0.0, 1.0) * self.coupling() * flux;
        let impedance = Phasor::new(
            self.circuit.stator_resistance,
            self.circuit.transient_reactance(),
        );
        (voltage - behind) / impedance
    }

    fn coupling(&self) -> f64 {
        self.circuit.magnetising_reactance / self.circuit.rotor_self_reactance()
    }
}

fn torque(circuit: &MotorCircuit, flux: Phasor, stator: Phasor) -> f64 {
    let coupling = circuit.magnetising_reactance / circuit.rotor_self_reactance();
    coupling * (flux.conj() * stator).im // (4)
}

impl Part for Motor {
    fn states(&self) -> usize {
        3
    }

    fn initial_state(&self) -> Vec<f64> {
        let (magnitude, angle) = self.initial_flux.to_polar();
        vec![magnitude, angle, self.initial_speed_rad_s]
    }

    fn current(&self, at: Terminal, state: &[f64]) -> Phasor {
        let flux = Phasor::from_polar(state[0], state[1]);
        self.stator_current(at.voltage, flux) * self.rating
    }

    fn derivatives(&self, at: Terminal, state: &[f64], slope: &mut [f64]) {
        let flux = Phasor::from_polar(state[0], state[1]);
        let stator = self.stator_current(at.voltage, flux);
        let (xm, w0) = (self.circuit.magnetising_reactance, self.nominal_rad_s);
        let rotor = (flux - xm * stator) / self.circuit.rotor_self_reactance(); // (2)
        let turning = Phasor::new(0.0, state[2] - w0) * flux;
        let flux_slope = -w0 * self.circuit.rotor_resistance * rotor + turning; // (3)
        let radial = flux.conj() * flux_slope;
        slope[0] = radial.re / state[0];
        slope[1] = radial.im / state[0].powi(2);
        let surplus = torque(&self.circuit, flux, stator) - self.load_torque;
        slope[2] = w0 * surplus / (2.0 * self.circuit.inertia_s); // (5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const W0: f64 = 376.991_118_430_775_2;

    fn at(voltage: Phasor) -> Terminal {
        Terminal {
            time_s: 0.0,
            voltage,
        }
    }

    fn motor(voltage: Phasor) -> Motor {
        Motor::at_operating_point(MotorCircuit::default(), 0.4, voltage, W0).unwrap()
    }

    #[test]
    fn the_operating_point_is_at_rest_and_draws_its_share() {
        let voltage = Phasor::from_polar(0.97, -0.2);
        let motor = motor(voltage);
        let state = motor.initial_state();
        let mut slope = [0.0; 3];
        motor.derivatives(at(voltage), &state, &mut slope);
        assert!(slope.iter().all(|rate| rate.abs() < 1e-9), "{slope:?}");
        let power = voltage * motor.current(at(voltage), &state).conj();
        assert!((power.re - 0.4).abs() < 1e-12, "{power}");
    }

    #[test]
    fn the_operating_point_meets_the_published_steady_state_formulas() {
        // Reference paper (12) and shared steady-state formulas, load base, V = 0.97, P = 0.4:
        // delta0 = -asin(2 X X' P/((X - X') V^2))/2, E' = (X - X')/X V cos delta0,
        // Q = V^2/X' (1 - (X - X')/X cos^2 delta0), w - ws = X tan delta0/(X' T0').
        let (v, p) = (0.97, 0.4);
        let voltage = Phasor::new(v, 0.0);
        let motor = motor(voltage);
        let q = MotorCircuit::default().on_load_base(p, W0);
        let (x, x1, t) = (
            q.reactance,
            q.transient_reactance,
            q.transient_open_circuit_time_constant_s,
        );
        let delta = -0.5 * (2.0 * x * x1 * p / ((x - x1) * v * v)).asin();
        let behind = (x - x1) / x * v * delta.cos();
        let reactive = v * v / x1 * (1.0 - (x - x1) / x * delta.cos().powi(2));
        let slip_rad_s = x * delta.tan() / (x1 * t);

        let state = motor.initial_state();
        let flux = Phasor::from_polar(state[0], state[1]);
        let transient_voltage = Phasor::new(0.0, motor.coupling()) * flux;
        let power = voltage * motor.current(at(voltage), &state).conj();
        assert!((transient_voltage.norm() - behind).abs() < 1e-12);
        assert!((transient_voltage.arg() - delta).abs() < 1e-12);
        assert!((power.im - reactive).abs() < 1e-12);
        assert!((state[2] - W0 - slip_rad_s).abs() < 1e-9);
    }

    #[test]
    fn away_from_rest_the_rates_are_those_of_the_papers_equation_nine() {
        let (before, dip) = (Phasor::new(1.0, 0.0), Phasor::from_polar(0.6, -0.35));
        let motor = motor(before);
        let q = MotorCircuit::default().on_load_base(0.4, W0);
        let (x, x1, t) = (
            q.reactance,
            q.transient_reactance,
            q.transient_open_circuit_time_constant_s,
        );
        let state = [0.9, -1.4, 0.97 * W0];
        let mut slope = [0.0; 3];
        motor.derivatives(at(dip), &state, &mut slope);

        let e = motor.coupling() * state[0];
        let delta = state[1] + std::f64::consts::FRAC_PI_2 - dip.arg();
        let v = dip.norm();
        let e_slope = -x / (x1 * t) * e + (x - x1) / (x1 * t) * v * delta.cos();
        // In the nominal frame the terminal angle stands still: ws = w0.
        let delta_slope = state[2] - W0 - (x - x1) / (x1 * t) * v * delta.sin() / e;
        let speed_slope = (-v * e * delta.sin() / x1 - 0.4) / q.inertia;
        assert!((motor.coupling() * slope[0] - e_slope).abs() < 1e-10);
        assert!(
            (slope[1] - delta_slope).abs() < 1e-9,
            "{} {delta_slope}",
            slope[1]
        );
        assert!(
            (slope[2] - speed_slope).abs() < 1e-8,
            "{} {speed_slope}",
            slope[2]
        );
    }

    #[test]
    fn hand_computed_constants_on_the_load_base() {
        // X = 2.3, X' = 0.1 + 2.2 x 0.14/2.34 = 0.1 + 0.131623932 = 0.231623932,
        // T0' = 2.34/(376.991 x 0.018) = 2.34/6.78584 = 0.344836 s.
        // Rating 0.45/0.6 = 0.75: X = 3.066667, X' = 0.308831909, M = 2 x 0.7 x 0.75/376.991
        // = 0.00278521.
        let q = MotorCircuit::default().on_load_base(0.45, W0);
        assert!((q.reactance - 3.066_666_667).abs() < 1e-9);
        assert!((q.transient_reactance - 0.308_831_909).abs() < 1e-9);
        assert!((q.transient_open_circuit_time_constant_s - 0.344_836).abs() < 1e-5);
        assert!((q.inertia - 0.002_785_21).abs() < 1e-8);
    }

    #[test]
    fn a_motor_asked_for_too_much_has_no_equilibrium() {
        let circuit = MotorCircuit {
            load_factor: 3.0,
            ..MotorCircuit::default()
        };
        let outcome = Motor::at_operating_point(circuit, 0.4, Phasor::new(1.0, 0.0), W0);
        assert!(matches!(outcome, Err(TruthError::NoEquilibrium { .. })));
    }
}
