//! A second group of motors with a time scale of its own.
//!
//! Large fans with 0.5 s of inertia and small pumps with 0.1 s at one substation are not one motor:
//! one of them has recovered while the other still accelerates.
//!
//! Missing, the plain fit takes a mean motor and leaves a residual with two time scales after the
//! voltage returns, first of one sign, then of the other, in Q more than in P; its parameters run to
//! their bounds. Below 20 % depth there is little to see.
//!
//! The same equations as the base motor's, on the base of the second group's own initial power:
//!
//! ```text
//! dw/dt = -alpha_2 w + alpha_2 u + j s w                                     (1)
//! ds/dt = -nu_2 (Im(w conj u) + kappa_2 / 2)                                 (2)
//! dP = K_2 (p_2 - 1),  dQ = K_2 (q_2 - q_20 )   without |u|^2/x_2            (3)
//! ```
//!
//! The share `K_2` is taken from the constant-power part of the static load; a constant-impedance load
//! absorbs `|u|^2/x_2` exactly.
//!
//! Source: reference paper (9), (10), (12) once more. Groups A (H = .1 s), B (.5 s) and C (.1 s) of
//! the WECC composite load model are three such motors, of fifth order (values not verified).

use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Instant, Motor, MotorDescription, MotorState, Rest, Step},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, State},
    },
    numerics::Elementary,
};

/// A second group of motors.
#[derive(Clone, Copy, Debug)]
pub(super) struct SecondMotor;

const DECLARATION: Declaration = Declaration {
    name: "second_motor",
    title: "Second group of motors",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::one_sided(["share", "K_2", "1"], [0.2, 0.7, 0.03]),
        Parameter::positive_shape(["alpha_per_s", "alpha_2", "1/s"], [1.0, 30.0, 300.0], 1.0),
        Parameter::positive_shape(["nu_per_s2", "nu_2", "1/s^2"], [5.0, 2500.0, 40_000.0], 1.3),
        Parameter::shape(["kappa", "kappa_2", "1"], [0.05, 0.35, 0.95], 0.15),
    ],
    states: &[
        State {
            name: "flux_real",
            unit: "1",
        },
        State {
            name: "flux_imaginary",
            unit: "1",
        },
        State {
            name: "speed",
            unit: "rad/s",
        },
    ],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &["double_cage_rotor", "feeder_impedance", "time_skew"],
    needs: Needs {
        voltage_below: Some(0.8),
        rate_fps: 50.0,
        separating_event: "dips below 60 % of the voltage, at 50 frames/s or more",
        ..Needs::A_DIP
    },
    source: "reference paper (9), (10), (12); WECC composite load model, motors A to C (values not \
             verified)",
};

impl Declared for SecondMotor {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn nuisance_grid(&self, motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        // Slower and faster than the motor found, lighter and heavier, each with two loadings.
        const FACTORS: [[f64; 2]; 4] = [[2.0, 5.0], [1.0, 2.5], [1.0, 0.35], [0.5, 0.17]];
        const LOADINGS: [f64; 2] = [0.7, 1.3];
        let mut points = Vec::new();
        for [alpha, nu] in FACTORS {
            for loading in LOADINGS {
                points.push(vec![
                    (motor.alpha_per_s * alpha).clamp(2.0, 200.0),
                    (motor.nu_per_s2 * nu).clamp(20.0, 30_000.0),
                    (motor.kappa * loading).clamp(0.1, 0.9),
                ]);
            }
        }
        points
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0]
    }
}

fn state<S: Elementary>(x: &[S]) -> MotorState<S> {
    MotorState {
        flux: [x[0], x[1]],
        second: [S::constant(0.0); 2],
        speed_rad_s: x[2],
    }
}

impl<S: Elementary> Equations<S> for SecondMotor {
    fn own_motor(&self, p: &[S], rest: &Rest<S>) -> Result<Option<Motor<S>>, Infeasible> {
        let coordinates = MotorCoordinates {
            alpha_per_s: p[1],
            nu_per_s2: p[2],
            kappa: p[3],
        };
        let synchronous = rest.synchronous_speed_rad_s;
        Motor::new(&MotorDescription::new(coordinates, synchronous)).map(Some)
    }

    fn initialise(&self, _p: &[S], rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        if let Some(motor) = &rest.own_motor {
            let state = motor.rest;
            x.copy_from_slice(&[state.flux[0], state.flux[1], state.speed_rad_s]);
        }
        Ok(())
    }

    fn rate_per_s(&self, _p: &[S], x: &[S], rest: &Rest<S>) -> f64 {
        let motor = rest.own_motor.as_ref();
        motor.map_or(0.0, |motor| motor.rate_per_s(&state(x)))
    }

    fn advance(&self, _p: &[S], x: &mut [S], step: &Step<S>, rest: &Rest<S>) {
        if let Some(motor) = &rest.own_motor {
            let next = motor.step(&state(x), step.phasor, step.duration_s); // (1), (2)
            x.copy_from_slice(&[next.flux[0], next.flux[1], next.speed_rad_s]);
        }
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, rest: &Rest<S>) -> [S; 2] {
        let Some(motor) = &rest.own_motor else {
            return [S::constant(0.0); 2];
        };
        let [active, reactive] = motor.power(&state(x), at.phasor);
        let [rest_active, rest_reactive] = motor.rest_power;
        [
            p[0] * (active * at.motor_active_factor - rest_active),
            p[0] * (reactive - rest_reactive),
        ] // (3)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::a_dip};

    #[test]
    fn the_same_motor_again_is_a_larger_share_of_the_first() {
        let plain = ComposedModel::new(&Structure::zip_im());
        let names = ["zip", "induction_motor", "second_motor"];
        let both = ComposedModel::new(&Structure::parse(&names).unwrap());
        let input = a_dip(0.6, -0.1);
        let drive = Drive {
            terminal: &input,
            frequency_deviation: &[],
            reactive_at_rest: 0.3,
        };
        let mut p = plain.typical();
        let mut twice = p.clone();
        twice.extend([0.15, p[0].exp(), p[1].exp(), p[2]]);
        p[3] += 0.15;
        let one = plain.simulate(&p, &[], &drive).unwrap();
        let two = both.simulate(&twice, &[], &drive).unwrap();
        for k in 0..one.active.len() {
            assert!((one.active[k] - two.active[k]).abs() < 1e-9);
            assert!((one.reactive[k] - two.reactive[k]).abs() < 1e-9);
        }
    }
}
