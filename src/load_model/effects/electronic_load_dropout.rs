//! Electronic load that drops out with the voltage and returns in part.
//!
//! Power supplies draw constant power until their voltage is too low; then one after the other
//! switches off, and only some of them switch on again by themselves.
//!
//! Missing, it leaves a lasting loss of P after the deep events, growing with the depth between two
//! thresholds, with hardly any Q.
//!
//! With `cut(V)` 1 above `V_d1` and falling straight to 0 at `V_d2 = V_d1 - s`, `V_min` the lowest
//! voltage so far, and `F` the share of P0:
//!
//! ```text
//! c  = cut(V)                                        while V is the lowest so far      (1)
//! c  = cut(V_min) + r (cut(V) - cut(V_min))          afterwards                        (2)
//! dP = F (c - 1),   dQ = t F (c - 1)                                                   (3)
//! ```
//!
//! Source: equations as in Dynawo's `ElectronicLoad.mo` (verified; there `V_min` is filtered with 10 ms),
//! which follows the WECC composite load model; Vd1 .7, Vd2 .5, frcel .8 from memory. The ratio `t` is
//! zero there; it is left open here for supplies without power factor correction.

use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, State},
    },
    numerics::{
        Elementary,
        elementary::{at_least, at_most, smaller},
    },
};

/// Electronic load that drops out with the voltage.
#[derive(Clone, Copy, Debug)]
pub(super) struct ElectronicLoadDropout;

const DECLARATION: Declaration = Declaration {
    name: "electronic_load_dropout",
    title: "Electronic load that drops out with the voltage",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::one_sided(["share", "F", "1"], [0.2, 0.7, 0.02]),
        Parameter::shape(["first_voltage", "V_d1", "1"], [0.5, 0.8, 0.95], 0.1),
        Parameter::shape(["span", "s", "1"], [0.02, 0.2, 0.4], 0.1),
        Parameter::shape(["returning_share", "r", "1"], [0.0, 0.5, 1.0], 0.5),
        Parameter::shape(["reactive_ratio", "t", "1"], [-0.3, 0.0, 0.3], 0.1),
    ],
    states: &[State {
        name: "lowest_voltage",
        unit: "1",
    }],
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

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        let mut points = Vec::new();
        for [first, span] in [[0.9, 0.15], [0.82, 0.2], [0.72, 0.22], [0.6, 0.1]] {
            for returning in [0.0, 0.5, 1.0] {
                points.push(vec![first, span, returning, 0.0]);
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

impl<S: Elementary> Equations<S> for ElectronicLoadDropout {
    fn initialise(&self, _p: &[S], _rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        x[0] = S::constant(1.0);
        Ok(())
    }

    fn advance(&self, _p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        x[0] = step.voltage.into_iter().fold(x[0], smaller);
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let lowest = cut(smaller(x[0], at.voltage), p);
        let connected = lowest + p[3] * (cut(at.voltage, p) - lowest); // (1), (2)
        let active = p[0] * (connected + -1.0);
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
        let p = [0.2, 0.8, 0.2, 0.5, 0.0];
        assert!((cut(0.65, &p) - 0.25).abs() < 1e-12);
        let lowest: f64 = cut(0.65, &p);
        let after = lowest + p[3] * (cut(1.0, &p) - lowest);
        assert!((p[0] * (after - 1.0) + 0.075).abs() < 1e-12);
    }
}
