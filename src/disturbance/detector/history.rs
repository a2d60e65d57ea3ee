//! The ring buffer and the level, trend and noise taken from it.

use std::{collections::VecDeque, ops::Range};

use super::options::Counts;
use crate::measurement::Sample;

/// The latest samples of one grid.
#[derive(Clone, Debug)]
pub(super) struct History {
    samples: VecDeque<Sample>,
    /// What may meet a trigger in each of them, else not a number. Read again with every sample: beside each
    /// other they take an eighth of the memory's lines, which counts with a thousand sites.
    voltages_pu: VecDeque<f64>,
    frequencies_hz: VecDeque<f64>,
    memory: usize,
}

/// Level, trend and noise over the base time, which ends where the step time begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Base {
    pub(super) voltage_pu: f64,
    pub(super) voltage_noise_pu: f64,
    pub(super) voltages: usize,
    pub(super) frequency: Option<FrequencyBase>,
}

/// The frequency's level and trend over the base time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FrequencyBase {
    /// Median, which belongs to the middle of the base time.
    level_hz: f64,
    /// Hertz per sample.
    trend_hz: f64,
    /// Samples from the middle of the base time to the newest sample.
    to_newest: f64,
    pub(super) noise_hz: f64,
    /// Whether at least half of the base time is known: less gives no trend.
    pub(super) has_trend: bool,
}

impl FrequencyBase {
    /// What the trend predicts for the sample `back` samples before the newest, hertz.
    pub(super) fn at(&self, back: usize) -> f64 {
        self.level_hz + self.trend_hz * (self.to_newest - back as f64)
    }
}

impl History {
    pub(super) fn new(memory: usize) -> Self {
        Self {
            samples: VecDeque::new(),
            voltages_pu: VecDeque::new(),
            frequencies_hz: VecDeque::new(),
            memory,
        }
    }

    pub(super) fn push(&mut self, sample: Sample) {
        if self.samples.len() == self.memory {
            self.samples.pop_front();
            self.voltages_pu.pop_front();
            self.frequencies_hz.pop_front();
        }
        let voltage_pu = trigger_voltage(&sample).unwrap_or(f64::NAN);
        let frequency_hz = trigger_frequency(&sample).unwrap_or(f64::NAN);
        self.voltages_pu.push_back(voltage_pu);
        self.frequencies_hz.push_back(frequency_hz);
        self.samples.push_back(sample);
    }

    pub(super) fn len(&self) -> usize {
        self.samples.len()
    }

    /// The sample `back` samples before the newest.
    pub(super) fn back(&self, back: usize) -> Option<&Sample> {
        self.samples
            .len()
            .checked_sub(back + 1)
            .and_then(|at| self.samples.get(at))
    }

    /// The newest `count` samples, oldest first.
    pub(super) fn newest(&self, count: usize) -> impl Iterator<Item = &Sample> {
        self.samples
            .iter()
            .skip(self.samples.len().saturating_sub(count))
    }

    /// Usable voltages of the samples `range` before the newest, oldest first.
    pub(super) fn voltages(&self, range: Range<usize>) -> Vec<f64> {
        known(&self.voltages_pu, range)
    }

    /// Usable frequencies of the samples `range` before the newest, oldest first.
    pub(super) fn frequencies(&self, range: Range<usize>) -> Vec<f64> {
        known(&self.frequencies_hz, range)
    }

    /// Level, trend and noise before the step time; none when too little is known.
    pub(super) fn base(&self, counts: &Counts) -> Option<Base> {
        let range = counts.step..counts.step + counts.base;
        // A twentieth of the base time is enough to begin with: recorders keep as little as 0.06 s
        // before a fault.
        let least = (counts.base / 20).max(5);
        let mut voltages = self.voltages(range.clone());
        if voltages.len() < least {
            return None;
        }
        Some(Base {
            voltage_noise_pu: noise(&voltages),
            voltages: voltages.len(),
            voltage_pu: median(&mut voltages)?,
            frequency: self.frequency_base(range, least),
        })
    }

