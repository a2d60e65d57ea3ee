//! Messages and samples coming in.

use std::ops::AddAssign;

use tracing::{debug, error, info, trace, warn};

use super::{Metrics, Occurrence, catalogue};

/// Where a payload came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Source {
    /// A sample batch.
    Measurement,
    /// A disturbance recording.
    Recording,
    /// A query.
    Query,
}

impl Source {
    /// Every source.
    pub const ALL: [Self; 3] = [Self::Measurement, Self::Recording, Self::Query];

    /// The label.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Measurement => "measurement",
            Self::Recording => "recording",
            Self::Query => "query",
        }
    }
}

/// What became of the samples of a batch. The counts need not add up: an out-of-order sample is
/// also accepted, an unusable one too.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SampleCounts {
    /// Put in place.
    pub accepted: u64,
    /// Later than the lag time, and dropped.
    pub late: u64,
    /// There already, and dropped.
    pub duplicate: u64,
    /// Put in place behind a newer one.
    pub out_of_order: u64,
    /// In place, but flagged so that no fit may use them.
    pub unusable: u64,
    /// Instants released without data.
    pub missing: u64,
    /// Instants that a step forward in time, unless a jump, or a restart of the service passed over.
    pub skipped: u64,
    /// Off the grid or too far ahead, and dropped.
    pub refused: u64,
    /// Received with the source's word that they are invalid.
    pub invalid: u64,
    /// Received as stale or interpolated.
    pub stale: u64,
    /// Received with a value that is no number.
    pub not_finite: u64,
    /// Received from a clock that was not synchronised; usable.
    pub unsynchronised: u64,
}

/// A batch went into a site's stream.
#[derive(Clone, Debug, PartialEq)]
pub struct BatchTaken {
    /// Site.
    pub site: String,
    /// Stream.
    pub stream: String,
    /// What became of its samples.
    pub samples: SampleCounts,
    /// Batches of the stream missing before this one.
    pub lost_before: u64,
    /// Batches counted as lost that have arrived after all with this one.
    pub found: u64,
    /// Time of its newest sample, UTC nanoseconds.
    pub newest_ns: i64,
    /// Age of that sample, nanoseconds.
    pub lag_ns: i64,
    /// Samples per second, as the batch says.
    pub rate_fps: f64,
    /// Worst message time quality of its samples (C37.118.2, table 4): 0 locked, 15 failed.
    pub time_quality_code: u8,
    /// How the stream's time or rate changed with it, if they did.
    pub step: Option<TimeStep>,
}

/// A change of a stream's time or rate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TimeStep {
    /// Word for the metric: forward, jump, backward, rate, grid, restart.
    pub kind: &'static str,
    /// What happened, in words.
    pub words: String,
}

impl Occurrence for BatchTaken {
    fn emit(&self, metrics: &Metrics) {
        let site = self.site.as_str();
        let (newest_s, lag_s) = (seconds(self.newest_ns), seconds(self.lag_ns));
        metrics.batch(site, self.samples.accepted, newest_s, lag_s);
        // The first outcome is the accepted ones.
        for (outcome, count) in self.samples.by_outcome().into_iter().skip(1) {
            if count > 0 {
                metrics.add(&catalogue::SAMPLES, &[site, outcome], count);
            }
        }
        metrics.streams().batch(self);
        trace!(site, stream = self.stream, samples = ?self.samples, "batch taken in");
        if let Some(TimeStep { kind, words }) = &self.step {
            metrics.add(&catalogue::TIME_STEPS, &[site, kind], 1);
            let skipped = self.samples.skipped;
            warn!(
                site,
                stream = self.stream,
                kind,
                words,
                skipped,
                "the stream's time begins anew"
            );
        }
        if self.samples.late > 0 {
            debug!(
                site,
                stream = self.stream,
                samples = self.samples.late,
                "samples discarded: later than the lag time"
            );
        }
        if self.found > 0 {
            metrics.add(&catalogue::BATCHES_FOUND, &[site], self.found);
        }
        if self.lost_before > 0 {
            metrics.add(&catalogue::BATCHES_LOST, &[site], self.lost_before);
            warn!(
                site,
                stream = self.stream,
                batches = self.lost_before,
                "batches have not arrived"
            );
        }
    }
}

/// A measurement message is behind the detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageThrough {
    /// Time since it arrived, nanoseconds.
    pub took_ns: i64,
}

impl Occurrence for MessageThrough {
    fn emit(&self, metrics: &Metrics) {
        metrics.observe(&catalogue::INTAKE_SECONDS, &[], seconds(self.took_ns));
    }
}

impl SampleCounts {
    /// Each count with its label.
    #[must_use]
    pub const fn by_outcome(&self) -> [(&'static str, u64); 12] {
        [
            ("accepted", self.accepted),
            ("late", self.late),
            ("duplicate", self.duplicate),
            ("out_of_order", self.out_of_order),
            ("unusable", self.unusable),
            ("missing", self.missing),
            ("skipped", self.skipped),
            ("refused", self.refused),
            ("invalid", self.invalid),
            ("stale", self.stale),
            ("not_finite", self.not_finite),
            ("unsynchronised", self.unsynchronised),
        ]
    }
}

impl AddAssign for SampleCounts {
    fn add_assign(&mut self, other: Self) {
        self.accepted += other.accepted;
        self.late += other.late;
        self.duplicate += other.duplicate;
        self.out_of_order += other.out_of_order;
        self.unusable += other.unusable;
        self.missing += other.missing;
        self.skipped += other.skipped;
        self.refused += other.refused;
        self.invalid += other.invalid;
        self.stale += other.stale;
        self.not_finite += other.not_finite;
        self.unsynchronised += other.unsynchronised;
    }
}

/// A site's streams were taken to their end: they had fallen silent, or the service is stopping.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StreamEnded {
    /// Site.
    pub site: String,
    /// The stream that was heard last.
    pub stream: String,
    /// Instants released without data.
    pub missing: u64,
    /// Whether it was for silence.
    pub silent: bool,
}

