//! Terms along the voltage and the frequency of an event, as the instrument would report them.

use super::term::{POWER_VOLTAGE_MIN, QUICK_DELAY_S, Term};
use crate::identification::intake::PreparedEvent;

/// Half width of the spread of a threshold, pu, and time over which a latch switches, s: those of
/// the relays of effects.
const SPREAD_PU: f64 = 0.008;
const SWITCHING_S: f64 = 0.004;

/// What drives the terms of an event: the output instants of its simulation and, where the phasor
/// jumps, every point between.
#[derive(Clone, Debug)]
pub(super) struct Driven<'a> {
    event: &'a PreparedEvent,
    time_s: Vec<f64>,
    voltage: Vec<f64>,
    deviation: Vec<f64>,
    /// Places of the output instants.
    outputs: Vec<usize>,
}

impl<'a> Driven<'a> {
    pub(super) fn new(event: &'a PreparedEvent) -> Self {
        let input = &event.input;
        let per = input.points_per_sample;
        let frequency = event.chain.output_frequency_deviation();
        let points = input.output_points();
        let mut driven = Self {
            event,
            time_s: Vec::new(),
            voltage: Vec::new(),
            deviation: Vec::new(),
            outputs: Vec::new(),
        };
        let fine_s = input.sample_interval_s / per as f64;
        for (place, &point) in points.iter().enumerate() {
            driven.outputs.push(driven.time_s.len());
            let next = points.get(place + 1).copied().unwrap_or(point + 1);
            let end = if input.jumps.get(point / per) == Some(&true) {
                next
            } else {
                point + 1
            };
            for p in point..end {
                driven.time_s.push(p as f64 * fine_s);
                driven.voltage.push(input.real[p].hypot(input.imaginary[p]));
                driven.deviation.push(frequency[place]);
            }
        }
        driven
    }

    /// The term at every sample: what P shows of active power of this size, and Q of reactive.
    pub(super) fn measured(&self, term: &Term) -> Vec<f64> {
        let fine = self.along(term);
        let power: Vec<f64> = self.outputs.iter().map(|&k| fine[k]).collect();
        let none = vec![0.0; power.len()];
        let measured = self.event.chain.measured(&power, &none);
        measured.into_iter().map(|[p, _]| p).collect()
    }

    /// The term along every point.
    fn along(&self, term: &Term) -> Vec<f64> {
        let of_voltage = |f: &dyn Fn(f64) -> f64| self.voltage.iter().map(|v| f(*v)).collect();
        match *term {
            Term::Power { exponent } => {
                of_voltage(&|v| v.max(POWER_VOLTAGE_MIN).powf(exponent) - 1.0)
            }
            Term::Deficit { threshold } => of_voltage(&|v| (threshold - v).max(0.0)),
            Term::Excess { threshold } => of_voltage(&|v| (v - threshold).max(0.0)),
            Term::Below { threshold } => of_voltage(&|v| below(v, threshold)),
            Term::Lag { time_s } => {
                let lagged = self.lagged(&self.voltage, 1.0, time_s);
                let pairs = self.voltage.iter().zip(lagged);
                pairs.map(|(v, lagged)| v - lagged).collect()
            }
            Term::Frequency => self.deviation.clone(),
            Term::FrequencyLag { time_s } => self.lagged(&self.deviation, 0.0, time_s),
            Term::Lost { threshold, delay_s } => self.latched(threshold, delay_s),
            Term::LostImpedance { threshold, delay_s } => {
                let latched = self.latched(threshold, delay_s);
                let pairs = latched.iter().zip(&self.voltage);
                pairs.map(|(latched, v)| latched * v * v).collect()
            }
            Term::LostRamp { threshold, time_s } => {
                self.returning(threshold, |s| (1.0 - s / time_s).clamp(0.0, 1.0))
            }
            Term::LostDecay { threshold, time_s } => {
                self.returning(threshold, |s| (-s / time_s).exp())
            }
            Term::Memory { threshold } => {
                let mut lowest = 1.0_f64;
                let seen = self.voltage.iter().map(|v| {
                    lowest = lowest.min(*v);
                    (threshold - lowest).max(0.0)
                });
                seen.collect()
            }
            Term::Drift => self.time_s.clone(),
        }
    }

    /// A first-order lag, exact for an input that is straight between the points.
    fn lagged(&self, input: &[f64], at_rest: f64, time_constant_s: f64) -> Vec<f64> {
        let mut state = at_rest;
        let mut out = Vec::with_capacity(input.len());
        out.push(state);
        for (times, values) in self.time_s.windows(2).zip(input.windows(2)) {
            let (h, [x0, x1]) = (times[1] - times[0], [values[0], values[1]]);
            let slope = (x1 - x0) / h;
            let decay = (-h / time_constant_s).exp();
            state = x1 - slope * time_constant_s + (state - x0 + slope * time_constant_s) * decay;
            out.push(state);
        }
        out
    }

    /// A definite-time relay that stays.
    fn latched(&self, threshold: f64, delay_s: f64) -> Vec<f64> {
        let (mut timer_s, mut latched) = (0.0_f64, 0.0_f64);
        let mut out = vec![0.0];
        for (times, v) in self.time_s.windows(2).zip(self.voltage.windows(2)) {
            let condition = [below(v[0], threshold), below(v[1], threshold)];
            if condition[1] > 0.0 {
                timer_s += 0.5 * (condition[0] + condition[1]) * (times[1] - times[0]);
            } else {
                timer_s = 0.0;
            }
            latched = latched.max(smooth_step((timer_s - delay_s) / SWITCHING_S));
            out.push(latched);
        }
        out
    }

    /// A quick latch times a function of the time since it switched.
    fn returning(&self, threshold: f64, left: impl Fn(f64) -> f64) -> Vec<f64> {
        let latched = self.latched(threshold, QUICK_DELAY_S);
        let mut timer_s = 0.0;
        let mut out = vec![0.0];
        for (times, pair) in self.time_s.windows(2).zip(latched.windows(2)) {
            timer_s += 0.5 * (pair[0] + pair[1]) * (times[1] - times[0]);
            out.push(pair[1] * left(timer_s));
        }
        out
    }
}

fn below(voltage: f64, threshold: f64) -> f64 {
    smooth_step((threshold - voltage) * (0.5 / SPREAD_PU) + 0.5)
}

fn smooth_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}
