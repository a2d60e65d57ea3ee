//! Everything that can happen to the service: one closed list.

use std::sync::Arc;

use super::{BacklogPart, Claimed, DocumentKind, Lease, Work};
use crate::{
    diagnosis::Diagnosis,
    disturbance::{Screening, Window},
    identification::{Identification, InForce, ParameterSet},
    measurement::{Record, SampleBatch},
    telemetry::intake::{FramesTaken, Source},
};

/// Something that happened. Events after a command carry what is needed to match the two.
#[derive(Debug)]
pub enum Event {
    /// A sample batch was decoded.
    BatchDecoded(SampleBatch),
    /// Frames of a C37.118 stream were decoded; their samples come as batches.
    FramesDecoded(FramesTaken),
    /// A recording was decoded and turned into phasors.
    RecordingDecoded(DecodedRecording),
    /// A payload could not be understood, or belongs to no site.
    PayloadRefused {
        /// Where it came from.
        source: Source,
        /// Key it came on.
        key: String,
        /// Word for the metric, from a closed list.
        reason: &'static str,
        /// What was wrong, in words.
        error: String,
    },
    /// The intake queue was full.
    MessagesDropped {
        /// What was dropped.
        source: Source,
        /// How many.
        messages: u64,
    },
    /// Time passed. Comes several times a second.
    Tick,
    /// A window is on durable storage.
    WindowStored {
        /// Identifier.
        window: String,
        /// Whether it was there before.
        known: bool,
    },
    /// The store refused a window.
    WindowNotStored {
        /// Identifier.
        window: String,
        /// What the store said.
        failure: Failure,
    },
    /// The verdict of screening is on durable storage.
    ScreeningStored {
        /// Identifier of the window.
        window: String,
    },
    /// The summary of an event is on its key.
    EventAnnounced {
        /// Identifier of the window.
        window: String,
    },
    /// The store knows that it is.
    AnnouncementMarked {
        /// Identifier of the window.
        window: String,
    },
    /// A step with a window after its storage failed. What is left is taken up by the next sweep.
    WindowStepFailed {
        /// Identifier of the window.
        window: String,
        /// What went wrong.
        failure: Failure,
    },
    /// A job is in the queue.
    WorkQueued {
        /// The job.
        work: Work,
        /// Whether it was there before, in whatever state.
        known: bool,
    },
    /// There is nothing to do for a site yet.
    WorkNotNeeded {
        /// The job.
        work: Work,
        /// Why, in words.
        reason: String,
    },
    /// A job could not be queued.
    WorkNotQueued {
        /// The job.
        work: Work,
        /// What the store said.
        failure: Failure,
    },
    /// A job is ours.
    WorkClaimed(Claimed),
    /// No job is due.
    NothingToClaim,
    /// The store could not be asked for a job.
    ClaimFailed(Failure),
    /// A lease was extended, or could not be.
    LeaseAnswered {
        /// Job.
        job: i64,
        /// Whether it is still ours.
        held: bool,
    },
    /// A fit ended.
    FitEnded {
        /// Job.
        job: i64,
        /// How.
        end: FitEnd,
    },
    /// A fit is on durable storage.
    FitStored {
        /// Job.
        job: i64,
        /// Number of the fit.
        fit: i64,
    },
    /// A diagnosis is on durable storage.
    DiagnosisStored {
        /// Job.
        job: i64,
        /// Its number.
        version: u64,
        /// Whether it was there before.
        known: bool,
    },
    /// A decision is on durable storage.
    DecisionCommitted {
        /// Job.
        job: i64,
        /// Version under which the set is to be published; none when it is not.
        version: Option<u64>,
        /// Whether the decision was there before.
        known: bool,
    },
    /// A job is off the queue, or has been given back.
    WorkEnded {
        /// Job.
        job: i64,
        /// Whether it was parked.
        parked: bool,
    },
    /// A step with a job failed. It is tried again.
    WorkStepFailed {
        /// Job.
        job: i64,
        /// What the store said.
        failure: Failure,
    },
    /// How far the sites have come is on durable storage, or could not be put there.
    ProgressKept(Result<(), Failure>),
    /// What waits in the store.
    BacklogLoaded(BacklogPart, Backlog),
    /// The store could not be asked for it.
    BacklogFailed(BacklogPart, Failure),
    /// A document is on its key.
    Published {
        /// What it is.
        kind: DocumentKind,
        /// Site.
        site: String,
        /// Version.
        version: u64,
    },
    /// The store knows that it is.
    PublicationMarked {
        /// What it is.
        kind: DocumentKind,
        /// Site.
        site: String,
        /// Version.
        version: u64,
    },
    /// A document could not be published, or the store could not be told. It is tried again.
    PublicationFailed {
        /// What it is.
        kind: DocumentKind,
        /// Site.
        site: String,
        /// Version.
        version: u64,
        /// What went wrong.
        failure: Failure,
    },
    /// Somebody has changed which model a site is to have; the store knows.
    StructureChanged {
        /// Site.
        site: String,
        /// Names of the parts.
        structure: Vec<String>,
        /// How it was said, from a closed list.
        origin: &'static str,
        /// Who.
        actor: String,
    },
    /// Somebody has changed which set counts; the store knows.
    SetsChanged {
        /// Site.
        site: String,
        /// What was done, from a closed list.
        action: &'static str,
        /// Version that counts now; none when it stays as it was.
        version: Option<u64>,
        /// Who.
        actor: String,
    },
    /// Somebody asks for a parameter set or a diagnosis.
    DocumentAsked {
        /// Number of the question.
        question: u64,
        /// Its text.
        selector: String,
        /// What is asked; an error in words when the question makes no sense.
        asked: Result<AskedDocument, String>,
    },
    /// A question was answered.
    QuestionAnswered {
        /// Its text.
        selector: String,
        /// How.
        outcome: crate::telemetry::sets::QueryOutcome,
    },
    /// Housekeeping in the store was done, or failed.
    HousekeepingDone(Result<Box<dyn crate::telemetry::Occurrence>, Failure>),
    /// The service is to stop.
    StopRequested,
    /// No message is on its way any more.
    IntakeStopped,
}

