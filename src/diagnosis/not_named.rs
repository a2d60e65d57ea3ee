//! Why an effect that was tried is not in the answer, so that every one has a verdict with its figure.

use super::{
    case::Case,
    diagnose::SCREENED_OUT,
    evidence::{Evidence, objections},
    options::ClaimOptions,
    round::Round,
    trials::Trial,
};

/// What speaks against an effect of a round that is not in its answer; at least one reason.
pub(super) fn why_not_named(case: &Case<'_>, round: &Round, trial: &Trial) -> Vec<String> {
    let Some(evidence) = &trial.evidence else {
        return vec![if trial.tried {
            without_fit(case, round, trial)
        } else {
            SCREENED_OUT.to_owned()
        }];
    };
    let options = &case.options.claim;
    let objections = objections(evidence, options);
    if !objections.is_empty() {
        return objections;
    }
    let named = round.decision.answer.first();
    let against = named.map_or_else(
        || explains_too_little(evidence, options),
        |&place| behind(evidence, &round.trials[place]),
    );
    let unseen = case.has_gate() && evidence.gate.is_none();
    let ahead = best(round).filter(|best| unseen && best.name() != trial.name());
    let unasked = ahead.map(|best| {
        let given_up = trial.fit.as_ref().is_some_and(|fit| fit.given_up);
        unasked(best.name(), evidence.delta_bic - best.delta_bic(), given_up)
    });
    std::iter::once(against).chain(unasked).collect()
}

/// That an effect was not held against the gate, since another is so far ahead of it.
fn unasked(best: &str, behind: f64, given_up: bool) -> String {
    let so_far = if given_up {
        ", where its fit was given up,"
    } else {
        ""
    };
    format!(
        "it is behind {best} by {behind:.0} of the criterion{so_far} and is not held against the held-out events"
    )
}

/// The effect that lowers the criterion most.
fn best(round: &Round) -> Option<&Trial> {
    let fitted = round.trials.iter().filter(|trial| trial.evidence.is_some());
    fitted.min_by(|a, b| a.delta_bic().total_cmp(&b.delta_bic()))
}

/// That something else is named which describes the events better.
fn behind(evidence: &Evidence, named: &Trial) -> String {
    let left = |name: &str, left: f64, gained: f64| {
        format!("{name} leaves {left:.2} per sample and gains {gained:.0} of the criterion")
    };
    let this = left("it", evidence.chi_square_after, -evidence.delta_bic);
    let other = left(named.name(), named.chi_square(), -named.delta_bic());
    format!("{this}, {other}")
}

/// That it lowers the misfit and does not explain it.
fn explains_too_little(evidence: &Evidence, options: &ClaimOptions) -> String {
    let Evidence {
        chi_square_before: before,
        chi_square_after: after,
        ..
    } = evidence;
    format!(
        "it takes {:.0} % of the misfit ({before:.2} to {after:.2} per sample) and leaves {:.1} times what the noise does",
        100.0 * (1.0 - after / before),
        after / options.floor
    )
}

/// Why an effect that was tried has no fit.
fn without_fit(case: &Case<'_>, round: &Round, trial: &Trial) -> String {
    let no_value = case.without_value(&round.base().baseline, trial.name());
    no_value.map_or_else(
        || "no fit with it follows the events better than without it".to_owned(),
        |no_value| no_value.to_string(),
    )
}

#[cfg(test)]
mod tests {
    use super::{super::evidence::tests::evidence, *};

    #[test]
    fn an_effect_that_helps_and_does_not_explain_is_told_so_with_its_figures() {
        let evidence = evidence(-500.0, 6.3, true);
        assert_eq!(
            explains_too_little(&evidence, &ClaimOptions::default()),
            "it takes 37 % of the misfit (10.00 to 6.30 per sample) and leaves 9.0 times what the noise does"
        );
        assert_eq!(
            unasked("saturation", 812.4, true),
            "it is behind saturation by 812 of the criterion, where its fit was given up, and is not held against the \
             held-out events"
        );
        assert!(unasked("saturation", 812.4, false).contains("criterion and is not"));
    }
}
