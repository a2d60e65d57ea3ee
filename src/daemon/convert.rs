//! Between the core's words and the store's.

use crate::{
    adapters::store::{self, Job, JobKind, StoreError},
    service::{Failure, Lease, Work, WorkKind},
};

pub(super) fn failure(error: &StoreError) -> Failure {
    Failure {
        reason: error.label(),
        error: error.to_string(),
        passing: error.passing(),
    }
}

pub(super) const fn job_kind(kind: WorkKind) -> JobKind {
    match kind {
        WorkKind::Event => JobKind::IdentifyEvent,
        WorkKind::Site => JobKind::IdentifySite,
        WorkKind::Diagnosis => JobKind::DiagnoseSite,
    }
}

pub(super) fn work_of(job: &Job) -> Work {
    Work {
        kind: match job.kind {
            JobKind::IdentifyEvent => WorkKind::Event,
            JobKind::IdentifySite => WorkKind::Site,
            JobKind::DiagnoseSite => WorkKind::Diagnosis,
        },
        site: job.site.clone(),
        subject: job.subject.clone(),
    }
}

pub(super) const fn lease(lease: &store::Lease) -> Lease {
    Lease {
        job: lease.job.0,
        claim: lease.claim,
    }
}

pub(super) const fn store_lease(lease: Lease) -> store::Lease {
    store::Lease {
        job: store::JobId(lease.job),
        claim: lease.claim,
    }
}
