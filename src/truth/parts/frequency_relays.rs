//! Blocks of generation or load with frequency relays of their own.
//!
//! ```text
//! (1)  S = S0 times the share that is connected, whatever the voltage
//! (2)  block k of n leaves for good when 1 + s df has been below 1 - D_k for T; s is 1 for relays that act below the
//!      nominal frequency and -1 above it; D_k spread evenly over 0.4 mHz/Hz around D
//! ```
//!
//! df is what the blocks' controllers see: the rate of a tracked angle.

use super::frequency::FrequencyTracker;
use crate::truth::{
    Phasor,
    load::{Operation, Part, Terminal},
    relay::{Relay, RelaySettings},
};

/// Settings of the blocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct FrequencyRelaySettings {
    /// Whether relays act above the nominal frequency; otherwise below it.
    pub(in crate::truth) above: bool,
    /// Deviation at which they act, of the nominal frequency.
    pub(in crate::truth) deviation: f64,
    /// How long it must last, s.
    pub(in crate::truth) delay_s: f64,
    /// Lag of the tracked angle, s.
    pub(in crate::truth) lag_s: f64,
    /// Nominal frequency, rad/s.
    pub(in crate::truth) nominal_rad_s: f64,
}

/// Number of blocks: not that of the estimator's relays.
const BLOCKS: usize = 12;
/// Half-width of the range in which they act.
const SPREAD: f64 = 2e-4;

/// The blocks at their operating point.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::truth) struct FrequencyRelays {
    settings: FrequencyRelaySettings,
    tracker: FrequencyTracker,
    initial: Phasor,
    initial_angle_rad: f64,
    relays: Vec<Relay>,
}

impl FrequencyRelays {
    /// Blocks that together draw `initial` (negative: feed) at a voltage of this angle.
    pub(in crate::truth) fn new(
        settings: FrequencyRelaySettings,
        initial_angle_rad: f64,
        initial: Phasor,
    ) -> Self {
        let relay = |k: usize| {
            let place = (k as f64 + 0.5) / BLOCKS as f64;
            let deviation = settings.deviation + SPREAD * (2.0 * place - 1.0);
            Relay::new(RelaySettings {
                drop_below_pu: 1.0 - deviation,
                drop_delay_s: settings.delay_s,
                return_above_pu: f64::INFINITY,
                return_delay_s: 0.0,
                dips: 1,
            })
        };
        Self {
            tracker: FrequencyTracker {
                nominal_rad_s: settings.nominal_rad_s,
                lag_s: settings.lag_s,
            },
            settings,
            initial,
            initial_angle_rad,
            relays: (0..BLOCKS).map(relay).collect(),
        }
    }

    /// What relays compare with their settings.
    fn seen(&self, at: Terminal, state: &[f64]) -> f64 {
        let deviation = self.tracker.deviation(at.voltage, state[0]);
        let side = if self.settings.above { -1.0 } else { 1.0 };
        1.0 + side * deviation // (2)
    }
}

impl Part for FrequencyRelays {
    fn states(&self) -> usize {
        1
    }

    fn initial_state(&self) -> Vec<f64> {
        vec![self.initial_angle_rad]
    }

    fn current(&self, at: Terminal, _state: &[f64]) -> Phasor {
        let closed = self.relays.iter().filter(|relay| relay.closed()).count();
        let share = closed as f64 / BLOCKS as f64;
        (self.initial * share / at.voltage).conj() // (1)
    }

    fn derivatives(&self, at: Terminal, state: &[f64], slope: &mut [f64]) {
        slope[0] = self.tracker.rate_rad_s(at.voltage, state[0]);
    }

    fn guards(&self, at: Terminal, state: &[f64], guards: &mut Vec<f64>) {
        let seen = self.seen(at, state);
        guards.extend(self.relays.iter().map(|relay| relay.guard(seen)));
    }

    fn timer_s(&self) -> f64 {
        let timers = self.relays.iter().map(Relay::timer_s);
        timers.fold(f64::INFINITY, f64::min)
    }

    fn react(&mut self, at: Terminal, state: &[f64], log: &mut Vec<Operation>) {
        let seen = self.seen(at, state);
        for relay in &mut self.relays {
            if relay.react(at.time_s, seen) {
                log.push(Operation {
                    time_s: at.time_s,
                    part: "frequency_trip",
                    action: "trip",
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn relays(above: bool) -> FrequencyRelays {
        let settings = FrequencyRelaySettings {
            above,
            deviation: 0.003,
            delay_s: 0.1,
            lag_s: 0.02,
            nominal_rad_s: 377.0,
        };
        FrequencyRelays::new(settings, 0.2, Phasor::new(-0.1, 0.0))
    }

    /// The terminals where the tracked angle, here 0, changes as at this deviation.
    fn at(time_s: f64, deviation: f64) -> Terminal {
        Terminal {
            time_s,
            voltage: Phasor::from_polar(0.9, deviation * 377.0 * 0.02),
        }
    }

    #[test]
    fn blocks_feed_until_the_frequency_has_been_beyond_their_setting() {
        for (above, deviation) in [(false, -0.0035), (true, 0.0035)] {
            let mut relays = relays(above);
            let mut log = Vec::new();
            let power = |r: &FrequencyRelays| {
                let here = at(0.0, 0.0);
                (here.voltage * r.current(here, &[0.0]).conj()).re
            };
            relays.react(at(1.0, -deviation), &[0.0], &mut log);
            assert!(relays.timer_s().is_infinite());
            relays.react(at(2.0, deviation), &[0.0], &mut log);
            assert!((relays.timer_s() - 2.1).abs() < 1e-12);
            assert!((power(&relays) + 0.1).abs() < 1e-15);
            relays.react(at(2.1, deviation), &[0.0], &mut log);
            assert!(power(&relays).abs() < 1e-15);
            assert_eq!(log.len(), BLOCKS);
        }
    }

    #[test]
    fn between_the_settings_of_the_blocks_some_leave() {
        // 0.002817, 0.002850, 0.002883, 0.002917, 0.002950, ...
        let mut relays = relays(false);
        let mut log = Vec::new();
        relays.react(at(2.0, -0.00296), &[0.0], &mut log);
        relays.react(at(2.1, -0.00296), &[0.0], &mut log);
        assert_eq!(log.len(), 5);
    }
}
