//! A phasor window longer than those of the standard: asked of the voltages before any effect is tried on the load.
//! What the instrument does to the jumps shows in every event, whatever the model of the load, and as long as it is
//! not accounted for, effects of the load are named in its place.

use super::{
    addable::RATE_TOLERANCE,
    anew::{Asked, with_settled_events},
    case::Case,
    convincing::fallen,
    diagnose::report,
    improve::{Change, improve_settled, start},
    options::{DiagnosisOptions, EventSplit},
    outcome::{Candidate, Diagnosis, Improvement, ImprovementStep, Status, StructureErrors},
    round::{Decision, Round},
    trials::Fitted,
};
use crate::{
    disturbance::Window,
    identification::{
        FilterChoice, FittedStructure, IdentificationError, LongerWindow, PhasorFilter,
        composed::{Baseline, ComposedFit},
        composed_parameters,
        intake::{LONGER_WINDOW, PreparedEvent, longer_window},
    },
    load_model::{Structure, effect::Kind, effects},
};

/// The window that the voltages show, where it is not accounted for yet.
pub(super) fn shown(asked: &Asked<'_>) -> Option<LongerWindow> {
    let excluded = asked.options.excluded.iter().any(|e| e == LONGER_WINDOW);
    let slowest = asked.windows.iter().map(|w| w.record.rate_fps);
    let may = !excluded
        && is_fast_enough(slowest.fold(f64::INFINITY, f64::min))
        && asked.options.identification.intake.filter == FilterChoice::Auto
        && asked.structure.with(LONGER_WINDOW).is_ok();
    may.then(|| longer_window(asked.windows)).flatten()
}

/// Whether there are samples enough to show a window.
fn is_fast_enough(rate_fps: f64) -> bool {
    let effect = effects::find(LONGER_WINDOW);
    effect.is_some_and(|effect| effect.declaration().needs.rate_fps <= RATE_TOLERANCE * rate_fps)
}

/// Whether events are seen through a longer window.
pub(super) fn is_accounted_for(events: &[PreparedEvent]) -> bool {
    let longer = |event: &PreparedEvent| matches!(event.filter, Some(PhasorFilter::Longer(_)));
    events.iter().any(longer)
}

/// The voltages speak for themselves, and what else the model lacks may show less in events that are seen wrongly: errors
/// may rise by this share, not more.
const RISE_MAX: f64 = 0.1;

/// Whether errors rise by more than that.
fn rises(before: &StructureErrors, after: &StructureErrors) -> bool {
    let quoted = |errors: &StructureErrors| errors.quoted().error_to_noise;
    let judged = StructureErrors::judged_error_to_noise;
    let more = |before: f64, after: f64| after > (1.0 + RISE_MAX) * before;
    more(quoted(before), quoted(after)) || more(judged(before), judged(after))
}

/// Share of the events with edges in which a window of the standard explains jumps that acquits the instrument.
const STANDARD_SHARE: f64 = 0.5;

/// Whether the jumps of the voltage are what a window of the standard makes of them.
pub(super) fn are_standard(events: &[PreparedEvent]) -> bool {
    let with_edges = || (events.iter()).filter(|event| event.near_edge.contains(&true));
    let standard = |event: &&PreparedEvent| {
        let seen = event.filter.is_some_and(PhasorFilter::is_of_the_standard);
        seen && !event.edges.is_empty()
    };
    let (all, explained) = (with_edges().count(), with_edges().filter(standard).count());
    all > 0 && explained as f64 >= STANDARD_SHARE * all as f64
}

/// That the window needs no trial; none where it was tried, or may not be added.
pub(super) fn acquitted(case: &Case<'_>, round: &Round) -> Option<Candidate> {
    let excluded = case.options.excluded.iter().any(|e| e == LONGER_WINDOW);
    let tried = round.trials.iter().any(|t| t.name() == LONGER_WINDOW);
    let may = round.base().baseline.structure.with(LONGER_WINDOW).is_ok();
    if excluded || tried || !may || !is_fast_enough(case.rate_fps()) {
        return None;
    }
    if !are_standard(&case.judged) {
        return None;
    }
    let edges: usize = case.judged.iter().map(|event| event.edges.len()).sum();
    Some(Candidate {
        effect: LONGER_WINDOW.to_owned(),
        kind: Kind::Instrument,
        score_share: 0.0,
        visibility: 1.0,
        delta_bic: None,
        held_out_error_before: None,
        held_out_error_after: None,
        share_of_best_gain: None,
        group: vec![LONGER_WINDOW.to_owned()],
        would_separate: String::new(),
        separating_events: Vec::new(),
        parameters: Vec::new(),
        model: None,
        declared: false,
        refused: vec![format!(
            "{edges} jumps of the voltage are spread as windows of the standard spread them: this is no longer one"
        )],
    })
}

