//! The contract of a store.

use std::fmt;

use super::{
    Approval, ClaimRequest, CommittedDecision, DecisionId, DecisionRecord, Enqueued, FitId, Job,
    JobFailure, JobKind, Keep, Lease, LeaseAnswer, NewDecision, NewDiagnosis, NewFit, NewJob,
    NewStructure, Origin, Pruned, RollBack, Saved, StoreCounts, StoreError, StoredDiagnosis,
    StoredFit, StoredSet, StructureRecord, WindowQuery, WindowSummary, WindowTally,
};
use crate::{
    disturbance::{Screening, Window},
    measurement::{Progress, Site},
};

/// Durable memory of the service. Synchronous: call it from a thread that may block.
///
/// Every call is one transaction: when it returns `Ok`, its effect survives the death of the
/// process and of the machine; when it returns an error, nothing of it was kept. Every write may be
/// repeated (the effect of the second is none), so that whoever died before learning the answer
/// simply asks again. The store reads no clock: `now_ns` is UTC in nanoseconds, from the caller.
///
/// Every method fails with [`StoreError`] when the database does; further errors are named with
/// the method.
#[allow(
    clippy::missing_errors_doc,
    reason = "every method fails for the reasons named in the trait's documentation"
)]
pub trait Store: fmt::Debug + Send + Sync {
    /// Creates the site or updates its base values.
    fn save_site(&self, site: &Site, now_ns: i64) -> Result<(), StoreError>;

    /// All sites, by name.
    fn sites(&self) -> Result<Vec<Site>, StoreError>;

    /// Keeps how far sites' measurements have come; what was kept of them before is replaced.
    ///
    /// [`StoreError::Unknown`] when one of the sites was never saved.
    fn save_progress(&self, progress: &[(String, Progress)]) -> Result<(), StoreError>;

    /// How far each site's measurements had come, by name.
    fn progress(&self) -> Result<Vec<(String, Progress)>, StoreError>;

    /// Keeps a window with its waveforms. Comes before anything else is done with it. A window
    /// whose id is known is left as it was.
    ///
    /// [`StoreError::Unknown`] when its site was never saved.
    fn save_window(&self, window: &Window, now_ns: i64) -> Result<Saved, StoreError>;

    /// A window with its waveforms; none when it is unknown or its waveforms have been pruned.
    fn window(&self, id: &str) -> Result<Option<Window>, StoreError>;

