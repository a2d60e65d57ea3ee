//! A first-order lag, exact for an input that goes straight over the step.

use crate::numerics::{Elementary, elementary::mean_decay};

/// The state of `T z' = v - z` after a step from `from` to `to`.
pub(super) fn lag<S: Elementary>(z: S, [from, to]: [S; 2], time_s: S, duration_s: f64) -> S {
    let x = S::constant(duration_s) / time_s;
    to - (to - from) * mean_decay(x) + (z - from) * (-x).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
