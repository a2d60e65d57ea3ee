//! The feeder between the measured bus and the load.
//!
//! Load is behind kilometres of line and a transformer. In a dip its own current, which rises in
//! the motors and falls elsewhere, moves its voltage.
//!
//! Missing, it leaves a residual that grows steeply with the depth of the dip; in shallow ones the
//! motor's transient reactance takes the feeder's into itself.
//!
//! In units of V0 and P0, where the impedance `Z` in per unit of the site's base has the value
//! `Z P0/V0^2`: the feeder stays the same when the load behind it is larger in another event:
//!
//! ```text
//! u_L = u - (R + j X) i                     (1)
//! ```
//!
//! solved with the whole load at every step by `composed::feeder`, at rest such that P0 and Q0 at the
//! measured bus hold; the motors' constants refer to the voltage at the load. A capacitor at the load is part of the load's `d_z`, exactly.
//! From event to event the reactive coefficients go with the Q/P of the load, not with that at the measured bus,
//! where a larger load shows more of the feeder.
//!
//! Source: circuit law; R = X = .04 on the feeder's rating in the WECC composite load model (value not
//! verified). One impedance for all the load: the mean of many.

use crate::{
    load_model::{
        composed::Feeder,
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Reference},
    },
    numerics::Elementary,
};

/// The feeder between the measured bus and the load.
#[derive(Clone, Copy, Debug)]
pub(super) struct FeederImpedance;

const DECLARATION: Declaration = Declaration {
    name: "feeder_impedance",
    title: "Feeder between the measured bus and the load",
    kind: Kind::Physics,
    version: 2,
    parameters: &[
        Parameter::one_sided(["resistance", "R", "pu"], [0.03, 0.3, 0.01])
            .with_reference(Reference::FixedImpedance),
        Parameter::one_sided(["reactance", "X", "pu"], [0.05, 0.5, 0.01])
            .with_reference(Reference::FixedImpedance),
    ],
    states: &[],
    acts_on: &[Place::Feeder],
    excludes: &[],
    resembles: &["stator_resistance", "second_motor"],
    needs: Needs {
        voltage_below: Some(0.7),
        separating_event: "dips of very different depth, one below 60 %",
        ..Needs::A_DIP
    },
    source: "circuit law; WECC composite load model Rfdr, Xfdr (values not verified)",
};

impl Declared for FeederImpedance {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for FeederImpedance {
    fn feeder(&self, p: &[S]) -> Feeder<S> {
        Feeder {
            resistance: p[0],
            reactance: p[1],
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    #[test]
    fn a_constant_impedance_behind_a_feeder_is_a_constant_impedance() {
        // Without a motor and with c_z = 1, d_z = Q0/P0 at the load, feeder and load are one
        // impedance: P and Q at the measured bus go with the square of the voltage.
        let step = |t: f64| [if t < 0.5 { 1.0 } else { 0.7 }, 0.0];
        let input = lasting(1.0, step, &[0.5]);
        let model = ComposedModel::new(&Structure::zip_im().with("feeder_impedance").unwrap());
        let mut p = model.typical();
        let q0 = 0.3;
        let [r, x] = [0.05, 0.12];
        // Load at rest: P_L0 = 1 - R |i0|^2, Q_L0 = q0 - X |i0|^2, |i0|^2 = 1 + q0^2 = 1.09; d_z in units of
        // P_L0, the rest of the bookkeeping being P_L0 p and Q_L0 + P_L0 (q - q0).
        let square = 1.0 + q0 * q0;
        let d_z = (q0 - x * square) / (1.0 - r * square);
        p[3..10].copy_from_slice(&[0.0, 1.0, 0.0, d_z, 0.0, r, x]);
        let drive = Drive::new(&input, &[], q0);
        let out = model.simulate(&p, &[], &drive).unwrap();
        let last = out.active.len() - 1;
        assert!((out.active[last] - 0.49).abs() < 1e-10);
        assert!((out.reactive[last] - 0.49 * q0).abs() < 1e-10);
    }
}
