//! A step of the motor as formulas: equations (1) to (5) of `motor`, over numbers of any kind.

#![allow(
    clippy::inline_always,
    reason = "compiled for the registers in which a step is taken"
)]

use std::ops::{Add, Mul};

use super::{complex, runge_kutta::runge_kutta};
use crate::numerics::{Arithmetic, Kernel};

/// Constants of (1) to (5).
#[derive(Clone, Copy, Debug)]
pub(super) struct Constants<T> {
    /// `D`.
    pub(super) difference: T,
    /// `1/T0'`.
    pub(super) decay_per_s: T,
    /// `nu/G`.
    pub(super) inverse_inertia: T,
    /// `1/Z'` or `1/Z''`.
    pub(super) admittance: [T; 2],
    /// `x' - x''` and `1/T''` of a second cage.
    pub(super) second_cage: Option<[T; 2]>,
    /// The share of itself to which the motor is connected, if it is not the whole.
    pub(super) connected: Option<T>,
}

impl<T: Arithmetic> Constants<T> {
    /// (1), given the voltage behind the impedance.
    #[inline(always)]
    fn current<V: Copy>(&self, behind: [T; 2], [re, im]: [V; 2]) -> [T; 2]
    where
        T: Mul<V, Output = T> + Add<V, Output = T>,
    {
        let current = complex::product([-behind[0] + re, -behind[1] + im], self.admittance);
        match self.connected {
            Some(share) => [current[0] * share, current[1] * share],
            None => current,
        }
    }

    /// (2), given what the saturation makes of the flux.
    #[inline(always)]
    fn flux_slopes(&self, [e_re, e_im]: [T; 2], held: [T; 2], current: [T; 2], s: T) -> [T; 2] {
        [
            -(s * e_im) - (held[0] + self.difference * current[1]) * self.decay_per_s,
            s * e_re - (held[1] - self.difference * current[0]) * self.decay_per_s,
        ]
    }
}

/// A step of the plain motor from fluxes and speed; behind them `alpha`, `nu` and the imaginary flux at rest.
#[inline(always)]
fn plain<T, V: Copy>([a, b, s, alpha, nu, b0]: [T; 6], u: [[V; 2]; 3], duration_s: f64) -> [T; 3]
where
    T: Arithmetic + Mul<V, Output = T> + Add<V, Output = T>,
{
    runge_kutta(
        #[inline(always)]
        |[a, b, s]: [T; 3], [re, im]: [V; 2]| {
            let torque = b * re - a * im;
            [
                alpha * (-a + re) - s * b,
                alpha * (-b + im) + s * a,
                nu * (b0 - torque),
            ]
        },
        [a, b, s],
        u,
        duration_s,
    )
}

/// A step from `e'`, the speed and `e''`. `held` is what the saturation makes of `e'`, `load` the torque of
/// the load at a speed.
#[inline(always)]
pub(super) fn detailed<T, V: Copy>(
    constants: &Constants<T>,
    [a, b, s, c, d]: [T; 5],
    u: [[V; 2]; 3],
    duration_s: f64,
    held: impl Fn([T; 2]) -> [T; 2],
    load: impl Fn(T) -> T,
) -> [T; 5]
where
    T: Arithmetic + Mul<V, Output = T> + Add<V, Output = T>,
{
    let k = constants;
    let Some([difference, inverse_time]) = k.second_cage else {
        let [a, b, s] = runge_kutta(
            #[inline(always)]
            |[a, b, s]: [T; 3], u: [V; 2]| {
                let e = [a, b];
                let current = k.current(e, u);
                let [da, db] = k.flux_slopes(e, held(e), current, s);
                let torque = complex::dot(e, current); // (3)
                [da, db, k.inverse_inertia * (torque - load(s))] // (4)
            },
            [a, b, s],
            u,
            duration_s,
        );
        return [a, b, s, c, d];
    };
    runge_kutta(
        #[inline(always)]
        |[a, b, s, c, d]: [T; 5], u: [V; 2]| {
            let (e, behind) = ([a, b], [c, d]);
            let current = k.current(behind, u);
            let flux = k.flux_slopes(e, held(e), current, s);
            let apart = [c - a, d - b];
            let second = [
                -(s * apart[1]) + flux[0] - (apart[0] + difference * current[1]) * inverse_time,
                s * apart[0] + flux[1] - (apart[1] - difference * current[0]) * inverse_time,
            ]; // (5)
            let torque = complex::dot(behind, current);
            let speed = k.inverse_inertia * (torque - load(s));
            [flux[0], flux[1], speed, second[0], second[1]]
        },
        [a, b, s, c, d],
        u,
        duration_s,
    )
}

