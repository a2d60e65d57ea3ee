//! Customers' equipment that disconnects itself and does not come back within the window.
//!
//! Controls, uninterruptible supplies and process protection take load off after a dip of some depth
//! and length; it returns minutes or hours later.
//!
//! Missing, it leaves a constant loss of P after the events beyond the threshold, with the power
//! factor of what was lost, near 1; one block of it cannot be told from an electronic load that does
//! not return.
//!
//! ```text
//! g  = latch(V < V_th for T)                (1)
//! dP = -F g,   dQ = -t F g                  (2)
//! ```
//!
//! Source: no published model; the equation is a definite-time relay with memory. Not included: a
//! count of successive dips, return.

use super::relay;
use crate::{
    load_model::{
        MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, State},
    },
    numerics::Elementary,
};

/// Equipment that disconnects itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct SelfDisconnection;

const DECLARATION: Declaration = Declaration {
    name: "self_disconnection",
    title: "Load that disconnects itself and stays off",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::one_sided(["share", "F", "1"], [0.1, 0.6, 0.02]),
        Parameter::shape(["voltage", "V_th", "1"], [0.4, 0.7, 0.94], 0.12),
        Parameter::shape(["time_s", "T", "s"], [0.0, 0.04, 0.5], 0.05),
        Parameter::shape(["reactive_ratio", "t", "1"], [-0.3, 0.0, 0.5], 0.15),
    ],
    states: &[
        State {
            name: "timer",
            unit: "s",
        },
        State {
            name: "disconnected",
            unit: "1",
        },
    ],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &["electronic_load_dropout", "motor_undervoltage_trip"],
    needs: Needs {
        voltage_below: Some(0.9),
        separating_event: "events on both sides of the threshold, and several depths below it",
        ..Needs::A_DIP
    },
    source: "definite-time relay with memory; no published load model (share .02-.2 not verified)",
};

impl Declared for SelfDisconnection {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        let mut points = Vec::new();
        for voltage in [0.52, 0.58, 0.64, 0.7, 0.76, 0.82, 0.88] {
            for time_s in [0.01, 0.06] {
                points.push(vec![voltage, time_s, 0.0]);
            }
        }
        points
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0]
    }
}

impl<S: Elementary> Equations<S> for SelfDisconnection {
    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let low = step.voltage.map(|v| relay::below(v, p[1]));
        if let [timer, latched] = x {
            relay::latch([timer, latched], low, p[2], step.duration_s); // (1)
        }
    }

    fn power(&self, p: &[S], x: &[S], _at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let lost = -(p[0] * x[1]);
        [lost, p[3] * lost] // (2)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::a_dip};

    #[test]
    fn the_share_is_gone_after_a_deep_dip_only() {
        let model = ComposedModel::new(&Structure::zip_im().with("self_disconnection").unwrap());
        for (depth, lost) in [(0.6, 0.1), (0.8, 0.0)] {
            let input = a_dip(depth, 0.0);
            let drive = Drive {
                terminal: &input,
                frequency_deviation: &[],
                reactive_at_rest: 0.3,
            };
            let with = model.simulate(&model.typical(), &[], &drive).unwrap();
            let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
            let last = with.active.len() - 1;
            assert!((without.active[last] - with.active[last] - lost).abs() < 1e-12);
            assert!((without.reactive[last] - with.reactive[last]).abs() < 1e-12);
        }
    }
}
