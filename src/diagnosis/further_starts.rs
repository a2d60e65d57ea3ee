//! Trials sketched once more, from other loads than the fits of the structure: where those are bent by what is missing, few
//! of its starts lead to where all is right.

use super::{
    case::Case,
    trials::{FOLLOWED, Fitted, Goal, Trial, wanted_beside_all},
};
use crate::{
    identification::{
        IdentificationError,
        composed::{ComposedFit, Ground, fit, has_no_motor},
    },
    load_model::effects,
};

/// An effect that leaves less than this share of the misfit says where everything else belongs.
const RIVALS_BELOW: f64 = 0.5;
/// Effects that are sketched again from another's fit, at most, ...
const RIVALS_MAX: usize = 3;
/// ... where nothing has a threshold those that leave less than this many times what the best one leaves.
const RIVALS_NEAR: f64 = 2.0;

/// Effects that are sketched again beside motors of every kind.
const FROM_OTHER_MOTORS: usize = 2;

/// Where an effect with a threshold is ahead, others that have one are sketched once more with everything
/// else as it has it: before the threshold's effect is in the model, all else is bent to make up for it, and
/// from there not each of them finds its way. So are, where the structure is far from the events, those that come near an
/// effect without a threshold: of two that straighten the motor each may end at another one.
pub(super) fn rivals_from_the_best(
    case: &Case<'_>,
    base: &Fitted,
    goal: Goal,
    list: &mut [Trial],
) -> Result<(), IdentificationError> {
    let options = &case.composed;
    let cancel = case.watcher.cancel;
    let order = by_criterion(list);
    let Some(&best) = order.first() else {
        return Ok(());
    };
    let before = base.chi_square();
    let left = list[best].chi_square();
    let switches = has_threshold(&list[best]);
    let Some(fit) = list[best]
        .fit
        .as_ref()
        .filter(|_| left < RIVALS_BELOW * before && (switches || before > FOLLOWED))
    else {
        return Ok(());
    };
    let Some(origin) = (base.baseline).with_values_of(&case.judged, fit, options, cancel) else {
        return Ok(());
    };
    let rivals = order.into_iter().skip(1);
    let rivals: Vec<usize> = rivals
        .filter(|&place| {
            let near = switches || list[place].chi_square() < RIVALS_NEAR * left;
            near && has_threshold(&list[place]) == switches
        })
        .take(RIVALS_MAX)
        .collect();
    let wanted = wanted_beside_all(case, base, goal, list);
    let is_rival = |(place, trial)| rivals.contains(&place).then_some(trial);
    let rivals = list.iter_mut().enumerate().filter_map(is_rival);
    sketched_again(case, base, &origin, wanted, rivals)
}

/// Where effects that come first follow the events without the motor, they are sketched once more from a fit of the
/// structure that has the motor of the best other effect: a motor given up for what was missing does not come back by
/// itself.
pub(super) fn with_the_motor_of_another(
    case: &Case<'_>,
    base: &Fitted,
    list: &mut [Trial],
) -> Result<(), IdentificationError> {
    let options = &case.composed;
    let order = by_criterion(list);
    let without = |place: &usize| list[*place].fit.as_ref().is_none_or(has_no_motor);
    let other = order.iter().find(|place| !without(place));
    let origin = other.and_then(|&place| {
        let fit = list[place].fit.as_ref()?;
        (base.baseline).with_values_of(&case.judged, fit, options, case.watcher.cancel)
    });
    let Some(origin) = origin else {
        return Ok(());
    };
    // Screens say little of what is far from any optimum.
    let (model, values, free) = (&origin.model, &origin.parameters, &origin.free);
    let own = fit(
        &case.judged,
        model,
        values,
        free,
        options,
        case.watcher.cancel,
    );
    let origin = own.filter(|own| !has_no_motor(own)).unwrap_or(origin);
    let first: Vec<usize> = order.into_iter().filter(without).take(RIVALS_MAX).collect();
    let is_first = |(place, trial)| first.contains(&place).then_some(trial);
    let trials = list.iter_mut().enumerate().filter_map(is_first);
    sketched_again(case, base, &origin, f64::INFINITY, trials)
}

