//! The motor of a composed model: the third-order machine with whatever the effects add to it.
//!
//! On the base of the motor's own initial power and V0, in the frame of the terminal phasor before
//! the event, with `Z = r + jx`, `Z' = r + jx'`, `D = x - x'`, `s` the rotor speed against the frame:
//!
//! ```text
//! i      = (u - e') / Z'                                                        (1)
//! de'/dt = j s e' - ((1 + S) e' - j D i) / T0'                                  (2)
//! t_e    = Re(e' conj i) = Re(u conj i) - r |i|^2                               (3)
//! ds/dt  = (nu / G) (t_e - t_0 ((w_s + s)/(w_s + s_0))^m)                       (4)
//! ```
//!
//! `alpha`, `nu` and `kappa = 2/G` fix `x' = 1/(G + 1/x)`, `T0' = (1 + G x)/alpha` and the inertia
//! `G/nu` as they do for the plain motor. With `w = e' Z/(jD)` equations (1) and (2) read
//! `dw/dt = j s w - alpha_c (w - u)`, `alpha_c = Z/(Z' T0')`, `i = (1/Z' - 1/Z)(u - w) + u/Z`: the plain
//! form with a complex `alpha`, real when r = 0. A second cage adds, with `x'' = (1 - c) x'`
//! in (1) and (3) and `e''` in place of `e'` there,
//!
//! ```text
//! de''/dt = j s (e'' - e') + de'/dt + (e' - e'' + j (x' - x'') i) / T''         (5)
//! ```
//!
//! At rest the motor draws exactly the active power 1; the slip is the root of `Re(1/Z(s)) = 1`
//! where the torque still rises with the slip, `Z(s)` being the impedance at standstill of the states.
//! Source: (1)-(4) reference paper (9), (10) with the stator of Kundur, "Power System Stability and
//! Control", 7.2, checked against that circuit in `composed::tests`; (5) the fifth-order motor of PSAT as in `OpenIPSL`, `Electrical/Machines/PSAT/MotorTypeV.mo` (verified).

#![allow(
    clippy::inline_always,
    reason = "a step is a few operations; a call would cost more than they do"
)]

use std::ops::{Add, Mul};

use super::{
    complex,
    motor_step::{Constants, Detailed, DetailedMeasured, LISTED, Plain, PlainMeasured, detailed},
};
use crate::{
    load_model::{Infeasible, MotorCoordinates, effect::TYPICAL_MOTOR_REACTANCE},
    numerics::{
        Dual, Elementary, Scalar,
        elementary::{at_least, power},
    },
};

/// The constants of a motor; effects change them before the steady state is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorDescription<S> {
    /// The coordinates of the plain motor.
    pub coordinates: MotorCoordinates<S>,
    /// `x`.
    pub reactance: S,
    /// `r`.
    pub stator_resistance: Option<S>,
    /// `m` in (4).
    pub torque_exponent: Option<S>,
    /// Reduction `c` of the transient reactance by a second cage, and its `T''` in s.
    pub second_cage: Option<[S; 2]>,
    /// Strength `B` and knee `A` of the saturation `S = B (|e'| - A)^2` above the knee.
    pub saturation: Option<[S; 2]>,
    /// Whether the equations above are to be used although nothing of it is present.
    pub detailed: bool,
    /// Synchronous angular speed before the event, rad/s.
    pub synchronous_speed_rad_s: f64,
}

impl<S: Elementary> MotorDescription<S> {
    /// A plain motor.
    #[must_use]
    pub fn new(coordinates: MotorCoordinates<S>, synchronous_speed_rad_s: f64) -> Self {
        Self {
            coordinates,
            reactance: S::constant(TYPICAL_MOTOR_REACTANCE),
            stator_resistance: None,
            torque_exponent: None,
            second_cage: None,
            saturation: None,
            detailed: false,
            synchronous_speed_rad_s,
        }
    }

    /// Takes constants that refer to a voltage of 1 to the base of another, given by its square.
    pub fn refer_to(&mut self, voltage_square: S) {
        let c = &mut self.coordinates;
        c.kappa = c.kappa / voltage_square;
        c.nu_per_s2 = c.nu_per_s2 * voltage_square;
        self.reactance = self.reactance / voltage_square;
        self.stator_resistance = self.stator_resistance.map(|r| r / voltage_square);
    }

    fn is_detailed(&self) -> bool {
        self.detailed
            || self.stator_resistance.is_some()
            || self.torque_exponent.is_some()
            || self.second_cage.is_some()
            || self.saturation.is_some()
    }

