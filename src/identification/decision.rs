//! Whether a new parameter set replaces the one in force.

use super::{Decision, ErrorSummary, ParameterSet, VerdictStatus};

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

/// How much worse than the set in force a candidate may be on the held-out events: differences
/// below two percent of the error are noise.
const NOT_WORSE_FACTOR: f64 = 1.02;

/// Decides what to do with `candidate`.
#[must_use]
#[allow(
    clippy::trivially_copy_pass_by_ref,
    reason = "settings are passed alike everywhere"
)]
pub fn decide(
    candidate: &ParameterSet,
    in_force: Option<&InForce>,
    options: &DecisionOptions,
) -> Decision {
    let reasons = candidate.verdict.reasons.join("; ");
    match candidate.verdict.status {
        VerdictStatus::Fail => Decision::Reject {
            reason: format!("validation failed: {reasons}"),
        },
        VerdictStatus::CannotJudge => unjudged(in_force, options.allow_unvalidated, &reasons),
        VerdictStatus::Pass => match compared(candidate, in_force) {
            Err(reason) => Decision::Reject { reason },
            Ok(reason) if options.manual_approval => Decision::AwaitApproval { reason },
            Ok(reason) => Decision::Publish { reason },
        },
    }
}

fn unjudged(in_force: Option<&InForce>, allowed: bool, reasons: &str) -> Decision {
    if !allowed {
        let reason = format!("cannot be judged ({reasons}) and unvalidated sets are not allowed");
        return Decision::Reject { reason };
    }
    let validated = in_force.is_some_and(|f| f.set.verdict.status == VerdictStatus::Pass);
    if validated {
        let reason = format!("cannot be judged ({reasons}); the set in force is validated");
        return Decision::Reject { reason };
    }
    Decision::PublishUnvalidated {
        reason: format!("cannot be judged: {reasons}"),
    }
}

fn compared(candidate: &ParameterSet, in_force: Option<&InForce>) -> Result<String, String> {
    let Some(in_force) = in_force else {
        return Ok("first validated set of the site".to_owned());
    };
    if in_force.set.verdict.status != VerdictStatus::Pass {
        return Ok(format!(
            "version {} in force was not validated, this one is",
            in_force.set.version
        ));
    }
    let (Some(new), Some(old)) = (&candidate.held_out, &in_force.on_candidates_held_out) else {
        return Err("no held-out event to compare with the set in force".to_owned());
    };
    let text = format!(
        "held-out error-to-noise {:.2} against {:.2} of version {} in force",
        new.error_to_noise, old.error_to_noise, in_force.set.version
    );
    if new.error_to_noise <= NOT_WORSE_FACTOR * old.error_to_noise {
        Ok(format!("not worse: {text}"))
    } else {
        Err(format!("worse: {text}"))
    }
}
