//! A first-order lag, exact for an input that goes straight over the step.

use crate::{
    load_model::composed::Step,
    numerics::{Elementary, elementary::mean_decay},
};

/// The state of `T z' = v - z` after a step from `from` to `to`.
pub(super) fn lag<S: Elementary>(z: S, [from, to]: [S; 2], time_s: S, duration_s: f64) -> S {
    decayed(z, [from, to], decay(time_s, duration_s))
}

/// The mean of a decay over a step, and what is left at its end.
fn decay<S: Elementary>(time_s: S, duration_s: f64) -> [S; 2] {
    let x = S::constant(duration_s) / time_s;
    [mean_decay(x), (-x).exp()]
}

fn decayed<S: Elementary>(z: S, [from, to]: [S; 2], [mean, left]: [S; 2]) -> S {
    to - (to - from) * mean + (z - from) * left
}

/// [`decayed`] towards numbers without derivatives, to the same bits.
fn decayed_to<S: Elementary>(z: S, [from, to]: [f64; 2], [mean, left]: [S; 2]) -> S {
    mean * (from - to) + to + (z + -from) * left
}

/// Below this share of half a step nothing of an older state is left.
const SHORT: f64 = 0.02;

/// What a lag, which may be of no time, does over each half of a step.
#[derive(Clone, Copy)]
pub(in crate::load_model) enum HalfStep<S> {
    /// Nothing is left of an older state; the lag over the half step.
    Short(S),
    /// [`decay`].
    Long([S; 2]),
}

impl<S: Elementary> HalfStep<S> {
    pub(in crate::load_model) fn new(time_s: S, half_s: f64) -> Self {
        if time_s.value() < SHORT * half_s {
            // (1 - e^-x)/x is 1/x and e^-x nothing there.
            Self::Short(time_s * (1.0 / half_s))
        } else {
            Self::Long(decay(time_s, half_s))
        }
    }

    /// The state of `T z' = v - z` after a step over which the voltage goes straight to the middle and to the end.
    pub(in crate::load_model) fn lagged(&self, z: S, [start, middle, end]: [S; 3]) -> S {
        match self {
            Self::Short(share) => end - (end - middle) * *share,
            Self::Long(decay) => {
                let z = decayed(z, [start, middle], *decay);
                decayed(z, [middle, end], *decay)
            }
        }
    }

    /// [`Self::lagged`] for a voltage without derivatives.
    pub(in crate::load_model) fn lagged_measured(&self, z: S, [start, middle, end]: [f64; 3]) -> S {
        match self {
            Self::Short(share) => *share * (middle - end) + end,
            Self::Long(decay) => {
                let z = decayed_to(z, [start, middle], *decay);
                decayed_to(z, [middle, end], *decay)
            }
        }
    }
}

/// [`HalfStep::lagged`] by itself.
pub(super) fn lagged_voltage<S: Elementary>(z: S, step: &Step<S>, time_s: S) -> S {
    HalfStep::new(time_s, 0.5 * step.duration_s).lagged(z, step.voltage)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::{Scalar, Sensitivities};

    #[test]
    fn a_ramp_is_followed_one_time_constant_late() {
        // z of v = t settles at t - T.
        let (mut z, step_s, time_s) = (0.0_f64, 0.01, 0.2);
        for k in 0..400 {
            let t = f64::from(k) * step_s;
            z = lag(z, [t, t + step_s], time_s, step_s);
        }
        assert!((z - (4.0 - time_s)).abs() < 1e-8);
    }

    #[test]
    fn a_measured_voltage_is_followed_to_the_same_bits() {
        type S = Sensitivities<1>;
        let voltage = [0.97, 0.62, 0.71];
        let z = S::new(0.93, &[0.4, -0.2]);
        for time_s in [1e-6, 0.0008, 0.05, 3.0] {
            let half = HalfStep::new(S::variable(time_s, 1), 0.5 / 60.0);
            let expected = half.lagged(z, voltage.map(S::constant));
            let found = half.lagged_measured(z, voltage);
            assert_eq!(found.value.to_bits(), expected.value.to_bits());
            assert!(found.derivatives().eq(expected.derivatives()));
        }
    }
}
