//! The classical Runge-Kutta method of order four.

#![allow(
    clippy::inline_always,
    reason = "the slopes are a few operations; a call would cost more than they do"
)]

use crate::numerics::Arithmetic;

/// The state after a step of `h` seconds over the phasors at its start, middle and end.
#[inline(always)]
pub(super) fn runge_kutta<S: Arithmetic, V: Copy, const N: usize>(
    slopes: impl Fn([S; N], [V; 2]) -> [S; N],
    x: [S; N],
    u: [[V; 2]; 3],
    h: f64,
) -> [S; N] {
    let k1 = slopes(x, u[0]);
    let k2 = slopes(ahead(&x, &k1, 0.5 * h), u[1]);
    let k3 = slopes(ahead(&x, &k2, 0.5 * h), u[1]);
    let k4 = slopes(ahead(&x, &k3, h), u[2]);
    let mut next = x;
    for i in 0..N {
        next[i] = x[i] + (k1[i] + (k2[i] + k3[i]) * 2.0 + k4[i]) * (h / 6.0);
    }
    next
}

#[inline(always)]
fn ahead<S: Arithmetic, const N: usize>(x: &[S; N], k: &[S; N], by: f64) -> [S; N] {
    let mut moved = *x;
    for i in 0..N {
        moved[i] = x[i] + k[i] * by;
    }
    moved
}
