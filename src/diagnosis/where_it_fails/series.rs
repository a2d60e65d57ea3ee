//! The samples of an event and of a model of it, side by side.

use super::Channel;
use crate::identification::{evaluate::Curves, intake::PreparedEvent};

/// One channel of an event, over P0. All vectors have the length of the event.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelSeries {
    /// Measured.
    pub measured: Vec<f64>,
    /// Modelled.
    pub model: Vec<f64>,
    /// Standard deviation that the fit assumes for each sample.
    pub deviation: Vec<f64>,
}

/// An event and its model, sample by sample. All vectors have the same length.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EventSeries {
    /// Time since the onset, seconds.
    pub time_s: Vec<f64>,
    /// Voltage over its value before the event.
    pub voltage: Vec<f64>,
    /// Frequency deviation from its value before the event, relative to nominal.
    pub frequency_deviation: Vec<f64>,
    /// Active power over P0.
    pub active: ChannelSeries,
    /// Reactive power over P0.
    pub reactive: ChannelSeries,
    /// Whether the sample counts in the fit.
    pub used: Vec<bool>,
    /// Whether the sample lies within two cycles of a voltage edge.
    pub near_edge: Vec<bool>,
    /// Instants of the voltage's jumps, where they are known better than to a sample, seconds since
    /// the onset.
    pub jumps_s: Vec<f64>,
}

impl ChannelSeries {
    /// Measured minus modelled at a sample, over P0.
    #[must_use]
    pub fn residual(&self, sample: usize) -> f64 {
        self.measured[sample] - self.model[sample]
    }
}

impl EventSeries {
    /// Puts a model beside an event.
    #[must_use]
    pub fn new(event: &PreparedEvent, curves: &Curves) -> Self {
        let onset = event.event_start as f64;
        let since_onset = |position: f64| (position - onset) / event.rate_fps;
        Self {
            time_s: (0..event.len()).map(|k| since_onset(k as f64)).collect(),
            voltage: event.voltage.clone(),
            frequency_deviation: event.frequency_deviation.clone(),
            active: ChannelSeries {
                measured: event.active.clone(),
                model: curves.active.clone(),
                deviation: event.active_deviation.clone(),
            },
            reactive: ChannelSeries {
                measured: event.reactive.clone(),
                model: curves.reactive.clone(),
                deviation: event.reactive_deviation.clone(),
            },
            used: event.used.clone(),
            near_edge: event.near_edge.clone(),
            jumps_s: event
                .edges
                .iter()
                .map(|edge| since_onset(edge.position))
                .collect(),
        }
    }

    /// One of its channels.
    #[must_use]
    pub const fn channel(&self, channel: Channel) -> &ChannelSeries {
        match channel {
            Channel::Active => &self.active,
            Channel::Reactive => &self.reactive,
        }
    }

    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there is no sample.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Seconds between samples.
    #[must_use]
    pub fn interval_s(&self) -> f64 {
        match self.time_s.as_slice() {
            [first, .., last] => (last - first) / (self.len() - 1) as f64,
            _ => 1.0,
        }
    }

    /// What a stretch that lasts to the end reaches, s since the onset.
    pub(super) fn end_s(&self) -> f64 {
        let last = self.time_s.last();
        last.map_or(0.0, |last| last - self.interval_s())
    }

    /// First sample of the event part.
    #[must_use]
    pub fn onset(&self) -> usize {
        self.time_s.partition_point(|time| *time < 0.0)
    }

    /// Whether a sample counts in the fit and has a residual with a deviation.
    #[must_use]
    pub fn counts(&self, channel: Channel, sample: usize) -> bool {
        let series = self.channel(channel);
        self.used[sample]
            && series.residual(sample).is_finite()
            && series.deviation[sample].is_finite()
            && series.deviation[sample] > 0.0
    }

    /// Whether a sample of the event part counts and lies away from edges: there the residual is the
    /// model's and not the instrument's.
    #[must_use]
    pub fn tells_of_the_load(&self, channel: Channel, sample: usize) -> bool {
        self.time_s[sample] >= 0.0 && !self.near_edge[sample] && self.counts(channel, sample)
    }
}