    /// With something else in the place of every number.
    pub(super) fn map<T: Elementary>(&self, f: impl Fn(S) -> T) -> MotorDescription<T> {
        let c = &self.coordinates;
        MotorDescription {
            coordinates: MotorCoordinates {
                alpha_per_s: f(c.alpha_per_s),
                nu_per_s2: f(c.nu_per_s2),
                kappa: f(c.kappa),
            },
            reactance: f(self.reactance),
            stator_resistance: self.stator_resistance.map(&f),
            torque_exponent: self.torque_exponent.map(&f),
            second_cage: self.second_cage.map(|pair| pair.map(&f)),
            saturation: self.saturation.map(|pair| pair.map(&f)),
            detailed: self.detailed,
            synchronous_speed_rad_s: self.synchronous_speed_rad_s,
        }
    }
}

/// Fluxes and speed of a motor: `w` of a plain one, `e'` and `e''` of a detailed one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorState<S> {
    /// `w` or `e'`.
    pub flux: [S; 2],
    /// `e''`; zero without a second cage.
    pub second: [S; 2],
    /// Rotor speed against the frame, rad/s.
    pub speed_rad_s: S,
}

/// A motor at its operating point, ready to be integrated.
#[derive(Clone, Copy, Debug)]
pub struct Motor<S> {
    /// States at rest.
    pub rest: MotorState<S>,
    /// Active and reactive power at rest, the latter without `1/x`.
    pub rest_power: [S; 2],
    /// `1/x`: the motor draws `|u|^2 / x` more reactive power than [`Motor::power`] says.
    pub susceptance: S,
    /// Admittance of the stator branch, `1/Z'` or `1/Z''`: what a sudden change of voltage meets.
    pub admittance: [S; 2],
    plain: bool,
    alpha: S,
    nu: S,
    strength: S,
    detail: Detail<S>,
    synchronous_speed_rad_s: f64,
}

/// Constants of (1) to (5).
#[derive(Clone, Copy, Debug)]
struct Detail<S> {
    difference: S,
    decay_per_s: S,
    inverse_inertia: S,
    rest_torque: S,
    torque_exponent: Option<S>,
    saturation: Option<[S; 2]>,
    /// `x' - x''` and `1/T''`.
    second_cage: Option<[S; 2]>,
}

/// A part of a motor that is connected to a share of itself, and has an inertia of its own.
struct Connected<S> {
    share: S,
    inverse_inertia: S,
}

/// Newton steps for the slip at rest; convergence is quadratic and from below.
const SLIP_STEPS_MAX: usize = 100;
/// Steps for the saturated flux at rest, a contraction.
const SATURATION_STEPS_MAX: usize = 200;

impl<S: Elementary> Motor<S> {
    /// Computes constants and steady state.
    ///
    /// # Errors
    ///
    /// [`Infeasible`] when the motor cannot draw its initial power at any slip.
    pub fn new(description: &MotorDescription<S>) -> Result<Self, Infeasible> {
        let c = &description.coordinates;
        let plain_rest = c.steady_state();
        let strength = S::constant(2.0) / c.kappa;
        let susceptance = S::constant(1.0) / description.reactance;
        let zero = S::constant(0.0);
        let detail = Detail {
            difference: description.reactance - S::constant(1.0) / (strength + susceptance),
            decay_per_s: c.alpha_per_s / (strength * description.reactance + 1.0),
            inverse_inertia: c.nu_per_s2 / strength,
            rest_torque: S::constant(1.0),
            torque_exponent: description.torque_exponent,
            saturation: description.saturation,
            second_cage: None,
        };
        let mut motor = Self {
            rest: MotorState {
                flux: [zero; 2],
                second: [zero; 2],
                speed_rad_s: zero,
            },
            rest_power: [zero; 2],
            susceptance,
            admittance: [zero, -(strength + susceptance)],
            plain: !description.is_detailed(),
            alpha: c.alpha_per_s,
            nu: c.nu_per_s2,
            strength,
            detail,
            synchronous_speed_rad_s: description.synchronous_speed_rad_s,
        };
        if motor.plain {
            let [a, b, s] = plain_rest?;
            motor.rest.flux = [a, b];
            motor.rest.speed_rad_s = s;
        } else {
            motor.settle_detailed(description)?;
        }
        motor.rest_power = motor.power(&motor.rest, [S::constant(1.0), zero]);
        Ok(motor)
    }

