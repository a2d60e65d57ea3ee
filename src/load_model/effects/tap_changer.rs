//! On-load tap changer between the measured bus and the load.
//!
//! When the voltage behind the transformer has been outside a dead band for some tens of seconds, the
//! tap changer moves it back step by step.
//!
//! Missing, it leaves stairs in P and Q while the measured voltage is flat. The window must be longer
//! than the delay; after a shorter event there is nothing to see.
//!
//! With `a` the ratio, 1 at rest, `v` the measured voltage, and `t_out` how long `1 - a v > b`, or how long `1 - a v < -b`,
//! has lasted:
//!
//! ```text
//! u_L = a u                                                                      (1)
//! a -> a +- d   whenever t_out passes T_d + k T_i,  k = 0, 1, 2 ...               (2)
//! ```
//!
//! each step over the time `T_m` around that instant. The set point is the voltage before the event, which may have been anywhere in the
//! real dead band; the band here is symmetric.
//!
//! A diverter switch changes over within some hundredths of a second (Kraemer, On-Load Tap-Changers for Power
//! Transformers, 2000, from memory, not verified: 40 to 60 ms).
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

/// Slow steps are found from farther away, s.
const SCREENED_MOTION_S: f64 = 0.1;
/// Range of the ratio around 1.
const RANGE: f64 = 0.15;
/// Spread of the dead band's edge, pu.
const BAND_SPREAD_PU: f64 = 0.001;

const DECLARATION: Declaration = Declaration {
    name: "tap_changer",
    title: "On-load tap changer",
    kind: Kind::Physics,
    version: 2,
    parameters: &[
        Parameter::one_sided(["step", "d", "1"], [0.006_25, 0.03, 0.002]),
        Parameter::shape(["half_band", "b", "1"], [0.003, 0.01, 0.03], 0.005),
        Parameter::positive_shape(["delay_s", "T_d", "s"], [0.3, 3.0, 60.0], 1.2),
        Parameter::positive_shape(["interval_s", "T_i", "s"], [0.3, 3.0, 20.0], 0.8),
        Parameter::positive_shape(["motion_s", "T_m", "s"], [0.02, 0.05, 0.15], 0.4),
    ],
    states: &[
        // Below 0 where the voltage is too high.
        State {
            name: "time_outside",
            unit: "s",
        },
        State {
            name: "ratio",
            unit: "1",
        },
    ],
    acts_on: &[Place::States, Place::Taps],
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

    fn bracketed(&self) -> &'static [&'static str] {
        &["half_band"]
    }

    fn mistaken_for(&self, values: &[f64]) -> Vec<Vec<f64>> {
        // Half as large steps twice as often make nearly the same stair, and the other way round. Where the first step of
        // both is at the same instant, three large ones end where five of half the interval do, ...
        let times = |step: f64, interval: f64, later_s: f64| {
            let mut other = values.to_vec();
            other[0] *= step;
            other[2] += later_s;
            other[3] *= interval;
            other
        };
        let in_three = |interval: f64| (2.0 * interval + 1.0) / 3.0;
        let mut others = [2.0, 3.0].map(|n| times(in_three(n), n, 0.0)).to_vec();
        others.push(times(1.0 / in_three(2.0), 0.5, 0.0));
        // ... where what lies between the steps is smoothed out, the line through their middles stays.
        others.extend([2.0, 3.0, 5.0].map(|n| {
            let mut other = times(n, n, 0.5 * (n - 1.0) * values[3]);
            other[4] = other[4].min(SCREENED_MOTION_S);
            other
        }));
        others
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        let mut points = Vec::new();
        for delay_s in [1.5_f64, 3.0, 5.0, 8.0, 15.0, 30.0] {
            for share in [0.4, 1.0, 1.5] {
                points.push(vec![
                    0.01,
                    delay_s,
                    (share * delay_s).min(8.0),
                    SCREENED_MOTION_S,
                ]);
            }
        }
        points
    }
}

/// Steps made by the time the voltage has been outside for `time`: a stair with smooth risers.
fn steps<S: Elementary>(time: S, p: &[S]) -> S {
    const STEPS_MAX: usize = 64;
    let mut sum = S::constant(0.0);
    for k in 0..STEPS_MAX {
        let since = time - p[2] - p[3] * k as f64 + p[4] * 0.5;
        if since.value() <= 0.0 {
            break;
        }
        sum = sum + smooth_step(since / p[4]);
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
        let sign = |value: f64| if value < 0.0 { -1.0 } else { 1.0 };
        let mut side = sign(timer.value());
        let mut time = *timer * side;
        // A step that has begun is finished, also where it enters the band half way.
        let moving = steps(time, p).value().fract() > 0.0;
        if !moving && sign(error[2].value()) * side < 0.0 {
            // What has passed on the other side counts nothing.
            side = -side;
            time = S::constant(0.0);
        }
        let outside = error.map(|e| smooth_step((e * side - p[1]) * (1.0 / BAND_SPREAD_PU)));
        let after = if moving {
            time + step.duration_s
        } else if outside[2].value() > 0.0 {
            time + mean(outside) * step.duration_s
        } else {
            *timer = S::constant(0.0);
            return;
        };
        *timer = after * side;
        let raised = p[0] * (steps(after, p) - steps(time, p)) * side;
        *ratio = at_least(at_most(*ratio + raised, 1.0 + RANGE), 1.0 - RANGE); // (2)
    }

    fn gain(&self, _p: &[S], x: &[S], _frequency_deviation: S, _rest: &Rest<S>) -> [S; 2] {
        [x[1], S::constant(0.0)] // (1)
    }
}

