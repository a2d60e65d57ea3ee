use super::*;
use crate::numerics::test_functions::{
    BRANIN, BRANIN_MINIMA, HIMMELBLAU, HIMMELBLAU_MINIMA, SIX_HUMP_CAMEL, SIX_HUMP_CAMEL_MINIMA,
    bounds, point, rastrigin,
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
        &[point(start)],
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
fn two_runs_give_the_same_bits() {
    let area = bounds(&[-3.0, -2.0], &[3.0, 2.0]);
    let run = || format!("{:?}", search_box(&SIX_HUMP_CAMEL, &area, &[0.3, 0.4]));
    assert_eq!(run(), run());
}
