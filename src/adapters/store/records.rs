//! What goes into a store and what comes out of it.

use std::fmt;

use crate::adapters::wire::{DocumentError, v1};
use crate::{
    disturbance::{Closing, Screening, Trigger},
    identification::{Decision, Identification, InForce, ParameterSet, VerdictStatus},
};

/// Number of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct JobId(pub i64);

/// Number of a fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FitId(pub i64);

/// Number of a decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct DecisionId(pub i64);

/// Whether a write changed anything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Saved {
    /// It is kept now.
    Stored,
    /// It was there before; nothing was changed.
    AlreadyStored,
}

/// Which windows to list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct WindowQuery<'a> {
    /// Only this site.
    pub site: Option<&'a str>,
    /// Only the window of this name.
    pub id: Option<&'a str>,
    /// Only those that screening has not judged yet: what a restarted service takes up first.
    pub unscreened: bool,
    /// Only those that have been screened and whose summary has not been put on its key yet.
    pub unannounced: bool,
    /// Only those with an onset before this time, UTC nanoseconds: the next page.
    pub before_ns: Option<i64>,
    /// At most so many; 0 asks for none.
    pub count_max: usize,
}

/// How many windows a site has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WindowTally {
    /// Site.
    pub site: String,
    /// Windows.
    pub windows: u64,
    /// Of these, the ones that screening found usable.
    pub usable: u64,
    /// Onset of the newest, UTC nanoseconds.
    pub newest_onset_ns: i64,
}

/// A window without its waveforms.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowSummary {
    /// Identifier.
    pub id: String,
    /// Site.
    pub site: String,
    /// Onset, UTC nanoseconds.
    pub onset_ns: i64,
    /// First sample, UTC nanoseconds.
    pub start_ns: i64,
    /// Number of samples.
    pub sample_count: usize,
    /// Samples per second.
    pub rate_fps: f64,
    /// Lowest usable voltage, pu; NaN when no sample is usable.
    pub lowest_voltage_pu: f64,
    /// What opened or extended it.
    pub triggers: Vec<Trigger>,
    /// Why it ended.
    pub closing: Closing,
    /// What screening said; none when it has not been asked yet.
    pub screening: Option<Screening>,
    /// When it was stored, UTC nanoseconds.
    pub stored_ns: i64,
    /// When its summary was put on its key, UTC nanoseconds.
    pub announced_ns: Option<i64>,
    /// Whether the waveforms are still kept.
    pub has_waveforms: bool,
}

/// What a job computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum JobKind {
    /// Fits one event; the subject is the window's id.
    IdentifyEvent,
    /// Fits a site's events jointly; the subject is the site.
    IdentifySite,
    /// Looks for what a site's model misses; the subject is the site. Comes after all fits.
    DiagnoseSite,
}

impl JobKind {
    /// Every kind.
    pub const ALL: [Self; 3] = [Self::IdentifyEvent, Self::IdentifySite, Self::DiagnoseSite];

    /// Name in the database, in logs and in metrics.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::IdentifyEvent => "identify_event",
            Self::IdentifySite => "identify_site",
            Self::DiagnoseSite => "diagnose_site",
        }
    }

    /// The kind of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

impl fmt::Display for JobKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A job to be queued.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewJob<'a> {
    /// What to compute.
    pub kind: JobKind,
    /// Site.
    pub site: &'a str,
    /// Window id or site, according to the kind.
    pub subject: &'a str,
    /// Hash of all inputs (windows, structure, options, program version): see
    /// [`crate::adapters::wire::content_hash`].
    pub inputs_hash: &'a str,
    /// Not to be claimed before this time, UTC nanoseconds.
    pub due_ns: i64,
}

/// What became of a job that was put into the queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Enqueued {
    /// It is new.
    Added(JobId),
    /// The same job was there, and is in this state now. (A superseded one is queued again.)
    Known(JobId, JobState),
}

/// Where a job is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum JobState {
    /// Waits to be claimed.
    Queued,
    /// A worker has it.
    Claimed,
    /// Ended.
    Done,
    /// Failed too often; waits for a person.
    Parked,
    /// A newer job for the same subject took its place before anybody claimed it.
    Superseded,
}

