//! Single-phase air-conditioner motors that stall: a run characteristic, a stalled impedance,
//! partial restart, thermal protection.
//!
//! ```text
//! (1)  running, V >= V_brk:  P = P0' + Kp1 (V - V_brk)^Np1,  Q = Q0' + Kq1 (V - V_brk)^Nq1
//! (2)  running, V <  V_brk:  P = P0' + Kp2 (V_brk - V)^Np2,  Q = Q0' + Kq2 (V_brk - V)^Nq2
//!      but never more than (4): a motor that slows down is an impedance in the end
//! (3)  P0' = 1 - Kp1 (1 - V_brk)^Np1,  Q0' = tan(acos pf) - Kq1 (1 - V_brk)^Nq1
//! (4)  stalled:  P = V^2 R/(R^2 + X^2),  Q = V^2 X/(R^2 + X^2)
//! (5)  V < V_stall for T_stall: all stall; V > V_rst for T_rst: the share F_rst runs again
//! (6)  T_th d theta/dt = I^2 R - theta; of those that stand, 1 - (theta - Th1)/(Th2 - Th1) are left
//! (7)  running P times 1 + K_pf df, Q times 1 + K_qf df; df is the rate of an angle that follows the voltage's
//! ```
//!
//! Powers over the motors' power at 1 pu. Source: WECC composite load model, motor D (performance
//! model of single-phase air conditioners); Kp1 = 0, Np1 = 1 and the other values as listed in the
//! catalogue of effects. Contactors of motor D are left out.

use super::frequency::FrequencyTracker;
use crate::truth::{
    Phasor,
    load::{Operation, Part, Terminal},
    relay::{Relay, RelaySettings},
};

/// Settings of the air conditioners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct AirConditionerSettings {
    /// Power factor at 1 pu.
    pub(in crate::truth) power_factor: f64,
    /// `V_stall`, pu.
    pub(in crate::truth) stall_pu: f64,
    /// `T_stall`, s.
    pub(in crate::truth) stall_delay_s: f64,
    /// R and X of stalled motors, pu.
    pub(in crate::truth) stalled: (f64, f64),
    /// `F_rst`.
    pub(in crate::truth) restarting: f64,
    /// `V_rst`, pu.
    pub(in crate::truth) restart_pu: f64,
    /// `T_rst`, s.
    pub(in crate::truth) restart_delay_s: f64,
    /// `T_th`, s.
    pub(in crate::truth) thermal_s: f64,
    /// Th1 and Th2.
    pub(in crate::truth) thermal_trip: (f64, f64),
    /// `K_pf` and `K_qf`.
    pub(in crate::truth) frequency: (f64, f64),
    /// Nominal frequency, rad/s.
    pub(in crate::truth) nominal_rad_s: f64,
}

/// `V_brk`, pu.
const BREAK_PU: f64 = 0.86;
/// Time constant with which the motors' frequency follows, s.
const FREQUENCY_LAG_S: f64 = 0.03;
/// Kq1, Nq1.
const REACTIVE_ABOVE: (f64, f64) = (6.0, 2.0);
/// Kp2, Np2.
const ACTIVE_BELOW: (f64, f64) = (12.0, 3.2);
/// Kq2, Nq2.
const REACTIVE_BELOW: (f64, f64) = (11.0, 2.5);

impl AirConditionerSettings {
    /// Power of running motors over their active power at 1 pu, (1) to (3).
    fn running(&self, voltage_pu: f64) -> Phasor {
        let (k, n) = REACTIVE_ABOVE;
        let at_break = Phasor::new(
            1.0,
            self.power_factor.acos().tan() - k * (1.0 - BREAK_PU).powf(n),
        );
        if voltage_pu >= BREAK_PU {
            at_break + Phasor::new(0.0, k * (voltage_pu - BREAK_PU).powf(n))
        } else {
            let below = BREAK_PU - voltage_pu;
            let power = |(k, n): (f64, f64)| k * below.powf(n);
            let slowing = at_break + Phasor::new(power(ACTIVE_BELOW), power(REACTIVE_BELOW));
            let standing = self.standing(voltage_pu);
            Phasor::new(slowing.re.min(standing.re), slowing.im.min(standing.im))
        }
    }

    /// Power of stalled motors, (4).
    fn standing(&self, voltage_pu: f64) -> Phasor {
        let (r, x) = self.stalled;
        Phasor::new(r, x) * (voltage_pu.powi(2) / (r * r + x * x))
    }
}

/// Motors of one kind: those that restart, or those that do not.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Group {
    share: f64,
    /// Open: stalled.
    relay: Relay,
    /// Of the temperatures at which the first and the last trip, how many were reached.
    passed: usize,
}

/// Air conditioners at their operating point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct AirConditioner {
    settings: AirConditionerSettings,
    tracker: FrequencyTracker,
    /// Active power at 1 pu voltage, pu of the load base.
    rating: f64,
    groups: [Group; 2],
    initial_voltage: Phasor,
}

