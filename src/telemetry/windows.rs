//! Disturbance windows on their way to durable storage and to the event key.

use tracing::{debug, error, info};

use super::{Metrics, Occurrence, catalogue};

/// A disturbance was cut out of a stream or recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WindowFound {
    /// Identifier.
    pub window: String,
    /// Why it was closed, from a closed list.
    pub closing: &'static str,
}

impl Occurrence for WindowFound {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::WINDOWS_CLOSED, &[self.closing], 1);
        debug!(
            window = self.window,
            closing = self.closing,
            "disturbance found"
        );
    }
}

/// A window is on durable storage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WindowKept {
    /// Identifier.
    pub window: String,
    /// Site.
    pub site: String,
    /// Whether it was there before.
    pub known: bool,
}

impl Occurrence for WindowKept {
    fn emit(&self, metrics: &Metrics) {
        if self.known {
            debug!(window = self.window, "disturbance was recorded before");
        } else {
            metrics.add(&catalogue::WINDOWS, &[&self.site], 1);
            debug!(window = self.window, "disturbance recorded");
        }
    }
}

/// A window was lost.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WindowDropped {
    /// Identifier.
    pub window: String,
    /// Why, in words.
    pub reason: String,
}

impl Occurrence for WindowDropped {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::WINDOWS_DROPPED, &[], 1);
        error!(
            window = self.window,
            reason = self.reason,
            "disturbance lost"
        );
    }

    fn sentence(&self) -> Option<String> {
        Some(format!(
            "lost the disturbance {}: {}",
            self.window, self.reason
        ))
    }
}

/// How many windows are in memory only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WindowsSpooled {
    /// Windows.
    pub windows: usize,
}

impl Occurrence for WindowsSpooled {
    fn emit(&self, metrics: &Metrics) {
        metrics.set(&catalogue::WINDOWS_SPOOLED, &[], self.windows as f64);
    }
}

/// Screening judged a window.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowScreened {
    /// Identifier.
    pub window: String,
    /// Site.
    pub site: String,
    /// Objections that forbid its use, from a closed list; empty when it is usable.
    pub refusals: Vec<&'static str>,
    /// The same in words, with their numbers.
    pub in_words: String,
}

impl Occurrence for WindowScreened {
    fn emit(&self, metrics: &Metrics) {
        let usable = self.refusals.is_empty();
        let verdict = if usable { "usable" } else { "refused" };
        metrics.add(&catalogue::WINDOWS_SCREENED, &[&self.site, verdict], 1);
        for reason in &self.refusals {
            metrics.add(&catalogue::SCREENING_REFUSALS, &[reason], 1);
        }
        info!(
            window = self.window,
            verdict,
            reasons = self.in_words,
            "disturbance screened"
        );
    }

    fn sentence(&self) -> Option<String> {
        let window = &self.window;
        Some(match (self.refusals.is_empty(), self.in_words.is_empty()) {
            (true, true) => format!("disturbance {window}: usable"),
            (true, false) => format!("disturbance {window}: usable, but {}", self.in_words),
            (false, _) => format!("disturbance {window}: not used, {}", self.in_words),
        })
    }
}

/// The summary of an event is on its key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct EventAnnounced {
    /// Identifier.
    pub window: String,
}

impl Occurrence for EventAnnounced {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::EVENTS_ANNOUNCED, &[], 1);
        debug!(window = self.window, "event announced");
    }
}
