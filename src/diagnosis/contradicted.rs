//! Untouched events that contradict a model which is adequate for all others.
//!
//! Untouched events are there to be quoted, and have no say in what is named. But `adequate` means that nothing is missing
//! that the events could show, and one that the model does not follow shows something. It then changes places with a
//! gating one, and everything begins anew: what is quoted is then the error on others, and the reasons say so.

use super::{
    anew::Stop,
    case::Case,
    departures::departs,
    event_sets::{Changes, Exchange},
    evidence::is_adequate,
    options::EventSplit,
    outcome::Status,
    round::Round,
};
use crate::identification::{
    composed::{self, ComposedFit, Scatter, composition_deviations},
    intake::PreparedEvent,
};

/// A composition so many times as far from that of the others as theirs differ is none: it stands in for what is missing.
/// Chosen: it is 5.8 times at most at 117 untouched events of 40 generated sites with nothing hidden.
const FOREIGN: f64 = 8.0;

impl Case<'_> {
    /// That the structure of a round that ends with `adequate` follows the untouched events as well, without any companion.
    pub(super) fn none_contradicts(&self, round: &Round) -> Result<(), Stop> {
        let says_adequate = round.decision.status == Status::Adequate;
        if !says_adequate || self.options.split != EventSplit::Balanced {
            return Ok(());
        }
        // What is quoted: the judged events at their narrowest. A wide spread would take in what is missing.
        let fit = self.narrowed(&round.asked.baseline.all);
        let options = &self.composed;
        let scatter =
            composed::sufficient_scatter(&self.judged, &fit, options, self.watcher.cancel)
                .unwrap_or(options.scatter);
        let mut exchanges: Vec<Exchange> = Vec::new();
        for event in &self.untouched {
            let taken: Vec<&str> = exchanges.iter().map(|e| e.untouched.as_str()).collect();
            if let Some(what) = self.contradicts(event, &fit, &scatter)
                && let Some(instead) = self.instead_of(event, &taken)
            {
                exchanges.push(Exchange {
                    gating: event.id.clone(),
                    untouched: instead,
                    reason: format!(
                        "is not followed by the model that follows the others ({what})"
                    ),
                });
            }
        }
        self.anew_with(Changes {
            exchanges,
            ..Changes::default()
        })
    }

    /// What a fit leaves of an event that it does not follow, in words, a composition of the event's own taken out that
    /// differs as those of the others do; none where it follows it.
    fn contradicts(
        &self,
        event: &PreparedEvent,
        fit: &ComposedFit,
        scatter: &Scatter,
    ) -> Option<String> {
        let one = std::slice::from_ref(event);
        let squares = composed::squares(one, &fit.model, &fit.parameters, scatter);
        let deviations = composition_deviations(one, fit, scatter);
        let (Some(&[squares]), Some(&[deviation])) = (squares.as_deref(), deviations.as_deref())
        else {
            return Some("no response".to_owned());
        };
        let left = squares / event.rows().max(1) as f64;
        departs(event, fit, scatter)
            .or_else(|| {
                let is_followed = is_adequate(left, &self.options.claim);
                (!is_followed).then(|| format!("{left:.2} per sample are left"))
            })
            .or_else(|| {
                (deviation > FOREIGN).then(|| {
                    format!(
                        "it would take a composition {deviation:.0} times as far from theirs as theirs differ"
                    )
                })
            })
    }
}
