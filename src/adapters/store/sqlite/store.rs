//! The contract of the store, call by call.

use super::{SqliteStore, decisions, diagnoses, fits, jobs, sets, structures, upkeep, windows};
use crate::{
    adapters::store::{
        Approval, ClaimRequest, CommittedDecision, DecisionId, DecisionRecord, Enqueued, FitId,
        Job, JobFailure, JobKind, Keep, Lease, LeaseAnswer, NewDecision, NewDiagnosis, NewFit,
        NewJob, NewStructure, Operation, Origin, Pruned, RollBack, Saved, Store, StoreCounts,
        StoreError, StoredDiagnosis, StoredFit, StoredSet, StructureRecord, WindowQuery,
        WindowSummary, WindowTally,
    },
    disturbance::{Screening, Window},
    measurement::{Progress, Site},
};

impl Store for SqliteStore {
    fn save_site(&self, site: &Site, now_ns: i64) -> Result<(), StoreError> {
        self.write(Operation("save a site"), |t| {
            windows::save_site(t, site, now_ns)
        })
    }

    fn sites(&self) -> Result<Vec<Site>, StoreError> {
        self.read(Operation("list sites"), windows::sites)
    }

    fn save_progress(&self, progress: &[(String, Progress)]) -> Result<(), StoreError> {
        self.write(Operation("save the progress"), |t| {
            windows::save_progress(t, progress)
        })
    }

    fn progress(&self) -> Result<Vec<(String, Progress)>, StoreError> {
        self.read(Operation("read the progress"), windows::progress)
    }

    fn save_window(&self, window: &Window, now_ns: i64) -> Result<Saved, StoreError> {
        self.write(Operation("save a window"), |t| {
            windows::save_window(t, window, now_ns)
        })
    }

    fn window(&self, id: &str) -> Result<Option<Window>, StoreError> {
        self.read(Operation("read a window"), |c| windows::window(c, id))
    }

    fn window_summaries(&self, query: &WindowQuery<'_>) -> Result<Vec<WindowSummary>, StoreError> {
        self.read(Operation("list windows"), |c| windows::summaries(c, query))
    }

    fn window_tallies(&self) -> Result<Vec<WindowTally>, StoreError> {
        self.read(Operation("count windows"), windows::tallies)
    }

    fn usable_windows(&self, site: &str, count_max: usize) -> Result<Vec<Window>, StoreError> {
        self.read(Operation("read usable windows"), |c| {
            windows::usable_windows(c, site, count_max)
        })
    }

    fn save_screening(
        &self,
        window_id: &str,
        screening: &Screening,
        now_ns: i64,
    ) -> Result<Saved, StoreError> {
        self.write(Operation("save a screening"), |t| {
            windows::save_screening(t, window_id, screening, now_ns)
        })
    }

    fn mark_announced(&self, window_id: &str, now_ns: i64) -> Result<Saved, StoreError> {
        self.write(Operation("mark a window as announced"), |t| {
            windows::mark_announced(t, window_id, now_ns)
        })
    }

    fn enqueue(&self, job: &NewJob<'_>, now_ns: i64) -> Result<Enqueued, StoreError> {
        self.write(Operation("queue a job"), |t| jobs::enqueue(t, job, now_ns))
    }

    fn claim(&self, request: &ClaimRequest<'_>) -> Result<Option<Job>, StoreError> {
        self.write(Operation("claim a job"), |t| jobs::claim(t, request))
    }

    fn heartbeat(&self, lease: &Lease, until_ns: i64) -> Result<LeaseAnswer, StoreError> {
        self.write(Operation("extend a lease"), |t| {
            jobs::heartbeat(t, lease, until_ns)
        })
    }

    fn complete(
        &self,
        lease: &Lease,
        outcome: &str,
        now_ns: i64,
    ) -> Result<LeaseAnswer, StoreError> {
        self.write(Operation("complete a job"), |t| {
            jobs::complete(t, lease, outcome, now_ns)
        })
    }

    fn fail(
        &self,
        lease: &Lease,
        failure: &JobFailure<'_>,
        now_ns: i64,
    ) -> Result<LeaseAnswer, StoreError> {
        self.write(Operation("note the failure of a job"), |t| {
            jobs::fail(t, lease, failure, now_ns)
        })
    }

