//! The lag through which the static load of a composed model sees its voltage: equations (1) and (2) of
//! `effects::static_lag`, exact for a voltage that goes straight from the start of a step to its middle and to its end.

use std::cell::Cell;

use super::{active::Pass, places::Acting};
use crate::numerics::elementary::{at_least, at_most, mean_decay};

/// `v/z` at most, and `z` at least.
const RATIO_MAX: f64 = 3.0;
const LAGGED_MIN: f64 = 0.02;
/// Below this share of half a step nothing of an older state is left.
const SHORT: f64 = 0.02;

/// The lag with what its steps share.
pub(super) struct StaticLag<S> {
    time_s: S,
    constant: [S; 2],
    line: [S; 2],
    /// Half a step, s, and what the lag makes of it.
    half: Cell<(f64, Half<S>)>,
}

/// What a lag does over half a step.
#[derive(Clone, Copy)]
enum Half<S> {
    /// Nothing is left of an older state; the lag over the half step.
    Short(S),
    /// The mean of the decay, and what is left.
    Long(S, S),
}

impl<S: Pass> StaticLag<S> {
    /// Of the effect that has it.
    pub(super) fn new(effect: &Acting<'_, '_, S>) -> Self {
        let time_s = effect.equations().static_lag_s(effect.parameters());
        Self {
            time_s,
            constant: effect.rest.static_constant,
            line: effect.rest.static_line,
            half: Cell::new((0.0, Half::Short(time_s))),
        }
    }

    /// `z` after a step over the voltages at its start, middle and end.
    pub(super) fn advanced(&self, z: S, [start, middle, end]: [S; 3], duration_s: f64) -> S {
        let half_s = 0.5 * duration_s;
        let (known_s, mut half) = self.half.get();
        if known_s.to_bits() != half_s.to_bits() {
            half = self.over(half_s);
            self.half.set((half_s, half));
        }
        match half {
            Half::Short(share) => end - (end - middle) * share,
            Half::Long(mean, left) => {
                let z = middle - (middle - start) * mean + (z - start) * left;
                end - (end - middle) * mean + (z - middle) * left
            }
        }
    }

    fn over(&self, half_s: f64) -> Half<S> {
        if self.time_s.value() < SHORT * half_s {
            // (1 - e^-x)/x is 1/x and e^-x nothing there.
            return Half::Short(self.time_s * (1.0 / half_s));
        }
        let x = S::constant(half_s) / self.time_s;
        Half::Long(mean_decay(x), (-x).exp())
    }

    /// What it adds to active and reactive power at a voltage.
    pub(super) fn power(&self, z: S, voltage: S) -> [S; 2] {
        let ratio = at_most(voltage / at_least(z, LAGGED_MIN), RATIO_MAX);
        let (square, line) = (ratio * ratio + -1.0, voltage * (ratio + -1.0));
        [0, 1].map(|c| self.constant[c] * square + self.line[c] * line) // (2)
    }
}
