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

// Closures and library iterators over the numbers are avoided here and everything is inlined by force:
// vector instructions only come out where the whole chain of calls is one function.

use super::input_pieces::{DEGREE, Piece};
use crate::numerics::Arithmetic;

/// Terms of the longest series: up to order 14.
pub(super) const LONG: usize = 15;
/// Terms of the series of a rough simulation, up to order 6: where that is not enough, its steps are halved.
pub(super) const SHORT: usize = 7;

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
pub(super) struct Series<A, const TERMS: usize> {
    a: [A; TERMS],
    b: [A; TERMS],
    r: [A; TERMS],
}

/// Judges a series at orders 4, 6, 8 and so on, in this order.
pub(super) trait Ending<A, const TERMS: usize> {
    /// Whether the series may end at `order`, given the sizes of its last two coefficients (see
    /// [`Series::last_two`]).
    fn ends(&mut self, series: &Series<A, TERMS>, order: usize) -> bool;
}

impl<A: Arithmetic> Series<A, LONG> {
    /// Extends the series from `state` (flux and rotation per step) until `ending` is content, or to
    /// the highest order. Returns the order.
    #[inline(always)]
    pub(super) fn run(
        state: [A; 3],
        motor: &StepConstants<A>,
        piece: &Piece,
        ending: &mut impl Ending<A, LONG>,
    ) -> (Self, usize) {
        let mut series = Self::from(state);
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
}

impl<A: Arithmetic> Series<A, SHORT> {
    /// Extends the series from `state` (flux and rotation per step) until `ending` is content, or to order
    /// 6. Returns the rotation's slope at the start.
    #[inline(always)]
    pub(super) fn run_short(
        state: [A; 3],
        motor: &StepConstants<A>,
        piece: &Piece,
        ending: &mut impl Ending<A, SHORT>,
    ) -> A {
        let mut series = Self::from(state);
        let s = &mut series;
        s.extend_twice(0, motor, &piece.phasor);
        s.extend_twice(2, motor, &piece.phasor);
        if !ending.ends(s, 4) {
            s.extend_twice(4, motor, &piece.phasor);
            let _ = ending.ends(s, 6);
        }
        series.first_rotation()
    }
}

impl<A: Arithmetic> Series<A, 5> {
    /// State at the end of a step by the series of order four.
    #[inline(always)]
    pub(super) fn of_order_four(state: [A; 3], motor: &StepConstants<A>, piece: &Piece) -> [A; 3] {
        let mut series = Self::from(state);
        series.extend_twice(0, motor, &piece.phasor);
        series.extend_twice(2, motor, &piece.phasor);
        series.sum(4)
    }
}

impl<A: Arithmetic, const TERMS: usize> Series<A, TERMS> {
    #[inline(always)]
    const fn from([a, b, r]: [A; 3]) -> Self {
        Self {
            a: [a; TERMS],
            b: [b; TERMS],
            r: [r; TERMS],
        }
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
        let turn_a = self.turn(k, &self.b);
        let turn_b = self.turn(k, &self.a);
        let torque = self.torque(k, u);
        let excess = if k == 0 { motor.load - torque } else { -torque };
        let (mut towards_a, mut towards_b) = (-self.a[k], -self.b[k]);
        if k <= DEGREE {
            towards_a = towards_a + u[k][0];
            towards_b = towards_b + u[k][1];
        }
        let share = 1.0 / (k + 1) as f64;
        let next_a = (motor.decay * towards_a - turn_a) * share;
        let next_b = (motor.decay * towards_b + turn_b) * share;
        let next_r = motor.acceleration * excess * share;
        self.a[k + 1] = next_a;
        self.b[k + 1] = next_b;
        self.r[k + 1] = next_r;
    }

    /// Coefficient `k` of `r x`.
    #[inline(always)]
    fn turn(&self, k: usize, x: &[A; TERMS]) -> A {
        let r = &self.r;
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
    }

    /// Coefficient `k` of the torque.
    #[inline(always)]
    fn torque(&self, k: usize, u: &[[f64; 2]; DEGREE + 1]) -> A {
        let (a, b) = (&self.a, &self.b);
        let lowest = k.saturating_sub(DEGREE);
        let mut sum = b[lowest] * u[k - lowest][0] - a[lowest] * u[k - lowest][1];
        for i in lowest + 1..=k {
            sum = sum + (b[i] * u[k - i][0] - a[i] * u[k - i][1]);
        }
        sum
    }

    /// Flux and rotation per step at the end of the step, up to `order`.
    #[inline(always)]
    pub(super) fn sum(&self, order: usize) -> [A; 3] {
        [
            total(&self.a, order),
            total(&self.b, order),
            total(&self.r, order),
        ]
    }

    /// The coefficients of `order` and the one before.
    #[inline(always)]
    pub(super) const fn last_two(&self, order: usize) -> [A; 6] {
        let (a, b, r) = (&self.a, &self.b, &self.r);
        let k = order - 1;
        [a[k], b[k], r[k], a[order], b[order], r[order]]
    }

    /// The rotation's coefficient of order one: its slope at the start.
    #[inline(always)]
    pub(super) const fn first_rotation(&self) -> A {
        self.r[1]
    }
}

#[inline(always)]
fn total<A: Arithmetic, const TERMS: usize>(c: &[A; TERMS], order: usize) -> A {
    let mut sum = c[order];
    for k in (0..order).rev() {
        sum = sum + c[k];
    }
    sum
}

/// Sum of the sizes of the phasor's coefficients from `order` on.
#[inline(always)]
pub(super) fn input_beyond(piece: &Piece, order: usize) -> f64 {
    let beyond = piece.phasor.iter().skip(order);
    beyond.map(|c| c[0].abs() + c[1].abs()).sum()
}
