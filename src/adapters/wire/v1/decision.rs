//! Decisions on parameter sets and the evidence kept with them.

use serde::{Deserialize, Serialize};

use super::{ErrorSummaryV1, VERSION, VerdictV1};
use crate::identification::{Decision, InForce, ParameterSet};

/// Counterpart of [`Decision`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "decision", rename_all = "snake_case")]
#[allow(
    missing_docs,
    reason = "each variant is that of the domain's type, documented there"
)]
pub enum DecisionV1 {
    Publish { reason: String },
    PublishUnvalidated { reason: String },
    AwaitApproval { reason: String },
    Reject { reason: String },
}

impl From<&Decision> for DecisionV1 {
    fn from(decision: &Decision) -> Self {
        match decision.clone() {
            Decision::Publish { reason } => Self::Publish { reason },
            Decision::PublishUnvalidated { reason } => Self::PublishUnvalidated { reason },
            Decision::AwaitApproval { reason } => Self::AwaitApproval { reason },
            Decision::Reject { reason } => Self::Reject { reason },
        }
    }
}

impl From<DecisionV1> for Decision {
    fn from(decision: DecisionV1) -> Self {
        match decision {
            DecisionV1::Publish { reason } => Self::Publish { reason },
            DecisionV1::PublishUnvalidated { reason } => Self::PublishUnvalidated { reason },
            DecisionV1::AwaitApproval { reason } => Self::AwaitApproval { reason },
            DecisionV1::Reject { reason } => Self::Reject { reason },
        }
    }
}

/// What a decision was based on: enough to judge it when the fit itself has been pruned.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EvidenceV1 {
    /// Version of this format: 1.
    pub v: u64,
    /// Content hash of the candidate.
    pub candidate: String,
    /// Its verdict.
    pub verdict: VerdictV1,
    /// Its errors in the fit.
    pub fit: ErrorSummaryV1,
    /// Its errors on the held-out events.
    pub held_out: Option<ErrorSummaryV1>,
    /// Version of the set in force at that time.
    pub in_force: Option<u64>,
    /// That set's errors on the candidate's held-out events.
    pub in_force_on_held_out: Option<ErrorSummaryV1>,
}

impl EvidenceV1 {
    /// The evidence on `candidate`, whose content hash is `hash`.
    #[must_use]
    pub fn new(candidate: &ParameterSet, hash: &str, in_force: Option<&InForce>) -> Self {
        Self {
            v: VERSION,
            candidate: hash.to_owned(),
            verdict: (&candidate.verdict).into(),
            fit: (&candidate.fit).into(),
            held_out: candidate.held_out.as_ref().map(Into::into),
            in_force: in_force.map(|in_force| in_force.set.version),
            in_force_on_held_out: in_force
                .and_then(|in_force| in_force.on_candidates_held_out.as_ref())
                .map(Into::into),
        }
    }
}
