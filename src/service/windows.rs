//! Windows on their way: memory, durable storage, screening, announcement, jobs.
//!
//! Only the first step keeps its window in memory until the store has it. Whatever fails after
//! that is found again in the store: see [`super::Backlog`].

use std::{
    collections::{BTreeMap, VecDeque},
    sync::Arc,
};

use super::{Command, Failure, ServiceOptions, outbox::Outbox};
use crate::{
    disturbance::{Screening, ScreeningReason, Window},
    telemetry::{
        store::StoreFailed,
        windows::{WindowDropped, WindowFound, WindowKept, WindowScreened, WindowsSpooled},
    },
};

/// Windows that the store is given at one time. It carries out one operation after the other anyway, and what it
/// has been given can no longer be dropped: a store that is slow must not gather windows beyond the spool's bound.
const IN_FLIGHT_MAX: usize = 1;

/// Windows that are not through yet.
#[derive(Debug)]
pub(super) struct Windows {
    /// Waiting for the store, oldest first.
    spool: VecDeque<Spooled>,
    /// While the store refuses: when to try the oldest again.
    retry_at_ns: Option<i64>,
    /// Stored, and now being screened and announced.
    in_progress: BTreeMap<String, (Arc<Window>, Screening)>,
    count_max: usize,
    retry_ns: i64,
}

#[derive(Debug)]
struct Spooled {
    window: Arc<Window>,
    in_flight: bool,
}

impl Windows {
    /// A disturbance of the whole grid gives a window per site at one time: there is room for it.
    pub(super) fn new(options: &ServiceOptions, sites: usize) -> Self {
        Self {
            spool: VecDeque::new(),
            retry_at_ns: None,
            in_progress: BTreeMap::new(),
            count_max: options.spool_windows_max.max(sites).max(1),
            retry_ns: options.store_retry_ns,
        }
    }

    /// A window was cut out.
    pub(super) fn found(&mut self, window: Window, out: &mut Outbox) {
        out.report(WindowFound {
            window: window.id.clone(),
            closing: window.closing.name(),
        });
        if self.knows(&window.id) {
            return;
        }
        let waiting = self.spool.iter().position(|s| !s.in_flight).unwrap_or(0);
        if self.spool.len() >= self.count_max
            && let Some(oldest) = self.spool.remove(waiting)
        {
            out.report(WindowDropped {
                window: oldest.window.id.clone(),
                reason: format!("{} windows wait for the store already", self.count_max),
            });
        }
        self.spool.push_back(Spooled {
            window: Arc::new(window),
            in_flight: false,
        });
        if self.retry_at_ns.is_none() {
            self.send_waiting(out);
        }
        self.report_spool(out);
    }

    /// The store has a window. Returned when it is new and its screening is to begin.
    pub(super) fn stored(
        &mut self,
        id: &str,
        known: bool,
        out: &mut Outbox,
    ) -> Option<Arc<Window>> {
        let at = self.spool.iter().position(|s| s.window.id == id)?;
        let window = self.spool.remove(at)?.window;
        out.report(WindowKept {
            window: id.to_owned(),
            site: window.site.clone(),
            known,
        });
        self.retry_at_ns = None;
        self.send_waiting(out);
        self.report_spool(out);
        (!known).then_some(window)
    }

    /// The store refused a window: it is tried again, the others wait behind it.
    pub(super) fn not_stored(&mut self, now_ns: i64, id: &str, failure: Failure, out: &mut Outbox) {
        out.report(StoreFailed {
            reason: failure.reason,
            error: failure.error,
            retried: true,
        });
        self.retry_at_ns = Some(now_ns.saturating_add(self.retry_ns));
        for spooled in self.spool.iter_mut().filter(|s| s.window.id == id) {
            spooled.in_flight = false;
        }
    }

    /// Tries the oldest window again when it is time.
    pub(super) fn retry(&mut self, now_ns: i64, out: &mut Outbox) {
        if self.retry_at_ns.is_some_and(|at| now_ns >= at) {
            self.retry_at_ns = Some(now_ns.saturating_add(self.retry_ns));
            self.send_waiting(out);
        }
    }

    /// Keeps the verdict of screening and has it stored. Returns false when too many windows are
    /// under way: this one is left in the store for the next sweep.
    pub(super) fn screened(
        &mut self,
        window: &Arc<Window>,
        screening: Screening,
        out: &mut Outbox,
    ) -> bool {
        if self.in_progress.len() >= self.count_max {
            return false;
        }
        out.report(WindowScreened {
            window: window.id.clone(),
            site: window.site.clone(),
            refusals: screening
                .refusals
                .iter()
                .map(ScreeningReason::label)
                .collect(),
            in_words: in_words(&screening),
        });
        self.in_progress
            .insert(window.id.clone(), (Arc::clone(window), screening.clone()));
        out.push(Command::StoreScreening {
            window: Arc::clone(window),
            screening,
        });
        true
    }

    /// Has the summary put on its key. Returns false when too many windows are under way.
    pub(super) fn announce(
        &mut self,
        window: Arc<Window>,
        screening: Screening,
        out: &mut Outbox,
    ) -> bool {
        if self.in_progress.len() >= self.count_max && !self.in_progress.contains_key(&window.id) {
            return false;
        }
        self.in_progress
            .insert(window.id.clone(), (Arc::clone(&window), screening.clone()));
        out.push(Command::Announce { window, screening });
        true
    }

    /// A window under way and its verdict.
    pub(super) fn under_way(&self, id: &str) -> Option<(Arc<Window>, Screening)> {
        self.in_progress.get(id).cloned()
    }

    /// A window is through, or is left to the next sweep.
    pub(super) fn leave(&mut self, id: &str) {
        self.in_progress.remove(id);
    }

    /// Whether a window is in memory already.
    pub(super) fn knows(&self, id: &str) -> bool {
        self.in_progress.contains_key(id) || self.spool.iter().any(|s| s.window.id == id)
    }

    /// Windows that only exist in memory.
    pub(super) fn spooled(&self) -> usize {
        self.spool.len()
    }

    /// Whether no window is under way.
    pub(super) fn at_rest(&self) -> bool {
        self.spool.is_empty() && self.in_progress.is_empty()
    }

    fn send_waiting(&mut self, out: &mut Outbox) {
        let in_flight = self.spool.iter().filter(|s| s.in_flight).count();
        for spooled in self
            .spool
            .iter_mut()
            .filter(|s| !s.in_flight)
            .take(IN_FLIGHT_MAX.saturating_sub(in_flight))
        {
            spooled.in_flight = true;
            out.push(Command::StoreWindow(Arc::clone(&spooled.window)));
        }
    }

    fn report_spool(&self, out: &mut Outbox) {
        out.report(WindowsSpooled {
            windows: self.spool.len(),
        });
    }
}

fn in_words(screening: &Screening) -> String {
    screening
        .refusals
        .iter()
        .chain(&screening.marks)
        .map(ToString::to_string)
        .collect::<Vec<_>>()
        .join("; ")
}
