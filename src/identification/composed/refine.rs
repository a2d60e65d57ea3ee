//! A sketch of a fit with one more effect, fitted to the end.

use super::{
    fit::{ComposedFit, ComposedFitOptions, ROUGH_ABOVE, fit_rows, unfitted},
    relay_walk,
    rows::EventRows,
    screening::Step,
    threshold::settled_with_others,
    waiting,
};
use crate::{
    identification::intake::PreparedEvent,
    load_model::{composed::Accuracy, effect::Effect, effects},
};

/// How often the relays' settings are walked after a fit, and others tried, at most.
const WALKS_MAX: usize = 3;

/// `fit`, of a structure to which `effect` was added last, fitted to the end; its threshold in the middle
/// of where it may lie. As it was where that ends higher.
#[must_use]
pub fn refine(
    events: &[PreparedEvent],
    fit: ComposedFit,
    effect: &str,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> ComposedFit {
    let Some(effect) = effects::find(effect) else {
        return fit;
    };
    let mut fit = fit;
    if fit.chi_square_per_row() > ROUGH_ABOVE {
        let of = |event| EventRows::with_accuracy(event, Accuracy::Rough);
        let rough: Vec<EventRows<'_>> = events.iter().map(of).collect();
        fit = refine_rows(&rough, &fit, effect, options, cancel);
    }
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    // It may have been simulated roughly.
    let (model, parameters) = (&fit.model, &fit.parameters);
    let Some(begun) = unfitted(&rows, model, parameters, &fit.free, options, cancel) else {
        return fit;
    };
    let fit = ComposedFit {
        evaluations: fit.evaluations,
        given_up: fit.given_up,
        ..begun
    };
    if fit.chi_square_per_row() > ROUGH_ABOVE || fit.given_up {
        return fit;
    }
    refine_rows(&rows, &fit, effect, options, cancel)
}

/// The same on rows, which say how exactly events are simulated.
pub(super) fn refine_rows(
    rows: &[EventRows<'_>],
    fit: &ComposedFit,
    effect: &'static dyn Effect,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> ComposedFit {
    let found = fit_rows(
        rows,
        &fit.model,
        &fit.parameters,
        &fit.free,
        options,
        cancel,
    );
    let lower =
        |found: &ComposedFit| found.minus_twice_log_posterior() <= fit.minus_twice_log_posterior();
    let given_up = found.as_ref().is_some_and(|found| found.given_up);
    let mut best = found.filter(lower).unwrap_or_else(|| fit.clone());
    best.evaluations += fit.evaluations;
    best.given_up = given_up;
    if given_up {
        return best;
    }
    let other = |fit: &ComposedFit, from: Option<Vec<f64>>| {
        let found = fit_rows(rows, &fit.model, &from?, &fit.free, options, cancel)?;
        let gained = fit.minus_twice_log_posterior() - found.minus_twice_log_posterior();
        let evaluations = found.evaluations + fit.evaluations;
        (gained > relay_walk::WORTH).then_some(ComposedFit {
            evaluations,
            ..found
        })
    };
    for settings in [relay_walk::from_fit, waiting::from_fit] {
        for _ in 0..WALKS_MAX {
            let Some(found) = other(&best, settings(rows, &best, options, cancel)) else {
                break;
            };
            best = found;
        }
    }
    let step = Step {
        rows,
        model: &fit.model,
        effect,
        origin: fit,
        options,
        cancel,
    };
    if !effect.screened_at().is_empty() {
        best = of_another_size(&step, best);
    }
    settled_with_others(&step, best)
}

/// The fit, or one begun at what the effect is mistaken for: which of several sizes is right shows once all else is
/// fitted.
fn of_another_size(step: &Step<'_>, fit: ComposedFit) -> ComposedFit {
    let coarse = step.options.coarse();
    let roughly = Step {
        options: &coarse,
        ..*step
    };
    let other = roughly.taken_for_another(fit.clone());
    if other.parameters == fit.parameters {
        return fit;
    }
    let (from, free) = (&other.parameters, &other.free);
    let found = fit_rows(step.rows, step.model, from, free, step.options, step.cancel);
    let lower =
        |found: &ComposedFit| found.minus_twice_log_posterior() < fit.minus_twice_log_posterior();
    found.filter(lower).unwrap_or(fit)
}
