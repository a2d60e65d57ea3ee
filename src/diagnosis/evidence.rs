//! What speaks for an effect and what against it: figures in, objections with theirs out. No model here.

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
    /// Against every event that others surround, foretold in turn; none where the gate alone was asked.
    pub(super) in_turn: Option<GateEvidence>,
    /// What the criterion gains by the best other effect, over what it gains by this one; where this one leaves next to
    /// nothing of what that one leaves, the share of it.
    pub(super) runner_up: f64,
    /// How much P follows the frequency by it, over what it does by every motor; none where it is no dependence on the
    /// frequency that could be taken for that.
    pub(super) times_every_motor: Option<f64>,
}

impl Evidence {
    /// Whether no other effect comes near.
    pub(super) fn stands_out(&self, options: &ClaimOptions) -> bool {
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

    /// Whether it lowers the misfit as no other effect does, and by far more than a claim needs.
    pub(super) fn is_overwhelming(&self, options: &ClaimOptions) -> bool {
        self.stands_out(options) && self.is_evident(options)
    }

    /// Whether the fitted events alone leave no doubt that it explains something.
    fn is_evident(&self, options: &ClaimOptions) -> bool {
        self.delta_bic <= -options.evident_delta_bic
            && fall(self.chi_square_before, self.chi_square_after) >= options.evident_fall
    }

    /// Whether it is small beside the noise that is assumed, but clear, and no other effect comes near: all events in turn
    /// may confirm it where the held-out ones by themselves do not.
    pub(super) fn may_be_confirmed(&self, options: &ClaimOptions) -> bool {
        self.is_followed(options)
            && self.stands_out(options)
            && self.delta_bic <= -options.confirmed_delta_bic
    }

    /// Whether events that it was not fitted to confirm what is small beside the noise that is assumed. What others come
    /// nearer to is not.
    fn is_confirmed(&self, options: &ClaimOptions) -> bool {
        let falls =
            |gate: GateEvidence| fall(gate.before, gate.after) >= options.confirmed_fall_min;
        self.is_followed(options)
            && self.delta_bic <= -options.confirmed_delta_bic
            && self.runner_up <= CONFIRMED_RUNNER_UP
            && self.gate.is_some_and(falls)
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

/// What is confirmed gains no less than the best other effect gains divided by this: rivals are confirmed too.
const CONFIRMED_RUNNER_UP: f64 = 1.25;
/// Held-out events that leave less than this share of what the fitted ones leave show nothing of it.
const SILENT_SHARE: f64 = 0.02;
/// Where they fall by this many times what a claim needs, they are not silent after all.
const SILENT_FALLS: f64 = 2.0;

/// A dependence on the frequency that is so many times that of every motor is one of its own.
const MORE_THAN_EVERY_MOTOR: f64 = 1.5;

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

/// In words that a value falls, rises, or has become infinite.
fn moves(before: f64, after: f64) -> String {
    let percent = 100.0 * fall(before, after);
    if !after.is_finite() {
        "has become infinite".to_owned()
    } else if percent < 0.0 {
        format!("rises by {:.1} %", -percent)
    } else {
        format!("falls by {percent:.1} %")
    }
}

/// Share by which a claim lowers the weighted squares of the fitted events.
fn needed_fall(evidence: &Evidence, options: &ClaimOptions) -> f64 {
    if !evidence.at_floor(options) {
        options.fall_min
    } else if evidence.stands_out(options) {
        options.distinct_fall_min
    } else if evidence.is_confirmed(options) {
        options.confirmed_fall_min
    } else {
        options.fall_min_at_floor
    }
}

/// The same of the held-out events. Where they are followed, an effect that stands out needs no more there
/// than of the fitted ones, and one that lowers the criterion by far in these next to nothing: the held-out ones may be
/// mild.
fn needed_held_out_fall(evidence: &Evidence, options: &ClaimOptions) -> f64 {
    if !evidence.is_followed(options) {
        options.held_out_fall_min
    } else if evidence.delta_bic <= -options.evident_delta_bic {
        options.evident_held_out_fall_min
    } else if evidence.is_confirmed(options) {
        options.confirmed_fall_min
    } else if evidence.stands_out(options) {
        needed_fall(evidence, options)
    } else {
        options.held_out_fall_min
    }
}

/// Whether nothing but the gate speaks against an effect.
pub(super) fn is_refused_by_gate_alone(evidence: &Evidence, options: &ClaimOptions) -> bool {
    let refused = objections(evidence, options);
    let of_gate = evidence
        .gate
        .and_then(|gate| of_the_gate(evidence, gate, options));
    of_gate.is_some() && refused.len() == 1
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
            "the misfit of the fitted events {}; a claim needs a fall by {:.0} %",
            moves(evidence.chi_square_before, evidence.chi_square_after),
            100.0 * needed
        ));
    }
    if evidence.amplitude_over_meaningful < 1.0 {
        list.push(format!(
            "its amplitude is {:.2} of the smallest one worth reporting",
            evidence.amplitude_over_meaningful
        ));
    }
    list.extend(as_every_motor_does(evidence, options));
    list.extend(
        evidence
            .gate
            .and_then(|gate| of_the_gate(evidence, gate, options)),
    );
    list
}

