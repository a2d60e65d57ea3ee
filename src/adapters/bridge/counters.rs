//! What a bridge has seen, for those who look from outside.

use std::sync::{Mutex, PoisonError};

use crate::adapters::c37118::{DialogueCounts, StreamCounters};

/// Counts since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Totals {
    /// Connections that stood.
    pub connections: u64,
    /// Attempts that failed.
    pub refused: u64,
    /// Connections that the source closed, or that broke.
    pub broken: u64,
    /// Connections given up because the source had fallen silent.
    pub silent: u64,
    /// Connections given up because no configuration came.
    pub unanswered: u64,
    /// Datagrams that came from another host than the source's and were not looked at.
    pub foreign: u64,
    /// Bytes and frames of all connections.
    pub stream: StreamCounters,
    /// What the frames were.
    pub dialogue: DialogueCounts,
    /// Frames dropped because whoever takes them on was too slow.
    pub dropped: u64,
    /// Frames taken on.
    pub delivered: u64,
    /// Frames that could not be published.
    pub unpublished: u64,
    /// Frames published while nobody subscribed to them: no daemon, or no way to it.
    pub unheard: u64,
}

/// Totals that several tasks write.
#[derive(Debug, Default)]
pub struct Counters(Mutex<Totals>);

impl Counters {
    /// As they are now.
    pub fn read(&self) -> Totals {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes them.
    pub fn update(&self, change: impl FnOnce(&mut Totals)) {
        change(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner));
    }
}

impl Totals {
    /// Each count with its name, for a log line or a document.
    #[must_use]
    pub const fn named(&self) -> [(&'static str, u64); 22] {
        let (stream, dialogue) = (&self.stream, &self.dialogue);
        [
            ("connections", self.connections),
            ("refused", self.refused),
            ("broken", self.broken),
            ("silent", self.silent),
            ("unanswered", self.unanswered),
            ("foreign", self.foreign),
            ("bytes", stream.bytes),
            ("frames", stream.frames),
            ("skipped_bytes", stream.skipped_bytes),
            ("bad_checksums", stream.bad_checksums),
            ("data", dialogue.data),
            ("configurations", dialogue.configurations),
            ("reconfigurations", dialogue.reconfigurations),
            ("before_configuration", dialogue.before_configuration),
            ("not_as_configured", dialogue.not_as_configured),
            ("malformed", dialogue.malformed),
            ("other", dialogue.other),
            ("commands", dialogue.commands),
            ("dropped", self.dropped),
            ("delivered", self.delivered),
            ("unpublished", self.unpublished),
            ("unheard", self.unheard),
        ]
    }
}