#[cfg(test)]
mod tests {
    use super::{DECLARATION, TapChanger};
    use crate::load_model::{
        ComposedModel, Drive, Structure, composed::contract::lasting, effect::Declared,
    };

    /// P and Q at 60 samples per second of a constant impedance without motor that draws `1 + j q0` at the
    /// measured bus, behind a reactance and taps, under a voltage with these jumps.
    fn impedance_behind_taps(
        voltage: impl Fn(f64) -> f64,
        [lasts_s, q0]: [f64; 2],
        jumps_s: &[f64],
        reactance: f64,
        taps: [f64; 5],
    ) -> [Vec<f64>; 2] {
        let input = lasting(lasts_s, |t| [voltage(t), 0.0], jumps_s);
        let structure = Structure::zip_im().with("feeder_impedance").unwrap();
        let model = ComposedModel::new(&structure.with("tap_changer").unwrap());
        let mut p = model.neutral();
        // d_z is what is left at the load, over P0.
        p[3..8].copy_from_slice(&[0.0, 1.0, 0.0, q0 - reactance * (1.0 + q0 * q0), 0.0]);
        p[model.index("feeder_impedance.reactance").unwrap()] = reactance;
        let first = model.index("tap_changer.step").unwrap();
        p[first..first + 5].copy_from_slice(&taps);
        let out = model
            .simulate(&p, &[], &Drive::new(&input, &[], q0))
            .unwrap();
        [out.active, out.reactive]
    }

    #[test]
    fn two_steps_bring_the_voltage_back_into_the_band() {
        // v = 0.98, band 0.01: after 1 s one step of 0.00625 (0.98613, still outside), after 2 s a
        // second one (0.99225, inside): no third.
        let low = |t: f64| if t < 0.5 { 1.0 } else { 0.98 };
        let taps = [0.006_25, 0.01, 1.0, 1.0, 0.05];
        let [active, _] = impedance_behind_taps(low, [5.0, 0.3], &[0.5], 0.0, taps);
        // 1.4, 2, 2.9 and 5 s.
        for (k, ratio) in [(84, 1.0), (120, 1.006_25), (174, 1.0125), (300, 1.0125)] {
            let expected = (0.98_f64 * ratio).powi(2);
            assert!(
                (active[k] - expected).abs() < 1e-6,
                "{k}: {} {expected}",
                active[k]
            );
        }
    }

    #[test]
    fn what_has_passed_on_one_side_does_not_count_on_the_other() {
        // Too low for 0.4 s, then too high: the first step comes 1 s after the change, and lowers.
        let voltage = |t: f64| match t {
            t if t < 0.5 => 1.0,
            t if t < 0.9 => 0.97,
            _ => 1.02,
        };
        let taps = [0.015, 0.01, 1.0, 1.0, 0.05];
        let [active, _] = impedance_behind_taps(voltage, [3.0, 0.3], &[0.5, 0.9], 0.0, taps);
        // 1.8, 2 and 2.9 s.
        for (k, ratio) in [(108, 1.0), (120, 0.985), (174, 0.985)] {
            let expected = (1.02_f64 * ratio).powi(2);
            assert!(
                (active[k] - expected).abs() < 1e-6,
                "{k}: {} {expected}",
                active[k]
            );
        }
    }

    #[test]
    fn the_transformer_stands_behind_the_feeder() {
        // |u|^2 Re(1/(jX + Z/a^2)) at the measured bus.
        let (q0, x, step) = (0.3, 0.12, 0.015);
        let low = |t: f64| if t < 0.5 { 1.0 } else { 0.95 };
        let taps = [step, 0.04, 1.0, 10.0, 0.05];
        let [active, reactive] = impedance_behind_taps(low, [3.0, q0], &[0.5], x, taps);
        // Load at rest: what the feeder leaves of u0 = 1 over i0 = 1 - j q0.
        let square = 1.0 + q0 * q0;
        let load = [1.0 / square, q0 / square - x];
        for (k, ratio) in [(60, 1.0), (120, 1.0 + step)] {
            let [r, own] = load.map(|part| part / (ratio * ratio));
            let total = own + x;
            let over = 0.95 * 0.95 / (r * r + total * total);
            assert!((active[k] - over * r).abs() < 1e-9, "{k}");
            assert!((reactive[k] - over * total).abs() < 1e-9, "{k}");
        }
    }

    #[test]
    fn other_stairs_end_where_this_one_does_or_keep_its_line() {
        let values = [0.006, 0.01, 4.0, 1.0, 0.12];
        let others = TapChanger.mistaken_for(&values);
        assert!(
            others
                .iter()
                .all(|other| other.len() == DECLARATION.parameters.len())
        );
        // Five steps from 4 to 8 s; three of twice the interval, nine of half of it; three and seven of the others.
        let (first_s, step) = (values[2], values[0]);
        let (risen, lasted_s) = (5.0 * step, 4.0);
        let mut same_end = 0;
        for other in &others {
            let count = 1.0 + lasted_s / other[3];
            if (other[2] - first_s).abs() < 1e-12 && count.fract() < 1e-9 {
                same_end += usize::from((count * other[0] - risen).abs() < 0.1 * risen);
            }
        }
        assert_eq!(same_end, 2, "twice and half the interval");
        // The line through the middles of the steps: at t it has risen by step * ((t - first) / interval + 1 / 2).
        let line = |p: &[f64]| p[0] * ((10.0 - p[2]) / p[3] + 0.5);
        let same_line = others.iter().filter(|other| {
            (line(other) - line(&values)).abs() < 1e-12
                && (other[0] / other[3] - 0.006).abs() < 1e-12
        });
        assert_eq!(same_line.count(), 3);
    }
}
