//! Discharge lighting that goes out and restrikes later.
//!
//! Sodium and mercury lamps go out when the voltage falls below about 70 to 80 % and cannot restrike
//! until they have cooled; fluorescent lamps go out and light again within a second or two.
//!
//! Missing, it leaves a loss of P and Q after deep dips that comes back in one piece after 1 to 2 s (or
//! minutes), and a Q that falls much faster than the square of the voltage before that.
//!
//! With `g(v)` 1 above `V_a` and falling straight to 0 at `V_a - s`, `m` the lit share:
//!
//! ```text
//! m  = lowest g so far, back to 1 over T_l from when v > V_a has lasted T          (1)
//! dP = F (l v^a - 1),   dQ = t F (l v^b - 1),   l = min(g, m)                      (2)
//! ```
//!
//! The -1 in (2) takes the lamps' share, of P and of Q, out of the constant-power part of the static load: what else the static load is
//! stays. With a restrike time beyond the window they stay dark.
//!
//! Source: P ~ v, Q ~ v^4.5, going out between .75-.8 and .65-.7: the discharge lighting of PSS/E's CLOD
//! (from memory, not verified); that kinds of lamps differ a little from these exponents, and restrike (1), chosen here.

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
        elementary::{at_least, at_most, power, smaller, smooth_step},
    },
};

/// Discharge lighting.
#[derive(Clone, Copy, Debug)]
pub(super) struct DischargeLighting;

const DECLARATION: Declaration = Declaration {
    name: "discharge_lighting",
    title: "Discharge lighting that goes out",
    kind: Kind::Physics,
    version: 3,
    parameters: &[
        Parameter::one_sided(["share", "F", "1"], [0.1, 0.6, 0.03]),
        Parameter::shape(["first_voltage", "V_a", "pu"], [0.55, 0.8, 0.95], 0.06)
            .with_reference(Reference::Voltage),
        Parameter::shape(["span", "s", "pu"], [0.02, 0.12, 0.3], 0.06)
            .with_reference(Reference::Voltage),
        Parameter::positive_shape(["restrike_s", "T", "s"], [0.4, 100.0, 1000.0], 3.0),
        Parameter::shape(["reactive_ratio", "t", "1"], [0.0, 0.5, 1.2], 0.2),
        Parameter::positive_shape(["lighting_s", "T_l", "s"], [0.04, 0.2, 3.0], 0.7),
        Parameter::shape(["active_exponent", "a", "1"], [0.7, 1.0, 1.3], 0.1),
        Parameter::shape(["reactive_exponent", "b", "1"], [3.5, 4.5, 5.5], 0.4),
    ],
    states: &[
        State {
            name: "lit",
            unit: "1",
        },
        State {
            name: "since_return_of_voltage",
            unit: "s",
        },
    ],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &["electronic_load_dropout", "contactor_dropout"],
    needs: Needs {
        voltage_below: Some(0.85),
        window_s: 4.0,
        separating_event: "Q between 85 and 95 % of the voltage, and dips below 75 %",
        ..Needs::A_DIP
    },
    source: "PSS/E CLOD discharge lighting (from memory, not verified)",
};

impl Declared for DischargeLighting {
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
        for span in [0.05, 0.14] {
            for restrike_s in [0.5, 1.5, 100.0] {
                points.push(vec![0.8, span, restrike_s, 0.5, 0.2, 1.0, 4.5]);
            }
        }
        points
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0, 4, 6, 7]
    }
}

fn burning<S: Elementary>(voltage: S, p: &[S]) -> S {
    at_least(at_most((voltage - p[1]) / p[2] + 1.0, 1.0), 0.0)
}

/// Share of the extinguished lamps that burn again.
fn restruck<S: Elementary>(since_s: S, p: &[S]) -> S {
    smooth_step((since_s - p[3]) / p[5])
}

impl<S: Elementary> Equations<S> for DischargeLighting {
    fn initialise(&self, _p: &[S], _rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        x[0] = S::constant(1.0);
        Ok(())
    }

    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let [lit, since] = x else { return };
        let burning = step.voltage.map(|v| burning(v, p));
        *lit = burning.into_iter().fold(*lit, smaller);
        if lit.value() >= 1.0 {
            return;
        }
        let high = step.voltage.map(|v| -relay::below(v, p[1]) + 1.0);
        relay::run_timer(since, high, step.duration_s);
        if restruck(*since, p).value() >= 1.0 {
            *lit = S::constant(1.0);
            *since = S::constant(0.0);
        }
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        const VOLTAGE_MIN: f64 = 0.05;
        let v = at_least(at.voltage, VOLTAGE_MIN);
        let memory = x[0] + (-x[0] + 1.0) * restruck(x[1], p);
        let lit = smaller(memory, burning(at.voltage, p));
        let [active, reactive] = [power(v, p[6]), power(v, p[7])];
        [
            p[0] * (lit * active + -1.0),
            p[4] * p[0] * (lit * reactive + -1.0),
        ] // (2)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    #[test]
    fn lamps_go_out_and_restrike() {
        let dip = |t: f64| [if (0.5..0.6).contains(&t) { 0.6 } else { 1.0 }, 0.0];
        let input = lasting(3.0, dip, &[0.5, 0.6]);
        let model = ComposedModel::new(&Structure::zip_im().with("discharge_lighting").unwrap());
        let mut p = model.typical();
        p[8..16].copy_from_slice(&[0.1, 0.8, 0.12, 1.0, 0.5, 0.2, 1.0, 4.5]);
        let drive = Drive::new(&input, &[], 0.3);
        let with = model.simulate(&p, &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        let lost = |k: usize| without.active[k] - with.active[k];
        assert!((lost(60) - 0.1).abs() < 1e-12);
        assert!((without.reactive[60] - with.reactive[60] - 0.05).abs() < 1e-12);
        assert!(lost(120).abs() < 1e-12);
    }
}
