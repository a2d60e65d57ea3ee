//! The lag through which the static load of a composed model sees its voltage: equations (1) and (2) of
//! `effects::static_lag`, exact for a voltage that goes straight from the start of a step to its middle and to its end.

use std::cell::RefCell;

use super::{active::Pass, places::Acting};
use crate::{
    load_model::effects::lag::HalfStep,
    numerics::elementary::{at_least, at_most},
};

/// `v/z` at most, and `z` at least.
const RATIO_MAX: f64 = 3.0;
const LAGGED_MIN: f64 = 0.02;

/// The lag with what its steps share.
pub(super) struct StaticLag<S> {
    time_s: S,
    constant: [S; 2],
    line: [S; 2],
    /// The last half step, s, and what the lag does over it.
    half: RefCell<Option<(f64, HalfStep<S>)>>,
}

impl<S: Pass> StaticLag<S> {
    /// Of the effect that has it.
    pub(super) fn new(effect: &Acting<'_, '_, S>) -> Self {
        Self {
            time_s: effect.equations().static_lag_s(effect.parameters()),
            constant: effect.rest.static_constant,
            line: effect.rest.static_line,
            half: RefCell::new(None),
        }
    }

    /// `z` after a step over the voltages at its start, middle and end.
    pub(super) fn advanced(&self, z: S, voltage: [S; 3], duration_s: f64) -> S {
        self.over(duration_s, |half| half.lagged(z, voltage))
    }

    /// The same where the voltages are measured.
    pub(super) fn advanced_measured(&self, z: S, voltage: [f64; 3], duration_s: f64) -> S {
        self.over(duration_s, |half| half.lagged_measured(z, voltage))
    }

    fn over(&self, duration_s: f64, lagged: impl Fn(&HalfStep<S>) -> S) -> S {
        let half_s = 0.5 * duration_s;
        let mut last = self.half.borrow_mut();
        match &*last {
            Some((s, half)) if s.to_bits() == half_s.to_bits() => lagged(half),
            _ => {
                let (_, half) = last.insert((half_s, HalfStep::new(self.time_s, half_s)));
                lagged(half)
            }
        }
    }

    /// What it adds to active and reactive power at a voltage.
    pub(super) fn power(&self, z: S, voltage: S) -> [S; 2] {
        let ratio = at_most(voltage / at_least(z, LAGGED_MIN), RATIO_MAX);
        let (square, line) = (ratio * ratio + -1.0, voltage * (ratio + -1.0));
        [0, 1].map(|c| self.constant[c] * square + self.line[c] * line) // (2)
    }
}
