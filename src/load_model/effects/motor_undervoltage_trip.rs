//! Undervoltage trip of motors, with or without return.
//!
//! Contactors and undervoltage relays take a share of the motors off when the voltage stays below
//! their setting for a time; some close again when the voltage is back, others wait for a person.
//!
//! Missing, it leaves a step down in P and Q after clearing, with the motors' power factor, in the
//! deep events only; with return, a second inrush when the motors, which have slowed down and lost
//! their flux, are switched on again.
//!
//! A share `F` of the motors keeps states of its own. With `c` its connected share, 1 at rest, and
//! the equations (1) to (4) of `base_motor` in which the current is `c i` and the inertia `h` times
//! that of the others (what contactors switch is lighter or heavier than the average):
//!
//! ```text
//! c  = 1 - open(V < V_tr for T_tr, T_o, T_s) (1 - latch(V > V_rc for T_rc))         (1)
//! dP = K F (c p' - p),  dQ = K F (c q' - q + (1 - c) b v^2)                       (2)
//! ```
//!
//! with `p, q` of the motors that stay and `p', q'` of the share, magnetisation included, and `b` the
//! capacitors at the terminals of the motors, which leave with them: what they feed at 1 pu, over the initial active power `K F P0` of
//! the share. Where a load draws more Q of its P at one event than at another, either these motors do so as well, with fewer
//! capacitors each, or others do: in an event they are `b V0^2 + b_r r`, with `r` what Q0/P0 is there above that of the site, `b_r = -1` for
//! motors that have the power factor of the load, and 0 where nothing of them changes. `open` picks up when the voltage
//! has been low for `T_tr`; then the contacts part after `T_o`, all of them within `T_s`, also when the voltage
//! is back by then. A return time beyond the window means no return. Once all are on again and the voltage is above `V_tr`, the relays
//! are as they were at first: the next dip trips the motors again. Two groups with different settings
//! are not modelled. The share is one of the base model's motors; those of `second_motor` stay on.
//!
//! Source: settings Vtr, Ttr, Ftr, Vrc, Trc of motors A to C in the WECC composite load model and the
//! two blocks of Dynawo's `BaseLoadMotorFifthOrder.mo` (names verified there; values .50-.70, .02 s,
//! reconnection .65-.75 and .05-.1 s not verified). Coasting: (2) of `base_motor` with i = 0.

use super::relay::{self, SwitchTimes};
use crate::{
    load_model::MotorCoordinates,
    load_model::{
        Infeasible,
        composed::{Instant, MotorDescription, MotorState, Rest, Step},
        effect::{
            Declaration, Declared, Equations, Kind, MOTOR_REACTANCE, Needs, Parameter, Place,
            Reference, State,
        },
    },
    numerics::Elementary,
};

/// What is believed of `b_r` without data: between what motors with the power factor of the load have and none.
const CAPACITORS_BY_RATIO: f64 = -0.5;

/// Undervoltage trip of motors.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotorUndervoltageTrip;

const fn state(name: &'static str, unit: &'static str) -> State {
    State { name, unit }
}