impl JobState {
    /// Every state.
    pub const ALL: [Self; 5] = [
        Self::Queued,
        Self::Claimed,
        Self::Done,
        Self::Parked,
        Self::Superseded,
    ];

    /// Name in the database, in logs and in metrics.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Claimed => "claimed",
            Self::Done => "done",
            Self::Parked => "parked",
            Self::Superseded => "superseded",
        }
    }

    /// The state of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name() == name)
    }
}

/// Who wants a job, and on what terms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClaimRequest<'a> {
    /// Name of the worker's instance.
    pub worker: &'a str,
    /// Kinds it can do.
    pub kinds: &'a [JobKind],
    /// Now, UTC nanoseconds.
    pub now_ns: i64,
    /// End of the lease, UTC nanoseconds: after it, others may claim the job.
    pub lease_until_ns: i64,
    /// A job whose holder disappeared so many times is parked instead of being handed out again.
    pub interruptions_max: u32,
}

/// The right to work on a job, until it ends or is taken away.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lease {
    /// Job.
    pub job: JobId,
    /// Which claim of the job this is, from 1: an old holder is told apart from the new one.
    pub claim: u64,
}

/// Whether a lease was still good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeaseAnswer {
    /// It was; done as asked.
    Held,
    /// The job has been parked by this failure.
    Parked,
    /// It had ended and the job is in other hands, or over: stop working on it.
    Lost,
}

/// A failure of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobFailure<'a> {
    /// What went wrong, in words.
    pub error: &'a str,
    /// When to try again, UTC nanoseconds.
    pub retry_at_ns: i64,
    /// Failures after which the job is parked, at least 1.
    pub failures_max: u32,
}

/// A job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Job {
    /// Number and right to work on it.
    pub lease: Lease,
    /// What to compute.
    pub kind: JobKind,
    /// Site.
    pub site: String,
    /// Window id or site, according to the kind.
    pub subject: String,
    /// Hash of its inputs.
    pub inputs_hash: String,
    /// Where it is.
    pub state: JobState,
    /// How often it failed.
    pub failures: u32,
    /// How often its holder disappeared.
    pub interruptions: u32,
    /// The last error.
    pub last_error: Option<String>,
    /// When it was queued, UTC nanoseconds.
    pub enqueued_ns: i64,
}

/// A fit to be kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewFit<'a> {
    /// Kind of the job that made it.
    pub kind: JobKind,
    /// Site.
    pub site: &'a str,
    /// Window id or site, according to the kind.
    pub subject: &'a str,
    /// Hash of its inputs.
    pub inputs_hash: &'a str,
    /// The fit; `cost.seconds` filled in by the caller.
    pub identification: &'a Identification,
}

/// A fit as it was kept.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredFit {
    /// Number.
    pub id: FitId,
    /// Kind of the job that made it.
    pub kind: JobKind,
    /// Site.
    pub site: String,
    /// Window id or site, according to the kind.
    pub subject: String,
    /// Hash of its inputs.
    pub inputs_hash: String,
    /// Names of the parts of the model.
    pub structure: Vec<String>,
    /// Hash of the parameter set's content.
    pub content_hash: String,
    /// Verdict of validation.
    pub verdict: VerdictStatus,
    /// When it was stored, UTC nanoseconds.
    pub stored_ns: i64,
    /// The parameter set as JSON (`ParameterSetV1`, version 0); none when pruned.
    pub set_document: Option<String>,
    /// The whole fit as JSON (as `identify --json`); none when pruned.
    pub document: Option<String>,
}

impl StoredFit {
    /// The parameter set, with version 0; none when pruned.
    ///
    /// # Errors
    ///
    /// [`DocumentError`] when the document cannot be understood.
    pub fn set(&self) -> Result<Option<ParameterSet>, DocumentError> {
        self.set_document
            .as_deref()
            .map(v1::decode_parameter_set)
            .transpose()
    }
}

/// A decision to be kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewDecision<'a> {
    /// The fit whose set is decided on.
    pub fit: FitId,
    /// What was decided, and why.
    pub decision: &'a Decision,
    /// The set in force at that time and its errors on the candidate's held-out events.
    pub in_force: Option<&'a InForce>,
    /// Who decided: the instance's name.
    pub actor: &'a str,
}

