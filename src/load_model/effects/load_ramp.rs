//! Load that drifts through the window.
//!
//! Morning rises, industrial cycles: P0 and Q0 are not constant for the seconds of a window.
//!
//! Missing, it leaves a slope through the whole window, before the event too.
//!
//! ```text
//! dP = a t,   dQ = b t                      (1)
//! ```
//!
//! with `t` from the first sample. The only effect that is not at rest before the event; a trend before it is
//! its proof. Linear: for windows of seconds to a minute.
//!
//! Source: definition.

use crate::{
    load_model::{
        composed::{Instant, Rest},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place},
    },
    numerics::Elementary,
};

/// Load that drifts through the window.
#[derive(Clone, Copy, Debug)]
pub(super) struct LoadRamp;

const DECLARATION: Declaration = Declaration {
    name: "load_ramp",
    title: "Load that drifts through the window",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::two_sided(["active_per_s", "a", "1/s"], [-0.05, 0.002, 0.05, 0.0005]),
        Parameter::two_sided(["reactive_per_s", "b", "1/s"], [-0.05, 0.001, 0.05, 0.0005]),
    ],
    states: &[],
    acts_on: &[Place::Power],
    excludes: &[],
    resembles: &["exponential_recovery", "tap_changer"],
    needs: Needs {
        voltage_below: None,
        window_s: 5.0,
        separating_event: "a longer record before the event",
        ..Needs::A_DIP
    },
    source: "definition of a linear drift",
};

impl Declared for LoadRamp {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for LoadRamp {
    fn power(&self, p: &[S], _x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        [p[0] * at.time_s, p[1] * at.time_s] // (1)
    }
}
