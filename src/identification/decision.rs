//! Whether a new parameter set replaces the one in force.

use super::{Decision, ErrorSummary, ParameterSet};

/// Settings of the decision.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct DecisionOptions {
    /// Publish a set that could not be judged, marked as unvalidated. Default: no.
    pub allow_unvalidated: bool,
    /// Wait for a person's approval of a set that passed. Default: no.
    pub manual_approval: bool,
}

/// The set in force and its errors on the candidate's held-out events.
#[derive(Clone, Debug, PartialEq)]
pub struct InForce {
    /// The set.
    pub set: ParameterSet,
    /// Its errors on the events the candidate was validated on; none when there were none.
    pub on_candidates_held_out: Option<ErrorSummary>,
}

/// Decides what to do with `candidate`.
#[must_use]
pub fn decide(
    _candidate: &ParameterSet,
    _in_force: Option<&InForce>,
    _options: &DecisionOptions,
) -> Decision {
    Decision::Reject {
        reason: "undecided".to_owned(),
    }
}
