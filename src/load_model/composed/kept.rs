//! What a pass leaves to those after it.

use std::sync::Arc;

use super::{feeder::Solution, motor::MotorState, run::Now};
use crate::numerics::Scalar;

/// Values of the states of motor and effects at every output instant, and of the phasor at the load
/// at every instant at which it was looked for.
#[derive(Clone, Debug, Default)]
pub(super) struct Kept {
    /// Whether the states are wanted.
    states: bool,
    /// States of the motor, and the lagged voltage of the static load.
    motor: Arc<Vec<(MotorState<f64>, f64)>>,
    /// States of the effects, instant after instant.
    effects: Vec<f64>,
    /// Solutions at the load, in the order in which they are looked for.
    pub(super) solutions: Vec<Solution>,
    /// Lowest voltage at the load at an output instant of the last integration, over that at rest, where that is not the
    /// measured one.
    pub(super) lowest_voltage: f64,
}

impl Kept {
    /// Nothing kept yet.
    pub(super) fn new(states: bool) -> Self {
        Self {
            states,
            ..Self::default()
        }
    }

    /// Whether a pass before has found how solutions at the load depend on themselves.
    pub(super) fn knows_slopes(&self) -> bool {
        self.solutions.first().is_some_and(Solution::knows_slopes)
    }

    /// Wants the states of the effects anew, for which the motor's are there.
    pub(super) fn forget_effects(&mut self) {
        self.states = true;
        self.effects.clear();
    }

    /// Adds the states of the effects at the next output instant.
    pub(super) fn keep_effects<S: Scalar>(&mut self, now: &Now<S>) {
        if self.states {
            self.effects.extend(now.effects.iter().map(|x| x.value()));
        }
    }

    /// Adds the next output instant.
    pub(super) fn keep<S: Scalar>(&mut self, now: &Now<S>) {
        if !self.states {
            return;
        }
        let motor = &now.motor;
        let motor = MotorState {
            flux: motor.flux.map(S::value),
            second: motor.second.map(S::value),
            speed_rad_s: motor.speed_rad_s.value(),
        };
        Arc::make_mut(&mut self.motor).push((motor, now.lagged.value()));
        self.effects.extend(now.effects.iter().map(|x| x.value()));
    }

    /// Ends a pass: what is there is not wanted again.
    pub(super) fn close(&mut self) {
        self.states = false;
    }

    /// The states of motor and static load at an output instant, as constants.
    pub(super) fn restore_motor<S: Scalar>(&self, index: usize, now: &mut Now<S>) {
        let (motor, lagged) = &self.motor[index];
        now.lagged = S::constant(*lagged);
        now.motor = MotorState {
            flux: motor.flux.map(S::constant),
            second: motor.second.map(S::constant),
            speed_rad_s: S::constant(motor.speed_rad_s),
        };
    }

    /// The states at an output instant, as constants.
    pub(super) fn restore<S: Scalar>(&self, index: usize, now: &mut Now<S>) {
        self.restore_motor(index, now);
        let count = now.effects.len();
        let own = &self.effects[index * count..(index + 1) * count];
        for (state, value) in now.effects.iter_mut().zip(own) {
            *state = S::constant(*value);
        }
    }
}
