//! Motors at another frequency than nominal.
//!
//! A motor's reactances are inductances times the frequency, and its air-gap power is torque times
//! synchronous speed. The reference paper's equations (9) and (10) have neither: at a torque that stays
//! the same, power stays the same whatever the frequency.
//!
//! Missing, it leaves residuals in proportion to the frequency deviation, through the whole window and
//! not at the edges: in P with the sign of the deviation, a smaller one in Q.
//!
//! With `F` the mean of `df = (f - f0)/f0` over +-0.4 s, less where a jump of the phasor is nearer than
//! that, and the motor's power `S(u)` of the paper's
//! equations as a function of the phasor that it sees:
//!
//! ```text
//! S_motor = (1 + c F) S(u_m),   u_m = u exp(j g) / (1 + c F)                  (1)
//! dg/dt   = D w_0 F                                                         (2)
//! Q      += -m df |u|^2                                                     (3)
//! ```
//!
//! `c = 1` in (1), from which the prior lets it stray by 0.15 only, is the plain statement above: the stator's voltage is `j f` times its flux linkages, so
//! the machine of nominal frequency sees `u/f` and its torque times `f` is power. (2) is for phasors whose
//! angle does not carry the course of the whole system's frequency, because they are given against a
//! reference that turns with it (`D = 1`), or twice (`D = -1`); simulators that keep a motor's slip
//! against such a reference do the same. The rotors then accelerate with the system although the angle
//! stays; the mean keeps local swings, which the angle has in any case, out of it.
//!
//! (3) is the magnetising current, whose reactance goes with the frequency as well. At nominal frequency its
//! `|u|^2/x` is part of the static load (`base_motor`), and `m` is the motors' share of P0 over their `x`: 0.2 for
//! half a load of motors with a magnetising reactance of 2.5. Without it a static dependence, which has a
//! coefficient for Q, follows such motors better than this effect does.
//!
//! (1) and (2) hold for all motors, those of `second_motor` and `motor_undervoltage_trip` included.
//!
//! Source: (1) the stator of Kundur, "Power System Stability and Control", 7.2, with the frequency kept
//! in the speed voltages; (2) kinematics. Checked on sites of another simulator, whose motors follow (1)
//! with c about 1 and (2) with D between 0.5 and 1 (docs/validation.md), (3) on the truth generator's. Valid for slow changes of
//! frequency.

use crate::{
    load_model::{
        composed::{FrequencyCourse, Instant, Rest, Seen},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Prior, Scale},
    },
    numerics::Elementary,
};

/// Motors at another frequency than nominal.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrequencyScaledPower;

const DECLARATION: Declaration = Declaration {
    name: "frequency_scaled_power",
    title: "Motors at another frequency than nominal",
    kind: Kind::Physics,
    version: 3,
    parameters: &[
        Parameter {
            prior: Prior {
                centre: 1.0,
                deviation: 0.15,
                scale: Scale::Linear,
            },
            ..Parameter::two_sided(["coefficient", "c", "1"], [-0.5, 1.0, 2.0, 0.3])
        },
        Parameter::two_sided(["reference_share", "D", "1"], [-1.5, 0.0, 1.5, 0.3]),
        Parameter {
            prior: Prior {
                centre: 0.2,
                deviation: 0.1,
                scale: Scale::Linear,
            },
            ..Parameter::two_sided(["magnetising", "m", "1"], [-0.5, 0.2, 1.0, 0.1])
        },
    ],
    states: &[],
    acts_on: &[Place::MotorFrequency, Place::Power],
    excludes: &[],
    resembles: &["static_frequency_dependence", "speed_dependent_torque"],
    needs: Needs {
        frequency: true,
        voltage_below: None,
        frequency_deviation: Some(5e-4),
        window_s: 5.0,
        separating_event: "deep dips at nominal frequency, and deviations of both signs",
        ..Needs::A_DIP
    },
    source: "Kundur, Power System Stability and Control, 7.2, with the frequency in the speed \
             voltages; no published load model states it separately (not verified)",
};

/// Half of the time over which local swings average out, s. Chosen.
const HALF_MEAN_S: f64 = 0.4;

/// The least half, s: about a cycle.
const HALF_MEAN_LEAST_S: f64 = 0.02;

impl Declared for FrequencyScaledPower {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for FrequencyScaledPower {
    fn motor_frequency(&self, p: &[S], course: &FrequencyCourse<'_, S>, seen: &mut [Seen<S>]) {
        let integral = Integral::new(course);
        let mut angle = S::constant(0.0);
        let mut before: Option<(f64, S)> = None;
        for (at, &time_s) in seen.iter_mut().zip(course.time_s) {
            let mean = integral.mean_around(time_s);
            at.frequency = at.frequency * (p[0] * mean + 1.0); // (1)
            if let Some((from_s, from)) = before {
                let turned = 0.5 * (time_s - from_s) * course.synchronous_speed_rad_s;
                angle = angle + (from + mean) * turned;
            }
            at.turn_rad = at.turn_rad + p[1] * angle; // (2)
            before = Some((time_s, mean));
        }
    }

