//! Every effect of the catalogue tried on top of a fitted structure: screened by its linear score,
//! the best refitted, and those that may be claimed held against the gate.

use super::{
    as_every_motor::times_every_motor,
    case::Case,
    claim::{reached_below, told_apart, told_share_of_left},
    evidence::{Evidence, GateEvidence, is_refused_by_gate_alone, objections},
    further_starts::{from_other_motors, rivals_from_the_best, with_the_motor_of_another},
};
use crate::{
    identification::{
        IdentificationError, ParameterEstimate,
        composed::{self, Baseline, ComposedFit, Ground, Score, Screened},
        composed_parameters,
        relay_edges::{amplitude, lowest_pu, shows_no_part},
    },
    load_model::{
        effect::{Declaration, Kind, Parameter},
        effects,
    },
};

/// A score below this many times the logarithm of the number of rows cannot win by any criterion.
const HOPELESS_GAIN: f64 = 1.0;
/// Nor one below this part of the least fall that a claim needs: refits gained up to five times their
/// score.
const HOPELESS_SHARE: f64 = 0.1;
/// Where the model leaves more than this per row, a score says little of what has a threshold: it is
/// refitted whatever its share.
pub(super) const FAR_PER_ROW: f64 = 10.0;
/// An instrument's error is no simpler cause than the load where it is so many deviations from what is believed of it.
const ORDINARY_DEVIATIONS: f64 = 2.0;
/// So many of the best trials are held against the gate, whatever else speaks against them.
const GATED_MIN: usize = 3;

/// Effects that gain at least this share of what the best one gains are fitted to the end.
const REFINED_SHARE: f64 = 0.4;
/// So many of them at most, the best sketches first ...
const REFINED_MAX: usize = 5;
/// ... and, once the events are followed (less than this per row), ...
pub(super) const FOLLOWED: f64 = 2.0;
/// ... none whose sketch leaves more than this many times what the best one leaves.
const BEATEN: f64 = 10.0;

/// A rival of an effect that brings the misfit down to the noise must come this many times as near as what is not told from
/// it does, ...
const RIVAL_OF_REACHED: f64 = 2.0;
/// ... one of an effect with which the events are followed down to this many times what that one leaves.
const RIVAL_OF_FOLLOWED: f64 = 2.0;
/// ... and one of an effect that leaves more than that, but a score still says something, to this many times.
const RIVAL_OF_NEAR: f64 = 3.0;

/// An effect that leaves less than this share of what was left before may have helped the structure's own fit
/// on, ...
const LOWERED_SHARE: f64 = 0.5;
/// ... which is looked after in all but the last of so many rounds of trials.
const LOWERED_MAX: usize = 3;

/// One effect on top of a structure.
pub(super) struct Trial {
    pub(super) declaration: &'static Declaration,
    /// Its best score.
    pub(super) score: Score,
    /// Share of the baseline's weighted squares that the score would remove.
    pub(super) score_share: f64,
    /// Whether it was refitted.
    pub(super) tried: bool,
    /// The refit on all judged events; none without one, or where none follows the events better.
    pub(super) fit: Option<ComposedFit>,
    /// Figures for the decision; none without a refit.
    pub(super) evidence: Option<Evidence>,
}

impl Trial {
    pub(super) fn name(&self) -> &'static str {
        self.declaration.name
    }

    /// Weighted squares per row that are left with it; infinite without a fit.
    pub(super) fn chi_square(&self) -> f64 {
        let fit = self.fit.as_ref();
        fit.map_or(f64::INFINITY, ComposedFit::chi_square_per_row)
    }

    pub(super) fn delta_bic(&self) -> f64 {
        self.evidence
            .as_ref()
            .map_or(f64::INFINITY, |e| e.delta_bic)
    }
}

/// A structure as rounds see it: fitted to all judged events, and its misfit on the gate.
#[derive(Clone)]
pub(super) struct Fitted {
    pub(super) baseline: Baseline,
    pub(super) gate: Option<f64>,
}

impl Fitted {
    pub(super) fn new(case: &Case<'_>, baseline: Baseline) -> Self {
        let gate = case.gate_misfit(&baseline.all);
        Self { baseline, gate }
    }

    pub(super) fn chi_square(&self) -> f64 {
        self.baseline.all.chi_square_per_row()
    }
}

/// What came of trying effects on a structure.
enum Tried {
    /// Best first.
    All(Vec<Trial>),
    /// With one of them the structure itself came to where it follows the events better without it.
    Lower(Box<Baseline>),
}

