//! An induction motor with what the plain one leaves out: a second rotor cage, saturation of the
//! main flux, a torque that depends on speed, speed voltages that scale with the frequency, and a
//! breaker behind which it coasts and from which it re-accelerates.
//!
//! In a frame that turns at nominal speed, on the motor's base, consumption positive; k counts the
//! rotor branches, `psi_m` is the air-gap flux, w the speed in pu:
//!
//! ```text
//! (1)  V = (R_s + j f X_s) I_s + j f psi_m             stator, f = 1 + df or 1
//! (2)  psi_k = psi_m + X_k I_k                         rotor branch k
//! (3)  psi_m (1 + S(|psi_m|))/X_m = I_s + sum I_k      main flux, S = a |psi_m|^n
//! (4)  d psi_k/dt = -w0 R_k I_k + j w0 (w - 1) psi_k
//! (5)  T_e = Im(conj(psi_m) I_s)
//! (6)  2 H dw/dt = T_e - T_rest (A w^2 + B w + C)/(A w_rest^2 + B w_rest + C),  C = 1 - A - B
//! ```
//!
//! With the breaker open `I_s = 0`: the rotor fluxes decay and the motor coasts down. Sources: Kundur
//! (1994), sections 4.3, 5.2.2, 7.2 (two rotor circuits, saturation S(1.0) and S(1.2), torque as a
//! polynomial of the speed). States: `psi_k` in Cartesian form, w, and the tracked angle of `frequency`.

use super::{frequency::FrequencyTracker, motor::MotorCircuit};
use crate::truth::{
    Phasor, TruthError,
    load::{Operation, Part, Terminal},
    relay::{Relay, RelaySettings},
};

/// A rotor circuit on the motor's base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct RotorBranch {
    /// Resistance, pu.
    pub(in crate::truth) resistance: f64,
    /// Leakage reactance, pu.
    pub(in crate::truth) reactance: f64,
}

/// Saturation of the main flux.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct Saturation {
    /// S at 1.0 pu flux.
    pub(in crate::truth) at_1_0: f64,
    /// S at 1.2 pu flux.
    pub(in crate::truth) at_1_2: f64,
}

impl Saturation {
    fn factor(&self, flux_pu: f64) -> f64 {
        let exponent = (self.at_1_2 / self.at_1_0).ln() / 1.2_f64.ln();
        self.at_1_0 * flux_pu.powf(exponent)
    }
}

/// What a motor is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct MachineSettings {
    /// Name in the log.
    pub(in crate::truth) part: &'static str,
    /// Circuit with the first rotor branch.
    pub(in crate::truth) circuit: MotorCircuit,
    /// A second rotor branch.
    pub(in crate::truth) second_rotor: Option<RotorBranch>,
    /// Saturation of the main flux.
    pub(in crate::truth) saturation: Option<Saturation>,
    /// A and B of the load torque.
    pub(in crate::truth) torque: (f64, f64),
    /// Lag of the frequency with which speed voltages scale, s; none: they do not.
    pub(in crate::truth) frequency_lag_s: Option<f64>,
    /// Breaker.
    pub(in crate::truth) breaker: Option<RelaySettings>,
}

impl MachineSettings {
    /// The plain motor of `circuit`.
    pub(in crate::truth) fn plain(circuit: MotorCircuit) -> Self {
        Self {
            part: "motor",
            circuit,
            second_rotor: None,
            saturation: None,
            torque: (0.0, 0.0),
            frequency_lag_s: None,
            breaker: None,
        }
    }

