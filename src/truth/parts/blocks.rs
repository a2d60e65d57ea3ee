//! Many small devices with relays of their own: electronics, lamps, contactors, whatever lets go.
//!
//! ```text
//! (1)  S = S0 (v^np + j ... v^nq) times the share that is connected
//! (2)  device k of n lets go below V_k and returns above V_k + margin; V_k spread evenly from
//!      V_first (the first to go) down to V_last
//! ```
//!
//! With many devices (2) is the straight line between two voltages of composite load models, and
//! the devices that never return are their memory of the lowest voltage.

use crate::truth::{
    Phasor,
    load::{Operation, Part, Terminal},
    relay::{Relay, RelaySettings},
};

/// Settings of a group of devices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::truth) struct BlocksSettings {
    /// Name in the log.
    pub(in crate::truth) part: &'static str,
    /// Number of devices.
    pub(in crate::truth) devices: usize,
    /// Voltage at which the first device goes, pu.
    pub(in crate::truth) first_pu: f64,
    /// Voltage at which the last device goes, pu.
    pub(in crate::truth) last_pu: f64,
    /// Time below its voltage after which a device goes, s.
    pub(in crate::truth) drop_delay_s: f64,
    /// Share of every device's power that returns.
    pub(in crate::truth) returning: f64,
    /// How far above its own voltage a device returns, pu.
    pub(in crate::truth) margin_pu: f64,
    /// Shortest and longest time above that voltage after which devices return, s.
    pub(in crate::truth) return_delay_s: (f64, f64),
    /// Devices go at this dip of the window, counted from 1.
    pub(in crate::truth) dips: u32,
    /// Exponents of P and of Q.
    pub(in crate::truth) exponents: (f64, f64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Device {
    relay: Relay,
    share: f64,
}

/// A group of devices at its operating point.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::truth) struct Blocks {
    settings: BlocksSettings,
    initial_voltage_pu: f64,
    initial: Phasor,
    devices: Vec<Device>,
}

impl Blocks {
    /// Devices that together draw `initial` at `initial_voltage_pu`, all connected.
    pub(in crate::truth) fn new(
        settings: BlocksSettings,
        initial_voltage_pu: f64,
        initial: Phasor,
    ) -> Self {
        let count = settings.devices.max(1);
        let devices = (0..count).flat_map(|k| {
            let place = (k as f64 + 0.5) / count as f64;
            let level = settings.first_pu + place * (settings.last_pu - settings.first_pu); // (2)
            let (quick, slow) = settings.return_delay_s;
            let coming_back = RelaySettings {
                drop_below_pu: level,
                drop_delay_s: settings.drop_delay_s,
                return_above_pu: level + settings.margin_pu,
                return_delay_s: quick + place * (slow - quick),
                dips: settings.dips,
            };
            let gone_for_good = RelaySettings {
                return_above_pu: f64::INFINITY,
                ..coming_back
            };
            let share = 1.0 / count as f64;
            [
                (coming_back, share * settings.returning),
                (gone_for_good, share * (1.0 - settings.returning)),
            ]
        });
        Self {
            settings,
            initial_voltage_pu,
            initial,
            devices: devices
                .filter(|(_, share)| *share > 0.0)
                .map(|(relay, share)| Device {
                    relay: Relay::new(relay),
                    share,
                })
                .collect(),
        }
    }

    fn connected(&self) -> f64 {
        let closed = self.devices.iter().filter(|device| device.relay.closed());
        closed.map(|device| device.share).sum()
    }
}

impl Part for Blocks {
    fn current(&self, at: Terminal, _state: &[f64]) -> Phasor {
        let v = at.voltage.norm() / self.initial_voltage_pu;
        let (active, reactive) = self.settings.exponents;
        let power = Phasor::new(
            self.initial.re * v.powf(active),
            self.initial.im * v.powf(reactive),
        );
        (power * self.connected() / at.voltage).conj() // (1)
    }

