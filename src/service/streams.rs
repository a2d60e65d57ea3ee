//! Measurements of each site on their way to windows.

use std::collections::BTreeMap;

use super::{DecodedRecording, SiteOptions, outbox::Outbox};
use crate::{
    disturbance::{Closing, Detector, Screening, Window, screen, window_of_recording},
    measurement::{Concentrator, SampleBatch, record::grid_offset_ns},
    telemetry::intake::{BatchTaken, PayloadRefused, RecordingTaken, SampleCounts, Source},
};

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

    /// Ends the streams that have been silent for too long.
    pub(super) fn end_silent(&mut self, now_ns: i64) -> Vec<Window> {
        let silence_ns = self.silence_ns;
        self.end_where(|arrived_ns| now_ns.saturating_sub(arrived_ns) >= silence_ns)
    }

    /// Ends all streams: the service is stopping.
    pub(super) fn end_all(&mut self) -> Vec<Window> {
        self.end_where(|_| true)
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

    fn end_where(&mut self, silent: impl Fn(i64) -> bool) -> Vec<Window> {
        self.sites
            .values_mut()
            .filter(|stream| stream.arrived_ns.is_some_and(&silent))
            .flat_map(Stream::end)
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
        }
    }

    fn push(&mut self, now_ns: i64, batch: &SampleBatch, out: &mut Outbox) -> Vec<Window> {
        self.arrived_ns = Some(now_ns);
        let report = self.concentrator.push(batch);
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
                refused: report.off_grid + report.overflow,
            },
            lost_before: report.lost_batches,
            newest_ns,
            lag_ns: now_ns.saturating_sub(newest_ns),
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

    fn end(&mut self) -> Vec<Window> {
        self.arrived_ns = None;
        let mut windows = Vec::new();
        for run in self.concentrator.flush() {
            windows.extend(self.detector.push_run(&run));
        }
        windows.extend(self.detector.flush(Closing::StreamSilent));
        windows
    }
}

fn unknown_site(source: Source, site: &str) -> PayloadRefused {
    PayloadRefused {
        source,
        key: site.to_owned(),
        reason: "unknown_site",
        error: format!("the site `{site}` is not configured"),
    }
}
