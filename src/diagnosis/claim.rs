//! What may be said of the trials: figures in, a decision with its reasons out. No model here.

use std::{cmp::Ordering, ops::RangeInclusive};

use super::options::ClaimOptions;

/// Weighted squares per row on the gate's events, not fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GateEvidence {
    pub(super) before: f64,
    pub(super) after: f64,
}

/// What speaks for one effect.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Evidence {
    /// The load, not the instrument.
    pub(super) physics: bool,
    /// Change of the criterion on all judged events.
    pub(super) delta_bic: f64,
    /// Weighted squares per row without it ...
    pub(super) chi_square_before: f64,
    /// ... and with it.
    pub(super) chi_square_after: f64,
    /// It acts in parts between two voltages that no event's lowest one lies between.
    pub(super) unseen_span: bool,
    /// Amplitude over the smallest meaningful one.
    pub(super) amplitude_over_meaningful: f64,
    /// An amplitude or shape lies on a bound.
    pub(super) at_bound: bool,
    /// Weighted squares with it.
    pub(super) squares_after: f64,
    /// Against the gate; none where there is none.
    pub(super) gate: Option<GateEvidence>,
    /// What the criterion gains by the best other effect, over what it gains by this one.
    pub(super) runner_up: f64,
}

impl Evidence {
    /// Whether no other effect comes near.
    fn stands_out(&self, options: &ClaimOptions) -> bool {
        self.runner_up <= options.distinct_runner_up
    }

    /// Whether the model follows the events already, the held-out ones too.
    fn is_followed(&self, options: &ClaimOptions) -> bool {
        let adequate = |g: GateEvidence| is_adequate(g.before, options);
        is_adequate(self.chi_square_before, options) && self.gate.is_none_or(adequate)
    }

    /// Whether it does as well as the noise allows.
    fn at_floor(&self, options: &ClaimOptions) -> bool {
        self.chi_square_before <= options.floor && self.is_followed(options)
    }

    /// Whether the held-out events have nothing to show: they are followed already, while the fitted ones
    /// are far from it, or hold next to nothing of what is left there. What has a threshold may not have operated
    /// in any of them, and what they do leave may be something else's.
    fn gate_is_silent(&self, gate: GateEvidence, options: &ClaimOptions) -> bool {
        let little = gate.before < SILENT_SHARE * self.chi_square_before;
        !is_adequate(self.chi_square_before, options)
            && (is_adequate(gate.before, options) || little)
    }
}

/// Held-out events that leave less than this share of what the fitted ones leave show nothing of it.
const SILENT_SHARE: f64 = 0.02;
/// Where they fall by this many times what a claim needs, they are not silent after all.
const SILENT_FALLS: f64 = 2.0;

/// A model that leaves less than this many times the floor is adequate.
pub(super) const ADEQUATE_FLOORS: f64 = 2.0;

/// Whether what a model leaves counts as adequate, unless events depart from it for a while.
pub(super) fn is_adequate(chi_square: f64, options: &ClaimOptions) -> bool {
    chi_square < ADEQUATE_FLOORS * options.floor
}

/// Share by which a value falls. What cannot be simulated has an infinite misfit.
fn fall(before: f64, after: f64) -> f64 {
    if !after.is_finite() {
        -1.0
    } else if before.is_infinite() {
        1.0
    } else if before > 0.0 {
        (before - after) / before
    } else {
        -1.0
    }
}

/// Share by which a claim lowers the weighted squares of the fitted events.
fn needed_fall(evidence: &Evidence, options: &ClaimOptions) -> f64 {
    if !evidence.at_floor(options) {
        options.fall_min
    } else if evidence.stands_out(options) {
        options.distinct_fall_min
    } else {
        options.fall_min_at_floor
    }
}

