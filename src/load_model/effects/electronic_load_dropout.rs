//! Electronic load that drops out with the voltage and returns in part.
//!
//! Power supplies draw constant power until their voltage is too low; then one after the other
//! switches off, and only some of them switch on again by themselves.
//!
//! Missing, it leaves a lasting loss of P after the deep events, growing with the depth between two
//! thresholds, with hardly any Q.
//!
//! With `cut(V)` 1 above `V_d1` and falling straight to 0 at `V_d2 = V_d1 - s`, `h` the share of the supplies whose
//! capacitors are empty (0 until `V < V_d1` has lasted `T_h`, 1 from `T_h + T_s` on, 0 again when the voltage is
//! back), `w_deepest` the largest `w` so far, and `F` the share of P0:
//!
//! ```text
//! w  = h (1 - cut(V))                                                                  (1)
//! c  = 1 - (1 - r) w_deepest - r w                                                     (2)
//! dP = F (c - 1),   dQ = t F (c - 1)                                                   (3)
//! ```
//!
//! With `T_h = T_s = 0` that is the published model, `c = cut(V_min) + r (cut(V) - cut(V_min))`.
//!
//! Source: equations as in Dynawo's `ElectronicLoad.mo` (verified; there `V_min` alone is filtered,
//! with 10 ms), which follows the WECC composite load model; Vd1 .7, Vd2 .5, frcel .8 from memory. The ratio `t` is
//! zero there; it is left open here for supplies without power factor correction.

use super::relay;
use crate::{
    load_model::{
        MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{
            Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Reference, State,
        },
    },
    numerics::{
        Elementary,
        elementary::{at_least, at_most, larger, smooth_step},
    },
};

/// Electronic load that drops out with the voltage.
#[derive(Clone, Copy, Debug)]
pub(super) struct ElectronicLoadDropout;

const DECLARATION: Declaration = Declaration {
    name: "electronic_load_dropout",
    title: "Electronic load that drops out with the voltage",
    kind: Kind::Physics,
    version: 3,
    parameters: &[
        Parameter::one_sided(["share", "F", "1"], [0.2, 0.7, 0.02]),
        Parameter::shape(["first_voltage", "V_d1", "pu"], [0.5, 0.8, 0.95], 0.1)
            .with_reference(Reference::Voltage)
            .with_resolution(relay::VOLTAGE_RESOLUTION_PU),
        Parameter::shape(["span", "s", "pu"], [0.02, 0.2, 0.4], 0.1)
            .with_reference(Reference::Voltage),
        Parameter::shape(["returning_share", "r", "1"], [0.0, 0.5, 1.0], 0.5),
        Parameter::shape(["reactive_ratio", "t", "1"], [-0.3, 0.0, 0.3], 0.1),
        Parameter::positive_shape(["hold_up_s", "T_h", "s"], [0.0005, 0.01, 0.2], 1.0),
        Parameter::positive_shape(["spread_s", "T_s", "s"], [0.002, 0.01, 0.1], 0.8),
    ],
    states: &[
        State {
            name: "timer",
            unit: "s",
        },
        State {
            name: "deepest_loss",
            unit: "1",
        },
    ],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &[
        "self_disconnection",
        "motor_undervoltage_trip",
        "discharge_lighting",
    ],
    needs: Needs {
        voltage_below: Some(0.9),
        separating_event: "at least two depths between and below the thresholds",
        ..Needs::A_DIP
    },
    source: "Dynawo ElectronicLoad.mo (equations verified); WECC composite load model (values not \
             verified)",
};

impl Declared for ElectronicLoadDropout {
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
        for (span, hold_up_s) in [(0.04, 0.002), (0.2, 0.002), (0.04, 0.03)] {
            for returning in [0.0, 0.5, 1.0] {
                points.push(vec![0.8, span, returning, 0.0, hold_up_s, 0.005]);
            }
        }
        points
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0, 3, 4]
    }
}

fn cut<S: Elementary>(voltage: S, p: &[S]) -> S {
    at_least(at_most((voltage - p[1]) / p[2] + 1.0, 1.0), 0.0)
}

/// (1)
fn lost<S: Elementary>(timer_s: S, voltage: S, p: &[S]) -> S {
    let empty = smooth_step((timer_s - p[5]) / p[6]);
    empty * (-cut(voltage, p) + 1.0)
}

impl<S: Elementary> Equations<S> for ElectronicLoadDropout {
    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let low = step.voltage.map(|v| relay::below(v, p[1]));
        let [timer, deepest] = x else { return };
        relay::run_timer(timer, low, step.duration_s);
        *deepest = larger(*deepest, lost(*timer, step.voltage[2], p));
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let now = lost(x[0], at.voltage, p);
        let deepest = larger(x[1], now);
        let away = (-p[3] + 1.0) * deepest + p[3] * now; // (2)
        let active = -(p[0] * away);
        [active, p[4] * active] // (3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_what_dropped_returns() {
        // Vd1 = 0.8, Vd2 = 0.6: at 0.65 the share (0.65 - 0.6)/0.2 = 0.25 is on; back at 1 with
        // r = 0.5 it is 0.25 + 0.5 x 0.75 = 0.625: 0.2 x 0.375 = 0.075 is lost.
        let p = [0.2, 0.8, 0.2, 0.5, 0.0, 0.01, 0.005];
        assert!((cut(0.65, &p) - 0.25).abs() < 1e-12);
        let deepest: f64 = lost(0.02, 0.65, &p);
        let away = (1.0 - p[3]) * deepest + p[3] * lost(0.0, 1.0, &p);
        assert!((p[0] * away - 0.075).abs() < 1e-12);
        // Half of the supplies are empty at 10 ms and half of 5 ms.
        assert!((lost(0.0125, 0.5, &p) - 0.5).abs() < 1e-12);
    }
}