    fn frequency_base(&self, range: Range<usize>, least: usize) -> Option<FrequencyBase> {
        let mut all = self.frequencies(range.clone());
        if all.len() < least {
            return None;
        }
        let noise_hz = noise(&all);
        let end = range.end.min(self.samples.len());
        let half = (end - range.start) / 2;
        let middle = range.start + half;
        let mut late = self.frequencies(range.start..middle);
        let mut early = self.frequencies(middle..end);
        let has_trend = 2 * all.len() >= range.end - range.start;
        let trend_hz = if has_trend {
            (median(&mut late)? - median(&mut early)?) / half as f64
        } else {
            0.0
        };
        Some(FrequencyBase {
            level_hz: median(&mut all)?,
            trend_hz,
            to_newest: middle as f64,
            noise_hz,
            has_trend,
        })
    }
}

/// The numbers among the values `range` before the newest, oldest first.
fn known(values: &VecDeque<f64>, range: Range<usize>) -> Vec<f64> {
    let end = values.len().saturating_sub(range.start);
    let start = values.len().saturating_sub(range.end);
    let mut known = Vec::with_capacity(end - start);
    known.extend(values.range(start..end).filter(|value| value.is_finite()));
    known
}

/// The voltage of a sample, if it may meet a trigger, pu.
pub(super) fn trigger_voltage(sample: &Sample) -> Option<f64> {
    let voltage_pu = sample.voltage_pu;
    (sample.quality.usable() && voltage_pu.is_finite()).then_some(voltage_pu)
}

/// The frequency of a sample, if it may meet a trigger, hertz.
pub(super) fn trigger_frequency(sample: &Sample) -> Option<f64> {
    let frequency_hz = sample.frequency_hz;
    (sample.quality.usable() && frequency_hz.is_finite()).then_some(frequency_hz)
}

/// Median; the upper one of an even number. Reorders the values.
pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Standard deviation of white noise, from the median of the successive differences: neither a
/// trend nor a step nor a spike counts.
fn noise(values: &[f64]) -> f64 {
    let mut differences: Vec<f64> = values.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    // 1.4826: standard deviation of a normal variable over its median magnitude.
    median(&mut differences).unwrap_or(0.0) * 1.4826 / std::f64::consts::SQRT_2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_found_beneath_a_trend_and_a_step() {
        // Plus and minus 0.001 in turn: differences of 0.002.
        let value =
            |k: u32| f64::from(k) * 1e-6 + if k > 70 { 0.05 } else { 0.0 } + 0.001 * alternating(k);
        let values: Vec<f64> = (0..100).map(value).collect();
        let expected = 0.002 * 1.4826 / std::f64::consts::SQRT_2;
        assert!((noise(&values) - expected).abs() < 0.02 * expected);
    }

    #[test]
    fn the_trend_of_the_frequency_is_carried_on_to_the_newest_sample() {
        let counts = Counts::new(&crate::disturbance::DetectorOptions::default(), 50.0);
        let mut history = History::new(counts.memory);
        for k in 0..counts.memory {
            let mut sample = Sample::missing(0);
            sample.quality = crate::measurement::Quality::GOOD;
            sample.voltage_pu = 1.0;
            sample.frequency_hz = 50.0 + 0.001 * k as f64;
            history.push(sample);
        }
        let newest_hz = 50.0 + 0.001 * (counts.memory - 1) as f64;
        let base = history.base(&counts).unwrap().frequency.unwrap();
        assert!((base.at(0) - newest_hz).abs() < 0.0011);
        assert!((base.at(10) - newest_hz + 0.01).abs() < 0.0011);
    }

    fn alternating(k: u32) -> f64 {
        if k.is_multiple_of(2) { 1.0 } else { -1.0 }
    }
}
