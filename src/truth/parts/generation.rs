//! Distributed generation netted inside the load: inverters at unity power factor.
//!
//! ```text
//! (1)  I = -i V/|V|                            injected: negative consumption
//! (2)  di/dt = (c min(P0/|V|, I_max) - i)/T
//! (3)  c = 0 while V < V_mc and t_d longer, then a straight ramp over t_ramp     momentary cessation
//! (4)  blocks of inverters leave below their voltage and stay away               trip
//! ```
//!
//! Source: NERC reliability guidelines on inverter-based resources and DER (momentary cessation with
//! delay and ramp), WECC `DER_A` (blocks between two voltages); current control as a first-order lag.

use crate::truth::{
    Phasor,
    load::{Operation, Part, Terminal},
    relay::{Relay, RelaySettings},
};

/// What inverters do in a dip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::truth) enum Behaviour {
    /// They stop, and return with a ramp.
    MomentaryCessation,
    /// A part of them leaves for good.
    Trip,
    /// They go on at constant power within their current limit.
    RideThrough,
}

/// Settings of the generation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct GenerationSettings {
    pub(in crate::truth) behaviour: Behaviour,
    /// Voltage below which inverters stop or leave, pu; blocks of a trip lie within 0.02 of it.
    pub(in crate::truth) threshold_pu: f64,
    /// Time below it after which they do, s.
    pub(in crate::truth) delay_s: f64,
    /// Share of the inverters that leave.
    pub(in crate::truth) tripping: f64,
    /// Time above the threshold after which inverters begin to return, s.
    pub(in crate::truth) recovery_delay_s: f64,
    /// Length of the ramp from nothing to full, s.
    pub(in crate::truth) ramp_s: f64,
    /// Lag of the current control, s.
    pub(in crate::truth) lag_s: f64,
    /// Largest current over that at rest.
    pub(in crate::truth) current_limit: f64,
}

/// Blocks of inverters that trip one after the other.
const BLOCKS: usize = 5;
/// Half-width of the range in which they trip, pu.
const SPREAD_PU: f64 = 0.02;
/// Inverters return this far above the threshold, pu.
const MARGIN_PU: f64 = 0.01;

/// Generation at its operating point.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::truth) struct Generation {
    settings: GenerationSettings,
    active_pu: f64,
    initial_voltage_pu: f64,
    relays: Vec<Relay>,
    /// Beginning of the ramp of (3).
    ramp_from_s: f64,
}

impl Generation {
    /// Generation that injects `active_pu` at `initial_voltage_pu`.
    pub(in crate::truth) fn new(
        settings: GenerationSettings,
        active_pu: f64,
        initial_voltage_pu: f64,
    ) -> Self {
        let relay = |offset_pu: f64| {
            let returns = settings.behaviour == Behaviour::MomentaryCessation;
            Relay::new(RelaySettings {
                drop_below_pu: settings.threshold_pu + offset_pu,
                drop_delay_s: settings.delay_s,
                return_above_pu: if returns {
                    settings.threshold_pu + MARGIN_PU
                } else {
                    f64::INFINITY
                },
                return_delay_s: settings.recovery_delay_s,
                dips: 1,
            })
        };
        let relays = match settings.behaviour {
            Behaviour::MomentaryCessation => vec![relay(0.0)],
            Behaviour::Trip => (0..BLOCKS)
                .map(|k| {
                    let place = (k as f64 + 0.5) / BLOCKS as f64;
                    relay(SPREAD_PU * (1.0 - 2.0 * place))
                })
                .collect(),
            Behaviour::RideThrough => Vec::new(),
        };
        Self {
            settings,
            active_pu,
            initial_voltage_pu,
            relays,
            ramp_from_s: f64::NEG_INFINITY,
        }
    }

    /// Share of the inverters that are connected.
    fn connected(&self) -> f64 {
        if self.settings.behaviour != Behaviour::Trip {
            return 1.0;
        }
        let away = self.relays.iter().filter(|relay| !relay.closed()).count();
        1.0 - self.settings.tripping * away as f64 / BLOCKS as f64 // (4)
    }

    /// Share of the power that the control asks for.
    fn order(&self, time_s: f64) -> f64 {
        if self.settings.behaviour != Behaviour::MomentaryCessation {
            return 1.0;
        }
        if self.relays.iter().any(|relay| !relay.closed()) {
            return 0.0;
        }
        ((time_s - self.ramp_from_s) / self.settings.ramp_s).clamp(0.0, 1.0) // (3)
    }
}

impl Part for Generation {
    fn states(&self) -> usize {
        1
    }

    fn initial_state(&self) -> Vec<f64> {
        vec![self.active_pu / self.initial_voltage_pu]
    }

    fn current(&self, at: Terminal, state: &[f64]) -> Phasor {
        -at.voltage / at.voltage.norm() * (state[0] * self.connected()) // (1)
    }

