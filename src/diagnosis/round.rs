//! One round: a structure fitted, its companions, every effect tried on it, and the decision.

use super::{
    addable::addable,
    anew::Stop,
    before_events::left_before_events,
    beyond::beyond_the_catalogue,
    case::Case,
    claim::{ByItself, answer_set, companions_or_rivals, decisive, reaches},
    departures::departures,
    equals::beside_companions,
    evidence::{Evidence, is_adequate, objections},
    outcome::{GeneralForm, Status},
    part_of::{Whole, whole},
    trials::{Fitted, Goal, Trial, trials},
};
use crate::{
    identification::{
        COMPANION, IdentificationError,
        composed::{Baseline, ComposedFit},
    },
    load_model::{effect::Kind, effects::find},
};

/// What every motor has: left out of the model it makes other effects look missing, so that every
/// trial has it. It is itself reported only when nothing else is.
///
/// `frequency_scaled_power` is none: decision 0018.
pub(super) const COMPANIONS: [&str; 1] = [COMPANION];
/// A companion is kept when it lowers the criterion by this much.
const COMPANION_DELTA_BIC: f64 = -10.0;
/// A claim that leaves more than this share of the misfit is held against what the companions resemble.
const MILD_CLAIM: f64 = 0.5;
/// Firsts from which a pair is sought where one effect does not reach the floor.
const FIRSTS: usize = 2;

/// What a round found.
pub(super) struct Round {
    /// The structure as asked.
    pub(super) asked: Fitted,
    /// The structure that the trials were added to, where a companion came with it.
    pub(super) accompanied: Option<Fitted>,
    /// Best first.
    pub(super) trials: Vec<Trial>,
    pub(super) decision: Decision,
}

/// What a round decided.
pub(super) struct Decision {
    pub(super) status: Status,
    /// Places in the list of trials of the answer set, best first.
    pub(super) answer: Vec<usize>,
    /// Reasons with their figures.
    pub(super) reasons: Vec<String>,
    /// A second effect that the best one needs beside it to reach the floor.
    pub(super) second: Option<Second>,
    /// Where the answer is that something is missing that the catalogue does not have: the general form that explains it
    /// best.
    pub(super) form: Option<GeneralForm>,
}

/// A second effect, and the fit with both.
pub(super) struct Second {
    pub(super) name: &'static str,
    pub(super) fit: ComposedFit,
}

impl Round {
    /// What the trials were added to.
    pub(super) fn base(&self) -> &Fitted {
        self.accompanied.as_ref().unwrap_or(&self.asked)
    }

    /// The answer set by name, best first.
    pub(super) fn names(&self) -> Vec<&str> {
        let answer = self.decision.answer.iter();
        answer.map(|&place| self.trials[place].name()).collect()
    }
}

/// Tries every effect on a fitted structure and decides.
pub(super) fn round(case: &Case<'_>, asked: Baseline) -> Result<Round, Stop> {
    let mut asked = Fitted::new(case, asked);
    let accompanied = companions(case, &asked.baseline)?.map(|with| Fitted::new(case, with));
    let base = accompanied.as_ref().unwrap_or(&asked);
    let names = addable(&base.baseline.structure, case);
    let (base, mut list) = trials(case, base.clone(), &names, Goal::Claim)?;
    case.none_apart(&base, &list)?;
    let accompanied = if accompanied.is_some() {
        // They may only have helped the fit of the structure itself on.
        if let Some(lower) = case.lower_from(&asked.baseline, &base.baseline.all)? {
            asked = Fitted::new(case, lower);
        }
        Some(base)
    } else {
        asked = base;
        None
    };
    let base = accompanied.as_ref().unwrap_or(&asked);
    let mut decision = beyond_the_catalogue(case, base, &list, decide(case, base, &list)?)?;
    if let Some(with) = &accompanied
        && decision.status != Status::CannotJudge
    {
        let judged = if decision.form.is_some() {
            // What explains more than every effect beside the companions is no stand-in for one.
            Judged {
                asked,
                list,
                decision,
            }
        } else if decision.answer.is_empty() {
            by_themselves(case, with, asked, list, decision)?
        } else {
            or_a_rival(case, asked, list, decision)?
        };
        (asked, list, decision) = (judged.asked, judged.list, judged.decision);
    }
    Ok(Round {
        asked,
        accompanied,
        trials: list,
        decision,
    })
}