/// At the floor what every motor does at another frequency shows as well, and what is no more than that is no effect of its
/// own.
fn as_every_motor_does(evidence: &Evidence, options: &ClaimOptions) -> Option<String> {
    let times = evidence.times_every_motor?;
    let alike = (0.0..MORE_THAN_EVERY_MOTOR).contains(&times);
    (alike && evidence.at_floor(options)).then(|| {
        format!(
            "P follows the frequency by it {times:.1} times as much as by every motor; a claim needs {MORE_THAN_EVERY_MOTOR} times"
        )
    })
}

/// What the gate says against an effect.
fn of_the_gate(evidence: &Evidence, gate: GateEvidence, options: &ClaimOptions) -> Option<String> {
    let held_out = fall(gate.before, gate.after);
    // What single events leave open, all of them in turn may not.
    let in_turn = |g: GateEvidence| fall(g.before, g.after) >= options.held_out_fall_min;
    let foretold = evidence.in_turn.is_some_and(in_turn);
    let is_silent = evidence.gate_is_silent(gate, options);
    if is_silent {
        let speaks = held_out >= SILENT_FALLS * options.held_out_fall_min;
        let left = left_share(evidence, options);
        if !speaks && left > options.silent_left_share {
            return Some(format!(
                "the held-out events show nothing of it, and of what the fitted ones show it leaves {:.0} %; a claim needs at most {:.0} %",
                100.0 * left,
                100.0 * options.silent_left_share
            ));
        }
    } else if !(evidence.is_followed(options) && evidence.is_evident(options)) {
        let needed = needed_held_out_fall(evidence, options);
        return (held_out < needed && !foretold).then(|| {
            format!(
                "the misfit of the held-out events {}; a claim needs a fall by {:.0} %",
                moves(gate.before, gate.after),
                100.0 * needed
            )
        });
    }
    // They may not excite it at all, and need only stay followed. Not for NaN, either.
    let kept = is_adequate(gate.after, options) || gate.after <= gate.before;
    (!kept && !foretold).then(|| {
        format!(
            "the held-out events, followed without it ({:.2} per sample), are not with it ({:.2})",
            gate.before, gate.after
        )
    })
}

