//! Loads that no catalogue has, written into recordings of sites that hide nothing: what they draw beside the load that is
//! there, sample by sample, from what the recording says of voltage and frequency.

use loadmodeld::{measurement::Record, truth::SyntheticSite};

/// What such a load does.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Novel {
    /// P swings after deep dips, damped.
    Swing,
    /// A block of P goes off a second after a deep dip, and comes back.
    DelayedBlock,
    /// P and Q follow the rate of the voltage.
    RateOfVoltage,
    /// P follows the rate of the frequency.
    RateOfFrequency,
    /// P pulsates, whatever the voltage does.
    Pulsation,
    /// P follows the voltage like a weight on a spring.
    SecondOrder,
    /// A capacitor is switched in after deep dips.
    Capacitor,
    /// P repeats what the voltage did a quarter of a second ago.
    Echo,
}

/// A dip below this share of the voltage before it is deep.
const DEEP: f64 = 0.85;
const TAU: f64 = std::f64::consts::TAU;

/// Numbers between 0 and 1 that follow from a site's number and a place.
fn drawn(number: u64, place: u64) -> f64 {
    // A fraction of multiples of the golden ratio fills the interval evenly.
    ((number * 7 + place * 3 + 1) as f64 * 0.618_033_988_749_895).fract()
}

impl Novel {
    pub(crate) const ALL: [Self; 8] = [
        Self::Swing,
        Self::DelayedBlock,
        Self::RateOfVoltage,
        Self::RateOfFrequency,
        Self::Pulsation,
        Self::SecondOrder,
        Self::Capacitor,
        Self::Echo,
    ];

    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Swing => "novel:swing",
            Self::DelayedBlock => "novel:delayed_block",
            Self::RateOfVoltage => "novel:rate_of_voltage",
            Self::RateOfFrequency => "novel:rate_of_frequency",
            Self::Pulsation => "novel:pulsation",
            Self::SecondOrder => "novel:second_order",
            Self::Capacitor => "novel:capacitor",
            Self::Echo => "novel:echo",
        }
    }

    /// Adds what this load draws to every recording of a site.
    pub(crate) fn write_into(self, site: &mut SyntheticSite, number: u64) {
        for record in &mut site.records {
            let drawn = self.draws(record, number);
            let first = record.samples.iter().find(|s| s.usable());
            let (p0, q0) = first.map_or((1.0, 0.0), |s| (s.active_pu, s.reactive_pu));
            let s0 = p0.hypot(q0);
            for (sample, [active, reactive]) in record.samples.iter_mut().zip(drawn) {
                sample.active_pu += active * p0;
                sample.reactive_pu += reactive * s0;
            }
        }
    }

    /// Shares of P0 and S0 that it draws at every sample.
    fn draws(self, record: &Record, number: u64) -> Vec<[f64; 2]> {
        let dt = 1.0 / record.rate_fps;
        let course = Course::of(record);
        let size = |low: f64, high: f64| low + (high - low) * drawn(number, 0);
        let time_s = |low: f64, high: f64| low + (high - low) * drawn(number, 1);
        let rate_hz = |low: f64, high: f64| low + (high - low) * drawn(number, 2);
        let since_deep = course.since_deep(dt);
        let after_deep = |of: &dyn Fn(f64) -> f64| -> Vec<f64> {
            let of = |since: &Option<f64>| since.map_or(0.0, of);
            since_deep.iter().map(of).collect()
        };
        let active = |values: Vec<f64>| values.into_iter().map(|p| [p, 0.0]).collect();
        match self {
            Self::Swing => {
                let (a, t, f) = (size(0.03, 0.08), time_s(0.6, 1.5), rate_hz(1.2, 2.5));
                active(after_deep(&|s| a * (-s / t).exp() * (TAU * f * s).sin()))
            }
            Self::DelayedBlock => {
                let (a, begin, lasts) =
                    (size(0.04, 0.1), time_s(0.8, 1.6), 1.0 + rate_hz(0.5, 1.5));
                let off = |s: f64| begin < s && s < begin + lasts;
                active(after_deep(&|s| if off(s) { -a } else { 0.0 }))
            }
            Self::RateOfVoltage => {
                let slopes = rates(&low_passed(&course.voltage, dt, time_s(0.15, 0.35)), dt);
                let a = size(0.03, 0.08);
                slopes.iter().map(|s| [a * s, 0.5 * a * s]).collect()
            }
            Self::RateOfFrequency => {
                let slow = low_passed(&course.frequency_hz, dt, time_s(0.15, 0.4));
                let a = size(0.04, 0.12);
                active(rates(&slow, dt).iter().map(|s| a * s).collect())
            }
            Self::Pulsation => {
                let (a, f) = (size(0.004, 0.015), rate_hz(0.4, 1.5));
                let count = course.voltage.len();
                active(
                    (0..count)
                        .map(|k| a * (TAU * f * k as f64 * dt).sin())
                        .collect(),
                )
            }
            Self::SecondOrder => {
                let follows = course.on_a_spring(dt, rate_hz(0.7, 1.6), time_s(0.1, 0.25));
                let a = size(0.1, 0.3);
                let both = follows.iter().zip(&course.voltage);
                active(both.map(|(x, v)| a * (x - v)).collect())
            }
            Self::Capacitor => {
                let (a, begin) = (size(0.04, 0.1), time_s(0.3, 1.0));
                let inserted = after_deep(&|s| if s > begin { -a } else { 0.0 });
                let both = inserted.iter().zip(&course.voltage);
                both.map(|(q, v)| [0.0, q * v * v]).collect()
            }
            Self::Echo => {
                let late_s = time_s(0.2, 0.35);
                let late = (1..100_u32).take_while(|k| f64::from(*k) * dt < late_s);
                let late = late.count();
                let a = size(0.1, 0.3);
                let voltage = &course.voltage;
                let then = |k: usize| voltage[k.saturating_sub(late)];
                active((0..voltage.len()).map(|k| a * (then(k) - 1.0)).collect())
            }
        }
    }
}

