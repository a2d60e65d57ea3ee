//! Contactors that drop out in the dip and close again after it.
//!
//! The coil of a contactor lets go a cycle after the voltage has fallen below about half, and closes again
//! at a somewhat higher one, at once or after the delay of a restart circuit.
//!
//! Missing, it leaves a notch in P and Q that begins in deep dips and ends some tenths of a second after the
//! voltage's return.
//!
//! With `off(v)` falling straight from 1 at `V_off` to 0 at `V_off - s`, `on(v)` the same curve `h` higher, `o(t)` rising
//! from 0 to 1 once `v < V_off` has lasted `T_o`, `r(t)` likewise once the last contactor's closing voltage has been there for
//! `T_c`, `k` the closed share:
//!
//! ```text
//! k  = k held within r on(v) <= k <= 1 - o (1 - off(v))                     (1)
//! dP = -F (1 - k) v^n,   dQ = -t F (1 - k) v^n                              (2)
//! ```
//!
//! `n` is 2 for heaters and 0 for what draws its power at any voltage. Motors that coast meanwhile and draw
//! an inrush when they return are `motor_undervoltage_trip`.
//!
//! Source: contactors of motor D in the WECC composite load model, Vc1off .5, Vc2off .4, Vc1on .6, Vc2on .5 (from
//! memory, not verified), which has `T_o = T_c = 0`; the delays are those of real contactors.

use super::relay;
use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{
            Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Reference, State,
        },
    },
    numerics::{
        Elementary,
        elementary::{at_least, at_most, larger, power, smaller},
    },
};

/// Contactors that drop out.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactorDropout;

const fn state(name: &'static str, unit: &'static str) -> State {
    State { name, unit }
}

const DECLARATION: Declaration = Declaration {
    name: "contactor_dropout",
    title: "Contactors that drop out in the dip",
    kind: Kind::Physics,
    version: 3,
    parameters: &[
        Parameter::one_sided(["share", "F", "1"], [0.2, 0.8, 0.02]),
        Parameter::shape(["first_voltage", "V_off", "pu"], [0.35, 0.55, 0.8], 0.08)
            .with_reference(Reference::Voltage),
        Parameter::shape(["span", "s", "pu"], [0.02, 0.1, 0.3], 0.05)
            .with_reference(Reference::Voltage),
        Parameter::shape(["hysteresis", "h", "pu"], [0.0, 0.08, 0.3], 0.05)
            .with_reference(Reference::Voltage),
        Parameter::positive_shape(["opening_s", "T_o", "s"], [0.0005, 0.01, 0.1], 0.8),
        Parameter::positive_shape(["closing_s", "T_c", "s"], [0.001, 0.05, 2.0], 1.5),
        Parameter::shape(["exponent", "n", "1"], [0.0, 1.0, 2.0], 0.7),
        Parameter::shape(["reactive_ratio", "t", "1"], [-0.2, 0.4, 1.2], 0.3),
    ],
    states: &[
        state("closed", "1"),
        state("opening_timer", "s"),
        state("closing_timer", "s"),
    ],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &[
        "motor_undervoltage_trip",
        "electronic_load_dropout",
        "discharge_lighting",
    ],
    needs: Needs {
        voltage_below: Some(0.6),
        separating_event: "dips on both sides of half the voltage",
        ..Needs::A_DIP
    },
    source: "WECC composite load model, motor D contactors (from memory, not verified)",
};

impl Declared for ContactorDropout {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn threshold(&self) -> Option<&'static str> {
        Some("first_voltage")
    }

    fn span(&self) -> Option<&'static str> {
        Some("span")
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        let mut points = Vec::new();
        for [span, opening_s] in [[0.04, 0.005], [0.15, 0.005], [0.15, 0.02]] {
            for closing_s in [0.005, 0.025, 0.06, 0.15, 0.4] {
                points.push(vec![0.55, span, 0.08, opening_s, closing_s, 1.0, 0.4]);
            }
        }
        points
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0, 6, 7]
    }
}

/// The closed share with the timers as they are: (1).
fn held<S: Elementary>(closed: S, timers_s: [S; 2], voltage: S, p: &[S]) -> S {
    let curve = |first: S| at_least(at_most((voltage - first) / p[2] + 1.0, 1.0), 0.0);
    let opened = relay::switched(timers_s[0], p[4]) * (-curve(p[1]) + 1.0);
    let closing = relay::switched(timers_s[1], p[5]) * curve(p[1] + p[3]);
    larger(smaller(closed, -opened + 1.0), closing)
}

impl<S: Elementary> Equations<S> for ContactorDropout {
    fn initialise(&self, _p: &[S], _rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        x[0] = S::constant(1.0);
        Ok(())
    }

    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let [closed, opening, closing] = x else {
            return;
        };
        let low = step.voltage.map(|v| relay::below(v, p[1]));
        relay::run_timer(opening, low, step.duration_s);
        let last = p[1] - p[2] + p[3];
        let high = step.voltage.map(|v| -relay::below(v, last) + 1.0);
        relay::run_timer(closing, high, step.duration_s);
        *closed = held(*closed, [*opening, *closing], step.voltage[2], p);
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        const VOLTAGE_MIN: f64 = 0.05;
        let open = -held(x[0], [x[1], x[2]], at.voltage, p) + 1.0;
        let drawn = power(at_least(at.voltage, VOLTAGE_MIN), p[6]);
        let active = -(p[0] * open * drawn);
        [active, p[7] * active] // (2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    #[test]
    fn without_delays_the_closed_share_follows_the_lower_curve_down_and_the_upper_one_up() {
        let p = [0.3, 0.55, 0.1, 0.08, 0.001, 0.001, 0.0, 0.4];
        // Down to 0.5: off = (0.5 - 0.45)/0.1 = 0.5. Up to 0.56: on = (0.56 - 0.53)/0.1 = 0.3: held at 0.5.
        // Up to 0.6: on = 0.7. Up to 0.7: all closed.
        let mut closed = 1.0_f64;
        for (v, expected) in [(0.9, 1.0), (0.5, 0.5), (0.56, 0.5), (0.6, 0.7), (0.7, 1.0)] {
            closed = held(closed, [1.0, 1.0], v, &p);
            assert!((closed - expected).abs() < 1e-12, "{v}: {closed}");
        }
    }

    #[test]
    fn what_dropped_out_is_back_when_the_closing_time_has_passed() {
        let dip = |t: f64| [if (0.5..0.6).contains(&t) { 0.4 } else { 1.0 }, 0.0];
        let input = lasting(3.0, dip, &[0.5, 0.6]);
        let model = ComposedModel::new(&Structure::zip_im().with("contactor_dropout").unwrap());
        let mut p = model.typical();
        p[8..16].copy_from_slice(&[0.1, 0.55, 0.1, 0.08, 0.01, 0.3, 2.0, 0.5]);
        let drive = Drive::new(&input, &[], 0.3);
        let with = model.simulate(&p, &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        let lost = |k: usize| without.active[k] - with.active[k];
        // 60 samples/s: 0.58 s in the dip, 0.1 x 0.4^2; 0.8 s after it; 1 s closed again.
        assert!((lost(35) - 0.016).abs() < 1e-6, "{}", lost(35));
        assert!((lost(48) - 0.1).abs() < 1e-6, "{}", lost(48));
        assert!((without.reactive[48] - with.reactive[48] - 0.05).abs() < 1e-6);
        assert!(lost(60).abs() < 1e-12);
    }
}