    fn derivatives(&self, at: Terminal, state: &[f64], slope: &mut [f64]) {
        let at_rest = self.active_pu / self.initial_voltage_pu;
        let wanted = self.active_pu / at.voltage.norm();
        let limited = wanted.min(self.settings.current_limit * at_rest);
        slope[0] = (self.order(at.time_s) * limited - state[0]) / self.settings.lag_s; // (2)
    }

    fn guards(&self, at: Terminal, _state: &[f64], guards: &mut Vec<f64>) {
        let voltage_pu = at.voltage.norm();
        guards.extend(self.relays.iter().map(|relay| relay.guard(voltage_pu)));
    }

    fn timer_s(&self) -> f64 {
        let timers = self.relays.iter().map(Relay::timer_s);
        timers.fold(f64::INFINITY, f64::min)
    }

    fn react(&mut self, at: Terminal, _state: &[f64], log: &mut Vec<Operation>) {
        let ramps = self.settings.behaviour == Behaviour::MomentaryCessation;
        for relay in &mut self.relays {
            if relay.react(at.time_s, at.voltage.norm()) {
                if relay.closed() && ramps {
                    self.ramp_from_s = at.time_s;
                }
                log.push(Operation {
                    time_s: at.time_s,
                    part: "distributed_generation",
                    action: match (ramps, relay.closed()) {
                        (true, false) => "cease",
                        (true, true) => "ramp",
                        (false, _) => "trip",
                    },
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn generation(behaviour: Behaviour) -> Generation {
        let settings = GenerationSettings {
            behaviour,
            threshold_pu: 0.8,
            delay_s: 0.0,
            tripping: 0.6,
            recovery_delay_s: 0.2,
            ramp_s: 2.0,
            lag_s: 0.02,
            current_limit: 1.1,
        };
        Generation::new(settings, 0.25, 1.0)
    }

    fn at(time_s: f64, voltage: f64) -> Terminal {
        Terminal {
            time_s,
            voltage: Phasor::new(voltage, 0.0),
        }
    }

    #[test]
    fn it_injects_its_power_at_unity_power_factor() {
        let generation = generation(Behaviour::RideThrough);
        let state = generation.initial_state();
        let power = generation.current(at(0.0, 1.0), &state).conj();
        assert!((power - Phasor::new(-0.25, 0.0)).norm() < 1e-15);
        let mut slope = [1.0];
        generation.derivatives(at(0.0, 1.0), &state, &mut slope);
        assert!(slope[0].abs() < 1e-15);
    }

    #[test]
    fn below_its_voltage_it_ceases_and_later_returns_on_a_ramp() {
        let mut generation = generation(Behaviour::MomentaryCessation);
        let mut log = Vec::new();
        generation.react(at(1.0, 0.7), &[], &mut log);
        assert!(generation.order(1.05).abs() < 1e-15);
        generation.react(at(1.1, 0.95), &[], &mut log);
        assert!((generation.timer_s() - 1.3).abs() < 1e-12);
        generation.react(at(1.3, 0.95), &[], &mut log);
        let actions: Vec<_> = log.iter().map(|operation| operation.action).collect();
        assert_eq!(actions, ["cease", "ramp"]);
        // Half of the ramp of 2 s one second after its beginning.
        assert!((generation.order(2.3) - 0.5).abs() < 1e-12);
        assert!((generation.order(9.0) - 1.0).abs() < 1e-15);
    }

    #[test]
    fn a_trip_takes_its_share_for_good_and_a_mild_dip_only_some_blocks() {
        let mut generation = generation(Behaviour::Trip);
        let state = generation.initial_state();
        let mut log = Vec::new();
        // Blocks at 0.816, 0.808, 0.8, 0.792, 0.784.
        generation.react(at(1.0, 0.804), &[], &mut log);
        let power = |g: &Generation| g.current(at(1.2, 1.0), &state).re;
        assert!((power(&generation) + 0.25 * (1.0 - 0.6 * 0.4)).abs() < 1e-14);
        generation.react(at(1.1, 0.7), &[], &mut log);
        generation.react(at(5.0, 1.0), &[], &mut log);
        assert!((power(&generation) + 0.25 * 0.4).abs() < 1e-14);
        assert_eq!(log.len(), 5);
    }

    #[test]
    fn riding_through_is_constant_power_up_to_the_current_limit() {
        let generation = generation(Behaviour::RideThrough);
        let settled = |voltage: f64| {
            let mut slope = [0.0];
            generation.derivatives(at(0.0, voltage), &[0.0], &mut slope);
            slope[0] * 0.02 * voltage
        };
        assert!((settled(0.95) - 0.25).abs() < 1e-14);
        // 1.1 x 0.25 x 0.7 below the limit of 1/1.1 = 0.909 pu.
        assert!((settled(0.7) - 0.1925).abs() < 1e-14);
    }
}
