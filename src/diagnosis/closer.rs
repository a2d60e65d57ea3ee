//! Where a structure follows the events, one round more closely: between events no more varies than they need.
//!
//! What is assumed of the composition of the load at first (2.5 % of P0 in the motor, 2 % in the coefficients) takes in as
//! much of what is missing, in each event as that one wants it. As long as the structure leaves more than the noise, nothing
//! says how much of that is variation. Where it leaves no more with less, it is not needed.

use super::{
    anew::Stop,
    case::Case,
    evidence::Evidence,
    outcome::Status,
    round::{COMPANIONS, Round, round},
    trials::COMMON,
};
use crate::identification::composed::{
    Baseline, ComposedFit, ComposedFitOptions, fit, narrower_than,
};

/// What is named in a closer round takes at least this share of the misfit of the fitted events: a little of what is left
/// there is the model's own, too.
const STANDS_OUT: f64 = 0.05;

/// A case between whose events less varies, and a structure fitted to it.
struct Closer<'a> {
    case: Case<'a>,
    base: Baseline,
}

impl<'a> Case<'a> {
    /// A round on a fitted structure, and the case that it was made with where that is a closer one.
    pub(super) fn round(&self, base: &Baseline) -> Result<(Round, Option<Case<'a>>), Stop> {
        let as_assumed = || Ok((round(self, base.clone())?, None));
        let Some(Closer { case, base: at }) = self.closer(base) else {
            return as_assumed();
        };
        let mut closer = match round(&case, at.clone()) {
            Err(Stop::Failed(error)) if error.is_of_the_model() => return as_assumed(),
            closer => closer?,
        };
        let Some(first) = closer.names().first().copied() else {
            return Ok((closer, Some(case)));
        };
        // Little shows here that is no effect: the model's own errors, and what every motor does.
        if !takes_enough(&closer) || COMMON.contains(&first) {
            return as_assumed();
        }
        let unlike_others = |e: &Evidence| e.stands_out(&self.options.claim);
        if !COMPANIONS.contains(&first) && !first_evidence(&closer).is_some_and(unlike_others) {
            let wide = round(self, base.clone())?;
            if names_another(&wide, &closer) {
                return Ok((wide, None));
            }
        }
        let told = self.told(&case, [&base.all, &at.all]);
        closer.decision.reasons.push(told);
        Ok((closer, Some(case)))
    }

    /// The case with the narrowest spread between events under which a structure leaves no more than the noise may, and the
    /// structure fitted with that. `None` where it leaves more, or takes what is assumed.
    fn closer(&self, base: &Baseline) -> Option<Closer<'a>> {
        let floor = self.options.claim.floor;
        if base.all.chi_square_per_row() > floor {
            return None;
        }
        let cancel = self.watcher.cancel;
        let shared = self.narrowed(&base.all);
        let (model, from, free) = (&shared.model, &shared.parameters, &shared.free);
        narrower_than(&self.composed.scatter)
            .iter()
            .find_map(|scatter| {
                let options = ComposedFitOptions {
                    scatter: *scatter,
                    ..self.composed
                };
                let all = fit(&self.judged, model, from, free, &options, cancel)?;
                (all.chi_square_per_row() <= floor).then(|| Closer {
                    case: self.with_scatter(*scatter),
                    base: Baseline {
                        structure: base.structure.clone(),
                        all,
                        mild: None,
                        ordinary: None,
                    },
                })
            })
    }

    /// That a round is a closer one, with its figures.
    fn told(&self, closer: &Case<'_>, fits: [&ComposedFit; 2]) -> String {
        let share = closer.composed.scatter.motor_share / self.composed.scatter.motor_share;
        let [assumed, left] = fits.map(ComposedFit::chi_square_per_row);
        format!(
            "the load was taken to vary from event to event by {:.0} % of what is assumed at first: the structure as it is leaves {left:.2} per sample then, and {assumed:.2} with all of it, both no more than the noise may",
            100.0 * share
        )
    }
}

/// Whether a round names effects of the load, no companions, of which a closer one names none. They show whatever is taken
/// to vary, and what the closer one names may be what they leave.
fn names_another(wide: &Round, closer: &Round) -> bool {
    let (wide_names, closer_names) = (wide.names(), closer.names());
    wide.decision.status == Status::MissingEffect
        && !wide_names.iter().any(|name| COMPANIONS.contains(name))
        && !wide_names.iter().any(|name| closer_names.contains(name))
}

/// What speaks for the first effect that a round names.
fn first_evidence(round: &Round) -> Option<&Evidence> {
    let first = round.decision.answer.first();
    first.and_then(|&place| round.trials[place].evidence.as_ref())
}

/// Whether what a round names takes enough of the misfit.
fn takes_enough(round: &Round) -> bool {
    first_evidence(round)
        .is_none_or(|e| e.chi_square_after <= (1.0 - STANDS_OUT) * e.chi_square_before)
}
