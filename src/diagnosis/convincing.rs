//! The figures that convince: errors over noise on events that a fit has not seen, before and after.

use super::{
    case::Case,
    diagnose::ERROR_TO_NOISE_FLOOR,
    outcome::{ImprovementStep, Status, StructureErrors},
    own_compositions::left_in_untouched,
    round::Round,
    trials::{Fitted, Trial},
};
use crate::identification::composed::ComposedFit;

/// What is said first of an answer: the error of the structure where nothing is missing, how it falls where
/// an effect is named. `errors` are those of `fit`, of the structure as asked.
pub(super) fn convincing(
    case: &Case<'_>,
    round: &Round,
    fit: &ComposedFit,
    errors: &StructureErrors,
) -> Option<String> {
    match round.decision.status {
        Status::Adequate => {
            let structure = &round.asked.baseline.structure;
            let beyond = left_in_untouched(case, structure, fit, errors)
                .map_or_else(String::new, |told| format!("; {told}"));
            Some(left(errors) + &beyond)
        }
        Status::MissingEffect | Status::InstrumentSuspect => claimed(case, round, errors),
        Status::UnknownEffect | Status::CannotJudge => None,
    }
}

/// What is left on events that were not fitted, beside what a perfect model leaves.
fn left(errors: &StructureErrors) -> String {
    let perfect = format!("a perfect model leaves up to about {ERROR_TO_NOISE_FLOOR:.1}");
    let gate = errors.gate.as_ref().map(|gate| gate.error_to_noise);
    match (&errors.untouched, gate) {
        (Some(untouched), gate) => {
            let gate = gate.map_or_else(String::new, |gate| {
                format!("; a fit without the gating events leaves {gate:.2} in these")
            });
            format!(
                "the error on untouched events is {:.2} times the noise, {perfect}{gate}",
                untouched.error_to_noise
            )
        }
        (None, Some(gate)) => format!(
            "the error on the gating events, of a fit without them, is {gate:.2} times the noise, {perfect}"
        ),
        (None, None) => format!(
            "the error on the fitted events, and there are no others, is {:.2} times the noise, {perfect}",
            errors.fit.error_to_noise
        ),
    }
}

/// How the error falls by what is named.
fn claimed(case: &Case<'_>, round: &Round, errors: &StructureErrors) -> Option<String> {
    let first = &round.trials[*round.decision.answer.first()?];
    let (named, fit) = match &round.decision.second {
        Some(second) => (format!("{} and {}", first.name(), second.name), &second.fit),
        None => (first.name().to_owned(), first.fit.as_ref()?),
    };
    let before = match companions(round, first, fit) {
        Some(with) => case.error_on_untouched(&with.baseline.all),
        None => errors.untouched.as_ref().map(|of| of.error_to_noise),
    };
    if let Some(before) = before {
        let after = case.error_on_untouched(fit).unwrap_or(f64::INFINITY);
        return Some(moved(&named, "on untouched events", before, after));
    }
    // What the gate is judged by is the misfit; its root is no error over noise.
    let gate = first.evidence.as_ref()?.gate?;
    let [before, after] = [gate.before, gate.after].map(f64::sqrt);
    Some(format!(
        "with {} the root of the misfit of the gating events, which neither fit has seen, {} from {before:.2} to {after:.2}",
        first.name(),
        direction(before, after)
    ))
}

/// The structure with its companions, where a trial added its effect to that.
fn companions<'a>(round: &'a Round, trial: &Trial, fit: &ComposedFit) -> Option<&'a Fitted> {
    let with = round.accompanied.as_ref()?;
    let has = |name: &str| fit.model.effect_names().any(|known| known == name);
    let mut names = with.baseline.all.model.effect_names();
    names
        .all(|name| name != trial.name() && has(name))
        .then_some(with)
}

/// How the error falls by an effect, on the events that [`StructureErrors::quoted`] is of.
pub(super) fn fallen(named: &str, before: &StructureErrors, after: &StructureErrors) -> String {
    let [before, error] = [before, after].map(|errors| errors.quoted().error_to_noise);
    moved(named, on_set(after), before, error)
}

/// The events that errors are quoted on.
fn on_set(errors: &StructureErrors) -> &'static str {
    match errors.quoted_set() {
        "untouched" => "on untouched events",
        "gate" => "on the gating events, of fits without them,",
        _ => "on the fitted events",
    }
}

/// That an error over noise falls, or does not.
fn moved(with: &str, events: &str, before: f64, after: f64) -> String {
    if !after.is_finite() {
        return format!(
            "with {with} there is no response {events} ({before:.2} times the noise without)"
        );
    }
    let direction = direction(before, after);
    format!(
        "with {with} the error {events} {direction} from {before:.2} to {after:.2} times the noise"
    )
}

const fn direction(before: f64, after: f64) -> &'static str {
    if after <= before { "falls" } else { "rises" }
}

/// How the error fell from the first step to the last; none where there is one step only.
pub(super) fn over_all(steps: &[ImprovementStep]) -> Option<String> {
    let [first, .., last] = steps else {
        return None;
    };
    let events = on_set(&last.errors);
    let [before, after] = [first, last].map(|step| step.errors.quoted().error_to_noise);
    let direction = if after <= before { "fell" } else { "rose" };
    Some(format!(
        "over all steps the error {events} {direction} from {before:.2} to {after:.2} times the noise"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::ErrorSummary;

    fn summary(error_to_noise: f64) -> ErrorSummary {
        ErrorSummary {
            error_to_noise,
            ..ErrorSummary::default()
        }
    }

    #[test]
    fn what_is_left_is_told_of_events_that_were_not_fitted() {
        let mut errors = StructureErrors {
            fit: summary(1.14),
            gate: Some(summary(3.62)),
            untouched: Some(summary(1.06)),
        };
        assert_eq!(
            left(&errors),
            "the error on untouched events is 1.06 times the noise, a perfect model leaves up to about 1.1; \
             a fit without the gating events leaves 3.62 in these"
        );
        errors.untouched = None;
        assert!(
            left(&errors)
                .starts_with("the error on the gating events, of a fit without them, is 3.62")
        );
        errors.gate = None;
        assert!(left(&errors).contains("there are no others, is 1.14 times"));
    }

    #[test]
    fn a_rise_is_no_fall() {
        let words = |after| moved("saturation", "on untouched events", 3.58, after);
        assert_eq!(
            words(1.54),
            "with saturation the error on untouched events falls from 3.58 to 1.54 times the noise"
        );
        assert!(words(4.0).contains("rises from 3.58 to 4.00"));
        assert!(words(f64::INFINITY).contains("no response on untouched events"));
    }
}