/// A person's answer to a decision that waits for approval.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Approval<'a> {
    /// Decision.
    pub decision: DecisionId,
    /// Yes or no.
    pub approved: bool,
    /// Who.
    pub actor: &'a str,
    /// Why, in words; may be empty.
    pub comment: &'a str,
}

/// A decision that is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CommittedDecision {
    /// Number.
    pub id: DecisionId,
    /// Version under which the set is published; none when it is not.
    pub version: Option<u64>,
    /// Whether the decision was there before.
    pub saved: Saved,
}

/// A decision as it was kept.
#[derive(Clone, Debug, PartialEq)]
pub struct DecisionRecord {
    /// Number.
    pub id: DecisionId,
    /// Site.
    pub site: String,
    /// Fit.
    pub fit: FitId,
    /// What was decided, and why.
    pub decision: Decision,
    /// Whether it still waits for a person.
    pub awaiting_approval: bool,
    /// Version under which the set is published; none when it is not.
    pub version: Option<u64>,
    /// The evidence as JSON: candidate's hash, verdict and held-out errors, those of the set in
    /// force.
    pub evidence: String,
    /// Who decided.
    pub actor: String,
    /// When, UTC nanoseconds.
    pub decided_ns: i64,
    /// What a person answered where one was asked.
    pub answer: Option<Answer>,
}

/// What a person answered to a decision that waited.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Whether the set is to be published.
    pub approved: bool,
    /// Who.
    pub actor: String,
    /// Why; may be empty.
    pub comment: String,
    /// When, UTC nanoseconds.
    pub answered_ns: i64,
}

/// A version of a parameter set.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredSet {
    /// Site.
    pub site: String,
    /// Version, from 1.
    pub version: u64,
    /// Hash of its content.
    pub content_hash: String,
    /// The set as JSON (`ParameterSetV1`): these bytes are what is published.
    pub document: String,
    /// Fit it comes from.
    pub fit: FitId,
    /// When the version was assigned, UTC nanoseconds.
    pub committed_ns: i64,
    /// When it was put on its key, UTC nanoseconds; none until then.
    pub published_ns: Option<i64>,
}

impl StoredSet {
    /// The set.
    ///
    /// # Errors
    ///
    /// [`DocumentError`] when the document cannot be understood.
    pub fn set(&self) -> Result<ParameterSet, DocumentError> {
        v1::decode_parameter_set(&self.document)
    }
}

/// What retention keeps. Ages in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Keep {
    /// Waveforms younger than this (by onset).
    pub waveforms_ns: i64,
    /// Summaries of windows younger than this (by onset); at least `waveforms_ns` is used.
    pub windows_ns: i64,
    /// Documents of fits and diagnoses younger than this.
    pub fits_ns: i64,
    /// Finished and superseded jobs younger than this.
    pub jobs_ns: i64,
    /// Rows touched by one call at most, so that no call is long.
    pub rows_max: usize,
}

/// What retention deleted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Pruned {
    /// Waveforms.
    pub waveforms: usize,
    /// Windows' summaries.
    pub windows: usize,
    /// Documents of fits and diagnoses.
    pub fits: usize,
    /// Jobs.
    pub jobs: usize,
    /// Whether the bound was reached and there may be more.
    pub more: bool,
}

/// Numbers for metrics.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct StoreCounts {
    /// Jobs that wait.
    pub jobs_queued: u64,
    /// Jobs in somebody's hands.
    pub jobs_claimed: u64,
    /// Jobs parked.
    pub jobs_parked: u64,
    /// Age of the oldest job that is due, nanoseconds; 0 when none is.
    pub oldest_due_job_age_ns: i64,
    /// Windows kept.
    pub windows: u64,
    /// Parameter sets with a version.
    pub sets: u64,
    /// Sets that wait to be published.
    pub sets_unpublished: u64,
    /// Diagnoses that wait to be published.
    pub diagnoses_unpublished: u64,
    /// Size of the store, bytes.
    pub bytes: u64,
}
