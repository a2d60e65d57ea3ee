use super::*;

mod constrained;

use crate::numerics::test_functions::{
    BRANIN, BRANIN_MINIMA, Derivatives, HIMMELBLAU, HIMMELBLAU_MINIMA, SIX_HUMP_CAMEL,
    SIX_HUMP_CAMEL_MINIMA, Smooth, bounds, point, rastrigin,
};

fn never() -> bool {
    false
}

fn close(a: &LocalSolution, b: &LocalSolution) -> bool {
    (&a.x - &b.x).amax() < 1e-5
}

fn search_box(problem: &dyn Objective, bounds: &Bounds, start: &[f64]) -> Search {
    let options = Options {
        tiers_max: 20,
        ..Options::default()
    };
    search(
        problem,
        bounds,
        &Starts::only(&[point(start)]),
        &[],
        &close,
        &options,
        &never,
    )
}

/// Fails unless the search found exactly the published minima, within their rounding.
fn assert_minima<const N: usize>(search: &Search, expected: &[([f64; N], f64)]) {
    for (x, value) in expected {
        let found = search.solutions.iter().any(|solution| {
            (&solution.local.x - point(x)).amax() < 1e-4
                && (solution.local.value - value).abs() < 1e-4
        });
        assert!(found, "minimum {value} at {x:?} not found: {search:#?}");
    }
    assert_eq!(search.solutions.len(), expected.len(), "{search:#?}");
    assert!(
        matches!(search.ended, Ended::NothingNew { .. }),
        "{:?}",
        search.ended
    );
}

#[test]
fn every_minimum_of_the_six_hump_camel_is_found_from_anywhere() {
    let area = bounds(&[-3.0, -2.0], &[3.0, 2.0]);
    // The origin is a saddle point of it.
    for start in [[0.0, 0.0], [-2.9, 1.9], [1.6, 0.5], [2.5, -2.0]] {
        assert_minima(
            &search_box(&SIX_HUMP_CAMEL, &area, &start),
            &SIX_HUMP_CAMEL_MINIMA,
        );
    }
}

#[test]
fn every_minimum_of_himmelblau_is_found_from_anywhere() {
    let area = bounds(&[-5.0, -5.0], &[5.0, 5.0]);
    for start in [[0.0, 0.0], [-5.0, 5.0], [3.0, 2.0], [4.9, -4.9]] {
        assert_minima(&search_box(&HIMMELBLAU, &area, &start), &HIMMELBLAU_MINIMA);
    }
}

#[test]
fn every_minimum_of_branin_is_found_from_anywhere() {
    let area = bounds(&[-5.0, 0.0], &[10.0, 15.0]);
    for start in [[0.0, 0.0], [10.0, 15.0], [-5.0, 15.0], [3.0, 2.0]] {
        assert_minima(&search_box(&BRANIN, &area, &start), &BRANIN_MINIMA);
    }
}

#[test]
fn every_minimum_of_rastrigin_is_found_in_two_and_three_dimensions() {
    let found = search_box(
        &rastrigin::<2>(),
        &bounds(&[-2.45; 2], &[2.45; 2]),
        &[2.3, -2.2],
    );
    assert_eq!(found.solutions.len(), 25, "{:#?}", found.ended);
    let best = found.best().map(|best| best.local.x.amax());
    assert!(best.is_some_and(|x| x < 1e-9));
    let cube = bounds(&[-1.45; 3], &[1.45; 3]);
    let found = search_box(&rastrigin::<3>(), &cube, &[0.3, -1.2, 0.9]);
    assert_eq!(found.solutions.len(), 27, "{:#?}", found.ended);
}

#[test]
fn the_slack_form_finds_the_same_minima_as_the_box() {
    let options = Options {
        formulation: Formulation::Slack,
        tiers_max: 20,
        ..Options::default()
    };
    let run = |problem: &dyn Objective, bounds: &Bounds, start: [f64; 2]| {
        search(
            problem,
            bounds,
            &Starts::only(&[point(&start)]),
            &[],
            &close,
            &options,
            &never,
        )
    };
    let camel = run(
        &SIX_HUMP_CAMEL,
        &bounds(&[-3.0, -2.0], &[3.0, 2.0]),
        [2.0, 1.0],
    );
    assert_minima(&camel, &SIX_HUMP_CAMEL_MINIMA);
    let himmelblau = run(&HIMMELBLAU, &bounds(&[-5.0; 2], &[5.0; 2]), [0.0, 0.0]);
    assert_minima(&himmelblau, &HIMMELBLAU_MINIMA);
    let branin = run(&BRANIN, &bounds(&[-5.0, 0.0], &[10.0, 15.0]), [3.0, 2.0]);
    assert_minima(&branin, &BRANIN_MINIMA);
}

