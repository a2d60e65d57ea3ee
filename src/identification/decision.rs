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

/// An effect is supported by the events when the error falls by this share with it, held out or
/// fitted: what chance gives a further parameter is a few parts in ten thousand of some thousand samples.
const SUPPORTED_FALL: f64 = 0.002;

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
    let version = in_force.set.version;
    if same(candidate, &in_force.set) {
        return Ok(format!(
            "this is version {version}, which is in force already"
        ));
    }
    let text = format!(
        "held-out error-to-noise {:.2} against {:.2} of version {version} in force",
        new.error_to_noise, old.error_to_noise
    );
    if new.error_to_noise <= NOT_WORSE_FACTOR * old.error_to_noise {
        let unsupported = unsupported(candidate, in_force, new, old).unwrap_or_default();
        Ok(format!("not worse: {text}{unsupported}"))
    } else {
        Err(format!("worse: {text}"))
    }
}

/// Whether the candidate is the fit that the set in force comes from. Bit by bit: what is no number
/// is the same too.
fn same(candidate: &ParameterSet, in_force: &ParameterSet) -> bool {
    let values = |set: &ParameterSet| -> Vec<u64> {
        let parameters = set.parameters.iter();
        parameters.map(|one| one.value.to_bits()).collect()
    };
    candidate.structure == in_force.structure
        && candidate.fitted_events == in_force.fitted_events
        && candidate.held_out_events == in_force.held_out_events
        && values(candidate) == values(in_force)
}

/// What is to be said of effects that were added and that the events do not ask for: whoever wanted
/// them gets them, and is told.
fn unsupported(
    candidate: &ParameterSet,
    in_force: &InForce,
    new: &ErrorSummary,
    old: &ErrorSummary,
) -> Option<String> {
    let before = &in_force.set;
    let has = |set: &ParameterSet, part: &String| set.structure.contains(part);
    let added: Vec<&str> = (candidate.structure.iter())
        .filter(|part| !has(before, part))
        .map(String::as_str)
        .collect();
    let only_added = (before.structure.iter()).all(|part| has(candidate, part));
    let falls = |new: f64, old: f64| new <= (1.0 - SUPPORTED_FALL) * old;
    // Errors on other events say nothing of the effect.
    let fitted = (candidate.fitted_events == before.fitted_events)
        .then_some((candidate.fit.error_to_noise, before.fit.error_to_noise));
    let (held_out, held_out_before) = (new.error_to_noise, old.error_to_noise);
    if added.is_empty()
        || !only_added
        || falls(held_out, held_out_before)
        || fitted.is_some_and(|(with, without)| falls(with, without))
    {
        return None;
    }
    let fitted = fitted.map_or_else(String::new, |(with, without)| {
        format!(", fitted {with:.3} and {without:.3}")
    });
    Some(format!(
        "; these events do not support the added {}: the error does not fall with it (held out \
         {held_out:.3} with, {held_out_before:.3} without{fitted})",
        added.join(" and ")
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::{Bases, OperatingPoint, Verdict};

    fn set(structure: &[&str], fitted: f64, held_out: f64) -> ParameterSet {
        let errors = |error_to_noise| ErrorSummary {
            error_to_noise,
            ..ErrorSummary::default()
        };
        ParameterSet {
            structure: structure.iter().map(|&part| part.to_owned()).collect(),
            fit: errors(fitted),
            held_out: Some(errors(held_out)),
            verdict: Verdict {
                status: VerdictStatus::Pass,
                reasons: Vec::new(),
                channels: Vec::new(),
            },
            site: "north".to_owned(),
            version: 0,
            structure_versions: Vec::new(),
            parameters: Vec::new(),
            derived: Vec::new(),
            bases: Bases {
                s_base_mva: 1.0,
                v_base_kv: 1.0,
                nominal_hz: 50.0,
            },
            operating_point: OperatingPoint {
                v0_pu: 1.0,
                p0_pu: 1.0,
                q0_pu: 0.0,
            },
            fitted_events: vec!["a".to_owned()],
            held_out_events: vec!["b".to_owned()],
            rank: 0,
            condition: 1.0,
            inflation: Vec::new(),
            notes: Vec::new(),
            software_version: String::new(),
        }
    }

    fn against(candidate: &ParameterSet, before: &ParameterSet) -> Decision {
        let in_force = InForce {
            set: ParameterSet {
                version: 3,
                ..before.clone()
            },
            on_candidates_held_out: before.held_out.clone(),
        };
        decide(candidate, Some(&in_force), &DecisionOptions::default())
    }

    const PLAIN: [&str; 2] = ["zip", "induction_motor"];
    const MORE: [&str; 3] = ["zip", "induction_motor", "tap_changer"];

    #[test]
    fn an_added_effect_that_lowers_no_error_is_published_and_called_unsupported() {
        let before = set(&PLAIN, 1.084, 1.0659);
        for (candidate, unsupported) in [
            (set(&MORE, 1.086, 1.0677), true),
            (set(&MORE, 1.084, 1.0659), true),
            (set(&MORE, 1.010, 1.0677), false),
            (set(&MORE, 1.086, 1.0500), false),
        ] {
            let decision = against(&candidate, &before);
            assert!(matches!(decision, Decision::Publish { .. }), "{decision:?}");
            let words = "do not support the added tap_changer";
            let said = decision.reason().contains(words);
            assert_eq!(said, unsupported, "{decision:?}");
        }
    }

    #[test]
    fn the_set_in_force_itself_is_told_as_such() {
        let before = set(&PLAIN, 1.0, 1.0);
        let decision = against(&before, &before);
        let words = "this is version 3, which is in force already";
        assert_eq!(decision.reason(), words);
    }
}
