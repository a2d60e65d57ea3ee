//! A fit that begins where the mild events have everything that shows in them. What a threshold keeps out of them is
//! looked for with the rest held, in one more event at a time, the mildest first: a relay that operates some ten
//! milliseconds late leaves more than all else together, in every event its own, and a fit to all of them has many
//! optima where one to a single event has few.

use super::{
    base::Base,
    baseline::{GOOD_FIT, values_of},
    candidates::promises,
    fit::{ComposedFit, ComposedFitOptions, fit_rows, unfitted},
    refine::refine,
    rows::EventRows,
    screening::{Candidate, Memory, Screening, Step},
};
use crate::{
    identification::intake::PreparedEvent,
    load_model::{
        Structure,
        composed::{Accuracy, ComposedModel},
        effect::{Effect, Parameter},
    },
};

/// Candidates of a relay from which it is fitted to the first event that shows it.
const STARTS: usize = 4;
/// An event that leaves more than this per row, the relay absent, shows it.
const SHOWS: f64 = 4.0;
/// Where between the lowest voltages of two events a threshold is tried.
const BETWEEN: [f64; 3] = [1.0 / 6.0, 0.5, 5.0 / 6.0];

/// `all`, of `structure` and to all `events`, begun anew at `mild`, a fit of the same structure or a smaller one to the
/// mild events. `None` when that cannot be simulated.
pub(super) fn from_mild(
    events: &[PreparedEvent],
    (structure, all): (&Structure, &ComposedFit),
    mild: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<ComposedFit> {
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    let begun = |at: &[f64]| unfitted(&rows, &all.model, at, &all.free, options, cancel);
    // What acts below a threshold as all events together had it.
    let at = values_of(mild, &all.model, &all.parameters);
    let mut starts = vec![begun(&at)];
    if mild.chi_square_per_row() < GOOD_FIT {
        let mut ordered: Vec<&PreparedEvent> = events.iter().collect();
        ordered.sort_by(|a, b| {
            let deeper = b.lowest_voltage.total_cmp(&a.lowest_voltage);
            deeper.then_with(|| a.id.cmp(&b.id))
        });
        let of = |event| EventRows::with_accuracy(event, Accuracy::Rough);
        let rows: Vec<EventRows<'_>> = ordered.iter().copied().map(of).collect();
        let lowest = ordered.iter().map(|e| e.lowest_voltage * e.v0_pu);
        let held = Held {
            rows: &rows,
            lowest_pu: &lowest.collect::<Vec<f64>>(),
            structure,
            all,
            options,
            cancel,
        };
        starts.push(begun(&held.with_relays(at)));
    }
    let chi_square = ComposedFit::chi_square_per_row;
    let nearest = starts.into_iter().flatten();
    let nearest = nearest.min_by(|a, b| chi_square(a).total_cmp(&chi_square(b)))?;
    let newest = structure.names().pop()?;
    Some(refine(events, nearest, &newest, options, cancel))
}

/// What does not change from relay to relay.
struct Held<'a> {
    /// Of all events, the mildest first.
    rows: &'a [EventRows<'a>],
    /// Their lowest voltages.
    lowest_pu: &'a [f64],
    structure: &'a Structure,
    all: &'a ComposedFit,
    options: &'a ComposedFitOptions,
    cancel: &'a (dyn Fn() -> bool + Sync),
}

