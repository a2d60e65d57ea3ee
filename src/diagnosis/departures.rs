//! Events that a model which is adequate over all samples does not follow for a while.

use super::{case::Case, where_it_fails::departure};
use crate::identification::{
    composed::{ComposedFit, Scatter, with_own_composition},
    intake::PreparedEvent,
};

/// So many events, ...
const EVENTS_MIN: usize = 2;
/// ... at least this share of them: one alone is an accident of its own.
const SHARE_MIN: f64 = 0.15;

/// What is left of each such event in words, with its name; nothing where they are too few.
///
/// Most of a window is quiet: what acts for half a second in some of the events hardly shows in a misfit per
/// sample. The composition that an event has for itself is taken out first.
pub(super) fn departures(case: &Case<'_>, fit: &ComposedFit) -> Vec<String> {
    let scatter = &case.composed.scatter;
    let of =
        |event: &PreparedEvent| Some(format!("{}: {}", event.id, departs(event, fit, scatter)?));
    let found: Vec<String> = case.judged.iter().filter_map(of).collect();
    let many =
        found.len() >= EVENTS_MIN && found.len() as f64 >= SHARE_MIN * case.judged.len() as f64;
    if many { found } else { Vec::new() }
}

/// Where an event departs from a model for a while, in words, its own composition taken out first; none where it does not.
pub(super) fn departs(
    event: &PreparedEvent,
    fit: &ComposedFit,
    scatter: &Scatter,
) -> Option<String> {
    let curves = with_own_composition(event, fit, scatter)?;
    departure(event, &curves)
}
