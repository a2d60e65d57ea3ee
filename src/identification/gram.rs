//! Gram matrix of one event: the weighted products of all columns of the linear model (10) and the
//! measurement. Everything a joint fit needs of an event is in these 66 numbers.
//!
//! Only four of the eleven columns depend on the motor: its own and its three sensitivities. What the
//! others give among themselves is summed once per problem ([`EventColumns`]); a simulation then costs the
//! products of its columns with one another and with the fixed ones. Sums run over all output
//! instants, in which those that are no measured sample of the fit have weight zero, and in a
//! fixed number of partial sums: the order does not depend on the instruction set.

use nalgebra::SMatrix;
use pulp::{Arch, Simd, WithSimd};

use super::{
    intake::PreparedEvent,
    joint_problem::{LINEAR, OUTER, OuterSensitivities},
    measurement_chain::{FilteredSample, StaticResponse},
};
use crate::{
    load_model::{
        MotorOutput,
        induction_motor::{BatchInput, BatchSink},
    },
    numerics::Scalar,
};

/// Columns: outer sensitivities, linear coefficients, operating-point offsets of P and Q, measured.
pub(super) const COLUMNS: usize = OUTER + LINEAR + 2 + 1;
/// The measured column.
pub(super) const Y: usize = COLUMNS - 1;

pub(super) type Gram = SMatrix<f64, COLUMNS, COLUMNS>;

/// The motor's column; those before it are its sensitivities, those behind it do not depend on the motor.
const MOTOR: usize = OUTER;
const FIRST_FIXED: usize = MOTOR + 1;
const FIXED: usize = COLUMNS - FIRST_FIXED;

/// Fixed columns that a row of one channel fills away from jumps, of P and of Q: `v^2 - 1`, `v - 1`, offset,
/// measured. The other channel's are zero there.
const FILLED: usize = 4;
const PLACES: [[usize; FILLED]; 2] = [[4, 5, 8, Y], [6, 7, 9, Y]];
/// The offset's column is 1: its weighted column is the weight itself.
const OFFSET: usize = 2;

/// Partial sums side by side. Chosen: four suit every instruction set.
const LANES: usize = 4;
type Lanes = [f64; LANES];

/// Columns of the linear model (10) at one sample, P row then Q row: what the motor gives to
/// either, and the static load.
pub(super) fn linear_rows(motor: [f64; 2], load: &StaticResponse) -> [[f64; LINEAR]; 2] {
    let StaticResponse { square, line, .. } = load;
    [
        [motor[0], square[0], line[0], -square[1], -line[1]],
        [motor[1], square[1], line[1], square[0], line[0]],
    ]
}

/// What an event's own reactive coefficients add to those of the site, given its columns.
pub(super) fn own_reactive(event: &PreparedEvent, linear: &[[f64; LINEAR]; 2]) -> [f64; 2] {
    let [z, i] = event.reactive_offset;
    linear.map(|row| z * row[3] + i * row[4])
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
) -> Vec<[S; 2]> {
    let active: Vec<S> = out.active.iter().map(|&p| p + -1.0).collect();
    let reactive: Vec<S> = out.reactive.iter().map(|&q| q - rest).collect();
    event.chain.measured(&active, &reactive)
}

/// What the motors of a batch draw at the output instants, kept per motor: the derivatives in order, then the
/// power itself; of each P, then Q, filled up to a whole number of [`LANES`].
pub(super) struct KeptSeries {
    length: usize,
    derivatives: usize,
    powers: Vec<f64>,
}

impl KeptSeries {
    /// Room for `motors` series of `length`, each with so many derivatives.
    pub(super) fn new(motors: usize, derivatives: usize, length: usize) -> Self {
        Self {
            length,
            derivatives,
            powers: vec![0.0; motors * 2 * (derivatives + 1) * length],
        }
    }

    /// The series of each motor, in order.
    pub(super) fn of_motors(&mut self) -> impl Iterator<Item = &mut [f64]> {
        let size = 2 * (self.derivatives + 1) * self.length;
        self.powers.chunks_exact_mut(size)
    }

    #[allow(
        clippy::inline_always,
        reason = "compiled for the instruction set of the simulation"
    )]
    #[inline(always)]
    fn keep(&mut self, column: usize, instant: usize, motors: &[usize], powers: [&[f64]; 2]) {
        let columns = self.derivatives + 1;
        for ((motor, p), q) in motors.iter().zip(powers[0]).zip(powers[1]) {
            let at = 2 * (motor * columns + column) * self.length + instant;
            self.powers[at] = *p;
            self.powers[at + self.length] = *q;
        }
    }
}

#[allow(
    clippy::inline_always,
    reason = "compiled for the instruction set of the simulation"
)]
impl BatchSink for KeptSeries {
    #[inline(always)]
    fn output(&mut self, instant: usize, motors: &[usize], active: &[f64], reactive: &[f64]) {
        self.keep(self.derivatives, instant, motors, [active, reactive]);
    }