    fn settle_detailed(&mut self, description: &MotorDescription<S>) -> Result<(), Infeasible> {
        let branch = Branch::new(description)?;
        let slip = running_speed(description, &branch)?;
        let rest = branch.at_speed(slip);
        self.admittance = complex::inverse(branch.stator);
        self.detail.second_cage = branch
            .second
            .map(|(difference, time_s)| [difference, S::constant(1.0) / time_s]);
        self.rest.flux = rest.transient;
        self.rest.second = rest.behind;
        self.rest.speed_rad_s = slip;
        self.detail.rest_torque = complex::dot(rest.behind, rest.current);
        Ok(())
    }

    /// The fastest rate of the motor in a state, 1/s: decay of the flux, swing, and the turning of
    /// the flux against the frame, which is fast in a stalled motor.
    #[must_use]
    pub fn rate_per_s(&self, state: &MotorState<S>) -> f64 {
        let (decay, turning) = (self.alpha.value(), state.speed_rad_s.value());
        let swing_square = self.nu.value().max(0.0);
        let mut rate = (decay * decay + turning * turning + swing_square).sqrt();
        if let Some([difference, inverse_time]) = self.detail.second_cage {
            let gain = 1.0 + difference.value() * complex::modulus(self.admittance).value();
            rate = rate.max(inverse_time.value() * gain);
        }
        rate
    }

    /// Active and reactive power drawn at the phasor `u`, the latter without `|u|^2 / x`.
    #[must_use]
    #[inline(always)]
    pub fn power<V: Copy>(&self, state: &MotorState<S>, u: [V; 2]) -> [S; 2]
    where
        S: Mul<V, Output = S> + Add<V, Output = S>,
    {
        let [re, im] = u;
        if self.plain {
            let [a, b] = state.flux;
            let active = a * im - b * re;
            let reactive = (-a + re) * re + (-b + im) * im;
            return [self.strength * active, self.strength * reactive];
        }
        let [i_re, i_im] = self.current(state, u);
        // |u|^2/x as (u/x) u keeps the operands' types apart.
        let shunt = (self.susceptance * re) * re + (self.susceptance * im) * im;
        [i_re * re + i_im * im, i_re * im - i_im * re - shunt]
    }

    #[inline(always)]
    fn current<V: Copy>(&self, state: &MotorState<S>, [re, im]: [V; 2]) -> [S; 2]
    where
        S: Mul<V, Output = S> + Add<V, Output = S>,
    {
        let e = if self.detail.second_cage.is_some() {
            state.second
        } else {
            state.flux
        };
        complex::product([-e[0] + re, -e[1] + im], self.admittance) // (1)
    }

    /// One classical Runge-Kutta step over the phasors at its start, middle and end.
    #[must_use]
    pub fn step(&self, state: &MotorState<S>, u: [[S; 2]; 3], duration_s: f64) -> MotorState<S> {
        if self.plain {
            let [a, b, s, alpha, nu, b0] = self.plain_list(state);
            let [[u0, u1], [u2, u3], [u4, u5]] = &u;
            let list = [a, b, s, alpha, nu, b0, u0, u1, u2, u3, u4, u5];
            let next = S::through(&Plain { duration_s }, list);
            return self.after(next, state.second);
        }
        self.detailed_step(state, &u, None, duration_s)
    }

    /// [`Self::step`] over phasors that are measured.
    #[must_use]
    pub fn measured_step(
        &self,
        state: &MotorState<S>,
        u: [[f64; 2]; 3],
        duration_s: f64,
    ) -> MotorState<S> {
        if self.plain {
            let next = S::through(&PlainMeasured { u, duration_s }, self.plain_list(state));
            return self.after(next, state.second);
        }
        if self.is_beyond_formulas() {
            return self.special_step(state, u, None, duration_s);
        }
        let nothing = S::constant(0.0);
        let (list, has) = self.list(state, None, &nothing);
        let kernel = DetailedMeasured { u, duration_s, has };
        let [a, b, s, c, d] = S::through(&kernel, list);
        self.after([a, b, s], [c, d])
    }

    /// A step of a motor connected to the share `connected` of itself (0: open stator, the rotor
    /// coasts), with `inertia` times the inertia. Only for a motor described as `detailed`.
    #[must_use]
    pub fn connected_step(
        &self,
        state: &MotorState<S>,
        u: [[S; 2]; 3],
        connected: S,
        inertia: S,
        duration_s: f64,
    ) -> MotorState<S> {
        let inverse_inertia = self.detail.inverse_inertia / inertia;
        let part = Connected {
            share: connected,
            inverse_inertia,
        };
        self.detailed_step(state, &u, Some(&part), duration_s)
    }

    /// The state after a step. The rotor stands still at most: a stalled motor does not turn backwards.
    #[inline(always)]
    fn after(&self, [a, b, speed_rad_s]: [S; 3], second: [S; 2]) -> MotorState<S> {
        MotorState {
            flux: [a, b],
            second,
            speed_rad_s: at_least(speed_rad_s, -self.synchronous_speed_rad_s),
        }
    }