/// The structure as asked, all trials, and what they decide.
struct Judged {
    asked: Fitted,
    list: Vec<Trial>,
    decision: Decision,
}

/// Nothing else is missing beside the companions: they speak for themselves, unless one only stands in for what it
/// resembles.
fn by_themselves(
    case: &Case<'_>,
    with: &Fitted,
    asked: Fitted,
    mut list: Vec<Trial>,
    mut decision: Decision,
) -> Result<Judged, IdentificationError> {
    let mut names = absent_companions(&asked);
    names.extend(rivals(case, &list, &names));
    let (asked, own) = trials(case, asked, &names, Goal::Claim)?;
    let named = of_companions(case, &list, &own);
    let answer = taken_over(&mut list, own, &named);
    // What only stands in for a companion must explain what is left as any other claim.
    let explains = |place: usize| {
        let evidence = list[place].evidence.as_ref();
        decision.status != Status::UnknownEffect
            || COMPANIONS.contains(&list[place].name())
            || evidence.is_some_and(|e| reaches(e, &case.options.claim))
    };
    if let Some(&place) = answer.first().filter(|&&place| explains(place)) {
        decision = companion_decision(case, with, &list[place], decision, answer);
    }
    Ok(Judged {
        asked,
        list,
        decision,
    })
}

/// A claim beside the companions stands, unless what one of them resembles explains clearly more by itself than the
/// companion and what is claimed together.
fn or_a_rival(
    case: &Case<'_>,
    asked: Fitted,
    mut list: Vec<Trial>,
    mut decision: Decision,
) -> Result<Judged, IdentificationError> {
    let claimed = &list[decision.answer[0]];
    let beside = |e: &Evidence| e.chi_square_after > MILD_CLAIM * e.chi_square_before;
    let mild = claimed.evidence.as_ref().is_some_and(beside);
    let resembled = resembled(&absent_companions(&asked));
    let answered = |name: &&str| decision.answer.iter().any(|&i| list[i].name() == *name);
    let criterion = claimed.fit.as_ref().map(ComposedFit::criterion);
    let (Some(criterion), true, false) = (criterion, mild, resembled.iter().any(answered)) else {
        return Ok(Judged {
            asked,
            list,
            decision,
        });
    };
    let may_be_added = addable(&asked.baseline.structure, case);
    let names: Vec<&'static str> = (may_be_added.into_iter())
        .filter(|name| resembled.contains(name))
        .collect();
    let (asked, own) = trials(case, asked, &names, Goal::Claim)?;
    let needed = criterion - case.options.claim.delta_bic_min;
    let clearly = |trial: &Trial| (trial.fit.as_ref()).is_some_and(|f| f.criterion() <= needed);
    let named: Vec<usize> = (declared(case, &own).into_iter())
        .filter(|&place| clearly(&own[place]))
        .collect();
    if let Some(evidence) = named.first().and_then(|&place| own[place].evidence.clone()) {
        let name = own[named[0]].name();
        let answer = taken_over(&mut list, own, &named);
        decision = Decision {
            status: status_of(&list[answer[0]]),
            reasons: vec![found(name, &evidence)],
            answer,
            second: None,
            form: None,
        };
    }
    Ok(Judged {
        asked,
        list,
        decision,
    })
}

fn absent_companions(asked: &Fitted) -> Vec<&'static str> {
    let absent = |name: &&&str| !asked.baseline.structure.contains(name);
    COMPANIONS.iter().filter(absent).copied().collect()
}

/// Puts trials of the structure as asked in the place of those beside the companions: the companions' own and those
/// `named`, whose places in the list are returned. What a rival that is not named gains beside the companions says more
/// of it.
fn taken_over(list: &mut Vec<Trial>, mut own: Vec<Trial>, named: &[usize]) -> Vec<usize> {
    let named: Vec<&str> = named.iter().map(|&place| own[place].name()).collect();
    own.retain(|trial| named.contains(&trial.name()) || COMPANIONS.contains(&trial.name()));
    list.retain(|trial| !own.iter().any(|alone| alone.name() == trial.name()));
    list.extend(own);
    let place_of = |name: &&str| list.iter().position(|trial| trial.name() == *name);
    named.iter().filter_map(place_of).collect()
}

