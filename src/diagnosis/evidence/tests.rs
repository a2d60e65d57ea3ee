//! What is claimed of figures, and what is not.

use super::*;

pub(in crate::diagnosis) fn evidence(delta_bic: f64, after: f64, physics: bool) -> Evidence {
    Evidence {
        blamed_first: !physics,
        delta_bic,
        chi_square_before: 10.0,
        chi_square_after: after,
        unseen_span: false,
        amplitude_over_meaningful: 3.0,
        amplitude_over_error: Some(9.0),
        at_bound: false,
        squares_after: 1000.0 * after,
        runner_up: 0.9,
        times_every_motor: None,
        in_turn: None,
        joined: None,
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
fn at_the_floor_an_amplitude_is_known_better_than_its_error() {
    let options = ClaimOptions::default();
    let gate = Some(GateEvidence {
        before: 0.5,
        after: 0.4,
    });
    let claim = |amplitude_over_error, chi_square_before| Evidence {
        chi_square_before,
        amplitude_over_error,
        gate,
        ..evidence(-480.0, 0.38, true)
    };
    for named in [
        claim(Some(4.7), 0.45),
        claim(None, 0.45),
        claim(Some(1.3), 0.8),
    ] {
        assert!(objections(&named, &options).is_empty());
    }
    let open = objections(&claim(Some(1.3), 0.45), &options);
    assert!(
        open.len() == 1 && open[0].contains("1.3 times its stated error"),
        "{open:?}"
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
    // Nor what a fit to the others leaves open of the gating ones.
    let joined = |after: f64| Evidence {
        joined: Some(GateEvidence {
            before: 0.28,
            after,
        }),
        ..small(Some(0.36))
    };
    assert!(objections(&joined(0.235), &options).is_empty());
    assert_eq!(objections(&joined(0.275), &options).len(), 1);
    assert_eq!(objections(&joined(f64::NAN), &options).len(), 1);
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
