//! Constant-power load that turns into an impedance at low voltage.
//!
//! No load draws constant power down to zero voltage. Study tools turn the constant-power part into a
//! constant impedance below a threshold, and recordings agree in kind.
//!
//! Missing, it leaves a residual in the deepest part of deep dips only, none above the threshold. With few depths the static part
//! takes most of it when it is refitted, and leaves the opposite sign just above the threshold.
//!
//! With `p` the threshold, `P_p`, `Q_p` the constant-power part of the static load and `w` the share of it
//! that is converted:
//!
//! ```text
//! k  = 1 - 2 ((v - p)/p)^2   for p/2 < v < p,    2 (v/p)^2 below,   1 above         (1)
//! dP = w P_p (k - 1),   dQ = w Q_p (k - 1)                                         (2)
//! ```
//!
//! `P_p = 1 - K - c_z - c_i` and likewise `Q_p`, over P0: what other effects take out of the constant-power part (`second_motor`,
//! `discharge_lighting`) still counts in it. The constant-current part is not converted, as in characteristic 1 below. What data tell is
//! `w P_p`: where `P_p` is near zero, `w` means nothing.
//!
//! Source: (1) with p = PQBRAK = .7 is characteristic 1 of PSS/E's loads as in `OpenIPSL`,
//! `PSSE/BaseClasses/baseLoad.mo` (verified). Below p/2 it is an impedance.

use crate::{
    load_model::{
        composed::{Instant, Rest},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Reference},
    },
    numerics::Elementary,
};

/// Constant-power load that turns into an impedance.
#[derive(Clone, Copy, Debug)]
pub(super) struct LowVoltageConversion;

const DECLARATION: Declaration = Declaration {
    name: "low_voltage_conversion",
    title: "Constant power that becomes an impedance at low voltage",
    kind: Kind::Physics,
    version: 2,
    parameters: &[
        Parameter::one_sided(["share", "w", "1"], [1.0, 1.5, 0.2]),
        Parameter::shape(["voltage", "p", "pu"], [0.4, 0.7, 0.9], 0.08)
            .with_reference(Reference::Voltage),
    ],
    states: &[],
    acts_on: &[Place::Power],
    excludes: &[],
    resembles: &["saturation", "electronic_load_dropout"],
    needs: Needs {
        voltage_below: Some(0.7),
        separating_event: "two or more depths below the threshold",
        ..Needs::A_DIP
    },
    source: "PSS/E load characteristic PQBRAK, OpenIPSL baseLoad.mo (equations and .7 verified)",
};

impl Declared for LowVoltageConversion {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn threshold(&self) -> Option<&'static str> {
        Some("voltage")
    }
}

/// `k - 1` of (1).
fn conversion<S: Elementary>(voltage: S, threshold: S) -> S {
    let x = voltage / threshold;
    if x.value() >= 1.0 {
        S::constant(0.0)
    } else if x.value() > 0.5 {
        let below = x + -1.0;
        below * below * -2.0
    } else {
        x * x * 2.0 + -1.0
    }
}

impl<S: Elementary> Equations<S> for LowVoltageConversion {
    fn power(&self, p: &[S], _x: &[S], at: &Instant<S>, rest: &Rest<S>) -> [S; 2] {
        let change = p[0] * conversion(at.voltage, p[1]);
        rest.static_constant.map(|part| part * change) // (2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_smooth_where_its_pieces_meet() {
        // At p/2: 1 - 2 (1/2)^2 = 1/2 = 2 (1/2)^2; slopes 2/p on both sides.
        let at = |v: f64| conversion(v, 0.7) + 1.0;
        assert!((at(0.35) - 0.5).abs() < 1e-12);
        let slope = |v: f64| (at(v + 1e-6) - at(v - 1e-6)) / 2e-6;
        assert!((slope(0.35 - 1e-5) - slope(0.35 + 1e-5)).abs() < 1e-3);
        // v = 0.6: 1 - 2 (0.1/0.7)^2 = 0.959184.
        assert!((at(0.6) - 0.959_184).abs() < 1e-6);
        assert!((at(0.71) - 1.0).abs() < 1e-15);
    }
}