    fn guards(&self, at: Terminal, _state: &[f64], guards: &mut Vec<f64>) {
        let voltage_pu = at.voltage.norm();
        guards.extend(self.devices.iter().map(|d| d.relay.guard(voltage_pu)));
    }

    fn timer_s(&self) -> f64 {
        let timers = self.devices.iter().map(|device| device.relay.timer_s());
        timers.fold(f64::INFINITY, f64::min)
    }

    fn react(&mut self, at: Terminal, _state: &[f64], log: &mut Vec<Operation>) {
        let voltage_pu = at.voltage.norm();
        for device in &mut self.devices {
            if device.relay.react(at.time_s, voltage_pu) {
                log.push(Operation {
                    time_s: at.time_s,
                    part: self.settings.part,
                    action: if device.relay.closed() {
                        "return"
                    } else {
                        "drop"
                    },
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn electronics(devices: usize) -> Blocks {
        let settings = BlocksSettings {
            part: "electronic_load_dropout",
            devices,
            first_pu: 0.7,
            last_pu: 0.5,
            drop_delay_s: 0.0,
            returning: 0.8,
            margin_pu: 0.0,
            return_delay_s: (0.0, 0.0),
            dips: 1,
            exponents: (0.0, 0.0),
        };
        Blocks::new(settings, 1.0, Phasor::new(0.2, 0.0))
    }

    fn power_at(blocks: &mut Blocks, time_s: f64, voltage: f64) -> f64 {
        let at = Terminal {
            time_s,
            voltage: Phasor::new(voltage, 0.0),
        };
        blocks.react(at, &[], &mut Vec::new());
        (at.voltage * blocks.current(at, &[]).conj()).re
    }

    #[test]
    fn many_devices_follow_the_composite_load_models_line_and_its_memory() {
        // WECC: c = (V - Vd2)/(Vd1 - Vd2) on the way down;
        // c = [(Vmin - Vd2) + frcel (min(V, Vd1) - Vmin)]/(Vd1 - Vd2) on the way up.
        // Vd1 = 0.7, Vd2 = 0.5, frcel = 0.8, Vmin = 0.56:
        // at 0.56: 0.3; back at 0.64: (0.06 + 0.8 x 0.08)/0.2 = 0.62; at 1: (0.06 + 0.112)/0.2 = 0.86.
        let mut blocks = electronics(2000);
        for (time_s, voltage, share) in [
            (0.0, 1.0, 1.0),
            (1.0, 0.56, 0.3),
            (1.1, 0.64, 0.62),
            (1.2, 1.0, 0.86),
        ] {
            let power = power_at(&mut blocks, time_s, voltage);
            // Half a device: 1/4000.
            assert!((power / 0.2 - share).abs() < 6e-4, "{voltage}: {power}");
        }
    }

    #[test]
    fn a_voltage_above_the_first_level_drops_nothing() {
        let mut blocks = electronics(20);
        assert!((power_at(&mut blocks, 1.0, 0.701) - 0.2).abs() < 1e-14);
        assert!((power_at(&mut blocks, 1.1, 0.49)).abs() < 1e-14);
    }

    #[test]
    fn lamps_strike_again_after_their_delay_only() {
        let settings = BlocksSettings {
            part: "discharge_lighting",
            returning: 1.0,
            return_delay_s: (1.0, 2.0),
            exponents: (1.0, 4.5),
            ..electronics(1).settings
        };
        let mut lamps = Blocks::new(settings, 1.0, Phasor::new(0.1, 0.05));
        assert!(power_at(&mut lamps, 1.0, 0.4).abs() < 1e-15);
        assert!(power_at(&mut lamps, 1.2, 0.9).abs() < 1e-15);
        assert!(
            (lamps.timer_s() - 2.7).abs() < 1e-12,
            "the middle of 1 to 2 s later"
        );
        assert!((power_at(&mut lamps, 2.7, 0.9) - 0.09).abs() < 1e-15);
    }
}