/// [`plain`] over phasors without derivatives.
pub(super) struct PlainMeasured {
    pub(super) u: [[f64; 2]; 3],
    pub(super) duration_s: f64,
}

impl Kernel<6, 3> for PlainMeasured {
    #[inline(always)]
    fn apply<T: Arithmetic>(&self, x: [T; 6]) -> [T; 3] {
        plain(x, self.u, self.duration_s)
    }
}

/// [`plain`], its phasors behind the constants.
pub(super) struct Plain {
    pub(super) duration_s: f64,
}

impl Kernel<12, 3> for Plain {
    #[inline(always)]
    fn apply<T: Arithmetic>(&self, x: [T; 12]) -> [T; 3] {
        let [a, b, s, alpha, nu, b0, u @ ..] = x;
        let u = [[u[0], u[1]], [u[2], u[3]], [u[4], u[5]]];
        plain([a, b, s, alpha, nu, b0], u, self.duration_s)
    }
}

/// Numbers of a step: `e'`, the speed, `e''`, `D`, `1/T0'`, `nu/G`, `t_0`, the admittance, the two of a second cage,
/// and the connected share.
pub(super) const LISTED: usize = 14;

/// [`detailed`] without saturation on a constant torque, over phasors without derivatives.
pub(super) struct DetailedMeasured {
    pub(super) u: [[f64; 2]; 3],
    pub(super) duration_s: f64,
    /// Which of the constants that may be missing are there: second cage, connected share.
    pub(super) has: [bool; 2],
}

impl Kernel<LISTED, 5> for DetailedMeasured {
    #[inline(always)]
    fn apply<T: Arithmetic>(&self, x: [T; LISTED]) -> [T; 5] {
        unsaturated(x, self.u, self.duration_s, self.has)
    }
}

/// The same with the phasors behind the constants.
pub(super) struct Detailed {
    pub(super) duration_s: f64,
    /// As [`DetailedMeasured::has`].
    pub(super) has: [bool; 2],
}

impl Kernel<{ LISTED + 6 }, 5> for Detailed {
    #[inline(always)]
    fn apply<T: Arithmetic>(&self, x: [T; LISTED + 6]) -> [T; 5] {
        let mut first = [x[0]; LISTED];
        first.copy_from_slice(&x[..LISTED]);
        let u = [[x[14], x[15]], [x[16], x[17]], [x[18], x[19]]];
        unsaturated(first, u, self.duration_s, self.has)
    }
}

#[inline(always)]
fn unsaturated<T, V: Copy>(
    x: [T; LISTED],
    u: [[V; 2]; 3],
    duration_s: f64,
    [cage, share]: [bool; 2],
) -> [T; 5]
where
    T: Arithmetic + Mul<V, Output = T> + Add<V, Output = T>,
{
    let constants = Constants {
        difference: x[5],
        decay_per_s: x[6],
        inverse_inertia: x[7],
        admittance: [x[9], x[10]],
        second_cage: if cage { Some([x[11], x[12]]) } else { None },
        connected: if share { Some(x[13]) } else { None },
    };
    let start = [x[0], x[1], x[2], x[3], x[4]];
    detailed(
        &constants,
        start,
        u,
        duration_s,
        #[inline(always)]
        |e| e,
        #[inline(always)]
        |_| x[8],
    )
}