#[test]
fn the_plain_form_of_the_paper_finds_every_minimum_of_himmelblau() {
    let options = Options {
        tiers_max: 20,
        ..Options::paper()
    };
    let area = bounds(&[-5.0; 2], &[5.0; 2]);
    let found = search(
        &HIMMELBLAU,
        &area,
        &Starts::only(&[point(&[1.0, 1.0])]),
        &[],
        &close,
        &options,
        &never,
    );
    assert_minima(&found, &HIMMELBLAU_MINIMA);
}

/// `sin(x)^2 + x^2 / 50` where `x < 4`, nothing beyond: minima at 0 and close to +-pi.
const CLIFF: Smooth<1> = Smooth {
    of: |[x]| {
        (x < 4.0).then(|| Derivatives {
            value: x.sin().powi(2) + x * x / 50.0,
            gradient: [(2.0 * x).sin() + x / 25.0],
            hessian: [[2.0 * (2.0 * x).cos() + 0.04]],
        })
    },
};

#[test]
fn every_direction_is_recorded_with_its_outcome() {
    let area = bounds(&[-4.5], &[4.5]);
    let found = search_box(&CLIFF, &area, &[0.2]);
    assert_eq!(found.solutions.len(), 3, "{found:#?}");
    let middle: Vec<_> = found
        .directions
        .iter()
        .filter(|record| record.from == 1)
        .collect();
    assert_eq!(middle[0].label, "eigenvector 1 +");
    assert_eq!(middle[0].outcome, DirectionOutcome::NewSolution(2));
    // The crest is at pi / 2, 0.175 of the box away.
    let exit = middle[0].exit_distance.unwrap();
    assert!((0.17..0.25).contains(&exit), "{exit}");
    let (distance, value) = middle[0].profile[0];
    assert!(distance <= 0.0 && value < 1e-20, "{distance} {value}");
    assert_eq!(middle[1].outcome, DirectionOutcome::NewSolution(3));
    let right: Vec<_> = found
        .directions
        .iter()
        .filter(|record| record.from == 2)
        .collect();
    // From pi to the cliff at 4, where the objective ends, it only rises.
    let DirectionOutcome::NoExitPoint {
        at_distance,
        diverged: true,
    } = right[0].outcome
    else {
        panic!("{right:#?}");
    };
    assert!(at_distance < (4.0 - 3.08) / 9.0, "{at_distance}");
    assert_eq!(right[1].outcome, DirectionOutcome::KnownSolution(1));
    let left: Vec<_> = found
        .directions
        .iter()
        .filter(|record| record.from == 3)
        .collect();
    // From -pi to the bound at -4.5 it rises all the way.
    let outcome = left[1].outcome;
    assert!(
        matches!(
            outcome,
            DirectionOutcome::NoExitPoint {
                diverged: false,
                ..
            }
        ),
        "{left:#?}"
    );
}

/// `sin(x)^2 - x / 4` where `x < 3`: beyond the crest it falls over the cliff.
#[test]
fn a_local_solver_at_the_edge_of_the_domain_is_infeasible() {
    let cliff = Smooth {
        of: |[x]: [f64; 1]| {
            (x < 3.0).then(|| Derivatives {
                value: x.sin().powi(2) - x / 4.0,
                gradient: [(2.0 * x).sin() - 0.25],
                hessian: [[2.0 * (2.0 * x).cos()]],
            })
        },
    };
    let found = search_box(&cliff, &bounds(&[-1.0], &[6.0]), &[0.1]);
    assert_eq!(found.solutions.len(), 1, "{found:#?}");
    assert_eq!(
        found.directions[0].outcome,
        DirectionOutcome::LocalSolverInfeasible
    );
    assert!(found.directions[0].exit_distance.is_some());
}

