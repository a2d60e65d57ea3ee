//! Which events are fitted, which decide, and which stay untouched.

use super::options::EventSplit;
use crate::identification::hold_out::{by_kind, distance, inner_events};

/// From this many events on, some stay untouched.
const UNTOUCHED_FROM: usize = 8;
/// Share of the events that stay untouched from there on.
const UNTOUCHED_SHARE: f64 = 0.2;
/// Share of the events that decide.
const GATE_SHARE: f64 = 0.27;

/// What an event is used for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    Fit,
    Gate,
    Untouched,
}

/// An event that was untouched and gates, and a gating one that is untouched in its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Exchange {
    pub(super) gating: String,
    pub(super) untouched: String,
    /// Why, as what follows the first one's name.
    pub(super) reason: String,
}

impl Exchange {
    /// In words.
    fn told(&self) -> String {
        let Self {
            gating,
            untouched,
            reason,
        } = self;
        format!("{gating} {reason}: it decides, and {untouched} stays untouched in its place")
    }
}

/// An event that is used for nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Apart {
    pub(super) event: String,
    /// Why.
    pub(super) reason: String,
}

/// A gating event that is fitted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct LetBeFitted {
    pub(super) event: String,
    /// Why.
    pub(super) reason: String,
}

/// How the sets are changed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Changes {
    pub(super) exchanges: Vec<Exchange>,
    pub(super) apart: Vec<Apart>,
    pub(super) let_be_fitted: Vec<LetBeFitted>,
}

impl Changes {
    /// Adds others.
    pub(super) fn extend(&mut self, others: Self) {
        self.exchanges.extend(others.exchanges);
        self.apart.extend(others.apart);
        self.let_be_fitted.extend(others.let_be_fitted);
    }

    /// Whether a gating event is fitted.
    pub(super) fn lets_be_fitted(&self, event: &str) -> bool {
        self.let_be_fitted.iter().any(|own| own.event == event)
    }

    /// How an event is set apart, where it is.
    pub(super) fn apart_of(&self, event: &str) -> Option<&Apart> {
        self.apart.iter().find(|apart| apart.event == event)
    }

    /// Each in words.
    pub(super) fn told(&self) -> impl Iterator<Item = String> {
        let apart = self.apart.iter();
        let apart = apart.map(|Apart { event, reason }| format!("{event} is set apart: {reason}"));
        let fitted = self.let_be_fitted.iter();
        let fitted =
            fitted.map(|LetBeFitted { event, reason }| format!("{event} is fitted: {reason}"));
        let exchanged = self.exchanges.iter().map(Exchange::told);
        exchanged.chain(apart).chain(fitted)
    }
}

/// Uses after exchanges, in their order.
pub(super) fn exchange(uses: &mut [Use], events: &[(&str, f64)], exchanges: &[Exchange]) {
    let mut now = |name: &str, its_use: Use| {
        if let Some(event) = events.iter().position(|(own, _)| *own == name) {
            uses[event] = its_use;
        }
    };
    for Exchange {
        gating, untouched, ..
    } in exchanges
    {
        now(gating, Use::Gate);
        now(untouched, Use::Untouched);
    }
}

/// The use of each event. `events` are `(name, lowest voltage)`.
///
/// By default both held-out sets are spread over the depths, dips and others apart, as [`by_kind`] and
/// [`inner_events`] say.
pub(super) fn uses(events: &[(&str, f64)], split: &EventSplit) -> Vec<Use> {
    match split {
        EventSplit::Named { gate, untouched } => {
            let among = |names: &[String], name: &str| names.iter().any(|n| n == name);
            let of = |name: &str| {
                if among(untouched, name) {
                    Use::Untouched
                } else if among(gate, name) {
                    Use::Gate
                } else {
                    Use::Fit
                }
            };
            events.iter().map(|(name, _)| of(name)).collect()
        }
        EventSplit::Balanced => balanced(events),
    }
}

