//! One more effect on a fitted model: screened at its neutral value over a grid of its shapes, then
//! refitted in stages from the best of them.

use nalgebra::{DMatrix, DVector};

use super::{
    covariance::EventCovariance,
    fit::{ComposedFit, ComposedFitOptions, fit_rows},
    rows::EventRows,
};
use crate::{
    identification::intake::PreparedEvent,
    load_model::{
        MotorCoordinates, Structure,
        composed::ComposedModel,
        effect::{Effect, Parameter, Role},
        effects,
        structure::StructureError,
    },
    numerics::local_solver,
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

/// An effect added to a fitted model.
#[derive(Clone, Debug)]
pub struct Extension {
    /// Its name.
    pub effect: &'static str,
    /// The structure with it.
    pub structure: Structure,
    /// Scores over the grid, best first.
    pub scores: Vec<Score>,
    /// The refitted model; `None` where no start could be simulated.
    pub fit: Option<ComposedFit>,
}

/// Grid points from which a refit starts.
const STARTS: usize = 2;
/// Shares of the proposed amplitude that are tried, until one lowers the objective.
const SHRINKING: [f64; 3] = [1.0, 0.4, 0.1];
/// Calls of the objective with which the effect alone is brought near its optimum.
const FIRST_STAGE_EVALUATIONS: u64 = 10;
/// An amplitude starts within this share of its bounds.
const START_WITHIN: f64 = 0.6;

/// Scores of `effect` at every point of its grid and from every origin (fits of one structure to the
/// same or to fewer events), best first; nothing is refitted.
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
    let model = ComposedModel::new(&structure.with(effect)?);
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    let Some(effect) = effects::find(effect) else {
        return Ok(Vec::new());
    };
    let mut scores: Vec<Score> = origins
        .iter()
        .flat_map(|origin| {
            let step = Step {
                rows: &rows,
                model: &model,
                effect,
                origin,
                options,
                cancel,
            };
            step.screen()
        })
        .collect();
    scores.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    Ok(scores)
}

/// Adds `effect` to every origin (fits of one structure to the same or to fewer events) and refits
/// on `events`; the best is kept.
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
    let rows: Vec<EventRows<'_>> = events.iter().map(EventRows::new).collect();
    let mut result = Extension {
        effect: "",
        structure: extended.clone(),
        scores: Vec::new(),
        fit: None,
    };
    let Some(effect) = effects::find(effect) else {
        return Ok(result);
    };
    result.effect = effect.declaration().name;
    let model = ComposedModel::new(&extended);
    for origin in origins {
        let step = Step {
            rows: &rows,
            model: &model,
            effect,
            origin,
            options,
            cancel,
        };
        let scores = step.screen();
        for score in scores.iter().take(STARTS) {
            let better = |a: &ComposedFit, b: &ComposedFit| a.objective < b.objective;
            if let Some(found) = step.refit(score)
                && result.fit.as_ref().is_none_or(|best| better(&found, best))
            {
                result.fit = Some(found);
            }
        }
        result.scores.extend(scores);
    }
    result.scores.sort_by(|a, b| b.gain.total_cmp(&a.gain));
    Ok(result)
}

struct Step<'a> {
    rows: &'a [EventRows<'a>],
    model: &'a ComposedModel,
    effect: &'static dyn Effect,
    origin: &'a ComposedFit,
    options: &'a ComposedFitOptions,
    cancel: &'a (dyn Fn() -> bool + Sync),
}

