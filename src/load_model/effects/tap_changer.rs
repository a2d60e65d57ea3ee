//! On-load tap changer between the measured bus and the load.
//!
//! When the voltage behind the transformer has been outside a dead band for some tens of seconds, the
//! tap changer moves it back step by step.
//!
//! Missing, it leaves stairs in P and Q while the measured voltage is flat. The window must be longer
//! than the delay; after a shorter event there is nothing to see.
//!
//! With `a` the ratio, 1 at rest, `v` the measured voltage, and `t_out` how long `|1 - a v| > b` has lasted:
//!
//! ```text
//! u_L = a u                                                                      (1)
//! a -> a +- d   whenever t_out passes T_d + k T_i,  k = 0, 1, 2 ...               (2)
//! ```
//!
//! each step over 0.1 s. The set point is the voltage before the event, which may have been anywhere in the
//! real dead band; the band here is symmetric.
//!
//! Source: line-drop-free on-load tap changer of the WECC composite load model (30 s, 5 s, steps of .00625,
//! from memory, not verified).

use super::relay::mean;
use crate::{
    load_model::{
        Infeasible, MotorCoordinates,
        composed::{Rest, Step},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, State},
    },
    numerics::{
        Elementary,
        elementary::{at_least, at_most, smooth_step},
    },
};

/// On-load tap changer.
#[derive(Clone, Copy, Debug)]
pub(super) struct TapChanger;

/// Time one step takes, s.
const MOTION_S: f64 = 0.1;
/// Range of the ratio around 1.
const RANGE: f64 = 0.15;
/// Spread of the dead band's edge, pu.
const BAND_SPREAD_PU: f64 = 0.001;

const DECLARATION: Declaration = Declaration {
    name: "tap_changer",
    title: "On-load tap changer",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::one_sided(["step", "d", "1"], [0.006_25, 0.03, 0.002]),
        Parameter::shape(["half_band", "b", "1"], [0.003, 0.01, 0.03], 0.005),
        Parameter::positive_shape(["delay_s", "T_d", "s"], [0.3, 3.0, 60.0], 1.2),
        Parameter::positive_shape(["interval_s", "T_i", "s"], [0.3, 3.0, 20.0], 0.8),
    ],
    states: &[
        State {
            name: "time_outside",
            unit: "s",
        },
        State {
            name: "ratio",
            unit: "1",
        },
    ],
    acts_on: &[Place::States, Place::Gain],
    excludes: &[],
    resembles: &["exponential_recovery", "load_ramp"],
    needs: Needs {
        voltage_below: Some(0.99),
        window_s: 30.0,
        separating_event: "a sustained change of voltage, recorded beyond the delay",
        ..Needs::A_DIP
    },
    source: "tap changer of the WECC composite load model (from memory, not verified)",
};

impl Declared for TapChanger {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn screened_at(&self) -> &'static [f64] {
        &[0.004, 0.006_25, 0.009, 0.0135, 0.02]
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        let mut points = Vec::new();
        for delay_s in [1.5_f64, 3.0, 5.0, 8.0, 15.0, 30.0] {
            for share in [0.4, 1.0, 1.5] {
                points.push(vec![0.01, delay_s, (share * delay_s).min(8.0)]);
            }
        }
        points
    }
}

/// Steps made by the time the voltage has been outside for `timer`: a stair with smooth risers.
fn steps<S: Elementary>(timer: S, p: &[S]) -> S {
    const STEPS_MAX: usize = 64;
    let mut sum = S::constant(0.0);
    for k in 0..STEPS_MAX {
        let since = timer - p[2] - p[3] * k as f64;
        if since.value() <= 0.0 {
            break;
        }
        sum = sum + smooth_step(since * (1.0 / MOTION_S));
    }
    sum
}

impl<S: Elementary> Equations<S> for TapChanger {
    fn initialise(&self, _p: &[S], _rest: &Rest<S>, x: &mut [S]) -> Result<(), Infeasible> {
        x[1] = S::constant(1.0);
        Ok(())
    }

    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let [timer, ratio] = x else { return };
        // The voltage of a step is that behind the ratio.
        let error = step.voltage.map(|v| -v + 1.0);
        let outside = error.map(|e| {
            let size = if e.value() < 0.0 { -e } else { e };
            smooth_step((size - p[1]) * (1.0 / BAND_SPREAD_PU))
        });
        let before = steps(*timer, p);
        // A step that has begun is finished, also where it enters the band half way.
        let moving = before.value().fract() > 0.0;
        if moving {
            *timer = *timer + step.duration_s;
        } else if outside[2].value() > 0.0 {
            *timer = *timer + mean(outside) * step.duration_s;
        } else {
            *timer = S::constant(0.0);
            return;
        }
        let moved = p[0] * (steps(*timer, p) - before);
        let raised = if error[2].value() > 0.0 {
            moved
        } else {
            -moved
        };
        *ratio = at_least(at_most(*ratio + raised, 1.0 + RANGE), 1.0 - RANGE); // (2)
    }

    fn gain(&self, _p: &[S], x: &[S], _frequency_deviation: S, _rest: &Rest<S>) -> [S; 2] {
        [x[1], S::constant(0.0)] // (1)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    #[test]
    fn two_steps_bring_the_voltage_back_into_the_band() {
        // v = 0.98, band 0.01: after 1 s one step of 0.00625 (0.98613, still outside), after 2 s a
        // second one (0.99225, inside): no third.
        let phasor = |t: f64| [if t < 0.5 { 1.0 } else { 0.98 }, 0.0];
        let input = lasting(5.0, phasor, &[0.5]);
        let model = ComposedModel::new(&Structure::zip_im().with("tap_changer").unwrap());
        let mut p = model.neutral();
        // A constant impedance without motor shows the voltage squared.
        p[3..8].copy_from_slice(&[0.0, 1.0, 0.0, 0.0, 0.0]);
        p[8..].copy_from_slice(&[0.006_25, 0.01, 1.0, 1.0]);
        let drive = Drive::new(&input, &[], 0.3);
        let out = model.simulate(&p, &[], &drive).unwrap().active;
        // 1.4, 2, 2.9 and 5 s at 60 samples per second.
        for (k, ratio) in [(84, 1.0), (120, 1.006_25), (174, 1.0125), (300, 1.0125)] {
            let expected = (0.98_f64 * ratio).powi(2);
            assert!(
                (out[k] - expected).abs() < 1e-6,
                "{k}: {} {expected}",
                out[k]
            );
        }
    }
}
