//! Gram matrix of one event: the weighted products of all columns of the linear model (10) and the
//! measurement. Everything a joint fit needs of an event is in these 66 numbers.

use nalgebra::SMatrix;

use super::{
    intake::PreparedEvent,
    joint_problem::{LINEAR, OUTER},
    measurement_chain::StaticResponse,
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

/// Columns of the linear model (10) at one sample, P row then Q row: what the motor gives to
/// either, and the static load.
pub(super) fn linear_rows(motor: [f64; 2], load: &StaticResponse) -> [[f64; LINEAR]; 2] {
    let StaticResponse { square, line, .. } = load;
    [
        [motor[0], square[0], line[0], -square[1], -line[1]],
        [motor[1], square[1], line[1], square[0], line[0]],
    ]
}

/// P and Q over P0 that the instrument reports of the load before the event.
pub(super) fn at_rest(event: &PreparedEvent, load: &StaticResponse) -> [f64; 2] {
    let q0 = event.q0_pu / event.p0_pu;
    let [p, q] = load.unity;
    [p - q0 * q, q + q0 * p]
}

/// What the motor adds to its power at rest, as the instrument reports it.
pub(super) fn motor_change<S: Scalar>(
    event: &PreparedEvent,
    out: &MotorOutput<S>,
    rest: S,
    frequency_scaled: bool,
) -> Vec<[S; 2]> {
    let df = event.chain.output_frequency_deviation();
    let active: Vec<S> = (out.active.iter().zip(df))
        .map(|(&p, df)| if frequency_scaled { p * (1.0 + df) } else { p } + -1.0)
        .collect();
    let reactive: Vec<S> = out.reactive.iter().map(|&q| q - rest).collect();
    event.chain.measured(&active, &reactive)
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
    let mut near_jumps = Gram::zeros();
    let q0 = event.q0_pu / event.p0_pu;
    let motor = motor_change(event, out, rest, frequency_scaled);
    let mut filtered = event.chain.filtered().iter().peekable();
    for k in 0..event.len() {
        let here = filtered.next_if(|f| f.sample == k);
        if !event.used[k] {
            continue;
        }
        let slopes = motor[k].map(&derivatives);
        let motor = motor[k].map(S::value);
        let measured = [event.active[k], event.reactive[k]];
        let deviations = [event.active_deviation[k], event.reactive_deviation[k]];
        if let Some(here) = here {
            let load = here.static_response();
            let rows = full_rows(event, (slopes, motor), measured, &load);
            for (row, deviation) in rows.iter().zip(deviations) {
                add_row::<FIRST>(&mut near_jumps, row, 1.0 / (deviation * deviation));
            }
            continue;
        }
        let v = event.voltage[k];
        let (square, line) = (v * v - 1.0, v - 1.0);
        let rest = [1.0, q0];
        for (channel, (sum, deviation)) in sums.iter_mut().zip(deviations).enumerate() {
            let [a, b, c] = slopes[channel];
            let change = measured[channel] - rest[channel];
            let row = [a, b, c, motor[channel], square, line, 1.0, change];
            let weight = 1.0 / (deviation * deviation);
            for i in FIRST..FILLED {
                let scaled = weight * row[i];
                for j in i..FILLED {
                    sum[i][j] += scaled * row[j];
                }
            }
        }
    }
    near_jumps.fill_lower_triangle_with_upper_triangle();
    scattered(&sums) + near_jumps
}

/// Rows of P and Q near a jump, where the filter mixes them: every column is filled.
fn full_rows(
    event: &PreparedEvent,
    (slopes, motor): ([[f64; OUTER]; 2], [f64; 2]),
    measured: [f64; 2],
    load: &StaticResponse,
) -> [[f64; COLUMNS]; 2] {
    let linear = linear_rows(motor, load);
    let rest = at_rest(event, load);
    let [unity, crossed] = load.unity;
    let offsets = [[unity, -crossed], [crossed, unity]];
    std::array::from_fn(|channel| {
        let mut row = [0.0; COLUMNS];
        row[..OUTER].copy_from_slice(&slopes[channel]);
        row[OUTER..OUTER + LINEAR].copy_from_slice(&linear[channel]);
        row[OUTER + LINEAR..Y].copy_from_slice(&offsets[channel]);
        row[Y] = measured[channel] - rest[channel];
        row
    })
}

fn add_row<const FIRST: usize>(gram: &mut Gram, row: &[f64; COLUMNS], weight: f64) {
    for i in FIRST..COLUMNS {
        let scaled = weight * row[i];
        for j in i..COLUMNS {
            gram[(i, j)] += scaled * row[j];
        }
    }
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
