//! A second cage, or deep bars, in the rotor.
//!
//! Large motors have a fast rotor circuit besides the slow one: for some milliseconds after a change
//! of voltage they draw more current than the transient reactance lets expect.
//!
//! Missing, it leaves short spikes after both edges of a dip, mostly in Q; a second motor, a time
//! skew or a phasor window leave similar ones. 120 frames/s help.
//!
//! Equation (5) of `base_motor`, with `x'' = (1 - c) x'` and the time constant `T''`:
//!
//! ```text
//! i = (u - e'')/(r + j x''),   de''/dt = j s (e'' - e') + de'/dt + (e' - e'' + j (x' - x'') i)/T''       (1)
//! ```
//!
//! With `y = e'' - e'` this is `dy/dt = j s y - (y - j (x' - x'') i)/T''`: two circuits side by side, so that every
//! double cage has parameters here exactly, from the partial fractions of its operational reactance
//!
//! ```text
//! x(p) = x'' + (x - x')/(1 + p T0') + (x' - x'')/(1 + p T'')                 (2)
//! ```
//!
//! `kappa` and `alpha` are those of the slow circuit alone: they move when a cage is added to a motor
//! fitted without one, mostly `kappa` downwards with the motor's share going up.
//!
//! Acts on the motors of the base model and on those that `motor_undervoltage_trip` takes from them; those of `second_motor` keep
//! one cage.
//!
//! Source: equations of PSAT's fifth-order motor as in `OpenIPSL` `MotorTypeV.mo` (verified); T'' about
//! 2 ms open-circuit and L'' .7 to .87 of L' in MOTORW records (not verified).

use crate::{
    load_model::{
        MotorCoordinates,
        composed::MotorDescription,
        effect::{
            Declaration, Declared, Equations, Kind, MOTOR_REACTANCE, Needs, Parameter, Place,
        },
    },
    numerics::Elementary,
};

/// A second cage in the rotor.
#[derive(Clone, Copy, Debug)]
pub(super) struct DoubleCageRotor;

const DECLARATION: Declaration = Declaration {
    name: "double_cage_rotor",
    title: "Second cage or deep bars in the rotor",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::one_sided(["reduction", "c", "1"], [0.25, 0.7, 0.08]),
        Parameter::positive_shape(["time_constant_s", "T''", "s"], [0.002, 0.012, 0.1], 0.7),
        MOTOR_REACTANCE,
    ],
    states: &[],
    acts_on: &[Place::Motor],
    excludes: &[],
    resembles: &["second_motor", "time_skew", "phasor_window"],
    needs: Needs {
        voltage_below: Some(0.75),
        rate_fps: 100.0,
        separating_event: "deep dips at 100 frames/s or more, time skew between channels ruled out",
        ..Needs::A_DIP
    },
    source: "PSAT fifth-order motor, OpenIPSL MotorTypeV.mo (equations verified); MOTORW values (not \
             verified)",
};

impl Declared for DoubleCageRotor {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        [0.004, 0.008, 0.016, 0.03].map(|t| vec![t]).to_vec()
    }
}

impl<S: Elementary> Equations<S> for DoubleCageRotor {
    fn motor(&self, p: &[S], motor: &mut MotorDescription<S>) {
        motor.second_cage = Some([p[0], p[1]]);
        motor.reactance = p[2];
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{
        MotorCoordinates,
        composed::{Motor, MotorDescription},
    };

    #[test]
    fn the_first_current_after_a_step_is_limited_by_the_subtransient_reactance() {
        // G = 5, x = 2: x' = 1/5.5, x'' = 0.75 x'. A step of the voltage by -0.1 changes the current
        // by -0.1/(j x''), the reactive power at u = 0.9 by the imaginary part of u conj(di).
        let mut description = MotorDescription::new(
            MotorCoordinates {
                alpha_per_s: 30.0,
                nu_per_s2: 900.0,
                kappa: 0.4,
            },
            376.99,
        );
        description.reactance = 2.0;
        description.second_cage = Some([0.25, 0.01]);
        let motor = Motor::new(&description).unwrap();
        let [p0, q0] = motor.rest_power;
        assert!((p0 - 1.0).abs() < 1e-12);
        let [_, q] = motor.power(&motor.rest, [0.9, 0.0]);
        let second = 0.75 / 5.5;
        // Magnetisation 1/x = 0.5 added on both sides.
        let expected = 0.9 * ((q0 + 0.5) - 0.1 / second);
        assert!((q + 0.5 * 0.81 - expected).abs() < 1e-12);
    }
}