/// Lets every second gating event that shows what is missing be fitted, the one that shows most first, where no
/// fitted one shows it: what was never seen can neither be learnt nor foretold. `misfits` are those of the
/// structure at the start, per row; above `adequate` something is missing.
pub(super) fn let_be_fitted_what_shows(gates: &mut [bool], misfits: &[f64], adequate: f64) {
    let showing = |gating: bool| {
        let all = gates.iter().zip(misfits).enumerate();
        let of = all.filter(move |(_, (gates, misfit))| **gates == gating && **misfit > adequate);
        of.map(|(event, _)| event).collect::<Vec<_>>()
    };
    if !showing(false).is_empty() {
        return;
    }
    let mut in_gate = showing(true);
    if in_gate.len() < 2 {
        return;
    }
    in_gate.sort_by(|&a, &b| misfits[b].total_cmp(&misfits[a]));
    for event in in_gate.into_iter().step_by(2) {
        gates[event] = false;
    }
}

/// A structure does not foretell an event that it leaves more than this many times as far, fitted without it, as
/// it leaves that event and all others, fitted to it.
const FAR_FROM_FORETOLD: f64 = 25.0;

/// The gating events of which a structure leaves far more where it was fitted without them (`foretold`, per row; none
/// of other events) than where it was fitted to all (`fitted`): it can follow them, but what the others say leaves
/// open how. Near stall a hundredth of the motor's torque decides whether it recovers, and such an event would outweigh all
/// others of the gate with and without whatever is added. As long as other gating events are left.
pub(super) fn not_foretold(foretold: &[Option<f64>], fitted: &[f64]) -> Vec<bool> {
    let mean = fitted.iter().sum::<f64>() / fitted.len().max(1) as f64;
    let both = || foretold.iter().zip(fitted);
    let is_far = |left: f64, fitted: f64| left > FAR_FROM_FORETOLD * mean.max(fitted);
    let others = both().any(|(left, fitted)| left.is_some_and(|left| !is_far(left, *fitted)));
    both()
        .map(|(left, fitted)| others && left.is_some_and(|left| is_far(left, *fitted)))
        .collect()
}

/// Which events are foretold together when each is once: those that gate, and the others in two halves, every second one
/// by depth. The deepest and the mildest are never foretold: nothing surrounds them.
pub(super) fn in_turn(gates: &[bool], lowest_voltages: &[f64]) -> [Vec<bool>; 3] {
    let mut order: Vec<usize> = (0..gates.len()).collect();
    order.sort_by(|&a, &b| lowest_voltages[a].total_cmp(&lowest_voltages[b]));
    let inner = order.get(1..order.len().saturating_sub(1)).unwrap_or(&[]);
    let mut folds = [
        gates.to_vec(),
        vec![false; gates.len()],
        vec![false; gates.len()],
    ];
    let fitted = inner.iter().filter(|&&event| !gates[event]);
    for (number, &event) in fitted.enumerate() {
        folds[1 + number % 2][event] = true;
    }
    folds
}

fn balanced(events: &[(&str, f64)]) -> Vec<Use> {
    let mut uses = vec![Use::Fit; events.len()];
    for kind in by_kind(events) {
        let of: Vec<(&str, f64)> = kind.iter().map(|&event| events[event]).collect();
        let with_untouched = events.len() >= UNTOUCHED_FROM;
        for (event, its_use) in kind
            .into_iter()
            .zip(spread_over_depths(&of, with_untouched))
        {
            uses[event] = its_use;
        }
    }
    uses
}