/// What some companions resemble.
fn resembled(companions: &[&str]) -> Vec<&'static str> {
    let own = companions.iter().filter_map(|companion| find(companion));
    own.flat_map(|effect| effect.declaration().resembles)
        .copied()
        .collect()
}

/// What some companions resemble, and what beside them would lower the criterion by as much as a claim needs.
fn rivals(case: &Case<'_>, list: &[Trial], companions: &[&str]) -> Vec<&'static str> {
    let needed = -case.options.claim.delta_bic_min;
    let resembled = resembled(companions);
    let gains = |trial: &&Trial| {
        let evidence = trial.evidence.as_ref();
        evidence.is_some_and(|e| e.delta_bic <= needed) && resembled.contains(&trial.name())
    };
    list.iter().filter(gains).map(Trial::name).collect()
}

/// Trials that were refitted, with their places.
fn refitted(list: &[Trial]) -> Vec<(usize, Evidence)> {
    let evidence = |(place, trial): (usize, &Trial)| Some((place, trial.evidence.clone()?));
    list.iter().enumerate().filter_map(evidence).collect()
}

/// The answer set of trials, as places in their list.
fn declared(case: &Case<'_>, list: &[Trial]) -> Vec<usize> {
    let options = &case.options.claim;
    let refitted = refitted(list);
    let judged: Vec<(Evidence, bool)> = (refitted.iter())
        .map(|(_, evidence)| (evidence.clone(), objections(evidence, options).is_empty()))
        .collect();
    let chosen = answer_set(&judged, options);
    chosen.into_iter().map(|i| refitted[i].0).collect()
}

/// [`companions_or_rivals`] of trials by themselves, as places in their list; `beside` are those beside the companions.
fn of_companions(case: &Case<'_>, beside: &[Trial], own: &[Trial]) -> Vec<usize> {
    let refitted = refitted(own);
    let by_itself = |(place, evidence): &(usize, Evidence)| {
        let name = own[*place].name();
        let with_companions = beside.iter().find(|trial| trial.name() == name);
        ByItself {
            evidence: evidence.clone(),
            is_companion: COMPANIONS.contains(&name),
            beside: with_companions.map_or(0.0, Trial::delta_bic),
        }
    };
    let list: Vec<ByItself> = refitted.iter().map(by_itself).collect();
    let chosen = companions_or_rivals(&list, &case.options.claim);
    chosen.into_iter().map(|i| refitted[i].0).collect()
}

/// The baseline with the companions that lower the criterion; none where none does.
fn companions(case: &Case<'_>, base: &Baseline) -> Result<Option<Baseline>, IdentificationError> {
    let mut kept: Option<Baseline> = None;
    for name in COMPANIONS {
        let at = kept.as_ref().unwrap_or(base);
        let excluded = case.options.excluded.iter().any(|x| x == name);
        if excluded || at.structure.with(name).is_err() {
            continue;
        }
        case.watcher.says(format!("fitting {name} beside it"), 0, 1);
        let with = at.with(&case.judged, name, &case.composed, case.watcher.cancel)?;
        case.watcher.check()?;
        let gain = |with: &Baseline| with.all.criterion() - at.all.criterion();
        if let Some(with) = with.filter(|w| gain(w) < COMPANION_DELTA_BIC) {
            kept = Some(with);
        }
    }
    Ok(kept)
}

fn decide(case: &Case<'_>, base: &Fitted, list: &[Trial]) -> Result<Decision, IdentificationError> {
    let options = &case.options.claim;
    if case.judged.len() < 2 {
        return Ok(nothing_declared(case, base));
    }
    if let Some(Whole { part, second }) = whole(case, base, list)? {
        return Ok(with_what_it_is_part_of(list, part, second));
    }
    let refitted = refitted(list);
    let judged: Vec<(Evidence, bool)> = (refitted.iter())
        .map(|(_, evidence)| (evidence.clone(), objections(evidence, options).is_empty()))
        .collect();
    let chosen = answer_set(&judged, options);
    let answer: Vec<usize> = chosen.iter().map(|&i| refitted[i].0).collect();
    let answer = beside_companions(case, base, list, answer, &COMPANIONS)?;
    let of_place = |place: &usize| refitted.iter().position(|(known, _)| known == place);
    let told: Vec<usize> = answer.iter().filter_map(of_place).collect();
    let (Some(&best), Some(&place)) = (told.first(), answer.first()) else {
        return Ok(nothing_declared(case, base));
    };
    // Its equals without companions are no others that come near.
    let mut equals = chosen;
    equals.sort_by_key(|i| *i != best);
    let evidence = &judged[best].0;
    let found = found(list[place].name(), evidence);
    let status = status_of(&list[place]);
    let follows = || {
        let fit = list[place].fit.as_ref();
        is_adequate(evidence.chi_square_after, options)
            && fit.is_some_and(|fit| departures(case, fit).is_empty())
    };
    if reaches(evidence, options) || decisive(&judged, &equals, options) || follows() {
        return Ok(Decision {
            status,
            answer,
            reasons: vec![found],
            second: None,
            form: None,
        });
    }
    Ok(match pair(case, base, list, &answer)? {
        Some(pair) => with_second(list, status, answer, found, pair),
        None => Decision {
            status: Status::UnknownEffect,
            answer: Vec::new(),
            reasons: vec![
                found,
                format!(
                    "that is still {:.1} times what the noise leaves, and no second effect of the catalogue brings it there",
                    evidence.chi_square_after / options.floor
                ),
            ],
            second: None,
            form: None,
        },
    })
}

fn status_of(trial: &Trial) -> Status {
    match trial.declaration.kind {
        Kind::Physics => Status::MissingEffect,
        Kind::Instrument => Status::InstrumentSuspect,
    }
}

fn found(name: &str, evidence: &Evidence) -> String {
    let in_turn = match (evidence.gate, evidence.in_turn, evidence.joined) {
        (Some(gate), _, Some(joined)) => format!(
            "; a fit to the others leaves the held-out events open ({:.2} to {:.2}), but what they add to its misfit falls from {:.2} to {:.2}",
            gate.before, gate.after, joined.before, joined.after
        ),
        (Some(gate), Some(in_turn), None) => format!(
            "; the held-out events leave it open ({:.2} to {:.2}), but of all events, each foretold by others, it falls from {:.2} to {:.2}",
            gate.before, gate.after, in_turn.before, in_turn.after
        ),
        _ => String::new(),
    };
    format!(
        "with {name} the misfit of the fitted events falls from {:.2} to {:.2} per sample{in_turn}",
        evidence.chi_square_before, evidence.chi_square_after
    )
}

/// An effect, and beside it what it is part of.
fn with_what_it_is_part_of(list: &[Trial], part: usize, second: Second) -> Decision {
    let evidence = list[part].evidence.as_ref();
    let name = list[part].name();
    let mut reasons: Vec<String> = evidence.map(|e| found(name, e)).into_iter().collect();
    reasons.push(format!(
        "with {} as well, which {name} is part of, it is {:.2}",
        second.name,
        second.fit.chi_square_per_row()
    ));
    Decision {
        status: status_of(&list[part]),
        answer: vec![part],
        reasons,
        second: Some(second),
        form: None,
    }
}

/// The first of a pair, with whom these events do not tell it from.
fn with_second(
    list: &[Trial],
    status: Status,
    mut answer: Vec<usize>,
    found: String,
    pair: Pair,
) -> Decision {
    let reason = format!(
        "{} alone leaves more than the noise; together with {} the misfit is {:.2} per sample",
        list[pair.first].name(),
        pair.second.name,
        pair.second.fit.chi_square_per_row()
    );
    if answer.first() != Some(&pair.first) {
        // Its rivals were those of an effect that alone was not enough.
        answer = vec![pair.first];
    }
    Decision {
        status,
        answer,
        reasons: vec![found, reason],
        second: Some(pair.second),
        form: None,
    }
}

/// Two effects that together explain what one does not.
struct Pair {
    first: usize,
    second: Second,
}

fn pair(
    case: &Case<'_>,
    base: &Fitted,
    list: &[Trial],
    answer: &[usize],
) -> Result<Option<Pair>, IdentificationError> {
    let options = &case.options.claim;
    let mut firsts: Vec<usize> = answer.to_vec();
    firsts.extend((0..list.len()).filter(|i| !answer.contains(i) && list[*i].fit.is_some()));
    let mut best: Option<(f64, Pair)> = None;
    for first in firsts.into_iter().take(FIRSTS) {
        let Some(fit) = &list[first].fit else {
            continue;
        };
        let base = base.baseline.completed(
            &case.judged,
            fit.clone(),
            list[first].name(),
            &case.composed,
            case.watcher.cancel,
        )?;
        let names = addable(&base.structure, case);
        let (_, seconds) = trials(case, Fitted::new(case, base), &names, Goal::Reach)?;
        let found = seconds.iter().find(|t| {
            t.evidence
                .as_ref()
                .is_some_and(|e| objections(e, options).is_empty() && reaches(e, options))
        });
        let Some((second, fit)) = found.and_then(|t| Some((t, t.fit.clone()?))) else {
            continue;
        };
        let criterion = fit.criterion();
        let at_floor = fit.chi_square_per_row() < options.reached_floors * options.floor;
        if best.as_ref().is_none_or(|(known, _)| criterion < *known) {
            let name = second.name();
            let second = Second { name, fit };
            best = Some((criterion, Pair { first, second }));
        }
        if at_floor {
            break;
        }
    }
    Ok(best.map(|(_, pair)| pair))
}

fn nothing_declared(case: &Case<'_>, base: &Fitted) -> Decision {
    let options = &case.options.claim;
    let chi_square = base.chi_square();
    let (status, reason) = if case.judged.len() < 2 {
        (
            Status::CannotJudge,
            "one event cannot show whether what explains it holds for others".to_owned(),
        )
    } else if is_adequate(chi_square, options) {
        let departures = departures(case, &base.baseline.all);
        if !departures.is_empty() {
            return unknown_where(case, chi_square, departures);
        }
        let before = left_before_events(case, &base.baseline.all);
        let before = before.map_or_else(String::new, |left| {
            format!("; before the disturbances {left:.2} are left")
        });
        (
            Status::Adequate,
            format!(
                "the misfit is {chi_square:.2} per sample, where the noise alone leaves at most about {:.1}{before}",
                options.floor
            ),
        )
    } else {
        (
            Status::UnknownEffect,
            format!(
                "the misfit is {chi_square:.2} per sample, {:.1} times what the noise leaves, and no effect of the catalogue explains it",
                chi_square / options.floor
            ),
        )
    };
    Decision {
        status,
        answer: Vec::new(),
        reasons: vec![reason],
        second: None,
        form: None,
    }
}

/// The misfit says adequate, but some events depart from the model for a while.
fn unknown_where(case: &Case<'_>, chi_square: f64, departures: Vec<String>) -> Decision {
    let mut reasons = vec![format!(
        "the misfit is {chi_square:.2} per sample, but {} of {} events depart from the model for a while, and no effect of the catalogue explains it",
        departures.len(),
        case.judged.len()
    )];
    reasons.extend(departures);
    Decision {
        status: Status::UnknownEffect,
        answer: Vec::new(),
        reasons,
        second: None,
        form: None,
    }
}

fn companion_decision(
    case: &Case<'_>,
    with: &Fitted,
    own: &Trial,
    before: Decision,
    answer: Vec<usize>,
) -> Decision {
    let chi_square = with.chi_square();
    let enough = is_adequate(chi_square, &case.options.claim);
    let after = own
        .evidence
        .as_ref()
        .map_or(chi_square, |e| e.chi_square_after);
    let mut reasons = vec![format!(
        "with {} the misfit is {after:.2} per sample",
        own.name()
    )];
    if !enough {
        reasons.extend(before.reasons);
    }
    Decision {
        status: status_of(own),
        answer,
        reasons,
        second: None,
        form: None,
    }
}