    fn release(&self, lease: &Lease, now_ns: i64) -> Result<LeaseAnswer, StoreError> {
        self.write(Operation("release a job"), |t| {
            jobs::release(t, lease, now_ns)
        })
    }

    fn release_leases_of(&self, worker: &str, now_ns: i64) -> Result<usize, StoreError> {
        self.write(Operation("release the jobs of a dead worker"), |t| {
            jobs::release_leases_of(t, worker, now_ns)
        })
    }

    fn parked_jobs(&self, count_max: usize) -> Result<Vec<Job>, StoreError> {
        self.read(Operation("list parked jobs"), |c| {
            jobs::parked(c, count_max)
        })
    }

    fn save_fit(&self, fit: &NewFit<'_>, now_ns: i64) -> Result<(FitId, Saved), StoreError> {
        self.write(Operation("save a fit"), |t| fits::save(t, fit, now_ns))
    }

    fn repeat_fit(
        &self,
        fit: FitId,
        inputs_hash: &str,
        now_ns: i64,
    ) -> Result<(FitId, Saved), StoreError> {
        self.write(Operation("keep a fit once more"), |t| {
            fits::repeat(t, fit, inputs_hash, now_ns)
        })
    }

    fn fit(&self, id: FitId) -> Result<Option<StoredFit>, StoreError> {
        self.read(Operation("read a fit"), |c| fits::by_id(c, id))
    }

    fn fit_of(
        &self,
        kind: JobKind,
        subject: &str,
        inputs_hash: &str,
    ) -> Result<Option<StoredFit>, StoreError> {
        self.read(Operation("look for a fit"), |c| {
            fits::by_inputs(c, kind, subject, inputs_hash)
        })
    }

    fn fits(
        &self,
        site: &str,
        kind: JobKind,
        count_max: usize,
    ) -> Result<Vec<StoredFit>, StoreError> {
        self.read(Operation("list fits"), |c| {
            fits::of_site(c, site, kind, count_max)
        })
    }

    fn commit_decision(
        &self,
        decision: &NewDecision<'_>,
        now_ns: i64,
    ) -> Result<CommittedDecision, StoreError> {
        self.write(Operation("commit a decision"), |t| {
            decisions::commit(t, decision, now_ns)
        })
    }

    fn approve(
        &self,
        approval: &Approval<'_>,
        now_ns: i64,
    ) -> Result<CommittedDecision, StoreError> {
        self.write(Operation("answer a decision"), |t| {
            decisions::approve(t, approval, now_ns)
        })
    }

    fn decisions(&self, site: &str, count_max: usize) -> Result<Vec<DecisionRecord>, StoreError> {
        self.read(Operation("list decisions"), |c| {
            decisions::of_site(c, site, count_max)
        })
    }

    fn decisions_awaiting_approval(
        &self,
        count_max: usize,
    ) -> Result<Vec<DecisionRecord>, StoreError> {
        self.read(Operation("list waiting decisions"), |c| {
            decisions::awaiting(c, count_max)
        })
    }

    fn decision(&self, id: DecisionId) -> Result<Option<DecisionRecord>, StoreError> {
        self.read(Operation("read a decision"), |c| decisions::by_id(c, id))
    }

    fn unpublished_sets(&self) -> Result<Vec<StoredSet>, StoreError> {
        self.read(
            Operation("list unpublished parameter sets"),
            sets::unpublished,
        )
    }

    fn mark_published(&self, site: &str, version: u64, now_ns: i64) -> Result<Saved, StoreError> {
        self.write(Operation("mark a parameter set as published"), |t| {
            sets::mark_published(t, site, version, now_ns)
        })
    }

    fn set_in_force(&self, site: &str) -> Result<Option<StoredSet>, StoreError> {
        self.read(Operation("read the parameter set in force"), |c| {
            sets::in_force(c, site)
        })
    }

    fn newest_set(&self, site: &str) -> Result<Option<StoredSet>, StoreError> {
        self.read(Operation("read the newest parameter set"), |c| {
            sets::newest(c, site)
        })
    }

    fn set(&self, site: &str, version: u64) -> Result<Option<StoredSet>, StoreError> {
        self.read(Operation("read a parameter set"), |c| {
            sets::by_version(c, site, version)
        })
    }

