//! Events at the edge of a relay: other events leave open whether it operates there.
//!
//! What a relay does in a dip between one that operated it and one that did not, by depth or by how long it lasts, cannot be
//! foretold: such an event says nothing against a model that has the relay. It is told by the voltages alone, whatever the
//! response is.

use std::ops::RangeInclusive;

use super::{
    composed::{self, ComposedFit},
    hold_out::{by_kind, distance, neighbours},
    intake::PreparedEvent,
};
use crate::load_model::{
    effect::{Declaration, Role},
    effects,
};

/// Parts of an effect that are told from none and from the whole: thresholds are known to no more than that.
const PARTS: RangeInclusive<f64> = 0.1..=0.9;

/// Whether none of the lowest voltages of events lies clearly between `first` and `span` below it, where an effect acts
/// in part, pu.
pub fn shows_no_part(first: f64, span: f64, mut lowest: impl Iterator<Item = f64>) -> bool {
    !lowest.any(|voltage| PARTS.contains(&((first - voltage) / span)))
}

/// The amplitude of an effect that is largest against the smallest meaningful one, and that one.
#[must_use]
pub fn amplitude(declaration: &Declaration, fit: &ComposedFit) -> (f64, f64) {
    let sizes = declaration.parameters.iter().filter_map(|p| {
        let (Role::OneSidedAmplitude { meaningful } | Role::TwoSidedAmplitude { meaningful }) =
            p.role
        else {
            return None;
        };
        let index = fit
            .model
            .index(&format!("{}.{}", declaration.name, p.name))?;
        Some(((fit.parameters[index] - p.neutral).abs(), meaningful))
    });
    sizes
        .max_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)))
        .unwrap_or((0.0, 1.0))
}

/// The lowest terminal voltage of an event, pu.
#[must_use]
pub fn lowest_pu(event: &PreparedEvent) -> f64 {
    event.v0_pu * event.input.lowest_voltage()
}

/// Whether an event says anything of what acts at the dip of this number, counted from 1.
#[must_use]
pub fn has_dip(event: &PreparedEvent, number: f64) -> bool {
    number <= 1.0 || composed::dips(event) as f64 >= number
}

/// An effect of a fit that the voltage switches.
#[derive(Clone, Debug)]
pub struct Relay {
    effect: &'static str,
    /// The voltages between which it acts in part, from `first - span` to `first`, pu.
    band: RangeInclusive<f64>,
    /// How long the voltage has to be below the first, s; none where that is not all there is to it.
    pick_up_s: Option<f64>,
    /// The dip at which it acts, counted from 1.
    dip: f64,
}

impl Relay {
    /// Those of a fit that are there: of a size that is meaningful.
    #[must_use]
    pub fn of(fit: &ComposedFit) -> Vec<Self> {
        let mut names: Vec<&'static str> = Vec::new();
        for name in fit.model.parameters().iter().filter_map(|p| p.effect) {
            if !names.contains(&name) {
                names.push(name);
            }
        }
        let relays = names.into_iter().map(|name| Self::named(fit, name));
        relays.flatten().collect()
    }

    fn named(fit: &ComposedFit, name: &str) -> Option<Self> {
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
            pick_up_s: effect.pick_up().and_then(value),
            dip: effect.counts_dips().and_then(value).unwrap_or(1.0),
        })
    }

    /// Why the `known` events leave open whether it acts in `event`, as what follows that event's name; none where they
    /// do not.
    #[must_use]
    pub fn open_at(&self, event: &PreparedEvent, known: &[&PreparedEvent]) -> Option<String> {
        if !has_dip(event, self.dip) {
            return None;
        }
        let known: Vec<&PreparedEvent> = (known.iter().copied())
            .filter(|event| has_dip(event, self.dip))
            .collect();
        let depths: Vec<f64> = known.iter().map(|event| lowest_pu(event)).collect();
        let lowest = lowest_pu(event);
        if is_open(lowest, &self.band, &depths) {
            return Some(format!(
                "lies at {lowest:.3} pu, where the other events leave open whether {} acts",
                self.effect
            ));
        }
        let first = *self.band.end();
        let times: Vec<f64> = (known.iter())
            .map(|event| event.longest_below_s(first))
            .collect();
        let lasts_s = event.longest_below_s(first);
        self.pick_up_s
            .filter(|pick_up_s| is_open_time(lasts_s, *pick_up_s, &times))
            .map(|_| {
                format!(
                    "stays below {first:.3} pu for {lasts_s:.3} s, where the other events leave open whether {} acts",
                    self.effect
                )
            })
    }
}

/// The place among `others` of the event that may be kept from a fit instead of `event`: of those of its kind
/// ([`by_kind`]) that are no neighbours of it in depth, so that it is no more open what happens there, and that `may`, the
/// one whose own neighbours are nearest.
#[must_use]
pub fn in_place_of(
    event: &PreparedEvent,
    others: &[&PreparedEvent],
    may: impl Fn(usize) -> bool,
) -> Option<usize> {
    let all: Vec<&PreparedEvent> = others.iter().copied().chain([event]).collect();
    let own = others.len();
    let shares: Vec<(&str, f64)> = (all.iter())
        .map(|e| (e.id.as_str(), e.lowest_voltage))
        .collect();
    let depths: Vec<(&str, f64)> = all.iter().map(|e| (e.id.as_str(), lowest_pu(e))).collect();
    let of_kind = by_kind(&shares)
        .into_iter()
        .find(|kind| kind.contains(&own))?;
    let next = neighbours(&depths, own);
    let candidates = (of_kind.into_iter())
        .filter(|place| *place != own && !next.contains(&Some(*place)) && may(*place));
    candidates.min_by(|&a, &b| distance(&depths, a).total_cmp(&distance(&depths, b)))
}

