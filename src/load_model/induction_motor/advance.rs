//! From one instant to the next: which method, how long a step, and a rotor that stands still.
//!
//! A piece of the input is tried in one step. Where the error estimate of that step exceeds the
//! tolerance, or the rotor would turn backwards, both halves are tried in turn, and so on. The decision
//! depends on the motor and its input alone, so it is the same in a batch as alone.

use super::{
    MotorCoordinates,
    input_pieces::Piece,
    radau,
    taylor::{Ending, LONG, Series, StepConstants, input_beyond},
};
use crate::{load_model::TerminalInput, numerics::Scalar};

/// Largest product of rate and step at which the series is tried: beyond it the highest order seldom reaches
/// the tolerance. Matters for speed only.
pub(super) const SERIES_REACH: f64 = 3.0;
/// Product of decay rate and step from which the implicit method is tried: there one of its steps, three
/// solutions of the stages, costs less than the steps of the series it replaces.
const IMPLICIT_REACH: f64 = 60.0;
/// What a step may leave out of flux and of rotation, relative to `kappa`: power is flux times `2 / kappa`,
/// so each step may add an error of a few 1e-9 of the motor's power. Smaller values cost little (the
/// order grows) and keep the output a smooth function of the parameters; below 1e-11 rounding interferes.
const FLUX_TOLERANCE: f64 = 1e-9;
/// Shortest step, seconds: where a jump of the input or the instant of standstill is pinned down to this,
/// no rate in the box of the reference paper can tell the difference.
const SHORTEST_S: f64 = 1e-10;
/// Steps per measured sample at most, on average over a simulation; beyond it the result is not a number.
const STEPS_PER_SAMPLE_MAX: usize = 2000;

/// Flux (real, imaginary) and rotor speed against the terminal's frame, rad/s.
#[derive(Clone, Copy, Debug)]
pub(super) struct State<S> {
    pub(super) flux: [S; 2],
    pub(super) speed: S,
    /// Whether the rotor stands still and the load's torque holds it.
    pub(super) standing: bool,
}

/// A motor with everything that stays the same during a simulation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mover<S> {
    alpha: S,
    nu: S,
    /// Flux and speed at rest; the flux's imaginary part is the torque of the load.
    rest: [S; 3],
    /// Speed at which the rotor stands still, rad/s.
    standstill: f64,
    /// What a step may leave out of flux and rotation.
    tolerance: f64,
    rate_static: f64,
    /// Shortest step, seconds.
    shortest_s: f64,
    steps_left: usize,
}

impl<S: Scalar> Mover<S> {
    /// `accuracy` multiplies the tolerance.
    pub(super) fn new(
        motor: &MotorCoordinates<S>,
        rest: [S; 3],
        input: &TerminalInput,
        accuracy: f64,
    ) -> Self {
        let standstill = -input.synchronous_speed_rad_s;
        let (alpha, nu) = (motor.alpha_per_s, motor.nu_per_s2);
        Self {
            alpha,
            nu,
            rest,
            // A motor whose slip at rest is above one never stands still: (9) as it is.
            standstill: if rest[2].value() > standstill {
                standstill
            } else {
                f64::NEG_INFINITY
            },
            // Power is flux times 2 / kappa.
            tolerance: FLUX_TOLERANCE * accuracy * motor.kappa.value(),
            rate_static: alpha.value().max(nu.value().max(0.0).sqrt()),
            shortest_s: SHORTEST_S * accuracy.max(1.0),
            steps_left: STEPS_PER_SAMPLE_MAX * (input.sample_count() + 50),
        }
    }

    pub(super) const fn rest(&self) -> [S; 3] {
        self.rest
    }

    /// The larger of the motor's two rates at rest, 1/s.
    pub(super) const fn rate_at_rest(&self) -> f64 {
        self.rate_static
    }

    pub(super) const fn alpha(&self) -> S {
        self.alpha
    }

    pub(super) const fn tolerance(&self) -> f64 {
        self.tolerance
    }

    pub(super) const fn standstill(&self) -> f64 {
        self.standstill
    }

    /// Moves the state over a piece of `duration_s`.
    pub(super) fn advance(&mut self, state: &mut State<S>, piece: &Piece, duration_s: f64) {
        if let Some(next) = self.step(state, piece, duration_s) {
            *state = next;
            return;
        }
        let half_s = 0.5 * duration_s;
        let left = piece.shortened(2);
        self.advance(state, &left, half_s);
        self.advance(state, &left.next(), half_s);
    }