impl Step<'_> {
    /// The origin's parameters with the effect absent.
    fn neutral(&self) -> Vec<f64> {
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
    fn own(&self, picks: impl Fn(&Parameter) -> bool) -> Vec<usize> {
        let name = self.effect.declaration().name;
        let all = self.model.parameters().iter().enumerate();
        all.filter(|(_, p)| p.effect == Some(name) && picks(&p.declaration))
            .map(|(index, _)| index)
            .collect()
    }

    /// Parameters that were free in the origin, as indices into this model.
    fn free_before(&self) -> Vec<usize> {
        let names = self
            .origin
            .free
            .iter()
            .map(|&i| &self.origin.model.parameters()[i].name);
        names.filter_map(|name| self.model.index(name)).collect()
    }

    fn screen(&self) -> Vec<Score> {
        let neutral = self.neutral();
        let motor = MotorCoordinates {
            alpha_per_s: neutral[0].exp(),
            nu_per_s2: neutral[1].exp(),
            kappa: neutral[2],
        };
        let shapes = self.own(|p| p.role == Role::Shape);
        let Some(base) = self.base_columns(&neutral) else {
            return Vec::new();
        };
        let mut scores: Vec<Score> = self
            .effect
            .nuisance_grid(&motor)
            .into_iter()
            .filter_map(|values| {
                let mut at = neutral.clone();
                for (index, value) in shapes.iter().zip(&values) {
                    at[*index] = *value;
                }
                self.score(&at, values, &base)
            })
            .collect();
        scores.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        scores
    }

    /// Derivative columns of what was free before, the residual, and the covariance of every event.
    fn base_columns(&self, neutral: &[f64]) -> Option<Vec<(DMatrix<f64>, EventCovariance)>> {
        let wanted = self.free_before();
        let scatter = &self.options.scatter;
        let columns = |event: &EventRows<'_>| {
            let rows = event.expanded(self.model, neutral, &wanted).ok()?;
            let covariance = event.covariance(self.model, neutral, scatter).ok()??;
            Some((rows, covariance))
        };
        self.rows.iter().map(columns).collect()
    }

    /// The score of the amplitudes at one grid point: the least squares problem of amplitudes and
    /// base parameters together, linearised at the neutral value.
    fn score(
        &self,
        at: &[f64],
        shapes: Vec<f64>,
        base: &[(DMatrix<f64>, EventCovariance)],
    ) -> Option<Score> {
        if (self.cancel)() {
            return None;
        }
        let amplitudes = self.own(Parameter::is_amplitude);
        let before = self.free_before().len();
        let count = amplitudes.len();
        let mut sum = DMatrix::zeros(before + count + 1, before + count + 1);
        for (event, (base, covariance)) in self.rows.iter().zip(base) {
            let added = event.expanded(self.model, at, &amplitudes).ok()?;
            let mut rows = DMatrix::zeros(base.nrows(), before + count + 1);
            rows.columns_mut(0, before)
                .copy_from(&base.columns(0, before));
            rows.columns_mut(before, count + 1).copy_from(&added);
            sum += covariance.gram(&rows);
        }
        for i in 0..before {
            // What the base leaves undetermined must not be divided by.
            sum[(i, i)] *= 1.0 + 1e-9;
        }
        let base_part = sum.view((0, 0), (before, before)).into_owned().cholesky()?;
        let cross = sum.view((0, before), (before, count + 1)).into_owned();
        let own = sum
            .view((before, before), (count + 1, count + 1))
            .into_owned();
        let projected = &own - cross.tr_mul(&base_part.solve(&cross));
        let information = projected.view((0, 0), (count, count)).into_owned();
        let right: DVector<f64> = projected
            .view((0, count), (count, 1))
            .column(0)
            .into_owned();
        let visibility = (0..count)
            .map(|i| projected[(i, i)] / own[(i, i)].max(f64::MIN_POSITIVE))
            .fold(1.0, f64::min);
        let amplitude = self.amplitude(&information, &right, &amplitudes)?;
        let gain = 2.0 * amplitude.dot(&right) - (amplitude.tr_mul(&information) * &amplitude)[0];
        Some(Score {
            shapes,
            amplitude_error: information[(0, 0)].max(f64::MIN_POSITIVE).sqrt().recip(),
            amplitudes: amplitude.iter().copied().collect(),
            gain,
            visibility,
        })
        .filter(|s| s.gain.is_finite())
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

    fn refit(&self, score: &Score) -> Option<ComposedFit> {
        let mut start = self.neutral();
        for (index, value) in self
            .own(|p| p.role == Role::Shape)
            .iter()
            .zip(&score.shapes)
        {
            start[*index] = *value;
        }
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
            let found = fit_rows(
                self.rows,
                self.model,
                &from,
                &all,
                self.options,
                self.cancel,
            );
            if found.is_some() {
                return found;
            }
        }
        None
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