impl AirConditioner {
    /// Air conditioners that draw `active_pu` at `initial_voltage`, all running.
    pub(in crate::truth) fn new(
        settings: AirConditionerSettings,
        active_pu: f64,
        initial_voltage: Phasor,
    ) -> Self {
        let relay = |return_above_pu: f64| {
            Relay::new(RelaySettings {
                drop_below_pu: settings.stall_pu,
                drop_delay_s: settings.stall_delay_s,
                return_above_pu,
                return_delay_s: settings.restart_delay_s,
                dips: 1,
            })
        };
        let group = |share, relay| Group {
            share,
            relay,
            passed: 0,
        };
        Self {
            settings,
            tracker: FrequencyTracker {
                nominal_rad_s: settings.nominal_rad_s,
                lag_s: FREQUENCY_LAG_S,
            },
            rating: active_pu / settings.running(initial_voltage.norm()).re,
            groups: [
                group(1.0 - settings.restarting, relay(f64::INFINITY)),
                group(settings.restarting, relay(settings.restart_pu)),
            ],
            initial_voltage,
        }
    }

    /// Power of running motors over their rating at a frequency deviation, (7).
    fn running(&self, voltage_pu: f64, deviation: f64) -> Phasor {
        let power = self.settings.running(voltage_pu);
        let (active, reactive) = self.settings.frequency;
        Phasor::new(
            power.re * (1.0 + active * deviation),
            power.im * (1.0 + reactive * deviation),
        )
    }

    /// Power of one motor of `group` over its rating.
    fn power(&self, group: &Group, voltage_pu: f64, deviation: f64) -> Phasor {
        if group.relay.closed() {
            self.running(voltage_pu, deviation)
        } else {
            self.settings.standing(voltage_pu)
        }
    }

    /// I^2 R of one motor: the heat that (6) integrates.
    fn heat(&self, group: &Group, voltage_pu: f64) -> f64 {
        let current = self.power(group, voltage_pu, 0.0).norm() / voltage_pu;
        current * current * self.settings.stalled.0
    }

    /// The next temperature at which the first or the last motors of `group` trip.
    fn next_trip(&self, group: &Group) -> f64 {
        let (first, last) = self.settings.thermal_trip;
        [first, last, f64::INFINITY][group.passed.min(2)]
    }

    /// Share of `group` that its thermal protection has left on, (6).
    fn left(&self, group: &Group, temperature: f64) -> f64 {
        let (first, last) = self.settings.thermal_trip;
        if group.relay.closed() {
            1.0
        } else {
            1.0 - ((temperature - first) / (last - first)).clamp(0.0, 1.0)
        }
    }
}

impl Part for AirConditioner {
    fn states(&self) -> usize {
        3
    }

    fn initial_state(&self) -> Vec<f64> {
        let heat = |group| self.heat(group, self.initial_voltage.norm());
        let angle_rad = self.initial_voltage.arg();
        self.groups.iter().map(heat).chain([angle_rad]).collect()
    }

    fn current(&self, at: Terminal, state: &[f64]) -> Phasor {
        let voltage_pu = at.voltage.norm();
        let deviation = self.tracker.deviation(at.voltage, state[2]);
        let groups = self.groups.iter().zip(state);
        let power: Phasor = groups
            .map(|(group, temperature)| {
                let left = self.left(group, *temperature);
                self.power(group, voltage_pu, deviation) * (group.share * left)
            })
            .sum();
        (power * self.rating / at.voltage).conj()
    }

    fn derivatives(&self, at: Terminal, state: &[f64], slope: &mut [f64]) {
        slope[2] = self.tracker.rate_rad_s(at.voltage, state[2]);
        for ((group, temperature), rate) in self.groups.iter().zip(state).zip(slope) {
            let heat = self.heat(group, at.voltage.norm());
            *rate = (heat - temperature) / self.settings.thermal_s; // (6)
        }
    }

    fn guards(&self, at: Terminal, state: &[f64], guards: &mut Vec<f64>) {
        for (group, temperature) in self.groups.iter().zip(state) {
            guards.push(group.relay.guard(at.voltage.norm()));
            let margin = self.next_trip(group) - temperature;
            guards.push(if margin.is_finite() { margin } else { 1.0 });
        }
    }

    fn timer_s(&self) -> f64 {
        let timers = self.groups.iter().map(|group| group.relay.timer_s());
        timers.fold(f64::INFINITY, f64::min)
    }

