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
        decrease_relative: 1e-14,
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
    // Creeping along its floor takes 270.
    assert!(found.cost.evaluations() < 60, "{:?}", found.cost);
}

/// Rosenbrock's valley, whose floor is raised to 1: what is above that can be had, what is below cannot.
#[test]
fn what_is_out_of_reach_is_given_up() {
    let objective = LeastSquares {
        dimension: 2,
        residuals: |x: &[f64]| {
            (
                DVector::from_column_slice(&[
                    10.0 * (x[1] - x[0] * x[0]),
                    1.0 - x[0],
                    2_f64.sqrt(),
                ]),
                DMatrix::from_row_slice(3, 2, &[-20.0 * x[0], 10.0, -1.0, 0.0, 0.0, 0.0]),
            )
        },
    };
    let everywhere = bounds(&[f64::NEG_INFINITY; 2], &[f64::INFINITY; 2]);
    let wanting = |wanted: f64| {
        let options = Options {
            wanted,
            ..Options::default()
        };
        minimise(
            &objective,
            &everywhere,
            &point(&[-1.2, 1.0]),
            &options,
            &never,
        )
        .unwrap()
    };
    let whole = wanting(f64::INFINITY);
    assert_found(&whole, &[1.0, 1.0], 1e-6);
    assert_eq!(wanting(1.001), whole);
    let given_up = wanting(0.5);
    let out_of_reach = matches!(given_up.termination, Termination::OutOfReach { .. });
    assert!(out_of_reach, "{given_up:?}");
    assert!(!given_up.termination.is_minimum() && given_up.termination.is_feasible());
    assert!(given_up.value >= 1.0 && given_up.cost.evaluations() < whole.cost.evaluations());
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

/// A problem of the NIST Statistical Reference Datasets (nonlinear regression).
struct Reference {
    objective: Box<dyn Objective>,
    /// The starts of the data set, the far one first.
    starts: Vec<Vec<f64>>,
    /// Certified parameters.
    expected: Vec<f64>,
    /// Certified residual sum of squares.
    sum_of_squares: f64,
}

fn assert_certified(reference: &Reference) {
    for start in &reference.starts {
        let found = solve(reference.objective.as_ref(), start);
        assert_found(&found, &reference.expected, 1e-6);
        let ratio = 2.0 * found.value / reference.sum_of_squares;
        assert!(
            (ratio - 1.0).abs() < 1e-9,
            "sum of squares off by {:e}",
            ratio - 1.0
        );
    }
}

#[test]
fn nist_misra1a_is_solved_as_certified() {
    assert_certified(&Reference {
        objective: Box::new(fit(&MISRA1A, |[b1, b2], x| {
            let e = (-b2 * x).exp();
            (b1 * (1.0 - e), [1.0 - e, b1 * x * e])
        })),
        starts: vec![vec![500.0, 1e-4], vec![250.0, 5e-4]],
        expected: vec![2.389_421_291_8e2, 5.501_564_318_1e-4],
        sum_of_squares: 1.245_513_889_4e-1,
    });
}

#[test]
fn nist_boxbod_is_solved_as_certified() {
    assert_certified(&Reference {
        objective: Box::new(fit(&BOXBOD, |[b1, b2], x| {
            let e = (-b2 * x).exp();
            (b1 * (1.0 - e), [1.0 - e, b1 * x * e])
        })),
        // From the far start every descent ends on the plateau b2 -> infinity.
        starts: vec![vec![100.0, 0.75]],
        expected: vec![2.138_094_088_9e2, 5.472_374_854_2e-1],
        sum_of_squares: 1.168_008_876_6e3,
    });
}

#[test]
fn nist_mgh09_is_solved_as_certified() {
    assert_certified(&Reference {
        objective: Box::new(fit(&MGH09, |[b1, b2, b3, b4], x| {
            let (upper, lower) = (x * x + x * b2, x * x + x * b3 + b4);
            let slope = -b1 * upper / lower.powi(2);
            (
                b1 * upper / lower,
                [upper / lower, b1 * x / lower, slope * x, slope],
            )
        })),
        starts: vec![vec![25.0, 39.0, 41.5, 39.0], vec![0.25, 0.39, 0.415, 0.39]],
        expected: vec![
            1.928_069_345_8e-1,
            1.912_823_287_3e-1,
            1.230_565_069_3e-1,
            1.360_623_306_8e-1,
        ],
        sum_of_squares: 3.075_056_038_5e-4,
    });
}

#[test]
fn nist_mgh10_is_solved_as_certified() {
    assert_certified(&Reference {
        objective: Box::new(fit(&MGH10, |[b1, b2, b3], x| {
            let e = (b2 / (x + b3)).exp();
            (
                b1 * e,
                [e, b1 * e / (x + b3), -b1 * e * b2 / (x + b3).powi(2)],
            )
        })),
        // From the far start the valley is followed, but not to its end in 3000 evaluations.
        starts: vec![vec![0.02, 4e3, 250.0]],
        expected: vec![5.609_636_471_0e-3, 6.181_346_346_3e3, 3.452_236_346_2e2],
        sum_of_squares: 8.794_585_517_1e1,
    });
}

#[test]
fn nist_rat43_is_solved_as_certified() {
    assert_certified(&Reference {
        objective: Box::new(fit(&RAT43, |[b1, b2, b3, b4], x| {
            let e = (b2 - b3 * x).exp();
            let power = (1.0 + e).powf(-1.0 / b4);
            let inner = -b1 * power / b4 * e / (1.0 + e);
            (
                b1 * power,
                [
                    power,
                    inner,
                    -x * inner,
                    b1 * power * (1.0 + e).ln() / (b4 * b4),
                ],
            )
        })),
        starts: vec![vec![100.0, 10.0, 1.0, 1.0], vec![700.0, 5.0, 0.75, 1.3]],
        expected: vec![
            6.996_415_127_0e2,
            5.277_125_302_5,
            7.596_293_832_9e-1,
            1.279_248_385_9,
        ],
        sum_of_squares: 8.786_404_908_0e3,
    });
}

#[test]
fn nist_thurber_is_solved_as_certified() {
    assert_certified(&Reference {
        objective: Box::new(fit(&THURBER, |[b1, b2, b3, b4, b5, b6, b7], x| {
            let upper = b1 + x * (b2 + x * (b3 + x * b4));
            let lower = 1.0 + x * (b5 + x * (b6 + x * b7));
            let slope = -upper / lower.powi(2);
            let up = [1.0, x, x * x, x.powi(3)].map(|power| power / lower);
            let down = [x, x * x, x.powi(3)].map(|power| power * slope);
            (
                upper / lower,
                [up[0], up[1], up[2], up[3], down[0], down[1], down[2]],
            )
        })),
        starts: vec![
            vec![1000.0, 1000.0, 400.0, 40.0, 0.7, 0.3, 0.03],
            vec![1300.0, 1500.0, 500.0, 75.0, 1.0, 0.4, 0.05],
        ],
        expected: vec![
            1.288_139_680_0e3,
            1.491_079_253_5e3,
            5.832_383_687_7e2,
            7.541_664_429_1e1,
            9.662_950_286_4e-1,
            3.979_728_579_7e-1,
            4.972_729_734_9e-2,
        ],
        sum_of_squares: 5.642_708_239_7e3,
    });
}

/// Powell's singular function (1962): the Jacobian loses rank 2 at the solution, 0.
#[test]
fn powell_singular_function_is_solved_although_the_curvature_vanishes() {
    let (five, ten) = (5.0_f64.sqrt(), 10.0_f64.sqrt());
    let objective = LeastSquares {
        dimension: 4,
        residuals: move |x: &[f64]| {
            let (a, b) = (x[1] - 2.0 * x[2], x[0] - x[3]);
            let jacobian = [
                [1.0, 10.0, 0.0, 0.0],
                [0.0, 0.0, five, -five],
                [0.0, 2.0 * a, -4.0 * a, 0.0],
                [2.0 * ten * b, 0.0, 0.0, -2.0 * ten * b],
            ];
            (
                point(&[x[0] + 10.0 * x[1], five * (x[2] - x[3]), a * a, ten * b * b]),
                DMatrix::from_fn(4, 4, |i, j| jacobian[i][j]),
            )
        },
    };
    let found = solve(&objective, &[3.0, -1.0, 0.0, 1.0]);
    // The objective vanishes with the fourth power of the distance.
    assert!(
        found.termination.is_minimum() && found.x.amax() < 1e-6,
        "{found:?}"
    );
}

/// Powell's badly scaled function (1970), solution 1.098...e-5, 9.106...
#[test]
fn powell_badly_scaled_function_is_solved() {
    let objective = LeastSquares {
        dimension: 2,
        residuals: |x: &[f64]| {
            (
                point(&[
                    1e4 * x[0] * x[1] - 1.0,
                    (-x[0]).exp() + (-x[1]).exp() - 1.0001,
                ]),
                DMatrix::from_row_slice(
                    2,
                    2,
                    &[1e4 * x[1], 1e4 * x[0], -(-x[0]).exp(), -(-x[1]).exp()],
                ),
            )
        },
    };
    let found = solve(&objective, &[0.0, 1.0]);
    assert_found(&found, &[1.098_159_329_7e-5, 9.106_146_739_9], 1e-8);
}

/// The value falls towards the bound (1, 1) and, on the way, along it.
#[test]
fn a_minimum_in_a_corner_is_reached_exactly() {
    let corner = bounds(&[1.0, 1.0], &[4.0, 4.0]);
    let found = solve_within(&rosenbrock(10.0), &corner, &[3.0, 2.0]);
    assert_eq!(found.x, point(&[1.0, 1.0]));
    let all_held = solve_within(&tilted(), &bounds(&[0.0, 0.0], &[2.0, 3.0]), &[1.0, 1.0]);
    assert_eq!(all_held.x, point(&[2.0, 0.0]));
    assert!(all_held.termination.is_minimum());
}

/// `(x - 5)^2 / 2 + (y + 7)^2 / 2`, coupled.
fn tilted() -> LeastSquares<impl Fn(&[f64]) -> Residuals + Sync> {
    LeastSquares {
        dimension: 2,
        residuals: |x: &[f64]| {
            (
                point(&[x[0] - 5.0 + 0.5 * x[1], x[1] + 7.0]),
                DMatrix::from_row_slice(2, 2, &[1.0, 0.5, 0.0, 1.0]),
            )
        },
    }
}

#[test]
fn a_constrained_rosenbrock_has_its_minimum_on_the_bound() {
    // On x = 0.5 the valley's floor is y = 0.25; value ((1 - 0.5)^2) / 2.
    let half = bounds(&[-2.0, -2.0], &[0.5, 2.0]);
    let found = solve_within(&rosenbrock(10.0), &half, &[-1.2, 1.0]);
    assert_found(&found, &[0.5, 0.25], 1e-9);
    assert!((found.value - 0.125).abs() < 1e-12);
}

#[test]
fn an_exactly_flat_direction_does_not_disturb_the_others() {
    let objective = LeastSquares {
        dimension: 3,
        residuals: |x: &[f64]| {
            let sum = x[0] + 1e-6 * x[1];
            (
                point(&[sum.exp() - 2.0, sum - 1.0]),
                DMatrix::from_row_slice(2, 3, &[sum.exp(), 1e-6 * sum.exp(), 0.0, 1.0, 1e-6, 0.0]),
            )
        },
    };
    let found = solve(&objective, &[4.0, 3.0, 7.0]);
    assert!(found.termination.is_minimum());
    // Where exp(s) (exp(s) - 2) + s - 1 = 0.
    let sum = found.x[0] + 1e-6 * found.x[1];
    assert!(
        (sum.exp() * (sum.exp() - 2.0) + sum - 1.0).abs() < 1e-6,
        "{found:?}"
    );
    assert!(found.cost.evaluations() < 30, "{:?}", found.cost);
}

/// `(x - 2)^2` where `x <= limit`, nothing beyond.
fn cut_off(limit: f64) -> impl Objective {
    struct CutOff(f64);
    impl Objective for CutOff {
        fn dimension(&self) -> usize {
            1
        }
        fn value(&self, x: &DVector<f64>) -> Option<f64> {
            (x[0] <= self.0).then(|| (x[0] - 2.0).powi(2))
        }
        fn expansion(&self, x: &DVector<f64>) -> Option<Expansion> {
            self.value(x).map(|value| Expansion {
                value,
                gradient: point(&[2.0 * (x[0] - 2.0)]),
                curvature: DMatrix::from_element(1, 1, 0.5),
            })
        }
    }
    CutOff(limit)
}

#[test]
fn a_step_out_of_the_domain_is_shortened() {
    // The curvature is four times too small: the first step goes to 6.
    let found = solve(&cut_off(2.5), &[0.0]);
    assert_found(&found, &[2.0], 1e-6);
}

#[test]
fn the_edge_of_the_domain_is_not_a_minimum() {
    let found = solve(&cut_off(1.0), &[0.0]);
    assert!(
        matches!(found.termination, Termination::EdgeOfDomain { .. }),
        "{found:?}"
    );
    assert!(found.x[0] > 0.99, "{found:?}");
    let refused = minimise(
        &cut_off(1.0),
        &bounds(&[0.0], &[9.0]),
        &point(&[1.5]),
        &Options::default(),
        &never,
    );
    assert_eq!(
        refused.map(|found| found.x),
        Err(UndefinedStart {
            cost: Cost {
                expansions: 1,
                ..Cost::default()
            }
        })
    );
}

#[test]
fn a_saddle_point_is_left_downwards() {
    let found = solve_within(
        &SIX_HUMP_CAMEL,
        &bounds(&[-3.0, -2.0], &[3.0, 2.0]),
        &[0.0, 0.0],
    );
    assert!((found.value + 1.031_628).abs() < 1e-6, "{found:?}");
}

#[test]
fn limits_and_cancellation_end_with_the_best_point_so_far() {
    let start = point(&[-1.2, 1.0]);
    let area = bounds(&[-5.0, -5.0], &[5.0, 5.0]);
    let few = Options {
        evaluations_max: 5,
        ..Options::default()
    };
    let limited = minimise(&rosenbrock(10.0), &area, &start, &few, &never).unwrap();
    assert!(matches!(
        limited.termination,
        Termination::EvaluationsExhausted { limit: 5, .. }
    ));
    assert!(limited.value < 12.1 && limited.cost.evaluations() <= 6);
    let cancelled = minimise(&rosenbrock(10.0), &area, &start, &few, &|| true).unwrap();
    assert_eq!(cancelled.termination, Termination::Cancelled);
    assert_eq!(cancelled.x, start);
}

const MISRA1A: [(f64, f64); 14] = [
    (77.6, 10.07),
    (114.9, 14.73),
    (141.1, 17.94),
    (190.8, 23.93),
    (239.9, 29.61),
    (289.0, 35.18),
    (332.8, 40.02),
    (378.4, 44.82),
    (434.8, 50.76),
    (477.3, 55.05),
    (536.8, 61.01),
    (593.1, 66.40),
    (689.1, 75.47),
    (760.0, 81.78),
];

const BOXBOD: [(f64, f64); 6] = [
    (1.0, 109.0),
    (2.0, 149.0),
    (3.0, 149.0),
    (5.0, 191.0),
    (7.0, 213.0),
    (10.0, 224.0),
];

const MGH09: [(f64, f64); 11] = [
    (4.0, 0.1957),
    (2.0, 0.1947),
    (1.0, 0.1735),
    (0.5, 0.16),
    (0.25, 0.0844),
    (0.167, 0.0627),
    (0.125, 0.0456),
    (0.1, 0.0342),
    (0.0833, 0.0323),
    (0.0714, 0.0235),
    (0.0625, 0.0246),
];

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

const RAT43: [(f64, f64); 15] = [
    (1.0, 16.08),
    (2.0, 33.83),
    (3.0, 65.80),
    (4.0, 97.20),
    (5.0, 191.55),
    (6.0, 326.20),
    (7.0, 386.87),
    (8.0, 520.53),
    (9.0, 590.03),
    (10.0, 651.92),
    (11.0, 724.93),
    (12.0, 699.56),
    (13.0, 689.96),
    (14.0, 637.56),
    (15.0, 717.41),
];

const THURBER: [(f64, f64); 37] = [
    (-3.067, 80.574),
    (-2.981, 84.248),
    (-2.921, 87.264),
    (-2.912, 87.195),
    (-2.840, 89.076),
    (-2.797, 89.608),
    (-2.702, 89.868),
    (-2.699, 90.101),
    (-2.633, 92.405),
    (-2.481, 95.854),
    (-2.363, 100.696),
    (-2.322, 101.060),
    (-1.501, 401.672),
    (-1.460, 390.724),
    (-1.274, 567.534),
    (-1.212, 635.316),
    (-1.100, 733.054),
    (-1.046, 759.087),
    (-0.915, 894.206),
    (-0.714, 990.785),
    (-0.566, 1090.109),
    (-0.545, 1080.914),
    (-0.400, 1122.643),
    (-0.309, 1178.351),
    (-0.109, 1260.531),
    (-0.103, 1273.514),
    (0.010, 1288.339),
    (0.119, 1327.543),
    (0.377, 1353.863),
    (0.790, 1414.509),
    (0.963, 1425.208),
    (1.006, 1421.384),
    (1.115, 1442.962),
    (1.572, 1464.350),
    (1.841, 1468.705),
    (2.047, 1447.894),
    (2.200, 1457.628),
];
