//! Diagnose, add, refit, until nothing more is missing.

use super::{
    case::{Case, Watcher},
    diagnose::report,
    options::{DiagnosisOptions, Progress},
    outcome::{Diagnosis, Improvement, ImprovementStep, Status},
    round::round,
    where_it_fails::failure,
};
use crate::{
    disturbance::Window,
    identification::{ErrorSummary, IdentificationError, composed::Baseline},
    load_model::{Structure, structure::StructureError},
    measurement::Site,
};

/// What is changed in a structure.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Change {
    /// Whatever diagnosis after diagnosis finds missing, until nothing is.
    #[default]
    UntilAdequate,
    /// These effects and no others, in one step each.
    ByHand {
        /// Added, in this order.
        add: Vec<String>,
        /// Removed before.
        remove: Vec<String>,
    },
}

/// Rounds at most: no site has shown more than three effects that could be told apart.
const ROUNDS_MAX: usize = 4;
/// An effect is dropped when the criterion without it is at most this much worse.
const SUPERFLUOUS_DELTA_BIC: f64 = 10.0;
/// A step may raise the error on events not fitted by this share: the spread of composition alone
/// moves it as much.
const WORSE_MAX: f64 = 0.02;

/// Goes round: diagnose, add what is missing, refit, drop what became superfluous.
///
/// # Errors
///
/// As [`diagnose`](super::diagnose()), and [`IdentificationError::NoUsableEvent`] or
/// [`IdentificationError::NoSolution`] when the structure at the start cannot be fitted.
pub fn improve(
    site: &Site,
    windows: &[Window],
    structure: &[String],
    change: &Change,
    options: &DiagnosisOptions,
    progress: &(dyn Fn(Progress) + Sync),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Improvement, IdentificationError> {
    let ranges = options.identification.ranges.clone();
    let parsed = Structure::parse(structure)?.with_ranges(ranges);
    let mut case = Case::new(site, windows, options, Watcher { progress, cancel })?;
    let base = case.baseline(&parsed)?;
    case.refuse_without_response(&base);
    let mut stairs = Stairs::new(&case, base)?;
    match change {
        Change::UntilAdequate => stairs.climb()?,
        Change::ByHand { add, remove } => stairs.change(add, remove)?,
    }
    let last = match stairs.last.take() {
        Some(last) => last,
        None => stairs.diagnosis()?,
    };
    Ok(Improvement {
        site: site.name.clone(),
        steps: stairs.steps,
        last,
        diagnoses: stairs.diagnoses,
    })
}

struct Stairs<'a> {
    case: &'a Case<'a>,
    at: Baseline,
    first_bic: f64,
    steps: Vec<ImprovementStep>,
    diagnoses: Vec<Diagnosis>,
    last: Option<Diagnosis>,
}

impl<'a> Stairs<'a> {
    fn new(case: &'a Case<'a>, at: Baseline) -> Result<Self, IdentificationError> {
        let first_bic = at.all.criterion();
        let mut stairs = Self {
            case,
            at,
            first_bic,
            steps: Vec::new(),
            diagnoses: Vec::new(),
            last: None,
        };
        let start = stairs.at.clone();
        let step = stairs.step(
            &start,
            None,
            Vec::new(),
            "the structure at the start".to_owned(),
        )?;
        stairs.steps.push(step);
        Ok(stairs)
    }

    fn diagnosis(&self) -> Result<Diagnosis, IdentificationError> {
        report(self.case, &round(self.case, self.at.clone())?)
    }