    fn branches(&self) -> impl Iterator<Item = RotorBranch> + '_ {
        let first = RotorBranch {
            resistance: self.circuit.rotor_resistance,
            reactance: self.circuit.rotor_reactance,
        };
        std::iter::once(first).chain(self.second_rotor)
    }

    fn stator_impedance(&self, frequency: f64) -> Phasor {
        let circuit = &self.circuit;
        Phasor::new(
            circuit.stator_resistance,
            frequency * circuit.stator_reactance,
        )
    }

    /// The flux that solves `flux (magnetising(S) + others) = sources`, (3).
    fn main_flux(&self, sources: Phasor, others: Phasor) -> Phasor {
        // Each round gains a digit and a half: S changes the sum by a few percent only.
        const ROUNDS: usize = 20;
        const CHANGE_MIN_PU: f64 = 1e-14;
        let unsaturated = 1.0 / self.circuit.magnetising_reactance;
        let mut flux = sources / (others + unsaturated);
        if let Some(saturation) = self.saturation {
            for _ in 0..ROUNDS {
                let factor = 1.0 + saturation.factor(flux.norm());
                let next = sources / (others + unsaturated * factor);
                let change = (next - flux).norm();
                flux = next;
                if change < CHANGE_MIN_PU {
                    break;
                }
            }
        }
        flux
    }

    /// Air-gap flux and stator current at rest with `slip`.
    fn at_rest(&self, voltage: Phasor, slip: f64) -> (Phasor, Phasor) {
        let j = Phasor::new(0.0, 1.0);
        let stator = self.stator_impedance(1.0);
        let rotor: Phasor = self
            .branches()
            .map(|b| Phasor::new(b.resistance / slip, b.reactance).inv())
            .sum();
        let flux = self.main_flux(voltage / stator, j * (stator.inv() + rotor));
        (flux, (voltage - j * flux) / stator)
    }

    /// The slip, below that of the largest power, at which the motor takes its rated share.
    fn running_slip(&self, voltage: Phasor) -> Result<f64, TruthError> {
        let active = |slip: f64| (voltage * self.at_rest(voltage, slip).1.conj()).re;
        let demand = self.circuit.load_factor;
        let mut breakdown = 1e-5;
        while breakdown < 1.0 && active(1.02 * breakdown) > active(breakdown) {
            breakdown *= 1.02;
        }
        if active(breakdown) < demand {
            return Err(TruthError::NoEquilibrium {
                demand_pu: demand,
                largest_pu: active(breakdown),
                voltage_pu: voltage.norm(),
            });
        }
        let (mut low, mut high) = (1e-9, breakdown);
        // 60 halvings exhaust the 53 bits of a double.
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if active(middle) < demand {
                low = middle;
            } else {
                high = middle;
            }
        }
        Ok(0.5 * (low + high))
    }

    fn load_torque_shape(&self, speed: f64) -> f64 {
        let (a, b) = self.torque;
        // A brake resists motion and holds at rest.
        let resisting = (speed / 0.01).clamp(-1.0, 1.0);
        (a * speed * speed + b * speed + 1.0 - a - b) * resisting
    }
}

/// A group of such motors at its operating point.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::truth) struct Machine {
    settings: MachineSettings,
    branches: Vec<RotorBranch>,
    /// Rating over the load base.
    rating: f64,
    nominal_rad_s: f64,
    torque_factor: f64,
    breaker: Option<Relay>,
    initial_state: Vec<f64>,
}

impl Machine {
    /// Motors that draw `active_pu` of the load base at `voltage`, at rest in the nominal frame.
    ///
    /// # Errors
    ///
    /// [`TruthError::NoEquilibrium`] when the circuit cannot take that much.
    pub(in crate::truth) fn at_operating_point(
        settings: MachineSettings,
        active_pu: f64,
        voltage: Phasor,
        nominal_rad_s: f64,
    ) -> Result<Self, TruthError> {
        let slip = settings.running_slip(voltage)?;
        let (flux, stator) = settings.at_rest(voltage, slip);
        let speed = 1.0 - slip;
        let branches: Vec<_> = settings.branches().collect();
        let mut initial_state = Vec::new();
        for branch in &branches {
            let impedance = Phasor::new(branch.resistance / slip, branch.reactance);
            let own = -Phasor::new(0.0, 1.0) * flux / impedance;
            let linkage = flux + own * branch.reactance; // (2)
            initial_state.extend([linkage.re, linkage.im]);
        }
        initial_state.push(speed);
        if settings.frequency_lag_s.is_some() {
            initial_state.push(voltage.arg());
        }
        Ok(Self {
            settings,
            branches,
            rating: active_pu / settings.circuit.load_factor,
            nominal_rad_s,
            torque_factor: (flux.conj() * stator).im / settings.load_torque_shape(speed),
            breaker: settings.breaker.map(Relay::new),
            initial_state,
        })
    }

    fn connected(&self) -> bool {
        self.breaker.is_none_or(|breaker| breaker.closed())
    }

