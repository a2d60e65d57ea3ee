//! Disturbances as one would make them for a test: dips, lasting steps of the voltage, deviations of the frequency.

use std::f64::consts::TAU;

use crate::{
    identification::intake::{KnownTerminal, PreparedEvent},
    load_model::TerminalInput,
};

/// What the terminal voltage does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Course {
    /// `times` falls to `voltage` for `duration_s` each, [`APART_S`] from the end of one to the next.
    Dips {
        voltage: f64,
        duration_s: f64,
        times: u32,
    },
    /// A step to `voltage` that stays.
    Step { voltage: f64 },
    /// The frequency goes by so much in [`SWING_S`], back half of the way in the same time, and stays.
    Frequency { deviation_hz: f64 },
}

/// A disturbance; voltages are shares of that before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::diagnosis) struct Plain(Course);

/// Time before a disturbance, after one, and after a step that stays, s.
const BEFORE_S: f64 = 1.0;
const AFTER_S: f64 = 10.0;
const AFTER_STEP_S: f64 = 30.0;
/// From the end of a dip to the next, s.
const APART_S: f64 = 0.5;
/// In which the frequency goes down, and in which it comes back half of the way, s.
const SWING_S: f64 = 3.0;
/// Fine grid points per sample interval.
const POINTS_PER_SAMPLE: usize = 32;
/// Nominal cycles on both sides of a jump in which samples say little: they are the instrument's.
const EDGE_CYCLES: f64 = 2.0;

const fn dip(voltage: f64, duration_s: f64) -> Plain {
    Plain(Course::Dips {
        voltage,
        duration_s,
        times: 1,
    })
}

const fn two_dips(voltage: f64) -> Plain {
    Plain(Course::Dips {
        voltage,
        duration_s: 0.1,
        times: 2,
    })
}

const fn step(voltage: f64) -> Plain {
    Plain(Course::Step { voltage })
}

const fn frequency(deviation_hz: f64) -> Plain {
    Plain(Course::Frequency { deviation_hz })
}

/// The disturbances that are tried, the most ordinary first.
pub(super) const ALL: [Plain; 20] = [
    step(0.97),
    step(1.03),
    step(0.95),
    step(1.05),
    dip(0.9, 0.1),
    frequency(-0.3),
    frequency(0.3),
    dip(0.8, 0.1),
    dip(0.7, 0.1),
    dip(0.6, 0.1),
    dip(0.8, 0.3),
    dip(0.7, 0.3),
    dip(0.5, 0.1),
    dip(0.6, 0.3),
    frequency(-1.0),
    dip(0.4, 0.1),
    dip(0.5, 0.3),
    two_dips(0.7),
    two_dips(0.5),
    dip(0.4, 0.3),
];

/// Where and how a disturbance is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::diagnosis) struct Seen {
    pub(super) v0_pu: f64,
    pub(super) p0_pu: f64,
    pub(super) q0_pu: f64,
    pub(super) rate_fps: f64,
    pub(super) nominal_hz: f64,
    /// Standard deviation of a sample of P over P0, and of Q.
    pub(super) noise: [f64; 2],
    /// As [`PreparedEvent::operating_point_deviation`].
    pub(super) operating_point_deviation: f64,
}

impl Plain {
    /// Dips to a share of the voltage, to the nearest hundredth.
    pub(super) fn dips(voltage: f64) -> [Self; 2] {
        let voltage = (100.0 * voltage).round() / 100.0;
        [dip(voltage, 0.1), dip(voltage, 0.3)]
    }

    /// In words.
    pub(super) fn words(self) -> String {
        match self.0 {
            Course::Dips {
                voltage,
                duration_s,
                times: 1,
            } => format!(
                "a dip to {:.0} % of the voltage for {duration_s:.1} s",
                100.0 * voltage
            ),
            Course::Dips {
                voltage,
                duration_s,
                times,
            } => format!(
                "{times} dips to {:.0} % of the voltage for {duration_s:.1} s each, {APART_S:.1} s apart",
                100.0 * voltage
            ),
            Course::Step { voltage } => {
                let way = if voltage < 1.0 { "fall" } else { "rise" };
                let size = 100.0 * (voltage - 1.0).abs();
                format!(
                    "a {way} of the voltage by {size:.0} % that lasts, recorded for {AFTER_STEP_S:.0} s"
                )
            }
            Course::Frequency { deviation_hz } => {
                let way = if deviation_hz < 0.0 { "falls" } else { "rises" };
                let size = deviation_hz.abs();
                format!(
                    "a frequency that {way} by {size:.1} Hz within {SWING_S:.0} s at a steady voltage"
                )
            }
        }
    }

    /// When the voltage last jumps, after the first sample, s; of a course without jumps when it begins.
    pub(super) fn over_s(self) -> f64 {
        match self.0 {
            Course::Dips {
                duration_s, times, ..
            } => BEFORE_S + f64::from(times) * duration_s + f64::from(times - 1) * APART_S,
            Course::Step { .. } | Course::Frequency { .. } => BEFORE_S,
        }
    }

