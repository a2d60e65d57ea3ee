//! A walk of the settings of relays: where none of an event's samples falls into the switching of a relay the
//! objective has no slope in its voltage or its delay, and a solver that begins in such a place stays there.

use nalgebra::DVector;

use super::{
    coordinates::Coordinates,
    fit::{ComposedFit, ComposedFitOptions, Place},
    problem::ComposedProblem,
    rows::EventRows,
};
use crate::{
    load_model::{
        composed::{ComposedModel, ModelParameter},
        effect::{Reference, Role, Scale},
        effects,
    },
    numerics::Objective,
};

/// First steps of a voltage, pu, and of a delay, relative.
const VOLTAGE_STEP: f64 = 0.016;
const DELAY_STEP: f64 = 0.24;
/// How often a step is halved.
const HALVINGS: usize = 3;
/// Steps at most in one direction.
const STEPS_MAX: usize = 4;

/// What a walk from a fit must gain in minus twice the logarithm of the posterior: two standard errors.
pub(super) const WORTH: f64 = 4.0;

/// A point with its value.
type At = (DVector<f64>, f64);

/// Where a walk leads from the end of a fit, as parameters; none where it gains too little, or nothing can be
/// walked.
pub(super) fn from_fit(
    rows: &[EventRows<'_>],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<f64>> {
    let model = &fit.model;
    let all = model.parameters();
    if !fit.free.iter().any(|index| is_setting(&all[*index])) {
        return None;
    }
    let coordinates = Coordinates::new(model, &fit.parameters, &fit.free);
    let x = coordinates.unknowns(&fit.parameters);
    let place = Place::new(rows, model, &coordinates, options, cancel);
    let problem = place.problem(&x, None)?;
    let value = problem.value(&x)?;
    let (walked, lower) = walk(&problem, model, &coordinates, (x, value));
    (2.0 * (value - lower) > WORTH).then(|| coordinates.parameters(&walked))
}

/// Moves one setting after the other while the objective falls, everything else held. The point it ends at,
/// with the objective there.
pub(super) fn walk(
    problem: &ComposedProblem<'_>,
    model: &ComposedModel,
    coordinates: &Coordinates,
    begun: At,
) -> At {
    let bounds = coordinates.bounds();
    let mut at = begun;
    for moves in moves(model, coordinates) {
        let mut share = 1.0;
        for _ in 0..=HALVINGS {
            for direction in [share, -share] {
                for _ in 0..STEPS_MAX {
                    let mut x = at.0.clone();
                    for (place, step) in &moves {
                        x[*place] = (x[*place] + direction * step)
                            .clamp(bounds.lower[*place], bounds.upper[*place]);
                    }
                    match problem.value(&x).filter(|value| *value < at.1) {
                        Some(value) => at = (x, value),
                        None => break,
                    }
                }
            }
            share *= 0.5;
        }
    }
    at
}

/// Places and steps of what is moved together: every setting by itself; and of what the frequency switches two against
/// each other, because its setting, its delay and their spreads all put off the instants that an event shows.
fn moves(model: &ComposedModel, coordinates: &Coordinates) -> Vec<Vec<(usize, f64)>> {
    let mut settings = Vec::new();
    for (place, index) in coordinates.indices().into_iter().enumerate() {
        let parameter = &model.parameters()[index];
        if is_setting(parameter) {
            let step = match parameter.declaration.prior.scale {
                Scale::Linear => VOLTAGE_STEP,
                Scale::Logarithmic => DELAY_STEP,
            };
            settings.push(((place, step), by_frequency(parameter)));
        }
    }
    let alone = settings.iter().map(|(own, _)| vec![*own]);
    let mut moves: Vec<Vec<(usize, f64)>> = alone.collect();
    let mut of_frequency = settings.iter().filter(|(_, by)| *by).map(|(own, _)| *own);
    while let Some((place, step)) = of_frequency.next() {
        let against = of_frequency.clone();
        moves.extend(against.map(|(other, by)| vec![(place, step), (other, -by)]));
    }
    moves
}

/// Whether it is a setting of an effect that the frequency switches.
fn by_frequency(parameter: &ModelParameter) -> bool {
    let relay = parameter.effect.and_then(effects::find);
    relay.is_some_and(|relay| !relay.frequency_thresholds().is_empty())
}

/// A setting of a relay in two fits of the same model.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelaySetting {
    /// What it is in both, pu or s.
    pub values: [f64; 2],
    /// Which it is.
    pub of: SettingOf,
    /// The dip at which the relay acts, counted from 1.
    pub dip: f64,
}

/// What a relay's setting sets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SettingOf {
    /// A voltage.
    Level,
    /// How long the voltage has to stay below a level.
    PickUp {
        /// That level in the first fit, pu.
        level_pu: f64,
    },
}

