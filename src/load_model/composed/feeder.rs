//! A series impedance between the measured bus and the load.
//!
//! In units of V0 and P0, with `Z = R + jX` and `u` the phasor at the measured bus:
//!
//! ```text
//! u_L = u - Z i,   i = conj((P_L + j Q_L)/u_L)                       (1)
//! P + j Q = u conj i                                                 (2)
//! ```
//!
//! At rest `i0 = 1 - j Q0/P0`, so `u_L0 = 1 - Z i0` and the load draws what is left: P0 and Q0 hold. The
//! load sees `u_L / u_L0`. A capacitor at the load is part of the load's `d_z`, exactly.
//!
//! (1) is a fixed point `x = g(x)` in which the current through the motor's stator branch, nearly all
//! of the feedback, is taken implicitly. Its values come from Broyden's method (C. G. Broyden, Math.
//! Comp. 19, 1965), which goes on with the matrix of the instant before; where that does not help, from
//! the plain iteration. Its derivatives follow from those of `g` at the solution:
//! `dx = (1 - dg/dx)^-1 dg/dp` (3).

mod ahead;

pub(super) use ahead::Way;

use super::{complex, motor::Motor};
use crate::numerics::{Elementary, Sensitivities};

/// Constants of the feeder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feeder<S> {
    /// `R`.
    pub resistance: S,
    /// `X`.
    pub reactance: S,
}

impl<S: Elementary> Feeder<S> {
    /// No feeder.
    #[must_use]
    pub fn none() -> Self {
        Self {
            resistance: S::constant(0.0),
            reactance: S::constant(0.0),
        }
    }

    /// `|u_L0|^2`.
    #[must_use]
    pub fn load_voltage_square(&self, rest_reactive: f64) -> S {
        complex::square(self.load_voltage(rest_reactive))
    }

    /// `Q_L0/P_L0` of the load, whose power at rest is `1 + j Q0/P0 - Z |i0|^2`.
    fn load_ratio(&self, rest_reactive: f64) -> S {
        let square = 1.0 + rest_reactive * rest_reactive;
        let active = self.resistance * -square + 1.0;
        let reactive = self.reactance * -square + rest_reactive;
        reactive / active
    }

    /// `u_L0`.
    fn load_voltage(&self, rest_reactive: f64) -> [S; 2] {
        let current = [S::constant(1.0), S::constant(-rest_reactive)];
        let drop = complex::product([self.resistance, self.reactance], current);
        [S::constant(1.0) - drop[0], -drop[1]]
    }
}

/// Reactive coefficients that go with Q0/P0 from event to event, where the load is behind a feeder: they go with what the
/// load draws, not with what the feeder takes, which is more of a larger load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AtLoad {
    /// Changes of `d_z` and `d_i` per change of `Q_L0/P_L0`.
    pub slopes: [f64; 2],
    /// Q0/P0 at the measured bus at which the coefficients of the site hold.
    pub site_reactive_at_rest: f64,
    /// `P0/V0^2` there over that of the event: so much larger is the feeder on its base.
    pub site_admittance_ratio: f64,
}

impl AtLoad {
    /// What is to be added to `d_z` and `d_i` that follow Q0/P0 at the measured bus already.
    pub(super) fn correction<S: Elementary>(
        &self,
        feeder: &Feeder<S>,
        rest_reactive: f64,
    ) -> [S; 2] {
        let site = Feeder {
            resistance: feeder.resistance * self.site_admittance_ratio,
            reactance: feeder.reactance * self.site_admittance_ratio,
        };
        let own = feeder.load_ratio(rest_reactive) + -rest_reactive;
        let others = site.load_ratio(self.site_reactive_at_rest) + -self.site_reactive_at_rest;
        self.slopes.map(|slope| (own - others) * slope)
    }
}

/// Steps of the iteration; the plain one gains a digit or more per step where there is a solution.
const STEPS_MAX: usize = 60;
/// Steps after which Broyden's method gives way to the plain iteration.
const SECANT_STEPS_MAX: usize = 12;
/// The step after one as short as this ends the iteration: it leaves rounding.
const CONVERGED: f64 = 1e-13;
/// Steps as short as this say nothing of the matrix.
const SECANT_STEP_MIN: f64 = 1e-10;
/// Derivatives of a [`Sensitivities`] that (3) needs for itself in the first pass with derivatives: the last ones.
/// Passes after it have `dg/dx` from there.
pub(super) const PROBES: usize = 2;

/// `dg/dx` at a fixed point.
type Slopes = [[f64; 2]; 2];

/// Scalars in which a fixed point of two numbers can be had with its derivatives.
pub(super) trait Implicit: Elementary {
    /// Two numbers, and by themselves where derivatives are carried.
    fn free(pair: [f64; 2]) -> [Self; 2];
    /// `dg/dx`, given the image of [`Self::free`] numbers; none where no derivatives are carried.
    fn slopes(image: &[Self; 2]) -> Option<Slopes>;
    /// The fixed point with value `at`, given `dg/dx` and the image of `at`, or of [`Self::free`] numbers where it is
    /// `probed`: (3).
    fn fixed_point(at: [f64; 2], image: [Self; 2], slopes: &Slopes, probed: bool) -> [Self; 2];
}

