//! The effects of a pass, each with the operating point that it sees, by the place where they act.

use super::{
    Rest,
    active::{Active, Pass},
    complex,
    run::Now,
};
use crate::load_model::effect::{Equations, Place};

/// An effect with the operating point that it sees.
pub(super) struct Acting<'r, 'a, S> {
    pub(super) effect: &'r Active<'a, S>,
    pub(super) rest: Rest<S>,
}

impl<S: Pass> Acting<'_, '_, S> {
    pub(super) fn own<'s>(&self, states: &'s [S]) -> &'s [S] {
        let end = self.effect.end();
        states.get(self.effect.first_state..end).unwrap_or(&[])
    }

    pub(super) fn acts_on(&self, place: Place) -> bool {
        self.effect.declaration.acts_on(place)
    }

    pub(super) fn parameters(&self) -> &[S] {
        &self.effect.parameters
    }

    pub(super) fn equations(&self) -> &dyn Equations<S> {
        self.effect.equations
    }
}

/// The effects of a pass by the place where they act.
pub(super) struct Places<'r, 'a, S> {
    pub(super) gain: Vec<&'r Acting<'r, 'a, S>>,
    pub(super) taps: Vec<&'r Acting<'r, 'a, S>>,
    pub(super) power: Vec<&'r Acting<'r, 'a, S>>,
    pub(super) states: Vec<&'r Acting<'r, 'a, S>>,
}

/// What some effects make of the phasor together.
pub(super) fn product<S: Pass>(
    effects: &[&Acting<'_, '_, S>],
    now: &Now<S>,
    deviation: S,
) -> [S; 2] {
    let none = [S::constant(1.0), S::constant(0.0)];
    effects.iter().fold(none, |product, e| {
        let own = e.own(&now.effects);
        let gain = e.equations().gain(e.parameters(), own, deviation, &e.rest);
        complex::product(product, gain)
    })
}
