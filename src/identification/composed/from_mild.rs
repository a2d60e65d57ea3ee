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
    /// The values `at`, those of every relay as the events want them beside the others.
    fn with_relays(&self, at: Vec<f64>) -> Vec<f64> {
        let relays = self.structure.effects().filter(|e| e.threshold().is_some());
        relays.fold(at, |at, relay| self.with_relay(&at, relay).unwrap_or(at))
    }

    /// The values `at`, those of `relay` as the events want them beside the others. `None` where no event shows it.
    fn with_relay(&self, at: &[f64], relay: &'static dyn Effect) -> Option<Vec<f64>> {
        let (options, cancel) = (self.options, self.cancel);
        let name = relay.declaration().name;
        let fewer = self.structure.without(name).ok()?;
        let model = ComposedModel::new(&fewer);
        let whole = ComposedFit {
            parameters: at.to_vec(),
            ..self.all.clone()
        };
        let others = values_of(&whole, &model, &model.typical());
        // Nothing is free: nothing follows.
        let held = unfitted(self.rows, &model, &others, &[], options, cancel)?;
        let shows = |(square, rows): (&f64, &EventRows<'_>)| *square > SHOWS * rows.count() as f64;
        let first = held.squares.iter().zip(self.rows).position(shows)?;
        let extended = ComposedModel::new(&fewer.with(name).ok()?);
        let until = |last: usize| Step {
            rows: &self.rows[..=last],
            model: &extended,
            effect: relay,
            origin: &held,
            options,
            cancel,
        };
        let lowest = self.lowest_pu[first];
        let above = if first == 0 {
            1.0
        } else {
            self.lowest_pu[first - 1]
        };
        let voltages = BETWEEN.map(|share| lowest + share * (above - lowest));
        let mut found = until(first).first_seen(voltages)?;
        for last in first + 1..self.rows.len() {
            let step = until(last);
            found = step.alone(&found.parameters)?;
        }
        Some(values_of(&found, &self.all.model, at))
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
