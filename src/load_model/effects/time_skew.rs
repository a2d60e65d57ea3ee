//! Time skew between the channels: P and Q are late against V.
//!
//! Two instruments, or two filters of one, put their samples at times that differ by up to a few
//! frames.
//!
//! Missing, it leaves residuals of opposite sign at the two edges of a dip and nothing on the plateaus;
//! one frame is 15 % of Q in a dip of 30 %. The inertia of a fit without it runs to its bound.
//!
//! ```text
//! y(t) = y*(t - tau)                        (1)
//! ```
//!
//! for P and Q alike. `y*` is what the instrument would report on time, its phasor filter included; by itself, without
//! the instrument, a cubic between the output instants, straight across a jump.
//!
//! Source: definition. A filter of two cycles looks like 1.4 to 4.3 ms of skew (measured on
//! prototypes), hence the smallest meaningful value.

use super::series::Curve;
use crate::{
    load_model::{
        composed::Series,
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place},
    },
    numerics::Elementary,
};

/// Time skew between the channels.
#[derive(Clone, Copy, Debug)]
pub(super) struct TimeSkew;

/// Instants of jumps are known to a hundredth of a nominal cycle: the shape of the instrument's filter is known no
/// better, at one event as at all others.
const RESOLUTION_S: f64 = 0.0002;

const DECLARATION: Declaration = Declaration {
    name: "time_skew",
    title: "Time skew between voltage and power",
    kind: Kind::Instrument,
    version: 2,
    parameters: &[
        Parameter::two_sided(["delay_s", "tau", "s"], [-0.08, 0.012, 0.08, 0.005])
            .with_resolution(RESOLUTION_S),
    ],
    states: &[],
    acts_on: &[Place::Measurement],
    excludes: &[],
    resembles: &["second_motor", "double_cage_rotor", "phasor_window"],
    needs: Needs {
        rate_fps: 25.0,
        separating_event: "an edge steeper than a frame",
        ..Needs::A_DIP
    },
    source: "definition of a delay; the smallest meaningful value is measured (docs/effects)",
};

impl Declared for TimeSkew {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn delay(&self) -> Option<&'static str> {
        Some("delay_s")
    }
}

impl<S: Elementary> Equations<S> for TimeSkew {
    fn measure(&self, p: &[S], series: &mut Series<'_, S>) {
        let delayed = |value: &[S]| -> Vec<S> {
            let curve = Curve::new(series.time_s, series.jump, value);
            series.time_s.iter().map(|t| curve.at(-p[0] + *t)).collect()
        };
        let (active, reactive) = (delayed(series.active), delayed(series.reactive));
        *series.active = active;
        *series.reactive = reactive;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_frame_late_is_the_sample_before() {
        let time_s: Vec<f64> = (0..10).map(|k| f64::from(k) / 60.0).collect();
        let mut active: Vec<f64> = (0..10).map(|k| f64::from(k * k)).collect();
        let mut reactive = active.clone();
        let before = active.clone();
        let mut series = Series {
            time_s: &time_s,
            jump: &[false; 10],
            phasor: &[[1.0, 0.0]; 10],
            reactive_at_rest: 0.0,
            active: &mut active,
            reactive: &mut reactive,
        };
        TimeSkew.measure(&[1.0 / 60.0], &mut series);
        for k in 1..10 {
            assert!((active[k] - before[k - 1]).abs() < 1e-9);
        }
    }
}
