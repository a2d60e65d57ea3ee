//! What the service must not forget: windows with their waveforms, jobs with leases, fits with
//! every solution, decisions with their evidence, versions of parameter sets, diagnoses, structures.
//!
//! [`Store`] is the contract, [`SqliteStore`] the embedded implementation (one file), and
//! `conformance` the suite that every implementation has to pass. `docs/storage.md` holds the
//! tables and the reasons.

#[cfg(test)]
mod conformance;
mod contract;
mod errors;
mod history;
mod records;
mod sqlite;

pub use contract::Store;
pub use errors::{Cause, Operation, StoreError};
pub use history::{
    NewDiagnosis, NewStructure, Origin, RollBack, Standing, StoredDiagnosis, StructureChange,
    StructureRecord, what_follows,
};
pub use records::{
    Answer, Approval, ClaimRequest, CommittedDecision, DecisionId, DecisionRecord, Enqueued, FitId,
    Job, JobFailure, JobId, JobKind, JobState, Keep, Lease, LeaseAnswer, NewDecision, NewFit,
    NewJob, Pruned, Saved, StoreCounts, StoredFit, StoredSet, WindowQuery, WindowSummary,
    WindowTally,
};
pub use sqlite::{SqliteOptions, SqliteStore};
