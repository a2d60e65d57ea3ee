//! One more effect on a fitted model: screened where it is absent over a grid of its shapes, then
//! refitted in stages from the best of them.

use super::{
    fit::{ComposedFit, ComposedFitOptions, fit_rows},
    rows::EventRows,
    screening::{Candidate, Score, Step, thresholds},
    threshold::settled,
};
use crate::{
    identification::intake::PreparedEvent,
    load_model::{
        Structure,
        composed::ComposedModel,
        effect::{Parameter, Role, Scale},
        effects,
        structure::StructureError,
    },
    numerics::local_solver,
};

/// An effect added to a fitted model.
#[derive(Clone, Debug)]
pub struct Extension {
    /// Its name.
    pub effect: &'static str,
    /// The structure with it.
    pub structure: Structure,
    /// Scores over the grid, best first.
    pub scores: Vec<Score>,
    /// The refitted model, as [`ComposedFitOptions::coarse`] fits; `None` where no start could be simulated.
    pub fit: Option<ComposedFit>,
}

/// Candidates from which a refit starts.
const STARTS: usize = 3;
/// Shares of the proposed amplitude that are tried, until one can be simulated.
const SHRINKING: [f64; 3] = [1.0, 0.4, 0.1];
/// Calls of the objective with which the effect alone is brought near its optimum.
const FIRST_STAGE_EVALUATIONS: u64 = 10;
/// Candidates that leave more than this multiple of what the best one leaves are not refitted.
const LEFT_MAX: f64 = 1.5;
/// Standard errors below this share of the prior's deviation come from the data.
const DETERMINED: f64 = 0.7;
/// Candidates whose gains differ by less than this share, and whose amplitudes do too, are one.
const ALIKE: f64 = 1e-3;
/// Least gain of a candidate worth a refit: two standard errors of one amplitude.
const GAIN_MIN: f64 = 4.0;
/// Least part of the effect that the fitted model must not be able to mimic.
const VISIBILITY_MIN: f64 = 1e-4;

/// Everything about an effect that `screen` and `extend` share.
struct Extending<'a> {
    rows: Vec<EventRows<'a>>,
    model: ComposedModel,
    voltages: Vec<f64>,
}

impl<'a> Extending<'a> {
    fn new(events: &'a [PreparedEvent], extended: &Structure, effect: &str) -> Self {
        let model = ComposedModel::new(extended);
        let threshold = effects::find(effect).and_then(|e| {
            let index = model.index(&format!("{effect}.{}", e.threshold()?))?;
            Some(&model.parameters()[index].declaration)
        });
        Self {
            rows: events.iter().map(EventRows::new).collect(),
            voltages: threshold.map_or_else(Vec::new, |p| thresholds(events, p)),
            model,
        }
    }

    fn steps<'s>(
        &'s self,
        origins: &'s [&'s ComposedFit],
        effect: &str,
        options: &'s ComposedFitOptions,
        cancel: &'s (dyn Fn() -> bool + Sync),
    ) -> Vec<Step<'s>> {
        let Some(effect) = effects::find(effect) else {
            return Vec::new();
        };
        let step = |origin: &&'s ComposedFit| Step {
            rows: &self.rows,
            model: &self.model,
            effect,
            origin,
            options,
            cancel,
        };
        origins.iter().map(step).collect()
    }
}

