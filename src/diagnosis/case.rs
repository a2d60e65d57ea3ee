//! The events of a site as a diagnosis uses them, and fits to them.

use super::{
    event_sets::{Apart, Changes, Use, exchange, let_be_fitted_what_shows, not_foretold, uses},
    evidence::ADEQUATE_FLOORS,
    narrowings::Narrowings,
    options::{DiagnosisOptions, EventSplit, Progress},
    outcome::{EventSets, StructureErrors},
};
use crate::{
    disturbance::Window,
    identification::{
        AlignedFit, ErrorSummary, FittedSite, FittedStructure, Identification, IdentificationError,
        ReactiveTrend,
        composed::{self, Baseline, ComposedFit, ComposedFitOptions, ComposedLoad, Scatter},
        conclude,
        edge_timing::align,
        evaluate::{Curves, EventModel, StaticModel, errors},
        fit::{Fit, SearchOptions},
        fit_aligned,
        intake::PreparedEvent,
        joint_problem::ProblemOptions,
        median_operating_point, prepare_all,
    },
    load_model::{Structure, composed::SimulationError},
    measurement::Site,
};

/// ZIP and motor that leave more than this (weighted squares per row) are a start of larger models and
/// nothing else; their other local solutions are no better ones.
const EXPLORED_BELOW_PER_ROW: f64 = 10.0;

/// A fit that leaves less than this per row is not sought from elsewhere.
const FOLLOWED: f64 = 2.0;

/// Whoever waits for a diagnosis.
#[derive(Clone, Copy)]
pub(super) struct Watcher<'a> {
    pub(super) progress: &'a (dyn Fn(Progress) + Sync),
    pub(super) cancel: &'a (dyn Fn() -> bool + Sync),
}

impl Watcher<'_> {
    pub(super) fn check(&self) -> Result<(), IdentificationError> {
        if (self.cancel)() {
            return Err(IdentificationError::Cancelled);
        }
        Ok(())
    }

    pub(super) fn says(&self, what: String, done: usize, of: usize) {
        (self.progress)(Progress { what, done, of });
    }
}

/// How ZIP and motor are sought.
pub(super) fn plain_search(options: &DiagnosisOptions) -> SearchOptions {
    SearchOptions {
        explored_below_per_row: EXPLORED_BELOW_PER_ROW,
        ..options.identification.search
    }
}

/// The events by use and the plain search on them.
pub(super) struct Case<'a> {
    pub(super) site: &'a Site,
    pub(super) windows: &'a [Window],
    pub(super) options: &'a DiagnosisOptions,
    /// How composed models are fitted: as `options` have it, or with less that varies from event to event.
    pub(super) composed: ComposedFitOptions,
    pub(super) watcher: Watcher<'a>,
    /// Fitted and gating events, jumps aligned.
    pub(super) judged: Vec<PreparedEvent>,
    /// Which of `judged` gate.
    pub(super) gates: Vec<bool>,
    pub(super) untouched: Vec<PreparedEvent>,
    /// How these sets were changed.
    pub(super) changes: Changes,
    pub(super) refused: Vec<(String, String)>,
    problem: ProblemOptions,
    pub(super) found: Fit,
    /// How the reactive coefficients of all events go with Q0/P0.
    pub(super) trend: ReactiveTrend,
    /// Fits of the judged events that were narrowed already.
    pub(super) narrowings: Narrowings,
}

impl<'a> Case<'a> {
    /// Prepares the windows, as the parts of the structure want it, and runs the plain search on all but the untouched ones.
    pub(super) fn new(
        site: &'a Site,
        windows: &'a [Window],
        structure: &Structure,
        options: &'a DiagnosisOptions,
        changes: &Changes,
        watcher: Watcher<'a>,
    ) -> Result<Self, IdentificationError> {
        let intake = options.identification.intake.for_parts(&structure.names());
        let (events, mut refused) = prepare_all(windows, &intake);
        if events.is_empty() {
            return Err(IdentificationError::NoUsableEvent { refused });
        }
        let keys: Vec<(&str, f64)> = events
            .iter()
            .map(|e| (e.id.as_str(), e.lowest_voltage))
            .collect();
        let mut uses = uses(&keys, &options.split);
        exchange(&mut uses, &keys, &changes.exchanges);
        let (mut judged, mut gates, mut untouched) = (Vec::new(), Vec::new(), Vec::new());
        for (event, how) in events.into_iter().zip(uses) {
            if let Some(Apart { event, reason }) = changes.apart_of(&event.id) {
                refused.push((event.clone(), reason.clone()));
            } else if how == Use::Untouched {
                untouched.push(event);
            } else {
                gates.push(how == Use::Gate && !changes.lets_be_fitted(&event.id));
                judged.push(event);
            }
        }
        watcher.says("fitting ZIP and motor".to_owned(), 0, 1);
        let problem = options.identification.problem;
        let search = plain_search(options);
        let AlignedFit {
            found,
            events: judged,
            trend,
        } = fit_aligned(judged, problem, &search, watcher.cancel)?;
        let untouched = untouched.iter().map(|e| trend.applied_to(e)).collect();
        Ok(Self {
            site,
            windows,
            options,
            composed: options.composed,
            watcher,
            judged,
            gates,
            untouched,
            changes: changes.clone(),
            refused,
            problem,
            found,
            trend,
            narrowings: Narrowings::default(),
        })
    }