#[test]
fn user_directions_are_followed_and_named() {
    let area = bounds(&[-5.0; 2], &[5.0; 2]);
    let user = |label: &str, kind| UserDirection {
        label: label.to_owned(),
        kind,
    };
    let directions = [
        user("across", UserDirectionKind::Along(point(&[-6.8, -5.3]))),
        user(
            "to the west",
            UserDirectionKind::Towards(point(&[-2.8, 3.1])),
        ),
        user("nowhere", UserDirectionKind::Along(point(&[0.0, 0.0]))),
    ];
    let options = Options {
        box_directions: false,
        tiers_max: 1,
        ..Options::default()
    };
    let start = [point(&[3.0, 2.0])];
    let found = search(
        &HIMMELBLAU,
        &area,
        &Starts::only(&start),
        &directions,
        &close,
        &options,
        &never,
    );
    let labels: Vec<_> = found
        .directions
        .iter()
        .map(|record| record.label.as_str())
        .collect();
    assert_eq!(
        labels,
        [
            "eigenvector 1 +",
            "eigenvector 1 -",
            "eigenvector 2 +",
            "eigenvector 2 -",
            "across +",
            "across -",
            "to the west"
        ]
    );
    let west = &found.directions[6];
    assert!(matches!(
        west.outcome,
        DirectionOutcome::NewSolution(_) | DirectionOutcome::KnownSolution(_)
    ));
}

#[test]
fn limits_and_cancellation_say_why_the_search_ended() {
    let area = bounds(&[-5.0; 2], &[5.0; 2]);
    let starts = [point(&[3.0, 2.0])];
    let run = |options: &Options, cancel: &(dyn Fn() -> bool + Sync)| {
        search(
            &HIMMELBLAU,
            &area,
            &Starts::only(&starts),
            &[],
            &close,
            options,
            cancel,
        )
    };
    let few = Options {
        evaluations_max: 60,
        ..Options::default()
    };
    assert!(matches!(
        run(&few, &never).ended,
        Ended::EvaluationsExhausted { limit: 60, .. }
    ));
    let one_tier = Options {
        tiers_max: 1,
        ..Options::default()
    };
    assert_eq!(
        run(&one_tier, &never).ended,
        Ended::TiersExhausted { limit: 1 }
    );
    assert_eq!(run(&Options::default(), &|| true).ended, Ended::Cancelled);
    // Cancelled in the middle: what was found until then is there.
    let calls = std::sync::atomic::AtomicU32::new(0);
    let later = || calls.fetch_add(1, std::sync::atomic::Ordering::Relaxed) > 100;
    let partial = run(&Options::default(), &later);
    assert_eq!(partial.ended, Ended::Cancelled);
    assert!(!partial.solutions.is_empty() && !partial.directions.is_empty());
}

#[test]
fn more_starts_are_asked_for_when_half_of_the_calls_are_used_up() {
    let (problem, area) = (rastrigin::<2>(), bounds(&[-5.0; 2], &[5.0; 2]));
    let first = [point(&[0.1, 0.1])];
    let known = std::sync::atomic::AtomicUsize::new(0);
    let more = |found: &[FoundSolution]| {
        known.store(found.len(), std::sync::atomic::Ordering::Relaxed);
        vec![point(&[3.9, 4.1])]
    };
    let options = Options {
        evaluations_max: 100,
        ..Options::default()
    };
    // The minimum in the cell of (4, 4), which the first tier from the origin does not lead to.
    let has_it = |second| {
        let starts = Starts {
            first: &first,
            second,
        };
        let found = search(&problem, &area, &starts, &[], &close, &options, &never);
        let near = |found: &FoundSolution| (&found.local.x - point(&[4.0, 4.0])).amax() < 0.1;
        found.solutions.iter().any(near)
    };
    assert!(has_it(Some(&more)) && !has_it(None));
    assert!(known.load(std::sync::atomic::Ordering::Relaxed) > 0);
}

#[test]
fn settings_out_of_range_are_named() {
    assert!(Options::default().checked().is_ok() && Options::paper().checked().is_ok());
    let refused = Options {
        step: 0.0,
        ..Options::default()
    }
    .checked();
    assert_eq!(
        refused.map_err(|error| error.to_string()),
        Err("step = 0 is out of range: (0, 0.5]".to_owned())
    );
    let local = local_solver::Options {
        damping_initial: f64::NAN,
        ..Default::default()
    };
    let refused = Options {
        local,
        ..Options::default()
    }
    .checked();
    assert_eq!(refused.map_err(|error| error.field), Err("damping_initial"));
}

#[test]
fn two_runs_give_the_same_bits() {
    let area = bounds(&[-3.0, -2.0], &[3.0, 2.0]);
    let run = || format!("{:?}", search_box(&SIX_HUMP_CAMEL, &area, &[0.3, 0.4]));
    assert_eq!(run(), run());
}
