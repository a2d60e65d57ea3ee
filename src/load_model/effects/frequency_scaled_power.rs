//! Motor power that follows the frequency.
//!
//! A motor's air-gap power is torque times synchronous speed, so that at a torque that stays the
//! same the power follows f. The reference paper's equation (10) has no frequency in it.
//!
//! Missing, it leaves a residual in P in proportion to the frequency deviation, through the whole
//! window and not at the edges, and none in Q.
//!
//! With `df = (f - f0)/f0`:
//!
//! ```text
//! P_motor = P_(10) (1 + c df)               (1)
//! ```
//!
//! `c = 1` is the plain statement above; a drive whose torque rises with the speed adds to it. The
//! plain path of `identification` knows this effect under the same name with `c = 1` fixed.
//!
//! Source: follows from P = T w at constant torque; no comparison, because no other tool has it as
//! an option. Valid for slow changes of frequency; the inertia's own power is in the motor's swing.

use crate::{
    load_model::effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place},
    numerics::Elementary,
};

/// Motor power that follows the frequency.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrequencyScaledPower;

const DECLARATION: Declaration = Declaration {
    name: "frequency_scaled_power",
    title: "Motor power that follows the frequency",
    kind: Kind::Physics,
    version: 1,
    parameters: &[Parameter::two_sided(
        ["coefficient", "c", "1"],
        [-1.0, 1.0, 3.0, 0.3],
    )],
    states: &[],
    acts_on: &[Place::MotorActivePower],
    excludes: &[],
    resembles: &["static_frequency_dependence", "speed_dependent_torque"],
    needs: Needs {
        frequency: true,
        voltage_below: None,
        frequency_deviation: Some(5e-4),
        window_s: 5.0,
        separating_event: "deep dips at nominal frequency, and deviations of both signs",
        ..Needs::A_DIP
    },
    source: "P = T w; no published load model states it separately (not verified)",
};

impl Declared for FrequencyScaledPower {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for FrequencyScaledPower {
    fn motor_active_factor(&self, p: &[S], frequency_deviation: S) -> S {
        p[0] * frequency_deviation + 1.0 // (1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_a_hertz_below_sixty_lowers_the_power_by_five_sixths_of_a_percent() {
        let factor = FrequencyScaledPower.motor_active_factor(&[1.0], -0.5 / 60.0);
        assert!((factor - (1.0 - 0.008_333_333_333)).abs() < 1e-10);
    }
}