    /// States and constants of the plain motor.
    #[inline(always)]
    fn plain_list<'s>(&'s self, state: &'s MotorState<S>) -> [&'s S; 6] {
        let [a, b] = &state.flux;
        let b0 = &self.rest.flux[1];
        [a, b, &state.speed_rad_s, &self.alpha, &self.nu, b0]
    }

    fn detailed_step(
        &self,
        state: &MotorState<S>,
        u: &[[S; 2]; 3],
        part: Option<&Connected<S>>,
        duration_s: f64,
    ) -> MotorState<S> {
        if self.is_beyond_formulas() {
            return self.special_step(state, *u, part, duration_s);
        }
        let nothing = S::constant(0.0);
        let (first, has) = self.list(state, part, &nothing);
        let mut list = [&nothing; LISTED + 6];
        list[..LISTED].copy_from_slice(&first);
        for (place, u) in list[LISTED..].iter_mut().zip(u.iter().flatten()) {
            *place = u;
        }
        let [a, b, s, c, d] = S::through(&Detailed { duration_s, has }, list);
        self.after([a, b, s], [c, d])
    }

    /// What a formula of a step wants, `nothing` where a constant is missing; and whether there are a second cage
    /// and a connected share.
    #[inline(always)]
    fn list<'s>(
        &'s self,
        state: &'s MotorState<S>,
        part: Option<&'s Connected<S>>,
        nothing: &'s S,
    ) -> ([&'s S; LISTED], [bool; 2]) {
        let d = &self.detail;
        let ([a, b], [c, e]) = (&state.flux, &state.second);
        let [re, im] = &self.admittance;
        let cage = d.second_cage.as_ref();
        let [difference, inverse_time] = cage.map_or([nothing; 2], <[S; 2]>::each_ref);
        let (inverse_inertia, share) = part.map_or((&d.inverse_inertia, nothing), |part| {
            (&part.inverse_inertia, &part.share)
        });
        let list = [
            a,
            b,
            &state.speed_rad_s,
            c,
            e,
            &d.difference,
            &d.decay_per_s,
            inverse_inertia,
            &d.rest_torque,
            re,
            im,
            difference,
            inverse_time,
            share,
        ];
        (list, [cage.is_some(), part.is_some()])
    }

    /// Whether a step needs more than the four operations.
    fn is_beyond_formulas(&self) -> bool {
        self.detail.saturation.is_some() || self.detail.torque_exponent.is_some()
    }

    /// A step with saturation, or with a torque that depends on the speed.
    fn special_step<V: Copy>(
        &self,
        state: &MotorState<S>,
        u: [[V; 2]; 3],
        part: Option<&Connected<S>>,
        duration_s: f64,
    ) -> MotorState<S>
    where
        S: Mul<V, Output = S> + Add<V, Output = S>,
    {
        let d = &self.detail;
        let constants = Constants {
            difference: d.difference,
            decay_per_s: d.decay_per_s,
            inverse_inertia: part.map_or(d.inverse_inertia, |part| part.inverse_inertia),
            admittance: self.admittance,
            second_cage: d.second_cage,
            connected: part.map(|part| part.share),
        };
        let held = |e: [S; 2]| {
            d.saturation.map_or(e, |curve| {
                let factor = saturation_factor(curve, e);
                [e[0] * factor, e[1] * factor]
            })
        };
        let load = |speed: S| self.load_torque(speed);
        let ([a, b], [c, e]) = (state.flux, state.second);
        let start = [a, b, state.speed_rad_s, c, e];
        let [a, b, s, c, e] = detailed(&constants, start, u, duration_s, held, load);
        self.after([a, b, s], [c, e])
    }

    #[inline(always)]
    fn load_torque(&self, speed_rad_s: S) -> S {
        // A drive that has come to rest still has this share of its speed in the power law, which
        // has no finite slope at 0.
        const SPEED_RATIO_MIN: f64 = 0.05;
        let rest = self.detail.rest_torque;
        let Some(exponent) = self.detail.torque_exponent else {
            return rest;
        };
        let synchronous = self.synchronous_speed_rad_s;
        let ratio = (speed_rad_s + synchronous) / (self.rest.speed_rad_s + synchronous);
        rest * power(at_least(ratio, SPEED_RATIO_MIN), exponent)
    }
}

#[inline(always)]
fn saturation_factor<S: Elementary>([strength, knee]: [S; 2], flux: [S; 2]) -> S {
    let above = at_least(complex::modulus(flux) - knee, 0.0);
    strength * above * above + 1.0
}

