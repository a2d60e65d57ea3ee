//! Everything about one event.

use super::{
    Channel, EventFailure, EventSeries, Segment,
    cross_correlation::cross_correlation,
    dependence::dependences,
    segments,
    sentence::{gravest, sentence},
};
use crate::identification::{evaluate::Curves, intake::PreparedEvent};

/// Where a model fails in an event.
///
/// `curves` is the model's answer to the event, of the event's length.
#[must_use]
pub fn failure(event: &PreparedEvent, curves: &Curves) -> EventFailure {
    failure_of_series(&event.id, EventSeries::new(event, curves))
}

/// Where an event departs from `curves` so far and so long that it is no noise, in words; none where it does
/// not. Looked for away from the voltage's edges.
#[must_use]
pub fn departure(event: &PreparedEvent, curves: &Curves) -> Option<String> {
    let series = EventSeries::new(event, curves);
    let clearing_s = segments::clearing_s(&series);
    gravest(&series, clearing_s)
}

/// The same from samples that are side by side already.
#[must_use]
pub fn failure_of_series(event: &str, series: EventSeries) -> EventFailure {
    let clearing_s = segments::clearing_s(&series);
    let error_to_noise = error_to_noise(&series);
    EventFailure {
        event: event.to_owned(),
        sentence: sentence(&series, clearing_s, error_to_noise),
        lowest_voltage: series.voltage.iter().copied().fold(f64::NAN, f64::min),
        frequency_deviation: largest_frequency_deviation(&series),
        error_to_noise,
        clearing_s,
        segments: segments::residuals(&series, clearing_s),
        dependences: dependences(&series, clearing_s),
        cross_correlations: [Channel::Active, Channel::Reactive]
            .into_iter()
            .filter_map(|channel| cross_correlation(&series, channel))
            .collect(),
        series,
    }
}

fn error_to_noise(series: &EventSeries) -> f64 {
    let (mut square, mut count) = (0.0, 0.0);
    for channel in [Channel::Active, Channel::Reactive] {
        let values = series.channel(channel);
        for k in series.onset()..series.len() {
            if series.counts(channel, k) {
                square += (values.residual(k) / values.deviation[k]).powi(2);
                count += 1.0;
            }
        }
    }
    if count > 0.0 {
        (square / count).sqrt()
    } else {
        0.0
    }
}

/// Near edges the angle turns with the voltage's jump, not with the frequency.
fn largest_frequency_deviation(series: &EventSeries) -> f64 {
    (series.onset()..series.len())
        .filter(|&k| series.used[k] && !series.near_edge[k])
        .map(|k| series.frequency_deviation[k])
        .filter(|deviation| deviation.is_finite())
        .fold(
            0.0,
            |most: f64, x| if x.abs() > most.abs() { x } else { most },
        )
}

impl EventFailure {
    /// The segment of a sample of its series.
    #[must_use]
    pub fn segment_of(&self, sample: usize) -> Segment {
        segments::segment_at(self.series.time_s[sample], self.clearing_s)
    }
}