const DECLARATION: Declaration = Declaration {
    name: "motor_undervoltage_trip",
    title: "Undervoltage trip of motors",
    kind: Kind::Physics,
    version: 5,
    parameters: &[
        Parameter::one_sided(["share", "F", "1"], [0.3, 1.0, 0.03]),
        Parameter::shape(["trip_voltage", "V_tr", "pu"], [0.4, 0.7, 0.94], 0.12)
            .with_reference(Reference::Voltage)
            .with_resolution(relay::VOLTAGE_RESOLUTION_PU),
        Parameter::positive_shape(["trip_time_s", "T_tr", "s"], [0.003, 0.02, 0.5], 0.8)
            .with_resolution(relay::MOTOR_TIME_RESOLUTION_S),
        Parameter::positive_shape(["opening_s", "T_o", "s"], [0.001, 0.03, 0.3], 1.0),
        Parameter::positive_shape(["opening_spread_s", "T_s", "s"], [0.004, 0.02, 0.15], 0.8),
        Parameter::shape(["capacitors", "b", "1"], [0.0, 0.3, 1.5], 0.4)
            .with_reference(Reference::GroupAdmittance),
        Parameter::shape(["return_voltage", "V_rc", "pu"], [0.5, 0.8, 0.95], 0.1)
            .with_reference(Reference::Voltage)
            .with_resolution(relay::VOLTAGE_RESOLUTION_PU),
        Parameter::positive_shape(["return_time_s", "T_rc", "s"], [0.02, 100.0, 1000.0], 3.0)
            .with_resolution(relay::TIME_RESOLUTION_S),
        Parameter::positive_shape(["inertia", "h", "1"], [0.25, 1.0, 4.0], 0.4),
        MOTOR_REACTANCE,
        Parameter::shape(
            ["capacitors_by_q0_over_p0", "b_r", "1"],
            [-1.5, 0.0, 0.5],
            0.5,
        )
        .with_centre(CAPACITORS_BY_RATIO),
    ],
    states: &[
        state("trip_timer", "s"),
        state("picked_up", "1"),
        state("since_pick_up", "s"),
        state("tripped", "1"),
        state("return_timer", "s"),
        state("returned", "1"),
        state("flux_real", "1"),
        state("flux_imaginary", "1"),
        state("second_flux_real", "1"),
        state("second_flux_imaginary", "1"),
        state("speed", "rad/s"),
    ],
    acts_on: &[Place::Motor, Place::States, Place::Power],
    excludes: &[],
    resembles: &[
        "self_disconnection",
        "electronic_load_dropout",
        "exponential_recovery",
    ],
    needs: Needs {
        voltage_below: Some(0.9),
        window_s: 5.0,
        separating_event: "events on both sides of the threshold, and the power factor of what was \
                           lost",
        ..Needs::A_DIP
    },
    source: "WECC composite load model (values not verified); Dynawo BaseLoadMotorFifthOrder.mo \
             (structure verified)",
};

impl Declared for MotorUndervoltageTrip {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn threshold(&self) -> Option<&'static str> {
        Some("trip_voltage")
    }

    fn pick_up(&self) -> Option<&'static str> {
        Some("trip_time_s")
    }

    fn parting(&self) -> Option<[&'static str; 2]> {
        Some(["opening_s", "opening_spread_s"])
    }

    fn by_reactive_ratio(&self) -> Option<&'static str> {
        Some("capacitors_by_q0_over_p0")
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        // Motors that come back draw an inrush: at a wrong moment it is worse than none.
        let returns_s = [
            0.06, 0.08, 0.1, 0.125, 0.15, 0.18, 0.22, 0.27, 0.33, 0.4, 0.48, 0.6, 0.8, 1.5, 300.0,
        ];
        let mut points = Vec::new();
        for (opening_s, returns_s) in [(0.01, &returns_s[..]), (0.05, &[0.4, 300.0])] {
            for return_time_s in returns_s {
                let [returns_pu, inertia] = [0.8, 1.0];
                let opens = [0.7, 0.02, opening_s, 0.02, 0.3];
                let closes = [returns_pu, *return_time_s, inertia, CAPACITORS_BY_RATIO];
                points.push(opens.into_iter().chain(closes).collect());
            }
        }
        points
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0]
    }
}

fn motor_state<S: Elementary>(x: &[S]) -> MotorState<S> {
    MotorState {
        flux: [x[6], x[7]],
        second: [x[8], x[9]],
        speed_rad_s: x[10],
    }
}

fn keep<S: Elementary>(x: &mut [S], motor: &MotorState<S>) {
    let [a, b] = motor.flux;
    let [c, d] = motor.second;
    x[6..].copy_from_slice(&[a, b, c, d, motor.speed_rad_s]);
}

/// (1)
fn connected<S: Elementary>(x: &[S]) -> S {
    let returned = -x[5] + 1.0;
    -(x[3] * returned) + 1.0
}

impl<S: Elementary> Equations<S> for MotorUndervoltageTrip {
    fn motor(&self, p: &[S], motor: &mut MotorDescription<S>) {
        motor.detailed = true;
        motor.reactance = p[9];
    }

    fn initialise(&self, _p: &[S], rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        keep(x, &rest.motor.rest);
        Ok(())
    }

