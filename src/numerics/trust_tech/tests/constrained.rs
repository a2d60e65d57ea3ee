//! Constrained problems whose every minimum is known.

use nalgebra::DMatrix;

use super::*;
use crate::numerics::test_functions::{Derivatives, Smooth, derivative_error};

/// Constraints of `N` unknowns: values and Jacobian, equalities first.
struct Smoothly<const N: usize, const M: usize> {
    equalities: usize,
    of: fn([f64; N]) -> Linearised<N, M>,
}

type Linearised<const N: usize, const M: usize> = ([f64; M], [[f64; N]; M]);

impl<const N: usize, const M: usize> Constraints for Smoothly<N, M> {
    fn equalities(&self) -> usize {
        self.equalities
    }

    fn inequalities(&self) -> usize {
        M - self.equalities
    }

    fn values(&self, p: &DVector<f64>) -> Option<DVector<f64>> {
        Some(DVector::from_row_slice(
            &(self.of)(std::array::from_fn(|i| p[i])).0,
        ))
    }

    fn jacobian(&self, p: &DVector<f64>) -> Option<DMatrix<f64>> {
        let (_, jacobian) = (self.of)(std::array::from_fn(|i| p[i]));
        Some(DMatrix::from_fn(M, N, |i, j| jacobian[i][j]))
    }
}

fn run(
    objective: &dyn Objective,
    constraints: &dyn Constraints,
    bounds: &Bounds,
    start: &[f64],
) -> Search {
    let problem = ConstrainedProblem {
        objective,
        constraints,
        bounds,
    };
    let options = Options {
        tiers_max: 20,
        ..Options::default()
    };
    let start = point(start);
    assert_derivatives(objective, constraints, &start);
    search_constrained(
        &problem,
        &Starts::only(&[start]),
        &[],
        &close,
        &options,
        &never,
    )
}

fn assert_derivatives(objective: &dyn Objective, constraints: &dyn Constraints, x: &DVector<f64>) {
    let (gradient, hessian) = derivative_error(objective, x);
    assert!(
        gradient < 1e-7 && hessian < 1e-7,
        "{gradient:e} {hessian:e}"
    );
    let jacobian = constraints.jacobian(x).unwrap();
    for i in 0..x.len() {
        let (mut ahead, mut behind) = (x.clone(), x.clone());
        ahead[i] += 1e-6;
        behind[i] -= 1e-6;
        let (ahead, behind) = (
            constraints.values(&ahead).unwrap(),
            constraints.values(&behind).unwrap(),
        );
        let error = ((ahead - behind) / 2e-6 - jacobian.column(i)).amax();
        assert!(error < 1e-7 * jacobian.amax().max(1.0), "{error:e}");
    }
}

/// `-xyz`.
const MINUS_VOLUME: Smooth<3> = Smooth {
    of: |[x, y, z]| {
        Some(Derivatives {
            value: -x * y * z,
            gradient: [-y * z, -x * z, -x * y],
            hessian: [[0.0, -z, -y], [-z, 0.0, -x], [-y, -x, 0.0]],
        })
    },
};

/// Hock and Schittkowski (1981), problem 29: four minima of value `-16 sqrt(2)`.
#[test]
fn hock_schittkowski_29_has_four_minima() {
    let ellipsoid = Smoothly {
        equalities: 0,
        of: |[x, y, z]: [f64; 3]| {
            (
                [x * x + 2.0 * y * y + 4.0 * z * z - 48.0],
                [[2.0 * x, 4.0 * y, 8.0 * z]],
            )
        },
    };
    let (y, value) = (8.0_f64.sqrt(), -16.0 * 2.0_f64.sqrt());
    let found = run(
        &MINUS_VOLUME,
        &ellipsoid,
        &bounds(&[-8.0; 3], &[8.0; 3]),
        &[1.0, 1.1, 0.9],
    );
    let expected = [
        [4.0, y, 2.0],
        [4.0, -y, -2.0],
        [-4.0, y, -2.0],
        [-4.0, -y, 2.0],
    ];
    assert_minima(&found, &expected.map(|x| (x, value)));
}

/// Hock and Schittkowski (1981), problem 71.
#[test]
fn hock_schittkowski_71_is_solved_as_published() {
    let objective = Smooth {
        of: |[a, b, c, d]: [f64; 4]| {
            Some(Derivatives {
                value: a * d * (a + b + c) + c,
                gradient: [d * (2.0 * a + b + c), a * d, a * d + 1.0, a * (a + b + c)],
                hessian: [
                    [2.0 * d, d, d, 2.0 * a + b + c],
                    [d, 0.0, 0.0, a],
                    [d, 0.0, 0.0, a],
                    [2.0 * a + b + c, a, a, 0.0],
                ],
            })
        },
    };
    let constraints = Smoothly {
        equalities: 1,
        of: |[a, b, c, d]: [f64; 4]| {
            (
                [a * a + b * b + c * c + d * d - 40.0, 25.0 - a * b * c * d],
                [
                    [2.0 * a, 2.0 * b, 2.0 * c, 2.0 * d],
                    [-b * c * d, -a * c * d, -a * b * d, -a * b * c],
                ],
            )
        },
    };
    let problem = ConstrainedProblem {
        objective: &objective,
        constraints: &constraints,
        bounds: &bounds(&[1.0; 4], &[5.0; 4]),
    };
    let start = point(&[1.0, 5.0, 5.0, 1.0]);
    assert_derivatives(&objective, &constraints, &start);
    // The local solver alone.
    let options = Options {
        tiers_max: 0,
        ..Options::default()
    };
    let found = search_constrained(
        &problem,
        &Starts::only(&[start]),
        &[],
        &close,
        &options,
        &never,
    );
    let best = &found.best().unwrap().local;
    assert!((best.value - 17.014_017_3).abs() < 1e-6, "{best:?}");
    let error = (&best.x - point(&[1.0, 4.742_999_4, 3.821_150_3, 1.379_408_2])).amax();
    assert!(error < 1e-5, "{best:?}");
}