/// Scores of `effect` at every point of its grid and from every origin (fits of one structure to the
/// same or to fewer events), most gain first; nothing is refitted.
///
/// # Errors
///
/// [`StructureError`] when the effect is not in the catalogue, or excluded by a part of the
/// structure.
pub fn screen(
    events: &[PreparedEvent],
    structure: &Structure,
    origins: &[&ComposedFit],
    effect: &str,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Vec<Score>, StructureError> {
    let extending = Extending::new(events, &structure.with(effect)?, effect);
    let mut scores = Vec::new();
    for step in extending.steps(origins, effect, options, cancel) {
        if let Some(base) = step.base_columns() {
            let found = step.screen(&base, &extending.voltages);
            scores.extend(found.into_iter().map(|c| c.score));
        }
    }
    scores.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    Ok(scores)
}

/// Adds `effect` to every origin (fits of one structure to the same or to fewer events) and refits
/// coarsely on `events` from the best candidates; the best is kept, for [`refine`]. An effect that no candidate makes visible, or
/// that none wants with the sign it can have, is not refitted: `fit` is `None`.
///
/// # Errors
///
/// [`StructureError`] when the effect is not in the catalogue, or excluded by a part of the
/// structure.
pub fn extend(
    events: &[PreparedEvent],
    structure: &Structure,
    origins: &[&ComposedFit],
    effect: &str,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Extension, StructureError> {
    let extended = structure.with(effect)?;
    let extending = Extending::new(events, &extended, effect);
    let options = &options.coarse();
    let steps = extending.steps(origins, effect, options, cancel);
    let mut scores = Vec::new();
    let mut promising: Vec<(usize, Candidate)> = Vec::new();
    let bases: Vec<_> = steps.iter().map(Step::base_columns).collect();
    for (number, (step, base)) in steps.iter().zip(&bases).enumerate() {
        let Some(base) = base else { continue };
        let found = step.screen(base, &extending.voltages);
        scores.extend(found.iter().map(|c| c.score.clone()));
        promising.extend(found.into_iter().filter(promises).map(|c| (number, c)));
    }
    scores.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    promising.sort_by(|a, b| a.1.left.total_cmp(&b.1.left));
    let mut best: Option<ComposedFit> = None;
    for (number, candidate) in distinct(promising) {
        let (step, Some(base)) = (&steps[number], &bases[number]) else {
            continue;
        };
        let candidate = step.polish(candidate, base);
        let found = step.refit(&candidate);
        let better = |found: &ComposedFit| {
            let known = best.as_ref();
            known.is_none_or(|known| evidence(found) < evidence(known))
        };
        if let Some(found) = found.filter(better) {
            best = Some(found);
        }
    }
    let name = steps.first().map_or("", |s| s.effect.declaration().name);
    Ok(Extension {
        effect: name,
        structure: extended,
        scores,
        fit: best,
    })
}

/// `fit`, of a structure to which `effect` was added last, fitted to the end; its threshold in the middle
/// of where it may lie. As it was where that ends higher.
#[must_use]
pub fn refine(
    events: &[PreparedEvent],
    fit: ComposedFit,
    effect: &str,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> ComposedFit {
    let Some(effect) = effects::find(effect) else {
        return fit;
    };
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    let found = fit_rows(
        &rows,
        &fit.model,
        &fit.parameters,
        &fit.free,
        options,
        cancel,
    );
    let lower =
        |found: &ComposedFit| found.minus_twice_log_posterior() <= fit.minus_twice_log_posterior();
    let mut best = found.filter(lower).unwrap_or_else(|| fit.clone());
    best.evaluations += fit.evaluations;
    let step = Step {
        rows: &rows,
        model: &fit.model,
        effect,
        origin: &fit,
        options,
        cancel,
    };
    settled(&step, best)
}

/// The fit of `origin` with `effect` in its structure although no candidate promised anything: its
/// shapes as they are typically, only its amplitudes free beside what was free before. `None` when it
/// cannot be simulated.
///
/// # Errors
///
/// As [`extend`].
pub(super) fn include(
    events: &[PreparedEvent],
    structure: &Structure,
    origin: &ComposedFit,
    effect: &str,
    options: &ComposedFitOptions,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Option<ComposedFit>, StructureError> {
    let extending = Extending::new(events, &structure.with(effect)?, effect);
    let origins = [origin];
    let steps = extending.steps(&origins, effect, options, cancel);
    Ok(steps.first().and_then(Step::include))
}

/// Whether a candidate is worth a refit.
fn promises(candidate: &Candidate) -> bool {
    candidate.score.gain > GAIN_MIN && candidate.score.visibility > VISIBILITY_MIN
}

/// The best candidates that are not one and the same; the best of every origin is among them, for what
/// is left of a bad fit by a linear extrapolation and what is left of a good one do not compare.
fn distinct(mut sorted: Vec<(usize, Candidate)>) -> Vec<(usize, Candidate)> {
    let mut chosen: Vec<(usize, Candidate)> = Vec::new();
    let limit = (sorted.first()).map_or(f64::INFINITY, |(_, best)| LEFT_MAX * best.left);
    let mut seen: Vec<usize> = Vec::new();
    let mut first = |number: usize| {
        let new = !seen.contains(&number);
        if new {
            seen.push(number);
        }
        new
    };
    let (firsts, others): (Vec<_>, Vec<_>) =
        sorted.drain(..).partition(|(number, _)| first(*number));
    let others = others.into_iter().filter(|(_, c)| c.left <= limit);
    for (number, candidate) in firsts.into_iter().chain(others) {
        let near = |a: f64, b: f64| (a - b).abs() <= ALIKE * a.abs().max(b.abs());
        let alike = |(other, known): &(usize, Candidate)| {
            let pairs = (known.score.amplitudes.iter()).zip(&candidate.score.amplitudes);
            *other == number
                && near(known.score.gain, candidate.score.gain)
                && pairs.fold(true, |all, (a, b)| all && near(*a, *b))
        };
        if chosen.len() < STARTS && !chosen.iter().any(alike) {
            chosen.push((number, candidate));
        }
    }
    chosen
}

/// What the fits of one structure from several starts are compared by: the posterior, and half of
/// `ln N` for every parameter that the data determine better than its prior. A relay that never operates
/// costs nothing, one that follows a single sample must be worth it.
fn evidence(fit: &ComposedFit) -> f64 {
    let determined = (fit.free.iter()).filter(|&&index| {
        let declared = &fit.model.parameters()[index].declaration;
        let scale = match declared.prior.scale {
            Scale::Linear => 1.0,
            Scale::Logarithmic => fit.parameters[index],
        };
        let error = fit.standard_error(index).map(|e| e / scale);
        error.is_none_or(|e| e < DETERMINED * declared.prior.deviation)
    });
    0.5 * fit.minus_twice_log_posterior()
        + 0.5 * (fit.rows.max(1) as f64).ln() * determined.count() as f64
}

impl Step<'_> {
    /// First the effect alone, then everything.
    fn refit(&self, candidate: &Candidate) -> Option<ComposedFit> {
        let score = &candidate.score;
        let start = self.at(&score.shapes);
        let amplitudes = self.own(Parameter::is_amplitude);
        let own = self.own(|_| true);
        let mut all = self.free_before();
        all.extend(self.all_new());
        all.sort_unstable();
        all.dedup();
        for share in SHRINKING {
            let mut from = start.clone();
            for (&index, value) in amplitudes.iter().zip(&score.amplitudes) {
                from[index] = self.started(index, share * value);
            }
            if let (Some(size), Some(&first)) = (candidate.size, amplitudes.first()) {
                // A staircase of smaller steps is another one.
                from[first] = self.started(first, size);
            }
            let first = ComposedFitOptions {
                rounds_max: 1,
                local: local_solver::Options {
                    evaluations_max: FIRST_STAGE_EVALUATIONS,
                    ..self.options.local
                },
                ..*self.options
            };
            let staged = fit_rows(self.rows, self.model, &from, &own, &first, self.cancel);
            let from = staged.map_or(from, |f| f.parameters);
            let found = self.fit(&from, &all);
            if found.is_some() {
                return found;
            }
        }
        None
    }

    fn include(&self) -> Option<ComposedFit> {
        let mut from = self.neutral();
        let amplitudes = self.own(Parameter::is_amplitude);
        for &index in &amplitudes {
            from[index] = self.started(index, 0.0);
        }
        let mut free = self.free_before();
        free.extend(amplitudes);
        free.sort_unstable();
        self.fit(&from, &free)
    }

    fn fit(&self, from: &[f64], free: &[usize]) -> Option<ComposedFit> {
        fit_rows(self.rows, self.model, from, free, self.options, self.cancel)
    }

    /// Parameters of the effect, shared ones included.
    fn all_new(&self) -> Vec<usize> {
        let known = |name: &str| self.origin.model.index(name).is_some();
        let all = self.model.parameters().iter().enumerate();
        all.filter(|(_, p)| !known(&p.name))
            .map(|(index, _)| index)
            .collect()
    }

    /// An amplitude to start from: away from its neutral value, where the effect has no slope in
    /// its shapes.
    fn started(&self, index: usize, value: f64) -> f64 {
        let declared = self.model.parameters()[index].declaration;
        let least = match declared.role {
            Role::OneSidedAmplitude { meaningful } | Role::TwoSidedAmplitude { meaningful } => {
                0.5 * meaningful
            }
            Role::Shape | Role::Shared | Role::Base => 0.0,
        };
        let away = if value.abs() < least {
            least.copysign(value)
        } else {
            value
        };
        (declared.neutral + away).clamp(declared.lower, declared.upper)
    }
}