    fn sets(&self, site: &str, count_max: usize) -> Result<Vec<StoredSet>, StoreError> {
        self.read(Operation("list parameter sets"), |c| {
            sets::of_site(c, site, count_max)
        })
    }

    fn roll_back(&self, roll_back: &RollBack<'_>, now_ns: i64) -> Result<Saved, StoreError> {
        self.write(Operation("roll back to a parameter set"), |t| {
            sets::roll_back(t, roll_back, now_ns)
        })
    }

    fn save_diagnosis(
        &self,
        diagnosis: &NewDiagnosis<'_>,
        now_ns: i64,
    ) -> Result<(u64, Saved), StoreError> {
        self.write(Operation("save a diagnosis"), |t| {
            diagnoses::save(t, diagnosis, now_ns)
        })
    }

    fn repeat_diagnosis(
        &self,
        site: &str,
        version: u64,
        inputs_hash: &str,
        now_ns: i64,
    ) -> Result<(u64, Saved), StoreError> {
        self.write(Operation("keep a diagnosis once more"), |t| {
            diagnoses::repeat(t, site, version, inputs_hash, now_ns)
        })
    }

    fn diagnosis(&self, site: &str, version: u64) -> Result<Option<StoredDiagnosis>, StoreError> {
        self.read(Operation("read a diagnosis"), |c| {
            diagnoses::by_version(c, site, version)
        })
    }

    fn newest_diagnosis(&self, site: &str) -> Result<Option<StoredDiagnosis>, StoreError> {
        self.read(Operation("read the newest diagnosis"), |c| {
            diagnoses::newest(c, site)
        })
    }

    fn diagnosis_of(
        &self,
        site: &str,
        inputs_hash: &str,
    ) -> Result<Option<StoredDiagnosis>, StoreError> {
        self.read(Operation("look for a diagnosis"), |c| {
            diagnoses::by_inputs(c, site, inputs_hash)
        })
    }

    fn diagnoses(&self, site: &str, count_max: usize) -> Result<Vec<StoredDiagnosis>, StoreError> {
        self.read(Operation("list diagnoses"), |c| {
            diagnoses::of_site(c, site, count_max)
        })
    }

    fn unpublished_diagnoses(&self) -> Result<Vec<StoredDiagnosis>, StoreError> {
        self.read(
            Operation("list unpublished diagnoses"),
            diagnoses::unpublished,
        )
    }

    fn mark_diagnosis_published(
        &self,
        site: &str,
        version: u64,
        now_ns: i64,
    ) -> Result<Saved, StoreError> {
        self.write(Operation("mark a diagnosis as published"), |t| {
            diagnoses::mark_published(t, site, version, now_ns)
        })
    }

    fn change_structure(
        &self,
        change: &NewStructure<'_>,
        now_ns: i64,
    ) -> Result<(StructureRecord, Saved), StoreError> {
        self.write(Operation("change a structure"), |t| {
            structures::change(t, change, now_ns)
        })
    }

    fn structure(
        &self,
        site: &str,
        origin: Option<Origin>,
    ) -> Result<Option<StructureRecord>, StoreError> {
        self.read(Operation("read a structure"), |c| {
            structures::newest(c, site, origin)
        })
    }

    fn structures(&self, site: &str, count_max: usize) -> Result<Vec<StructureRecord>, StoreError> {
        self.read(Operation("list structures"), |c| {
            structures::of_site(c, site, count_max)
        })
    }

    fn prune(&self, keep: &Keep, now_ns: i64) -> Result<Pruned, StoreError> {
        const PRUNE: Operation = Operation("delete what is too old");
        let pruned = self.write(PRUNE, |t| upkeep::prune(t, keep, now_ns))?;
        self.maintain(PRUNE, |c| upkeep::shrink(c, keep.rows_max))?;
        Ok(pruned)
    }

    fn counts(&self, now_ns: i64) -> Result<StoreCounts, StoreError> {
        self.read(Operation("count"), |c| upkeep::counts(c, now_ns))
    }

    fn disk_free_bytes(&self) -> Option<u64> {
        self.free_bytes()
    }

    fn check(&self) -> Result<(), StoreError> {
        self.read(Operation("look at itself"), upkeep::check)
    }
}