/// The same of the held-out events. Where they are followed, an effect that stands out needs no more there
/// than of the fitted ones, and one that is evident in these next to nothing: the held-out ones may be mild. One without
/// which much more would be left of these needs nothing: the held-out ones may not excite it at all.
fn needed_held_out_fall(evidence: &Evidence, options: &ClaimOptions) -> f64 {
    if !evidence.is_followed(options) {
        options.held_out_fall_min
    } else if evidence.delta_bic <= -options.evident_delta_bic {
        let own = fall(evidence.chi_square_before, evidence.chi_square_after);
        let is_large = own >= options.evident_fall;
        if is_large {
            0.0
        } else {
            options.evident_held_out_fall_min
        }
    } else if evidence.stands_out(options) {
        needed_fall(evidence, options)
    } else {
        options.held_out_fall_min
    }
}

/// Why this effect may not be declared, each with its figure; empty when it may.
pub(super) fn objections(evidence: &Evidence, options: &ClaimOptions) -> Vec<String> {
    let mut list = Vec::new();
    if evidence.delta_bic > -options.delta_bic_min {
        list.push(format!(
            "the criterion changes by {:.0}; a claim needs -{:.0}",
            evidence.delta_bic, options.delta_bic_min
        ));
    }
    let own = fall(evidence.chi_square_before, evidence.chi_square_after);
    let needed = needed_fall(evidence, options);
    if own < needed {
        list.push(format!(
            "the misfit of the fitted events falls by {:.1} %; a claim needs {:.0} %",
            100.0 * own,
            100.0 * needed
        ));
    }
    if evidence.amplitude_over_meaningful < 1.0 {
        list.push(format!(
            "its amplitude is {:.2} of the smallest one worth reporting",
            evidence.amplitude_over_meaningful
        ));
    }
    if let Some(gate) = evidence.gate {
        let held_out = fall(gate.before, gate.after);
        let needed = needed_held_out_fall(evidence, options);
        if evidence.gate_is_silent(gate, options) {
            let speaks = held_out >= SILENT_FALLS * options.held_out_fall_min;
            if !speaks && left_share(evidence, options) > options.silent_left_share {
                list.push(format!(
                    "the held-out events show nothing of it, and of what the fitted ones show it leaves {:.0} %; a claim needs at most {:.0} %",
                    100.0 * left_share(evidence, options),
                    100.0 * options.silent_left_share
                ));
            }
            // Not for NaN, either.
            let kept = is_adequate(gate.after, options) || gate.after <= gate.before;
            if !kept {
                list.push(format!(
                    "the held-out events, followed without it ({:.2} per sample), are not with it ({:.2})",
                    gate.before, gate.after
                ));
            }
        } else if held_out < needed {
            list.push(format!(
                "the misfit of the held-out events falls by {:.1} %; a claim needs {:.0} %",
                100.0 * held_out,
                100.0 * needed
            ));
        }
    }
    list
}

/// Whether an effect explains what is left so far that its name can stand for it: down to the floor,
/// nearly all of it, or most of it and near the floor.
pub(super) fn reaches(evidence: &Evidence, options: &ClaimOptions) -> bool {
    evidence.chi_square_after < reached_below(evidence.chi_square_before, options)
}

/// What must be left less of, where `before` is left without the effect.
pub(super) fn reached_below(before: f64, options: &ClaimOptions) -> f64 {
    let floor = options.floor;
    let share = |share: f64| floor + share * (before - floor).max(0.0);
    let near = share(options.near_left_share).min(options.near_floors * floor);
    let most = share(options.left_share).max(near);
    most.max(options.reached_floors * floor)
}

/// What is left above the floor, as a share of what was.
fn left_share(evidence: &Evidence, options: &ClaimOptions) -> f64 {
    let left = (evidence.chi_square_after - options.floor).max(0.0);
    left / (evidence.chi_square_before - options.floor).max(f64::MIN_POSITIVE)
}

/// Whether the best of the trials leaves so little, and every one outside the answer set so much more,
/// that its name stands although the floor is not reached: the equations of a real device differ a
/// little from ours, and no other device's come near.
pub(super) fn decisive(
    list: &[(Evidence, bool)],
    chosen: &[usize],
    options: &ClaimOptions,
) -> bool {
    let Some(&best) = chosen.first() else {
        return false;
    };
    let excess = |chi_square: f64| (chi_square - options.floor).max(0.0);
    let evidence = &list[best].0;
    let left = excess(evidence.chi_square_after);
    let mut others = (0..list.len()).filter(|i| !chosen.contains(i));
    left <= options.decisive_share * excess(evidence.chi_square_before)
        && others.all(|i| excess(list[i].0.chi_square_after) >= options.decisive_factor * left)
}

