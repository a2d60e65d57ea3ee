//! Scores of an effect on a fitted model: what a linear extrapolation from its absence promises, over
//! a grid of its shapes and around the best of them.

use std::{
    cell::RefCell,
    collections::{HashMap, HashSet},
};

use nalgebra::{DMatrix, DVector};

use super::{
    base::{Added, Base, Projected},
    coordinates::Coordinates,
    fit::{ComposedFit, ComposedFitOptions, Place},
    rows::EventRows,
};
use crate::{
    identification::intake::PreparedEvent,
    load_model::{
        MotorCoordinates,
        composed::{ComposedModel, MotorCourse},
        effect::{Effect, Parameter, Scale},
    },
};

/// How strongly the residual of a fitted model points at an effect, at one point of its grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Score {
    /// Values of the effect's shapes.
    pub shapes: Vec<f64>,
    /// Amplitudes that a linear extrapolation from the neutral value proposes.
    pub amplitudes: Vec<f64>,
    /// By how much these would lower `sum r' Sigma^-1 r`, everything else following.
    pub gain: f64,
    /// Which share of the effect the fitted model cannot mimic by its own parameters, 0 to 1.
    pub visibility: f64,
    /// Standard error of the first amplitude: what is smaller than about three of it cannot be seen.
    pub amplitude_error: f64,
}

/// An amplitude starts within this share of its bounds.
const START_WITHIN: f64 = 0.6;
/// Two dips whose lowest voltages are closer than this, relative to V0, leave no gap for a threshold.
const GAP_MIN: f64 = 0.012;
/// A gap wider than this is tried at three places.
const WIDE_GAP: f64 = 0.06;
/// Thresholds tried at most.
const THRESHOLDS_MAX: usize = 16;
/// A dip is at least this deep.
const DIP: f64 = 0.97;
/// Of the points of a large grid (without its thresholds) ...
const LARGE_GRID: usize = 8;
/// ... one in so many is tried with every threshold, ...
const SPARSE: usize = 4;
/// ... and all of them with so many of the thresholds, the best ones.
const THRESHOLDS_KEPT: usize = 5;
/// A dip whose lowest voltage is above a threshold by this does not reach what the model's relays smear of it, pu.
const CLEAR_ABOVE_PU: f64 = 0.02;
/// First steps of a pattern search around a grid point, in standard deviations of the prior and at most
/// in shares of the range, and how often they are halved.
const STEP_DEVIATIONS: f64 = 0.7;
const STEP_OF_RANGE: f64 = 0.15;
const HALVINGS: usize = 2;
/// Steps in one direction, and rounds over all, where an effect is looked at in several sizes, ...
const SIZED_STEPS_MAX: usize = 4;
/// ... the factor from one size to the next, ...
const SIZE_STEP: f64 = 1.5;
/// ... and how far from a size what it does there is taken to be proportional.
const SIZE_HOLDS: f64 = 1.25;
/// The search goes on with a shape only while it gains this share of what is left.
const WORTH: f64 = 1e-4;

/// A score, and what would be left of `sum r' Sigma^-1 r`.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    pub(super) score: Score,
    pub(super) left: f64,
    /// The size of the first amplitude at which the effect was looked at; `None` for a derivative.
    pub(super) size: Option<f64>,
    /// By how much the parameters that were free before would move to make room for the effect.
    pub(super) following: DVector<f64>,
}

/// An effect beside one fitted model.
pub(super) struct Step<'a> {
    pub(super) rows: &'a [EventRows<'a>],
    pub(super) model: &'a ComposedModel,
    pub(super) effect: &'static dyn Effect,
    pub(super) origin: &'a ComposedFit,
    pub(super) options: &'a ComposedFitOptions,
    pub(super) cancel: &'a (dyn Fn() -> bool + Sync),
}

/// The place of an event among the rows, and the bits of shapes (all but the threshold, or of a whole vector).
type BesideThreshold = (usize, Vec<u64>);