impl Implicit for f64 {
    fn free(pair: [f64; 2]) -> [Self; 2] {
        pair
    }

    fn slopes(_image: &[Self; 2]) -> Option<Slopes> {
        None
    }

    fn fixed_point(at: [f64; 2], _image: [Self; 2], _slopes: &Slopes, _probed: bool) -> [Self; 2] {
        at
    }
}

impl<const PAIRS: usize> Implicit for Sensitivities<PAIRS> {
    #[inline]
    fn free([x, y]: [f64; 2]) -> [Self; 2] {
        [
            Self::variable(x, Self::COUNT - PROBES),
            Self::variable(y, Self::COUNT - PROBES + 1),
        ]
    }

    #[inline]
    fn slopes(image: &[Self; 2]) -> Option<Slopes> {
        let by = |i: usize, j: usize| image[i].derivative(Self::COUNT - PROBES + j);
        Some([[by(0, 0), by(0, 1)], [by(1, 0), by(1, 1)]])
    }

    fn fixed_point(at: [f64; 2], image: [Self; 2], slopes: &Slopes, probed: bool) -> [Self; 2] {
        let [[xx, xy], [yx, yy]] = *slopes;
        let (a, b) = (1.0 - xx, -xy);
        let (c, d) = (-yx, 1.0 - yy);
        let scale = 1.0 / (a * d - b * c);
        let [x, y] = image;
        let with_value = |value: f64, mut number: Self| {
            number.value = value;
            if probed {
                number.without_last_pair()
            } else {
                number
            }
        };
        [
            with_value(at[0], (x * d + y * -b) * scale),
            with_value(at[1], (y * a + x * -c) * scale),
        ]
    }
}

/// Values of a solution of (1): the last point and where the step from there led.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    at: [f64; 2],
    next: [f64; 2],
    /// `dg/dx` at the last point, once a pass has carried derivatives.
    slopes: Option<Slopes>,
}

impl Solution {
    /// Whether a pass has carried derivatives.
    pub(super) fn knows_slopes(&self) -> bool {
        self.slopes.is_some()
    }
}

/// Broyden's matrix: what a step is, given how far the image is from its point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Secant([[f64; 2]; 2]);

impl Secant {
    /// The plain iteration: to the image.
    pub(super) const PLAIN: Self = Self([[1.0, 0.0], [0.0, 1.0]]);

    fn times(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [[a, b], [c, d]] = self.0;
        [a * x + b * y, c * x + d * y]
    }

    /// Learns from a step that shortened the way to the image by `shortened`.
    fn learn(&mut self, step: [f64; 2], shortened: [f64; 2]) {
        let expected = self.times(shortened);
        let divisor = complex::dot(step, expected);
        let square = complex::square(step);
        // Too far from what it knows for a rank-one change.
        if square < SECANT_STEP_MIN * SECANT_STEP_MIN || divisor < 0.1 * square {
            return;
        }
        let [[a, b], [c, d]] = self.0;
        let row = [step[0] * a + step[1] * c, step[0] * b + step[1] * d];
        for (i, matrix_row) in self.0.iter_mut().enumerate() {
            let more = (step[i] - expected[i]) / divisor;
            *matrix_row = [matrix_row[0] + more * row[0], matrix_row[1] + more * row[1]];
        }
    }
}

/// Square of the voltage below which the current does not rise any further.
const VOLTAGE_SQUARE_MIN: f64 = 0.01;

/// A feeder at its operating point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Network<S> {
    impedance: [S; 2],
    /// `u_L0`.
    rest: [S; 2],
    /// Active and reactive power of the load at rest.
    rest_power: [S; 2],
    rest_reactive: f64,
    /// Admittance taken implicitly, and `1/(1 + Z Y)`.
    implicit: [S; 2],
    divisor: [S; 2],
}

impl<S: Implicit> Network<S> {
    pub(super) fn new(
        feeder: &Feeder<S>,
        rest_reactive: f64,
        motor_share: S,
        motor: &Motor<S>,
    ) -> Self {
        let one = S::constant(1.0);
        let impedance = [feeder.resistance, feeder.reactance];
        let current = [one, S::constant(-rest_reactive)];
        let rest = feeder.load_voltage(rest_reactive);
        let power = complex::product(rest, complex::conjugate(current));
        let square = complex::square(rest);
        let scale = motor_share * power[0] / square;
        let implicit = motor.admittance.map(|y| y * scale);
        let loop_gain = complex::product(impedance, implicit);
        Self {
            impedance,
            rest,
            rest_power: power,
            rest_reactive,
            implicit,
            divisor: complex::inverse([loop_gain[0] + 1.0, loop_gain[1]]),
        }
    }

