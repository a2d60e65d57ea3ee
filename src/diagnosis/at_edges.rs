//! Untouched events at the edge of a relay: the others leave open whether it operates there.
//!
//! What a relay does to an event between a dip that operated it and one that did not, by depth or by how long it lasts,
//! cannot be foretold, and such an event says nothing against a model that has the relay. By its voltages alone, whatever its
//! response is, such an event changes places with a gating one: there a voltage or a delay that the fitted events leave open
//! is that of all judged ones (`foretelling`).

use super::{
    anew::Stop,
    case::Case,
    event_sets::{Changes, Exchange},
    options::EventSplit,
};
use crate::identification::{
    composed::Baseline,
    intake::PreparedEvent,
    relay_edges::{Relay, in_place_of},
};

impl Case<'_> {
    /// That no untouched event lies at the edge of a relay of a structure.
    pub(super) fn none_at_edges(&self, of: &Baseline) -> Result<(), Stop> {
        let exchanges = self.at_edges(of);
        self.anew_with(Changes {
            exchanges,
            ..Changes::default()
        })
    }

    /// The untouched events at the edge of a relay of a structure, each with the gating event that takes its place; none
    /// where no gating event can, and where the user said what is untouched.
    fn at_edges(&self, of: &Baseline) -> Vec<Exchange> {
        if self.options.split != EventSplit::Balanced {
            return Vec::new();
        }
        let relays = Relay::of(&of.all);
        let judged: Vec<&PreparedEvent> = self.judged.iter().collect();
        let mut exchanges: Vec<Exchange> = Vec::new();
        for event in &self.untouched {
            let open = relays
                .iter()
                .find_map(|relay| relay.open_at(event, &judged));
            let taken: Vec<&str> = exchanges.iter().map(|e| e.untouched.as_str()).collect();
            if let Some(reason) = open
                && let Some(instead) = self.instead_of(event, &taken)
            {
                exchanges.push(Exchange {
                    gating: event.id.clone(),
                    untouched: instead,
                    reason,
                });
            }
        }
        exchanges
    }

    /// The gating event that may stay untouched in place of another ([`in_place_of`]); none that was itself exchanged, nor one
    /// of those `taken`.
    pub(super) fn instead_of(&self, event: &PreparedEvent, taken: &[&str]) -> Option<String> {
        let judged: Vec<&PreparedEvent> = self.judged.iter().collect();
        let may = |place: usize| {
            let id = judged[place].id.as_str();
            let exchanged = self.changes.exchanges.iter().any(|e| e.gating == id);
            self.gates[place] && !taken.contains(&id) && !exchanged
        };
        let place = in_place_of(event, &judged, may)?;
        Some(judged[place].id.clone())
    }
}
