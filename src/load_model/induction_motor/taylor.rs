//! One step by the Taylor series of the bilinear system.
//!
//! With the step as unit of time and the rotation per step `r = h s`, equation (9) reads
//!
//! ```text
//! a' = h alpha (u_re - a) - r b
//! b' = h alpha (u_im - b) + r a
//! r' = h^2 nu (b0 - b u_re + a u_im)
//! ```
//!
//! so each coefficient follows from Cauchy products of those before it. Explicit, and cheap per order:
//! a step may be as long as the fastest rate's own time, whatever accuracy is asked for.

use super::input_pieces::{DEGREE, Piece};
use crate::numerics::Arithmetic;

/// Highest order.
const ORDER: usize = 14;

/// The motor's constants over one step.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepConstants<A> {
    /// `h alpha`.
    pub(super) decay: A,
    /// `h^2 nu`.
    pub(super) acceleration: A,
    /// `b0`, the torque of the load.
    pub(super) load: A,
}

/// Coefficients of flux and rotation per step, constant first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Series<A> {
    a: [A; ORDER + 1],
    b: [A; ORDER + 1],
    r: [A; ORDER + 1],
}

/// Judges a series at orders 4, 6, 8 and so on, in this order.
pub(super) trait Ending<A> {
    /// Whether the series may end at `order`, given the sizes of its last two coefficients (see
    /// [`Series::last_two`]).
    fn ends(&mut self, series: &Series<A>, order: usize) -> bool;
}

impl<A: Arithmetic> Series<A> {
    /// Extends the series from `state` (flux and rotation per step) until `ending` is content, or to
    /// the highest order. Returns the order.
    #[inline(always)]
    pub(super) fn run(
        state: [A; 3],
        motor: &StepConstants<A>,
        piece: &Piece,
        ending: &mut impl Ending<A>,
    ) -> (Self, usize) {
        let mut series = Self {
            a: [state[0]; ORDER + 1],
            b: [state[1]; ORDER + 1],
            r: [state[2]; ORDER + 1],
        };
        let u = &piece.phasor;
        // Orders as literals: each line becomes straight code without loops.
        let s = &mut series;
        s.extend_twice(0, motor, u);
        s.extend_twice(2, motor, u);
        if ending.ends(s, 4) {
            return (series, 4);
        }
        s.extend_twice(4, motor, u);
        if ending.ends(s, 6) {
            return (series, 6);
        }
        s.extend_twice(6, motor, u);
        if ending.ends(s, 8) {
            return (series, 8);
        }
        s.extend_twice(8, motor, u);
        if ending.ends(s, 10) {
            return (series, 10);
        }
        s.extend_twice(10, motor, u);
        if ending.ends(s, 12) {
            return (series, 12);
        }
        s.extend_twice(12, motor, u);
        let _ = ending.ends(s, 14);
        (series, 14)
    }

    #[inline(always)]
    fn extend_twice(&mut self, k: usize, motor: &StepConstants<A>, u: &[[f64; 2]; DEGREE + 1]) {
        self.extend(k, motor, u);
        self.extend(k + 1, motor, u);
    }

    /// Coefficients of order `k + 1` from those up to `k`. The newest factors enter the sums last, so
    /// that the older products need not wait for them.
    #[inline(always)]
    fn extend(&mut self, k: usize, motor: &StepConstants<A>, u: &[[f64; 2]; DEGREE + 1]) {
        let (a, b, r) = (&self.a, &self.b, &self.r);
        let turn = |x: &[A; ORDER + 1]| {
            if k == 0 {
                return r[0] * x[0];
            }
            let mut sum = r[0] * x[k];
            if k > 1 {
                let mut older = r[k - 1] * x[1];
                for i in 2..k {
                    older = older + r[k - i] * x[i];
                }
                sum = older + sum;
            }
            sum + r[k] * x[0]
        };
        let (turn_a, turn_b) = (turn(b), turn(a));
        let product = |i: usize| b[i] * u[k - i][0] - a[i] * u[k - i][1];
        let lowest = k.saturating_sub(DEGREE);
        let mut torque = product(lowest);
        for i in lowest + 1..=k {
            torque = torque + product(i);
        }
        let excess = if k == 0 { motor.load - torque } else { -torque };
        let drive = |x: A, part: usize| {
            let towards = if k <= DEGREE { -x + u[k][part] } else { -x };
            motor.decay * towards
        };
        let share = 1.0 / (k + 1) as f64;
        let next = [
            (drive(a[k], 0) - turn_a) * share,
            (drive(b[k], 1) + turn_b) * share,
            motor.acceleration * excess * share,
        ];
        self.a[k + 1] = next[0];
        self.b[k + 1] = next[1];
        self.r[k + 1] = next[2];
    }

    /// Flux and rotation per step at the end of the step, up to `order`.
    #[inline(always)]
    pub(super) fn sum(&self, order: usize) -> [A; 3] {
        let total = |c: &[A; ORDER + 1]| {
            let mut sum = c[order];
            for k in (0..order).rev() {
                sum = sum + c[k];
            }
            sum
        };
        [total(&self.a), total(&self.b), total(&self.r)]
    }

    /// The coefficients of `order` and the one before.
    #[inline(always)]
    pub(super) const fn last_two(&self, order: usize) -> [A; 6] {
        let (a, b, r) = (&self.a, &self.b, &self.r);
        let k = order - 1;
        [a[k], b[k], r[k], a[order], b[order], r[order]]
    }

    /// The rotation's coefficients from order one to `order`.
    #[inline(always)]
    pub(super) fn rotation(&self, order: usize) -> &[A] {
        &self.r[1..=order]
    }
}

/// Sum of the sizes of the phasor's coefficients from `order` on.
#[inline(always)]
pub(super) fn input_beyond(piece: &Piece, order: usize) -> f64 {
    let beyond = piece.phasor.iter().skip(order);
    beyond.map(|c| c[0].abs() + c[1].abs()).sum()
}
