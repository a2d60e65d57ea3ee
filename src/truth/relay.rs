//! Definite-time undervoltage relays: what drops out, trips, lets go or stalls below a voltage.
//!
//! ```text
//! closed --V < V_drop--> dropping --T_drop later--> open --V > V_return--> returning --T_return later--> closed
//!        <---V >= V_drop---                              <---V <= V_return---
//! ```

/// Settings of a relay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RelaySettings {
    /// Opens below this voltage, pu.
    pub(super) drop_below_pu: f64,
    /// After this time below it, s.
    pub(super) drop_delay_s: f64,
    /// Closes again above this voltage, pu; infinite for never.
    pub(super) return_above_pu: f64,
    /// After this time above it, s.
    pub(super) return_delay_s: f64,
    /// Opens at this dip of the window only, counted from 1.
    pub(super) dips: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Stage {
    Closed,
    Dropping { due_s: f64 },
    Open,
    Returning { due_s: f64 },
}

/// A relay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Relay {
    settings: RelaySettings,
    stage: Stage,
    dips_left: u32,
}

/// Delays end this much early, seconds: less than any step, more than rounding.
const ROUNDING_S: f64 = 1e-11;

impl Relay {
    /// A closed relay.
    pub(super) fn new(settings: RelaySettings) -> Self {
        Self {
            settings,
            stage: Stage::Closed,
            dips_left: settings.dips,
        }
    }

    pub(super) fn closed(&self) -> bool {
        matches!(self.stage, Stage::Closed | Stage::Dropping { .. })
    }

    /// Changes its sign when the relay wants to look.
    pub(super) fn guard(&self, voltage_pu: f64) -> f64 {
        let level = if self.closed() {
            self.settings.drop_below_pu
        } else {
            self.settings.return_above_pu
        };
        if level.is_finite() {
            voltage_pu - level
        } else {
            -1.0
        }
    }

    /// When the running delay ends.
    pub(super) fn timer_s(&self) -> f64 {
        match self.stage {
            Stage::Dropping { due_s } | Stage::Returning { due_s } => due_s,
            Stage::Closed | Stage::Open => f64::INFINITY,
        }
    }

    /// Looks at the voltage; whether the relay opened or closed.
    pub(super) fn react(&mut self, time_s: f64, voltage_pu: f64) -> bool {
        let settings = self.settings;
        let low = voltage_pu < settings.drop_below_pu;
        let recovered = voltage_pu > settings.return_above_pu;
        if self.stage == Stage::Closed && low {
            self.dips_left = self.dips_left.saturating_sub(1);
            self.stage = Stage::Dropping {
                due_s: if self.dips_left == 0 {
                    time_s + settings.drop_delay_s
                } else {
                    f64::INFINITY
                },
            };
        } else if self.stage == Stage::Open && recovered {
            self.stage = Stage::Returning {
                due_s: time_s + settings.return_delay_s,
            };
        }
        match self.stage {
            Stage::Dropping { .. } if !low => self.stage = Stage::Closed,
            Stage::Returning { .. } if !recovered => self.stage = Stage::Open,
            Stage::Dropping { due_s } if time_s >= due_s - ROUNDING_S => {
                self.stage = Stage::Open;
                return true;
            }
            Stage::Returning { due_s } if time_s >= due_s - ROUNDING_S => {
                self.stage = Stage::Closed;
                return true;
            }
            _ => {}
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn relay(dips: u32) -> Relay {
        Relay::new(RelaySettings {
            drop_below_pu: 0.7,
            drop_delay_s: 0.05,
            return_above_pu: 0.8,
            return_delay_s: 0.1,
            dips,
        })
    }

    #[test]
    fn it_opens_after_its_delay_and_closes_after_the_other() {
        let mut relay = relay(1);
        assert!(!relay.react(1.0, 0.6));
        assert!((relay.timer_s() - 1.05).abs() < 1e-12 && relay.closed());
        assert!(relay.react(1.05, 0.6) && !relay.closed());
        assert!(relay.timer_s().is_infinite());
        assert!(!relay.react(1.2, 0.75), "between the levels it stays open");
        assert!(!relay.react(1.3, 0.9));
        assert!(relay.react(1.4, 0.9) && relay.closed());
    }

    #[test]
    fn a_dip_shorter_than_the_delay_does_nothing() {
        let mut relay = relay(1);
        relay.react(1.0, 0.6);
        assert!(!relay.react(1.03, 0.75));
        assert!(!relay.react(1.05, 0.75) && relay.closed());
        assert!(relay.timer_s().is_infinite());
    }

    #[test]
    fn a_relay_that_counts_opens_at_its_dip_only() {
        let mut relay = relay(2);
        relay.react(1.0, 0.6);
        assert!(!relay.react(1.05, 0.6) && relay.closed());
        relay.react(1.2, 0.9);
        relay.react(1.5, 0.6);
        assert!(relay.react(1.55, 0.6) && !relay.closed());
    }

    #[test]
    fn guards_change_sign_where_the_relay_must_look() {
        let mut relay = relay(1);
        assert!(relay.guard(0.71) > 0.0 && relay.guard(0.69) < 0.0);
        relay.react(1.0, 0.6);
        relay.react(1.05, 0.6);
        assert!(relay.guard(0.79) < 0.0 && relay.guard(0.81) > 0.0);
    }
}