/// By how much the criterion of a rival is behind one that leaves `chi_square` per row, `squares` together, and has
/// gained `gain`, before the two are told apart.
pub(super) fn told_apart(chi_square: f64, squares: f64, gain: f64, options: &ClaimOptions) -> f64 {
    let above = (1.0 - options.floor / chi_square).max(0.0);
    let told = options.rival_share_of_left + options.rival_share_of_excess * above;
    let left = (told * squares).min(options.rival_share * gain);
    options.delta_bic_near.max(left)
}

/// The trials, best criterion first, of which the first is declared: indices of those that cannot be
/// told from it, itself first. Those that may not be declared do not count, nor rivals that must
/// stretch a parameter to its bound where another need not. Between equals on what they were fitted to
/// the held-out events decide, where they are followed far better with one than with another.
pub(super) fn answer_set(list: &[(Evidence, bool)], options: &ClaimOptions) -> Vec<usize> {
    let allowed = |i: &usize| list[*i].1;
    let Some(best) = (0..list.len()).find(|i| allowed(i)) else {
        return Vec::new();
    };
    let near = |i: &usize| {
        let evidence = &list[*i].0;
        let (after, squares) = (evidence.chi_square_after, evidence.squares_after);
        told_apart(after, squares, -evidence.delta_bic, options)
    };
    let close = |i: &usize| list[*i].0.delta_bic - list[best].0.delta_bic <= near(&best);
    let mut chosen: Vec<usize> = (best..list.len()).filter(allowed).filter(close).collect();
    if chosen.iter().any(|&i| !list[i].0.at_bound) {
        chosen.retain(|&i| !list[i].0.at_bound);
    }
    let held_out = |i: usize| list[i].0.gate.map_or(0.0, |gate| gate.after);
    let least = chosen
        .iter()
        .map(|&i| held_out(i))
        .fold(f64::INFINITY, f64::min);
    let most = options.rival_held_out_factor * least.max(ADEQUATE_FLOORS * options.floor);
    chosen.retain(|&i| held_out(i) <= most);
    let place = |i: &usize| order(&list[*i].0, list[*i].0.delta_bic, options);
    chosen.sort_by(|a, b| earlier(place(a), place(b)));
    chosen
}

/// Parts of an effect that are told from none and from the whole: thresholds are known to no more than that.
const PARTS: RangeInclusive<f64> = 0.1..=0.9;

/// Whether none of the lowest voltages of events lies clearly between `first` and `span` below it, where an effect acts
/// in part, pu.
pub(super) fn shows_no_part(first: f64, span: f64, mut lowest: impl Iterator<Item = f64>) -> bool {
    !lowest.any(|voltage| PARTS.contains(&((first - voltage) / span)))
}

/// What decides the order of effects that are not told apart: see [`order`].
pub(super) type Order = (bool, f64);

/// The place of an effect with a criterion among those that it is not told from. An instrument that explains as much
/// as the load is blamed first: it is the simpler cause. What acts in parts between two voltages, where no event
/// shows a part, is behind what switches at one, unless its criterion is lower by as much as a claim needs: dips between
/// the fitted ones are foretold as the prior has them.
pub(super) fn order(evidence: &Evidence, criterion: f64, options: &ClaimOptions) -> Order {
    let unseen = if evidence.unseen_span {
        options.delta_bic_min
    } else {
        0.0
    };
    (evidence.physics, criterion + unseen)
}

pub(super) fn earlier(one: Order, other: Order) -> Ordering {
    one.0.cmp(&other.0).then(one.1.total_cmp(&other.1))
}

