//! Which of the trials is declared, and what is not told from it: figures in, a decision out. No model here.

use std::cmp::Ordering;

use super::{
    evidence::{ADEQUATE_FLOORS, Evidence, objections},
    options::ClaimOptions,
};

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
    let told = told_share_of_left(chi_square, options);
    let left = (told * squares).min(options.rival_share * gain);
    options.delta_bic_near.max(left)
}

/// The same as a share of the squares that are left, whatever was gained.
pub(super) fn told_share_of_left(chi_square: f64, options: &ClaimOptions) -> f64 {
    let above = (1.0 - options.floor / chi_square).max(0.0);
    options.rival_share_of_left + options.rival_share_of_excess * above
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

/// What decides the order of effects that are not told apart: see [`order`].
pub(super) type Order = (bool, f64);

/// The place of an effect with a criterion among those that it is not told from. An instrument that explains as much
/// as the load is blamed first where its error is one that instruments have: it is the simpler cause. What acts in parts
/// between two voltages, where no event shows a part, is behind what switches at one, unless its criterion is lower by as
/// much as a claim needs: dips between the fitted ones are foretold as the prior has them.
pub(super) fn order(evidence: &Evidence, criterion: f64, options: &ClaimOptions) -> Order {
    let unseen = if evidence.unseen_span {
        options.delta_bic_min
    } else {
        0.0
    };
    (!evidence.blamed_first, criterion + unseen)
}

pub(super) fn earlier(one: Order, other: Order) -> Ordering {
    one.0.cmp(&other.0).then(one.1.total_cmp(&other.1))
}

/// A companion, or what resembles one, tried by itself.
pub(super) struct ByItself {
    pub(super) evidence: Evidence,
    pub(super) is_companion: bool,
    /// What the criterion changes by it where the companions are in the model; zero for a companion.
    pub(super) beside: f64,
}

impl ByItself {
    /// Whether it may be declared. What is small and gains little beside the companion is what the companion does, and
    /// not confirmed by held-out events, which show that as well.
    fn may(&self, options: &ClaimOptions) -> bool {
        let own = self.is_companion || self.beside <= -options.confirmed_delta_bic;
        let confirmed_delta_bic = if own {
            options.confirmed_delta_bic
        } else {
            f64::INFINITY
        };
        let options = ClaimOptions {
            confirmed_delta_bic,
            ..*options
        };
        objections(&self.evidence, &options).is_empty()
    }
}

/// Held-out events speak for a companion that gains this share of what a rival gains, ...
const GAINED_NEARLY: f64 = 0.8;
/// ... where they are followed with it and the rival leaves so many times what is adequate.
const FORETOLD_BETTER: f64 = 2.0;

/// Whether held-out events, followed with a companion that gains nearly as much, are not with its rival.
fn is_foretold_better(companion: &Evidence, rival: &Evidence, options: &ClaimOptions) -> bool {
    let (Some(own), Some(other)) = (companion.gate, rival.gate) else {
        return false;
    };
    let adequate = ADEQUATE_FLOORS * options.floor;
    companion.delta_bic <= GAINED_NEARLY * rival.delta_bic
        && own.after <= adequate
        && other.after > FORETOLD_BETTER * adequate
}

/// The answer set of companions and what resembles them, best criterion first: what a companion stands in for where that
/// is better by as much as a claim needs and held-out events do not speak for the companion, and otherwise the companion,
/// which every motor has and which nothing that resembles it speaks against.
pub(super) fn companions_or_rivals(list: &[ByItself], options: &ClaimOptions) -> Vec<usize> {
    let judged: Vec<(Evidence, bool)> = (list.iter())
        .map(|trial| (trial.evidence.clone(), trial.may(options)))
        .collect();
    let chosen = answer_set(&judged, options);
    let companions = list.iter().filter(|trial| trial.is_companion);
    let gained = companions.map(|trial| trial.evidence.delta_bic);
    let needed = gained.fold(0.0, f64::min) - options.delta_bic_min;
    let unrivalled = |trial: &ByItself| {
        let alone = Evidence {
            runner_up: 0.0,
            ..trial.evidence.clone()
        };
        trial.is_companion && objections(&alone, options).is_empty()
    };
    let companion = list.iter().position(unrivalled);
    let clearly = |best: &usize| {
        let rival = &list[*best].evidence;
        let refuted =
            companion.is_some_and(|i| is_foretold_better(&list[i].evidence, rival, options));
        rival.delta_bic <= needed && !refuted
    };
    if chosen.first().is_some_and(clearly) && !chosen.iter().any(|&i| list[i].is_companion) {
        return chosen;
    }
    companion.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::{
        super::evidence::{GateEvidence, is_adequate, tests::evidence},
        *,
    };

    #[test]
    fn at_the_noise_little_tells_two_effects_apart_and_above_it_more_is_needed() {
        let options = ClaimOptions::default();
        let told = |chi_square| told_share_of_left(chi_square, &options);
        assert!((told(0.5) - options.rival_share_of_left).abs() < 1e-12);
        assert!((told(options.floor) - options.rival_share_of_left).abs() < 1e-12);
        assert!(told(0.9) > 2.0 * told(0.5) && told(2.0) > told(0.9));
        assert!((told_apart(2.0, 1e4, 1e9, &options) - 1e4 * told(2.0)).abs() < 1e-9);
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
        let trial = |evidence, is_companion, beside| ByItself {
            evidence,
            is_companion,
            beside,
        };
        let companion = |gain: f64| trial(evidence(gain, 2.1, true), true, 0.0);
        let rival = |gain: f64| trial(evidence(gain, 2.0, true), false, -40.0);
        let clear = [rival(-1300.0), companion(-1180.0)];
        assert_eq!(companions_or_rivals(&clear, &options), [0]);
        // Better by less than a claim needs, or not at all.
        let near = [rival(-270.0), companion(-250.0)];
        assert_eq!(companions_or_rivals(&near, &options), [1]);
        let worse = [companion(-1180.0), rival(-900.0)];
        assert_eq!(companions_or_rivals(&worse, &options), [0]);
        // What may not be declared takes no one's place.
        let mut stretched = rival(-1300.0);
        stretched.evidence.amplitude_over_meaningful = 0.5;
        let refused = [stretched, companion(-1180.0)];
        assert_eq!(companions_or_rivals(&refused, &options), [1]);
        // Held-out events that the companion follows and the rival does not speak for the companion, ...
        let held_out = |mut trial: ByItself, after: f64| {
            let before = 7.0;
            trial.evidence.gate = Some(GateEvidence { before, after });
            trial
        };
        let foretold = [
            held_out(rival(-1300.0), 5.4),
            held_out(companion(-1180.0), 0.9),
        ];
        assert_eq!(companions_or_rivals(&foretold, &options), [1]);
        // ... unless it gains much less.
        let much_less = [
            held_out(rival(-1300.0), 5.4),
            held_out(companion(-900.0), 0.9),
        ];
        assert_eq!(companions_or_rivals(&much_less, &options), [0]);
        let nothing = [rival(-20.0), companion(-10.0)];
        assert!(companions_or_rivals(&nothing, &options).is_empty());
    }

    #[test]
    fn held_out_events_confirm_in_the_place_of_a_companion_what_gains_beside_it_too() {
        let options = ClaimOptions::default();
        let small = |delta_bic: f64, fall: f64| Evidence {
            chi_square_before: 0.50,
            runner_up: 0.8,
            gate: Some(GateEvidence {
                before: 0.90,
                after: 0.90 * (1.0 - fall),
            }),
            ..evidence(delta_bic, 0.46, true)
        };
        let answer = |beside: f64| {
            let trial = |evidence, is_companion, beside| ByItself {
                evidence,
                is_companion,
                beside,
            };
            let list = [
                trial(small(-360.0, 0.04), false, beside),
                trial(small(-220.0, 0.05), true, 0.0),
            ];
            companions_or_rivals(&list, &options)
        };
        assert_eq!(answer(-124.0), [0]);
        assert_eq!(answer(-34.0), [1]);
        assert_eq!(answer(0.0), [1]);
    }
}
