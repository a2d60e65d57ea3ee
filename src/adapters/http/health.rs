//! Whether the service is alive and whether it is ready.

use std::{
    fmt,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicI64, Ordering},
    },
};

use serde::Serialize;

use super::WorkBoard;

/// A loop without a step for so long is dead, nanoseconds. The loop ticks several times a second.
const STALLED_NS: i64 = 5_000_000_000;

/// What the daemon tells about itself, and what probes read.
pub struct Health {
    clock: Box<dyn Fn() -> i64 + Send + Sync>,
    progress_ns: AtomicI64,
    zenoh_open: AtomicBool,
    store_answers: AtomicBool,
    stopping: AtomicBool,
    work: Arc<WorkBoard>,
}

impl fmt::Debug for Health {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Health")
            .field("report", &self.report())
            .finish_non_exhaustive()
    }
}

/// The answer to a probe.
#[allow(
    clippy::struct_excessive_bools,
    reason = "each is a check of its own, with a name that probes read"
)]
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HealthReport {
    /// The loop makes progress: otherwise restart the service.
    pub live: bool,
    /// The store and zenoh answer and the service is not stopping: otherwise send it nothing.
    pub ready: bool,
    /// Seconds since the loop's last step.
    pub loop_idle_seconds: f64,
    /// Whether the store answered the last time, and its disk had space left.
    pub store: bool,
    /// Whether the zenoh session is open.
    pub zenoh: bool,
    /// Whether the service is stopping.
    pub stopping: bool,
}

impl Health {
    /// Nothing is ready yet. `clock` gives UTC nanoseconds.
    pub fn new(clock: impl Fn() -> i64 + Send + Sync + 'static) -> Self {
        let now_ns = clock();
        Self {
            clock: Box::new(clock),
            progress_ns: AtomicI64::new(now_ns),
            zenoh_open: AtomicBool::new(false),
            store_answers: AtomicBool::new(false),
            stopping: AtomicBool::new(false),
            work: Arc::default(),
        }
    }

    /// The jobs under way.
    pub const fn work(&self) -> &Arc<WorkBoard> {
        &self.work
    }

    /// The loop has made a step.
    pub fn progress(&self, now_ns: i64) {
        self.progress_ns.store(now_ns, Ordering::Relaxed);
    }

    /// Whether the zenoh session is open.
    pub fn set_zenoh(&self, open: bool) {
        self.zenoh_open.store(open, Ordering::Relaxed);
    }

    /// Whether the store answered.
    pub fn set_store(&self, answers: bool) {
        self.store_answers.store(answers, Ordering::Relaxed);
    }

    /// The service is stopping.
    pub fn set_stopping(&self) {
        self.stopping.store(true, Ordering::Relaxed);
    }

    /// UTC nanoseconds.
    #[must_use]
    pub fn now_ns(&self) -> i64 {
        (self.clock)()
    }

    /// How things are now.
    pub fn report(&self) -> HealthReport {
        let idle_ns = (self.clock)().saturating_sub(self.progress_ns.load(Ordering::Relaxed));
        let (store, zenoh, stopping) = (
            self.store_answers.load(Ordering::Relaxed),
            self.zenoh_open.load(Ordering::Relaxed),
            self.stopping.load(Ordering::Relaxed),
        );
        let live = idle_ns < STALLED_NS;
        HealthReport {
            live,
            ready: live && store && zenoh && !stopping,
            loop_idle_seconds: idle_ns as f64 / 1e9,
            store,
            zenoh,
            stopping,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    #[test]
    fn a_loop_without_progress_is_dead_and_a_service_without_store_is_not_ready() {
        let now = Arc::new(AtomicI64::new(0));
        let clock = Arc::clone(&now);
        let health = Health::new(move || clock.load(Ordering::Relaxed));
        assert!(health.report().live && !health.report().ready);
        health.set_store(true);
        health.set_zenoh(true);
        assert!(health.report().ready);
        now.store(STALLED_NS, Ordering::Relaxed);
        assert!(!health.report().live && !health.report().ready);
        health.progress(STALLED_NS);
        assert!(health.report().ready);
        health.set_stopping();
        assert!(health.report().live && !health.report().ready);
    }
}
