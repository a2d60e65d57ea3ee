//! Start, stop and the state of the loop.

use tracing::{debug, error, info};

use super::{Metrics, Occurrence, catalogue, intake::seconds};

/// The service is ready.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServiceReady {
    /// Instance.
    pub instance: String,
    /// Endpoints that zenoh listens on.
    pub zenoh: Vec<String>,
    /// Address of the HTTP server.
    pub http: Option<String>,
}

impl Occurrence for ServiceReady {
    fn emit(&self, _metrics: &Metrics) {
        info!(instance = self.instance, zenoh = ?self.zenoh, http = self.http, "ready");
    }
}

/// A connection waited until another one ended, because as many as are allowed were open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionWaited;

impl Occurrence for ConnectionWaited {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::HTTP_CONNECTIONS_DELAYED, &[], 1);
        debug!("an HTTP connection waited until another one ended");
    }
}

/// The service begins to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServiceStopping {
    /// Fits running.
    pub fits: usize,
    /// Windows that are not on durable storage yet.
    pub windows: usize,
}

impl Occurrence for ServiceStopping {
    fn emit(&self, _metrics: &Metrics) {
        info!(fits = self.fits, windows = self.windows, "stopping");
    }

    fn sentence(&self) -> Option<String> {
        Some(format!(
            "stopping: {} fits run, {} disturbances wait for the store",
            self.fits, self.windows
        ))
    }
}

/// The service could not finish what it had begun before the grace time was over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GraceExceeded {
    /// Fits still running.
    pub fits: usize,
    /// Windows lost.
    pub windows: usize,
}

impl Occurrence for GraceExceeded {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::WINDOWS_DROPPED, &[], self.windows as u64);
        error!(
            fits = self.fits,
            windows = self.windows,
            "stopped after the grace time"
        );
    }

    fn sentence(&self) -> Option<String> {
        Some(format!(
            "stopped after the grace time: {} fits given up, {} disturbances lost",
            self.fits, self.windows
        ))
    }
}

/// How long the loop's longest step took since the last report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoopMeasured {
    /// Nanoseconds.
    pub longest_step_ns: i64,
}

impl Occurrence for LoopMeasured {
    fn emit(&self, metrics: &Metrics) {
        metrics.set(&catalogue::LOOP_STEP, &[], seconds(self.longest_step_ns));
    }
}