/// Starts for `fit`, some of whose voltages and pick-up times of relays are `open` towards `other`, a fit of the same model:
/// that one, these settings not free; and the same with all settings of these relays as they are there. None where none is
/// open.
#[must_use]
pub fn with_levels_of(
    fit: &ComposedFit,
    other: &ComposedFit,
    open: impl Fn(&RelaySetting) -> bool,
) -> Option<[ComposedFit; 2]> {
    let parameters = fit.model.parameters();
    let is_open = |index: &usize| {
        let of = setting_of(fit, &parameters[*index]);
        of.is_some_and(|of| {
            open(&RelaySetting {
                values: [fit, other].map(|fit| fit.parameters[*index]),
                of,
                dip: counted_dip(fit, &parameters[*index]),
            })
        })
    };
    let settings: Vec<usize> = fit.free.iter().copied().filter(is_open).collect();
    let is_of_them = |index: usize| {
        let of_same = |setting: &usize| parameters[*setting].effect == parameters[index].effect;
        is_setting(&parameters[index]) && settings.iter().any(of_same)
    };
    let held = held_as_in(fit, other, |index| settings.contains(&index))?;
    Some([held, held_as_in(fit, other, is_of_them)?])
}

/// What a parameter of a fit sets of a relay; none where it is no voltage and no pick-up time.
fn setting_of(fit: &ComposedFit, parameter: &ModelParameter) -> Option<SettingOf> {
    if !is_setting(parameter) {
        return None;
    }
    if parameter.declaration.reference == Reference::Voltage {
        return Some(SettingOf::Level);
    }
    let relay = effects::find(parameter.effect?)?;
    let is_pick_up = relay.pick_up() == Some(parameter.declaration.name);
    let level = format!("{}.{}", parameter.effect?, relay.threshold()?);
    let level_pu = fit.parameters[fit.model.index(&level)?];
    is_pick_up.then_some(SettingOf::PickUp { level_pu })
}

/// A start for `fit`: `other`, a fit of the same model, the frequencies at which something switches not free; the
/// delays after them are. None where there are none.
#[must_use]
pub fn with_frequency_levels_of(fit: &ComposedFit, other: &ComposedFit) -> Option<ComposedFit> {
    held_as_in(fit, other, |index| {
        let parameter = &fit.model.parameters()[index];
        let relay = parameter.effect.and_then(effects::find);
        let levels = relay.map_or(&[][..], |relay| relay.frequency_thresholds());
        levels.contains(&parameter.declaration.name)
    })
}

/// `fit` with the parameters of `other`, those that `picks` takes not free: what they go with, delays before all, is begun
/// where `other` has it, too. None where it takes none.
fn held_as_in(
    fit: &ComposedFit,
    other: &ComposedFit,
    picks: impl Fn(usize) -> bool,
) -> Option<ComposedFit> {
    let is_left = |index: &usize| !picks(*index);
    let free: Vec<usize> = fit.free.iter().copied().filter(is_left).collect();
    (free.len() < fit.free.len()).then(|| ComposedFit {
        free,
        covariance: None,
        ..other.clone()
    })
}

/// The dip at which the effect of a parameter acts; 1 where it counts none.
fn counted_dip(fit: &ComposedFit, parameter: &ModelParameter) -> f64 {
    let effect = parameter.effect.and_then(effects::find);
    let count = effect.and_then(|effect| {
        let own = effect.declaration().name;
        fit.model.index(&format!("{own}.{}", effect.counts_dips()?))
    });
    count.map_or(1.0, |index| fit.parameters[index])
}

/// Whether events say of a parameter no more than between which two of them it lies, without saying where
/// ([`Declared::bracketed`](crate::load_model::effect::Declared::bracketed)).
#[must_use]
pub fn is_bracketed(parameter: &ModelParameter) -> bool {
    let effect = parameter.effect.and_then(effects::find);
    effect.is_some_and(|e| e.bracketed().contains(&parameter.declaration.name))
}

/// Whether a parameter is a voltage, a frequency or a delay of an effect that has a threshold, or that goes in steps, or what
/// its frequencies differ by.
pub(super) fn is_setting(parameter: &ModelParameter) -> bool {
    let declared = &parameter.declaration;
    let Some(relay) = parameter.effect.and_then(effects::find) else {
        return false;
    };
    let frequencies = relay.frequency_thresholds();
    let switches =
        relay.threshold().is_some() || !relay.screened_at().is_empty() || !frequencies.is_empty();
    let is_level = declared.reference == Reference::Voltage || frequencies.contains(&declared.name);
    // What settings differ by puts off the last of them as a time does.
    let differs = !frequencies.is_empty() && declared.prior.scale == Scale::Logarithmic;
    switches && declared.role == Role::Shape && (is_level || differs || declared.unit == "s")
}