/// A step with what all candidates share.
pub(super) struct Screening<'a> {
    step: &'a Step<'a>,
    base: &'a Base,
    memory: &'a Memory,
}

/// What the screens of one effect on one fit share.
pub(super) struct Memory {
    /// What the motor does in every event while the effect is absent; none where that is of no use.
    motors: Vec<Option<MotorCourse>>,
    /// What is added to events that stay above the threshold, which does not depend on where it lies.
    above: RefCell<HashMap<BesideThreshold, Added>>,
    /// Events in which an effect of some shapes does nothing at one of its sizes, and so at none.
    nothing: RefCell<HashSet<BesideThreshold>>,
}

impl Memory {
    pub(super) fn new(step: &Step<'_>) -> Self {
        let neutral = step.neutral();
        let amplitudes = step.own(Parameter::is_amplitude);
        let of =
            |event: &EventRows<'_>| event.motor_course(step.model, &neutral, &amplitudes).ok()?;
        Self {
            motors: step.rows.iter().map(of).collect(),
            above: RefCell::default(),
            nothing: RefCell::default(),
        }
    }
}

/// Voltages at which a threshold may lie: below all dips, in the gaps between their lowest voltages,
/// and above the mildest.
pub(super) fn thresholds(events: &[PreparedEvent], declared: &Parameter) -> Vec<f64> {
    let mut lowest: Vec<f64> = events
        .iter()
        .filter(|e| e.lowest_voltage < DIP)
        .map(|e| e.lowest_voltage * e.v0_pu)
        .collect();
    lowest.sort_by(f64::total_cmp);
    lowest.push(1.0);
    let within = |v: f64| v.clamp(declared.lower, declared.upper);
    let mut list = vec![declared.lower];
    for pair in lowest.windows(2) {
        let gap = pair[1] - pair[0];
        // A dip reaches its lowest voltage late: where in a wide gap a threshold lies shows in when the
        // dips below it take effect.
        let shares: &[f64] = if gap > WIDE_GAP {
            &[1.0 / 6.0, 0.5, 5.0 / 6.0]
        } else if gap > GAP_MIN {
            &[0.5]
        } else {
            &[]
        };
        list.extend(shares.iter().map(|share| within(pair[0] + share * gap)));
    }
    list.dedup();
    let count = list.len();
    if count <= THRESHOLDS_MAX {
        return list;
    }
    let chosen = (0..THRESHOLDS_MAX).map(|i| list[i * (count - 1) / (THRESHOLDS_MAX - 1)]);
    chosen.collect()
}

