//! Magnetic saturation of the motors.
//!
//! Above a knee the flux needs more magnetising current than in proportion.
//!
//! Missing, it leaves a residual in Q at voltages above normal and a slightly wrong decay of the flux;
//! in a single dip there is next to nothing, over several voltage levels a little.
//!
//! ```text
//! S = B (|e'| - A)^2 above the knee A, else 0                                       (1)
//! de'/dt = j s e' - ((1 + S) e' - j (x - x') i)/T0'                                 (2)
//! ```
//!
//! Acts on the motors of the base model and on those that `motor_undervoltage_trip` takes from them; those of `second_motor` do
//! not saturate. `x` on the base of the motors' own initial power.
//!
//! Source: quadratic saturation as usual for machines, SE(1.0) and SE(1.2) being two points of (1) (from
//! memory, not verified); (2) as equation (2) of `base_motor`.

use crate::{
    load_model::{
        MotorCoordinates,
        composed::MotorDescription,
        effect::{
            Declaration, Declared, Equations, Kind, MOTOR_REACTANCE, Needs, Parameter, Place,
            Reference,
        },
    },
    numerics::Elementary,
};

/// Magnetic saturation of the motors.
#[derive(Clone, Copy, Debug)]
pub(super) struct Saturation;

const DECLARATION: Declaration = Declaration {
    name: "saturation",
    title: "Magnetic saturation of the motors",
    kind: Kind::Physics,
    version: 2,
    parameters: &[
        Parameter::one_sided(["strength", "B", "1"], [5.0, 40.0, 1.0])
            .with_reference(Reference::GroupAdmittance),
        Parameter::shape(["knee", "A", "pu"], [0.5, 0.8, 1.0], 0.05)
            .with_reference(Reference::Voltage),
        MOTOR_REACTANCE,
    ],
    states: &[],
    acts_on: &[Place::Motor],
    excludes: &[],
    resembles: &["low_voltage_conversion"],
    needs: Needs {
        voltage_below: None,
        voltage_above: Some(1.04),
        separating_event: "three or more voltage levels, one above 1.05",
        ..Needs::A_DIP
    },
    source: "quadratic machine saturation SE(1.0), SE(1.2) (from memory, not verified)",
};

impl Declared for Saturation {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        [0.75, 0.85].map(|knee| vec![knee]).to_vec()
    }
}

impl<S: Elementary> Equations<S> for Saturation {
    fn motor(&self, p: &[S], motor: &mut MotorDescription<S>) {
        motor.saturation = Some([p[0], p[1]]);
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
    fn a_saturated_motor_magnetises_with_more_current() {
        let mut description = MotorDescription::new(
            MotorCoordinates {
                alpha_per_s: 30.0,
                nu_per_s2: 900.0,
                kappa: 0.4,
            },
            376.99,
        );
        description.saturation = Some([0.0, 0.8]);
        let without = Motor::new(&description).unwrap();
        description.saturation = Some([5.0, 0.8]);
        let with = Motor::new(&description).unwrap();
        assert!((with.rest_power[0] - 1.0).abs() < 1e-12);
        // S = 5 (|e'| - 0.8)^2 with |e'| about 0.87: 2 to 3 % of 1/x more in Q, and a smaller flux.
        let more = with.rest_power[1] - without.rest_power[1];
        assert!(more > 0.005 && more < 0.05, "{more}");
        let modulus = |m: &Motor<f64>| m.rest.flux[0].hypot(m.rest.flux[1]);
        assert!(modulus(&with) < modulus(&without));
    }
}
