//! Whether a general form explains more than what the catalogue offers: then something is missing that it does not have.

use super::{
    case::Case,
    claim::told_apart,
    evidence::{Evidence, objections},
    options::ClaimOptions,
    outcome::{GeneralForm, Status},
    round::Decision,
    trials::{Fitted, Goal, Trial, trials},
};
use crate::{
    identification::{
        FittedStructure, IdentificationError, composed::ComposedFit, composed_parameters,
    },
    load_model::general_forms,
};

/// A decision of the catalogue, held against the general forms where it leaves more than noise: where one of them explains clearly
/// more, its names stand for something else. Where the catalogue has no answer, the form that explains most is told.
pub(super) fn beyond_the_catalogue(
    case: &Case<'_>,
    base: &Fitted,
    list: &[Trial],
    decision: Decision,
) -> Result<Decision, IdentificationError> {
    let options = &case.options.claim;
    let Some(named) = explained_by(base, list, &decision) else {
        return Ok(decision);
    };
    if named.chi_square_per_row() < options.reached_floors * options.floor {
        return Ok(decision);
    }
    let Some((form, evidence, fit)) = best_form(case, base)? else {
        return Ok(decision);
    };
    let unknown = decision.status == Status::UnknownEffect;
    let better =
        || clearly_better(&fit, named, base, options) && foretells_better(case, &evidence, named);
    if !unknown && !better() {
        return Ok(decision);
    }
    let most = list.iter().filter_map(|trial| trial.fit.as_ref());
    if unknown
        && most
            .map(ComposedFit::criterion)
            .any(|c| c < fit.criterion())
    {
        return Ok(decision);
    }
    let mut reasons = decision.reasons;
    reasons.push(format!(
        "a general form that is no effect of the catalogue explains more: with {} ({}) it is {:.2} per sample",
        form.declaration.name,
        lower_first(form.declaration.title),
        evidence.chi_square_after
    ));
    Ok(Decision {
        status: Status::UnknownEffect,
        answer: Vec::new(),
        reasons,
        second: None,
        form: told(case, &form, &evidence, &fit),
    })
}

/// The fit that speaks for a decision; none where nothing is said to be missing.
fn explained_by<'f>(
    base: &'f Fitted,
    list: &'f [Trial],
    decision: &'f Decision,
) -> Option<&'f ComposedFit> {
    match decision.status {
        Status::Adequate | Status::CannotJudge => None,
        Status::UnknownEffect => Some(&base.baseline.all),
        Status::MissingEffect | Status::InstrumentSuspect => match &decision.second {
            Some(second) => Some(&second.fit),
            None => list[*decision.answer.first()?].fit.as_ref(),
        },
    }
}

/// The general form with the lowest criterion of those that might be claimed as an effect might.
fn best_form(
    case: &Case<'_>,
    base: &Fitted,
) -> Result<Option<(Trial, Evidence, ComposedFit)>, IdentificationError> {
    let names: Vec<&'static str> = (general_forms::all().iter())
        .map(|form| form.declaration().name)
        .filter(|name| {
            !case
                .options
                .excluded
                .iter()
                .any(|excluded| excluded == name)
        })
        .filter(|name| base.baseline.structure.with(name).is_ok())
        .collect();
    let (_, forms) = trials(case, base.clone(), &names, Goal::Claim)?;
    let claimable = |mut trial: Trial| {
        let evidence = trial.evidence.clone()?;
        let fit = trial.fit.take()?;
        let may = objections(&evidence, &case.options.claim).is_empty();
        may.then_some((trial, evidence, fit))
    };
    Ok(forms.into_iter().find_map(claimable))
}

/// Whether a form leaves so much less of the held-out events than what is named as an effect that is claimed must leave less of
/// them than the structure without it. A form follows many things that it was fitted to.
fn foretells_better(case: &Case<'_>, form: &Evidence, named: &ComposedFit) -> bool {
    match (form.gate, case.gate_misfit(named)) {
        (Some(gate), Some(of_named)) => {
            gate.after <= (1.0 - case.options.claim.held_out_fall_min) * of_named
        }
        _ => true,
    }
}

/// Whether the criterion of a form is lower by more than what the events do not tell apart, and by as much as a claim needs.
fn clearly_better(
    form: &ComposedFit,
    named: &ComposedFit,
    base: &Fitted,
    options: &ClaimOptions,
) -> bool {
    let squares: f64 = form.squares.iter().sum();
    let gain = base.baseline.all.criterion() - form.criterion();
    let told = told_apart(form.chi_square_per_row(), squares, gain, options);
    form.criterion() < named.criterion() - told.max(options.delta_bic_min)
}

fn told(
    case: &Case<'_>,
    form: &Trial,
    evidence: &Evidence,
    fit: &ComposedFit,
) -> Option<GeneralForm> {
    let name = form.declaration.name;
    let fit = case.narrowed(fit);
    let parameters = composed_parameters(&fit, name);
    let value = |own: &str| {
        let of_name = parameters
            .iter()
            .find(|p| p.name.rsplit('.').next() == Some(own));
        of_name.map(|p| p.value)
    };
    let effect_file = general_forms::with_values(name, &value).ok().flatten()?;
    Some(GeneralForm {
        name: name.to_owned(),
        title: form.declaration.title.to_owned(),
        misfit_before: evidence.chi_square_before,
        misfit_after: evidence.chi_square_after,
        delta_bic: evidence.delta_bic,
        held_out_error_before: evidence.gate.map(|gate| gate.before.sqrt()),
        held_out_error_after: evidence.gate.map(|gate| gate.after.sqrt()),
        parameters,
        model: FittedStructure::of(&fit, &case.trend),
        effect_file,
    })
}

fn lower_first(title: &str) -> String {
    let mut letters = title.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_lowercase().chain(letters).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::lower_first;

    #[test]
    fn a_title_goes_on_within_a_sentence() {
        assert_eq!(lower_first("Swings for a while"), "swings for a while");
        assert_eq!(lower_first(""), "");
    }
}
