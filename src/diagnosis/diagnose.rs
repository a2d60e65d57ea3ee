//! From windows to a diagnosis.

use super::{
    addable::{addable, hidden_by_rate},
    anew::{Asked, with_settled_events},
    case::{Case, Watcher},
    convincing::convincing,
    in_the_way::WithoutIt,
    longer_window::{acquitted, seen, shown},
    not_named::why_not_named,
    options::{DiagnosisOptions, Progress},
    outcome::{
        Candidate, Diagnosis, DiagnosisCost, EffectWorth, EventSets, GeneralForm, Status,
        StructureErrors, Unexplained, Untestable,
    },
    round::{Decision, Round},
    separating::{Plain, Silent, ordinary, separated, would_show},
    trials::Trial,
    unexplained,
    where_it_fails::{failure, pooled},
    worth::{effects_of, superfluous_in_words, worth_of},
};
use crate::{
    disturbance::Window,
    identification::{
        FittedStructure, IdentificationError, composed_parameters, intake::PreparedEvent,
        relay_edges::amplitude as amplitude_of,
    },
    load_model::{
        Structure,
        effect::{Declaration, Parameter, Role},
        effects,
    },
    measurement::Site,
};

/// An amplitude shows when it is this many of its standard errors.
const DETECTABLE_ERRORS: f64 = 4.0;

