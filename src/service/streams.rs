//! Measurements of each site on their way to windows.

use std::collections::BTreeMap;

use super::{DecodedRecording, SiteOptions, outbox::Outbox};
use crate::{
    disturbance::{Closing, Detector, Screening, Window, screen, window_of_recording},
    measurement::{Concentrator, Progress, Quality, Restart, SampleBatch, record::grid_offset_ns},
    telemetry::intake::{
        BatchTaken, PayloadRefused, RecordingTaken, SampleCounts, Source, StreamEnded, TimeStep,
    },
};

/// Steps forward of at least this length are held against the time that passed between the arrivals. Chosen: longer
/// than what a source delivers late after an outage.
const JUMP_S_MIN: f64 = 3600.0;
/// A step that went on this many times as far as the arrivals is a jump of the stamps, between two recordings or of a
/// clock: nobody measured in between. Chosen: a live source has 1, a replay in a hurry some tens.
const JUMP_PACE: f64 = 100.0;

/// All sites.
#[derive(Debug)]
pub(super) struct Streams {
    sites: BTreeMap<String, Stream>,
    silence_ns: i64,
}

#[derive(Debug)]
struct Stream {
    options: SiteOptions,
    concentrator: Concentrator,
    detector: Detector,
    /// When the last batch arrived; none when everything has been released since.
    arrived_ns: Option<i64>,
    /// When the last batch arrived, released or not.
    last_arrived_ns: Option<i64>,
    /// Which stream it was of.
    heard: String,
    /// How far an earlier run of the service had come; none once data have followed.
    earlier: Option<Progress>,
    /// Newest instant of which the store knows.
    kept_ns: Option<i64>,
    /// The one that it has been asked to keep.
    asked_ns: Option<i64>,
}

impl Streams {
    pub(super) fn new(sites: Vec<SiteOptions>, silence_ns: i64) -> Self {
        let sites = sites
            .into_iter()
            .map(|site| (site.site.name.clone(), Stream::new(site)))
            .collect();
        Self { sites, silence_ns }
    }

    /// Takes a batch in and returns the windows that it completed.
    pub(super) fn push(
        &mut self,
        now_ns: i64,
        batch: &SampleBatch,
        out: &mut Outbox,
    ) -> Vec<Window> {
        let Some(stream) = self.sites.get_mut(&batch.site) else {
            out.report(unknown_site(Source::Measurement, &batch.site));
            return Vec::new();
        };
        stream.push(now_ns, batch, out)
    }

    /// Takes a recording in: one window, or none when no sample of it can be used.
    pub(super) fn push_recording(
        &self,
        recording: DecodedRecording,
        out: &mut Outbox,
    ) -> Option<Window> {
        let Some(stream) = self.sites.get(&recording.site) else {
            out.report(unknown_site(Source::Recording, &recording.site));
            return None;
        };
        let samples = recording.record.samples.len();
        let options = &stream.options;
        let window = window_of_recording(&options.site, recording.record, &options.detector);
        if window.is_none() {
            out.report(PayloadRefused {
                source: Source::Recording,
                key: format!("{}/{}", recording.site, recording.recorder),
                reason: "no_usable_sample",
                error: format!("none of the {samples} phasors of the recording can be used"),
            });
            return None;
        }
        out.report(RecordingTaken {
            site: recording.site,
            recorder: recording.recorder,
            samples,
            windows: 1,
        });
        window
    }

    /// Takes note of how far an earlier run of the service had come.
    pub(super) fn resume(&mut self, progress: Vec<(String, Progress)>) {
        for (site, progress) in progress {
            if let Some(stream) = self.sites.get_mut(&site) {
                stream.kept_ns = Some(progress.newest_ns);
                stream.earlier = Some(progress);
            }
        }
    }

    /// How far the sites have come that have come further than the store knows.
    pub(super) fn progress(&mut self) -> Vec<(String, Progress)> {
        let streams = self.sites.iter_mut();
        streams
            .filter_map(|(site, stream)| Some((site.clone(), stream.progress()?)))
            .collect()
    }

    /// The store has kept, or has not, what [`Self::progress`] gave the last time.
    pub(super) fn progress_answered(&mut self, kept: bool) {
        for stream in self.sites.values_mut() {
            let asked_ns = stream.asked_ns.take();
            if kept && asked_ns.is_some() {
                stream.kept_ns = asked_ns;
            }
        }
    }

    /// Ends the streams that have been silent for too long.
    pub(super) fn end_silent(&mut self, now_ns: i64, out: &mut Outbox) -> Vec<Window> {
        let silence_ns = self.silence_ns;
        let silent = |arrived_ns| now_ns.saturating_sub(arrived_ns) >= silence_ns;
        self.end_where(silent, true, out)
    }

    /// Ends all streams: the service is stopping.
    pub(super) fn end_all(&mut self, out: &mut Outbox) -> Vec<Window> {
        self.end_where(|_| true, false, out)
    }

    /// Whether nothing waits for more samples.
    pub(super) fn at_rest(&self) -> bool {
        self.sites
            .values()
            .all(|stream| stream.arrived_ns.is_none())
    }

    /// The verdict of screening; a window of an unknown site is judged by the default settings.
    pub(super) fn screen(&self, window: &Window) -> Screening {
        match self.sites.get(&window.site) {
            Some(stream) => screen(window, &stream.options.screening),
            None => screen(window, &crate::disturbance::ScreeningOptions::default()),
        }
    }

    fn end_where(
        &mut self,
        wanted: impl Fn(i64) -> bool,
        silent: bool,
        out: &mut Outbox,
    ) -> Vec<Window> {
        self.sites
            .values_mut()
            .filter(|stream| stream.arrived_ns.is_some_and(&wanted))
            .flat_map(|stream| stream.end(silent, out))
            .collect()
    }
}