    /// The same events, between which no more varies than `scatter`.
    pub(super) fn with_scatter(&self, scatter: Scatter) -> Self {
        Self {
            composed: ComposedFitOptions {
                scatter,
                ..self.composed
            },
            judged: self.judged.clone(),
            gates: self.gates.clone(),
            untouched: self.untouched.clone(),
            changes: self.changes.clone(),
            refused: self.refused.clone(),
            found: self.found.clone(),
            narrowings: Narrowings::default(),
            ..*self
        }
    }

    /// Frames per second of the slowest event.
    pub(super) fn rate_fps(&self) -> f64 {
        let rates = self.judged.iter().map(|event| event.rate_fps);
        rates.fold(f64::INFINITY, f64::min)
    }

    /// Untouched events that the structure at the start has no response in are refused with the
    /// reason: no later structure is quoted on others. Gating events in which what was fitted without
    /// them has none are fitted instead: the more is missing, the more tells such an event. So are those that it
    /// does not foretell although it can follow them ([`not_foretold`]), and some of
    /// those that alone show that something is missing ([`let_be_fitted_what_shows`]), unless they were named.
    ///
    /// # Errors
    ///
    /// [`IdentificationError`] when the fit without the gate fails.
    pub(super) fn settle_uses(&mut self, base: &Baseline) -> Result<(), IdentificationError> {
        let model = load(&base.structure, &base.all);
        for event in std::mem::take(&mut self.untouched) {
            match model.curves(&align(&model, &event)) {
                Ok(_) => self.untouched.push(event),
                Err(error) => {
                    let named = model.without_value(&event);
                    let error = named.map_or_else(|| error.to_string(), |named| named.to_string());
                    let reason = format!("the fitted model has no response: {error}");
                    self.refused.push((event.id, reason));
                }
            }
        }
        let may_choose = self.options.split == EventSplit::Balanced;
        let misfits = self.per_row(&base.all);
        while self.has_gate() {
            let fit = self.narrowed_without_gate(&base.all)?;
            let model = load(&base.structure, &fit);
            let silent = |(event, gates): (&PreparedEvent, &bool)| {
                *gates && model.curves(&align(&model, event)).is_err()
            };
            let mut fitted: Vec<bool> = self.judged.iter().zip(&self.gates).map(silent).collect();
            // Only where other events are quoted: what is hard to foretell must not leave an error that is.
            if may_choose && !self.untouched.is_empty() && !fitted.contains(&true) {
                fitted = not_foretold(&self.foretold(&fit, &self.gates), &misfits);
            }
            if !fitted.contains(&true) {
                break;
            }
            for (gates, fitted) in self.gates.iter_mut().zip(fitted) {
                *gates &= !fitted;
            }
        }
        if may_choose {
            let adequate = ADEQUATE_FLOORS * self.options.claim.floor;
            let_be_fitted_what_shows(&mut self.gates, &misfits, adequate);
        }
        Ok(())
    }

    /// Events by use.
    pub(super) fn events(&self) -> EventSets {
        let names = |gating: bool| {
            let pairs = self.judged.iter().zip(&self.gates);
            pairs
                .filter(|(_, g)| **g == gating)
                .map(|(e, _)| e.id.clone())
                .collect()
        };
        EventSets {
            fit: names(false),
            gate: names(true),
            untouched: self.untouched.iter().map(|e| e.id.clone()).collect(),
            refused: self.refused.clone(),
        }
    }

    /// The fitted events, or those of the gate.
    pub(super) fn part(&self, gating: bool) -> Vec<PreparedEvent> {
        let pairs = self.judged.iter().zip(&self.gates);
        pairs
            .filter(|(_, g)| **g == gating)
            .map(|(e, _)| e.clone())
            .collect()
    }