/// On the unit sphere `x^4 + y^4 + z^4` is lowest, 1/3, on the eight diagonals.
#[test]
fn a_quartic_on_a_sphere_has_its_minima_on_the_diagonals() {
    let quartic = Smooth {
        of: |x: [f64; 3]| {
            let mut hessian = [[0.0; 3]; 3];
            for (i, row) in hessian.iter_mut().enumerate() {
                row[i] = 12.0 * x[i].powi(2);
            }
            Some(Derivatives {
                value: x.iter().map(|x| x.powi(4)).sum(),
                gradient: x.map(|x| 4.0 * x.powi(3)),
                hessian,
            })
        },
    };
    let sphere = Smoothly {
        equalities: 1,
        of: |[x, y, z]: [f64; 3]| ([x * x + y * y + z * z - 1.0], [[2.0 * x, 2.0 * y, 2.0 * z]]),
    };
    let found = run(
        &quartic,
        &sphere,
        &bounds(&[-1.5; 3], &[1.5; 3]),
        &[0.9, 0.3, -0.2],
    );
    let third = 3.0_f64.sqrt().recip();
    let sign = |bits: usize, i: usize| if bits >> i & 1 == 1 { third } else { -third };
    let expected: [_; 8] =
        std::array::from_fn(|bits| ([0, 1, 2].map(|i| sign(bits, i)), 1.0 / 3.0));
    assert_minima(&found, &expected);
}

/// `(x - 0.1)^2 + (y^2 - 1)^2 + y / 10` where `cos(pi x) <= -1/2`: four strips around x = -3, -1,
/// 1, 3, with two wells each.
#[test]
fn every_minimum_in_four_disconnected_components_is_found() {
    let objective = Smooth {
        of: |[x, y]: [f64; 2]| {
            Some(Derivatives {
                value: (x - 0.1).powi(2) + (y * y - 1.0).powi(2) + 0.1 * y,
                gradient: [2.0 * (x - 0.1), 4.0 * y * (y * y - 1.0) + 0.1],
                hessian: [[2.0, 0.0], [0.0, 12.0 * y * y - 4.0]],
            })
        },
    };
    let strips = Smoothly {
        equalities: 0,
        of: |[x, _]: [f64; 2]| {
            let pi = std::f64::consts::PI;
            ([(pi * x).cos() + 0.5], [[-pi * (pi * x).sin(), 0.0]])
        },
    };
    // In each strip the edge next to 0.1; y where 4 y (y^2 - 1) + 0.1 = 0, by Newton's method.
    let mut expected = Vec::new();
    for x in [-8.0 / 3.0, -2.0 / 3.0, 2.0 / 3.0, 8.0 / 3.0] {
        for well in [-1.0_f64, 1.0] {
            let mut y = well;
            for _ in 0..20 {
                y -= (4.0 * y * (y * y - 1.0) + 0.1) / (12.0 * y * y - 4.0);
            }
            expected.push(([x, y], objective.value(&point(&[x, y])).unwrap()));
        }
    }
    let area = bounds(&[-3.5, -2.0], &[3.5, 2.0]);
    for start in [[0.0, 0.3], [3.4, -1.9]] {
        assert_minima(&run(&objective, &strips, &area, &start), &expected);
    }
}

#[test]
fn two_constrained_runs_give_the_same_bits() {
    let ellipsoid = Smoothly {
        equalities: 0,
        of: |[x, y, z]: [f64; 3]| {
            (
                [x * x + 2.0 * y * y + 4.0 * z * z - 48.0],
                [[2.0 * x, 4.0 * y, 8.0 * z]],
            )
        },
    };
    let area = bounds(&[-8.0; 3], &[8.0; 3]);
    let twice = || {
        format!(
            "{:?}",
            run(&MINUS_VOLUME, &ellipsoid, &area, &[1.0, 1.1, 0.9])
        )
    };
    assert_eq!(twice(), twice());
}

/// A start from which no feasible point can be reached: two discs that do not meet.
#[test]
fn contradicting_constraints_end_without_a_solution() {
    let discs = Smoothly {
        equalities: 0,
        of: |[x, y, _]: [f64; 3]| {
            (
                [
                    (x - 2.0).powi(2) + y * y - 1.0,
                    (x + 2.0).powi(2) + y * y - 1.0,
                ],
                [
                    [2.0 * (x - 2.0), 2.0 * y, 0.0],
                    [2.0 * (x + 2.0), 2.0 * y, 0.0],
                ],
            )
        },
    };
    let found = run(
        &MINUS_VOLUME,
        &discs,
        &bounds(&[-4.0; 3], &[4.0; 3]),
        &[0.3, 0.2, 1.0],
    );
    assert_eq!(found.ended, Ended::NoSolution);
    assert!(found.solutions.is_empty());
}