/// Whether none of the `known` lowest voltages lies between `voltage` and a band, nor clearly within the band: then
/// they do not say what happens at `voltage`.
fn is_open(voltage: f64, band: &RangeInclusive<f64>, known: &[f64]) -> bool {
    let (last, first) = (*band.start(), *band.end());
    let between =
        |other: &f64| (first < *other && *other < voltage) || (voltage < *other && *other < last);
    shows_no_part(first, first - last, known.iter().copied()) && !known.iter().any(between)
}

/// The same of a time below the voltage of a relay, and how long it has to be: whether none of the `known` times lies
/// between. What does not come below the voltage is not open.
fn is_open_time(lasts_s: f64, pick_up_s: f64, known: &[f64]) -> bool {
    let [shorter, longer] = [lasts_s.min(pick_up_s), lasts_s.max(pick_up_s)];
    lasts_s > 0.0
        && !known
            .iter()
            .any(|other| shorter < *other && *other < longer)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::composed::tests::events;

    #[test]
    fn a_depth_is_open_where_no_known_one_lies_between_it_and_the_band() {
        let known = [0.48, 0.70, 0.81];
        let open = |voltage: f64, band: [f64; 2]| is_open(voltage, &(band[0]..=band[1]), &known);
        assert!(open(0.74, [0.74, 0.74]) && open(0.74, [0.76, 0.76]) && open(0.74, [0.72, 0.73]));
        assert!(!open(0.74, [0.83, 0.83]) && !open(0.74, [0.6, 0.65]) && !open(0.5, [0.74, 0.74]));
        // 0.70 shows a part, which tells what smaller parts there are.
        assert!(!open(0.74, [0.65, 0.76]));
    }

    #[test]
    fn a_time_is_open_where_no_known_one_lies_between_it_and_the_delay() {
        let known = [0.0, 0.035, 0.25];
        let open = |lasts_s: f64, pick_up_s: f64| is_open_time(lasts_s, pick_up_s, &known);
        assert!(open(0.023, 0.03) && open(0.03, 0.023) && open(0.08, 0.2));
        assert!(!open(0.023, 0.04) && !open(0.3, 0.2) && !open(0.0, 0.03));
    }

    /// An event that lies at this voltage for so long, and at 1 otherwise.
    fn dip(id: &str, voltage: f64, lasts_s: f64) -> PreparedEvent {
        let mut event = events().remove(0);
        event.id = id.to_owned();
        event.v0_pu = 1.0;
        let fine_s = event.input.sample_interval_s / event.input.points_per_sample as f64;
        let last = event.input.real.len();
        event.input.real.fill(1.0);
        event.input.imaginary.fill(0.0);
        let begins = last / 2;
        let ends_s = begins as f64 * fine_s + lasts_s;
        for (index, real) in event.input.real.iter_mut().enumerate().skip(begins) {
            if (index as f64 * fine_s) < ends_s - 0.5 * fine_s {
                *real = voltage;
            }
        }
        event.lowest_voltage = voltage;
        event
    }

    #[test]
    fn an_event_is_open_by_its_depth_or_by_how_long_it_lasts() {
        let relay = Relay {
            effect: "self_disconnection",
            band: 0.8..=0.8,
            pick_up_s: Some(0.06),
            dip: 1.0,
        };
        let known = [("a", 0.7, 0.1), ("b", 0.95, 0.1)].map(|(id, v, s)| dip(id, v, s));
        let known: Vec<&PreparedEvent> = known.iter().collect();
        let open = |voltage: f64, lasts_s: f64| relay.open_at(&dip("c", voltage, lasts_s), &known);
        assert!(open(0.75, 0.2).unwrap().contains("lies at 0.750 pu"));
        assert!(open(0.85, 0.2).unwrap().contains("lies at 0.850 pu"));
        assert_eq!(open(0.65, 0.2), None);
        let told = open(0.65, 0.04).unwrap();
        assert!(told.contains("below 0.800 pu for 0.040 s"), "{told}");
        assert_eq!(open(0.97, 0.04), None);
        // Of a relay that acts at the second dip an event with one says nothing.
        let second = Relay { dip: 2.0, ..relay };
        assert_eq!(second.open_at(&dip("c", 0.75, 0.2), &known), None);
    }

    #[test]
    fn another_event_takes_the_place_that_is_no_neighbour_and_stands_least_alone() {
        let known = [0.5, 0.6, 0.7, 0.82, 0.84, 0.9].map(|v| dip("a", v, 0.1));
        let known: Vec<&PreparedEvent> = known.iter().collect();
        let event = dip("c", 0.65, 0.1);
        // 0.6 and 0.7 are neighbours; 0.84 leaves the narrowest gap, 0.9, with one neighbour, the next.
        assert_eq!(in_place_of(&event, &known, |_| true), Some(4));
        assert_eq!(in_place_of(&event, &known, |place| place != 4), Some(5));
        assert_eq!(in_place_of(&event, &known, |place| place == 1), None);
    }

    #[test]
    fn a_dip_shows_a_part_clearly_within_the_band_only() {
        let shows_none = |lowest: &[f64]| shows_no_part(0.75, 0.05, lowest.iter().copied());
        assert!(shows_none(&[0.9, 0.749, 0.702, 0.68]));
        assert!(!shows_none(&[0.9, 0.72]));
        assert!(shows_none(&[]));
    }
}
