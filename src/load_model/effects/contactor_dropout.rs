//! Contactors that drop out in the dip and close again after it.
//!
//! The coil of a contactor lets go below about half the voltage and closes again at a somewhat higher
//! one, without a delay of its own.
//!
//! Missing, it leaves a notch in P and Q during deep dips that is gone within some tenths of a second of
//! the voltage's return.
//!
//! With `off(v)` falling straight from 1 at `V_off` to 0 at `V_off - s`, `on(v)` the same curve `h` higher, `k`
//! the closed share:
//!
//! ```text
//! k  = k held within on(v) <= k <= off(v)                (1)
//! dP = -K F (1 - k) p,   dQ = -K F (1 - k) q             (2)
//! ```
//!
//! with `p, q` of the motors, magnetisation included: as in the source, the motors behind the contactors
//! keep the speed of the others. Motors that coast meanwhile are `motor_undervoltage_trip`.
//!
//! Source: contactors of motor D in the WECC composite load model, Vc1off .5, Vc2off .4, Vc1on .6, Vc2on .5 (from
//! memory, not verified).

use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, State},
    },
    numerics::{
        Elementary,
        elementary::{at_least, at_most, larger, smaller},
    },
};

/// Contactors that drop out.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactorDropout;

const DECLARATION: Declaration = Declaration {
    name: "contactor_dropout",
    title: "Contactors that drop out in the dip",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::one_sided(["share", "F", "1"], [0.3, 1.0, 0.03]),
        Parameter::shape(["first_voltage", "V_off", "1"], [0.35, 0.55, 0.8], 0.08),
        Parameter::shape(["span", "s", "1"], [0.02, 0.1, 0.3], 0.05),
        Parameter::shape(["hysteresis", "h", "1"], [0.0, 0.08, 0.15], 0.05),
    ],
    states: &[State {
        name: "closed",
        unit: "1",
    }],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &["motor_undervoltage_trip", "electronic_load_dropout"],
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

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        [0.04, 0.1].map(|span| vec![0.55, span, 0.08]).to_vec()
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0]
    }
}

fn held<S: Elementary>(closed: S, voltage: S, p: &[S]) -> S {
    let curve = |first: S| at_least(at_most((voltage - first) / p[2] + 1.0, 1.0), 0.0);
    let (off, on) = (curve(p[1]), curve(p[1] + p[3]));
    larger(smaller(closed, off), on) // (1)
}

impl<S: Elementary> Equations<S> for ContactorDropout {
    fn initialise(&self, _p: &[S], _rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        x[0] = S::constant(1.0);
        Ok(())
    }

    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        x[0] = step.voltage.into_iter().fold(x[0], |k, v| held(k, v, p));
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, rest: &Rest<S>) -> [S; 2] {
        let open = -held(x[0], at.voltage, p) + 1.0;
        let lost = -(rest.motor_share * p[0] * open);
        [lost * at.motor[0], lost * at.motor[1]] // (2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closed_share_follows_the_lower_curve_down_and_the_upper_one_up() {
        let p = [0.3, 0.55, 0.1, 0.08];
        // Down to 0.5: off = (0.5 - 0.45)/0.1 = 0.5. Up to 0.56: on = (0.56 - 0.53)/0.1 = 0.3: held at 0.5.
        // Up to 0.6: on = 0.7. Up to 0.7: all closed.
        let mut closed = 1.0_f64;
        for (v, expected) in [(0.9, 1.0), (0.5, 0.5), (0.56, 0.5), (0.6, 0.7), (0.7, 1.0)] {
            closed = held(closed, v, &p);
            assert!((closed - expected).abs() < 1e-12, "{v}: {closed}");
        }
    }
}
