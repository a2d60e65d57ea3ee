//! Load torque that depends on the speed.
//!
//! The reference paper's motors drive a constant torque. Fans and pumps demand less when they slow
//! down, about with the square of the speed; conveyors and compressors do not.
//!
//! Missing, it biases the motor share and the inertia rather than leaving much of a residual; deep or
//! long dips, and sags of frequency with the voltage at its value, show it. Hardly separable from
//! a frequency dependence of the static part (correlation .99 over four events).
//!
//! ```text
//! T_m = T_0 (w / w_0)^m                     (1)
//! ```
//!
//! solved within the swing equation (4) of `base_motor`; `w` the rotor speed. `m` is 0 for a torque
//! that stays, about 2 for fans and pumps, somewhat more where they work against a static head; no drive
//! has a negative one.
//!
//! Acts on the motors of the base model and on those that `motor_undervoltage_trip` takes from them; the torque of those of
//! `second_motor` stays.
//!
//! Source: torque exponent `etrq` of the motors A to C in the WECC composite load model (0 for A, 2 for B
//! and C, not verified) and `torqueExponent` of Dynawo's fifth-order motor (verified by name). The
//! polynomial of CIM6 and of PSAT's motors (`a + b w + c w^2`, verified in `OpenIPSL`) is close to (1) within a
//! few percent of speed.

use crate::{
    load_model::{
        composed::MotorDescription,
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place},
    },
    numerics::Elementary,
};

/// Load torque that depends on the speed.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpeedDependentTorque;

const DECLARATION: Declaration = Declaration {
    name: "speed_dependent_torque",
    title: "Load torque that depends on the speed",
    kind: Kind::Physics,
    version: 2,
    parameters: &[Parameter::one_sided(
        ["exponent", "m", "1"],
        [2.0, 3.5, 0.5],
    )],
    states: &[],
    acts_on: &[Place::Motor],
    excludes: &[],
    resembles: &["static_frequency_dependence", "frequency_scaled_power"],
    needs: Needs {
        voltage_below: Some(0.7),
        window_s: 5.0,
        separating_event: "deep dips at nominal frequency, and deviations of both signs",
        ..Needs::A_DIP
    },
    source: "WECC composite load model, etrq (values not verified); Dynawo MotorFifthOrder, \
             torqueExponent; OpenIPSL MotorTypeV (polynomial verified)",
};

impl Declared for SpeedDependentTorque {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for SpeedDependentTorque {
    fn motor(&self, p: &[S], motor: &mut MotorDescription<S>) {
        motor.torque_exponent = Some(p[0]);
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    #[test]
    fn at_half_a_hertz_less_a_fan_draws_the_cube() {
        // After a slow fall of the frequency by 0.01 pu the rotor has lost 1 % of its speed (and
        // the slip stays all but the same): torque 0.99^2; the motor's power (10) is torque.
        let angle = |t: f64| {
            let ramp = (t - 0.5).clamp(0.0, 4.0);
            let after = (t - 4.5).max(0.0);
            -0.01 * 376.99 * (ramp * ramp / 8.0 + after)
        };
        let phasor = |t: f64| [angle(t).cos(), angle(t).sin()];
        let input = lasting(12.0, phasor, &[]);
        let structure = Structure::zip_im().with("speed_dependent_torque").unwrap();
        let model = ComposedModel::new(&structure);
        let p = model.typical();
        let drive = Drive::new(&input, &[], 0.3);
        let out = model.simulate(&p, &[], &drive).unwrap();
        let last = out.active[out.active.len() - 1];
        let expected = 1.0 + p[3] * (0.99_f64 * 0.99 - 1.0);
        assert!((last - expected).abs() < 3e-4, "{last} {expected}");
    }
}