    fn power(&self, p: &[S], _x: &[S], at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let square = at.voltage * at.voltage;
        [S::constant(0.0), -(p[2] * at.frequency_deviation * square)] // (3)
    }
}

/// Integral of the deviation from the first instant on.
struct Integral<'a, S> {
    course: &'a FrequencyCourse<'a, S>,
    sums: Vec<S>,
}

impl<'a, S: Elementary> Integral<'a, S> {
    fn new(course: &'a FrequencyCourse<'a, S>) -> Self {
        let mut sum = S::constant(0.0);
        let mut sums = vec![sum];
        for (time, df) in course.time_s.windows(2).zip(course.deviation.windows(2)) {
            sum = sum + (df[0] + df[1]) * (0.5 * (time[1] - time[0]));
            sums.push(sum);
        }
        Self { course, sums }
    }

    /// The mean over `+-HALF_MEAN_S` or to the next jump; beyond the ends the deviation stays as it is
    /// there.
    fn mean_around(&self, time_s: f64) -> S {
        let jumps = self.course.jumps_s.iter();
        let half = jumps.fold(HALF_MEAN_S, |half, jump_s| {
            half.min((jump_s - time_s).abs())
        });
        let half = half.max(HALF_MEAN_LEAST_S);
        (self.up_to(time_s + half) - self.up_to(time_s - half)) * (0.5 / half)
    }

    fn up_to(&self, time_s: f64) -> S {
        let (time, df) = (self.course.time_s, self.course.deviation);
        let last = time.len() - 1;
        let next = time.partition_point(|t| *t <= time_s);
        let from = next.saturating_sub(1).min(last);
        let after = time_s - time[from];
        if next == 0 || next > last {
            return self.sums[from] + df[from] * after;
        }
        let slope = (df[next] - df[from]) * (1.0 / (time[next] - time[from]));
        self.sums[from] + (df[from] + slope * (0.5 * after)) * after
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    #[test]
    fn half_a_hertz_less_is_five_sixths_of_a_percent_less_power() {
        // The phasor turns with the deviation -1/120, the torque stays: P = f.
        let df = -0.5 / 60.0;
        let phasor = |t: f64| {
            let angle = df * 376.99 * (t - 0.2).max(0.0);
            [angle.cos(), angle.sin()]
        };
        let input = lasting(6.0, phasor, &[]);
        let structure = Structure::zip_im().with("frequency_scaled_power").unwrap();
        let model = ComposedModel::new(&structure);
        let mut p = model.typical();
        p[3..11].copy_from_slice(&[1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]);
        let course: Vec<f64> = (input.output_points().iter())
            .map(|i| {
                if (*i as f64) < 0.2 * 60.0 * 16.0 {
                    0.0
                } else {
                    df
                }
            })
            .collect();
        let drive = Drive::new(&input, &course, 0.3);
        let out = model.simulate(&p, &[], &drive).unwrap();
        let last = out.active.len() - 1;
        // Five seconds after the step the rotor has all but settled.
        assert!(
            (out.active[last] - (1.0 + df)).abs() < 1e-5,
            "{}",
            out.active[last]
        );
        // (3) adds 0.2/120 to Q.
        p[model.static_lag() - 1] = 0.2;
        let magnetised = model.simulate(&p, &[], &drive).unwrap();
        assert_eq!(magnetised.active, out.active);
        let added = magnetised.reactive[last] - out.reactive[last];
        assert!((added + 0.2 * df).abs() < 1e-12, "{added}");
    }

    #[test]
    fn phasors_against_a_turning_reference_are_turned_back() {
        // A deviation that grows slowly: with D = 1 and a phasor that stays, the rotor is driven as by a
        // phasor that turns.
        let df = |t: f64| -0.004 * (t - 1.0).clamp(0.0, 3.0);
        let angle = |t: f64| {
            let ramp = (t - 1.0).clamp(0.0, 3.0);
            -0.004 * 376.99 * (0.5 * ramp * ramp + 3.0 * (t - 4.0).max(0.0))
        };
        let still = lasting(6.0, |_| [1.0, 0.0], &[]);
        let turning = lasting(6.0, |t| [angle(t).cos(), angle(t).sin()], &[]);
        let course: Vec<f64> = (still.output_points().iter())
            .map(|i| df(*i as f64 / 960.0))
            .collect();
        let structure = Structure::zip_im().with("frequency_scaled_power").unwrap();
        let model = ComposedModel::new(&structure);
        let mut p = model.typical();
        let own = model.static_lag() - 3..model.static_lag();
        let of = |p: &[f64], terminal| {
            let drive = Drive::new(terminal, &course, 0.3);
            model.simulate(p, &[], &drive).unwrap().active
        };
        p[own.clone()].copy_from_slice(&[0.0, 1.0, 0.0]);
        let with = of(&p, &still);
        p[own].copy_from_slice(&[0.0, 0.0, 0.0]);
        let without = of(&p, &turning);
        for (x, y) in with.iter().zip(&without) {
            // The mean rounds the corners of the ramp.
            assert!((x - y).abs() < 2e-3, "{x} {y}");
        }
    }
}
