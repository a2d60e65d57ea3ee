//! Diagnose, add, refit, until nothing more is missing.

use super::{
    anew::{Asked, Stop, with_settled_events},
    case::{Case, Watcher},
    convincing::over_all,
    diagnose::report,
    in_the_way::WithoutIt,
    longer_window::{self, shown},
    options::{DiagnosisOptions, Progress},
    outcome::{Diagnosis, Improvement, ImprovementStep, Status},
    round::Second,
    where_it_fails::failure,
    worse::{deciding, is_worse, rise_on_untouched},
    worth::{effects_of, is_superfluous, worth_of},
};
use crate::{
    disturbance::Window,
    identification::{
        IdentificationError,
        composed::{Baseline, ComposedFit},
    },
    load_model::Structure,
    measurement::Site,
};

mod exchange;
mod together;

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
    let watcher = Watcher { progress, cancel };
    let asked = Asked {
        site,
        windows,
        structure: &parsed,
        options,
        watcher,
    };
    if let Some(window) = shown(&asked)
        && let Some(mut done) = longer_window::improvement(&asked, change, window)?
    {
        told_over_all(&mut done);
        return Ok(done);
    }
    let mut done = match longer_window::removal(&asked, change)? {
        Some(done) => done,
        None => improve_settled(&asked, change)?,
    };
    told_over_all(&mut done);
    Ok(done)
}

/// How the error moved over all steps, said first.
fn told_over_all(done: &mut Improvement) {
    if let Some(told) = over_all(&done.steps) {
        done.last.reasons.insert(0, told);
    }
}

/// The structure at the start, as a step.
pub(super) fn start(case: &Case<'_>, base: Baseline) -> Result<ImprovementStep, Stop> {
    let mut stairs = Stairs::new(case, base)?;
    Ok(stairs.steps.remove(0))
}

/// [`improve`] with events prepared as the structure at the start wants it.
pub(super) fn improve_settled(
    asked: &Asked<'_>,
    change: &Change,
) -> Result<Improvement, IdentificationError> {
    with_settled_events(asked, |case, base| {
        let mut stairs = Stairs::new(case, base)?;
        match change {
            Change::UntilAdequate => stairs.climb()?,
            Change::ByHand { add, remove } => stairs.change(add, remove)?,
        }
        let mut last = match stairs.last.take() {
            Some(last) => last,
            None => stairs.diagnosis()?,
        };
        last = last.with_worth(worth_of(case, &stairs.at, &stairs.given(change))?);
        Ok(Improvement {
            site: asked.site.name.clone(),
            steps: stairs.steps,
            last,
            diagnoses: stairs.diagnoses,
        })
    })
}

/// Effects, and of each the structure without it.
type WithoutEach = Vec<(String, Baseline)>;

/// Why a step up is not taken.
struct Refused {
    reason: String,
    /// The step, where it only follows events that are not fitted worse.
    worse: Option<Box<Higher>>,
}

/// A step up.
struct Higher {
    step: ImprovementStep,
    next: Baseline,
    /// Of each effect that an earlier step added, the structure without it.
    without: WithoutEach,
}