    #[inline(always)]
    fn slope(
        &mut self,
        instant: usize,
        motors: &[usize],
        index: usize,
        active: &[f64],
        reactive: &[f64],
    ) {
        self.keep(index, instant, motors, [active, reactive]);
    }
}

/// What an event's Gram matrix is made of besides the motor's columns.
#[derive(Debug)]
pub(super) struct EventColumns<'a> {
    /// The event's input, made ready.
    pub(super) input: BatchInput<'a>,
    /// Products of the fixed columns among themselves.
    fixed: Gram,
    /// Per channel and output instants: the fixed columns times their weight; zero at instants that are
    /// no sample of the fit or lie near a jump.
    weighted: [Vec<[Lanes; FILLED]>; 2],
    near_jumps: Vec<NearJump<'a>>,
}

/// Rows of P and Q at a sample of the fit near a jump, where the filter mixes them.
#[derive(Debug)]
struct NearJump<'a> {
    sample: &'a FilteredSample,
    weights: [f64; 2],
    fixed: [[f64; FIXED]; 2],
}

impl<'a> EventColumns<'a> {
    /// The fixed part of an event's Gram matrix.
    pub(super) fn new(event: &'a PreparedEvent) -> Self {
        let instants = event.input.output_count();
        let blocks = instants.div_ceil(LANES);
        let mut columns = Self {
            input: BatchInput::new(&event.input),
            fixed: Gram::zeros(),
            weighted: std::array::from_fn(|_| vec![[[0.0; LANES]; FILLED]; blocks]),
            near_jumps: Vec::new(),
        };
        let mut filtered = event.chain.filtered().iter().peekable();
        for k in 0..event.len() {
            let here = filtered.next_if(|f| f.sample == k);
            if !event.used[k] {
                continue;
            }
            let load = here.map_or_else(
                || StaticResponse::direct(event.voltage[k]),
                FilteredSample::static_response,
            );
            let fixed = fixed_rows(event, k, &load);
            let weights = [event.active_deviation[k], event.reactive_deviation[k]]
                .map(|deviation| 1.0 / (deviation * deviation));
            for (row, weight) in fixed.iter().zip(weights) {
                columns.add_fixed(row, weight);
            }
            match here {
                Some(sample) => columns.near_jumps.push(NearJump {
                    sample,
                    weights,
                    fixed,
                }),
                None => columns.add_sample(event.chain.instant(k), &fixed, weights),
            }
        }
        columns.fixed.fill_lower_triangle_with_upper_triangle();
        columns
    }

    fn add_fixed(&mut self, row: &[f64; FIXED], weight: f64) {
        for i in 0..FIXED {
            let scaled = weight * row[i];
            for (j, x) in row.iter().enumerate().skip(i) {
                self.fixed[(FIRST_FIXED + i, FIRST_FIXED + j)] += scaled * x;
            }
        }
    }

    fn add_sample(&mut self, instant: usize, fixed: &[[f64; FIXED]; 2], weights: [f64; 2]) {
        for channel in 0..2 {
            let block = &mut self.weighted[channel][instant / LANES];
            for (column, place) in block.iter_mut().zip(PLACES[channel]) {
                column[instant % LANES] = weights[channel] * fixed[channel][place - FIRST_FIXED];
            }
        }
    }

    /// Length of a series: the output instants and what fills them up.
    pub(super) fn series_length(&self) -> usize {
        self.weighted[0].len() * LANES
    }

    /// The Gram matrix without sensitivities: those columns stay zero. `series` is what the motor draws (see
    /// [`KeptSeries`]); it is overwritten.
    pub(super) fn plain_gram(&self, series: &mut [f64], rest: f64) -> Gram {
        self.filled_gram::<1>(series, &[rest])
    }

    /// The Gram matrix with sensitivities.
    pub(super) fn sensitivity_gram(&self, series: &mut [f64], rest: OuterSensitivities) -> Gram {
        let rest: [f64; OUTER + 1] = std::array::from_fn(|i| component(&rest, i));
        self.filled_gram(series, &rest)
    }

    fn filled_gram<const N: usize>(&self, series: &mut [f64], rest: &[f64; N]) -> Gram {
        let mut parts = series.chunks_exact_mut(self.series_length());
        let columns: [[&[f64]; 2]; N] = std::array::from_fn(|i| {
            let [active, reactive] = [(); 2].map(|()| parts.next().unwrap_or_default());
            subtract(active, if i + 1 == N { 1.0 } else { 0.0 });
            subtract(reactive, rest[i]);
            [&*active, &*reactive]
        });
        // The sums are in a fixed order, so that the instruction set changes their speed alone.
        Arch::new().dispatch(GramOf {
            event: self,
            columns: &columns,
        })
    }