/// The structure as asked, and what it says once the longer window is accounted for.
pub(super) struct Seen {
    pub(super) step: ImprovementStep,
    pub(super) diagnosis: Diagnosis,
    /// Change of the criterion by the window.
    delta_bic: f64,
}

/// Fits the structure with events seen as the standard has it and through the longer window; none where the errors clearly
/// rise by it.
pub(super) fn seen(
    asked: &Asked<'_>,
    window: LongerWindow,
) -> Result<Option<Seen>, IdentificationError> {
    let with = asked.structure.with(LONGER_WINDOW)?;
    let Asked {
        site,
        windows,
        options,
        watcher,
        ..
    } = *asked;
    with_settled_events(asked, |case, base| {
        watcher.says(
            format!("seeing all events through {}", window.in_words()),
            0,
            1,
        );
        let step = start(case, base.clone())?;
        let named = named(options, &case.events().gate, &case.events().untouched);
        let accounted = Case::new(site, windows, &with, &named, &case.changes, watcher);
        let through = match accounted.and_then(|c| Ok((c.baseline(&with)?.all, c))) {
            Ok((fit, case)) => Through { case: &case, fit }.judged(&with, &step.errors),
            Err(error) => Err(error),
        };
        match through {
            Ok(Some(through)) => {
                let diagnosis = diagnosis(case, base, window, &step.errors, &through)?;
                let delta_bic = diagnosis.candidates[0].delta_bic.unwrap_or(0.0);
                Ok(Some(Seen {
                    step,
                    diagnosis,
                    delta_bic,
                }))
            }
            Ok(None) => Ok(None),
            Err(error) if error.is_of_the_model() => Ok(None),
            Err(error) => Err(error.into()),
        }
    })
}

/// The settings with these sets of events.
fn named(options: &DiagnosisOptions, gate: &[String], untouched: &[String]) -> DiagnosisOptions {
    DiagnosisOptions {
        split: EventSplit::Named {
            gate: gate.to_vec(),
            untouched: untouched.to_vec(),
        },
        ..options.clone()
    }
}

/// The structure fitted to events seen through the longer window.
struct Through<'a, 'b> {
    case: &'b Case<'a>,
    fit: ComposedFit,
}

/// What of that is told.
struct Told {
    errors: StructureErrors,
    gate_misfit: Option<f64>,
    fit: ComposedFit,
    model: FittedStructure,
}

impl Through<'_, '_> {
    /// None where the errors are clearly worse than without.
    fn judged(
        self,
        structure: &Structure,
        before: &StructureErrors,
    ) -> Result<Option<Told>, IdentificationError> {
        let fit = self.case.narrowed(&self.fit);
        let errors = self.case.errors(structure, &fit)?;
        if rises(before, &errors) {
            return Ok(None);
        }
        Ok(Some(Told {
            errors,
            gate_misfit: self.case.gate_misfit(&self.fit),
            model: FittedStructure::of(&fit, &self.case.trend),
            fit,
        }))
    }
}

/// That the instrument, not the load, explains what is left.
fn diagnosis(
    case: &Case<'_>,
    base: Baseline,
    window: LongerWindow,
    before: &StructureErrors,
    told: &Told,
) -> Result<Diagnosis, IdentificationError> {
    let candidate = candidate(case, &base, before, told);
    let spread = format!(
        "the jumps of the voltage are spread as by {}; windows of the standard have two cycles at most",
        window.in_words()
    );
    let round = Round {
        asked: Fitted::new(case, base),
        accompanied: None,
        trials: Vec::new(),
        decision: Decision {
            status: Status::InstrumentSuspect,
            answer: Vec::new(),
            reasons: vec![fallen(LONGER_WINDOW, before, &told.errors), spread],
            second: None,
            form: None,
        },
    };
    Ok(Diagnosis {
        summary: format!(
            "The instrument, not the load, explains what is left: {LONGER_WINDOW}, {}.",
            window.in_words()
        ),
        candidates: vec![candidate],
        answer_set: vec![LONGER_WINDOW.to_owned()],
        ..report(case, &round)?
    })
}