/// The branches of the detailed motor at rest, seen from its terminals.
struct Branch<S> {
    /// `Z'` or `Z''`.
    stator: [S; 2],
    difference: S,
    open_circuit_time_s: S,
    saturation: Option<[S; 2]>,
    /// `x' - x''` and `T''`.
    second: Option<(S, S)>,
}

/// Current and voltages of the rest at one speed and `u = 1`.
struct AtSpeed<S> {
    current: [S; 2],
    transient: [S; 2],
    behind: [S; 2],
}

impl<S: Elementary> Branch<S> {
    fn new(description: &MotorDescription<S>) -> Result<Self, Infeasible> {
        let c = &description.coordinates;
        let loaded = c.kappa.value() > 0.0; // false for NaN, too
        if !loaded {
            return Err(Infeasible {
                violation: -c.kappa.value(),
                constraint: "(13)",
            });
        }
        let strength = S::constant(2.0) / c.kappa;
        let x = description.reactance;
        let x_prime = S::constant(1.0) / (strength + S::constant(1.0) / x);
        let second = description
            .second_cage
            .map(|[reduction, time_s]| (x_prime * reduction, time_s));
        let behind = second.map_or(x_prime, |(part, _)| x_prime - part);
        let resistance = description.stator_resistance;
        Ok(Self {
            stator: [resistance.unwrap_or(S::constant(0.0)), behind],
            difference: x - x_prime,
            open_circuit_time_s: (strength * x + 1.0) / c.alpha_per_s,
            saturation: description.saturation,
            second,
        })
    }

    /// (1), (2), (5) at rest.
    fn at_speed(&self, s: S) -> AtSpeed<S> {
        let mut factor = S::constant(1.0);
        let mut at = self.with_factor(s, factor);
        if let Some(curve) = self.saturation {
            let mut last = f64::NAN;
            for _ in 0..SATURATION_STEPS_MAX {
                factor = saturation_factor(curve, at.transient);
                at = self.with_factor(s, factor);
                // Exactly repeated values: by then the derivatives have converged as well.
                if factor.value().to_bits() == last.to_bits() {
                    break;
                }
                last = factor.value();
            }
        }
        at
    }

    fn with_factor(&self, s: S, factor: S) -> AtSpeed<S> {
        let zero = S::constant(0.0);
        let rotor = complex::quotient(
            [zero, self.difference],
            [factor, -(s * self.open_circuit_time_s)],
        );
        let both = self.second.map_or(rotor, |(difference, time_s)| {
            let cage = complex::quotient([zero, difference], [S::constant(1.0), -(s * time_s)]);
            complex::sum(rotor, cage)
        });
        let current = complex::inverse(complex::sum(self.stator, both));
        AtSpeed {
            current,
            transient: complex::product(rotor, current),
            behind: complex::product(both, current),
        }
    }
}

/// Speed against the frame at which the motor draws 1. The power is concave in the slip up to
/// pull-out, so Newton's method from synchronous speed approaches the root from one side; where the
/// power stops rising there is none.
fn running_speed<S: Elementary>(
    description: &MotorDescription<S>,
    branch: &Branch<S>,
) -> Result<S, Infeasible> {
    let rigid = Branch::new(&description.map(|x| Dual::<1>::constant(x.value())))?;
    let (mut speed, mut slope) = (0.0, f64::NAN);
    let mut missing = f64::INFINITY;
    for _ in 0..SLIP_STEPS_MAX {
        let active = rigid.at_speed(Dual::variable(speed, 0)).current[0];
        missing = 1.0 - active.value;
        slope = active.derivatives[0];
        // The power rises as the speed falls; neither holds for NaN.
        let (rises, turns) = (slope < 0.0, speed > -description.synchronous_speed_rad_s);
        if !(rises && turns) {
            break;
        }
        let next = speed + missing / slope;
        if (next - speed).abs() <= 1e-14 * next.abs() {
            // With losses the terminal power still rises where the torque already falls.
            let at = rigid.at_speed(Dual::variable(next, 0));
            let torque = complex::dot(at.behind, at.current);
            let stable = torque.derivatives[0] < 0.0;
            if !stable {
                missing = torque.derivatives[0] / slope.abs();
                break;
            }
            let exact = branch.at_speed(S::constant(next)).current[0];
            return Ok((exact + -1.0) * (-1.0 / slope) + next);
        }
        speed = next;
    }
    Err(Infeasible {
        violation: if slope.is_nan() {
            f64::NAN
        } else {
            missing.max(f64::MIN_POSITIVE)
        },
        constraint: "(13), with losses",
    })
}
