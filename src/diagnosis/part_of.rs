//! An effect that is part of something else is tried together with it: alone it makes up for what it comes with.

use super::{
    addable::addable,
    case::Case,
    claim::{answer_set, reaches},
    evidence::{Evidence, is_adequate, objections},
    round::Second,
    trials::{Fitted, Goal, Trial, trials},
};
use crate::identification::{IdentificationError, composed::ComposedFit};

/// Effects, and what they are part of. Taps are those of a transformer, and the load lies behind its reactance: without
/// that the voltage behind it is too high in a dip, and small steps that come often make up for the difference.
const PART_OF: [(&str, &str); 1] = [("tap_changer", "feeder_impedance")];
/// It is tried where the effect by itself gains this share of what the best one gains.
const GAIN_SHARE: f64 = 0.5;

/// Whether two names are one thing.
pub(super) fn are_one(part: &str, other: &str) -> bool {
    PART_OF.contains(&(part, other))
}

/// An effect and what it is part of.
pub(super) struct Whole {
    /// The place of the effect in the list of trials.
    pub(super) part: usize,
    /// What it is part of, and the fit with both.
    pub(super) second: Second,
}

/// The effect of `list` that, with what it is part of, explains clearly more than any effect by itself, and more than the best
/// other one beside the same thing.
pub(super) fn whole(
    case: &Case<'_>,
    base: &Fitted,
    list: &[Trial],
) -> Result<Option<Whole>, IdentificationError> {
    let may_be_added = addable(&base.baseline.structure, case);
    let gain = |trial: &Trial| -trial.delta_bic();
    let most = list.iter().map(gain).fold(0.0, f64::max);
    let needed = case.options.claim.delta_bic_min;
    for (name, other) in PART_OF {
        let place = list.iter().position(|trial| trial.name() == name);
        let Some(part) = place.filter(|&place| {
            gain(&list[place]) >= needed.max(GAIN_SHARE * most) && may_be_added.contains(&other)
        }) else {
            continue;
        };
        case.watcher
            .says(format!("trying {name} with {other}"), 0, 1);
        let rival = list.iter().map(Trial::name);
        let rival = rival.filter(|rival| ![name, other].contains(rival)).take(1);
        let names: Vec<&'static str> = std::iter::once(list[part].name()).chain(rival).collect();
        let beside = match case.with(&base.baseline, other) {
            Ok(beside) => Fitted::new(case, beside),
            Err(error) if error.is_of_the_model() => continue,
            Err(error) => return Err(error),
        };
        let singles = list.iter().filter_map(|trial| trial.fit.as_ref());
        let lowest = singles.min_by(|a, b| a.criterion().total_cmp(&b.criterion()));
        let (lowest, below) = lowest.map_or((f64::INFINITY, f64::INFINITY), |fit| {
            (fit.criterion(), fit.squares.iter().sum::<f64>())
        });
        let (_, tried) = trials(case, beside, &names, Goal::Below(below))?;
        if let Some(fit) = named(case, &tried, name)
            && fit.criterion() <= lowest - needed
        {
            let second = Second { name: other, fit };
            return Ok(Some(Whole { part, second }));
        }
    }
    Ok(None)
}

/// The fit with `name`, where it is the first answer of the trials and explains what is left.
fn named(case: &Case<'_>, tried: &[Trial], name: &str) -> Option<ComposedFit> {
    let options = &case.options.claim;
    let refitted: Vec<&Trial> = tried.iter().filter(|t| t.evidence.is_some()).collect();
    let evidence = refitted.iter().filter_map(|trial| trial.evidence.clone());
    let judged: Vec<(Evidence, bool)> = evidence
        .map(|evidence| {
            let may = objections(&evidence, options).is_empty();
            (evidence, may)
        })
        .collect();
    let first = *answer_set(&judged, options).first()?;
    let explains = |e: &Evidence| reaches(e, options) || is_adequate(e.chi_square_after, options);
    let is_it = refitted[first].name() == name && explains(&judged[first].0);
    refitted[first].fit.clone().filter(|_| is_it)
}

#[cfg(test)]
mod tests {
    use super::PART_OF;
    use crate::load_model::Structure;

    #[test]
    fn parts_and_what_they_are_part_of_compose() {
        for (name, other) in PART_OF {
            let both = Structure::zip_im().with(other).and_then(|s| s.with(name));
            assert!(both.is_ok(), "{name} with {other}");
        }
    }
}