/// What is left above the floor, as a share of what was.
fn left_share(evidence: &Evidence, options: &ClaimOptions) -> f64 {
    let left = (evidence.chi_square_after - options.floor).max(0.0);
    left / (evidence.chi_square_before - options.floor).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::diagnosis) fn evidence(delta_bic: f64, after: f64, physics: bool) -> Evidence {
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
            times_every_motor: None,
            in_turn: None,
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
    fn at_the_floor_a_dependence_on_the_frequency_is_more_than_that_of_every_motor() {
        let options = ClaimOptions::default();
        let gate = Some(GateEvidence {
            before: 0.3,
            after: 0.25,
        });
        let claim = |times_every_motor, chi_square_before| Evidence {
            chi_square_before,
            gate,
            times_every_motor,
            ..evidence(-180.0, 0.25, true)
        };
        for named in [
            claim(Some(2.0), 0.3),
            claim(Some(-0.5), 0.3),
            claim(None, 0.3),
            claim(Some(0.9), 0.8),
        ] {
            assert!(objections(&named, &options).is_empty());
        }
        let alike = objections(&claim(Some(0.9), 0.3), &options);
        assert!(
            alike.len() == 1 && alike[0].contains("0.9 times"),
            "{alike:?}"
        );
    }

    #[test]
    fn a_misfit_that_rises_does_not_fall() {
        assert_eq!(moves(10.0, 10.06), "rises by 0.6 %");
        assert_eq!(moves(10.0, 9.94), "falls by 0.6 %");
        assert_eq!(moves(10.0, f64::INFINITY), "has become infinite");
    }

    #[test]
    fn what_held_out_events_confirm_may_be_small() {
        let options = ClaimOptions::default();
        let small = Evidence {
            chi_square_before: 0.28,
            runner_up: 0.8,
            gate: Some(GateEvidence {
                before: 0.26,
                after: 0.245,
            }),
            ..evidence(-380.0, 0.26, true)
        };
        assert!(objections(&small, &options).is_empty());
        let refused = |change: fn(&mut Evidence)| {
            let mut other = small.clone();
            change(&mut other);
            !objections(&other, &options).is_empty()
        };
        assert!(refused(|e| e.delta_bic = -90.0));
        assert!(refused(|e| e.chi_square_after = 0.275));
        assert!(refused(|e| e.gate = None));
        assert!(refused(|e| {
            e.gate = Some(GateEvidence {
                before: 0.26,
                after: 0.255,
            });
        }));
        // Another effect gains more, or it is what every motor does.
        assert!(refused(|e| e.runner_up = 1.5));
        assert!(refused(|e| e.runner_up = f64::INFINITY));
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
            ..evidence(-90.0, 0.465, true)
        };
        // 7 % on the fitted events and on the others, too little of the criterion for them to confirm.
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
        // ... but they must stay followed.
        assert!(objections(&large(0.90), &options).is_empty());
        assert!(objections(&large(1.45), &options)[0].contains("are not with it (1.45)"));
        assert_eq!(objections(&large(f64::NAN), &options).len(), 1);
        // Those that were not must fall.
        let not_followed = Evidence {
            chi_square_before: 2.0,
            gate: Some(GateEvidence {
                before: 1.45,
                after: 1.39,
            }),
            ..large(0.0)
        };
        assert!(objections(&not_followed, &options)[0].contains("falls by 4.1 %"));
    }

    #[test]
    fn what_is_small_may_be_confirmed_by_all_events_in_turn() {
        let options = ClaimOptions::default();
        let small = |in_turn: Option<f64>| Evidence {
            chi_square_before: 0.27,
            runner_up: 0.4,
            gate: Some(GateEvidence {
                before: 0.263,
                after: 0.258,
            }),
            in_turn: in_turn.map(|after| GateEvidence {
                before: 0.268,
                after,
            }),
            ..evidence(-240.0, 0.235, true)
        };
        let refused = small(None);
        assert!(refused.may_be_confirmed(&options) && is_refused_by_gate_alone(&refused, &options));
        assert!(objections(&small(Some(0.238)), &options).is_empty());
        assert_eq!(objections(&small(Some(0.253)), &options).len(), 1);
        // Others come near, or it is next to nothing.
        for other in [
            Evidence {
                runner_up: 0.7,
                ..small(None)
            },
            Evidence {
                delta_bic: -90.0,
                ..small(None)
            },
        ] {
            assert!(!other.may_be_confirmed(&options));
        }
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
    fn what_the_gating_events_leave_open_the_others_may_foretell() {
        let options = ClaimOptions::default();
        let gate = GateEvidence {
            before: 0.9,
            after: 4.8,
        };
        let in_turn = |after: f64| Evidence {
            chi_square_before: 0.76,
            gate: Some(gate),
            in_turn: Some(GateEvidence { before: 0.5, after }),
            ..evidence(-5000.0, 0.27, true)
        };
        assert!(objections(&in_turn(0.25), &options).is_empty());
        assert_eq!(objections(&in_turn(0.48), &options).len(), 1);
        assert_eq!(objections(&in_turn(f64::NAN), &options).len(), 1);
        // They are asked only about what nothing else comes near to.
        let alone = Evidence {
            runner_up: 0.2,
            ..in_turn(0.25)
        };
        assert!(alone.is_overwhelming(&options) && !in_turn(0.25).is_overwhelming(&options));
        let refused = Evidence {
            in_turn: None,
            ..alone.clone()
        };
        assert!(is_refused_by_gate_alone(&refused, &options));
        let small_besides = Evidence {
            amplitude_over_meaningful: 0.5,
            ..refused
        };
        assert!(!is_refused_by_gate_alone(&small_besides, &options));
        let small = Evidence {
            chi_square_after: 0.6,
            ..alone
        };
        assert!(!small.is_overwhelming(&options));
    }
}
