//! The store.

use tracing::{error, info, warn};

use super::{Metrics, Occurrence, catalogue, intake::seconds};

/// The store refused an operation.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoreFailed {
    /// Word for the metric, from a closed list.
    pub reason: &'static str,
    /// What it said.
    pub error: String,
    /// Whether the operation is tried again.
    pub retried: bool,
}

impl Occurrence for StoreFailed {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::STORE_ERRORS, &[self.reason], 1);
        error!(
            reason = self.reason,
            error = self.error,
            retried = self.retried,
            "the store refused an operation"
        );
    }

    fn sentence(&self) -> Option<String> {
        Some(format!("the store refused an operation: {}", self.error))
    }
}

/// Numbers of the store.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StoreMeasured {
    /// Jobs that wait.
    pub jobs_queued: u64,
    /// Jobs in somebody's hands.
    pub jobs_claimed: u64,
    /// Jobs parked.
    pub jobs_parked: u64,
    /// Age of the oldest due job, nanoseconds.
    pub oldest_due_job_age_ns: i64,
    /// Size, bytes.
    pub bytes: u64,
    /// What its disk has left, bytes; none where that is not known.
    pub disk_free_bytes: Option<u64>,
}

impl Occurrence for StoreMeasured {
    fn emit(&self, metrics: &Metrics) {
        metrics.set(&catalogue::JOBS, &["queued"], self.jobs_queued as f64);
        metrics.set(&catalogue::JOBS, &["claimed"], self.jobs_claimed as f64);
        metrics.set(&catalogue::JOBS, &["parked"], self.jobs_parked as f64);
        metrics.set(
            &catalogue::JOB_AGE,
            &[],
            seconds(self.oldest_due_job_age_ns),
        );
        metrics.set(&catalogue::STORE_BYTES, &[], self.bytes as f64);
        if let Some(free) = self.disk_free_bytes {
            metrics.set(&catalogue::STORE_DISK_FREE_BYTES, &[], free as f64);
        }
    }
}

/// Retention deleted something.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StorePruned {
    /// Waveforms.
    pub waveforms: usize,
    /// Summaries of windows.
    pub windows: usize,
    /// Documents of fits.
    pub fits: usize,
    /// Jobs.
    pub jobs: usize,
}

impl Occurrence for StorePruned {
    fn emit(&self, metrics: &Metrics) {
        let rows = [
            ("waveforms", self.waveforms),
            ("windows", self.windows),
            ("fits", self.fits),
            ("jobs", self.jobs),
        ];
        for (what, count) in rows {
            metrics.add(&catalogue::STORE_PRUNED, &[what], count as u64);
        }
        if rows.iter().any(|(_, count)| *count > 0) {
            info!(
                waveforms = self.waveforms,
                windows = self.windows,
                fits = self.fits,
                jobs = self.jobs,
                "retention deleted old records"
            );
        }
    }
}

/// Work that was left behind in the store was taken up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WorkTakenUp {
    /// Windows that had not been screened.
    pub windows: usize,
    /// Events that had not been announced.
    pub events: usize,
    /// Sets that had not been published.
    pub sets: usize,
}

impl Occurrence for WorkTakenUp {
    fn emit(&self, _metrics: &Metrics) {
        if self.windows + self.events + self.sets > 0 {
            warn!(
                windows = self.windows,
                events = self.events,
                sets = self.sets,
                "took up work that was left behind"
            );
        }
    }

    fn sentence(&self) -> Option<String> {
        let (windows, events, sets) = (self.windows, self.events, self.sets);
        (windows + events + sets > 0).then(|| {
            format!(
                "took up what was left behind: {windows} disturbances to screen, {events} events \
                 to announce, {sets} sets to publish"
            )
        })
    }
}
