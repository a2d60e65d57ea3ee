//! Everything the service can ask for.

use std::sync::Arc;

use super::{AskedDocument, Diagnosed, Fitted, PendingDocument};
use crate::{
    disturbance::{Screening, Window},
    identification::{Decision, InForce},
    measurement::Progress,
    telemetry::Occurrence,
};

/// What is to be done. Each is answered by an event unless it says otherwise.
#[derive(Debug)]
pub enum Command {
    /// Put a window on durable storage.
    StoreWindow(Arc<Window>),
    /// Put a verdict of screening on durable storage.
    StoreScreening {
        /// Window.
        window: Arc<Window>,
        /// Verdict.
        screening: Screening,
    },
    /// Put the summary of an event on its key.
    Announce {
        /// Window.
        window: Arc<Window>,
        /// Verdict of screening.
        screening: Screening,
    },
    /// Tell the store that it is there.
    MarkAnnounced {
        /// Identifier of the window.
        window: String,
    },
    /// Queue a job. A joint fit or a diagnosis of a site with too few usable events is not queued,
    /// nor a diagnosis of events that have not been fitted jointly.
    Queue {
        /// The job.
        work: Work,
        /// Not before this time, UTC nanoseconds.
        due_ns: i64,
    },
    /// Claim one job that is due.
    Claim {
        /// End of the lease, UTC nanoseconds.
        lease_until_ns: i64,
    },
    /// Extend a lease.
    Heartbeat {
        /// Lease.
        lease: Lease,
        /// Its new end, UTC nanoseconds.
        until_ns: i64,
    },
    /// Run a fit or a diagnosis on a thread of its own.
    RunFit(Claimed),
    /// Ask a fit to stop. Not answered by itself: the fit ends.
    CancelFit {
        /// Job.
        job: i64,
    },
    /// Put a fit on durable storage.
    StoreFit {
        /// Job.
        claimed: Claimed,
        /// The fit.
        fitted: Arc<Fitted>,
    },
    /// Put a diagnosis on durable storage.
    StoreDiagnosis {
        /// Job.
        claimed: Claimed,
        /// The diagnosis.
        diagnosed: Arc<Diagnosed>,
    },
    /// Put a decision, and the set when it is to be published, on durable storage.
    CommitDecision {
        /// Job.
        job: i64,
        /// Number of the fit.
        fit: i64,
        /// What was decided.
        decision: Decision,
        /// What it was compared with.
        in_force: Option<Box<InForce>>,
    },
    /// Take a job off the queue, or give it back.
    EndWork {
        /// Lease.
        lease: Lease,
        /// How it ended.
        end: WorkEnd,
    },
    /// Put on durable storage how far sites have come.
    KeepProgress(Vec<(String, Progress)>),
    /// Load what waits in the store.
    LoadBacklog(BacklogPart),
    /// Put a set or diagnosis on its key.
    Publish(PendingDocument),
    /// Tell the store that it is there.
    MarkPublished {
        /// What it is.
        kind: DocumentKind,
        /// Site.
        site: String,
        /// Version.
        version: u64,
    },
    /// Answer a question for a parameter set or a diagnosis.
    Answer {
        /// Number of the question.
        question: u64,
        /// What is asked.
        asked: AskedDocument,
    },
    /// Answer a question with an error. Not answered by an event.
    Refuse {
        /// Number of the question.
        question: u64,
        /// Why, in words.
        reason: String,
    },
    /// Measure the store.
    MeasureStore,
    /// Delete what retention allows to delete.
    Prune,
    /// Write a log line and move the metrics. Not answered.
    Report(Box<dyn Occurrence>),
    /// Take nothing in any more.
    StopIntake,
    /// Everything is done: end the loop. Not answered.
    Stop,
}

/// Which part of what waits in the store is to be loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BacklogPart {
    /// All of it, and the usable windows that are each to have a job: after a start.
    Everything,
    /// Windows, changed structures, sets and diagnoses.
    WindowsAndUnpublished,
    /// Sets and diagnoses: after a decision or a diagnosis.
    Unpublished,
}

/// What is published under a version.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum DocumentKind {
    /// A parameter set.
    Set,
    /// A diagnosis.
    Diagnosis,
}

/// What a job computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum WorkKind {
    /// The fit of one event.
    Event,
    /// The joint fit of a site's events.
    Site,
    /// What the model of a site misses.
    Diagnosis,
}

impl WorkKind {
    /// Name in logs.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Event => "identify_event",
            Self::Site => "identify_site",
            Self::Diagnosis => "diagnose_site",
        }
    }
}

/// A job.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Work {
    /// What it computes.
    pub kind: WorkKind,
    /// Site.
    pub site: String,
    /// Window identifier or site, according to the kind.
    pub subject: String,
}

impl Work {
    /// The fit of one event.
    #[must_use]
    pub fn event(site: &str, window: &str) -> Self {
        Self {
            kind: WorkKind::Event,
            site: site.to_owned(),
            subject: window.to_owned(),
        }
    }

    /// The joint fit of a site.
    #[must_use]
    pub fn site(site: &str) -> Self {
        Self {
            kind: WorkKind::Site,
            site: site.to_owned(),
            subject: site.to_owned(),
        }
    }

    /// The diagnosis of a site.
    #[must_use]
    pub fn diagnosis(site: &str) -> Self {
        Self {
            kind: WorkKind::Diagnosis,
            ..Self::site(site)
        }
    }
}

/// The right to work on a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lease {
    /// Number of the job.
    pub job: i64,
    /// Which claim of the job this is.
    pub claim: u64,
}

/// A job that is ours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Claimed {
    /// The right to it.
    pub lease: Lease,
    /// What it computes.
    pub work: Work,
}

/// How the service leaves a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WorkEnd {
    /// Done, with its outcome in words.
    Complete {
        /// Outcome.
        outcome: String,
    },
    /// Failed, with the error in words; tried again later or parked.
    Fail {
        /// Error.
        error: String,
        /// When to try again, UTC nanoseconds.
        retry_at_ns: i64,
    },
    /// Given back undone.
    Release,
}