fn spread_over_depths(events: &[(&str, f64)], with_untouched: bool) -> Vec<Use> {
    let count = events.len();
    let mut uses = vec![Use::Fit; count];
    if count < 2 {
        return uses;
    }
    let untouched = if with_untouched {
        rounded(count as f64 * UNTOUCHED_SHARE)
    } else {
        0
    };
    let gate = rounded(count as f64 * GATE_SHARE).clamp(1, count - 1 - untouched);
    let held = gate + untouched;
    let chosen = inner_events(events, held);
    for &event in &chosen {
        uses[event] = Use::Gate;
    }
    // The gate is fitted in the end: it keeps what stands alone, and those with near neighbours stay
    // untouched, one of each equal part of the depths.
    for part in 0..untouched {
        let of = &chosen[part * held / untouched..(part + 1) * held / untouched];
        let nearest = of
            .iter()
            .min_by(|&&a, &&b| distance(events, a).total_cmp(&distance(events, b)));
        if let Some(&event) = nearest {
            uses[event] = Use::Untouched;
        }
    }
    uses
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a number of events"
)]
fn rounded(value: f64) -> usize {
    value.round() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(count: usize) -> [usize; 3] {
        let names: Vec<String> = (0..count).map(|i| format!("event_{i:02}")).collect();
        let depth = |i: usize| 0.4 + 0.5 * i as f64 / count as f64;
        let events: Vec<(&str, f64)> = names
            .iter()
            .enumerate()
            .map(|(i, n)| (n.as_str(), depth(i)))
            .collect();
        let uses = uses(&events, &EventSplit::Balanced);
        assert_eq!(uses[0], Use::Fit, "the deepest of {count} is fitted");
        [Use::Fit, Use::Gate, Use::Untouched].map(|u| uses.iter().filter(|x| **x == u).count())
    }

    #[test]
    fn every_number_of_events_has_its_sets() {
        assert_eq!(counted(1), [1, 0, 0]);
        assert_eq!(counted(2), [1, 1, 0]);
        assert_eq!(counted(4), [3, 1, 0]);
        assert_eq!(counted(7), [5, 2, 0]);
        assert_eq!(counted(8), [4, 2, 2]);
        assert_eq!(counted(11), [6, 3, 2]);
        assert_eq!(counted(50), [26, 14, 10]);
    }

    #[test]
    fn what_only_gating_events_show_is_learnt_from_some_of_them() {
        let settled = |mut gates: Vec<bool>, misfits: &[f64]| {
            let_be_fitted_what_shows(&mut gates, misfits, 1.4);
            gates
        };
        let gates = vec![false, true, false, true, true];
        assert_eq!(
            settled(gates.clone(), &[0.7, 3.0, 0.8, 5.0, 4.0]),
            [false, false, false, false, true]
        );
        // A fitted one shows it as well, or one gating event alone, or none.
        for misfits in [
            [1.5, 3.0, 0.8, 5.0, 4.0],
            [0.7, 0.7, 0.8, 5.0, 0.6],
            [0.7; 5],
        ] {
            assert_eq!(settled(gates.clone(), &misfits), gates);
        }
    }

    #[test]
    fn what_a_structure_follows_but_does_not_foretell_is_fitted() {
        let foretold = [None, Some(29_000.0), Some(3.0)];
        let found = not_foretold(&foretold, &[2.0, 4.0, 2.5]);
        assert_eq!(found, [false, true, false]);
        // Something is missing in it, or others are far too, or nothing else would gate.
        let alone = [None, Some(29_000.0), None];
        for (foretold, fitted) in [
            (foretold, [2.0, 5_000.0, 2.5]),
            (foretold, [4_000.0, 4.0, 2.5]),
            (alone, [2.0, 4.0, 2.5]),
        ] {
            assert_eq!(not_foretold(&foretold, &fitted), [false; 3]);
        }
    }

    #[test]
    fn every_event_between_others_is_foretold_once() {
        let depths = [0.9, 0.5, 0.7, 0.95, 0.8, 0.6];
        let gates = [false, false, true, false, false, false];
        let folds = in_turn(&gates, &depths);
        // By depth: 1 (deepest), 5, 2 (gates), 4, 0, 3 (mildest).
        assert_eq!(folds[0], gates);
        let of = |fold: &[bool]| (0..6).filter(|&event| fold[event]).collect::<Vec<_>>();
        assert_eq!([of(&folds[1]), of(&folds[2])], [vec![0, 5], vec![4]]);
        assert_eq!(in_turn(&[true], &[0.5])[1], [false]);
        assert!(in_turn(&[], &[])[0].is_empty());
    }

    #[test]
    fn exchanged_events_have_each_others_use() {
        let events = [("a", 0.5), ("b", 0.6), ("c", 0.7), ("d", 0.6)];
        let mut uses = [Use::Fit, Use::Gate, Use::Untouched, Use::Fit];
        let one = Exchange {
            gating: "c".to_owned(),
            untouched: "b".to_owned(),
            reason: String::new(),
        };
        exchange(&mut uses, &events, &[one]);
        assert_eq!(uses, [Use::Fit, Use::Untouched, Use::Gate, Use::Fit]);
    }

    #[test]
    fn named_events_keep_their_use() {
        let events = [("a", 0.5), ("b", 0.6), ("c", 0.7)];
        let split = EventSplit::Named {
            gate: vec!["a".to_owned()],
            untouched: vec!["c".to_owned()],
        };
        assert_eq!(uses(&events, &split), [Use::Gate, Use::Fit, Use::Untouched]);
    }
}
