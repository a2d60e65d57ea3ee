//! What the effects that a structure already has are worth to the events.

use super::{case::Case, longer_window::is_accounted_for, outcome::EffectWorth};
use crate::identification::{IdentificationError, composed::Baseline, intake::LONGER_WINDOW};

/// An effect is superfluous when the criterion without it is at most this much worse.
const SUPERFLUOUS_DELTA_BIC: f64 = 10.0;

/// Whether an effect is, without which the criterion is worse by so much.
pub(super) fn is_superfluous(worse_by: f64) -> bool {
    worse_by <= SUPERFLUOUS_DELTA_BIC
}

/// Of each of these effects what is lost without it: the others begin where they are. An effect without which
/// nothing can be fitted has no entry.
pub(super) fn worth_of(
    case: &Case<'_>,
    at: &Baseline,
    effects: &[String],
) -> Result<Vec<EffectWorth>, IdentificationError> {
    let mut list = Vec::new();
    for (k, effect) in effects.iter().enumerate() {
        // What the events are seen through stays, whatever else is fitted again.
        if effect == LONGER_WINDOW && is_accounted_for(&case.judged) {
            continue;
        }
        let watcher = case.watcher;
        watcher.says(format!("fitting without {effect}"), k, effects.len());
        let structure = at.structure.without(effect)?;
        let fewer = match case.baseline_from(&structure, &at.all) {
            Ok(fewer) => fewer,
            Err(error) if error.is_of_the_model() => continue,
            Err(error) => return Err(error),
        };
        let delta_bic_without = fewer.all.criterion() - at.all.criterion();
        list.push(EffectWorth {
            effect: effect.clone(),
            delta_bic_without,
            untouched_without: case.error_on_untouched(&fewer.all),
            is_superfluous: is_superfluous(delta_bic_without),
        });
    }
    Ok(list)
}

/// What is said of each effect that the events do not need; `with_it` is the error over noise on the untouched
/// events of the whole structure.
pub(super) fn superfluous_in_words(
    effects: &[EffectWorth],
    with_it: Option<f64>,
) -> impl Iterator<Item = String> {
    let superfluous = effects.iter().filter(|worth| worth.is_superfluous);
    superfluous.map(move |worth| {
        let errors = match (worth.untouched_without, with_it) {
            (Some(without), Some(with)) => format!(
                ", and the error on untouched events is {without:.2} times the noise ({with:.2} with it)"
            ),
            _ => String::new(),
        };
        format!(
            "the events do not need {}: the criterion {} by {:.0} without it{errors}",
            worth.effect,
            if worth.delta_bic_without <= 0.0 {
                "falls"
            } else {
                "rises only"
            },
            worth.delta_bic_without.abs()
        )
    })
}

/// Names of the effects of a structure.
pub(super) fn effects_of(at: &Baseline) -> Vec<String> {
    let plain = at.structure.plain_part();
    let names = at.structure.names().into_iter();
    names.filter(|name| !plain.contains(name)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_needed_is_told_with_its_figures() {
        let worth = |effect: &str, delta_bic_without: f64| EffectWorth {
            effect: effect.to_owned(),
            delta_bic_without,
            untouched_without: Some(1.064),
            is_superfluous: is_superfluous(delta_bic_without),
        };
        let list = [worth("one", -5.4), worth("two", 9.0), worth("three", 300.0)];
        let told: Vec<String> = superfluous_in_words(&list, Some(1.05)).collect();
        assert_eq!(
            told,
            [
                "the events do not need one: the criterion falls by 5 without it, and the error on untouched events is \
                 1.06 times the noise (1.05 with it)",
                "the events do not need two: the criterion rises only by 9 without it, and the error on untouched events \
                 is 1.06 times the noise (1.05 with it)"
            ]
        );
        let told = superfluous_in_words(&list, None).next().unwrap();
        assert!(told.ends_with("5 without it"), "{told}");
    }
}
