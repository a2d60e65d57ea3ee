//! Whether a general form explains more than what the catalogue offers: then something is missing that it does not have.

use super::{
    case::Case,
    claim::told_apart,
    evidence::{Evidence, objections},
    options::ClaimOptions,
    outcome::{GeneralForm, Status},
    part_of::are_one,
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
    let bar = Bar::of(list, &decision, options);
    if named.chi_square_per_row() < bar.tried_above {
        return Ok(decision);
    }
    let below = of_use_below(list, named, &decision, &bar, options);
    let Some((form, evidence, fit)) = best_form(case, base, below)? else {
        return Ok(decision);
    };
    let explains_more = if decision.status == Status::UnknownEffect {
        let known = list.iter().filter_map(|trial| trial.fit.as_ref());
        let mut known = known.map(ComposedFit::criterion);
        known.all(|criterion| fit.criterion() <= criterion)
    } else {
        let squares: f64 = fit.squares.iter().sum();
        let gain = base.baseline.all.criterion() - fit.criterion();
        let told = told_apart(fit.chi_square_per_row(), squares, gain, options);
        let by_form = Figures {
            criterion: fit.criterion(),
            held_out: evidence.gate.map(|gate| gate.after),
        };
        let by_names = Figures {
            criterion: named.criterion(),
            held_out: case.gate_misfit(named),
        };
        bar.is_cleared(by_form, by_names, told, options)
    };
    if !explains_more {
        return Ok(decision);
    }
    let mut reasons = decision.reasons;
    let how = if bar.of_pair { "as much" } else { "more" };
    reasons.push(format!(
        "a general form that is no effect of the catalogue explains {how}: with {} ({}) it is {:.2} per sample",
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

/// A criterion counts what is left and what it took to get there, so that a fit with a lower one may leave a little more.
const LEFT_MORE: f64 = 1.05;

/// Weighted squares above which a form cannot take a decision back: it must come down to what explains most (`named`, or
/// all that was tried where nothing does), and beside two names to what events tell from it.
fn of_use_below(
    list: &[Trial],
    named: &ComposedFit,
    decision: &Decision,
    bar: &Bar,
    options: &ClaimOptions,
) -> f64 {
    let squares = |fit: &ComposedFit| fit.squares.iter().sum::<f64>();
    let left = squares(named);
    if decision.status == Status::UnknownEffect {
        let known = list.iter().filter_map(|trial| trial.fit.as_ref());
        return LEFT_MORE * known.map(squares).fold(left, f64::min);
    }
    let told = if bar.of_pair {
        told_apart(named.chi_square_per_row(), left, f64::INFINITY, options)
    } else {
        0.0
    };
    LEFT_MORE * (left + told)
}

/// The general form with the lowest criterion of those that might be claimed as an effect might; what cannot come below so
/// many weighted squares is given up.
fn best_form(
    case: &Case<'_>,
    base: &Fitted,
    below: f64,
) -> Result<Option<(Trial, Evidence, ComposedFit)>, IdentificationError> {
    let names: Vec<&'static str> = (general_forms::all().iter())
        .map(|form| form.declaration().name)
        .filter(|name| !case.options.excluded.iter().any(|x| x == name))
        .filter(|name| base.baseline.structure.with(name).is_ok())
        .collect();
    let (_, forms) = trials(case, base.clone(), &names, Goal::Below(below))?;
    let claimable = |mut trial: Trial| {
        let evidence = trial.evidence.clone()?;
        let fit = trial.fit.take()?;
        let may = objections(&evidence, &case.options.claim).is_empty();
        may.then_some((trial, evidence, fit))
    };
    Ok(forms.into_iter().find_map(claimable))
}

/// What a form must do for a decision to be taken back.
struct Bar {
    /// Forms are tried where the decision leaves more than this per row.
    tried_above: f64,
    /// Whether two names are the answer.
    of_pair: bool,
}

impl Bar {
    /// One name, or what is one thing, stands where it is at the floor.
    fn of(list: &[Trial], decision: &Decision, options: &ClaimOptions) -> Self {
        let pair = decision.second.as_ref().zip(decision.answer.first());
        let of_pair =
            pair.is_some_and(|(second, &first)| !are_one(list[first].name(), second.name));
        let floor = options.reached_floors * options.floor;
        Self {
            tried_above: if of_pair { 0.0 } else { floor },
            of_pair,
        }
    }

    /// One name gives way to a form that is better by more than the events tell apart (`told`), and by as much as a claim needs,
    /// in the criterion and on held-out events: a form follows many things that it was fitted to. Two names give way to one form
    /// that the events do not tell from them: two effects that cancel each other imitate most things.
    fn is_cleared(&self, form: Figures, names: Figures, told: f64, options: &ClaimOptions) -> bool {
        let (criterion, held_out) = if self.of_pair {
            (told, options.held_out_fall_min)
        } else {
            (-told.max(options.delta_bic_min), -options.held_out_fall_min)
        };
        let foretold = form.held_out.zip(names.held_out);
        form.criterion <= names.criterion + criterion
            && foretold.is_none_or(|(form, names)| form <= (1.0 + held_out) * names)
    }
}

/// What speaks for a form, or for names.
#[derive(Clone, Copy)]
struct Figures {
    criterion: f64,
    /// Weighted squares per sample of the held-out events; none without any.
    held_out: Option<f64>,
}

/// A form as it is told, narrowed as what is published.
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
    // Whatever a fit may end at can be written: a test of the forms.
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
    use super::*;

    const fn figures(criterion: f64, held_out: f64) -> Figures {
        Figures {
            criterion,
            held_out: Some(held_out),
        }
    }

    #[test]
    fn one_name_gives_way_to_what_is_clearly_better_on_all_events() {
        let options = ClaimOptions::default();
        let bar = Bar {
            tried_above: 0.9,
            of_pair: false,
        };
        let named = figures(5000.0, 1.0);
        let clears = |form, told| bar.is_cleared(form, named, told, &options);
        assert!(clears(figures(4500.0, 0.8), 400.0));
        assert!(!clears(figures(4500.0, 0.8), 600.0), "not told apart");
        assert!(
            !clears(figures(4980.0, 0.8), 0.0),
            "less than a claim needs"
        );
        assert!(!clears(figures(4500.0, 0.95), 400.0), "foretells no better");
        let ungated = Figures {
            held_out: None,
            ..figures(4500.0, 0.0)
        };
        assert!(clears(ungated, 400.0));
    }

    #[test]
    fn two_names_give_way_to_one_form_that_is_as_good() {
        let options = ClaimOptions::default();
        let bar = Bar {
            tried_above: 0.0,
            of_pair: true,
        };
        let named = figures(5000.0, 1.0);
        let clears = |form| bar.is_cleared(form, named, 100.0, &options);
        assert!(clears(figures(5060.0, 1.01)) && clears(figures(4000.0, 0.5)));
        assert!(!clears(figures(5200.0, 1.0)), "told apart");
        assert!(!clears(figures(5060.0, 1.2)), "foretells less");
    }

    #[test]
    fn a_title_goes_on_within_a_sentence() {
        assert_eq!(lower_first("Swings for a while"), "swings for a while");
        assert_eq!(lower_first(""), "");
    }
}
