//! A transformer whose taps follow the load's voltage, in steps and with delays.
//!
//! ```text
//! (1)  V_load = a V,  I = a I_load                 a = 1 at rest
//! (2)  |V_load - V_set| > db/2 for T_first         one step of a towards V_set
//! (3)  still so T_next after a step                another one
//! ```
//!
//! Source: Kundur (1994), section 11.2; delays and deadband as on-load tap changers have them.

use super::load::{Operation, Terminal};

/// Settings of a tap changer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TapSettings {
    /// One step of the ratio.
    pub(super) step: f64,
    /// Whole width of the deadband, pu.
    pub(super) deadband_pu: f64,
    /// Delay of the first step, s.
    pub(super) first_s: f64,
    /// Delay of every further step, s.
    pub(super) next_s: f64,
    /// Most steps to either side.
    pub(super) steps_max: i32,
}

/// A tap changer.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct TapChanger {
    settings: TapSettings,
    setpoint_pu: f64,
    position: i32,
    due_s: f64,
    side: i32,
}

impl TapChanger {
    /// At its middle position, holding the voltage that the load has at rest.
    pub(super) fn new(settings: TapSettings, setpoint_pu: f64) -> Self {
        Self {
            settings,
            setpoint_pu,
            position: 0,
            due_s: f64::INFINITY,
            side: 0,
        }
    }

    pub(super) fn ratio(&self) -> f64 {
        1.0 + self.settings.step * f64::from(self.position) // (1)
    }

    pub(super) fn guards(&self, voltage_pu: f64) -> [f64; 2] {
        let (deviation, half) = (
            voltage_pu - self.setpoint_pu,
            0.5 * self.settings.deadband_pu,
        );
        [deviation - half, deviation + half]
    }

    pub(super) fn timer_s(&self) -> f64 {
        self.due_s
    }

    pub(super) fn react(&mut self, at: Terminal, log: &mut Vec<Operation>) {
        const ROUNDING_S: f64 = 1e-11;
        let [above, below] = self.guards(at.voltage.norm());
        let wanted = if above > 0.0 {
            -1
        } else {
            i32::from(below < 0.0)
        };
        let possible = (self.position + wanted).abs() <= self.settings.steps_max;
        if wanted == 0 || !possible {
            (self.side, self.due_s) = (0, f64::INFINITY);
        } else if wanted != self.side {
            (self.side, self.due_s) = (wanted, at.time_s + self.settings.first_s); // (2)
        } else if at.time_s >= self.due_s - ROUNDING_S {
            self.position += wanted;
            self.due_s = at.time_s + self.settings.next_s; // (3)
            log.push(Operation {
                time_s: at.time_s,
                part: "tap_changer",
                action: if wanted > 0 { "raise" } else { "lower" },
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::Phasor;

    fn at(time_s: f64, voltage: f64) -> Terminal {
        Terminal {
            time_s,
            voltage: Phasor::new(voltage, 0.0),
        }
    }

    #[test]
    fn steps_come_after_the_first_delay_and_then_after_the_next_until_the_voltage_is_back() {
        let settings = TapSettings {
            step: 0.0125,
            deadband_pu: 0.02,
            first_s: 3.0,
            next_s: 1.0,
            steps_max: 16,
        };
        let mut taps = TapChanger::new(settings, 1.0);
        let mut log = Vec::new();
        taps.react(at(0.0, 0.995), &mut log);
        assert!(taps.timer_s().is_infinite());
        // 0.97 at the transformer: 0.97 x 1.0125 = 0.98213, x 1.025 = 0.99425, inside 0.99..1.01.
        taps.react(at(1.0, 0.97), &mut log);
        assert!((taps.timer_s() - 4.0).abs() < 1e-12);
        for time_s in [4.0, 5.0] {
            taps.react(at(time_s, 0.97 * taps.ratio()), &mut log);
        }
        taps.react(at(5.0, 0.97 * taps.ratio()), &mut log);
        assert!((taps.ratio() - 1.025).abs() < 1e-12 && taps.timer_s().is_infinite());
        assert_eq!(log.len(), 2);
    }

    #[test]
    fn a_short_dip_moves_nothing() {
        let settings = TapSettings {
            step: 0.01,
            deadband_pu: 0.02,
            first_s: 3.0,
            next_s: 1.0,
            steps_max: 16,
        };
        let mut taps = TapChanger::new(settings, 1.0);
        let mut log = Vec::new();
        taps.react(at(1.0, 0.7), &mut log);
        taps.react(at(1.1, 1.0), &mut log);
        taps.react(at(4.0, 1.0), &mut log);
        assert!(log.is_empty() && (taps.ratio() - 1.0).abs() < 1e-15);
    }
}