    fn climb(&mut self) -> Result<(), IdentificationError> {
        for _ in 0..ROUNDS_MAX {
            let mut found = self.diagnosis()?;
            let missing = matches!(
                found.status,
                Status::MissingEffect | Status::InstrumentSuspect
            );
            let Some(effect) = found.answer_set.first().filter(|_| missing).cloned() else {
                self.last = Some(found);
                return Ok(());
            };
            match self.higher(&effect, &found.summary)? {
                Ok((step, next)) => {
                    self.diagnoses.push(found);
                    self.steps.push(step);
                    self.at = next;
                }
                Err(reason) => {
                    found
                        .reasons
                        .push(format!("{effect} is not added: {reason}"));
                    self.last = Some(found);
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    /// The next step up, or why there is none.
    fn higher(
        &self,
        effect: &str,
        reason: &str,
    ) -> Result<Result<(ImprovementStep, Baseline), String>, IdentificationError> {
        let climbed = || {
            let mut next = self.case.with(&self.at, effect)?;
            let dropped = self.drop_superfluous(&mut next, effect)?;
            let step = self.step(&next, Some(effect.to_owned()), dropped, reason.to_owned())?;
            Ok((step, next))
        };
        match climbed() {
            Ok((step, _)) if self.worse(&step) => Ok(Err(format!(
                "the error on events not fitted rises to {:.2} times the noise",
                deciding(&step).error_to_noise
            ))),
            Ok(higher) => Ok(Ok(higher)),
            Err(
                error
                @ (IdentificationError::NoSolution | IdentificationError::NotSimulated { .. }),
            ) => Ok(Err(error.to_string())),
            Err(error) => Err(error),
        }
    }

    fn change(&mut self, add: &[String], remove: &[String]) -> Result<(), IdentificationError> {
        for effect in remove {
            let next = self.case.baseline(&without(&self.at.structure, effect)?)?;
            let step = self.step(
                &next,
                None,
                vec![effect.clone()],
                "removed by hand".to_owned(),
            )?;
            self.steps.push(step);
            self.at = next;
        }
        for effect in add {
            let next = self.case.with(&self.at, effect)?;
            let step = self.step(
                &next,
                Some(effect.clone()),
                Vec::new(),
                "added by hand".to_owned(),
            )?;
            self.steps.push(step);
            self.at = next;
        }
        Ok(())
    }

    /// Effects that earlier steps added and that `next` no longer needs are taken out of it.
    fn drop_superfluous(
        &self,
        next: &mut Baseline,
        newest: &str,
    ) -> Result<Vec<String>, IdentificationError> {
        let added = self.steps.iter().filter_map(|s| s.added.clone());
        let mut dropped = Vec::new();
        for effect in added.filter(|e| e != newest) {
            if !next.structure.contains(&effect) {
                continue;
            }
            let fewer = self.case.baseline(&without(&next.structure, &effect)?)?;
            let worse_by = fewer.all.criterion() - next.all.criterion();
            if worse_by <= SUPERFLUOUS_DELTA_BIC {
                *next = fewer;
                dropped.push(effect);
            }
        }
        Ok(dropped)
    }

    fn worse(&self, step: &ImprovementStep) -> bool {
        let before = self
            .steps
            .last()
            .map_or(f64::INFINITY, |s| deciding(s).error_to_noise);
        deciding(step).error_to_noise > (1.0 + WORSE_MAX) * before
    }

    fn step(
        &self,
        at: &Baseline,
        added: Option<String>,
        dropped: Vec<String>,
        reason: String,
    ) -> Result<ImprovementStep, IdentificationError> {
        let fit = &self.case.narrowed(&at.all);
        let errors = self.case.errors(&at.structure, fit)?;
        let curves = self.case.curves(&at.structure, fit)?;
        Ok(ImprovementStep {
            structure: at.structure.names(),
            added,
            dropped,
            reason,
            errors,
            failures: curves
                .iter()
                .map(|(event, curves)| failure(event, curves))
                .collect(),
            parameter_count: fit.free.len(),
            delta_bic: at.all.criterion() - self.first_bic,
            set: self.case.conclude(&at.structure, fit)?.set,
        })
    }
}

/// The errors by which a step is taken or not: never those of the untouched events, which are quoted
/// and must not have been chosen by.
fn deciding(step: &ImprovementStep) -> &ErrorSummary {
    step.errors.gate.as_ref().unwrap_or(&step.errors.fit)
}

fn without(structure: &Structure, effect: &str) -> Result<Structure, IdentificationError> {
    if !structure.contains(effect) {
        let name = effect.to_owned();
        return Err(StructureError::NotThere { name }.into());
    }
    let left: Vec<String> = structure
        .names()
        .into_iter()
        .filter(|n| n != effect)
        .collect();
    Ok(Structure::parse(&left)?.with_ranges(structure.ranges().clone()))
}