impl Step<'_> {
    /// Where the model is simulated and compared with the events.
    pub(super) fn place<'a>(&'a self, coordinates: &'a Coordinates) -> Place<'a> {
        Place::new(
            self.rows,
            self.model,
            coordinates,
            self.options,
            self.cancel,
        )
    }

    /// The origin's parameters with the effect absent.
    pub(super) fn neutral(&self) -> Vec<f64> {
        let value = |name: &str| {
            let place = self.origin.model.index(name)?;
            self.origin.parameters.get(place).copied()
        };
        let parameters = self.model.parameters().iter();
        parameters
            .map(|p| value(&p.name).unwrap_or(p.declaration.neutral))
            .collect()
    }

    /// Indices of the effect's own parameters that a predicate picks.
    pub(super) fn own(&self, picks: impl Fn(&Parameter) -> bool) -> Vec<usize> {
        let name = self.effect.declaration().name;
        let all = self.model.parameters().iter().enumerate();
        all.filter(|(_, p)| p.effect == Some(name) && picks(&p.declaration))
            .map(|(index, _)| index)
            .collect()
    }

    /// Parameters that were free in the origin, as indices into this model.
    pub(super) fn free_before(&self) -> Vec<usize> {
        let names = self
            .origin
            .free
            .iter()
            .map(|&i| &self.origin.model.parameters()[i].name);
        names.filter_map(|name| self.model.index(name)).collect()
    }

    /// Where the effect's threshold is in the model's vector.
    pub(super) fn threshold(&self) -> Option<usize> {
        let name = self.effect.threshold()?;
        let own = self.effect.declaration().name;
        self.model.index(&format!("{own}.{name}"))
    }

    /// The effect's own grid.
    fn grid(&self) -> Vec<Vec<f64>> {
        let neutral = self.neutral();
        let motor = MotorCoordinates {
            alpha_per_s: neutral[0].exp(),
            nu_per_s2: neutral[1].exp(),
            kappa: neutral[2],
        };
        self.with_counts(self.with_frequency_levels(self.effect.nuisance_grid(&motor)))
    }

    /// Which of the effect's shapes is its threshold.
    fn threshold_place(&self) -> Option<usize> {
        let index = self.threshold()?;
        let shapes = self.own(Parameter::is_shape);
        shapes.iter().position(|i| *i == index)
    }

    /// The origin's parameters with the effect absent and of these shapes.
    pub(super) fn at(&self, shapes: &[f64]) -> Vec<f64> {
        let mut at = self.neutral();
        let places = self.own(Parameter::is_shape);
        for (index, value) in places.iter().zip(shapes) {
            at[*index] = *value;
        }
        at
    }

    /// Least squares under the signs the amplitudes may have.
    fn amplitude(
        &self,
        information: &DMatrix<f64>,
        right: &DVector<f64>,
        places: &[usize],
    ) -> Option<DVector<f64>> {
        let mut regular = information.clone();
        for i in 0..places.len() {
            regular[(i, i)] += 1e-9 * information[(i, i)] + f64::MIN_POSITIVE;
        }
        let mut amplitude = regular.cholesky()?.solve(right);
        for (value, &place) in amplitude.iter_mut().zip(places) {
            let declared = self.model.parameters()[place].declaration;
            let (low, high) = (
                declared.lower - declared.neutral,
                declared.upper - declared.neutral,
            );
            *value = value.clamp(START_WITHIN * low, START_WITHIN * high);
        }
        Some(amplitude)
    }
}

impl<'a> Screening<'a> {
    /// Of a step from a fit of which `base` is.
    pub(super) fn new(step: &'a Step<'a>, base: &'a Base, memory: &'a Memory) -> Self {
        Self { step, base, memory }
    }

