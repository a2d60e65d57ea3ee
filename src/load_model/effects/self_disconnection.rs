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
//! g  = open(V < V_th for T at the N-th dip, T_o, T_s)       (1)
//! dP = -F v^n g,   dQ = t dP                                (2)
//! ```
//!
//! What is gone drew its power as `v^n` before: in the dip less is lost than after it. Without that a fit opens
//! the relay too early, by 5 ms for every unit of `n`, to make up for what it loses too much of in the dip.
//!
//! `open` picks up when the voltage has been low for `T`; then the contacts part after `T_o`, all of them
//! within `T_s`, also when the voltage is back by then.
//!
//! Uninterruptible supplies of data centres count: at the second or third dip within a minute, as unsuccessful reclosures
//! make them, they keep their load to themselves (on 10 July 2024 about 1500 MW left in Virginia, after six faults within
//! 82 s). `N` counts the dips of an event that last for `T`; a search tries it where an event has several. A dip that came before
//! the window is not known of.
//!
//! Source: no published model; the equation is a definite-time relay with memory. Data centres: NERC, incident review
//! on simultaneous reductions of voltage-sensitive load, January 2025 (figures as reported; at which dip is from memory, not
//! verified). Not included: return, a load that leaves for the length of every dip before it stays away.

use super::relay::{self, SwitchTimes};
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
        elementary::{at_least, power},
    },
};

/// Equipment that disconnects itself.
#[derive(Clone, Copy, Debug)]
pub(super) struct SelfDisconnection;

const DECLARATION: Declaration = Declaration {
    name: "self_disconnection",
    title: "Load that disconnects itself and stays off",
    kind: Kind::Physics,
    version: 5,
    parameters: &[
        Parameter::one_sided(["share", "F", "1"], [0.1, 0.6, 0.02]),
        Parameter::shape(["voltage", "V_th", "pu"], [0.4, 0.7, 0.94], 0.12)
            .with_reference(Reference::Voltage)
            .with_resolution(relay::VOLTAGE_RESOLUTION_PU),
        Parameter::positive_shape(["time_s", "T", "s"], [0.003, 0.02, 0.5], 0.8)
            .with_resolution(relay::TIME_RESOLUTION_S),
        Parameter::positive_shape(["opening_s", "T_o", "s"], [0.001, 0.02, 0.3], 1.0),
        Parameter::positive_shape(["opening_spread_s", "T_s", "s"], [0.004, 0.02, 0.15], 0.8),
        Parameter::shape(["reactive_ratio", "t", "1"], [-0.3, 0.0, 0.5], 0.15),
        Parameter::shape(["voltage_exponent", "n", "1"], [0.0, 1.0, 3.0], 0.6),
        Parameter::count(["dips", "N", "1"], [1.0, 3.0]),
    ],
    states: &[
        State {
            name: "timer",
            unit: "s",
        },
        State {
            name: "picked_up",
            unit: "1",
        },
        State {
            name: "since_pick_up",
            unit: "s",
        },
        State {
            name: "disconnected",
            unit: "1",
        },
        State {
            name: "counted_once",
            unit: "1",
        },
        State {
            name: "counted_twice",
            unit: "1",
        },
    ],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &["electronic_load_dropout", "motor_undervoltage_trip"],
    needs: Needs {
        voltage_below: Some(0.9),
        separating_event: "events on both sides of the threshold, and several depths below it; whether dips are counted shows in faults that are repeated",
        ..Needs::A_DIP
    },
    source: "definite-time relay with memory; no published load model (share .02-.2 not verified)",
};

impl Declared for SelfDisconnection {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn threshold(&self) -> Option<&'static str> {
        Some("voltage")
    }

    fn pick_up(&self) -> Option<&'static str> {
        Some("time_s")
    }

    fn parting(&self) -> Option<[&'static str; 2]> {
        Some(["opening_s", "opening_spread_s"])
    }

    fn counts_dips(&self) -> Option<&'static str> {
        Some("dips")
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        [0.003, 0.02, 0.06]
            .map(|opening_s| vec![0.7, 0.02, opening_s, 0.02, 0.0, 1.0, 1.0])
            .to_vec()
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0, 5, 6]
    }
}

impl<S: Elementary> Equations<S> for SelfDisconnection {
    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let low = step.voltage.map(|v| relay::below(v, p[1]));
        if let [timer, picked_up, since, disconnected, once, twice] = x {
            let times = SwitchTimes {
                pick_up_s: p[2],
                opening_s: p[3],
                spread_s: p[4],
            };
            let state = [timer, picked_up, since, disconnected];
            let counted = [once, twice];
            relay::open_at_dip(p[7].value(), state, counted, low, times, step.duration_s); // (1)
        }
    }

    fn power(&self, p: &[S], x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        // Without a voltage nothing is drawn; the power law has no slope there.
        const VOLTAGE_MIN: f64 = 0.01;
        let drawn = p[0] * power(at_least(at.voltage, VOLTAGE_MIN), p[6]);
        let lost = -(drawn * x[3]);
        [lost, p[5] * lost] // (2)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    /// P and Q lost in a dip of 0.3 s, at its end and a second after it.
    fn lost(depth: f64) -> [[f64; 2]; 2] {
        let model = ComposedModel::new(&Structure::zip_im().with("self_disconnection").unwrap());
        let dip = |t: f64| [if (0.5..0.8).contains(&t) { depth } else { 1.0 }, 0.0];
        let input = lasting(2.0, dip, &[0.5, 0.8]);
        let drive = Drive::new(&input, &[], 0.3);
        let with = model.simulate(&model.typical(), &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        [45, 108].map(|k| {
            [
                without.active[k] - with.active[k],
                without.reactive[k] - with.reactive[k],
            ]
        })
    }

    #[test]
    fn the_share_is_gone_after_a_deep_dip_only() {
        for (depth, expected) in [(0.6, 0.1), (0.8, 0.0)] {
            let [_, [active, reactive]] = lost(depth);
            assert!((active - expected).abs() < 1e-12, "{active}");
            assert!(reactive.abs() < 1e-12, "{reactive}");
        }
    }

    #[test]
    fn load_that_counts_leaves_at_its_dip_and_not_before() {
        let model = ComposedModel::new(&Structure::zip_im().with("self_disconnection").unwrap());
        let low = |t: f64| {
            [0.5..0.7, 1.0..1.2, 1.5..1.7]
                .iter()
                .any(|dip| dip.contains(&t))
        };
        let dips = |t: f64| [if low(t) { 0.6 } else { 1.0 }, 0.0];
        let input = lasting(2.0, dips, &[0.5, 0.7, 1.0, 1.2, 1.5, 1.7]);
        let drive = Drive::new(&input, &[], 0.3);
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        let count = model.index("self_disconnection.dips").unwrap();
        for (dips, gone) in [
            (1.0, [0.1, 0.1, 0.1]),
            (2.0, [0.0, 0.1, 0.1]),
            (3.0, [0.0, 0.0, 0.1]),
        ] {
            let mut at = model.typical();
            at[count] = dips;
            let with = model.simulate(&at, &[], &drive).unwrap();
            for (sample, gone) in [54, 84, 114].into_iter().zip(gone) {
                let lost = without.active[sample] - with.active[sample];
                assert!((lost - gone).abs() < 1e-12, "{dips} {sample}: {lost}");
            }
        }
    }

    #[test]
    fn in_the_dip_less_is_lost_than_after_it() {
        // A load of constant current: 0.1 x 0.6.
        let [[active, _], _] = lost(0.6);
        assert!((active - 0.06).abs() < 1e-12, "{active}");
    }
}
