//! One step by the three-stage Radau IIA method (order 5, L-stable), for steps that are long against
//! the decay of the flux.
//!
//! The stages solve a system of nine equations by Newton's method with the exact Jacobian. Whole step
//! and two halves are combined by Richardson's extrapolation to order 6; their difference is the
//! error estimate. Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, section
//! IV.5 (nodes and weights) and IV.8 (Newton's method); the extrapolation keeps the value 0 of the
//! stability function at infinity.

use super::{input_pieces::Piece, taylor::StepConstants};
use crate::numerics::Scalar;

const STAGES: usize = 3;
const SIZE: usize = 3 * STAGES;
const ROOT_6: f64 = 2.449_489_742_783_178;
/// Nodes: zeros of Radau's polynomial, right end included.
const NODES: [f64; STAGES] = [(4.0 - ROOT_6) / 10.0, (4.0 + ROOT_6) / 10.0, 1.0];
const WEIGHTS: [[f64; STAGES]; STAGES] = [
    [
        (88.0 - 7.0 * ROOT_6) / 360.0,
        (296.0 - 169.0 * ROOT_6) / 1800.0,
        (-2.0 + 3.0 * ROOT_6) / 225.0,
    ],
    [
        (296.0 + 169.0 * ROOT_6) / 1800.0,
        (88.0 + 7.0 * ROOT_6) / 360.0,
        (-2.0 - 3.0 * ROOT_6) / 225.0,
    ],
    [(16.0 - ROOT_6) / 36.0, (16.0 + ROOT_6) / 36.0, 1.0 / 9.0],
];
/// Newton steps at most: from a good start it takes four.
const ITERATIONS_MAX: usize = 12;
/// Newton's method has converged when no stage moves by more than this, relative to one or to the
/// rotation. It converges quadratically, so the one step that follows reaches rounding.
const CONVERGED: f64 = 1e-9;

/// State after the step and how far one whole step is from two halves, as a share of `1/31` (the
/// error of the halves). `None` if Newton's method fails: the step is too long.
pub(super) fn step<S: Scalar>(
    state: [S; 3],
    motor: &StepConstants<S>,
    piece: &Piece,
) -> Option<([S; 3], [f64; 3])> {
    let whole = single(state, motor, piece)?;
    // Half the step: rotation and decay per step halve, acceleration quarters.
    let half = StepConstants {
        decay: motor.decay * 0.5,
        acceleration: motor.acceleration * 0.25,
        load: motor.load,
    };
    let left = piece.shortened(2);
    let start = [state[0], state[1], state[2] * 0.5];
    let middle = single(start, &half, &left)?;
    let mut end = single(middle, &half, &left.next())?;
    end[2] = end[2] * 2.0;
    let correction: [S; 3] = std::array::from_fn(|i| (end[i] - whole[i]) * (1.0 / 31.0));
    let better = std::array::from_fn(|i| end[i] + correction[i]);
    Some((better, correction.map(|c| c.value().abs())))
}

fn single<S: Scalar>(state: [S; 3], motor: &StepConstants<S>, piece: &Piece) -> Option<[S; 3]> {
    let inputs = NODES.map(|x| piece.at(x));
    let mut stages = [state; STAGES];
    let mut last = false;
    for _ in 0..ITERATIONS_MAX {
        let jacobians: [_; STAGES] =
            std::array::from_fn(|i| jacobian(stages[i].map(Scalar::value), motor, inputs[i]));
        let factors = Factors::of(system(&jacobians))?;
        let mut change = residual(state, &stages, motor, &inputs);
        factors.solve(&mut change);
        let mut moved = 0.0;
        for i in 0..STAGES {
            for c in 0..3 {
                let step = change[3 * i + c];
                stages[i][c] = stages[i][c] - step;
                let size = if c == 2 {
                    stages[i][c].value().abs().max(1.0)
                } else {
                    1.0
                };
                moved += step.value().abs() / size;
            }
        }
        if last {
            return Some(stages[STAGES - 1]);
        }
        if !moved.is_finite() {
            return None;
        }
        last = moved <= CONVERGED;
    }
    None
}

fn slopes<S: Scalar>([a, b, r]: [S; 3], motor: &StepConstants<S>, [re, im]: [f64; 2]) -> [S; 3] {
    [
        motor.decay * (-a + re) - r * b,
        motor.decay * (-b + im) + r * a,
        motor.acceleration * (motor.load - b * re + a * im),
    ]
}

fn jacobian<S: Scalar>(x: [f64; 3], motor: &StepConstants<S>, u: [f64; 2]) -> [[f64; 3]; 3] {
    let (decay, acceleration) = (motor.decay.value(), motor.acceleration.value());
    [
        [-decay, -x[2], -x[1]],
        [x[2], -decay, x[0]],
        [acceleration * u[1], -acceleration * u[0], 0.0],
    ]
}

/// `X_i - x0 - sum_j A_ij f(X_j)`.
fn residual<S: Scalar>(
    start: [S; 3],
    stages: &[[S; 3]; STAGES],
    motor: &StepConstants<S>,
    inputs: &[[f64; 2]; STAGES],
) -> [S; SIZE] {
    let f: [_; STAGES] = std::array::from_fn(|j| slopes(stages[j], motor, inputs[j]));
    std::array::from_fn(|row| {
        let (i, c) = (row / 3, row % 3);
        let [p, q, r] = WEIGHTS[i];
        stages[i][c] - start[c] - (f[0][c] * p + f[1][c] * q + f[2][c] * r)
    })
}

fn system(jacobians: &[[[f64; 3]; 3]; STAGES]) -> [[f64; SIZE]; SIZE] {
    let mut matrix = [[0.0; SIZE]; SIZE];
    for i in 0..STAGES {
        for j in 0..STAGES {
            for c in 0..3 {
                for d in 0..3 {
                    matrix[3 * i + c][3 * j + d] = -WEIGHTS[i][j] * jacobians[j][c][d];
                }
            }
        }
        for c in 0..3 {
            matrix[3 * i + c][3 * i + c] += 1.0;
        }
    }
    matrix
}

/// LU factors with row exchanges.
struct Factors {
    lu: [[f64; SIZE]; SIZE],
    pivots: [usize; SIZE],
}

impl Factors {
    fn of(mut lu: [[f64; SIZE]; SIZE]) -> Option<Self> {
        let mut pivots = [0; SIZE];
        for k in 0..SIZE {
            let mut pivot = k;
            for i in k + 1..SIZE {
                if lu[i][k].abs() > lu[pivot][k].abs() {
                    pivot = i;
                }
            }
            pivots[k] = pivot;
            lu.swap(k, pivot);
            let top = lu[k];
            if top[k].abs() <= 0.0 || top[k].is_nan() {
                return None;
            }
            for row in &mut lu[k + 1..] {
                let factor = row[k] / top[k];
                row[k] = factor;
                for j in k + 1..SIZE {
                    row[j] -= factor * top[j];
                }
            }
        }
        Some(Self { lu, pivots })
    }

    fn solve<S: Scalar>(&self, x: &mut [S; SIZE]) {
        for k in 0..SIZE {
            x.swap(k, self.pivots[k]);
            for i in k + 1..SIZE {
                x[i] = x[i] - x[k] * self.lu[i][k];
            }
        }
        for k in (0..SIZE).rev() {
            for j in k + 1..SIZE {
                x[k] = x[k] - x[j] * self.lu[k][j];
            }
            x[k] = x[k] * (1.0 / self.lu[k][k]);
        }
    }
}