/// Tries every effect that may be added, best first: refitted ones by the criterion, then the others
/// by their score. With the structure as it was tried on: where an effect only helped its fit on, that begins
/// anew from there.
pub(super) fn trials(
    case: &Case<'_>,
    base: Fitted,
    names: &[&'static str],
    goal: Goal,
) -> Result<(Fitted, Vec<Trial>), IdentificationError> {
    let mut base = base;
    for again in (0..LOWERED_MAX).rev() {
        match tried(case, &base, names, goal, again > 0)? {
            Tried::All(list) => return Ok((base, list)),
            Tried::Lower(lower) => base = Fitted::new(case, *lower),
        }
    }
    Ok((base, Vec::new()))
}

fn tried(
    case: &Case<'_>,
    base: &Fitted,
    names: &[&'static str],
    goal: Goal,
    may_lower: bool,
) -> Result<Tried, IdentificationError> {
    let options = &case.composed;
    let ground = (base.baseline).ground(&case.judged, options, case.watcher.cancel);
    let (mut list, screens) = screened(case, base, &ground, names)?;
    let rows = base.baseline.all.rows as f64;
    let needed = HOPELESS_SHARE * case.options.claim.fall_min;
    let far = base.chi_square() > FAR_PER_ROW;
    let worth = |t: &Trial| {
        let hidden = far && effects::find(t.name()).is_some_and(|e| e.threshold().is_some());
        t.score.gain > HOPELESS_GAIN * rows.ln() && (t.score_share >= needed || hidden)
    };
    let refits = list
        .iter()
        .filter(|t| worth(t))
        .count()
        .min(case.options.refits_max);
    let mut least = base.chi_square();
    let mut wanted = wanted(case, base, goal);
    let both = list.iter_mut().zip(&screens).filter(|(t, _)| worth(t));
    for (done, (trial, screened)) in both.take(refits).enumerate() {
        case.watcher
            .says(format!("trying {}", trial.name()), done, refits);
        trial.tried = true;
        trial.fit = base.baseline.sketched(&ground, screened, wanted);
        case.watcher.check()?;
        if let Some(fit) = &trial.fit {
            wanted = wanted.min(wanted_beside(case, base, fit));
        }
        let Some(fit) = trial.fit.as_ref().filter(|_| may_lower) else {
            continue;
        };
        if fit.chi_square_per_row() < LOWERED_SHARE * least {
            least = fit.chi_square_per_row();
            if let Some(lower) = case.lower_from(&base.baseline, fit)? {
                return Ok(Tried::Lower(Box::new(lower)));
            }
        }
    }
    refine(case, base, goal, &mut list)?;
    with_the_motor_of_another(case, base, &mut list)?;
    rivals_from_the_best(case, base, goal, &mut list)?;
    from_other_motors(case, base, goal, &mut list)?;
    refine(case, base, goal, &mut list)?;
    list.sort_by(|a, b| {
        let by_criterion = a.delta_bic().total_cmp(&b.delta_bic());
        by_criterion.then_with(|| b.score.gain.total_cmp(&a.score.gain))
    });
    rank(&mut list);
    hold_against_gate(case, base, &mut list)?;
    Ok(Tried::All(list))
}

/// What effects are tried for.
#[derive(Clone, Copy, Debug)]
pub(super) enum Goal {
    /// To say which is missing, and what comes near it.
    Claim,
    /// To find one that explains what is left: others are of no use.
    Reach,
    /// To find one that leaves less than so many weighted squares.
    Below(f64),
}

/// Weighted squares that an effect must come down to for its goal, whatever else speaks for it.
fn wanted(case: &Case<'_>, base: &Fitted, goal: Goal) -> f64 {
    let claim = &case.options.claim;
    let before: f64 = base.baseline.all.squares.iter().sum();
    let rows = base.baseline.all.rows as f64;
    let reach = match goal {
        Goal::Claim => f64::INFINITY,
        Goal::Reach => rows * reached_below(base.chi_square(), claim),
        Goal::Below(squares) => squares,
    };
    let share = [
        claim.fall_min,
        claim.fall_min_at_floor,
        claim.distinct_fall_min,
    ];
    let share = share.into_iter().fold(f64::INFINITY, f64::min);
    (before * (1.0 - share))
        .min(before - claim.delta_bic_min)
        .min(reach)
}

/// The same beside another effect that leaves what `other` leaves: what cannot come near it is no rival.
fn wanted_beside(case: &Case<'_>, base: &Fitted, other: &ComposedFit) -> f64 {
    let sum = |fit: &ComposedFit| fit.squares.iter().sum::<f64>();
    let (before, after) = (sum(&base.baseline.all), sum(other));
    let refined = before - REFINED_SHARE * (before - after);
    let per_row = other.chi_square_per_row();
    let claim = &case.options.claim;
    let factor = if per_row < claim.reached_floors * claim.floor {
        1.0 + RIVAL_OF_REACHED * told_share_of_left(per_row, claim)
    } else if per_row < FOLLOWED {
        RIVAL_OF_FOLLOWED
    } else if per_row < FAR_PER_ROW {
        RIVAL_OF_NEAR
    } else {
        f64::INFINITY
    };
    refined.min(factor * after)
}

/// The same beside all that were tried.
pub(super) fn wanted_beside_all(case: &Case<'_>, base: &Fitted, goal: Goal, list: &[Trial]) -> f64 {
    let fits = list.iter().filter_map(|trial| trial.fit.as_ref());
    let beside = fits.map(|fit| wanted_beside(case, base, fit));
    beside.fold(wanted(case, base, goal), f64::min)
}

/// What every motor does more or less: at the floor it needs what other effects need, however far it
/// is ahead of them.
pub(super) const COMMON: [&str; 1] = ["frequency_scaled_power"];

/// Where an effect leaves less than this share of what the best other one leaves, that says how near the other comes, and
/// not what the two gain: of a large misfit a wrong effect takes most as well.
const NOWHERE_NEAR: f64 = 0.1;

/// How near the best other effect comes to each.
fn rank(list: &mut [Trial]) {
    let gains: Vec<f64> = (list.iter())
        .map(|trial| (-trial.delta_bic()).max(0.0))
        .collect();
    let left: Vec<f64> = (list.iter())
        .map(|trial| {
            let evidence = trial.evidence.as_ref();
            evidence.map_or(f64::INFINITY, |e| e.chi_square_after)
        })
        .collect();
    for (place, trial) in list.iter_mut().enumerate() {
        let others = || (0..gains.len()).filter(|k| *k != place);
        let best = others().map(|k| gains[k]).fold(0.0, f64::max);
        let least = others().map(|k| left[k]).fold(f64::INFINITY, f64::min);
        let near = left[place] / least;
        let near = if near < NOWHERE_NEAR {
            near
        } else {
            f64::INFINITY
        };
        let common = COMMON.contains(&trial.name());
        if let Some(evidence) = &mut trial.evidence {
            evidence.runner_up = if common {
                f64::INFINITY
            } else {
                near.min(best / gains[place].max(f64::MIN_POSITIVE))
            };
        }
    }
}

/// The effects that any origin lets look for, most gain first, with their screens.
fn screened(
    case: &Case<'_>,
    base: &Fitted,
    ground: &Ground<'_>,
    names: &[&'static str],
) -> Result<(Vec<Trial>, Vec<Screened>), IdentificationError> {
    let squares: f64 = base.baseline.all.squares.iter().sum();
    let mut list = Vec::with_capacity(names.len());
    for (done, name) in names.iter().enumerate() {
        case.watcher.check()?;
        case.watcher
            .says(format!("looking for {name}"), done, names.len());
        let screened = ground.screen(name)?;
        let (Some(effect), Some(score)) = (effects::find(name), screened.best()) else {
            continue;
        };
        let trial = Trial {
            declaration: effect.declaration(),
            score_share: (score.gain / squares.max(f64::MIN_POSITIVE)).clamp(0.0, 1.0),
            score: score.clone(),
            tried: false,
            fit: None,
            evidence: None,
        };
        list.push((trial, screened));
    }
    list.sort_by(|a, b| b.0.score.gain.total_cmp(&a.0.score.gain));
    Ok(list.into_iter().unzip())
}

/// Fits the sketches that come near the best one to the end, and gathers what speaks for each; where that is
/// done already, nothing.
fn refine(
    case: &Case<'_>,
    base: &Fitted,
    goal: Goal,
    list: &mut [Trial],
) -> Result<(), IdentificationError> {
    let before = base.baseline.all.criterion();
    let gain = |fit: &ComposedFit| before - fit.criterion();
    let best = (list.iter().filter_map(|t| t.fit.as_ref()))
        .map(gain)
        .fold(0.0, f64::max);
    let mut order: Vec<(usize, f64)> = (list.iter().enumerate())
        .filter(|(_, trial)| trial.evidence.is_none())
        .filter_map(|(place, trial)| Some((place, gain(trial.fit.as_ref()?))))
        .collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    let ended = list.iter().filter(|trial| trial.evidence.is_some());
    let mut least = ended.map(Trial::chi_square).fold(f64::INFINITY, f64::min);
    let mut wanted = wanted_beside_all(case, base, goal, list);
    for (number, (place, gain)) in order.into_iter().enumerate() {
        let trial = &mut list[place];
        let given_up = trial.fit.as_ref().is_some_and(|fit| fit.given_up);
        let beaten = given_up || least < FOLLOWED && trial.chi_square() > BEATEN * least;
        let Some(mut fit) = trial.fit.take() else {
            continue;
        };
        if gain > 0.0 && gain >= REFINED_SHARE * best && number < REFINED_MAX && !beaten {
            case.watcher.says(
                format!("fitting {} to the end", trial.name()),
                number,
                REFINED_MAX,
            );
            let options = &case.composed.wanting(wanted);
            let cancel = case.watcher.cancel;
            fit = composed::refine(&case.judged, fit, trial.declaration.name, options, cancel);
            case.watcher.check()?;
            wanted = wanted.min(wanted_beside(case, base, &fit));
            least = least.min(fit.chi_square_per_row());
        }
        trial.evidence = Some(evidence(case, base, trial, &fit));
        trial.fit = Some(fit);
    }
    Ok(())
}

fn evidence(case: &Case<'_>, base: &Fitted, trial: &Trial, added: &ComposedFit) -> Evidence {
    let before = &base.baseline.all;
    let (value, meaningful) = amplitude(trial.declaration, added);
    let estimates = composed_parameters(added, trial.name());
    Evidence {
        blamed_first: trial.declaration.kind == Kind::Instrument
            && (estimates.iter()).all(|e| is_of_ordinary_size(trial.declaration, e)),
        delta_bic: added.criterion() - before.criterion(),
        chi_square_before: before.chi_square_per_row(),
        chi_square_after: added.chi_square_per_row(),
        unseen_span: unseen_span(case, trial.name(), added),
        amplitude_over_meaningful: value / meaningful,
        amplitude_over_error: None,
        at_bound: (estimates.iter()).any(|p| p.at_bound && at_wrong_end(trial.declaration, p)),
        squares_after: added.squares.iter().sum(),
        gate: None,
        in_turn: None,
        joined: None,
        runner_up: 0.0,
        times_every_motor: times_every_motor(trial.name(), added),
    }
}

/// The amplitude that is known best over its stated error; none where none has one.
fn amplitude_over_error(declaration: &Declaration, estimates: &[ParameterEstimate]) -> Option<f64> {
    let amplitudes = declaration.parameters.iter().filter(|p| p.is_amplitude());
    let over_error = amplitudes.filter_map(|amplitude| {
        let own = |e: &&ParameterEstimate| e.name.rsplit('.').next() == Some(amplitude.name);
        let estimate = estimates.iter().find(own)?;
        let error = estimate.standard_error.filter(|error| *error > 0.0)?;
        Some((estimate.value - amplitude.neutral).abs() / error)
    });
    over_error.max_by(f64::total_cmp)
}

/// Whether an effect that acts in events does so in parts between two voltages, and no event's lowest voltage shows a part.
fn unseen_span(case: &Case<'_>, name: &'static str, added: &ComposedFit) -> bool {
    let shape = |shape: &str| {
        let index = added.model.index(&format!("{name}.{shape}"))?;
        Some(added.parameters[index])
    };
    let band = effects::find(name).and_then(|effect| {
        let (first, span) = (shape(effect.threshold()?)?, shape(effect.span()?)?);
        Some((first, span))
    });
    let lowest: Vec<f64> = case.judged.iter().map(lowest_pu).collect();
    band.is_some_and(|(first, span)| acts_in_unseen_parts(first, span, &lowest))
}

/// Whether some of the lowest voltages of events are below `first`, and none shows a part of the span below it, pu.
fn acts_in_unseen_parts(first: f64, span: f64, lowest: &[f64]) -> bool {
    let acts = lowest.iter().any(|voltage| *voltage < first);
    acts && shows_no_part(first, span, lowest.iter().copied())
}

/// Holds against the gate, of trials whose best come first, whatever might be claimed and come near the first that
/// is; of the others the best, for the table and because the gate may tell that the model is not at the floor.
fn hold_against_gate(
    case: &Case<'_>,
    base: &Fitted,
    list: &mut [Trial],
) -> Result<(), IdentificationError> {
    let options = &case.options.claim;
    let claimable = |e: &Evidence| objections(e, options).is_empty();
    // What is behind this in the criterion is no rival of the first that may be claimed.
    let mut near = f64::INFINITY;
    let count = list.len();
    for (place, trial) in list.iter_mut().enumerate() {
        case.watcher.check()?;
        let Some(evidence) = &mut trial.evidence else {
            continue;
        };
        let may = claimable(evidence) && evidence.delta_bic <= near;
        if place >= GATED_MIN && !may {
            continue;
        }
        let what = format!("holding {} against other events", trial.declaration.name);
        case.watcher.says(what, place, count);
        let after = trial.fit.as_ref().and_then(|fit| case.gate_misfit(fit));
        if let (Some(before), Some(after)) = (base.gate, after) {
            evidence.gate = Some(GateEvidence { before, after });
        }
        let clear = evidence.is_overwhelming(options) || evidence.may_be_confirmed(options);
        if clear && is_refused_by_gate_alone(evidence, options) {
            let own = trial.fit.as_ref();
            evidence.in_turn = own.and_then(|own| case.in_turn(&base.baseline.all, own));
            let is_open = is_refused_by_gate_alone(evidence, options);
            if is_open && evidence.may_be_confirmed(options) {
                evidence.joined = own.and_then(|own| case.joined(&base.baseline.all, own));
            }
            case.watcher.check()?;
        }
        if evidence.at_floor(options) && claimable(evidence) {
            // As it would be published: what fits compete by states how well they know the corner they ended in.
            let own = trial.fit.as_ref().map(|fit| case.narrowed(fit));
            let estimates = own.map(|own| composed_parameters(&own, trial.declaration.name));
            evidence.amplitude_over_error =
                estimates.and_then(|own| amplitude_over_error(trial.declaration, &own));
            case.watcher.check()?;
        }
        if near.is_infinite() && claimable(evidence) {
            let (left, squares) = (evidence.chi_square_after, evidence.squares_after);
            let behind = told_apart(left, squares, -evidence.delta_bic, options);
            near = evidence.delta_bic + behind;
        }
    }
    Ok(())
}

/// The declaration of an amplitude that has been estimated; none of what is none.
fn amplitude_declared<'a>(
    declaration: &'a Declaration,
    estimate: &ParameterEstimate,
) -> Option<&'a Parameter> {
    let own = estimate.name.rsplit('.').next()?;
    let mut declared = declaration.parameters.iter();
    declared.find(|p| p.name == own && p.is_amplitude())
}

/// Whether an amplitude is within what is believed of nearly all of its kind.
fn is_of_ordinary_size(declaration: &Declaration, estimate: &ParameterEstimate) -> bool {
    amplitude_declared(declaration, estimate).is_none_or(|p| {
        (estimate.value - p.prior.centre).abs() <= ORDINARY_DEVIATIONS * p.prior.deviation
    })
}

/// Whether a parameter lies on a bound that says the effect has to be stretched to describe the data:
/// not an amplitude that is absent, and not a shape whose bound is a case of its own.
fn at_wrong_end(declaration: &Declaration, estimate: &ParameterEstimate) -> bool {
    amplitude_declared(declaration, estimate)
        .is_some_and(|p| (estimate.value - p.neutral).abs() > 0.5 * (p.upper - p.neutral))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_relay_below_every_event_has_no_unseen_part() {
        let lowest = [0.9, 0.56];
        assert!(!acts_in_unseen_parts(0.5, 0.05, &lowest));
        assert!(!acts_in_unseen_parts(0.6, 0.05, &lowest));
        assert!(acts_in_unseen_parts(0.7, 0.05, &lowest));
    }

    #[test]
    fn a_phase_error_that_few_instruments_have_is_no_ordinary_one() {
        let is_ordinary = |effect: &str, own: &str, value: f64| {
            let declaration = effects::find(effect).unwrap().declaration();
            let estimate = ParameterEstimate {
                name: format!("{effect}.{own}"),
                meaning: String::new(),
                value,
                unit: String::new(),
                lower: -1.0,
                upper: 1.0,
                standard_error: None,
                at_bound: false,
                identifiable: true,
                interval: None,
            };
            is_of_ordinary_size(declaration, &estimate)
        };
        assert!(is_ordinary("ratio_phase_error", "angle_rad", -0.019));
        assert!(!is_ordinary("ratio_phase_error", "angle_rad", -0.021));
        // No more is believed of a skew than its bounds.
        assert!(is_ordinary("time_skew", "delay_s", 0.07));
    }
}