/// Judges `structure` on the windows of a site and names what is missing in it.
///
/// Deterministic: the same windows and options give the same diagnosis, whatever the number of
/// threads and the order of the windows. Events that cannot be judged do not fail the call: the
/// diagnosis says [`Status::CannotJudge`] and why.
///
/// # Errors
///
/// [`IdentificationError::Structure`] when the structure cannot be composed,
/// [`IdentificationError::Cancelled`] when `cancel` said so.
pub fn diagnose(
    site: &Site,
    windows: &[Window],
    structure: &[String],
    options: &DiagnosisOptions,
    progress: &(dyn Fn(Progress) + Sync),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Diagnosis, IdentificationError> {
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
    let of_window = match shown(&asked) {
        Some(window) => seen(&asked, window),
        None => Ok(None),
    };
    let judged = of_window.and_then(|seen| match seen {
        Some(seen) => Ok(seen.diagnosis),
        None => of_the_load(&asked),
    });
    match judged {
        Err(error)
            if error.is_of_the_model()
                || matches!(error, IdentificationError::NoUsableEvent { .. }) =>
        {
            Ok(cannot_judge(site, structure, &error))
        }
        other => other,
    }
}

/// The diagnosis where the instrument's window is no longer than the standard's, or is accounted for.
fn of_the_load(asked: &Asked<'_>) -> Result<Diagnosis, IdentificationError> {
    with_settled_events(asked, |case, base| {
        case.none_at_edges(&base)?;
        if let Some(WithoutIt { case, round, .. }) = case.without_what_is_in_the_way(&base)? {
            return Ok(with_worth(&case, &round)?);
        }
        let (round, closer) = case.round(&base)?;
        case.none_contradicts(&round)?;
        Ok(with_worth(closer.as_ref().unwrap_or(case), &round)?)
    })
}

/// What a round says, and what the effects that the structure has already are worth.
fn with_worth(case: &Case<'_>, round: &Round) -> Result<Diagnosis, IdentificationError> {
    let at = &round.asked.baseline;
    let effects = worth_of(case, at, &effects_of(at))?;
    Ok(report(case, round)?.with_worth(effects))
}

impl Diagnosis {
    /// With what the effects that the structure has already are worth.
    #[must_use]
    pub(super) fn with_worth(mut self, effects: Vec<EffectWorth>) -> Self {
        let untouched = self.baseline.untouched.as_ref();
        let error = untouched.map(|of| of.error_to_noise);
        self.reasons.extend(superfluous_in_words(&effects, error));
        self.effects = effects;
        self
    }
}

fn cannot_judge(site: &Site, structure: &[String], error: &IdentificationError) -> Diagnosis {
    let refused = match error {
        IdentificationError::NoUsableEvent { refused } => refused.clone(),
        _ => Vec::new(),
    };
    Diagnosis {
        site: site.name.clone(),
        structure: structure.to_vec(),
        status: Status::CannotJudge,
        summary: format!("Nothing can be said of this model: {error}."),
        reasons: vec![error.to_string()],
        events: EventSets {
            refused,
            ..EventSets::default()
        },
        baseline: StructureErrors::default(),
        noise_floor: ERROR_TO_NOISE_FLOOR,
        segments: Vec::new(),
        failures: Vec::new(),
        effects: Vec::new(),
        candidates: Vec::new(),
        answer_set: Vec::new(),
        untestable: Vec::new(),
        unexplained: None,
        model: None,
        cost: DiagnosisCost::default(),
    }
}

/// Root mean square of residual over noise that a perfect model leaves, edges included
/// (`docs/validation.md`, generated sites).
pub const ERROR_TO_NOISE_FLOOR: f64 = 1.1;

/// What a round says, in words and figures.
///
/// [`IdentificationError::NotSimulated`] as [`Case::errors`].
pub(super) fn report(case: &Case<'_>, round: &Round) -> Result<Diagnosis, IdentificationError> {
    case.watcher
        .says("comparing with the measurements".to_owned(), 0, 1);
    let structure = &round.asked.baseline.structure;
    let fit = &case.narrowed(&round.asked.baseline.all);
    let curves = case.curves(structure, fit)?;
    let failures: Vec<_> = curves
        .iter()
        .map(|(event, curves)| failure(event, curves))
        .collect();
    let ordinary = ordinary(case);
    let candidates = candidates(case, round, &ordinary);
    let answer_set: Vec<String> = round.names().into_iter().map(str::to_owned).collect();
    let trials = || round.trials.iter();
    let unexplained = if round.decision.status == Status::UnknownEffect {
        let closest = &round.base().baseline;
        let curves = case.curves(&closest.structure, &closest.all)?;
        let (events, curves): (Vec<_>, Vec<_>) = curves.into_iter().unzip();
        with_form(unexplained::describe(&events, &curves), &round.decision)
    } else {
        None
    };
    let baseline = case.errors(structure, fit)?;
    Ok(Diagnosis {
        site: case.site.name.clone(),
        structure: structure.names(),
        status: round.decision.status,
        summary: summary(round, &answer_set),
        reasons: convincing(case, round, fit, &baseline)
            .into_iter()
            .chain(round.decision.reasons.iter().cloned())
            .chain(case.changes.told())
            .collect(),
        events: case.events(),
        baseline,
        noise_floor: ERROR_TO_NOISE_FLOOR,
        segments: pooled(&failures),
        failures,
        effects: Vec::new(),
        candidates,
        answer_set,
        untestable: silent(case, round, &ordinary)
            .into_iter()
            .chain(too_slow(case, structure))
            .chain(without_value(case, round))
            .collect(),
        unexplained,
        model: Some(FittedStructure::of(fit, &case.trend)),
        cost: DiagnosisCost {
            simulations: trials()
                .filter_map(|t| t.fit.as_ref())
                .map(|f| f.evaluations)
                .sum(),
            refits: trials().filter(|t| t.tried).count() as u64,
            seconds: 0.0,
        },
    })
}

/// A description with the general form that was found.
fn with_form(described: Option<Unexplained>, decision: &Decision) -> Option<Unexplained> {
    let form = decision.form.as_ref();
    let of_form = |form: &GeneralForm| Unexplained {
        signature: format!("{}.", form.title),
        terms: Vec::new(),
        effect_file: None,
        general_form: None,
    };
    let described = described.or_else(|| form.map(of_form));
    described.map(|described| Unexplained {
        general_form: form.cloned(),
        ..described
    })
}

fn summary(round: &Round, answer: &[String]) -> String {
    let rivals = match answer {
        [] | [_] => String::new(),
        [_, others @ ..] => format!(
            " (these events do not separate it from {})",
            others.join(", ")
        ),
    };
    let first = answer.first().map_or("", String::as_str);
    match round.decision.status {
        Status::Adequate => {
            "The model follows these events: nothing is missing that they could show.".to_owned()
        }
        Status::MissingEffect => match &round.decision.second {
            None => format!("The model lacks {first}{rivals}."),
            Some(second) => format!(
                "The model lacks {first}{rivals}, and besides it {}.",
                second.name
            ),
        },
        Status::InstrumentSuspect => {
            format!("The instrument, not the load, explains what is left: {first}{rivals}.")
        }
        Status::UnknownEffect => {
            "Something is missing that no effect of the catalogue describes.".to_owned()
        }
        Status::CannotJudge => "These events do not allow a judgement.".to_owned(),
    }
}

/// Why an effect was not refitted.
pub(super) const SCREENED_OUT: &str = "the linear screen finds too little of it in the residuals";

impl Candidate {
    /// Whether the linear screen alone speaks against it.
    #[must_use]
    pub fn is_screened_out(&self) -> bool {
        self.refused.as_slice() == [SCREENED_OUT]
    }
}

/// Places of the trials, those of the answer set first.
fn in_order(round: &Round) -> impl Iterator<Item = usize> {
    let answer = &round.decision.answer;
    let others = (0..round.trials.len()).filter(|i| !answer.contains(i));
    answer.iter().copied().chain(others)
}

fn candidates(
    case: &Case<'_>,
    round: &Round,
    ordinary: &[(Plain, PreparedEvent)],
) -> Vec<Candidate> {
    let answer = &round.decision.answer;
    let best_gain = round
        .trials
        .iter()
        .map(|t| -t.delta_bic())
        .filter(|g| g.is_finite())
        .fold(0.0, f64::max);
    let listed = in_order(round).map(|i| (i, &round.trials[i]));
    let named: Vec<&Trial> = answer.iter().map(|&i| &round.trials[i]).collect();
    let apart = separated(case, ordinary, &named);
    let candidate = |(place, trial): (usize, &Trial)| {
        let evidence = trial.evidence.as_ref();
        let gate = evidence.and_then(|e| e.gate);
        let declared = answer.contains(&place);
        let refused = if declared {
            Vec::new()
        } else {
            why_not_named(case, round, trial)
        };
        // What may be added is shown as it would be published.
        let fit = trial.fit.as_ref().map(|fit| {
            if declared {
                case.narrowed(fit)
            } else {
                fit.clone()
            }
        });
        let grouped = declared && answer.len() > 1;
        let own = answer.iter().position(|i| *i == place);
        let separated = own.and_then(|own| apart.get(own).cloned());
        let separated = separated.unwrap_or_default();
        let names = || {
            answer
                .iter()
                .map(|&i| round.trials[i].name().to_owned())
                .collect()
        };
        let group = if grouped {
            names()
        } else {
            vec![trial.name().to_owned()]
        };
        Candidate {
            effect: trial.name().to_owned(),
            kind: trial.declaration.kind,
            score_share: trial.score_share,
            visibility: trial.score.visibility,
            delta_bic: evidence.map(|e| e.delta_bic),
            held_out_error_before: gate.map(|g| g.before.sqrt()),
            held_out_error_after: gate.map(|g| g.after.sqrt()),
            share_of_best_gain: evidence
                .map(|e| (-e.delta_bic / best_gain).clamp(0.0, 1.0))
                .filter(|s| s.is_finite()),
            would_separate: separated.words,
            separating_events: separated.events,
            group,
            parameters: fit
                .as_ref()
                .map(|fit| composed_parameters(fit, trial.name()))
                .unwrap_or_default(),
            model: fit
                .as_ref()
                .map(|fit| FittedStructure::of(fit, &case.trend)),
            declared,
            refused,
        }
    };
    listed
        .map(candidate)
        .chain(acquitted(case, round))
        .collect()
}

/// The instruments that so few samples per second cannot show.
fn too_slow(case: &Case<'_>, structure: &Structure) -> Vec<Untestable> {
    let unseen = |declaration: &'static Declaration| {
        let (parameter, meaningful) = first_amplitude(declaration)?;
        Some(Untestable {
            effect: declaration.name.to_owned(),
            smallest_detectable_amplitude: f64::INFINITY,
            meaningful_amplitude: meaningful,
            amplitude: parameter.name.to_owned(),
            unit: parameter.unit.to_owned(),
            needs: format!(
                "{} frames/s, these events have {}",
                declaration.needs.rate_fps,
                case.rate_fps()
            ),
        })
    };
    let hidden = hidden_by_rate(structure, case).into_iter();
    hidden.filter_map(unseen).collect()
}

