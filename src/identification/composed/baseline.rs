//! Where the fit of a structure with effects starts: the plain model on all events, and, where that
//! fits badly, on the mildest of them only, whose voltage stayed above any threshold.

use super::{
    extend::{Ground, Screened},
    fit::{ComposedFit, ComposedFitOptions, fit, unfitted},
    from_mild::from_mild,
    refine::refine,
    rows::EventRows,
};
use crate::{
    identification::{
        fit::{FitSolution, SearchOptions, fit as search},
        intake::PreparedEvent,
        joint_problem::ProblemOptions,
    },
    load_model::{
        Structure,
        composed::{ComposedModel, ModelParameter},
        effect::Role,
        structure::StructureError,
    },
};

/// Above this multiple of the noise (squared, per row) the mildest events are fitted by themselves.
const BAD_FIT: f64 = 2.5;
/// Below this a fit to all events is not begun anew at what the mildest have.
const FOLLOWED: f64 = 1.0;
/// Above this multiple a fit is not brought to its end.
const NEAR: f64 = 10.0;
/// Below this the mildest events count as fitted.
pub(super) const GOOD_FIT: f64 = 1.6;
/// Shares of the events, mildest first, that are tried.
const MILD_SHARES: [f64; 3] = [0.6, 0.4, 0.25];
/// Calls of the objective in the search on the mild events.
const MILD_EVALUATIONS_MAX: u64 = 300;
/// Above this an ordinary load is a start of its own: what is fitted is bent by what is missing.
const BENT: f64 = 4.0;
/// The same where a fit has no motor, ...
const BENT_WITHOUT_MOTOR: f64 = 1.0;
/// ... its share or kappa being within this part of their range from the least.
const NO_MOTOR: f64 = 1e-3;
/// Where fits of the static load's lag begin, s: at nothing, a jump between two instants says nothing of it.
const STATIC_LAG_S: f64 = 0.002;
/// Below this rate no sample near a jump tells a lag of milliseconds from when the voltage jumped: there is none.
const STATIC_LAG_RATE_FPS: f64 = 45.0;
/// Motors of every kind: ordinary ones have 10 to 100 1/s, 200 to 5,000 1/s^2 and 0.1 to 0.9.
const MOTORS_ALPHA_PER_S: [f64; 2] = [20.0, 60.0];
const MOTORS_NU_PER_S2: [f64; 3] = [300.0, 1000.0, 3000.0];
const MOTORS_KAPPA: [f64; 3] = [0.25, 0.5, 0.75];
/// Place of kappa in a model's vector.
const KAPPA: usize = 2;
/// Place of the motor's share.
const MOTOR_SHARE: usize = 3;
/// Shares of kappa from which a fit begins, until one can be simulated: a motor at its steepest in the
/// plain search, which knows one operating point only, is beyond pull-out at another.
const EASED: [f64; 4] = [1.0, 0.9, 0.75, 0.5];
/// A fit of the same structure is another one where minus twice its log posterior is lower by this ...
const LOWER: f64 = 10.0;
/// ... and by this share of the squares it leaves.
const LOWER_SHARE: f64 = 0.1;
/// Fewest events of a mild fit.
const MILD_EVENTS_MIN: usize = 2;

/// A structure fitted to all events and, where the plain structure fails on them, to the mildest.
#[derive(Clone, Debug)]
pub struct Baseline {
    /// The structure.
    pub structure: Structure,
    /// Fitted to all events.
    pub all: ComposedFit,
    /// The mildest events, and the fit to them alone; none where that to all follows them.
    pub mild: Option<(Vec<PreparedEvent>, ComposedFit)>,
    /// An ordinary load, not fitted, its effects as in `all`: where what is missing bends a fit, its optimum
    /// may be farther from the truth. None where nothing seems to be missing.
    pub ordinary: Option<ComposedFit>,
}

impl Baseline {
    /// The fits from which an effect may start.
    #[must_use]
    pub fn origins(&self) -> Vec<&ComposedFit> {
        let mild = self.mild.iter().map(|(_, fit)| fit);
        std::iter::once(&self.all).chain(mild).collect()
    }

