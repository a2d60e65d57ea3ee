//! Effects that cannot be told apart are compared once more with what every motor has.
//!
//! Where much is missing, a companion does not show before the right effect is in the model: what it leaves is
//! then made up for by whichever of the equals has a parameter to spare.

use super::{
    case::Case,
    claim::{Order, earlier, order, told_apart},
    trials::{Fitted, Trial},
};
use crate::identification::{IdentificationError, composed::ComposedFit};

/// The places in `list` of an answer set, in the order of their criterion with each of `companions` that lowers
/// it, without those that are told apart then. As they are where no companion may be added.
pub(super) fn beside_companions(
    case: &Case<'_>,
    base: &Fitted,
    list: &[Trial],
    answer: Vec<usize>,
    companions: &[&'static str],
) -> Result<Vec<usize>, IdentificationError> {
    let structure = &base.baseline.structure;
    let absent = companions.iter().find(|name| {
        let excluded = case.options.excluded.iter().any(|x| x == **name);
        !excluded
            && structure.with(name).is_ok()
            && !answer.iter().any(|&i| list[i].name() == **name)
    });
    let Some(companion) = absent.filter(|_| answer.len() > 1) else {
        return Ok(answer);
    };
    let mut fits: Vec<(usize, ComposedFit)> = Vec::new();
    for &place in &answer {
        let Some(alone) = list[place].fit.clone() else {
            return Ok(answer);
        };
        let name = list[place].name();
        case.watcher.says(
            format!("fitting {companion} beside {name}"),
            fits.len(),
            answer.len(),
        );
        let with = base.baseline.completed(
            &case.judged,
            alone.clone(),
            name,
            &case.composed,
            case.watcher.cancel,
        )?;
        let beside = with.extended(&case.judged, companion, &case.composed, case.watcher.cancel)?;
        case.watcher.check()?;
        let lower = beside.filter(|fit| fit.criterion() < alone.criterion());
        fits.push((place, lower.unwrap_or(alone)));
    }
    fits.sort_by(|a, b| a.1.criterion().total_cmp(&b.1.criterion()));
    let best = &fits[0].1;
    let limit = best.criterion()
        + told_apart(
            best.chi_square_per_row(),
            best.squares.iter().sum(),
            base.baseline.all.criterion() - best.criterion(),
            &case.options.claim,
        );
    let ordered = |(place, fit): &(usize, ComposedFit)| -> Order {
        let evidence = list[*place].evidence.as_ref();
        evidence.map_or((true, fit.criterion()), |evidence| {
            order(evidence, fit.criterion(), &case.options.claim)
        })
    };
    fits.retain(|(_, fit)| fit.criterion() <= limit);
    fits.sort_by(|a, b| earlier(ordered(a), ordered(b)));
    Ok(fits.into_iter().map(|(place, _)| place).collect())
}
