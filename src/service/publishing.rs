//! Sets and diagnoses on their way to their keys.

use std::collections::BTreeMap;

use super::{Command, DocumentKind, Failure, PendingDocument, ServiceOptions, outbox::Outbox};
use crate::telemetry::{
    diagnoses::DiagnosisPublished,
    sets::{Publication, PublishFailed, SetPublished},
};

/// Sets and diagnoses that have a version and are not known to be published. Each is put on its key
/// once; when the store could not be told, only the telling is repeated.
#[derive(Debug, Default)]
pub(super) struct Publishing {
    documents: BTreeMap<Address, Underway>,
}

/// What a document is, site and version.
pub(super) type Address = (DocumentKind, String, u64);

#[derive(Debug)]
struct Underway {
    document: PendingDocument,
    put: bool,
    retry_at_ns: Option<i64>,
}

impl Publishing {
    /// A document waits to be published; false when it is under way already.
    pub(super) fn begin(&mut self, document: PendingDocument, out: &mut Outbox) -> bool {
        let address = (document.kind, document.site.clone(), document.version);
        if self.documents.contains_key(&address) {
            return false;
        }
        let underway = Underway {
            document,
            put: false,
            retry_at_ns: None,
        };
        underway.give(out);
        self.documents.insert(address, underway);
        true
    }

    /// A document is on its key.
    pub(super) fn published(&mut self, now_ns: i64, address: &Address, out: &mut Outbox) {
        let (kind, site, version) = (address.0, address.1.clone(), address.2);
        if let Some(underway) = self.documents.get_mut(address) {
            underway.put = true;
            match kind {
                DocumentKind::Set => out.report(SetPublished {
                    site,
                    version,
                    at_ns: now_ns,
                }),
                DocumentKind::Diagnosis => out.report(DiagnosisPublished { site, version }),
            }
            underway.give(out);
        }
    }

    /// The store knows that it is.
    pub(super) fn marked(&mut self, address: &Address) {
        self.documents.remove(address);
    }

    /// A step failed: it is tried again after a pause.
    pub(super) fn failed(
        &mut self,
        now_ns: i64,
        address: &Address,
        failure: Failure,
        options: &ServiceOptions,
        out: &mut Outbox,
    ) {
        out.report(PublishFailed {
            what: match address.0 {
                DocumentKind::Set => Publication::Set,
                DocumentKind::Diagnosis => Publication::Diagnosis,
            },
            subject: format!("{} version {}", address.1, address.2),
            error: failure.error,
        });
        if let Some(underway) = self.documents.get_mut(address) {
            underway.retry_at_ns = Some(now_ns.saturating_add(options.store_retry_ns));
        }
    }

    /// Repeats failed steps.
    pub(super) fn tick(&mut self, now_ns: i64, out: &mut Outbox) {
        for underway in self.documents.values_mut() {
            if underway.retry_at_ns.is_some_and(|at| now_ns >= at) {
                underway.retry_at_ns = None;
                underway.give(out);
            }
        }
    }

    /// Whether nothing is under way.
    pub(super) fn at_rest(&self) -> bool {
        self.documents.is_empty()
    }
}

impl Underway {
    fn give(&self, out: &mut Outbox) {
        out.push(if self.put {
            Command::MarkPublished {
                kind: self.document.kind,
                site: self.document.site.clone(),
                version: self.document.version,
            }
        } else {
            Command::Publish(self.document.clone())
        });
    }
}