    /// The fits from which effects start, of a structure built up effect by effect.
    pub(super) fn baseline(&self, structure: &Structure) -> Result<Baseline, IdentificationError> {
        self.built_up(structure, |built, effect| self.with(built, effect))
    }

    /// The same, each effect begun where a fit of a larger structure has it. What the structure by itself leads to was
    /// seen when its effects were tried one beside the other.
    pub(super) fn baseline_from(
        &self,
        structure: &Structure,
        fit: &ComposedFit,
    ) -> Result<Baseline, IdentificationError> {
        let (options, cancel) = (&self.composed, self.watcher.cancel);
        self.built_up(structure, |built, effect| {
            self.watcher.check()?;
            let begun = built.with_fit(&self.judged, effect, fit, options, cancel)?;
            begun.map_or_else(|| self.with(built, effect), Ok)
        })
    }

    fn built_up(
        &self,
        structure: &Structure,
        with: impl Fn(&Baseline, &str) -> Result<Baseline, IdentificationError>,
    ) -> Result<Baseline, IdentificationError> {
        let plain = structure.plain_part();
        let best = self
            .found
            .solutions
            .first()
            .ok_or(IdentificationError::NoSolution)?;
        let built = composed::baseline(
            &self.judged,
            &plain,
            best,
            &self.problem,
            &self.composed,
            self.watcher.cancel,
        );
        let mut built = built.ok_or_else(|| self.failed())?;
        for effect in structure.names() {
            if !plain.contains(&effect) {
                built = with(&built, &effect)?;
            }
        }
        Ok(built)
    }

    /// A baseline with one more effect.
    pub(super) fn with(
        &self,
        base: &Baseline,
        effect: &str,
    ) -> Result<Baseline, IdentificationError> {
        self.watcher.check()?;
        let next = base.with(&self.judged, effect, &self.composed, self.watcher.cancel)?;
        next.ok_or_else(|| match self.failed() {
            IdentificationError::NoSolution => self
                .without_value(base, effect)
                .unwrap_or(IdentificationError::NoSolution),
            other => other,
        })
    }

    /// Where an effect, added to a baseline, has no finite value in an event, judged or untouched; none where that is
    /// not so.
    pub(super) fn without_value(
        &self,
        base: &Baseline,
        effect: &str,
    ) -> Option<IdentificationError> {
        let of = |events| composed::without_value(events, &base.structure, &base.all, effect);
        of(&self.judged).or_else(|| of(&self.untouched))
    }

    /// The same, where a round has found `fit` with the effect: begun there too, whichever ends lower.
    pub(super) fn with_found(
        &self,
        base: &Baseline,
        effect: &str,
        fit: &ComposedFit,
    ) -> Result<Baseline, IdentificationError> {
        self.watcher.check()?;
        let (options, cancel) = (&self.composed, self.watcher.cancel);
        let found = base.with_fit(&self.judged, effect, fit, options, cancel)?;
        self.watcher.check()?;
        let Some(found) = found else {
            return self.with(base, effect);
        };
        let had_companions = found.all.parameters.len() != fit.parameters.len();
        if !had_companions || found.all.chi_square_per_row() < FOLLOWED {
            return Ok(found);
        }
        match self.with(base, effect) {
            Ok(own) if own.all.criterion() < found.all.criterion() => Ok(own),
            Err(error) if !error.is_of_the_model() => Err(error),
            _ => Ok(found),
        }
    }

    /// [`Baseline::lower_from`] on the judged events.
    pub(super) fn lower_from(
        &self,
        base: &Baseline,
        fit: &ComposedFit,
    ) -> Result<Option<Baseline>, IdentificationError> {
        let (options, cancel) = (&self.composed, self.watcher.cancel);
        let lower = base.lower_from(&self.judged, fit, options, cancel);
        self.watcher.check()?;
        Ok(lower)
    }

    pub(super) fn failed(&self) -> IdentificationError {
        if (self.watcher.cancel)() {
            IdentificationError::Cancelled
        } else {
            IdentificationError::NoSolution
        }
    }

