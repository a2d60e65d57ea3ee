//! Publishing a plan at its pace.

use std::{collections::BTreeMap, time::Duration};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use tokio::time::{Instant, sleep_until};

use super::{Piece, Plan};
use crate::{
    adapters::{
        wire::v1::encode_batch_cbor,
        zenoh::{self, Encoding, Keys, Session},
    },
    commands::Error,
    measurement::{Channel, Record, SampleBatch, record::grid_offset_ns},
};

/// Time that one batch covers, seconds: PMU concentrators send a few frames at a time.
const BATCH_S: f64 = 0.1;
/// Batches between two questions whether everything has been taken in: half of the daemon's shortest
/// queue, so that nothing is ever dropped.
const BATCHES_BETWEEN_BARRIERS: u64 = 64;
/// Longest wait for the daemon to take in what was sent.
const BARRIER_LIMIT: Duration = Duration::from_mins(1);
/// Time between two events, seconds of the original: their real distance may be months.
const BETWEEN_EVENTS_S: f64 = 2.0;

/// How fast a plan is published.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::commands) struct Pace {
    speed: f64,
}

impl Pace {
    /// `speed` times faster than the original, 0 as fast as it is taken; none for anything else.
    pub(in crate::commands) fn new(speed: f64) -> Option<Self> {
        (speed >= 0.0 && speed.is_finite()).then_some(Self { speed })
    }

    pub(super) fn of(self, original_s: f64) -> Duration {
        if self.speed > 0.0 {
            Duration::from_secs_f64(original_s.max(0.0) / self.speed)
        } else {
            Duration::ZERO
        }
    }
}

/// What was published.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(in crate::commands) struct Played {
    pub(in crate::commands) samples: u64,
    pub(in crate::commands) batches: u64,
    pub(in crate::commands) recordings: u64,
}

/// Publishes plans.
#[derive(Debug)]
pub(in crate::commands) struct Player<'s> {
    session: &'s Session,
    keys: Keys,
    stream: String,
    pace: Pace,
}

impl<'s> Player<'s> {
    pub(in crate::commands) fn new(
        session: &'s Session,
        keys: Keys,
        stream: &str,
        pace: Pace,
    ) -> Self {
        Self {
            session,
            keys,
            stream: stream.to_owned(),
            pace,
        }
    }