    fn tracker(&self) -> Option<FrequencyTracker> {
        self.settings.frequency_lag_s.map(|lag_s| FrequencyTracker {
            nominal_rad_s: self.nominal_rad_s,
            lag_s,
        })
    }

    fn linkage(branch: usize, state: &[f64]) -> Phasor {
        Phasor::new(state[2 * branch], state[2 * branch + 1])
    }

    /// Air-gap flux and stator current, (1) to (3).
    fn air_gap(&self, voltage: Phasor, state: &[f64]) -> (Phasor, Phasor) {
        let nothing = Phasor::new(0.0, 0.0);
        let (mut sources, mut others) = (nothing, nothing);
        for (k, branch) in self.branches.iter().enumerate() {
            sources += Self::linkage(k, state) / branch.reactance;
            others += 1.0 / branch.reactance;
        }
        if !self.connected() {
            return (self.settings.main_flux(sources, others), nothing);
        }
        let angle = state.last().copied().unwrap_or(0.0);
        let frequency = self
            .tracker()
            .map_or(1.0, |tracker| 1.0 + tracker.deviation(voltage, angle));
        let stator = self.settings.stator_impedance(frequency);
        let turning = Phasor::new(0.0, frequency);
        sources += voltage / stator;
        others += turning / stator;
        let flux = self.settings.main_flux(sources, others);
        (flux, (voltage - turning * flux) / stator)
    }
}

impl Part for Machine {
    fn states(&self) -> usize {
        self.initial_state.len()
    }

    fn initial_state(&self) -> Vec<f64> {
        self.initial_state.clone()
    }

    fn current(&self, at: Terminal, state: &[f64]) -> Phasor {
        if self.connected() {
            self.air_gap(at.voltage, state).1 * self.rating
        } else {
            Phasor::new(0.0, 0.0)
        }
    }

    fn derivatives(&self, at: Terminal, state: &[f64], slope: &mut [f64]) {
        let (flux, stator) = self.air_gap(at.voltage, state);
        let w0 = self.nominal_rad_s;
        let at_speed = 2 * self.branches.len();
        let speed = state[at_speed];
        for (k, branch) in self.branches.iter().enumerate() {
            let linkage = Self::linkage(k, state);
            let own = (linkage - flux) / branch.reactance; // (2)
            let turning = Phasor::new(0.0, w0 * (speed - 1.0)) * linkage;
            let rate = turning - w0 * branch.resistance * own; // (4)
            (slope[2 * k], slope[2 * k + 1]) = (rate.re, rate.im);
        }
        let electrical = (flux.conj() * stator).im; // (5)
        let load = self.torque_factor * self.settings.load_torque_shape(speed);
        slope[at_speed] = (electrical - load) / (2.0 * self.settings.circuit.inertia_s); // (6)
        if let Some(tracker) = self.tracker() {
            slope[at_speed + 1] = tracker.rate_rad_s(at.voltage, state[at_speed + 1]);
        }
    }

    fn guards(&self, at: Terminal, _state: &[f64], guards: &mut Vec<f64>) {
        guards.extend(self.breaker.map(|b| b.guard(at.voltage.norm())));
    }

    fn timer_s(&self) -> f64 {
        self.breaker.map_or(f64::INFINITY, |b| b.timer_s())
    }

