//! Static load that depends on the frequency.
//!
//! Everything that is not a motor in the model still holds motors, ballasts and reactors whose power
//! changes with the frequency.
//!
//! Missing, it leaves a residual in P and Q that follows the frequency and not the voltage: after
//! the edges, late in the window, with the sign of the frequency deviation.
//!
//! With `df = (f - f0)/f0`, `P_s` the active power of the static part and `v = V/V0`, over P0:
//!
//! ```text
//! dP = Kpf df P_s                           (1)
//! dQ = Kqf df v^2                           (2)
//! ```
//!
//! In (2) the coefficient refers to P0, not to the static reactive power: that one may be zero, and
//! the data do not determine it (the motor's magnetisation is part of it). To compare with a
//! tabulated coefficient multiply that by `Q_static0/P0`.
//!
//! Source: (1) the linear frequency factor of the IEEE task force on load representation (1993, 1995)
//! and of PSAT's frequency-dependent load; values Kpf 0.7 to 2.6, Kqf -2.3 to 1.6 of the own reactive
//! power (all from memory, not verified). CMPLDW: Pfreq 0, Qfreq -1 (specification of 2015, not
//! verified). Linear: beyond about 2 Hz under-frequency relays and drives follow laws of their own.

use crate::{
    load_model::{
        composed::{Instant, Rest},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place},
    },
    numerics::Elementary,
};

/// Static load that depends on the frequency.
#[derive(Clone, Copy, Debug)]
pub(super) struct StaticFrequencyDependence;

const DECLARATION: Declaration = Declaration {
    name: "static_frequency_dependence",
    title: "Static load that depends on the frequency",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::two_sided(["active_coefficient", "Kpf", "1"], [-1.0, 1.3, 4.0, 0.3]),
        Parameter::two_sided(["reactive_coefficient", "Kqf", "1"], [-3.0, -0.5, 3.0, 0.3]),
    ],
    states: &[],
    acts_on: &[Place::Power],
    excludes: &[],
    resembles: &[
        "frequency_scaled_power",
        "speed_dependent_torque",
        "exponential_recovery",
    ],
    needs: Needs {
        frequency: true,
        voltage_below: None,
        frequency_deviation: Some(5e-4),
        window_s: 5.0,
        separating_event: "deep dips at nominal frequency, and deviations of both signs",
        ..Needs::A_DIP
    },
    source: "IEEE Task Force on Load Representation, IEEE Trans. Power Syst. 8(2) 1993 and 10(3) \
             1995; PSAT; CMPLDW specification 2015 (all not verified)",
};

impl Declared for StaticFrequencyDependence {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for StaticFrequencyDependence {
    fn power(&self, p: &[S], _x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let df = at.frequency_deviation;
        [
            p[0] * df * at.static_active,          // (1)
            p[1] * df * (at.voltage * at.voltage), // (2)
        ]
    }
}