    /// Publishes everything; `progress` is told of samples as they go out. Ends when the daemon has
    /// taken everything in.
    pub(in crate::commands) async fn play(
        &self,
        plan: &Plan,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<Played, Error> {
        // Nobody listening is noticed before anything is sent into the void.
        self.barrier("measurement").await?;
        let mut played = Played::default();
        let mut sequences = BTreeMap::new();
        for piece in &plan.pieces {
            match piece {
                Piece::Event { site, name, record } => {
                    let sequence = sequences.entry(site.as_str()).or_insert(0);
                    let before = *sequence;
                    self.event((site, name), record, sequence, progress).await?;
                    played.samples += record.samples.len() as u64;
                    played.batches += *sequence - before;
                }
                Piece::Recording {
                    site,
                    recorder,
                    payload,
                } => {
                    let key = self.keys.recording(site, recorder);
                    let encoding = Encoding::APPLICATION_CBOR;
                    zenoh::put(self.session, &key, payload.clone(), encoding).await?;
                    self.barrier("recording").await?;
                    played.recordings += 1;
                }
            }
        }
        self.barrier("measurement").await?;
        Ok(played)
    }

    async fn event(
        &self,
        (site, name): (&str, &str),
        record: &Record,
        sequence: &mut u64,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<(), Error> {
        let key = self.keys.measurement(site, &self.stream);
        let started = Instant::now();
        let length = batch_length(record.rate_fps);
        let channels = channels(record);
        for first in (0..record.samples.len()).step_by(length) {
            let last = (first + length).min(record.samples.len());
            let batch = SampleBatch {
                site: site.to_owned(),
                stream: self.stream.clone(),
                ..batch(record, &channels, first..last, *sequence)
            };
            let payload =
                encode_batch_cbor(&batch, record.nominal_hz).map_err(|source| Error::Batch {
                    event: name.to_owned(),
                    source,
                })?;
            // A batch can be sent when its last sample has been measured.
            sleep_until(started + self.pace.of(last as f64 / record.rate_fps)).await;
            zenoh::put(self.session, &key, payload, Encoding::APPLICATION_CBOR).await?;
            *sequence += 1;
            progress((last - first) as u64);
            if sequence.is_multiple_of(BATCHES_BETWEEN_BARRIERS) {
                self.barrier("measurement").await?;
            }
        }
        sleep_until(Instant::now() + self.pace.of(BETWEEN_EVENTS_S)).await;
        Ok(())
    }

    /// Waits until the daemon has taken in everything before this.
    async fn barrier(&self, queue: &str) -> Result<(), Error> {
        let selector = format!("{}?after={queue}", self.keys.status("*"));
        zenoh::ask(self.session, &selector, BARRIER_LIMIT).await?;
        Ok(())
    }
}

/// A bar on standard error; hidden when that is no terminal.
pub(in crate::commands) fn progress_bar(plan: &Plan) -> ProgressBar {
    let target = ProgressDrawTarget::stderr();
    let bar = ProgressBar::with_draw_target(Some(plan.sample_count() as u64), target);
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} samples, {eta} left");
    match style {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "rates are positive and at most some thousands per second"
)]
fn batch_length(rate_fps: f64) -> usize {
    (rate_fps * BATCH_S).round().max(1.0) as usize
}

/// The channels that a record has: those a load needs, and the optional ones that hold a value.
fn channels(record: &Record) -> Vec<Channel> {
    let holds_values = |channel: &Channel| {
        !channel.optional() || record.samples.iter().any(|s| s.value(*channel).is_finite())
    };
    Channel::ALL.into_iter().filter(holds_values).collect()
}

fn batch(
    record: &Record,
    channels: &[Channel],
    range: std::ops::Range<usize>,
    sequence: u64,
) -> SampleBatch {
    let start_ns = record.start_ns + grid_offset_ns(range.start as f64, record.rate_fps);
    let samples = &record.samples[range];
    SampleBatch {
        site: String::new(),
        stream: String::new(),
        sequence: Some(sequence),
        start_ns,
        rate_fps: record.rate_fps,
        channels: channels
            .iter()
            .map(|channel| {
                (
                    *channel,
                    samples.iter().map(|s| s.value(*channel)).collect(),
                )
            })
            .collect(),
        quality: samples.iter().map(|s| s.quality).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::{Quality, Sample};

    #[test]
    fn a_pace_is_a_speed_that_is_not_negative() {
        assert_eq!(Pace::new(0.0).unwrap().of(10.0), Duration::ZERO);
        assert_eq!(
            Pace::new(4.0).unwrap().of(10.0),
            Duration::from_millis(2500)
        );
        assert!(Pace::new(-1.0).is_none());
        assert!(Pace::new(f64::NAN).is_none());
    }

    #[test]
    fn a_channel_without_any_value_is_not_sent() {
        let record = Record {
            start_ns: 0,
            rate_fps: 60.0,
            nominal_hz: 60.0,
            samples: vec![Sample {
                voltage_pu: 1.0,
                frequency_hz: 60.0,
                active_pu: 1.0,
                reactive_pu: 0.2,
                quality: Quality::GOOD,
                ..Sample::missing(0)
            }],
        };
        assert_eq!(
            channels(&record),
            [
                Channel::VoltagePu,
                Channel::FrequencyHz,
                Channel::ActivePu,
                Channel::ReactivePu
            ]
        );
        assert_eq!(batch_length(60.0), 6);
        assert_eq!(batch_length(1.0), 1);
    }
}
