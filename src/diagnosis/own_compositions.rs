//! What is left of events of which each has the composition that it most probably has: not the load of the day, but what
//! the model makes of it.

use super::{case::Case, diagnose::ERROR_TO_NOISE_FLOOR, outcome::StructureErrors};
use crate::{
    identification::{
        ErrorSummary,
        composed::{ComposedFit, Scatter, with_own_composition},
        evaluate::{Curves, EventModel, StaticModel, errors},
        intake::PreparedEvent,
    },
    load_model::{Structure, composed::SimulationError},
};

/// Of the squares beyond the floor this is the smaller part.
const SMALLER_PART: f64 = 0.25;

/// A fit whose composition each event moves as far as it most probably is.
#[derive(Debug)]
struct OwnCompositions<'a> {
    fit: &'a ComposedFit,
    scatter: &'a Scatter,
}

impl EventModel for OwnCompositions<'_> {
    fn curves(&self, event: &PreparedEvent) -> Result<Curves, SimulationError> {
        with_own_composition(event, self.fit, self.scatter)
            .ok_or(SimulationError::NotFinite { output: 0 })
    }
}

/// What a fit of a structure leaves in the untouched events, in words, where `of_one`, the errors with one composition for
/// all, is above the floor there; none where it is not, or an event has no response.
pub(super) fn left_in_untouched(
    case: &Case<'_>,
    structure: &Structure,
    fit: &ComposedFit,
    of_one: &StructureErrors,
) -> Option<String> {
    let error = of_one.untouched.as_ref()?.error_to_noise;
    if error <= ERROR_TO_NOISE_FLOOR {
        return None;
    }
    let scatter = &case.composed.scatter;
    let model = OwnCompositions { fit, scatter };
    let events = case.untouched_as(structure, fit);
    let left = errors(&model, &StaticModel::fit(&case.judged), &events).ok()?;
    Some(told(&left, error))
}

/// What is left, and of which event the most where that is not the smaller part of `error`, the error with one composition.
fn told(left: &ErrorSummary, error: f64) -> String {
    let own = left.error_to_noise;
    let told = format!("with the composition that each of them most probably has, it is {own:.2}");
    let beyond = |error: f64| (error.powi(2) - ERROR_TO_NOISE_FLOOR.powi(2)).max(0.0);
    if beyond(own) <= SMALLER_PART * beyond(error) {
        return format!("{told}: most of it is the load, which changes from event to event");
    }
    let most = (left.events.iter()).max_by(|a, b| a.error_to_noise.total_cmp(&b.error_to_noise));
    let most = most.filter(|_| left.events.len() > 1);
    let most = most.map(|most| format!(", most in {} ({:.2})", most.event, most.error_to_noise));
    let away = left.error_to_noise_away_from_edges;
    let at_edges = beyond(away) <= SMALLER_PART * beyond(own);
    let away = at_edges.then(|| format!(", away from the jumps of the voltage {away:.2}"));
    told + &most.unwrap_or_default() + &away.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::told;
    use crate::identification::{ErrorSummary, EventErrors};

    #[test]
    fn what_is_left_beyond_the_composition_is_told_with_its_event() {
        let event = |name: &str, error_to_noise| EventErrors {
            event: name.to_owned(),
            error_to_noise,
            ..EventErrors::default()
        };
        let summary = |error_to_noise| ErrorSummary {
            error_to_noise,
            error_to_noise_away_from_edges: error_to_noise,
            events: vec![event("a", 1.2), event("b", 3.4), event("c", 0.9)],
            ..ErrorSummary::default()
        };
        assert!(told(&summary(2.1), 2.6).ends_with("it is 2.10, most in b (3.40)"));
        assert!(told(&summary(1.3), 2.6).contains("it is 1.30: most of it is the load"));
        let mut one = summary(2.1);
        one.events.truncate(1);
        assert!(told(&one, 2.6).ends_with("it is 2.10"));
        one.error_to_noise_away_from_edges = 1.2;
        assert!(told(&one, 2.6).ends_with("it is 2.10, away from the jumps of the voltage 1.20"));
    }
}