/// The effects that could not be looked for, because they have no finite value in some event.
fn without_value(case: &Case<'_>, round: &Round) -> Vec<Untestable> {
    let base = &round.base().baseline;
    let silent = |name: &&'static str| round.trials.iter().all(|trial| trial.name() != *name);
    let unseen = |name: &'static str| {
        let reason = case.without_value(base, name)?;
        let declaration = effects::find(name)?.declaration();
        let (parameter, meaningful) = first_amplitude(declaration)?;
        Some(Untestable {
            effect: name.to_owned(),
            smallest_detectable_amplitude: f64::INFINITY,
            meaningful_amplitude: meaningful,
            amplitude: parameter.name.to_owned(),
            unit: parameter.unit.to_owned(),
            needs: reason.to_string(),
        })
    };
    let addable = addable(&base.structure, case).into_iter();
    addable.filter(silent).filter_map(unseen).collect()
}

/// The amplitude that an effect is judged by, and the smallest worth reporting.
fn first_amplitude(declaration: &Declaration) -> Option<(&Parameter, f64)> {
    let parameter = declaration.parameters.iter().find(|p| p.is_amplitude())?;
    match parameter.role {
        Role::OneSidedAmplitude { meaningful } | Role::TwoSidedAmplitude { meaningful } => {
            Some((parameter, meaningful))
        }
        _ => None,
    }
}