    /// The Gram matrix with the last `N` columns up to the motor's.
    #[allow(
        clippy::inline_always,
        reason = "compiled for the instruction set at hand"
    )]
    #[inline(always)]
    fn gram<const N: usize>(&self, columns: &[[&[f64]; 2]; N]) -> Gram {
        let first = FIRST_FIXED - N;
        let mut gram = self.fixed;
        let mut weighted = vec![[0.0; LANES]; self.weighted[0].len()];
        for channel in 0..2 {
            for i in 0..N {
                let column = columns[i][channel];
                let sums = with_fixed(column, &self.weighted[channel], &mut weighted);
                for (place, sum) in PLACES[channel].into_iter().zip(sums) {
                    gram[(first + i, place)] += sum;
                }
                for j in i..N {
                    gram[(first + i, first + j)] += product(&weighted, columns[j][channel]);
                }
            }
        }
        for near in &self.near_jumps {
            near.add_to(&mut gram, columns);
        }
        gram.fill_lower_triangle_with_upper_triangle();
        gram
    }
}

/// The call of [`EventColumns::gram`] on the instruction set at hand.
struct GramOf<'a, const N: usize> {
    event: &'a EventColumns<'a>,
    columns: &'a [[&'a [f64]; 2]; N],
}

impl<const N: usize> WithSimd for GramOf<'_, N> {
    type Output = Gram;

    #[allow(
        clippy::inline_always,
        reason = "compiled for the instruction set at hand"
    )]
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> Gram {
        self.event.gram(self.columns)
    }
}

impl NearJump<'_> {
    fn add_to<const N: usize>(&self, gram: &mut Gram, columns: &[[&[f64]; 2]; N]) {
        let first = FIRST_FIXED - N;
        let motor = columns.map(|[active, reactive]| self.sample.measured(active, reactive));
        for (channel, fixed) in self.fixed.iter().enumerate() {
            for i in 0..N {
                let scaled = self.weights[channel] * motor[i][channel];
                for j in i..N {
                    gram[(first + i, first + j)] += scaled * motor[j][channel];
                }
                for (j, fixed) in fixed.iter().enumerate() {
                    gram[(first + i, FIRST_FIXED + j)] += scaled * fixed;
                }
            }
        }
    }
}

/// A sensitivity, or the value behind the sensitivities.
fn component(x: &OuterSensitivities, index: usize) -> f64 {
    if index < OUTER {
        x.derivative(index)
    } else {
        x.value
    }
}

/// The fixed columns of one sample, P row then Q row.
fn fixed_rows(event: &PreparedEvent, k: usize, load: &StaticResponse) -> [[f64; FIXED]; 2] {
    let linear = linear_rows([0.0; 2], load);
    let rest = at_rest(event, load);
    let measured = [event.active[k], event.reactive[k]];
    let own = own_reactive(event, &linear);
    let [unity, crossed] = load.unity;
    let offsets = [[unity, -crossed], [crossed, unity]];
    std::array::from_fn(|channel| {
        let mut row = [0.0; FIXED];
        row[..LINEAR - 1].copy_from_slice(&linear[channel][1..]);
        row[LINEAR - 1..FIXED - 1].copy_from_slice(&offsets[channel]);
        row[FIXED - 1] = measured[channel] - rest[channel] - own[channel];
        row
    })
}

fn subtract(series: &mut [f64], rest: f64) {
    for x in series {
        *x -= rest;
    }
}

#[allow(
    clippy::inline_always,
    reason = "compiled for the instruction set at hand"
)]
#[inline(always)]
/// Sums of a column times the weighted fixed ones; `weighted` becomes the column times its weight.
fn with_fixed(column: &[f64], fixed: &[[Lanes; FILLED]], weighted: &mut [Lanes]) -> [f64; FILLED] {
    let mut sums = [[0.0; LANES]; FILLED];
    for ((x, fixed), weighted) in column.chunks_exact(LANES).zip(fixed).zip(weighted) {
        for lane in 0..LANES {
            weighted[lane] = fixed[OFFSET][lane] * x[lane];
        }
        for (sum, fixed) in sums.iter_mut().zip(fixed) {
            for lane in 0..LANES {
                sum[lane] += fixed[lane] * x[lane];
            }
        }
    }
    sums.map(together)
}

#[allow(
    clippy::inline_always,
    reason = "compiled for the instruction set at hand"
)]
#[inline(always)]
fn product(weighted: &[Lanes], column: &[f64]) -> f64 {
    let mut sum = [0.0; LANES];
    for (w, x) in weighted.iter().zip(column.chunks_exact(LANES)) {
        for lane in 0..LANES {
            sum[lane] += w[lane] * x[lane];
        }
    }
    together(sum)
}

fn together([a, b, c, d]: Lanes) -> f64 {
    (a + b) + (c + d)
}
