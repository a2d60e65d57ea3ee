//! Held-out events at the edge of a relay change places with fitted ones.
//!
//! What is held out is chosen before anything is known of relays. Where the fit has one and the fitted events leave open whether
//! it operates in a held-out event ([`relay_edges`](super::relay_edges)), that event is fitted, and another held out
//! in its place. By the voltages alone, whatever the response is.

use super::{
    intake::PreparedEvent,
    relay_edges::{Relay, in_place_of},
    site_fit::FittedSite,
};

/// Events to fit and to hold out.
pub(super) type Sets = (Vec<PreparedEvent>, Vec<PreparedEvent>);

/// Which events change places.
pub(super) struct Exchanges {
    /// An event that is fitted, and the one that is held out in its place.
    pub(super) moves: Vec<[String; 2]>,
    /// The same in words.
    pub(super) told: Vec<String>,
}

fn relays(site: &FittedSite) -> Vec<Relay> {
    site.composed.as_ref().map(Relay::of).unwrap_or_default()
}

/// The held-out events at the edges of the fit's relays, and why.
pub(super) fn at_edges(site: &FittedSite) -> Vec<(&PreparedEvent, String)> {
    let relays = relays(site);
    let known: Vec<&PreparedEvent> = site.measured.iter().collect();
    let open = |event| relays.iter().find_map(|relay| relay.open_at(event, &known));
    (site.held.iter())
        .filter_map(|event| Some((event, open(event)?)))
        .collect()
}

/// For each held-out event at an edge a fitted one that is not the deepest and that the others do not leave open; none where
/// there is none, or no other can be held out.
pub(super) fn exchanges(site: &FittedSite) -> Option<Exchanges> {
    let relays = relays(site);
    let fitted: Vec<&PreparedEvent> = site.measured.iter().collect();
    let depths = fitted.iter().map(|event| event.lowest_voltage);
    let deepest = depths.fold(f64::INFINITY, f64::min);
    let mut done = Exchanges {
        moves: Vec::new(),
        told: Vec::new(),
    };
    for (event, why) in at_edges(site) {
        let may = |place: usize| {
            let candidate = fitted[place];
            let is_taken = done.moves.iter().any(|[_, held]| *held == candidate.id);
            let rest: Vec<&PreparedEvent> = (fitted.iter().copied())
                .filter(|other| other.id != candidate.id)
                .chain([event])
                .collect();
            let is_open = || relays.iter().any(|r| r.open_at(candidate, &rest).is_some());
            candidate.lowest_voltage > deepest && !is_taken && !is_open()
        };
        if let Some(place) = in_place_of(event, &fitted, may) {
            let [fitted, held] = [event.id.clone(), fitted[place].id.clone()];
            done.told.push(format!(
                "{fitted} {why}: it is fitted, and {held} is held out in its place"
            ));
            done.moves.push([fitted, held]);
        }
    }
    (!done.moves.is_empty()).then_some(done)
}

/// The sets after exchanges, each in the order of the identifiers.
pub(super) fn exchanged((fitted, held): Sets, moves: &[[String; 2]]) -> Sets {
    let moved = |event: &PreparedEvent, to: usize| moves.iter().any(|pair| pair[to] == event.id);
    let (stays, goes): (Vec<_>, Vec<_>) = fitted.into_iter().partition(|e| !moved(e, 1));
    let (comes, rests): (Vec<_>, Vec<_>) = held.into_iter().partition(|e| moved(e, 0));
    let sorted = |one: Vec<PreparedEvent>, other: Vec<PreparedEvent>| {
        let mut all = [one, other].concat();
        all.sort_by(|a, b| a.id.cmp(&b.id));
        all
    };
    (sorted(stays, comes), sorted(rests, goes))
}

#[cfg(test)]
mod tests {
    use super::exchanged;
    use crate::identification::composed::tests::events;

    #[test]
    fn sets_keep_all_events_and_their_order() {
        let named = |names: &[&str]| {
            let events = names.iter().zip(events().into_iter().cycle());
            let named = events.map(|(name, mut event)| {
                event.id = (*name).to_owned();
                event
            });
            named.collect::<Vec<_>>()
        };
        let move_of = |fitted: &str, held: &str| [fitted.to_owned(), held.to_owned()];
        let sets = (named(&["a", "c", "e", "f"]), named(&["b", "d"]));
        let (fitted, held) = exchanged(sets, &[move_of("b", "e")]);
        let ids = |events: &[crate::identification::intake::PreparedEvent]| {
            events.iter().map(|e| e.id.clone()).collect::<Vec<_>>()
        };
        assert_eq!(ids(&fitted), ["a", "b", "c", "f"]);
        assert_eq!(ids(&held), ["d", "e"]);
    }
}
