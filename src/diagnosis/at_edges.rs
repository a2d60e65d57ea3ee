//! Untouched events at the edge of a relay: the others leave open whether it operates there.
//!
//! What a relay does to an event between a dip that operated it and one that did not cannot be foretold, and such an event
//! says nothing against a model that has the relay. By its depth alone, whatever its response is, such an event changes
//! places with a gating one: there a voltage that the fitted events leave open is that of all judged ones
//! (`foretelling`).

use std::ops::RangeInclusive;

use super::{
    anew::Stop,
    case::Case,
    claim::shows_no_part,
    event_sets::{Changes, Exchange, distance, neighbours},
    options::EventSplit,
    trials::amplitude,
};
use crate::{
    identification::{
        composed::{self, Baseline, ComposedFit},
        hold_out::by_kind,
        intake::PreparedEvent,
    },
    load_model::effects,
};

/// An effect that the voltage switches, and the voltages between which it acts in part.
struct Relay {
    effect: &'static str,
    /// From `first - span` to `first`, pu.
    band: RangeInclusive<f64>,
    /// The dip at which it acts, counted from 1.
    dip: f64,
}

impl Relay {
    /// Of an effect of a fit; none where it has no such voltage or is not there.
    fn of(fit: &ComposedFit, name: &str) -> Option<Self> {
        let effect = effects::find(name)?;
        let declared = effect.declaration();
        let value = |own: &str| {
            let index = fit.model.index(&format!("{}.{own}", declared.name))?;
            Some(fit.parameters[index])
        };
        let first = value(effect.threshold()?)?;
        let span = effect.span().and_then(value).unwrap_or(0.0);
        let (size, meaningful) = amplitude(declared, fit);
        (size >= meaningful).then(|| Self {
            effect: declared.name,
            band: first - span..=first,
            dip: effect.counts_dips().and_then(value).unwrap_or(1.0),
        })
    }

    /// Whether an event says anything of its voltage.
    fn is_told_by(&self, event: &PreparedEvent) -> bool {
        self.dip <= 1.0 || composed::dips(event) as f64 >= self.dip
    }
}

fn lowest_pu(event: &PreparedEvent) -> f64 {
    event.v0_pu * event.input.lowest_voltage()
}

/// Whether none of the `known` lowest voltages lies between `voltage` and a band, nor clearly within the band: then
/// they do not say what happens at `voltage`.
fn is_open(voltage: f64, band: &RangeInclusive<f64>, known: &[f64]) -> bool {
    let (last, first) = (*band.start(), *band.end());
    let between =
        |other: &f64| (first < *other && *other < voltage) || (voltage < *other && *other < last);
    shows_no_part(first, first - last, known.iter().copied()) && !known.iter().any(between)
}

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
        let names = of.structure.names();
        let relays: Vec<Relay> = (names.iter())
            .filter_map(|name| Relay::of(&of.all, name))
            .collect();
        let mut exchanges: Vec<Exchange> = Vec::new();
        for event in &self.untouched {
            let at_edge = relays.iter().find(|relay| self.is_at_edge(event, relay));
            let taken: Vec<&str> = exchanges.iter().map(|e| e.untouched.as_str()).collect();
            if let Some(relay) = at_edge
                && let Some(instead) = self.instead_of(event, &taken)
            {
                exchanges.push(Exchange {
                    gating: event.id.clone(),
                    untouched: instead,
                    reason: format!(
                        "lies at {:.3} pu, where the other events leave open whether {} acts",
                        lowest_pu(event),
                        relay.effect
                    ),
                });
            }
        }
        exchanges
    }

    fn is_at_edge(&self, event: &PreparedEvent, relay: &Relay) -> bool {
        let known = self.judged.iter().filter(|e| relay.is_told_by(e));
        let known: Vec<f64> = known.map(lowest_pu).collect();
        relay.is_told_by(event) && is_open(lowest_pu(event), &relay.band, &known)
    }

    /// The gating event that may stay untouched in place of another: of those of its kind ([`by_kind`]) that are no
    /// neighbours of it in depth, so that it is no more open what happens there, the one whose own neighbours are nearest.
    /// None that was itself exchanged, nor one of those `taken`.
    pub(super) fn instead_of(&self, event: &PreparedEvent, taken: &[&str]) -> Option<String> {
        let all: Vec<&PreparedEvent> = self.judged.iter().chain([event]).collect();
        let own = all.len() - 1;
        let shares: Vec<(&str, f64)> = (all.iter())
            .map(|e| (e.id.as_str(), e.lowest_voltage))
            .collect();
        let depths: Vec<(&str, f64)> = all.iter().map(|e| (e.id.as_str(), lowest_pu(e))).collect();
        let kinds = by_kind(&shares);
        let of_kind = kinds.into_iter().find(|kind| kind.contains(&own))?;
        let next = neighbours(&depths, own);
        let may = |place: &usize| {
            let id = depths[*place].0;
            let exchanged = self.changes.exchanges.iter().any(|e| e.gating == id);
            let gates = self.gates.get(*place).is_some_and(|gates| *gates);
            gates && !next.contains(&Some(*place)) && !taken.contains(&id) && !exchanged
        };
        let candidates = of_kind.into_iter().filter(may);
        let nearest =
            candidates.min_by(|&a, &b| distance(&depths, a).total_cmp(&distance(&depths, b)));
        nearest.map(|place| depths[place].0.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_depth_is_open_where_no_known_one_lies_between_it_and_the_band() {
        let known = [0.48, 0.70, 0.81];
        let open = |voltage: f64, band: [f64; 2]| is_open(voltage, &(band[0]..=band[1]), &known);
        assert!(open(0.74, [0.74, 0.74]) && open(0.74, [0.76, 0.76]) && open(0.74, [0.72, 0.73]));
        assert!(!open(0.74, [0.83, 0.83]) && !open(0.74, [0.6, 0.65]) && !open(0.5, [0.74, 0.74]));
        // 0.70 shows a part, which tells what smaller parts there are.
        assert!(!open(0.74, [0.65, 0.76]));
    }
}