/// Samples have other weights behind another window, so that criteria are not comparable: the change is that of the plain
/// residual over noise.
fn candidate(case: &Case<'_>, base: &Baseline, before: &StructureErrors, told: &Told) -> Candidate {
    let rows: usize = case.judged.iter().map(PreparedEvent::rows).sum();
    let rows = rows as f64;
    let square = |errors: &StructureErrors| errors.judged_error_to_noise().powi(2);
    let added = told.fit.free.len().saturating_sub(base.all.free.len());
    let delta_bic =
        rows * (square(&told.errors) - square(before)) + added as f64 * rows.max(1.0).ln();
    Candidate {
        effect: LONGER_WINDOW.to_owned(),
        kind: Kind::Instrument,
        score_share: (1.0 - square(&told.errors) / square(before)).clamp(0.0, 1.0),
        visibility: 1.0,
        delta_bic: Some(delta_bic),
        held_out_error_before: case.gate_misfit(&base.all).map(f64::sqrt),
        held_out_error_after: told.gate_misfit.map(f64::sqrt),
        share_of_best_gain: Some(1.0),
        group: vec![LONGER_WINDOW.to_owned()],
        would_separate: String::new(),
        separating_events: Vec::new(),
        parameters: composed_parameters(&told.fit, LONGER_WINDOW),
        model: Some(told.model.clone()),
        declared: true,
        refused: Vec::new(),
    }
}

/// [`improve`](super::improve()) with the window accounted for in its first step; none where the errors clearly rise by
/// it, or where it was not to be added.
pub(super) fn improvement(
    asked: &Asked<'_>,
    change: &Change,
    window: LongerWindow,
) -> Result<Option<Improvement>, IdentificationError> {
    let inner = match change {
        Change::UntilAdequate => Change::UntilAdequate,
        Change::ByHand { add, remove } if add.iter().any(|name| name == LONGER_WINDOW) => {
            Change::ByHand {
                add: (add.iter().filter(|name| *name != LONGER_WINDOW).cloned()).collect(),
                remove: remove.clone(),
            }
        }
        Change::ByHand { .. } => return Ok(None),
    };
    let with = asked.structure.with(LONGER_WINDOW)?;
    let accounted = Asked {
        structure: &with,
        ..*asked
    };
    let done = match improve_settled(&accounted, &inner) {
        Ok(done) => done,
        Err(error) if error.is_of_the_model() => return Ok(None),
        Err(error) => return Err(error),
    };
    let events = &done.last.events;
    let refused = |id: &String| events.refused.iter().any(|(event, _)| event == id);
    let windows: Vec<Window> = (asked.windows.iter())
        .filter(|window| !refused(&window.id))
        .cloned()
        .collect();
    let options = named(asked.options, &events.gate, &events.untouched);
    let before = Asked {
        windows: &windows,
        options: &options,
        ..*asked
    };
    let seen = seen(&before, window)?;
    Ok(seen.map(|seen| joined(seen, done, *change == Change::UntilAdequate)))
}

/// [`improve`](super::improve()) with the window taken out by hand in its first step: from there all events are seen as
/// the standard has it. None where it was not to be taken out.
pub(super) fn removal(
    asked: &Asked<'_>,
    change: &Change,
) -> Result<Option<Improvement>, IdentificationError> {
    let Change::ByHand { add, remove } = change else {
        return Ok(None);
    };
    if !remove.iter().any(|name| name == LONGER_WINDOW) {
        return Ok(None);
    }
    let without = asked.structure.without(LONGER_WINDOW)?;
    let inner = Change::ByHand {
        add: add.clone(),
        remove: (remove.iter().filter(|name| *name != LONGER_WINDOW).cloned()).collect(),
    };
    let unaccounted = Asked {
        structure: &without,
        ..*asked
    };
    let mut done = improve_settled(&unaccounted, &inner)?;
    let events = &done.last.events;
    let options = named(asked.options, &events.gate, &events.untouched);
    let before = Asked {
        options: &options,
        ..*asked
    };
    let before = with_settled_events(&before, start)?;
    if let Some(first) = done.steps.first_mut() {
        first.dropped = vec![LONGER_WINDOW.to_owned()];
        "removed by hand".clone_into(&mut first.reason);
    }
    done.steps.insert(0, before);
    Ok(Some(done))
}

/// The step to the window before the steps from there.
fn joined(seen: Seen, mut done: Improvement, found: bool) -> Improvement {
    let Seen {
        step,
        diagnosis,
        delta_bic,
    } = seen;
    for later in &mut done.steps {
        later.delta_bic += delta_bic;
    }
    if let Some(first) = done.steps.first_mut() {
        first.added = Some(LONGER_WINDOW.to_owned());
        first.reason = if found {
            diagnosis.summary.clone()
        } else {
            "added by hand".to_owned()
        };
    }
    done.steps.insert(0, step);
    if found {
        done.diagnoses.insert(0, diagnosis);
    }
    done
}
