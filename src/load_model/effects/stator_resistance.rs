//! Resistance of the motors' stators.
//!
//! The reference paper's motor has none. Real ones lose 2 to 4 % of their rating in it, which turns
//! the phase of the sudden current after a voltage step and makes the air-gap torque smaller than
//! the terminal power exactly while the current is high.
//!
//! Missing, it leaves spikes in P at both edges of a dip and a swing of slightly wrong height; a
//! search without it names a feeder impedance or a second motor instead, which also bring a
//! resistance. It is rarely a finding of its own and often a part of the base model.
//!
//! On the base of the motor's own initial power, with `r` in the stator branch:
//!
//! ```text
//! i   = (u - e') / (r + j x')               (1)
//! t_e = Re(u conj i) - r |i|^2              (2)
//! Re(u conj i) = 1 at rest                  (3)
//! ```
//!
//! (1) to (3) are solved by `base_motor`. `kappa`, which fixes `x'`, keeps its meaning; pull-out
//! comes near `kappa = 1`, later rather than earlier, because the losses are part of the power. The magnetising reactance matters only through
//! the losses and the decay of the flux, and is all but unidentifiable. Not included: the
//! stator's own transients (a hundredth of a second), which a phasor does not show either.
//!
//! Acts on the motors of the base model and on those that `motor_undervoltage_trip` takes from them; those of `second_motor` have a
//! resistance `r_2` of their own.
//!
//! Source: Kundur, "Power System Stability and Control" (1994), 7.2 (equations from memory; checked
//! against that circuit in `composed::tests`).

use crate::{
    load_model::{
        composed::MotorDescription,
        effect::{
            Declaration, Declared, Equations, Kind, MOTOR_REACTANCE, Needs, Parameter, Place,
            Reference,
        },
    },
    numerics::Elementary,
};

/// Resistance of the motors' stators.
#[derive(Clone, Copy, Debug)]
pub(super) struct StatorResistance;

const DECLARATION: Declaration = Declaration {
    name: "stator_resistance",
    title: "Stator resistance of the motors",
    kind: Kind::Physics,
    version: 2,
    parameters: &[
        Parameter::one_sided(["resistance", "r", "1"], [0.02, 0.08, 0.005])
            .with_reference(Reference::GroupImpedance),
        MOTOR_REACTANCE,
    ],
    states: &[],
    acts_on: &[Place::Motor],
    excludes: &[],
    resembles: &["feeder_impedance", "second_motor", "time_skew"],
    needs: Needs {
        voltage_below: Some(0.85),
        rate_fps: 50.0,
        separating_event: "dips of very different depth at 50 frames/s or more",
        ..Needs::A_DIP
    },
    source: "Kundur 1994, 7.2 (not verified); values .02-.04 on the rating: large-motor test data \
             of composite load models (not verified)",
};

impl Declared for StatorResistance {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for StatorResistance {
    fn motor(&self, p: &[S], motor: &mut MotorDescription<S>) {
        motor.stator_resistance = Some(p[0]);
        motor.reactance = p[1];
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{
        MotorCoordinates,
        composed::{Motor, MotorDescription},
    };

    #[test]
    fn losses_at_rest_are_the_current_squared_times_the_resistance() {
        // With r = 0.03, x = 2, G = 5: the torque (2) at rest is 1 - 0.03 |i|^2 and the current
        // i = 1 - j (q + 1/x); both from the motor at rest, the torque from Re(e' conj i).
        let mut description = MotorDescription::new(
            MotorCoordinates {
                alpha_per_s: 30.0,
                nu_per_s2: 900.0,
                kappa: 0.4,
            },
            376.99,
        );
        description.stator_resistance = Some(0.03);
        description.reactance = 2.0;
        let motor = Motor::new(&description).unwrap();
        let [p, q] = motor.rest_power;
        assert!((p - 1.0).abs() < 1e-13, "{p}");
        let current = [1.0, -(q + 0.5)];
        let [e_re, e_im] = motor.rest.flux;
        let torque = e_re * current[0] + e_im * current[1];
        let losses = 0.03 * (current[0] * current[0] + current[1] * current[1]);
        assert!((torque - (1.0 - losses)).abs() < 1e-13);
    }

    #[test]
    fn an_overloaded_motor_has_no_steady_state() {
        for kappa in [1.5, f64::NAN, -0.1] {
            let mut description = MotorDescription::new(
                MotorCoordinates {
                    alpha_per_s: 30.0,
                    nu_per_s2: 900.0,
                    kappa,
                },
                376.99,
            );
            description.stator_resistance = Some(0.05);
            assert!(Motor::new(&description).is_err(), "{kappa}");
        }
    }
}