/// A recording after decoding.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodedRecording {
    /// Site.
    pub site: String,
    /// Recorder, from the key.
    pub recorder: String,
    /// The phasors.
    pub record: Record,
}

/// Which document is asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AskedDocument {
    /// What it is.
    pub kind: DocumentKind,
    /// Site.
    pub site: String,
    /// Version; none for the one that counts.
    pub version: Option<u64>,
}

/// Why a store or the network did not do what it was asked to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// Word for the metric, from a closed list.
    pub reason: &'static str,
    /// What it said.
    pub error: String,
    /// Whether the same may succeed later.
    pub passing: bool,
}

/// How a fit ended.
#[derive(Clone, Debug)]
pub enum FitEnd {
    /// With a parameter set.
    Fitted(Arc<Fitted>),
    /// The same inputs were fitted before; the candidate is known.
    Known {
        /// Number of the fit.
        fit: i64,
        /// The candidate.
        candidate: Arc<Candidate>,
        /// Whether somebody came back to a structure that the same events were fitted with before:
        /// the fit is decided on again.
        again: bool,
    },
    /// With a diagnosis.
    Diagnosed(Arc<Diagnosed>),
    /// The same inputs were diagnosed before.
    DiagnosisKnown {
        /// Number of the diagnosis.
        version: u64,
    },
    /// Somebody came back to a structure: what was found of it before is on record once more.
    DiagnosedBefore {
        /// Number of the diagnosis that was made.
        earlier: u64,
        /// Number that it has now as well: the site's newest.
        version: u64,
    },
    /// There is no set to be had from these data; asking again does not help.
    NoSet {
        /// Why, in words.
        reason: String,
    },
    /// Something went wrong that may go right the next time.
    Failed {
        /// What, in words.
        error: String,
    },
    /// It was cancelled.
    Cancelled,
    /// It panicked.
    Panicked {
        /// What the panic said.
        message: String,
    },
}

/// A fit and what its candidate is measured against.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The fit, with its cost in seconds.
    pub identification: Identification,
    /// Hash of what was really fitted: events may have come between queue and fit.
    pub inputs_hash: String,
    /// The set in force and its errors on the candidate's held-out events.
    pub in_force: Option<InForce>,
}

/// A diagnosis and what it was made from.
#[derive(Clone, Debug, PartialEq)]
pub struct Diagnosed {
    /// The diagnosis, with its cost in seconds.
    pub diagnosis: Diagnosis,
    /// Error over noise of the untouched events with the first effect named; none where no effect is
    /// named or no event is untouched.
    pub error_after: Option<f64>,
    /// Hash of what was really diagnosed.
    pub inputs_hash: String,
}

/// A candidate from a fit that was on record, and what it is measured against.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// The candidate.
    pub set: ParameterSet,
    /// The set in force and its errors on the candidate's held-out events.
    pub in_force: Option<InForce>,
}

/// What waits in the store: what a service that died has left behind.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Backlog {
    /// Windows that were never screened.
    pub unscreened: Vec<Arc<Window>>,
    /// Windows whose summaries were not put on their keys.
    pub unannounced: Vec<(Arc<Window>, Screening)>,
    /// Identifiers of usable windows, by site, oldest first: each is to have a job.
    pub usable: Vec<(String, Vec<String>)>,
    /// Sites whose structure was changed and that have not been fitted with it.
    pub restructured: Vec<String>,
    /// Sets and diagnoses that were not put on their keys, each kind in the order of its commits.
    pub unpublished: Vec<PendingDocument>,
    /// Whether a bound was reached and there may be more.
    pub more: bool,
}

/// A set or diagnosis that is to be put on its key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PendingDocument {
    /// What it is.
    pub kind: DocumentKind,
    /// Site.
    pub site: String,
    /// Version.
    pub version: u64,
    /// The document.
    pub document: String,
}

/// The right to work on a job; see [`Lease`].
pub type JobNumber = i64;

impl Claimed {
    /// Number of the job.
    #[must_use]
    pub const fn job(&self) -> JobNumber {
        let Lease { job, .. } = self.lease;
        job
    }
}