impl Stream {
    fn new(options: SiteOptions) -> Self {
        Self {
            concentrator: Concentrator::new(&options.site, options.concentrator.clone()),
            detector: Detector::new(&options.site, options.detector),
            options,
            arrived_ns: None,
            last_arrived_ns: None,
            heard: String::new(),
            earlier: None,
            kept_ns: None,
            asked_ns: None,
        }
    }

    fn push(&mut self, now_ns: i64, batch: &SampleBatch, out: &mut Outbox) -> Vec<Window> {
        self.arrived_ns = Some(now_ns);
        let waited_ns = now_ns.saturating_sub(self.last_arrived_ns.replace(now_ns).unwrap_or(0));
        batch.stream.clone_into(&mut self.heard);
        let before = self.come_to();
        let report = self.concentrator.push(batch);
        let (step, skipped) = self.step(before, report.restart, batch.start_ns, waited_ns);
        let flagged = |flag| batch.quality.iter().filter(|q| q.contains(flag)).count() as u64;
        let (mut windows, mut missing) = (Vec::new(), 0);
        for run in self.concentrator.drain() {
            missing += run.missing as u64;
            windows.extend(self.detector.push_run(&run));
        }
        let last = batch.len().saturating_sub(1) as f64;
        let newest_ns = batch
            .start_ns
            .saturating_add(grid_offset_ns(last, batch.rate_fps));
        out.report(BatchTaken {
            site: batch.site.clone(),
            stream: batch.stream.clone(),
            samples: SampleCounts {
                accepted: report.accepted,
                late: report.late,
                duplicate: report.duplicate,
                out_of_order: report.out_of_order,
                unusable: report.bad_quality,
                missing,
                skipped,
                refused: report.off_grid + report.overflow,
                invalid: flagged(Quality::DATA_INVALID),
                stale: flagged(Quality::STALE),
                not_finite: flagged(Quality::NOT_FINITE),
                unsynchronised: flagged(Quality::NOT_SYNCHRONISED),
            },
            lost_before: report.lost_batches,
            found: report.found_batches,
            newest_ns,
            lag_ns: now_ns.saturating_sub(newest_ns),
            rate_fps: batch.rate_fps,
            time_quality_code: batch
                .quality
                .iter()
                .map(|quality| quality.time_quality_code())
                .max()
                .unwrap_or(0),
            step,
        });
        if let Some(refusal) = report.refusal {
            out.report(PayloadRefused {
                source: Source::Measurement,
                key: format!("{}/{}", batch.site, batch.stream),
                reason: refusal.label(),
                error: refusal.to_string(),
            });
        }
        windows
    }

    fn end(&mut self, silent: bool, out: &mut Outbox) -> Vec<Window> {
        self.arrived_ns = None;
        let (mut windows, mut missing) = (Vec::new(), 0);
        for run in self.concentrator.flush() {
            missing += run.missing as u64;
            windows.extend(self.detector.push_run(&run));
        }
        windows.extend(self.detector.flush(Closing::StreamSilent));
        out.report(StreamEnded {
            site: self.options.site.name.clone(),
            stream: self.heard.clone(),
            missing,
            silent,
        });
        windows
    }

    /// How far its measurements have come, in this run of the service or before it.
    fn come_to(&self) -> Option<Progress> {
        let now = self
            .concentrator
            .newest_ns()
            .zip(self.concentrator.rate_fps());
        let now = now.map(|(newest_ns, rate_fps)| Progress {
            newest_ns,
            rate_fps,
        });
        now.or(self.earlier)
    }

    fn progress(&mut self) -> Option<Progress> {
        let progress = self.come_to()?;
        if self.kept_ns == Some(progress.newest_ns) {
            return None;
        }
        self.asked_ns = Some(progress.newest_ns);
        Some(progress)
    }

    /// How the time changed with a batch that starts at `start_ns` and came `waited_ns` after the one before, and
    /// the instants that were passed over.
    fn step(
        &mut self,
        before: Option<Progress>,
        restart: Option<Restart>,
        start_ns: i64,
        waited_ns: i64,
    ) -> (Option<TimeStep>, u64) {
        let (Some(restart), Some(before)) = (restart, before) else {
            return (None, 0);
        };
        self.earlier = None;
        let skipped = before.instants_before(start_ns);
        let kind = match restart {
            // The first data of this run, and an earlier one had come to a moment that is not before.
            Restart::First if skipped == 0 => return (None, 0),
            Restart::First => "restart",
            Restart::Forward { gap_s } if is_jump(gap_s, waited_ns) => {
                let words = format!("the stamps jumped forward by {gap_s:.0} s");
                return (
                    Some(TimeStep {
                        kind: "jump",
                        words,
                    }),
                    0,
                );
            }
            Restart::Forward { .. } => "forward",
            Restart::Backward { .. } => "backward",
            Restart::OffGrid { rate_fps } if (rate_fps - before.rate_fps).abs() < 1e-6 => "grid",
            Restart::OffGrid { .. } => "rate",
        };
        let words = match restart {
            Restart::First => format!("the service was away for {skipped} instants"),
            other => other.to_string(),
        };
        (Some(TimeStep { kind, words }), skipped)
    }
}

/// Whether a step forward is far longer than the time that passed.
fn is_jump(gap_s: f64, waited_ns: i64) -> bool {
    gap_s >= JUMP_S_MIN && gap_s >= JUMP_PACE * (waited_ns.max(0) as f64 / 1e9)
}

fn unknown_site(source: Source, site: &str) -> PayloadRefused {
    PayloadRefused {
        source,
        key: site.to_owned(),
        reason: "unknown_site",
        error: format!("the site `{site}` is not configured"),
    }
}
