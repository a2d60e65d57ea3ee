//! Sets on their way to their keys.

use std::collections::BTreeMap;

use super::{Command, Failure, PendingSet, ServiceOptions, outbox::Outbox};
use crate::telemetry::sets::{Publication, PublishFailed, SetPublished};

/// Sets that have a version and are not known to be published. A set is put on its key once; when
/// the store could not be told, only the telling is repeated.
#[derive(Debug, Default)]
pub(super) struct Publishing {
    sets: BTreeMap<(String, u64), Underway>,
}

#[derive(Debug)]
struct Underway {
    set: PendingSet,
    put: bool,
    retry_at_ns: Option<i64>,
}

impl Publishing {
    /// A set waits to be published; false when it is under way already.
    pub(super) fn begin(&mut self, set: PendingSet, out: &mut Outbox) -> bool {
        let key = (set.site.clone(), set.version);
        if self.sets.contains_key(&key) {
            return false;
        }
        let underway = Underway {
            set,
            put: false,
            retry_at_ns: None,
        };
        underway.give(out);
        self.sets.insert(key, underway);
        true
    }

    /// A set is on its key.
    pub(super) fn published(&mut self, now_ns: i64, site: &str, version: u64, out: &mut Outbox) {
        if let Some(underway) = self.sets.get_mut(&(site.to_owned(), version)) {
            underway.put = true;
            out.report(SetPublished {
                site: site.to_owned(),
                version,
                at_ns: now_ns,
            });
            underway.give(out);
        }
    }

    /// The store knows that it is.
    pub(super) fn marked(&mut self, site: &str, version: u64) {
        self.sets.remove(&(site.to_owned(), version));
    }

    /// A step failed: it is tried again after a pause.
    pub(super) fn failed(
        &mut self,
        now_ns: i64,
        (site, version): (&str, u64),
        failure: Failure,
        options: &ServiceOptions,
        out: &mut Outbox,
    ) {
        out.report(PublishFailed {
            what: Publication::Set,
            subject: format!("{site} version {version}"),
            error: failure.error,
        });
        if let Some(underway) = self.sets.get_mut(&(site.to_owned(), version)) {
            underway.retry_at_ns = Some(now_ns.saturating_add(options.store_retry_ns));
        }
    }

    /// Repeats failed steps.
    pub(super) fn tick(&mut self, now_ns: i64, out: &mut Outbox) {
        for underway in self.sets.values_mut() {
            if underway.retry_at_ns.is_some_and(|at| now_ns >= at) {
                underway.retry_at_ns = None;
                underway.give(out);
            }
        }
    }

    /// Whether nothing is under way.
    pub(super) fn at_rest(&self) -> bool {
        self.sets.is_empty()
    }
}

impl Underway {
    fn give(&self, out: &mut Outbox) {
        out.push(if self.put {
            Command::MarkPublished {
                site: self.set.site.clone(),
                version: self.set.version,
            }
        } else {
            Command::PublishSet(self.set.clone())
        });
    }
}