    /// From when times are told, in words.
    pub(super) const fn since(self) -> &'static str {
        match self.0 {
            Course::Dips { .. } => "its end",
            Course::Step { .. } | Course::Frequency { .. } => "its beginning",
        }
    }

    fn length_s(self) -> f64 {
        match self.0 {
            Course::Step { .. } => BEFORE_S + AFTER_STEP_S,
            Course::Dips { .. } | Course::Frequency { .. } => self.over_s() + AFTER_S,
        }
    }

    /// Share of the voltage before it at a time after the first sample.
    fn voltage(self, time_s: f64) -> f64 {
        // A jump lies on a sample whatever the rounding of its time.
        let since = time_s - BEFORE_S + 1e-9;
        match self.0 {
            Course::Dips {
                voltage,
                duration_s,
                times,
            } => {
                let each = duration_s + APART_S;
                let low = (0..times)
                    .map(|k| since - f64::from(k) * each)
                    .any(|t| (0.0..duration_s).contains(&t));
                if low { voltage } else { 1.0 }
            }
            Course::Step { voltage } if since >= 0.0 => voltage,
            _ => 1.0,
        }
    }

    /// Deviation of the frequency, Hz.
    fn deviation_hz(self, time_s: f64) -> f64 {
        let Course::Frequency { deviation_hz } = self.0 else {
            return 0.0;
        };
        let way = (time_s - BEFORE_S) / SWING_S;
        let share = if way <= 1.0 {
            way.max(0.0)
        } else {
            (1.5 - 0.5 * way).max(0.5)
        };
        deviation_hz * share
    }

    /// The event as it would be recorded, P and Q at rest all the time.
    pub(super) fn event(self, seen: &Seen) -> PreparedEvent {
        let interval_s = 1.0 / seen.rate_fps;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "some thousand samples"
        )]
        let count = |time_s: f64| (time_s * seen.rate_fps).ceil() as usize;
        let samples = count(self.length_s()) + 1;
        let fine = (samples - 1) * POINTS_PER_SAMPLE + 1;
        let fine_s = interval_s / POINTS_PER_SAMPLE as f64;
        let (mut real, mut imaginary) = (Vec::with_capacity(fine), Vec::with_capacity(fine));
        let mut angle = 0.0;
        for k in 0..fine {
            let time_s = k as f64 * fine_s;
            let voltage = self.voltage(time_s);
            real.push(voltage * f64::cos(angle));
            imaginary.push(voltage * f64::sin(angle));
            angle += TAU * fine_s * self.deviation_hz(time_s + 0.5 * fine_s);
        }
        let at = |k: usize| k as f64 * interval_s;
        let jumps: Vec<bool> = (0..samples - 1)
            .map(|k| (self.voltage(at(k)) - self.voltage(at(k + 1))).abs() > 0.0)
            .collect();
        let reach = count(EDGE_CYCLES / seen.nominal_hz);
        let near = |k: usize| {
            jumps[k.saturating_sub(reach + 1)..(k + reach).min(jumps.len())].contains(&true)
        };
        let used = (0..samples).map(|k| !near(k)).collect();
        let q0_over_p0 = seen.q0_pu / seen.p0_pu;
        let mut event = PreparedEvent::from(KnownTerminal {
            id: self.words(),
            input: TerminalInput {
                real,
                imaginary,
                points_per_sample: POINTS_PER_SAMPLE,
                sample_interval_s: interval_s,
                dense: vec![false; jumps.len()],
                jumps,
                synchronous_speed_rad_s: TAU * seen.nominal_hz,
            },
            q0_over_p0,
            active: vec![1.0; samples],
            reactive: vec![q0_over_p0; samples],
            frequency_deviation: (0..samples)
                .map(|k| self.deviation_hz(at(k)) / seen.nominal_hz)
                .collect(),
            noise: seen.noise,
            operating_point_deviation: seen.operating_point_deviation,
            event_start: count(BEFORE_S),
        });
        event.v0_pu = seen.v0_pu;
        event.p0_pu = seen.p0_pu;
        event.q0_pu = seen.q0_pu;
        event.used = used;
        event
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SEEN: Seen = Seen {
        v0_pu: 1.02,
        p0_pu: 0.8,
        q0_pu: 0.2,
        rate_fps: 50.0,
        nominal_hz: 50.0,
        noise: [1e-3, 2e-3],
        operating_point_deviation: 1e-4,
    };

    #[test]
    fn a_dip_is_as_deep_and_as_long_as_said() {
        let plain = two_dips(0.7);
        let event = plain.event(&SEEN);
        let low = event.voltage.iter().filter(|v| **v < 0.71).count();
        assert_eq!(low, 10);
        assert!((event.lowest_voltage - 0.7).abs() < 1e-12);
        assert!((plain.over_s() - 1.7).abs() < 1e-12);
        let at = |sample: usize| event.voltage[sample];
        assert!(at(82) < 0.71 && at(86) > 0.99 && at(65) > 0.99);
        // Four jumps, two cycles on both sides of each.
        assert_eq!(event.input.jumps.iter().filter(|j| **j).count(), 4);
        let used = |k: usize| event.used[k];
        assert!(used(47) && !used(48) && !used(57) && used(58));
        assert!(plain.words().starts_with("2 dips to 70 %"));
    }

    #[test]
    fn the_angle_is_the_integral_of_the_frequency() {
        let event = frequency(-0.3).event(&SEEN);
        let deviation = &event.frequency_deviation;
        let least = deviation.iter().copied().fold(0.0, f64::min);
        assert!((least * 50.0 + 0.3).abs() < 1e-3);
        assert!((deviation[deviation.len() - 1] * 50.0 + 0.15).abs() < 1e-12);
        let sum: f64 = deviation.windows(2).map(|d| 0.5 * (d[0] + d[1])).sum();
        let turns = sum * 50.0 / 50.0;
        let (re, im) = (event.input.real.last(), event.input.imaginary.last());
        let angle = im.unwrap().atan2(*re.unwrap());
        assert!((angle - TAU * turns).sin().abs() < 1e-3);
        assert!(event.used.iter().all(|used| *used));
    }

    #[test]
    fn every_one_is_told_from_the_others() {
        let words: std::collections::HashSet<String> = ALL.iter().map(|p| p.words()).collect();
        assert_eq!(words.len(), ALL.len());
    }
}
