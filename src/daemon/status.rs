//! What the daemon says of itself on its status key.

use std::sync::{Mutex, PoisonError};

use serde::Serialize;

/// How the daemon is doing.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Status {
    /// Version of this format: 1.
    pub v: u64,
    /// Instance.
    pub instance: String,
    /// Version of the program.
    pub program: String,
    /// Whether it is stopping.
    pub stopping: bool,
    /// Whether nothing is under way in memory. Jobs that wait in the store do not count.
    pub at_rest: bool,
    /// Fits that run.
    pub fits_running: usize,
    /// Parameter sets published since the start.
    pub sets_published: u64,
    /// Diagnoses published since the start.
    pub diagnoses_published: u64,
    /// Ticks of the loop since the start.
    pub ticks: u64,
}

/// The newest status, written by the loop and read by everybody.
#[derive(Debug)]
pub(super) struct StatusBoard {
    status: Mutex<Status>,
    instance: String,
}

impl StatusBoard {
    pub(super) fn new(instance: &str) -> Self {
        Self {
            status: Mutex::new(Status {
                v: 1,
                instance: instance.to_owned(),
                program: env!("CARGO_PKG_VERSION").to_owned(),
                ..Status::default()
            }),
            instance: instance.to_owned(),
        }
    }

    pub(super) fn instance(&self) -> &str {
        &self.instance
    }

    pub(super) fn read(&self) -> Status {
        self.lock().clone()
    }

    pub(super) fn update(&self, change: impl FnOnce(&mut Status)) {
        change(&mut self.lock());
    }

    pub(super) fn document(&self) -> String {
        serde_json::to_string(&self.read()).unwrap_or_default()
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Status> {
        self.status.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
