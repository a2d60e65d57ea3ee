use super::*;
use crate::numerics::test_functions::{
    BRANIN, HIMMELBLAU, LeastSquares, Residuals, SIX_HUMP_CAMEL, bounds, derivative_error, point,
    rastrigin,
};

fn never() -> bool {
    false
}

fn solve(objective: &dyn Objective, start: &[f64]) -> LocalSolution {
    let everywhere = bounds(
        &vec![f64::NEG_INFINITY; start.len()],
        &vec![f64::INFINITY; start.len()],
    );
    solve_within(objective, &everywhere, start)
}

fn solve_within(objective: &dyn Objective, bounds: &Bounds, start: &[f64]) -> LocalSolution {
    let options = Options {
        evaluations_max: 3000,
        ..Options::default()
    };
    minimise(objective, bounds, &point(start), &options, &never).unwrap()
}

/// Fails unless `found` is a minimum at `expected`, each component to `relative`.
fn assert_found(found: &LocalSolution, expected: &[f64], relative: f64) {
    assert!(found.termination.is_minimum(), "{found:?}");
    for (i, &x) in expected.iter().enumerate() {
        let error = (found.x[i] - x).abs() / x.abs().max(1e-300);
        assert!(
            error <= relative,
            "x[{i}] = {} instead of {x}: {found:?}",
            found.x[i]
        );
    }
}

/// A model `y(b, x)` with its derivatives, fitted to pairs `(x, y)`.
fn fit<const N: usize>(
    data: &'static [(f64, f64)],
    model: fn([f64; N], f64) -> (f64, [f64; N]),
) -> LeastSquares<impl Fn(&[f64]) -> Residuals + Sync> {
    LeastSquares {
        dimension: N,
        residuals: move |b: &[f64]| {
            let b: [f64; N] = std::array::from_fn(|i| b[i]);
            let at: Vec<_> = data.iter().map(|&(x, y)| (model(b, x), y)).collect();
            (
                DVector::from_fn(at.len(), |row, _| at[row].0.0 - at[row].1),
                DMatrix::from_fn(at.len(), N, |row, i| at[row].0.1[i]),
            )
        },
    }
}

#[test]
fn derivatives_of_the_test_functions_agree_with_differences() {
    let points = [[0.3, -0.7], [1.7, 0.9], [-2.1, 1.3]];
    for objective in [&SIX_HUMP_CAMEL, &HIMMELBLAU, &BRANIN, &rastrigin::<2>()] {
        for x in &points {
            let (gradient, hessian) = derivative_error(objective, &point(x));
            assert!(
                gradient < 1e-7 && hessian < 1e-7,
                "{gradient:e} {hessian:e}"
            );
        }
    }
}

#[test]
fn rosenbrock_is_solved_from_the_standard_start() {
    let found = solve(&rosenbrock(10.0), &[-1.2, 1.0]);
    assert_found(&found, &[1.0, 1.0], 1e-10);
}

#[test]
fn a_valley_a_million_times_steeper_across_than_along_is_followed_to_its_end() {
    let found = solve(&rosenbrock(1e3), &[-1.2, 1.0]);
    assert_found(&found, &[1.0, 1.0], 1e-8);
}

fn rosenbrock(steepness: f64) -> LeastSquares<impl Fn(&[f64]) -> Residuals + Sync> {
    LeastSquares {
        dimension: 2,
        residuals: move |x: &[f64]| {
            (
                point(&[steepness * (x[1] - x[0] * x[0]), 1.0 - x[0]]),
                DMatrix::from_row_slice(2, 2, &[-2.0 * steepness * x[0], steepness, -1.0, 0.0]),
            )
        },
    }
}

#[test]
fn mgh10_is_solved() {
    let found = solve(&fit(&MGH10, mgh10), &[0.02, 4000.0, 250.0]);
    assert_found(
        &found,
        &[5.609_636_471_0e-3, 6.181_346_346_3e3, 3.452_236_346_2e2],
        1e-7,
    );
    assert!((2.0 * found.value / 8.794_585_517_1e1 - 1.0).abs() < 1e-10);
}

fn mgh10([b1, b2, b3]: [f64; 3], x: f64) -> (f64, [f64; 3]) {
    let e = (b2 / (x + b3)).exp();
    (
        b1 * e,
        [e, b1 * e / (x + b3), -b1 * e * b2 / (x + b3).powi(2)],
    )
}

const MGH10: [(f64, f64); 16] = [
    (50.0, 34780.0),
    (55.0, 28610.0),
    (60.0, 23650.0),
    (65.0, 19630.0),
    (70.0, 16370.0),
    (75.0, 13720.0),
    (80.0, 11540.0),
    (85.0, 9744.0),
    (90.0, 8261.0),
    (95.0, 7030.0),
    (100.0, 6005.0),
    (105.0, 5147.0),
    (110.0, 4427.0),
    (115.0, 3820.0),
    (120.0, 3307.0),
    (125.0, 2872.0),
];