    fn react(&mut self, at: Terminal, _state: &[f64], log: &mut Vec<Operation>) {
        let Some(breaker) = &mut self.breaker else {
            return;
        };
        if breaker.react(at.time_s, at.voltage.norm()) {
            log.push(Operation {
                time_s: at.time_s,
                part: self.settings.part,
                action: if breaker.closed() { "return" } else { "drop" },
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::parts::Motor;

    const W0: f64 = 376.991_118_430_775_2;

    fn at(voltage: Phasor) -> Terminal {
        Terminal {
            time_s: 0.0,
            voltage,
        }
    }

    fn machine(settings: MachineSettings) -> Machine {
        let voltage = Phasor::from_polar(0.98, -0.3);
        Machine::at_operating_point(settings, 0.4, voltage, W0).unwrap()
    }

    fn plain() -> MachineSettings {
        let circuit = MotorCircuit {
            stator_resistance: 0.02,
            ..MotorCircuit::default()
        };
        MachineSettings::plain(circuit)
    }

    fn with_everything() -> MachineSettings {
        MachineSettings {
            second_rotor: Some(RotorBranch {
                resistance: 0.06,
                reactance: 0.1,
            }),
            saturation: Some(Saturation {
                at_1_0: 0.15,
                at_1_2: 0.5,
            }),
            torque: (0.7, 0.1),
            frequency_lag_s: Some(0.02),
            ..plain()
        }
    }

    #[test]
    fn every_kind_of_motor_is_at_rest_at_its_operating_point_and_draws_its_share() {
        for settings in [plain(), with_everything()] {
            let (machine, voltage) = (machine(settings), Phasor::from_polar(0.98, -0.3));
            let state = machine.initial_state();
            let mut slope = vec![0.0; state.len()];
            machine.derivatives(at(voltage), &state, &mut slope);
            assert!(slope.iter().all(|rate| rate.abs() < 1e-9), "{slope:?}");
            let power = voltage * machine.current(at(voltage), &state).conj();
            assert!((power.re - 0.4).abs() < 1e-12, "{power}");
        }
    }

    #[test]
    fn without_additions_it_is_the_plain_motor_in_other_coordinates() {
        let (before, dip) = (
            Phasor::from_polar(0.98, -0.3),
            Phasor::from_polar(0.6, -0.5),
        );
        let machine = machine(plain());
        let motor = Motor::at_operating_point(plain().circuit, 0.4, before, W0).unwrap();
        let (cartesian, polar) = (machine.initial_state(), motor.initial_state());
        let flux = Phasor::new(cartesian[0], cartesian[1]);
        assert!((flux - Phasor::from_polar(polar[0], polar[1])).norm() < 1e-9);
        let currents = [
            machine.current(at(dip), &cartesian),
            motor.current(at(dip), &polar),
        ];
        assert!((currents[0] - currents[1]).norm() < 1e-9, "{currents:?}");
        let (mut rates, mut polar_rates) = ([0.0; 3], [0.0; 3]);
        machine.derivatives(at(dip), &cartesian, &mut rates);
        motor.derivatives(at(dip), &polar, &mut polar_rates);
        let unit = Phasor::from_polar(1.0, polar[1]);
        let turned = unit * Phasor::new(polar_rates[0], polar[0] * polar_rates[1]);
        assert!((turned - Phasor::new(rates[0], rates[1])).norm() < 1e-6);
        assert!((rates[2] - polar_rates[2] / W0).abs() < 1e-9);
    }

    #[test]
    fn power_in_is_losses_plus_air_gap_power() {
        // Energy: P = R_s |I_s|^2 + sum R_k |I_k|^2 + w T_e + rate of the magnetic energy; at rest
        // the last is zero.
        let machine = machine(with_everything());
        let (voltage, state) = (Phasor::from_polar(0.98, -0.3), machine.initial_state());
        let (flux, stator) = machine.air_gap(voltage, &state);
        let rotor: f64 = machine
            .branches
            .iter()
            .enumerate()
            .map(|(k, b)| {
                let own = (Machine::linkage(k, &state) - flux) / b.reactance;
                b.resistance * own.norm_sqr()
            })
            .sum();
        let (torque, speed) = ((flux.conj() * stator).im, state[4]);
        let losses = machine.settings.circuit.stator_resistance * stator.norm_sqr() + rotor;
        let power = (voltage * stator.conj()).re;
        assert!((power - losses - speed * torque).abs() < 1e-12, "{power}");
    }

    #[test]
    fn a_second_cage_in_parallel_shifts_the_locked_rotor_impedance_as_computed_by_hand() {
        // slip 1, no magnetising current to speak of (X_m = 1e6): branches 0.018 + j 0.14 and
        // 0.06 + j 0.1 in parallel: product = (0.00108 - 0.014) + j (0.0018 + 0.0084)
        // = -0.01292 + j 0.0102; sum = 0.078 + j 0.24, |sum|^2 = 0.063684;
        // quotient = (-0.01292 x 0.078 + 0.0102 x 0.24 + j (0.0102 x 0.078 + 0.01292 x 0.24))/0.063684
        // = (0.00144024 + j 0.0038964)/0.063684 = 0.0226154 + j 0.0611833.
        let settings = MachineSettings {
            circuit: MotorCircuit {
                magnetising_reactance: 1e6,
                stator_resistance: 0.0,
                ..MotorCircuit::default()
            },
            second_rotor: with_everything().second_rotor,
            ..plain()
        };
        let voltage = Phasor::new(1.0, 0.0);
        let (_, current) = settings.at_rest(voltage, 1.0);
        let rotor = voltage / current - Phasor::new(0.0, 0.1);
        assert!(
            (rotor - Phasor::new(0.022_615_4, 0.061_183_3)).norm() < 1e-6,
            "{rotor}"
        );
    }

    #[test]
    fn saturation_has_its_two_published_points_and_draws_more_magnetising_current() {
        let saturation = Saturation {
            at_1_0: 0.1,
            at_1_2: 0.4,
        };
        assert!((saturation.factor(1.0) - 0.1).abs() < 1e-15);
        assert!((saturation.factor(1.2) - 0.4).abs() < 1e-14);
        let reactive = |saturation| {
            let settings = MachineSettings {
                saturation,
                ..plain()
            };
            let voltage = Phasor::new(1.1, 0.0);
            (voltage * settings.at_rest(voltage, 1e-6).1.conj()).im
        };
        // Without load Q = V^2/(X_s + X_m/(1 + S)); flux V X_m'/(X_s + X_m') with X_m' = X_m/(1 + S).
        // n = ln 4/ln 1.2 = 7.6036; flux 1.04577: S = 0.1 x 1.04577^n = 0.1405, X_m' = 1.92898,
        // flux = 1.1 x 1.92898/2.02898 = 1.04579, Q = 1.21/2.02898 = 0.59636.
        let (plain, saturated) = (reactive(None), reactive(Some(saturation)));
        assert!((plain - 1.21 / 2.3).abs() < 1e-4, "{plain}");
        assert!((saturated - 0.596_36).abs() < 1e-4, "{saturated}");
    }

    #[test]
    fn behind_an_open_breaker_the_flux_decays_and_the_motor_slows_as_its_torque_says() {
        let settings = MachineSettings {
            breaker: Some(RelaySettings {
                drop_below_pu: 0.7,
                drop_delay_s: 0.0,
                return_above_pu: 0.8,
                return_delay_s: 0.1,
                dips: 1,
            }),
            torque: (1.0, 0.0),
            ..plain()
        };
        let mut machine = machine(settings);
        let state = machine.initial_state();
        let mut log = Vec::new();
        machine.react(at(Phasor::new(0.5, 0.0)), &state, &mut log);
        assert_eq!(log.len(), 1);
        let terminal = at(Phasor::new(0.5, 0.0));
        assert!(machine.current(terminal, &state).norm() < 1e-15);
        let mut slope = vec![0.0; 3];
        machine.derivatives(terminal, &state, &mut slope);
        let flux = Phasor::new(state[0], state[1]);
        let rate = Phasor::new(slope[0], slope[1]);
        // d|psi|/dt = -|psi|/T0', T0' = 0.344836 s; dw/dt = -T/(2 H) with T = (0.6 - losses)/...:
        // the torque at rest, 0.6 - R_s |I|^2.
        let decay = (flux.conj() * rate).re / flux.norm_sqr();
        assert!((decay + 1.0 / 0.344_836).abs() < 1e-4, "{decay}");
        let (_, stator) = settings.at_rest(
            Phasor::new(0.98, 0.0),
            settings.running_slip(Phasor::new(0.98, 0.0)).unwrap(),
        );
        let torque = 0.6 - 0.02 * stator.norm_sqr();
        assert!((slope[2] + torque / 1.4).abs() < 1e-9, "{}", slope[2]);
    }

    #[test]
    fn speed_voltages_that_scale_give_torque_times_frequency() {
        // At df = -0.01 and no stator resistance the air-gap power is f T_e.
        let settings = MachineSettings {
            frequency_lag_s: Some(0.05),
            ..MachineSettings::plain(MotorCircuit::default())
        };
        let machine = machine(settings);
        let mut state = machine.initial_state();
        let voltage = Phasor::from_polar(0.98, -0.3);
        state[3] = voltage.arg() + 0.01 * W0 * 0.05;
        let (flux, stator) = machine.air_gap(voltage, &state);
        let torque = (flux.conj() * stator).im;
        let power = (voltage * stator.conj()).re;
        assert!((power - 0.99 * torque).abs() < 1e-12, "{power} {torque}");
    }
}