    /// Candidates over the grid, with thresholds in `voltages`, best first.
    pub(super) fn screen(&self, voltages: &[f64]) -> Vec<Candidate> {
        let mut found: Vec<Candidate> = Vec::new();
        let own = self.step.grid();
        let Some(place) = (self.step.threshold_place()).filter(|_| !voltages.is_empty()) else {
            found.extend(own.into_iter().flat_map(|at| self.candidates(at)));
            found.sort_by(|a, b| a.left.total_cmp(&b.left));
            return found;
        };
        // The points of the grid differ in all but the threshold.
        let mut points: Vec<Vec<f64>> = Vec::new();
        for mut point in own {
            point[place] = voltages[0];
            if !points.contains(&point) {
                points.push(point);
            }
        }
        let last = points.len().saturating_sub(1);
        let sparse = if points.len() < LARGE_GRID { 1 } else { SPARSE };
        let (first, later): (Vec<_>, Vec<_>) = (points.into_iter().enumerate())
            .partition(|(number, _)| (last - number).is_multiple_of(sparse));
        let mut ranked: Vec<(f64, f64)> = Vec::with_capacity(voltages.len());
        for voltage in voltages {
            let begun = found.len();
            found.extend(
                (first.iter()).flat_map(|(_, at)| self.candidates(with(at, place, *voltage))),
            );
            let left = found[begun..].iter().map(|c| c.left);
            ranked.push((left.fold(f64::INFINITY, f64::min), *voltage));
        }
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, voltage) in ranked.into_iter().take(THRESHOLDS_KEPT) {
            found.extend(
                (later.iter()).flat_map(|(_, at)| self.candidates(with(at, place, voltage))),
            );
        }
        found.sort_by(|a, b| a.left.total_cmp(&b.left));
        found
    }

    /// The candidates at one point, of every size at which the effect is looked at.
    fn candidates(&self, at: Vec<f64>) -> Vec<Candidate> {
        let sizes = self.step.effect.screened_at();
        if sizes.is_empty() {
            return self.candidate(at, None).into_iter().collect();
        }
        let of = |size: &f64| self.candidate(at.clone(), Some(*size));
        sizes.iter().filter_map(of).collect()
    }

    /// Moves one shape after the other while less is left: a pattern search over the linear score,
    /// which needs no slope in a threshold or a delay. Of an effect that is looked at in several sizes it moves the size,
    /// too, and goes as far as that leads: fewer large steps stand for many small ones.
    pub(super) fn polish(&self, from: Candidate) -> Candidate {
        let shapes = self.step.own(Parameter::is_shape);
        let steps_max = from.size.map_or(1, |_| SIZED_STEPS_MAX);
        let first = self.step.own(Parameter::is_amplitude).first().copied();
        let largest = first.map_or(f64::INFINITY, |index| {
            self.step.model.parameters()[index].declaration.upper
        });
        let mut best = from;
        for halving in 0..=HALVINGS {
            let shrink = 0.5_f64.powi(i32::try_from(halving).unwrap_or(0));
            for _ in 0..steps_max {
                let begun = best.left;
                for (place, &index) in shapes.iter().enumerate() {
                    let declared = &self.step.model.parameters()[index].declaration;
                    if !declared.can_be_free() {
                        continue;
                    }
                    best = self.along(best, steps_max, |at, direction| {
                        let mut shapes = at.score.shapes.clone();
                        shapes[place] = moved(shapes[place], declared, direction * shrink);
                        (shapes != at.score.shapes).then_some((shapes, at.size))
                    });
                }
                best = self.along(best, steps_max, |at, direction| {
                    let size = (at.size? * SIZE_STEP.powf(direction * shrink)).min(largest);
                    Some((at.score.shapes.clone(), Some(size)))
                });
                if best.left >= begun {
                    break;
                }
            }
        }
        best
    }

    /// Up to `steps_max` steps in the first of two directions in which less is left. `next` is where a step from a
    /// candidate leads, shapes and size; none where it leads nowhere.
    fn along(
        &self,
        from: Candidate,
        steps_max: usize,
        next: impl Fn(&Candidate, f64) -> Option<(Vec<f64>, Option<f64>)>,
    ) -> Candidate {
        let mut best = from;
        for direction in [1.0, -1.0] {
            let mut moved = false;
            for _ in 0..steps_max {
                let stepped =
                    next(&best, direction).and_then(|(at, size)| self.candidate(at, size));
                match stepped.filter(|stepped| stepped.left < best.left * (1.0 - WORTH)) {
                    Some(stepped) => (best, moved) = (stepped, true),
                    None => break,
                }
            }
            if moved {
                break;
            }
        }
        best
    }

    /// The score of the amplitudes at one grid point: the least squares problem of amplitudes and
    /// base parameters together, linearised at the neutral value.
    fn candidate(&self, shapes: Vec<f64>, size: Option<f64>) -> Option<Candidate> {
        if (self.step.cancel)() {
            return None;
        }
        let at = &self.step.at(&shapes);
        let amplitudes = self.step.own(Parameter::is_amplitude);
        let count = amplitudes.len();
        let mut sum: Option<Added> = None;
        for number in 0..self.base.events.len() {
            let added = self.added(number, at, &shapes, size)?;
            sum = Some(match sum {
                None => added,
                Some(sum) => sum.plus(&added),
            });
        }
        let Projected {
            information: projected,
            own,
            cross,
            factor,
        } = self.base.projected(&sum?)?;
        let information = projected.view((0, 0), (count, count)).into_owned();
        let right: DVector<f64> = projected
            .view((0, count), (count, 1))
            .column(0)
            .into_owned();
        let visibility = (0..count)
            .map(|i| projected[(i, i)] / own[i].max(f64::MIN_POSITIVE))
            .fold(1.0, f64::min);
        let mut amplitude = self.step.amplitude(&information, &right, &amplitudes)?;
        if let Some(size) = size {
            amplitude[0] = amplitude[0].clamp(size / SIZE_HOLDS, size * SIZE_HOLDS);
        }
        let gain = 2.0 * amplitude.dot(&right) - (amplitude.tr_mul(&information) * &amplitude)[0];
        let score = Score {
            shapes,
            amplitude_error: information[(0, 0)].max(f64::MIN_POSITIVE).sqrt().recip(),
            amplitudes: amplitude.iter().copied().collect(),
            gain,
            visibility,
        };
        let left = projected[(count, count)] - gain;
        let to_residual = cross.column(count) - cross.columns(0, count) * &amplitude;
        (gain.is_finite() && left.is_finite()).then_some(Candidate {
            score,
            left,
            size,
            following: factor.solve(&to_residual),
        })
    }

    /// What the amplitudes add to an event, from memory where it stays above the threshold.
    fn added(&self, number: usize, at: &[f64], shapes: &[f64], size: Option<f64>) -> Option<Added> {
        let added = || {
            let columns = self.columns(number, at, size)?;
            Some(self.base.events[number].added(&columns))
        };
        let place = self.step.threshold_place().filter(|place| {
            self.base.events[number].lowest_voltage_pu > shapes[*place] + CLEAR_ABOVE_PU
        });
        let Some(place) = place else {
            return added();
        };
        let others = shapes.iter().enumerate().filter(|(i, _)| *i != place);
        let key: Vec<u64> = (others.map(|(_, value)| *value))
            .chain(size)
            .map(f64::to_bits)
            .collect();
        if let Some(known) = self.memory.above.borrow().get(&(number, key.clone())) {
            return Some(known.clone());
        }
        let added = added()?;
        let known = &self.memory.above;
        known.borrow_mut().insert((number, key), added.clone());
        Some(added)
    }

    /// The columns of the amplitudes: derivatives, or for the first what it does at a size, per unit of it.
    fn columns(&self, number: usize, at: &[f64], size: Option<f64>) -> Option<DMatrix<f64>> {
        let amplitudes = self.step.own(Parameter::is_amplitude);
        let (event, base) = (&self.step.rows[number], &self.base.events[number]);
        let motor = self.memory.motors[number].as_ref();
        let (Some(size), Some((&first, others))) = (size, amplitudes.split_first()) else {
            return event.added(self.step.model, at, &amplitudes, motor).ok();
        };
        let added = event.added(self.step.model, at, others, motor).ok()?;
        let mut added = added.insert_column(0, 0.0);
        let key = (number, at.iter().map(|x| x.to_bits()).collect());
        if self.memory.nothing.borrow().contains(&key) {
            return Some(added);
        }
        let mut with = at.to_vec();
        with[first] += size;
        let residual = event.residual(self.step.model, &with).ok()?;
        if residual == base.residual {
            self.memory.nothing.borrow_mut().insert(key);
            return Some(added);
        }
        added.set_column(0, &((&base.residual - residual) / size));
        Some(added)
    }
}

/// A point with another value in one place.
pub(super) fn with(point: &[f64], place: usize, value: f64) -> Vec<f64> {
    let mut point = point.to_vec();
    point[place] = value;
    point
}

/// A shape a step further, within its bounds.
fn moved(value: f64, declared: &Parameter, steps: f64) -> f64 {
    let logarithmic = declared.prior.scale == Scale::Logarithmic;
    let scaled = |x: f64| if logarithmic { x.ln() } else { x };
    let (lower, upper) = (scaled(declared.lower), scaled(declared.upper));
    let step = (STEP_DEVIATIONS * declared.prior.deviation).min(STEP_OF_RANGE * (upper - lower));
    let moved = (scaled(value) + steps * step).clamp(lower, upper);
    if logarithmic { moved.exp() } else { moved }
}
