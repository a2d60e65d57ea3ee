//! The scalars of a simulation, and an effect as it takes part in one.

use super::feeder::Implicit;
use crate::load_model::effect::{Declaration, Effect, Equations, PairSensitivity, Sensitivity};

/// The scalars of a simulation.
pub(super) trait Pass: Implicit + 'static {
    fn equations(effect: &dyn Effect) -> &dyn Equations<Self>;
}

impl Pass for f64 {
    fn equations(effect: &dyn Effect) -> &dyn Equations<Self> {
        effect.plain()
    }
}

impl Pass for Sensitivity {
    fn equations(effect: &dyn Effect) -> &dyn Equations<Self> {
        effect.with_sensitivities()
    }
}

impl Pass for PairSensitivity {
    fn equations(effect: &dyn Effect) -> &dyn Equations<Self> {
        effect.with_two()
    }
}

/// An effect that takes part in a pass.
pub(super) struct Active<'a, S> {
    pub(super) declaration: &'static Declaration,
    pub(super) equations: &'a dyn Equations<S>,
    pub(super) parameters: Vec<S>,
    pub(super) first_state: usize,
    /// Whether it is an instrument that is late.
    pub(super) delays: bool,
}

impl<'a, S: Pass> Active<'a, S> {
    /// With its parameters; its states come after `first_state` others.
    pub(super) fn new(effect: &'a dyn Effect, parameters: Vec<S>, first_state: usize) -> Self {
        Self {
            declaration: effect.declaration(),
            equations: S::equations(effect),
            parameters,
            first_state,
            delays: effect.delay().is_some(),
        }
    }

    /// One past the last of its states.
    pub(super) fn end(&self) -> usize {
        self.first_state + self.declaration.states.len()
    }
}