    /// The baseline with one more effect: [`Self::extended`] on all events, and fitted to the mild
    /// events by themselves, so that a part whose effect shows everywhere is not spoilt by what
    /// happens in deep dips only. `None` where no start could be simulated.
    ///
    /// # Errors
    ///
    /// [`StructureError`] when the effect is not in the catalogue, or excluded.
    pub fn with(
        &self,
        events: &[PreparedEvent],
        effect: &str,
        options: &ComposedFitOptions,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Self>, StructureError> {
        let Some(all) = self.extended(events, effect, options, cancel)? else {
            return Ok(None);
        };
        self.completed(events, all, effect, options, cancel)
            .map(Some)
    }

    /// The fit of the structure with one more effect to all events, from both origins. An effect that
    /// does not show is included with its typical shapes. `None` where no start could be simulated.
    ///
    /// # Errors
    ///
    /// As [`Self::with`].
    pub fn extended(
        &self,
        events: &[PreparedEvent],
        effect: &str,
        options: &ComposedFitOptions,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<ComposedFit>, StructureError> {
        let ground = self.ground(events, options, cancel);
        let screened = ground.screen(effect)?;
        let sketched = self.sketched(&ground, &screened, f64::INFINITY);
        let refined = sketched.map(|fit| refine(events, fit, effect, options, cancel));
        let followed = refined.filter(|fit| self.followed_by(fit));
        Ok(followed.or_else(|| ground.include(&screened, options)))
    }

    /// The fits from which effects are added, on `events`.
    pub fn ground<'a>(
        &'a self,
        events: &'a [PreparedEvent],
        options: &ComposedFitOptions,
        cancel: &'a (dyn Fn() -> bool + Sync),
    ) -> Ground<'a> {
        let ground = Ground::new(events, &self.structure, &self.origins(), options, cancel);
        ground.and_from(&self.ordinary)
    }

