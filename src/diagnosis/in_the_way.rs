//! An event that keeps a structure from following all others.
//!
//! A motor that stays below its speed after the fault draws for seconds what no running motor does. Where the structure's own
//! motor recovers at such an event, its constants are bent until it does not, and what is left of all other events says
//! nothing of what is missing. Effects are compared without it then, and what they explain is held against it afterwards.
//! Where that follows it, or leaves much that something else may explain, it stays one of those that every later fit has to
//! follow; what comes near and no nearer sets it apart, as `set_apart` does with what nothing explains.

use super::{
    anew::Stop,
    case::{Case, plain_search},
    event_sets::{Apart, Changes},
    outcome::Status,
    round::{Round, round},
    set_apart::LEFT_FLOORS,
    trials::FAR_PER_ROW,
};
use crate::identification::{
    IdentificationError,
    composed::{Baseline, ComposedFit},
    fit::SearchOptions,
    fit_aligned,
    intake::PreparedEvent,
};

/// An event is in the way of a structure that is far from the events ([`FAR_PER_ROW`]) and leaves this many times less of the
/// others without it.
const FALL: f64 = 10.0;
/// So many of the deepest are looked at.
const DEEPEST: usize = 3;
/// With fewer judged events none is left out.
const EVENTS_MIN: usize = 5;

/// What was found without the event that was in the way.
pub(super) struct WithoutIt<'a> {
    /// The other events.
    pub(super) case: Case<'a>,
    /// Of them.
    pub(super) round: Round,
    /// The structure with the first effect of the answer, fitted to all events from there.
    pub(super) with_it: ComposedFit,
    /// That the event is set apart for good, where that effect explains it but does not follow it: at the edge of stall the
    /// simulation comes near to what the motor did and no nearer.
    pub(super) apart: Option<Changes>,
}

impl<'a> Case<'a> {
    /// A round among the other events, where one is in the way and an effect explains the others; none where the events
    /// have to be taken as they are, as where the effect then does not come closer to all of them.
    pub(super) fn without_what_is_in_the_way(
        &self,
        base: &Baseline,
    ) -> Result<Option<WithoutIt<'a>>, Stop> {
        let Some((event, others)) = self.in_the_way(base)? else {
            return Ok(None);
        };
        let reason = format!(
            "with it {} leave {:.1} per sample of all events, without it about {others:.1} of the others",
            base.structure.names().join(" + "),
            base.all.chi_square_per_row()
        );
        match self.round_without(base, event, &reason) {
            Err(Stop::Failed(error)) if error.is_of_the_model() => Ok(None),
            other => other,
        }
    }

    /// The place of the event among the deepest ones without which most of the misfit is gone, and what is left per row of
    /// the others then.
    fn in_the_way(&self, base: &Baseline) -> Result<Option<(usize, f64)>, IdentificationError> {
        let left = base.all.chi_square_per_row();
        let plain = base.structure.names() == base.structure.plain_part().names();
        let enough = self.judged.len() >= EVENTS_MIN && self.has_room_apart();
        if !(plain && enough && left > FAR_PER_ROW) {
            return Ok(None);
        }
        let mut without = Vec::with_capacity(DEEPEST);
        for (number, event) in deepest(&self.judged).into_iter().enumerate() {
            let what = "fitting ZIP and motor without one event".to_owned();
            self.watcher.says(what, number, DEEPEST);
            without.push((event, self.left_without(event)?));
        }
        Ok(most_in_the_way(left, &without))
    }

    /// What ZIP and motor leave per row of all but one event; infinite where nothing is found.
    fn left_without(&self, event: usize) -> Result<f64, IdentificationError> {
        let mut others = self.judged.clone();
        others.remove(event);
        let rows: usize = others.iter().map(PreparedEvent::rows).sum();
        let search = SearchOptions {
            explored_below_per_row: 0.0,
            ..plain_search(self.options)
        };
        let problem = self.options.identification.problem;
        match fit_aligned(others, problem, &search, self.watcher.cancel) {
            Ok(fit) => {
                let best = fit.found.solutions.first();
                Ok(best.map_or(f64::INFINITY, |best| {
                    2.0 * best.point.objective / rows.max(1) as f64
                }))
            }
            Err(IdentificationError::NoSolution) => Ok(f64::INFINITY),
            Err(error) => Err(error),
        }
    }

    /// The round among all but one event; none where nothing is missing there, nothing is named, or what is named comes no
    /// closer to all events than the structure.
    fn round_without(
        &self,
        base: &Baseline,
        event: usize,
        reason: &str,
    ) -> Result<Option<WithoutIt<'a>>, Stop> {
        let id = &self.judged[event].id;
        let apart = |reason: String| Changes {
            apart: vec![Apart {
                event: id.clone(),
                reason,
            }],
            ..Changes::default()
        };
        let mut changes = self.changes.clone();
        changes.extend(apart(format!(
            "only while effects are compared, as {reason}"
        )));
        let (site, options, watcher) = (self.site, self.options, self.watcher);
        watcher.says(format!("leaving {id} out for now"), 0, 1);
        let mut case = Case::new(
            site,
            self.windows,
            &base.structure,
            options,
            &changes,
            watcher,
        )?;
        let of_others = case.baseline(&base.structure)?;
        case.settle_uses(&of_others)?;
        if of_others.all.chi_square_per_row() <= options.claim.floor {
            return Ok(None);
        }
        let mut round = round(&case, of_others)?;
        let claims = matches!(
            round.decision.status,
            Status::MissingEffect | Status::InstrumentSuspect
        );
        let first = round.decision.answer.first().filter(|_| claims);
        let Some(trial) = first.map(|&place| &round.trials[place]) else {
            return Ok(None);
        };
        let (name, Some(fit)) = (trial.name(), &trial.fit) else {
            return Ok(None);
        };
        let with_it = self.with_found(base, name, fit)?.all;
        if with_it.criterion() > base.all.criterion() - options.claim.delta_bic_min {
            return Ok(None);
        }
        let [before, after] = [&base.all, &with_it].map(ComposedFit::chi_square_per_row);
        let left = self.per_row(&with_it)[event];
        let told = format!(
            "{name} fitted to {id} as well leaves {left:.2} per sample of it and {after:.2} of all events"
        );
        let for_good = is_explained_but_not_followed([before, after], left, options.claim.floor);
        let apart = for_good.then(|| apart(format!("{reason}; {told}")));
        round.decision.reasons.push(told);
        Ok(Some(WithoutIt {
            case,
            round,
            with_it,
            apart,
        }))
    }
}