/// The largest amplitude there can be. Of a share the search may go beyond the whole, a load cannot.
fn largest(parameter: &Parameter) -> f64 {
    let range = (parameter.upper - parameter.neutral).max(parameter.neutral - parameter.lower);
    if parameter.name == "share" {
        range.min(1.0)
    } else {
        range
    }
}

/// The effects of which less would have shown than is worth reporting, and what would show them.
fn silent(case: &Case<'_>, round: &Round, ordinary: &[(Plain, PreparedEvent)]) -> Vec<Untestable> {
    let all = round.trials.iter();
    let (silent, amplitudes): (Vec<Untestable>, Vec<Silent<'_>>) =
        all.filter_map(|trial| untestable(round, trial)).unzip();
    let base = &round.base().baseline;
    let needed = DETECTABLE_ERRORS.powi(2) * round.base().chi_square().max(1.0);
    let scatter = &case.composed.scatter;
    let fitted = (&base.structure, &base.all);
    let shows = would_show(ordinary, fitted, &amplitudes, needed, scatter);
    (silent.into_iter().zip(shows))
        .map(|(silent, shows)| Untestable {
            needs: format!("{shows}; in general {}", silent.needs),
            ..silent
        })
        .collect()
}

/// The smallest amplitude that would have shown, where that is more than what would be worth
/// reporting.
fn untestable<'t>(round: &Round, trial: &'t Trial) -> Option<(Untestable, Silent<'t>)> {
    let declaration = trial.declaration;
    let (amplitude, meaningful) = first_amplitude(declaration)?;
    let misfit = round.base().chi_square().max(1.0).sqrt();
    let detectable = DETECTABLE_ERRORS * misfit * trial.score.amplitude_error;
    let found = trial.fit.as_ref().is_some_and(|fit| {
        let (value, least) = amplitude_of(declaration, fit);
        value > least && trial.delta_bic() < 0.0
    });
    if detectable <= meaningful || found {
        return None;
    }
    let untestable = Untestable {
        effect: trial.name().to_owned(),
        smallest_detectable_amplitude: if detectable < largest(amplitude) {
            detectable
        } else {
            f64::INFINITY
        },
        meaningful_amplitude: meaningful,
        amplitude: amplitude.name.to_owned(),
        unit: amplitude.unit.to_owned(),
        needs: declaration.needs.separating_event.to_owned(),
    };
    let silent = Silent {
        declaration,
        amplitude,
        size: meaningful,
        shown: detectable.min(largest(amplitude)),
    };
    Some((untestable, silent))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load_model::effects;

    #[test]
    fn no_share_is_larger_than_the_whole() {
        let of = |effect: &str| {
            let declaration = effects::find(effect).unwrap().declaration();
            let (parameter, _) = first_amplitude(declaration).unwrap();
            (parameter.name, parameter.upper, largest(parameter))
        };
        let (name, upper, most) = of("low_voltage_conversion");
        assert!(
            name == "share" && upper > 1.0 && most <= 1.0,
            "{upper} {most}"
        );
        let (_, upper, most) = of("saturation");
        assert!((most - upper).abs() < 1e-12, "{upper} {most}");
    }
}