    /// Solves (1) for the load's own phasor `u_L / u_L0`, starting from `guess`; `load` gives power
    /// over P0 as if the load were at the measured bus. `None` when there is no solution nearby.
    pub(super) fn solve(
        &self,
        u: [S; 2],
        guess: [f64; 2],
        secant: &mut Secant,
        load: impl Fn([S; 2]) -> [S; 2],
    ) -> Option<(Solution, [S; 2])> {
        let mut at = complex::product(guess, self.rest.map(S::value));
        let mut before: Option<([f64; 2], [f64; 2])> = None;
        let mut close = false;
        for count in 0..STEPS_MAX {
            let image = self.image(u, S::free(at), &load);
            let ahead = [image[0].value() - at[0], image[1].value() - at[1]];
            if count >= SECANT_STEPS_MAX {
                *secant = Secant::PLAIN;
            } else if let Some((step, last)) = before {
                if complex::square(ahead) > complex::square(last) {
                    *secant = Secant::PLAIN;
                } else {
                    secant.learn(step, complex::difference(last, ahead));
                }
            }
            let step = secant.times(ahead);
            let next = complex::sum(at, step);
            if close {
                let solution = Solution {
                    at,
                    next,
                    slopes: None,
                };
                return Some(self.settled(solution, image, true));
            }
            at = next;
            let square = complex::square(step);
            if !square.is_finite() {
                break;
            }
            close = square < CONVERGED * CONVERGED;
            before = Some((step, ahead));
        }
        *secant = Secant::PLAIN;
        None
    }

    /// A solution whose values are known, and its phasor.
    pub(super) fn known(
        &self,
        u: [S; 2],
        solution: &Solution,
        load: impl Fn([S; 2]) -> [S; 2],
    ) -> (Solution, [S; 2]) {
        let probed = !solution.knows_slopes();
        let at = if probed {
            S::free(solution.at)
        } else {
            complex::constant(solution.at)
        };
        let image = self.image(u, at, &load);
        self.settled(*solution, image, probed)
    }

    /// A solution that knows its slopes unless it is `probed`, and its phasor, given the image of its point.
    #[inline]
    fn settled(&self, solution: Solution, image: [S; 2], probed: bool) -> (Solution, [S; 2]) {
        let slopes = solution.slopes.or_else(|| S::slopes(&image));
        let own = S::fixed_point(solution.next, image, &slopes.unwrap_or_default(), probed);
        let solution = Solution { slopes, ..solution };
        (solution, complex::quotient(own, self.rest))
    }

    /// `g` at a phasor of the load.
    #[inline]
    fn image(&self, u: [S; 2], at: [S; 2], load: &impl Fn([S; 2]) -> [S; 2]) -> [S; 2] {
        let load = load(complex::quotient(at, self.rest));
        let explicit =
            complex::difference(self.current(at, load), complex::product(self.implicit, at));
        let drop = complex::product(self.impedance, explicit);
        complex::product(complex::difference(u, drop), self.divisor)
    }

    /// (2) for a load with this phasor and power over P0.
    pub(super) fn power(&self, u: [S; 2], own: [S; 2], load: [S; 2]) -> [S; 2] {
        let current = self.current(complex::product(own, self.rest), load);
        complex::product(u, complex::conjugate(current))
    }

    #[inline]
    fn current(&self, at: [S; 2], load: [S; 2]) -> [S; 2] {
        let square = complex::square(at);
        let weight = if square.value() < VOLTAGE_SQUARE_MIN {
            S::constant(1.0 / VOLTAGE_SQUARE_MIN)
        } else {
            S::constant(1.0) / square
        };
        let active = self.rest_power[0] * load[0];
        let reactive = self.rest_power[1] + self.rest_power[0] * (load[1] + -self.rest_reactive);
        // conj(P + jQ) u / |u|^2
        complex::scaled(complex::product([active, -reactive], at), weight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_feeder_takes_is_not_what_the_load_draws() {
        // R = 0.02, X = 0.1 on the base of an event that is a quarter larger than the site's median: the same
        // load, 0.25 of Q/P behind the feeder, shows more at the measured bus there.
        let feeder = |scale: f64| Feeder {
            resistance: 0.02 * scale,
            reactance: 0.1 * scale,
        };
        let shown = |scale: f64| {
            let mut ratio = 0.25;
            for _ in 0..100 {
                let square = 1.0 + ratio * ratio;
                ratio = 0.25 * (1.0 - 0.02 * scale * square) + 0.1 * scale * square;
            }
            ratio
        };
        let (here, site) = (shown(1.0), shown(0.8));
        assert!(here - site > 0.015);
        let at_load = AtLoad {
            slopes: [0.7, 0.2],
            site_reactive_at_rest: site,
            site_admittance_ratio: 0.8,
        };
        let correction = at_load.correction(&feeder(1.0), here);
        for (correction, slope) in correction.iter().zip(at_load.slopes) {
            assert!((slope * (here - site) + correction).abs() < 1e-12);
        }
        let without: [f64; 2] = at_load.correction(&Feeder::none(), here);
        assert!(without.iter().all(|c| c.abs() < 1e-15));
    }
}