/// Voltage over that at the beginning and frequency, gaps bridged.
struct Course {
    voltage: Vec<f64>,
    frequency_hz: Vec<f64>,
}

impl Course {
    fn of(record: &Record) -> Self {
        let first = record.samples.iter().find(|s| s.usable());
        let (mut v, mut f) =
            first.map_or((1.0, record.nominal_hz), |s| (s.voltage_pu, s.frequency_hz));
        let v0 = v;
        let mut course = Self {
            voltage: Vec::new(),
            frequency_hz: Vec::new(),
        };
        for sample in &record.samples {
            if sample.usable() {
                (v, f) = (sample.voltage_pu, sample.frequency_hz);
            }
            course.voltage.push(v / v0);
            course.frequency_hz.push(f);
        }
        course
    }

    /// Seconds since the newest deep dip began.
    fn since_deep(&self, dt: f64) -> Vec<Option<f64>> {
        let mut since: Option<f64> = None;
        let mut was_deep = false;
        let mut list = Vec::with_capacity(self.voltage.len());
        for v in &self.voltage {
            let deep = *v < DEEP;
            since = if deep && !was_deep {
                Some(0.0)
            } else {
                since.map(|s| s + dt)
            };
            was_deep = deep;
            list.push(since);
        }
        list
    }

    /// A weight on a spring that hangs on the voltage, by the exact solution between samples.
    fn on_a_spring(&self, dt: f64, rate_hz: f64, damping: f64) -> Vec<f64> {
        let (w, parts) = (TAU * rate_hz, 20);
        let h = dt / f64::from(parts);
        let (mut x, mut speed) = (1.0, 0.0);
        let mut list = Vec::with_capacity(self.voltage.len());
        for v in &self.voltage {
            for _ in 0..parts {
                speed += h * (w * w * (v - x) - 2.0 * damping * w * speed);
                x += h * speed;
            }
            list.push(x);
        }
        list
    }
}

fn low_passed(values: &[f64], dt: f64, time_s: f64) -> Vec<f64> {
    let share = 1.0 - (-dt / time_s).exp();
    let mut y = values.first().copied().unwrap_or_default();
    let next = |value: &f64| {
        y += share * (value - y);
        y
    };
    values.iter().map(next).collect()
}

fn rates(values: &[f64], dt: f64) -> Vec<f64> {
    let of = |k: usize| (values[k] - values[k.saturating_sub(1)]) / dt;
    (0..values.len()).map(of).collect()
}