    fn react(&mut self, at: Terminal, state: &[f64], log: &mut Vec<Operation>) {
        for (index, temperature) in state.iter().enumerate().take(self.groups.len()) {
            let trips = self.next_trip(&self.groups[index]) <= *temperature;
            let group = &mut self.groups[index];
            if group.share <= 0.0 {
                continue;
            }
            let mut tell = |action| {
                log.push(Operation {
                    time_s: at.time_s,
                    part: "single_phase_ac_stall",
                    action,
                });
            };
            if group.relay.react(at.time_s, at.voltage.norm()) {
                let running = group.relay.closed();
                tell(if running { "restart" } else { "stall" });
            }
            if trips {
                group.passed += 1;
                tell("thermal trip");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settings() -> AirConditionerSettings {
        AirConditionerSettings {
            power_factor: 0.98,
            stall_pu: 0.6,
            stall_delay_s: 0.033,
            stalled: (0.124, 0.114),
            restarting: 0.2,
            restart_pu: 0.95,
            restart_delay_s: 0.3,
            thermal_s: 15.0,
            thermal_trip: (0.7, 1.9),
            frequency: (1.0, -3.3),
            nominal_rad_s: 377.0,
        }
    }

    fn at(time_s: f64, voltage: f64) -> Terminal {
        Terminal {
            time_s,
            voltage: Phasor::new(voltage, 0.0),
        }
    }

    fn power(part: &AirConditioner, voltage: f64) -> Phasor {
        voltage * part.current(at(0.0, voltage), &[0.1, 0.1, 0.0]).conj()
    }

    #[test]
    fn running_motors_draw_what_the_published_curves_say() {
        let part = AirConditioner::new(settings(), 0.2, Phasor::new(1.0, 0.0));
        // tan(acos 0.98) = 0.203059; Q0' = 0.203059 - 6 x 0.14^2 = 0.085459.
        assert!((power(&part, 1.0) - Phasor::new(0.2, 0.040_611_8)).norm() < 1e-6);
        // V = 0.76: P = 1 + 12 x 0.1^3.2 = 1.0075715, Q = 0.085459 + 11 x 0.1^2.5 = 0.120244.
        let low = power(&part, 0.76);
        assert!(
            (low - Phasor::new(0.201_514_3, 0.024_048_8)).norm() < 1e-6,
            "{low}"
        );
    }

    #[test]
    fn stalled_motors_are_an_impedance_and_some_restart() {
        let mut part = AirConditioner::new(settings(), 0.2, Phasor::new(1.0, 0.0));
        let state = part.initial_state();
        let mut log = Vec::new();
        part.react(at(1.0, 0.5), &state, &mut log);
        assert!(log.is_empty());
        part.react(at(1.033, 0.5), &state, &mut log);
        assert_eq!(log.len(), 2);
        // R^2 + X^2 = 0.015376 + 0.012996 = 0.028372; at 0.9: 0.81 x 0.124/0.028372 = 3.540110.
        let stalled = power(&part, 0.9);
        assert!((stalled.re - 0.2 * 3.540_110).abs() < 1e-6, "{stalled}");
        part.react(at(1.2, 0.96), &state, &mut log);
        part.react(at(1.5, 0.96), &state, &mut log);
        let standing = part.settings.standing(0.96);
        let running = part.settings.running(0.96);
        let expected = (standing * 0.8 + running * 0.2) * 0.2;
        assert!((power(&part, 0.96) - expected).norm() < 1e-12);
    }

    #[test]
    fn stalled_motors_heat_up_and_trip_between_the_two_temperatures() {
        let mut part = AirConditioner::new(settings(), 0.2, Phasor::new(1.0, 0.0));
        let mut state = part.initial_state();
        let mut log = Vec::new();
        part.react(at(1.0, 0.5), &state, &mut log);
        part.react(at(1.1, 0.5), &state, &mut log);
        let mut slope = [0.0; 3];
        part.derivatives(at(1.1, 0.9), &state, &mut slope);
        // I^2 R = 0.81/0.028372 x 0.124 = 3.540110; (3.540110 - theta)/15.
        assert!((slope[0] - (3.540_110 - state[0]) / 15.0).abs() < 1e-6);
        // At 1.3, halfway from 0.7 to 1.9, half of those that do not restart are left; the others are cold.
        state = vec![1.3, 0.2, 0.0];
        let left = 0.5 * 0.8 + 0.2;
        let standing = part.settings.standing(0.9) * 0.2;
        let power = 0.9 * part.current(at(5.0, 0.9), &state).conj();
        assert!((power - standing * left).norm() < 1e-12);
        for temperature in [1.3, 1.8, 1.9, 2.0] {
            state[0] = temperature;
            part.react(at(5.0, 0.9), &state, &mut log);
        }
        assert_eq!(part.groups[0].passed, 2);
    }

    #[test]
    fn running_motors_follow_the_frequency_once_they_notice_it() {
        let part = AirConditioner::new(settings(), 0.2, Phasor::new(1.0, 0.0));
        // An angle that is followed 0.02 x 377 rad/s x 0.03 s behind: df = 0.02.
        let state = [0.1, 0.1, -0.02 * 377.0 * FREQUENCY_LAG_S];
        let power = part.current(at(0.0, 1.0), &state).conj();
        let expected = Phasor::new(0.2 * 1.02, 0.040_611_8 * (1.0 - 3.3 * 0.02));
        assert!((power - expected).norm() < 1e-6, "{power}");
    }

    #[test]
    fn a_mild_dip_stalls_nothing() {
        let mut part = AirConditioner::new(settings(), 0.2, Phasor::new(1.0, 0.0));
        let state = part.initial_state();
        let mut log = Vec::new();
        part.react(at(1.0, 0.61), &state, &mut log);
        part.react(at(2.0, 0.61), &state, &mut log);
        assert!(log.is_empty());
    }
}