    /// Errors on the fitted and gating events of a fit without the gate, and on the untouched ones of
    /// the fit to both.
    ///
    /// [`IdentificationError::NotSimulated`] when the model has no response in one of them: an error
    /// that leaves such an event out would look better than the model is.
    pub(super) fn errors(
        &self,
        structure: &Structure,
        fit: &ComposedFit,
    ) -> Result<StructureErrors, IdentificationError> {
        let judged = load(structure, fit);
        let untouched = self.errors_of(&judged, &self.untouched)?;
        if !self.has_gate() {
            return Ok(StructureErrors {
                fit: self.errors_of(&judged, &self.judged)?.unwrap_or_default(),
                gate: None,
                untouched,
            });
        }
        let training = self.narrowed_without_gate(fit)?;
        let model = load(structure, &training);
        Ok(StructureErrors {
            fit: self
                .errors_of(&model, &self.part(false))?
                .unwrap_or_default(),
            gate: self.errors_of(&model, &self.part(true))?,
            untouched,
        })
    }

    /// Error over noise on the untouched events; `None` where there are none or the model has no response in one.
    pub(super) fn error_on_untouched(&self, fit: &ComposedFit) -> Option<f64> {
        let fit = self.narrowed(fit);
        let structure = Structure::parse(&FittedStructure::of(&fit, &self.trend).structure).ok()?;
        let summary = self.errors_of(&load(&structure, &fit), &self.untouched);
        Some(summary.ok()??.error_to_noise)
    }

    /// Errors of a model on events; `None` without events.
    fn errors_of(
        &self,
        model: &ComposedLoad,
        events: &[PreparedEvent],
    ) -> Result<Option<ErrorSummary>, IdentificationError> {
        if events.is_empty() {
            return Ok(None);
        }
        let events = aligned(model, events);
        errors(model, &StaticModel::fit(&self.judged), &events)
            .map(Some)
            .map_err(|error| not_simulated(model, &events, &error))
    }

    /// The untouched events, their jumps where a fit explains them best.
    pub(super) fn untouched_as(
        &self,
        structure: &Structure,
        fit: &ComposedFit,
    ) -> Vec<PreparedEvent> {
        aligned(&load(structure, fit), &self.untouched)
    }

    /// What a fit says in all events, in the order of their names.
    pub(super) fn curves(
        &self,
        structure: &Structure,
        fit: &ComposedFit,
    ) -> Result<Vec<(PreparedEvent, Curves)>, IdentificationError> {
        let model = load(structure, fit);
        let mut events: Vec<&PreparedEvent> = self.judged.iter().chain(&self.untouched).collect();
        events.sort_by(|a, b| a.id.cmp(&b.id));
        let simulated = events.into_iter().map(|event| {
            let event = align(&model, event);
            let curves = model.curves(&event);
            let of_event = std::slice::from_ref(&event);
            let curves = curves.map_err(|error| not_simulated(&model, of_event, &error))?;
            Ok((event, curves))
        });
        simulated.collect()
    }

    /// The parameter set of a fit, validated on the untouched events (on those of the gate where
    /// there are none).
    pub(super) fn conclude(
        &self,
        structure: &Structure,
        fit: &ComposedFit,
    ) -> Result<Identification, IdentificationError> {
        let (fitted, held, fit) = if self.untouched.is_empty() && self.has_gate() {
            let training = self.narrowed_without_gate(fit)?;
            (self.part(false), self.part(true), training)
        } else {
            (self.judged.clone(), self.untouched.clone(), fit.clone())
        };
        let fitted_site = FittedSite {
            structure: structure.clone(),
            problem: self.problem,
            found: self.found.clone(),
            operating_point: median_operating_point(&fitted),
            weighted: fitted.clone(),
            measured: fitted,
            held,
            trend: self.trend,
            refused: self.refused.clone(),
            composed: Some(fit),
            exchanged: Vec::new(),
        };
        conclude(self.site, fitted_site, &self.options.identification)
    }
}

fn aligned(model: &ComposedLoad, events: &[PreparedEvent]) -> Vec<PreparedEvent> {
    events.iter().map(|event| align(model, event)).collect()
}

fn not_simulated(
    model: &ComposedLoad,
    events: &[PreparedEvent],
    error: &SimulationError,
) -> IdentificationError {
    if let Some(error) = events.iter().find_map(|event| model.without_value(event)) {
        return error;
    }
    let structure = model.structure.names().join(" + ");
    IdentificationError::NotSimulated {
        reason: format!("{structure}: {error}"),
    }
}

/// The model of a fit.
fn load(structure: &Structure, fit: &ComposedFit) -> ComposedLoad {
    ComposedLoad {
        structure: structure.clone(),
        model: fit.model.clone(),
        parameters: fit.parameters.clone(),
    }
}