/// The answer set of trials of which some are companions (marked), each tried by itself, best criterion first: what a
/// companion stands in for where that is better by as much as a claim needs, and otherwise the companion, which every
/// motor has and which nothing that resembles it speaks against.
pub(super) fn companions_or_rivals(
    list: &[(Evidence, bool)],
    options: &ClaimOptions,
) -> Vec<usize> {
    let may = |evidence: &Evidence| objections(evidence, options).is_empty();
    let judged: Vec<(Evidence, bool)> = (list.iter())
        .map(|(evidence, _)| (evidence.clone(), may(evidence)))
        .collect();
    let chosen = answer_set(&judged, options);
    let companions = list.iter().filter(|(_, is_companion)| *is_companion);
    let gained = companions.map(|(evidence, _)| evidence.delta_bic);
    let needed = gained.fold(0.0, f64::min) - options.delta_bic_min;
    let clearly = |best: &usize| list[*best].0.delta_bic <= needed;
    if chosen.first().is_some_and(clearly) && !chosen.iter().any(|&i| list[i].1) {
        return chosen;
    }
    let unrivalled = |(evidence, is_companion): &(Evidence, bool)| {
        let alone = Evidence {
            runner_up: 0.0,
            ..evidence.clone()
        };
        *is_companion && may(&alone)
    };
    list.iter().position(unrivalled).into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evidence(delta_bic: f64, after: f64, physics: bool) -> Evidence {
        Evidence {
            physics,
            delta_bic,
            chi_square_before: 10.0,
            chi_square_after: after,
            unseen_span: false,
            amplitude_over_meaningful: 3.0,
            at_bound: false,
            squares_after: 1000.0 * after,
            runner_up: 0.9,
            gate: Some(GateEvidence {
                before: 12.0,
                after: after * 1.2,
            }),
        }
    }

    #[test]
    fn a_claim_needs_criterion_misfit_amplitude_and_gate() {
        let options = ClaimOptions::default();
        let good = evidence(-500.0, 2.0, true);
        assert!(objections(&good, &options).is_empty());
        let weak = Evidence {
            delta_bic: -20.0,
            ..good.clone()
        };
        assert_eq!(objections(&weak, &options).len(), 1);
        let small = Evidence {
            amplitude_over_meaningful: 0.4,
            ..good.clone()
        };
        assert!(objections(&small, &options)[0].contains("0.40"));
        let gate = Some(GateEvidence {
            before: 12.0,
            after: f64::INFINITY,
        });
        let failed = Evidence {
            gate,
            ..good.clone()
        };
        assert!(objections(&failed, &options)[0].contains("held-out"));
        let ungated = Evidence { gate: None, ..good };
        assert!(objections(&ungated, &options).is_empty());
    }

    #[test]
    fn at_the_floor_an_effect_that_stands_out_needs_less() {
        let options = ClaimOptions::default();
        let small = Evidence {
            chi_square_before: 0.50,
            gate: Some(GateEvidence {
                before: 0.60,
                after: 0.56,
            }),
            ..evidence(-300.0, 0.465, true)
        };
        // 7 % on the fitted events and on the others.
        assert_eq!(objections(&small, &options).len(), 2);
        let alone = Evidence {
            runner_up: 0.2,
            ..small.clone()
        };
        assert!(objections(&alone, &options).is_empty());
        // Above the floor it needs no more of the held-out events than of the fitted ones, ...
        let above = Evidence {
            chi_square_before: 0.72,
            chi_square_after: 0.67,
            ..alone.clone()
        };
        assert!(objections(&above, &options).is_empty());
        let beside_others = Evidence {
            runner_up: 0.9,
            ..above
        };
        assert_eq!(objections(&beside_others, &options).len(), 1);
        // Where the held-out events are not followed, the model is not at the floor.
        let gate = Some(GateEvidence {
            before: 1.6,
            after: 0.5,
        });
        let elsewhere = Evidence { gate, ..small };
        assert!(objections(&elsewhere, &options).is_empty());
    }

    #[test]
    fn what_is_evident_in_followed_events_need_not_show_in_mild_held_out_ones() {
        let options = ClaimOptions::default();
        let of = |delta_bic: f64, after: f64| Evidence {
            chi_square_before: 0.71,
            gate: Some(GateEvidence {
                before: 0.671,
                after,
            }),
            ..evidence(delta_bic, 0.55, true)
        };
        assert!(objections(&of(-758.0, 0.657), &options).is_empty());
        assert_eq!(objections(&of(-400.0, 0.657), &options).len(), 1);
        assert_eq!(objections(&of(-758.0, 0.67), &options).len(), 1);
        // What most of the misfit of the fitted events goes to need not show there at all, ...
        let large = |after: f64| Evidence {
            chi_square_before: 1.28,
            chi_square_after: 0.25,
            ..of(-10_984.0, after)
        };
        assert!(objections(&large(0.67), &options).is_empty());
        // ... but must not make them worse.
        assert_eq!(objections(&large(0.68), &options).len(), 1);
    }

    #[test]
    fn held_out_events_in_which_nothing_operates_need_only_stay_followed() {
        let options = ClaimOptions::default();
        let gate = |after| Evidence {
            gate: Some(GateEvidence { before: 0.6, after }),
            ..evidence(-5000.0, 0.8, true)
        };
        assert!(objections(&gate(0.9), &options).is_empty());
        assert!(objections(&gate(1.6), &options)[0].contains("are not with it (1.60)"));
        assert_eq!(objections(&gate(f64::INFINITY), &options).len(), 1);
        let weak = Evidence {
            chi_square_after: 5.0,
            ..gate(0.9)
        };
        assert!(objections(&weak, &options)[0].contains("it leaves 46 %"));
        // They speak for it all the same.
        let heard = Evidence {
            gate: Some(GateEvidence {
                before: 0.70,
                after: 0.50,
            }),
            ..weak.clone()
        };
        assert!(objections(&heard, &options).is_empty());
        // What they leave is little beside what the fitted ones do: something else's.
        let beside = |after| Evidence {
            chi_square_before: 235.0,
            chi_square_after: 8.0,
            gate: Some(GateEvidence {
                before: 1.61,
                after,
            }),
            ..weak.clone()
        };
        assert!(objections(&beside(1.50), &options).is_empty());
        assert!(objections(&beside(1.70), &options)[0].contains("are not with it (1.70)"));
        // Where the fitted events are followed as well, they must fall.
        let near = Evidence {
            chi_square_before: 1.2,
            chi_square_after: 1.0,
            ..gate(0.7)
        };
        assert!(objections(&near, &options)[0].contains("held-out"));
    }

    #[test]
    fn rivals_within_five_percent_share_the_answer_and_instruments_come_first() {
        let options = ClaimOptions::default();
        let list = [
            (evidence(-1000.0, 2.0, true), true),
            (evidence(-990.0, 2.0, true), false),
            (evidence(-960.0, 2.1, false), true),
            (evidence(-900.0, 2.5, true), true),
        ];
        assert_eq!(answer_set(&list, &options), [2, 0]);
        let mut unseen = list.clone();
        unseen[0].0.unseen_span = true;
        unseen[3].0.delta_bic = -975.0;
        assert_eq!(answer_set(&unseen, &options), [2, 3, 0]);
        unseen[0].0.delta_bic = -1010.0;
        assert_eq!(answer_set(&unseen, &options), [2, 0, 3]);
        let mut stretched = list.clone();
        stretched[2].0.at_bound = true;
        assert_eq!(answer_set(&stretched, &options), [0]);
        // Where nearly nothing is left, a difference is told by what is left, not by the gain.
        let huge = [
            (evidence(-1e6, 2.0, true), true),
            (evidence(-0.999e6, 3.0, true), true),
        ];
        assert_eq!(answer_set(&huge, &options), [0]);
        // What is left above the floor is no noise by which a rival could be told.
        let rivals = |after: f64| {
            let one = Evidence {
                squares_after: 12_000.0 * after,
                ..evidence(-10_000.0, after, true)
            };
            let other = Evidence {
                delta_bic: -9550.0,
                ..one.clone()
            };
            [(one, true), (other, true)]
        };
        assert_eq!(answer_set(&rivals(1.0), &options), [0, 1]);
        assert_eq!(answer_set(&rivals(0.7), &options), [0]);
        assert!(answer_set(&list[1..2], &options).is_empty());
    }

    #[test]
    fn a_dip_shows_a_part_clearly_within_the_band_only() {
        let shows_none = |lowest: &[f64]| shows_no_part(0.75, 0.05, lowest.iter().copied());
        assert!(shows_none(&[0.9, 0.749, 0.702, 0.68]));
        assert!(!shows_none(&[0.9, 0.72]));
        assert!(shows_none(&[]));
    }

    #[test]
    fn between_equals_the_held_out_events_decide() {
        let options = ClaimOptions::default();
        let with_gate = |delta_bic, after| {
            let gate = Some(GateEvidence {
                before: 400.0,
                after,
            });
            let evidence = evidence(delta_bic, 0.4, true);
            (Evidence { gate, ..evidence }, true)
        };
        let list = [
            with_gate(-1008.0, 300.0),
            with_gate(-1000.0, 0.6),
            with_gate(-999.0, 4.0),
        ];
        assert_eq!(answer_set(&list, &options), [1, 2]);
        let alike = [with_gate(-1008.0, 300.0), with_gate(-1000.0, 200.0)];
        assert_eq!(answer_set(&alike, &options), [0, 1]);
        // What is behind in the criterion is no equal, however well it follows the held-out events.
        let behind = [with_gate(-1008.0, 300.0), with_gate(-900.0, 0.6)];
        assert_eq!(answer_set(&behind, &options), [0]);
    }

    #[test]
    fn a_name_stands_only_for_what_it_explains() {
        let options = ClaimOptions::default();
        assert!(reaches(&evidence(-500.0, 2.0, true), &options));
        assert!(!reaches(&evidence(-500.0, 6.0, true), &options));
        // Most of it must go on the way to the floor.
        let half = |after: f64| Evidence {
            chi_square_before: 2.6,
            ..evidence(-500.0, after, true)
        };
        assert!(!reaches(&half(1.7), &options) && !is_adequate(1.7, &options));
        assert!(!reaches(&half(1.3), &options) && is_adequate(1.3, &options));
        assert!(reaches(&half(1.0), &options));
        let far = [
            (evidence(-5000.0, 1.5, true), true),
            (evidence(-900.0, 8.0, true), true),
        ];
        assert!(decisive(&far, &[0], &options));
        let near = [
            (evidence(-5000.0, 1.5, true), true),
            (evidence(-4000.0, 2.0, true), true),
        ];
        assert!(!decisive(&near, &[0], &options));
        let large = Evidence {
            chi_square_before: 1000.0,
            ..evidence(-500.0, 6.0, true)
        };
        assert!(reaches(&large, &options));
    }

    #[test]
    fn a_companion_gives_way_to_what_is_clearly_better_by_itself() {
        let options = ClaimOptions::default();
        let companion = |gain: f64| (evidence(gain, 2.1, true), true);
        let rival = |gain: f64| (evidence(gain, 2.0, true), false);
        let clear = [rival(-1300.0), companion(-1180.0)];
        assert_eq!(companions_or_rivals(&clear, &options), [0]);
        // Better by less than a claim needs, or not at all.
        let near = [rival(-270.0), companion(-250.0)];
        assert_eq!(companions_or_rivals(&near, &options), [1]);
        let worse = [companion(-1180.0), rival(-900.0)];
        assert_eq!(companions_or_rivals(&worse, &options), [0]);
        // What may not be declared takes no one's place.
        let mut stretched = rival(-1300.0);
        stretched.0.amplitude_over_meaningful = 0.5;
        let refused = [stretched, companion(-1180.0)];
        assert_eq!(companions_or_rivals(&refused, &options), [1]);
        let nothing = [rival(-20.0), companion(-10.0)];
        assert!(companions_or_rivals(&nothing, &options).is_empty());
    }
}