    fn rate_per_s(&self, _p: &[S], x: &[S], rest: &Rest<S>) -> f64 {
        rest.motor.rate_per_s(&motor_state(x))
    }

    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, rest: &Rest<S>) {
        let before = connected(x);
        let low = step.voltage.map(|v| relay::below(v, p[1]));
        let high = step.voltage.map(|v| -relay::below(v, p[6]) + 1.0);
        if let [
            trip_timer,
            picked_up,
            since,
            tripped,
            return_timer,
            returned,
            ..,
        ] = x
        {
            let times = SwitchTimes {
                pick_up_s: p[2],
                opening_s: p[3],
                spread_s: p[4],
            };
            let relay = [
                &mut *trip_timer,
                &mut *picked_up,
                &mut *since,
                &mut *tripped,
            ];
            relay::open(relay, low, times, step.duration_s);
            if tripped.value() > 0.0 {
                relay::latch([return_timer, returned], high, p[7], step.duration_s);
            }
            if returned.value() >= 1.0 && tripped.value() >= 1.0 && low[2].value() <= 0.0 {
                // Everything is on again, and the next dip finds the relays as the first did.
                for state in [
                    trip_timer,
                    picked_up,
                    since,
                    tripped,
                    return_timer,
                    returned,
                ] {
                    *state = S::constant(0.0);
                }
            }
        }
        let share = (before + connected(x)) * 0.5;
        let state = motor_state(x);
        let next =
            rest.motor
                .connected_step(&state, step.motor_phasor, share, p[8], step.duration_s);
        keep(x, &next);
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, rest: &Rest<S>) -> [S; 2] {
        let share = connected(x);
        let [active, reactive] = rest.motor.power(&motor_state(x), at.motor_phasor);
        let [re, im] = at.motor_phasor;
        let magnetising = rest.motor.susceptance * (re * re + im * im);
        let capacitors = (-share + 1.0) * (p[5] + p[10]) * at.voltage * at.voltage;
        let group = rest.motor_share * p[0];
        [
            group * (share * (active * at.motor_factor) - at.motor[0]),
            group
                * (share * ((reactive + magnetising) * at.motor_factor) - at.motor[1] + capacitors),
        ] // (2)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{
        ComposedModel, Drive, Structure,
        composed::contract::{a_dip, lasting},
    };

    fn run(input: &crate::load_model::TerminalInput, change: &[(&str, f64)]) -> Vec<f64> {
        let structure = Structure::zip_im().with("motor_undervoltage_trip").unwrap();
        let model = ComposedModel::new(&structure);
        let mut p = model.typical();
        for (name, value) in change {
            p[model
                .index(&format!("motor_undervoltage_trip.{name}"))
                .unwrap()] = *value;
        }
        let drive = Drive::new(input, &[], 0.3);
        model.simulate(&p, &[], &drive).unwrap().active
    }

    #[test]
    fn what_tripped_for_good_is_missing_at_the_end() {
        // Motor share 0.4, of which 0.3 trip: 0.12 of P0 is missing when the rest has recovered.
        let without = run(&a_dip(0.6, 0.0), &[("share", 0.0)]);
        let with = run(
            &a_dip(0.6, 0.0),
            &[("share", 0.3), ("return_time_s", 300.0)],
        );
        let last = with.len() - 1;
        assert!((without[last] - with[last] - 0.12).abs() < 2e-3);
    }

    #[test]
    fn above_the_threshold_nothing_happens() {
        let without = run(&a_dip(0.8, 0.0), &[("share", 0.0)]);
        let with = run(&a_dip(0.8, 0.0), &[("share", 0.3)]);
        for (x, y) in without.iter().zip(&with) {
            assert!((x - y).abs() < 2e-5);
        }
    }

    #[test]
    fn motors_that_return_draw_an_inrush_and_settle_at_their_old_power() {
        // On a constant torque they must be back before they have slowed down below pull-out.
        let dip = |t: f64| {
            let v = if (0.5..0.7).contains(&t) { 0.5 } else { 1.0 };
            [v, 0.0]
        };
        let input = lasting(6.0, dip, &[0.5, 0.7]);
        let change = [("share", 0.5), ("return_time_s", 0.2)];
        let with = run(&input, &change);
        let last = with[with.len() - 1];
        assert!((last - 1.0).abs() < 1e-3, "{last}");
        // Off between 0.54 and 0.9 s: 0.2 of P0; then with a slip that needs power to undo.
        let without = run(&input, &[("share", 0.0)]);
        let extra = |k: usize| with[k] - without[k];
        let largest = (55..120).map(extra).fold(0.0, f64::max);
        assert!(largest > 0.05, "{largest}");
        assert!((extra(53) + 0.2).abs() < 0.03, "{}", extra(53));
    }
}