/// What a round found.
struct Seen {
    diagnosis: Diagnosis,
    /// The fit with the first effect of its answer.
    fit: Option<ComposedFit>,
    /// The second effect that the first one needs, if any.
    second: Option<Second>,
    /// The structure with the companions beside which effects were tried, if any.
    accompanied: Option<Baseline>,
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
    fn new(case: &'a Case<'a>, at: Baseline) -> Result<Self, Stop> {
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

    /// The effects that nothing here has shown to be needed: those at the start, or all where what is added was named by
    /// hand.
    fn given(&self, change: &Change) -> Vec<String> {
        let mut names = effects_of(&self.at);
        if *change == Change::UntilAdequate {
            let start = self.steps.first().map(|step| &step.structure);
            names.retain(|name| start.is_some_and(|start| start.contains(name)));
        }
        names
    }

    fn diagnosis(&mut self) -> Result<Diagnosis, Stop> {
        self.round().map(|seen| seen.diagnosis)
    }

    /// One round. Where it found a lower fit of the structure itself, that takes the place of the one it began with.
    fn round(&mut self) -> Result<Seen, Stop> {
        if let Some(found) = self.case.without_what_is_in_the_way(&self.at)? {
            let WithoutIt {
                case,
                round,
                with_it,
                apart,
            } = found;
            self.case.anew_with(apart.unwrap_or_default())?;
            return Ok(Seen {
                diagnosis: report(&case, &round)?,
                fit: Some(with_it),
                second: round.decision.second,
                accompanied: None,
            });
        }
        let (round, closer) = self.case.round(&self.at)?;
        self.case.none_contradicts(&round)?;
        let asked = &round.asked.baseline;
        if closer.is_none()
            && asked.all.minus_twice_log_posterior() < self.at.all.minus_twice_log_posterior()
        {
            self.at = asked.clone();
            if let Some(last) = self.steps.pop() {
                let step = self.step(&self.at, last.added, last.dropped, last.reason)?;
                self.steps.push(step);
            }
        }
        let first = round.decision.answer.first();
        let fit = first.and_then(|&place| round.trials[place].fit.clone());
        Ok(Seen {
            diagnosis: report(closer.as_ref().unwrap_or(self.case), &round)?,
            fit,
            second: round.decision.second,
            accompanied: round.accompanied.map(|with| with.baseline),
        })
    }

    fn climb(&mut self) -> Result<(), Stop> {
        for _ in 0..ROUNDS_MAX {
            let Seen {
                diagnosis: mut found,
                fit,
                second,
                accompanied,
            } = self.round()?;
            let Some(effect) = claimed(&found) else {
                self.last = Some(found);
                return Ok(());
            };
            let alone = self.higher(&effect, fit.as_ref(), &found.summary)?;
            let is_worth_it = |own: &Higher| own.next.all.criterion() <= self.at.all.criterion();
            if !alone.as_ref().is_ok_and(is_worth_it)
                && let Some(with) = &accompanied
                && self.accompanied(with, &effect, fit.as_ref(), &found)?
            {
                continue;
            }
            match alone {
                Ok(higher) => {
                    let reason = found.summary.clone();
                    self.diagnoses.push(found);
                    self.take(&effect, higher)?;
                    if let Some(Second { name, fit }) = &second
                        && self.at.structure.with(name).is_ok()
                        && let Ok(higher) = self.higher(name, Some(fit), &reason)?
                    {
                        self.take(name, higher)?;
                    }
                }
                Err(Refused { reason, worse }) => {
                    if let Some(higher) = worse {
                        self.case.none_is_open(&self.at, &higher.next, &effect)?;
                        if self.beyond(*higher, &found, second.as_ref())? {
                            continue;
                        }
                    }
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

    fn take(&mut self, effect: &str, higher: Higher) -> Result<(), Stop> {
        self.steps.push(higher.step);
        self.at = higher.next;
        self.exchange(effect, &higher.without)
    }

    /// The next step up, or why there is none.
    fn higher(
        &self,
        effect: &str,
        fit: Option<&ComposedFit>,
        reason: &str,
    ) -> Result<Result<Higher, Refused>, Stop> {
        let climbed = || {
            let watcher = self.case.watcher;
            watcher.says(format!("adding {effect}"), 0, 1);
            let mut next = match fit {
                Some(fit) => self.case.with_found(&self.at, effect, fit)?,
                None => self.case.with(&self.at, effect)?,
            };
            let (dropped, without) = self.drop_superfluous(&mut next, effect)?;
            let step = self.step(&next, Some(effect.to_owned()), dropped, reason.to_owned())?;
            Ok(Higher {
                step,
                next,
                without,
            })
        };
        match climbed() {
            Ok(higher) if self.worse(&higher.step) => Ok(Err(Refused {
                reason: self.why_worse(&higher.step),
                worse: Some(Box::new(higher)),
            })),
            Ok(higher) => Ok(Ok(higher)),
            Err(Stop::Failed(error)) if error.is_of_the_model() => Ok(Err(Refused {
                reason: error.to_string(),
                worse: None,
            })),
            Err(error) => Err(error),
        }
    }

    fn change(&mut self, add: &[String], remove: &[String]) -> Result<(), Stop> {
        for effect in remove {
            let fewer = self.at.structure.without(effect);
            let next = self
                .case
                .baseline(&fewer.map_err(IdentificationError::from)?)?;
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

    /// Effects that earlier steps added and that `next` no longer needs are taken out of it. Those, and, where
    /// there are none, each other with the structure without it.
    fn drop_superfluous(
        &self,
        next: &mut Baseline,
        newest: &str,
    ) -> Result<(Vec<String>, WithoutEach), IdentificationError> {
        let added = self.steps.iter().filter_map(|s| s.added.clone());
        let mut dropped = Vec::new();
        let mut without_each = WithoutEach::new();
        for effect in added.filter(|e| e != newest) {
            if !next.structure.contains(&effect) {
                continue;
            }
            let watcher = self.case.watcher;
            watcher.says(format!("fitting without {effect}"), 0, 1);
            let structure = next.structure.without(&effect)?;
            let fewer = self.case.baseline_from(&structure, &next.all)?;
            let worse_by = fewer.all.criterion() - next.all.criterion();
            if is_superfluous(worse_by) {
                *next = fewer;
                dropped.push(effect);
                without_each.clear();
            } else if dropped.is_empty() {
                without_each.push((effect, fewer));
            }
        }
        Ok((dropped, without_each))
    }

    fn worse(&self, step: &ImprovementStep) -> bool {
        let before = self.steps.last();
        before.is_some_and(|before| is_worse(&before.errors, &step.errors))
    }

    fn why_worse(&self, step: &ImprovementStep) -> String {
        let before = self.steps.last();
        let of_untouched = before.and_then(|b| rise_on_untouched(&b.errors, &step.errors));
        let (events, error) = match of_untouched {
            Some(error) => ("untouched events", error),
            None => ("events not fitted", deciding(&step.errors).error_to_noise),
        };
        format!("the error on {events} rises to {error:.2} times the noise")
    }

    fn step(
        &self,
        at: &Baseline,
        added: Option<String>,
        dropped: Vec<String>,
        reason: String,
    ) -> Result<ImprovementStep, Stop> {
        self.case.none_at_edges(at)?;
        let names = at.structure.names().join(" + ");
        let what = format!("holding {names} against other events");
        self.case.watcher.says(what, 0, 1);
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

/// The effect that a diagnosis names first.
fn claimed(found: &Diagnosis) -> Option<String> {
    let missing = matches!(
        found.status,
        Status::MissingEffect | Status::InstrumentSuspect
    );
    found.answer_set.first().filter(|_| missing).cloned()
}