    /// One step, or nothing if it must be shorter.
    #[inline(always)]
    fn step(&mut self, from: &State<S>, piece: &Piece, h: f64) -> Option<State<S>> {
        let rate = self.rate_static.max(from.speed.value().abs());
        let shortest = h <= self.shortest_s;
        let series = h * rate <= SERIES_REACH || shortest;
        let implicit = h * self.alpha.value() > IMPLICIT_REACH && !from.standing;
        if !series && !implicit && rate.is_finite() {
            return None;
        }
        self.steps_left = self.steps_left.saturating_sub(1);
        let stop = shortest || self.steps_left == 0 || !rate.is_finite();
        let constants = StepConstants {
            decay: self.alpha * h,
            acceleration: self.acceleration(from, h),
            load: self.rest[1],
        };
        let start = [from.flux[0], from.flux[1], from.speed * h];
        let (end, lowest) = if series || stop {
            let mut ending = Tail {
                tolerance: self.tolerance,
                decay: constants.decay.value(),
                piece,
                reached: false,
            };
            let (series, order) = Series::run(start, &constants, piece, &mut ending);
            if !ending.reached && !stop {
                return None;
            }
            let end = sum(&series, order);
            let falling = from.speed.value() + series.first_rotation().value() * (1.0 / h);
            let to = end[2].value() * (1.0 / h);
            (end, falling.min(to))
        } else {
            let (end, error) = radau::step(start, &constants, piece)?;
            let tolerance = self.tolerance;
            let rotation = tolerance * start[2].value().abs().max(1.0);
            // Written so that NaN is refused.
            if !(error[0] <= tolerance && error[1] <= tolerance && error[2] <= rotation) {
                return None;
            }
            (end, end[2].value() * (1.0 / h))
        };
        let mut to = State {
            flux: [end[0], end[1]],
            speed: end[2] * (1.0 / h),
            standing: from.standing,
        };
        if from.standing {
            to.speed = from.speed;
        }
        if self.steps_left == 0 {
            to.flux = [S::constant(f64::NAN); 2];
        }
        self.standstill_kept(&mut to, piece, lowest, stop)
            .then_some(to)
    }

    fn acceleration(&self, from: &State<S>, h: f64) -> S {
        if from.standing {
            S::constant(0.0)
        } else {
            self.nu * (h * h)
        }
    }

    /// Whether the step is short enough for what the rotor does: it comes to stand or starts at the end
    /// of a shortest step.
    #[inline(always)]
    fn standstill_kept(&self, to: &mut State<S>, piece: &Piece, lowest: f64, stop: bool) -> bool {
        if to.standing {
            let [re, im] = piece.at(1.0);
            let torque = to.flux[1] * re - to.flux[0] * im;
            if torque.value() < self.rest[1].value() {
                if !stop {
                    return false;
                }
                to.standing = false;
            }
            return true;
        }
        // `lowest` bounds the speed: a curve that falls and rises again lies above its tangent.
        if lowest < self.standstill {
            if !stop {
                return false;
            }
            if to.speed.value() <= self.standstill {
                to.speed = S::constant(self.standstill);
                to.standing = true;
            }
        }
        true
    }
}

#[inline(always)]
fn sum<S: Scalar>(series: &Series<S, LONG>, order: usize) -> [S; 3] {
    // Literal orders become straight code.
    match order {
        4 => series.sum(4),
        6 => series.sum(6),
        8 => series.sum(8),
        10 => series.sum(10),
        12 => series.sum(12),
        _ => series.sum(14),
    }
}

/// Ends a series when its last two terms and what the input still adds are below the tolerance.
struct Tail<'a> {
    tolerance: f64,
    decay: f64,
    piece: &'a Piece,
    reached: bool,
}

impl<S: Scalar> Ending<S, LONG> for Tail<'_> {
    #[inline(always)]
    fn ends(&mut self, series: &Series<S, LONG>, order: usize) -> bool {
        let terms: f64 = series.last_two(order).map(|c| c.value().abs()).iter().sum();
        if terms.is_nan() {
            self.reached = true;
            return true;
        }
        self.reached = terms <= self.tolerance
            && (order > 8 || self.decay * input_beyond(self.piece, order) <= self.tolerance);
        self.reached
    }
}