impl Held<'_> {
    /// The values `at`, those of every relay as the events want them beside the others. The mildest event that is not
    /// followed says which is next, whatever their order in the structure.
    fn with_relays(&self, mut at: Vec<f64>) -> Vec<f64> {
        let relays = self.structure.effects().filter(|e| e.threshold().is_some());
        let mut left: Vec<&'static dyn Effect> = relays.collect();
        while let Some((place, values)) = self.next_relay(&at, &left) {
            left.remove(place);
            at = values;
        }
        at
    }

    /// Which of the relays `left`, none of them in the model yet, comes next, and the values `at` with it. `None` where
    /// every event is followed, none of the relays helps or none is left.
    fn next_relay(&self, at: &[f64], left: &[&'static dyn Effect]) -> Option<(usize, Vec<f64>)> {
        let mut fewer = self.structure.clone();
        for relay in left {
            fewer = fewer.without(relay.declaration().name).ok()?;
        }
        let model = ComposedModel::new(&fewer);
        let whole = ComposedFit {
            parameters: at.to_vec(),
            ..self.all.clone()
        };
        let others = values_of(&whole, &model, &model.typical());
        // Nothing is free: nothing follows.
        let held = unfitted(self.rows, &model, &others, &[], self.options, self.cancel)?;
        let first = (0..self.rows.len()).find(|event| self.shows(&held, *event))?;
        let lowest = self.lowest_pu[first];
        let above = if first == 0 {
            1.0
        } else {
            self.lowest_pu[first - 1]
        };
        let voltages = BETWEEN.map(|share| lowest + share * (above - lowest));
        let seen = left.iter().enumerate().filter_map(|(place, relay)| {
            let with = fewer.with(relay.declaration().name).ok()?;
            let model = ComposedModel::new(&with);
            let step = self.step(&held, &model, *relay, first);
            Some((place, step.first_seen(voltages)?))
        });
        let (place, fit) = seen.min_by(|a, b| a.1.objective.total_cmp(&b.1.objective))?;
        let found = self.through_deeper(&held, left[place], fit, left.len() > 1)?;
        Some((place, values_of(&found, &self.all.model, at)))
    }

    /// `fit`, of a relay to the mildest events, fitted to one deeper event more at a time; where `others` may act there,
    /// only as far as it follows.
    fn through_deeper(
        &self,
        held: &ComposedFit,
        relay: &'static dyn Effect,
        fit: ComposedFit,
        others: bool,
    ) -> Option<ComposedFit> {
        let mut found = fit;
        for last in found.squares.len()..self.rows.len() {
            let step = self.step(held, &found.model, relay, last);
            let deeper = step.alone(&found.parameters)?;
            if others && self.shows(&deeper, last) {
                break;
            }
            found = deeper;
        }
        Some(found)
    }

    /// `relay` added to the fit `held`, in the events up to `last`.
    fn step<'s>(
        &'s self,
        held: &'s ComposedFit,
        model: &'s ComposedModel,
        relay: &'static dyn Effect,
        last: usize,
    ) -> Step<'s> {
        Step {
            rows: &self.rows[..=last],
            model,
            effect: relay,
            origin: held,
            options: self.options,
            cancel: self.cancel,
        }
    }

    /// Whether `event`, as `fit` leaves it, shows that something is missing.
    fn shows(&self, fit: &ComposedFit, event: usize) -> bool {
        fit.squares[event] > SHOWS * self.rows[event].count() as f64
    }
}

impl Step<'_> {
    /// The effect fitted alone from the best of its candidates. `None` where none can be simulated or promises anything.
    fn first_seen(&self, voltages_pu: [f64; BETWEEN.len()]) -> Option<ComposedFit> {
        let base = Base::new(self.rows, self.origin, &self.options.scatter)?;
        let memory = Memory::new(self);
        let screening = Screening::new(self, &base, &memory);
        let threshold = self.threshold()?;
        let declared = self.model.parameters()[threshold].declaration;
        let voltages = voltages_pu.map(|v| v.clamp(declared.lower, declared.upper));
        let shapes = self.own(Parameter::is_shape);
        let place = shapes.iter().position(|i| *i == threshold)?;
        let mut begun: Vec<Candidate> = Vec::new();
        for candidate in screening.screen(&voltages).into_iter().filter(promises) {
            let beside = |c: &Candidate| without(&c.score.shapes, place);
            let new = |known: &Candidate| beside(known) != beside(&candidate);
            if begun.len() < STARTS && begun.iter().all(new) {
                begun.push(candidate);
            }
        }
        let starts = begun.iter().filter_map(|c| self.start(c, &base));
        let fits = starts.filter_map(|from| self.alone(&from));
        fits.min_by(|a, b| a.objective.total_cmp(&b.objective))
    }

    /// The effect fitted alone, to the end.
    fn alone(&self, from: &[f64]) -> Option<ComposedFit> {
        let own = self.own(Parameter::can_be_free);
        fit_rows(self.rows, self.model, from, &own, self.options, self.cancel)
    }
}

/// A point but for one place.
fn without(point: &[f64], place: usize) -> Vec<f64> {
    let mut point = point.to_vec();
    point.remove(place);
    point
}
