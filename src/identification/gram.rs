//! Gram matrix of one event: the weighted products of all columns of the linear model (10) and the
//! measurement. Everything a joint fit needs of an event is in these 66 numbers.

use nalgebra::SMatrix;

use super::{
    intake::PreparedEvent,
    joint_problem::{LINEAR, OUTER},
};
use crate::{
    load_model::MotorOutput,
    numerics::{Dual, Scalar},
};

/// Columns: outer sensitivities, linear coefficients, operating-point offsets of P and Q, measured.
pub(super) const COLUMNS: usize = OUTER + LINEAR + 2 + 1;
/// The measured column.
pub(super) const Y: usize = COLUMNS - 1;

pub(super) type Gram = SMatrix<f64, COLUMNS, COLUMNS>;

/// Columns that a row of one channel fills: the other channel's static coefficients and offset are
/// zero there.
const FILLED: usize = OUTER + 5;
/// Where those of P and of Q stand among all columns.
const PLACES: [[usize; FILLED]; 2] = [[0, 1, 2, 3, 4, 5, 8, Y], [0, 1, 2, 3, 6, 7, 9, Y]];

/// Columns of the linear model (10) at one sample, P row then Q row.
pub(super) fn linear_rows(voltage: f64, active: f64, reactive_change: f64) -> [[f64; LINEAR]; 2] {
    let (square, line) = (voltage * voltage - 1.0, voltage - 1.0);
    [
        [active - 1.0, square, line, 0.0, 0.0],
        [reactive_change, 0.0, 0.0, square, line],
    ]
}

/// Without sensitivities: those columns stay zero.
pub(super) fn plain_gram(
    event: &PreparedEvent,
    out: &MotorOutput<f64>,
    rest: f64,
    frequency_scaled: bool,
) -> Gram {
    accumulate::<f64, OUTER>(event, out, rest, frequency_scaled, |_| [0.0; OUTER])
}

/// With sensitivities.
pub(super) fn sensitivity_gram(
    event: &PreparedEvent,
    out: &MotorOutput<Dual<OUTER>>,
    rest: Dual<OUTER>,
    frequency_scaled: bool,
) -> Gram {
    accumulate::<_, 0>(event, out, rest, frequency_scaled, |d| d.derivatives)
}

/// Sums over the used samples; columns before `FIRST` are left out.
fn accumulate<S: Scalar, const FIRST: usize>(
    event: &PreparedEvent,
    out: &MotorOutput<S>,
    rest: S,
    frequency_scaled: bool,
    derivatives: impl Fn(S) -> [f64; OUTER],
) -> Gram {
    let mut sums = [[[0.0; FILLED]; FILLED]; 2];
    let q0 = event.q0_pu / event.p0_pu;
    for k in (0..event.len()).filter(|&k| event.used[k]) {
        let reactive = out.reactive[k] - rest;
        let active = if frequency_scaled {
            out.active[k] * (1.0 + event.frequency_deviation[k])
        } else {
            out.active[k]
        };
        let v = event.voltage[k];
        let (square, line) = (v * v - 1.0, v - 1.0);
        let row = |motor: f64, slopes: [f64; OUTER], measured: f64| {
            let [a, b, c] = slopes;
            [a, b, c, motor, square, line, 1.0, measured]
        };
        let rows = [
            row(
                active.value() - 1.0,
                derivatives(active),
                event.active[k] - 1.0,
            ),
            row(
                reactive.value(),
                derivatives(reactive),
                event.reactive[k] - q0,
            ),
        ];
        let deviations = [event.active_deviation[k], event.reactive_deviation[k]];
        for (sum, (row, deviation)) in sums.iter_mut().zip(rows.iter().zip(deviations)) {
            let weight = 1.0 / (deviation * deviation);
            for i in FIRST..FILLED {
                let scaled = weight * row[i];
                for j in i..FILLED {
                    sum[i][j] += scaled * row[j];
                }
            }
        }
    }
    scattered(&sums)
}

fn scattered(sums: &[[[f64; FILLED]; FILLED]; 2]) -> Gram {
    let mut gram = Gram::zeros();
    for (sum, places) in sums.iter().zip(&PLACES) {
        for i in 0..FILLED {
            for j in i..FILLED {
                gram[(places[i], places[j])] += sum[i][j];
            }
        }
    }
    gram.fill_lower_triangle_with_upper_triangle();
    gram
}