impl Occurrence for StreamEnded {
    fn emit(&self, metrics: &Metrics) {
        let (site, stream, missing) = (self.site.as_str(), self.stream.as_str(), self.missing);
        if missing > 0 {
            metrics.add(&catalogue::SAMPLES, &[site, "missing"], missing);
        }
        if self.silent {
            metrics.add(&catalogue::SILENCES, &[site], 1);
            info!(site, stream, missing, "silent: what waited is released");
        }
        metrics.streams().ended(self);
    }
}

/// A recording was read.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingTaken {
    /// Site.
    pub site: String,
    /// Recorder, from the key.
    pub recorder: String,
    /// Phasors in it.
    pub samples: usize,
    /// Disturbances found in it.
    pub windows: usize,
}

impl Occurrence for RecordingTaken {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::RECORDINGS, &[&self.site], 1);
        info!(
            site = self.site,
            recorder = self.recorder,
            samples = self.samples,
            windows = self.windows,
            "recording taken in"
        );
    }

    fn sentence(&self) -> Option<String> {
        let (site, recorder) = (&self.site, &self.recorder);
        Some(format!(
            "{site}: recording of {recorder} taken in, {} phasors",
            self.samples
        ))
    }
}

/// A payload could not be understood or belongs to nobody.
#[derive(Clone, Debug, PartialEq)]
pub struct PayloadRefused {
    /// Where it came from.
    pub source: Source,
    /// Key it came on.
    pub key: String,
    /// Word for the metric, from a closed list.
    pub reason: &'static str,
    /// What was wrong, in words.
    pub error: String,
}

impl Occurrence for PayloadRefused {
    fn emit(&self, metrics: &Metrics) {
        let labels = [self.source.name(), self.reason];
        metrics.add(&catalogue::PAYLOADS_REFUSED, &labels, 1);
        let count = metrics.value(&catalogue::PAYLOADS_REFUSED, &labels);
        if is_worth_a_line(count) {
            let (key, reason) = (&self.key, self.reason);
            warn!(key, reason, error = self.error, count, "payload refused");
        }
    }

    fn sentence(&self) -> Option<String> {
        Some(format!("refused a payload on {}: {}", self.key, self.error))
    }
}

/// Frames of a C37.118 stream came in, since the last report on it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FramesTaken {
    /// Site.
    pub site: String,
    /// Stream.
    pub stream: String,
    /// The stream as the configuration calls it: `*` for any that has no table of its own.
    pub configured: String,
    /// How many had each outcome, by words from a closed list; only those that any had.
    pub outcomes: Vec<(&'static str, u64)>,
    /// The first one that could not be used: its outcome, and why.
    pub trouble: Option<(&'static str, String)>,
}

impl Occurrence for FramesTaken {
    fn emit(&self, metrics: &Metrics) {
        let (site, stream) = (self.site.as_str(), self.stream.as_str());
        for &(outcome, count) in &self.outcomes {
            metrics.add(
                &catalogue::FRAMES,
                &[site, &self.configured, outcome],
                count,
            );
        }
        metrics.streams().frames(self);
        trace!(site, stream, outcomes = ?self.outcomes, "frames taken in");
        if let Some((outcome, error)) = &self.trouble {
            warn!(site, stream, outcome, error, outcomes = ?self.outcomes, "frames not used");
        }
    }
}

/// The first ten of a kind are logged, then the 16th, the 32nd and so on: a flood of bad payloads
/// must not become a flood of log lines.
fn is_worth_a_line(count: f64) -> bool {
    const ALL_UP_TO: f64 = 10.0;
    count <= ALL_UP_TO || count.log2().fract().abs() < f64::EPSILON
}

/// The intake queue was full.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MessagesDropped {
    /// What was dropped.
    pub source: Source,
    /// How many since the last report.
    pub messages: u64,
}

impl Occurrence for MessagesDropped {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(
            &catalogue::MESSAGES_DROPPED,
            &[self.source.name()],
            self.messages,
        );
        error!(
            source = self.source.name(),
            messages = self.messages,
            "messages dropped: the intake queue was full"
        );
    }

    fn sentence(&self) -> Option<String> {
        Some(format!(
            "dropped {} messages: the intake queue was full",
            self.messages
        ))
    }
}

/// Nanoseconds as seconds, for gauges.
pub(super) fn seconds(nanoseconds: i64) -> f64 {
    nanoseconds as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_bad_payloads_makes_few_lines() {
        let lines = (1..=10_000)
            .filter(|n| is_worth_a_line(f64::from(*n)))
            .count();
        assert_eq!(lines, 10 + 10); // 1 to 10, then 16, 32, ... 8192
    }
}