/// The event without which least is left of the others, where that is far less than what is left of all.
fn most_in_the_way(left: f64, without: &[(usize, f64)]) -> Option<(usize, f64)> {
    let least = (without.iter()).min_by(|one, other| one.1.total_cmp(&other.1));
    least.copied().filter(|(_, others)| *others < left / FALL)
}

/// Whether an effect takes what an event in the way leaves of all events, from `before` per row to `after`, and yet comes no
/// nearer to the event itself than some times the noise.
fn is_explained_but_not_followed([before, after]: [f64; 2], left: f64, floor: f64) -> bool {
    left > LEFT_FLOORS * floor && after < before / FALL
}

/// Places of the deepest events, the deepest first.
fn deepest(events: &[PreparedEvent]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..events.len()).collect();
    order.sort_by(|&a, &b| {
        events[a]
            .lowest_voltage
            .total_cmp(&events[b].lowest_voltage)
    });
    order.truncate(DEEPEST);
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_event_without_which_the_others_are_followed_is_in_the_way() {
        let without = [(6, 5.2), (2, 0.8), (4, 60.0)];
        assert_eq!(most_in_the_way(67.0, &without), Some((2, 0.8)));
        assert_eq!(most_in_the_way(7.9, &without), None);
        assert_eq!(most_in_the_way(67.0, &[(6, f64::INFINITY)]), None);
        assert_eq!(most_in_the_way(67.0, &[]), None);
    }

    #[test]
    fn what_an_effect_follows_or_does_not_explain_is_not_set_apart_for_good() {
        assert!(is_explained_but_not_followed([67.0, 0.67], 3.2, 0.7));
        assert!(!is_explained_but_not_followed([67.0, 0.4], 1.1, 0.7));
        // It may be the second of two effects that is missing there.
        assert!(!is_explained_but_not_followed([67.0, 20.0], 160.0, 0.7));
    }
}