    /// Ordinary loads with motors of every kind, not fitted, everything else as in [`Self::ordinary`]: none where nothing
    /// seems to be missing. A motor that was fitted without what is missing may be of another kind than the load's, and so may
    /// be the one that is typical.
    #[must_use]
    pub fn motors_of_every_kind(
        &self,
        events: &[PreparedEvent],
        options: &ComposedFitOptions,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Vec<ComposedFit> {
        let Some(ordinary) = &self.ordinary else {
            return Vec::new();
        };
        let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
        let mut loads = Vec::new();
        for alpha_per_s in MOTORS_ALPHA_PER_S {
            for nu_per_s2 in MOTORS_NU_PER_S2 {
                for kappa in MOTORS_KAPPA {
                    let mut values = ordinary.parameters.clone();
                    values[..=KAPPA].copy_from_slice(&[alpha_per_s.ln(), nu_per_s2.ln(), kappa]);
                    let (model, free) = (&ordinary.model, &ordinary.free);
                    loads.extend(unfitted(&rows, model, &values, free, options, cancel));
                }
            }
        }
        loads
    }

    /// A coarse fit with one more effect to all events, from both origins: enough to compare it with
    /// other effects; [`refine`] fits it to the end. `None` where no start could be simulated, or none
    /// led to where the events are followed as well as without the effect. Given up where the weighted squares
    /// `wanted` are out of reach.
    #[must_use]
    pub fn sketched(
        &self,
        ground: &Ground<'_>,
        screened: &Screened,
        wanted: f64,
    ) -> Option<ComposedFit> {
        let fit = ground.refit(screened, wanted)?;
        if self.followed_by(&fit) {
            return Some(fit);
        }
        if fit.given_up {
            return None;
        }
        // The covariances of its start may have hidden what it leaves: once more, with those of its end.
        let again = ground.again(screened, &fit);
        Some(again).filter(|fit| self.followed_by(fit))
    }

    /// This structure with the values that `fit`, of this structure and one more effect, has for it. `None`
    /// when they cannot be simulated without the effect.
    #[must_use]
    pub fn with_values_of(
        &self,
        events: &[PreparedEvent],
        fit: &ComposedFit,
        options: &ComposedFitOptions,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Option<ComposedFit> {
        let model = &self.all.model;
        let values = values_of(fit, model, &self.all.parameters);
        let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
        unfitted(&rows, model, &values, &self.all.free, options, cancel)
    }

    /// The same structure fitted to all events from where `fit`, with one more effect, has its values: none
    /// where that ends no lower than this.
    #[must_use]
    pub fn lower_from(
        &self,
        events: &[PreparedEvent],
        fit: &ComposedFit,
        options: &ComposedFitOptions,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Option<Self> {
        let newest = self.structure.names().pop()?;
        let begun = self.with_values_of(events, fit, options, cancel)?;
        let all = refine(events, begun, &newest, options, cancel);
        let gained = self.all.minus_twice_log_posterior() - all.minus_twice_log_posterior();
        let least = LOWER.max(LOWER_SHARE * self.all.squares.iter().sum::<f64>());
        (gained > least).then(|| Self {
            ordinary: ordinary(events, &all, options, cancel),
            all,
            ..self.clone()
        })
    }

    /// Whether a fit ends no higher than this one, from which it began: otherwise it lost its way.
    fn followed_by(&self, fit: &ComposedFit) -> bool {
        fit.minus_twice_log_posterior() <= self.all.minus_twice_log_posterior()
    }

    /// [`Self::with`], begun where `fit` is: a fit with the effect and perhaps with more besides. `None` where
    /// its values cannot be simulated.
    ///
    /// # Errors
    ///
    /// As [`Self::with`].
    pub fn with_fit(
        &self,
        events: &[PreparedEvent],
        effect: &str,
        fit: &ComposedFit,
        options: &ComposedFitOptions,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<Option<Self>, StructureError> {
        let structure = self.structure.with(effect)?;
        let Some(begun) = in_order_of(&structure, fit, events, options, cancel) else {
            return Ok(None);
        };
        let all = refine(events, begun, effect, options, cancel);
        self.completed(events, all, effect, options, cancel)
            .map(Some)
    }

    /// The baseline with `effect`, of which `all` is the fit to all `events`.
    ///
    /// # Errors
    ///
    /// As [`Self::with`].
    pub fn completed(
        &self,
        events: &[PreparedEvent],
        all: ComposedFit,
        effect: &str,
        options: &ComposedFitOptions,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<Self, StructureError> {
        let (mut mild, mut all) = (None, all);
        let structure = self.structure.with(effect)?;
        let left = all.chi_square_per_row();
        if let Some((few, fit)) = self.mild.as_ref().filter(|_| left > FOLLOWED) {
            let ground = Ground::new(few, &self.structure, &[fit], options, cancel);
            let own = ground.refit(&ground.screen(effect)?, f64::INFINITY);
            let own = own.map(|fit| refine(few, fit, effect, options, cancel));
            // What does not show in the mild events leaves their fit as it is.
            let own = own.unwrap_or_else(|| fit.clone());
            // What the mild events have may lead where all of them did not.
            let led = from_mild(events, (&structure, &all), &own, options, cancel);
            let least = all.minus_twice_log_posterior();
            all = (led.filter(|fit| fit.minus_twice_log_posterior() < least)).unwrap_or(all);
            mild = (left > BAD_FIT).then(|| (few.clone(), own));
        }
        Ok(Self {
            structure,
            ordinary: ordinary(events, &all, options, cancel),
            all,
            mild,
        })
    }
}

/// Starts from `best`, the plain search's solution on all `events`. `None` when it cannot be
/// simulated or the caller asked to stop.
#[must_use]
pub fn baseline(
    events: &[PreparedEvent],
    structure: &Structure,
    best: &FitSolution,
    problem: &ProblemOptions,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<Baseline> {
    let model = ComposedModel::new(structure);
    let free = base_parameters(&model, events);
    let coarse = options.coarse();
    let sketched = |events: &[PreparedEvent], solution: &FitSolution| {
        EASED.into_iter().find_map(|share| {
            let mut from = start(&model, solution, &free);
            from[KAPPA] *= share;
            fit(events, &model, &from, &free, &coarse, cancel)
        })
    };
    // What is far from the events is only a start, and no better one for being exact.
    let refined = |events: &[PreparedEvent], sketch: ComposedFit| {
        let near = sketch.chi_square_per_row() < NEAR;
        let found = near.then(|| fit(events, &model, &sketch.parameters, &free, options, cancel));
        found.flatten().unwrap_or(sketch)
    };
    let all = refined(events, sketched(events, best)?);
    let mut result = Baseline {
        structure: structure.clone(),
        ordinary: ordinary(events, &all, options, cancel),
        all,
        mild: None,
    };
    if result.all.chi_square_per_row() < BAD_FIT {
        return Some(result);
    }
    let mut order: Vec<&PreparedEvent> = events.iter().collect();
    order.sort_by(|a, b| {
        let depth = |e: &PreparedEvent| 1.0 - e.lowest_voltage;
        depth(a).total_cmp(&depth(b)).then_with(|| a.id.cmp(&b.id))
    });
    for share in MILD_SHARES {
        let count = mild_count(events.len(), share);
        if count >= events.len() {
            continue;
        }
        let mild: Vec<PreparedEvent> = order[..count].iter().map(|e| (*e).clone()).collect();
        // Only a start of other fits: the local solutions of the scan will do.
        let mut options_of_search = SearchOptions::default().sketch();
        options_of_search.trust_tech.evaluations_max = MILD_EVALUATIONS_MAX;
        let Some(found) = search(&mild, *problem, &options_of_search, cancel) else {
            continue;
        };
        let candidate = found.solutions.first().and_then(|s| sketched(&mild, s));
        let Some(candidate) = candidate.map(|c| refined(&mild, c)) else {
            continue;
        };
        let chi_square = candidate.chi_square_per_row();
        let known = result.mild.as_ref();
        if known.is_none_or(|(_, known)| chi_square < known.chi_square_per_row()) {
            result.mild = Some((mild, candidate));
        }
        if chi_square < GOOD_FIT {
            break;
        }
    }
    Some(result)
}

/// An ordinary load with the effects of `fit`; none where that follows the events.
fn ordinary(
    events: &[PreparedEvent],
    fit: &ComposedFit,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<ComposedFit> {
    let bent = if has_no_motor(fit) {
        BENT_WITHOUT_MOTOR
    } else {
        BENT
    };
    if fit.chi_square_per_row() < bent {
        return None;
    }
    let model = &fit.model;
    let mut values = with_a_lag(model, &fit.free);
    for (index, parameter) in model.parameters().iter().enumerate() {
        if parameter.effect.is_some() {
            values[index] = fit.parameters[index];
        }
    }
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    unfitted(&rows, model, &values, &fit.free, options, cancel)
}

/// Whether the motor's share or its kappa has run to its least: what is missing stands in for the motor.
#[must_use]
pub fn has_no_motor(fit: &ComposedFit) -> bool {
    [KAPPA, MOTOR_SHARE].iter().any(|&index| {
        let declaration = &fit.model.parameters()[index].declaration;
        let (low, high) = (declaration.lower, declaration.upper);
        fit.parameters[index] <= low + NO_MOTOR * (high - low)
    })
}

/// `structure` with the values that `fit` has, typical ones where it has none, and free what is free there. `None` when they
/// cannot be simulated.
#[must_use]
pub fn in_order_of(
    structure: &Structure,
    fit: &ComposedFit,
    events: &[PreparedEvent],
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Option<ComposedFit> {
    let model = ComposedModel::new(structure);
    let values = values_of(fit, &model, &model.typical());
    let free = fit.free.iter();
    let free = free.filter_map(|&index| model.index(&fit.model.parameters()[index].name));
    let mut free: Vec<usize> = free.collect();
    free.sort_unstable();
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    unfitted(&rows, &model, &values, &free, options, cancel)
}

/// The vector of `model` with the values of `fit`, and `others` where it has none.
pub(super) fn values_of(fit: &ComposedFit, model: &ComposedModel, others: &[f64]) -> Vec<f64> {
    let own = model.parameters().iter().zip(others);
    let value = |(parameter, other): (&ModelParameter, &f64)| {
        let index = fit.model.index(&parameter.name);
        index.map_or(*other, |index| fit.parameters[index])
    };
    own.map(value).collect()
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a share of a number of events"
)]
fn mild_count(events: usize, share: f64) -> usize {
    ((events as f64 * share).ceil() as usize).max(MILD_EVENTS_MIN)
}

/// The parameters of ZIP and motor, and those of effects that the plain search knows in part.
fn base_parameters(model: &ComposedModel, events: &[PreparedEvent]) -> Vec<usize> {
    let all = model.parameters().iter().enumerate();
    let tells_lag = events.iter().all(|e| e.rate_fps >= STATIC_LAG_RATE_FPS);
    let shared = |p: &ModelParameter| p.declaration.role == Role::Shared;
    all.filter(|(_, p)| !shared(p))
        .map(|(index, _)| index)
        .filter(|index| tells_lag || *index != model.static_lag())
        .collect()
}

/// The typical vector, with a lag of the static load where that is free.
fn with_a_lag(model: &ComposedModel, free: &[usize]) -> Vec<f64> {
    let mut values = model.typical();
    let lag = model.static_lag();
    if !free.contains(&lag) {
        return values;
    }
    let declared = &model.parameters()[lag].declaration;
    values[lag] = STATIC_LAG_S.clamp(declared.lower, declared.upper);
    values
}

/// The model's vector at a solution of the plain search, every effect as it is typically.
fn start(model: &ComposedModel, solution: &FitSolution, free: &[usize]) -> Vec<f64> {
    let mut values = with_a_lag(model, free);
    let plain = solution.found.local.x.iter().chain(&solution.point.linear);
    for (value, plain) in values.iter_mut().zip(plain) {
        *value = *plain;
    }
    values
}
