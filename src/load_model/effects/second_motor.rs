//! A second group of motors with a time scale of its own.
//!
//! Large fans with 0.5 s of inertia and small pumps with 0.1 s at one substation are not one motor:
//! one of them has recovered while the other still accelerates.
//!
//! Missing, the plain fit takes a mean motor and leaves a residual with two time scales after the
//! voltage returns, first of one sign, then of the other, in P and in Q; its parameters run to
//! their bounds. Below 20 % depth there is little to see.
//!
//! The same equations as the base motor's, (1) to (4) of `base_motor` with a stator resistance, on
//! the base of the second group's own initial power, written in figures that an engineer knows for
//! motors of every size: slip `s_2`, stored energy over initial power `H_2`, `kappa_2` (the initial power
//! over the pull-out power at V0, without `r_2`), `r_2`.
//!
//! ```text
//! alpha_2 = w_0 s_2 (1 + sqrt(1 - kappa_2^2)) / kappa_2                       (1)
//! nu_2    = w_0 / (kappa_2 H_2)                                             (2)
//! dP = K_2 (p_2 - 1),  dQ = K_2 (q_2 - q_20)   without |u|^2/x_2            (3)
//! ```
//!
//! (1) is the steady state (12) of the reference paper solved for alpha, (2) the definition of nu. The share
//! `K_2` is taken from the constant-power part of the static load; a constant-impedance load absorbs
//! `|u|^2/x_2`, exactly where `r_2` is zero.
//!
//! The reactance `x_2` is not fitted: 2.2 on the base of the group's own initial power, a stator and magnetising reactance of about 3 on
//! the rating. It matters through `r_2` alone. What changes the motors of the base model (`stator_resistance`, `saturation`,
//! `double_cage_rotor`, `speed_dependent_torque`, `motor_undervoltage_trip`) does not change these; `frequency_scaled_power` does.
//!
//! Source: reference paper (9), (10), (12) once more. Ranges: rated slips of 0.5 to 5 %, H of .1 s (pumps) to
//! some s (large fans) on the rating, at 60 to 90 % loading; groups A (H = .1 s), B (.5 s) and C (.1 s) of the
//! WECC composite load model are three such motors, of fifth order (all from memory, not verified).

use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Instant, Motor, MotorDescription, MotorState, Rest, Step},
        effect::{
            Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Reference, State,
        },
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
    version: 2,
    parameters: &[
        Parameter::one_sided(["share", "K_2", "1"], [0.2, 0.7, 0.03]),
        Parameter::positive_shape(["slip", "s_2", "1"], [0.002, 0.013, 0.06], 0.6)
            .with_reference(Reference::GroupImpedance),
        Parameter::positive_shape(["inertia_s", "H_2", "s"], [0.08, 0.7, 6.0], 0.8),
        Parameter::shape(["kappa", "kappa_2", "1"], [0.15, 0.35, 0.7], 0.07)
            .with_reference(Reference::GroupImpedance),
        Parameter::positive_shape(["resistance", "r_2", "1"], [0.001, 0.01, 0.06], 0.7)
            .with_reference(Reference::GroupImpedance),
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
        const FACTORS: [[f64; 2]; 4] = [[2.0, 0.25], [1.0, 0.4], [1.0, 2.5], [0.5, 4.0]];
        const LOADINGS: [f64; 2] = [0.8, 1.25];
        // Between 50 and 60 Hz; these are starts.
        const SYNCHRONOUS_SPEED_RAD_S: f64 = 345.0;
        let slip = motor.alpha_per_s * motor.kappa / (2.0 * SYNCHRONOUS_SPEED_RAD_S);
        let inertia_s = SYNCHRONOUS_SPEED_RAD_S / (motor.kappa * motor.nu_per_s2);
        let mut points = Vec::new();
        for [slower, heavier] in FACTORS {
            for loading in LOADINGS {
                points.push(vec![
                    (slip * slower).clamp(0.004, 0.04),
                    (inertia_s * heavier).clamp(0.1, 4.0),
                    (motor.kappa * loading).clamp(0.2, 0.6),
                    0.01,
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
        let speed = rest.synchronous_speed_rad_s;
        let [slip, inertia_s, kappa, resistance] = [p[1], p[2], p[3], p[4]];
        let cosine = (-(kappa * kappa) + 1.0).sqrt();
        let coordinates = MotorCoordinates {
            alpha_per_s: slip * speed * (cosine + 1.0) / kappa, // (1)
            nu_per_s2: S::constant(speed) / (kappa * inertia_s), // (2)
            kappa,
        };
        let mut description = MotorDescription::new(coordinates, speed);
        description.stator_resistance = Some(resistance);
        description.refer_to(rest.load_voltage_square);
        Motor::new(&description).map(Some)
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
            let next = motor.step(&state(x), step.motor_phasor, step.duration_s);
            x.copy_from_slice(&[next.flux[0], next.flux[1], next.speed_rad_s]);
        }
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, rest: &Rest<S>) -> [S; 2] {
        let Some(motor) = &rest.own_motor else {
            return [S::constant(0.0); 2];
        };
        let [active, reactive] = motor.power(&state(x), at.motor_phasor);
        let [rest_active, rest_reactive] = motor.rest_power;
        [
            p[0] * (active * at.motor_factor - rest_active),
            p[0] * (reactive * at.motor_factor - rest_reactive),
        ] // (3)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::a_dip};

    #[test]
    fn the_same_motor_again_is_a_larger_share_of_the_first() {
        let structure = Structure::zip_im().with("stator_resistance").unwrap();
        let one = ComposedModel::new(&structure);
        let both = ComposedModel::new(&structure.with("second_motor").unwrap());
        let input = a_dip(0.6, -0.1);
        let drive = Drive::new(&input, &[], 0.3);
        let mut p = one.typical();
        let resistance = one.index("stator_resistance.resistance").unwrap();
        p[resistance] = 0.012;
        // The lag of the static load comes last.
        let mut twice = p[..one.static_lag()].to_vec();
        let [alpha, nu, kappa] = [p[0].exp(), p[1].exp(), p[2]];
        // (1) and (2) the other way round.
        let speed = input.synchronous_speed_rad_s;
        let slip = alpha * kappa / (speed * (1.0 + (1.0 - kappa * kappa).sqrt()));
        twice.extend([0.15, slip, speed / (kappa * nu), kappa, 0.012, 0.0]);
        p[3] += 0.15;
        let one = one.simulate(&p, &[], &drive).unwrap();
        let two = both.simulate(&twice, &[], &drive).unwrap();
        for k in 0..one.active.len() {
            assert!((one.active[k] - two.active[k]).abs() < 1e-9);
            assert!((one.reactive[k] - two.reactive[k]).abs() < 1e-9);
        }
    }
}
