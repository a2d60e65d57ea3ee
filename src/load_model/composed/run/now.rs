//! What moves during a pass.

use super::super::{
    active::Pass,
    feeder::{Secant, Solution, Way},
    motor::MotorState,
};

/// States, and what is known of the phasor at the load.
#[derive(Clone)]
pub(in crate::load_model::composed) struct Now<S> {
    pub(in crate::load_model::composed) motor: MotorState<S>,
    pub(in crate::load_model::composed) effects: Vec<S>,
    /// Voltage as the static load sees it.
    pub(in crate::load_model::composed) lagged: S,
    /// Phasor at the load over the measured one.
    pub(super) ratio: [S; 2],
    /// Whether that is the ratio of the states as they are.
    pub(super) settled: bool,
    /// Where it came from.
    pub(super) way: Way<S>,
    pub(super) secant: Secant,
    /// How often a solution at the load was looked for.
    pub(super) looked_for: usize,
    /// Solutions that no pass before has found, or not with their slopes.
    pub(super) solutions: Vec<Solution>,
    /// Lowest voltage at the load at an output instant so far, where that is not the measured one.
    pub(super) lowest_voltage: f64,
}

impl<S: Pass> Now<S> {
    /// With the motor and the effects at rest.
    pub(super) fn at_rest(motor: MotorState<S>, effects: Vec<S>) -> Self {
        Self {
            motor,
            effects,
            lagged: S::constant(1.0),
            ratio: [S::constant(1.0), S::constant(0.0)],
            settled: false,
            way: Way::UNKNOWN,
            secant: Secant::PLAIN,
            looked_for: 0,
            solutions: Vec::new(),
            lowest_voltage: f64::INFINITY,
        }
    }

    /// Takes over the state of another, and its list of solutions; not the way by which it came.
    pub(super) fn exchange(&mut self, other: &mut Self) {
        self.motor = other.motor;
        self.effects.copy_from_slice(&other.effects);
        self.lagged = other.lagged;
        self.ratio = other.ratio;
        self.secant = other.secant;
        self.looked_for = other.looked_for;
        std::mem::swap(&mut self.solutions, &mut other.solutions);
    }
}