/// Where the best effect still leaves much, those that come first and have a threshold are sketched once more beside motors
/// of every kind: what acts in deep dips only bends a motor that is fitted without it, and from there few starts lead to
/// where both are right.
pub(super) fn from_other_motors(
    case: &Case<'_>,
    base: &Fitted,
    goal: Goal,
    list: &mut [Trial],
) -> Result<(), IdentificationError> {
    let order = by_criterion(list);
    let least = list
        .iter()
        .map(Trial::chi_square)
        .fold(f64::INFINITY, f64::min);
    if matches!(goal, Goal::Below(_)) || least < FOLLOWED {
        return Ok(());
    }
    let chosen: Vec<usize> = (order.into_iter())
        .filter(|place| has_threshold(&list[*place]))
        .take(FROM_OTHER_MOTORS)
        .collect();
    if chosen.is_empty() {
        return Ok(());
    }
    let (options, cancel) = (&case.composed, case.watcher.cancel);
    let motors = (base.baseline).motors_of_every_kind(&case.judged, options, cancel);
    if motors.is_empty() {
        return Ok(());
    }
    let structure = &base.baseline.structure;
    let ground = Ground::new(&case.judged, structure, &[], options, cancel).and_from(&motors);
    let is_chosen = |(place, trial)| chosen.contains(&place).then_some(trial);
    let trials = list.iter_mut().enumerate().filter_map(is_chosen);
    sketched_on(case, base, &ground, f64::INFINITY, trials)
}

/// Whether an effect acts below a voltage only.
fn has_threshold(trial: &Trial) -> bool {
    let effect = effects::find(trial.name());
    effect.is_some_and(|e| e.threshold().is_some())
}

/// The places of trials that have a fit, best criterion first.
fn by_criterion(list: &[Trial]) -> Vec<usize> {
    let criterion = |trial: &Trial| trial.fit.as_ref().map(ComposedFit::criterion);
    let mut order: Vec<(usize, f64)> = (list.iter().enumerate())
        .filter_map(|(place, trial)| Some((place, criterion(trial)?)))
        .collect();
    order.sort_by(|a, b| a.1.total_cmp(&b.1));
    order.into_iter().map(|(place, _)| place).collect()
}

/// Sketches effects from another fit of the structure.
fn sketched_again<'t>(
    case: &Case<'_>,
    base: &Fitted,
    origin: &ComposedFit,
    wanted: f64,
    trials: impl IntoIterator<Item = &'t mut Trial>,
) -> Result<(), IdentificationError> {
    let (options, cancel) = (&case.composed, case.watcher.cancel);
    let origins = [origin];
    let structure = &base.baseline.structure;
    let ground = Ground::new(&case.judged, structure, &origins, options, cancel);
    sketched_on(case, base, &ground, wanted, trials)
}

/// Sketches effects from some loads; what ends lower takes the place of what is known.
fn sketched_on<'t>(
    case: &Case<'_>,
    base: &Fitted,
    ground: &Ground<'_>,
    wanted: f64,
    trials: impl IntoIterator<Item = &'t mut Trial>,
) -> Result<(), IdentificationError> {
    for trial in trials {
        case.watcher
            .says(format!("trying {} again", trial.name()), 0, 1);
        let found = base
            .baseline
            .sketched(ground, &ground.screen(trial.name())?, wanted);
        case.watcher.check()?;
        let known = trial
            .fit
            .as_ref()
            .map_or(f64::INFINITY, ComposedFit::criterion);
        if let Some(found) = found.filter(|found| found.criterion() < known) {
            trial.fit = Some(found);
            trial.evidence = None;
        }
    }
    Ok(())
}