    /// What is known of windows without their waveforms, newest first.
    fn window_summaries(&self, query: &WindowQuery<'_>) -> Result<Vec<WindowSummary>, StoreError>;

    /// How many windows each site has, by name; sites without windows are left out.
    fn window_tallies(&self) -> Result<Vec<WindowTally>, StoreError>;

    /// The newest `count_max` windows of a site that screening found usable and whose waveforms
    /// are still kept, oldest first.
    fn usable_windows(&self, site: &str, count_max: usize) -> Result<Vec<Window>, StoreError>;

    /// Keeps the verdict of screening; a later and different one replaces it.
    ///
    /// [`StoreError::Unknown`] when there is no such window.
    fn save_screening(
        &self,
        window_id: &str,
        screening: &Screening,
        now_ns: i64,
    ) -> Result<Saved, StoreError>;

    /// Notes that the summary of an event has been put on its key.
    fn mark_announced(&self, window_id: &str, now_ns: i64) -> Result<Saved, StoreError>;

    /// Puts a job into the queue. The same kind, subject and inputs make the same job: one that is
    /// queued, claimed, done or parked stays so. Older jobs of the same kind and subject that nobody
    /// has claimed yet are superseded: their inputs are out of date.
    fn enqueue(&self, job: &NewJob<'_>, now_ns: i64) -> Result<Enqueued, StoreError>;

    /// Hands out a due job of the kinds asked for until the lease ends: the oldest, but fits before
    /// diagnoses; a job whose lease has ended is due again. No job is ever in two hands at one time. Jobs whose holders died too
    /// often are parked on the way.
    fn claim(&self, request: &ClaimRequest<'_>) -> Result<Option<Job>, StoreError>;

    /// Extends a lease.
    fn heartbeat(&self, lease: &Lease, until_ns: i64) -> Result<LeaseAnswer, StoreError>;

    /// Ends a job for good, with its outcome in words.
    fn complete(
        &self,
        lease: &Lease,
        outcome: &str,
        now_ns: i64,
    ) -> Result<LeaseAnswer, StoreError>;

    /// Notes that a job failed: it is due again at `retry_at_ns`, or parked with its error after
    /// `failures_max` failures.
    fn fail(
        &self,
        lease: &Lease,
        failure: &JobFailure<'_>,
        now_ns: i64,
    ) -> Result<LeaseAnswer, StoreError>;

    /// Gives a job back undone (the service is stopping); counts as nothing.
    fn release(&self, lease: &Lease, now_ns: i64) -> Result<LeaseAnswer, StoreError>;

    /// Ends all leases of a worker that is known to be dead (this instance before its restart), so
    /// that its jobs are due at once. Returns how many.
    fn release_leases_of(&self, worker: &str, now_ns: i64) -> Result<usize, StoreError>;

    /// Jobs that failed too often, newest first, at most `count_max`.
    fn parked_jobs(&self, count_max: usize) -> Result<Vec<Job>, StoreError>;

    /// Keeps a fit with all its solutions and directions. The same kind, subject and inputs make
    /// the same fit: the first one stays and its number is returned.
    fn save_fit(&self, fit: &NewFit<'_>, now_ns: i64) -> Result<(FitId, Saved), StoreError>;

    /// Keeps a fit once more, under the hash of a request that asks for it again, so that it is
    /// decided on again. The second call with the same hash changes nothing.
    ///
    /// [`StoreError::Unknown`] when there is no such fit, or its documents have been pruned.
    fn repeat_fit(
        &self,
        fit: FitId,
        inputs_hash: &str,
        now_ns: i64,
    ) -> Result<(FitId, Saved), StoreError>;

    /// A fit by its number.
    fn fit(&self, id: FitId) -> Result<Option<StoredFit>, StoreError>;

    /// The fit of these inputs, if it was made before: nobody needs to compute it again.
    fn fit_of(
        &self,
        kind: JobKind,
        subject: &str,
        inputs_hash: &str,
    ) -> Result<Option<StoredFit>, StoreError>;

    /// Fits of a site, newest first, at most `count_max`.
    fn fits(
        &self,
        site: &str,
        kind: JobKind,
        count_max: usize,
    ) -> Result<Vec<StoredFit>, StoreError>;

    /// Keeps a decision with its evidence and, when it is to publish, the parameter set under the
    /// site's next version: one transaction. A fit is decided once; asked again, the first answer
    /// is returned. A set whose content hash the site already has under some version keeps that
    /// version; where another version has come since, it counts and is published again.
    ///
    /// [`StoreError::Unknown`] when there is no such fit.
    fn commit_decision(
        &self,
        decision: &NewDecision<'_>,
        now_ns: i64,
    ) -> Result<CommittedDecision, StoreError>;

    /// Approves a decision that waits for it, or refuses; the set gets its version as in
    /// [`Store::commit_decision`].
    ///
    /// [`StoreError::Unknown`] when there is no such decision or it does not wait.
    fn approve(
        &self,
        approval: &Approval<'_>,
        now_ns: i64,
    ) -> Result<CommittedDecision, StoreError>;

    /// Decisions of a site, newest first, at most `count_max`.
    fn decisions(&self, site: &str, count_max: usize) -> Result<Vec<DecisionRecord>, StoreError>;

    /// Decisions that wait for a person, oldest first, at most `count_max`.
    fn decisions_awaiting_approval(
        &self,
        count_max: usize,
    ) -> Result<Vec<DecisionRecord>, StoreError>;

    /// One decision.
    fn decision(&self, id: DecisionId) -> Result<Option<DecisionRecord>, StoreError>;

    /// Sets that have a version but have not been put on their key yet, in the order of their
    /// commits: what to publish now, and again after a restart.
    fn unpublished_sets(&self) -> Result<Vec<StoredSet>, StoreError>;

    /// Notes that a version has been put on its key.
    ///
    /// [`StoreError::Unknown`] when there is no such version.
    fn mark_published(&self, site: &str, version: u64, now_ns: i64) -> Result<Saved, StoreError>;

    /// The set in force: the last version that has been put on its key. What a queryable answers.
    fn set_in_force(&self, site: &str) -> Result<Option<StoredSet>, StoreError>;

    /// The version that came last, published or about to be. What the next candidate is compared with.
    fn newest_set(&self, site: &str) -> Result<Option<StoredSet>, StoreError>;

    /// One version.
    fn set(&self, site: &str, version: u64) -> Result<Option<StoredSet>, StoreError>;

    /// Versions of a site, newest first, at most `count_max`.
    fn sets(&self, site: &str, count_max: usize) -> Result<Vec<StoredSet>, StoreError>;

    /// Makes an older version count again: it waits to be put on its key once more, with the same
    /// number and the same bytes.
    ///
    /// [`StoreError::Unknown`] when there is no such version.
    fn roll_back(&self, roll_back: &RollBack<'_>, now_ns: i64) -> Result<Saved, StoreError>;

    /// Keeps a diagnosis under the site's next number. The same inputs make the same diagnosis: the
    /// first one stays and its number is returned.
    fn save_diagnosis(
        &self,
        diagnosis: &NewDiagnosis<'_>,
        now_ns: i64,
    ) -> Result<(u64, Saved), StoreError>;

    /// Keeps a diagnosis once more, under the site's next number and the hash of a request that
    /// asks for it again. The second call with the same hash changes nothing.
    ///
    /// [`StoreError::Unknown`] when there is no such diagnosis, or its document has been pruned.
    fn repeat_diagnosis(
        &self,
        site: &str,
        version: u64,
        inputs_hash: &str,
        now_ns: i64,
    ) -> Result<(u64, Saved), StoreError>;

    /// One diagnosis.
    fn diagnosis(&self, site: &str, version: u64) -> Result<Option<StoredDiagnosis>, StoreError>;

    /// The newest diagnosis of a site.
    fn newest_diagnosis(&self, site: &str) -> Result<Option<StoredDiagnosis>, StoreError>;

    /// The diagnosis of these inputs, if it was made before.
    fn diagnosis_of(
        &self,
        site: &str,
        inputs_hash: &str,
    ) -> Result<Option<StoredDiagnosis>, StoreError>;

    /// Diagnoses of a site, newest first, at most `count_max`.
    fn diagnoses(&self, site: &str, count_max: usize) -> Result<Vec<StoredDiagnosis>, StoreError>;

    /// Diagnoses that have not been put on their key yet, oldest first.
    fn unpublished_diagnoses(&self) -> Result<Vec<StoredDiagnosis>, StoreError>;

    /// Notes that a diagnosis has been put on its key.
    ///
    /// [`StoreError::Unknown`] when there is no such diagnosis.
    fn mark_diagnosis_published(
        &self,
        site: &str,
        version: u64,
        now_ns: i64,
    ) -> Result<Saved, StoreError>;

    /// Changes which model a site is to have. A change that changes nothing is answered with the
    /// record that says so already.
    ///
    /// [`StoreError::Structure`] when the change makes no model.
    fn change_structure(
        &self,
        change: &NewStructure<'_>,
        now_ns: i64,
    ) -> Result<(StructureRecord, Saved), StoreError>;

    /// The newest record of a site, of one origin or of any: the newest of any is the model that
    /// is fitted.
    fn structure(
        &self,
        site: &str,
        origin: Option<Origin>,
    ) -> Result<Option<StructureRecord>, StoreError>;

    /// Records of a site's structure, newest first, at most `count_max`.
    fn structures(&self, site: &str, count_max: usize) -> Result<Vec<StructureRecord>, StoreError>;

    /// Deletes what is older than `keep` allows, at most `keep.rows_max` rows in one call: call
    /// again while [`Pruned::more`]. Decisions, parameter sets, structures and the audit trail are never
    /// deleted, nor the waveforms and fits behind a site's newest set.
    fn prune(&self, keep: &Keep, now_ns: i64) -> Result<Pruned, StoreError>;

    /// Numbers for metrics.
    fn counts(&self, now_ns: i64) -> Result<StoreCounts, StoreError>;

    /// Bytes that its disk has left for who runs this; none where that cannot be known.
    fn disk_free_bytes(&self) -> Option<u64>;

    /// Whether the store answers and is whole, as far as a quick look tells.
    fn check(&self) -> Result<(), StoreError>;
}
