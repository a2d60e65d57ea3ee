//! Generation or load that is switched off by the frequency.
//!
//! Small generation has relays of its own: many an older photovoltaic plant leaves the grid at 49.5 or 59.3 Hz, or at
//! 50.2 Hz, and does not come back within minutes. Underfrequency relays shed load on purpose, most at
//! 49.0 to 48.0 or 59.5 to 58.5 Hz.
//!
//! Missing, it leaves a step of P with no step of the voltage, at the instant at which the frequency has been beyond the
//! relay's for its delay; it stays. Generation that is lost raises P, load that is shed lowers it.
//!
//! ```text
//! b_k = (df < -u_k) + (df > o_k)                                 (1)
//! s_k = time since b_k has lasted for T                          (2)
//! dP  = -F mean_k smooth_step(s_k/T_s),   dQ = t dP              (3)
//! u_k, o_k = u, o + w z_k,   z_k = -0.8, -0.4, 0, 0.4, 0.8       (4)
//! ```
//!
//! `df` is the frequency's deviation from that before the event, over the nominal one. `F` is negative for generation. Relays of one setting
//! differ by what they measure: a fifth of them each acts at its own within `w` to both sides. Once `b_k` has
//! lasted for `T` they are off within `T_s`, whatever the frequency does meanwhile. A phase jump, which a frequency channel
//! shows for a few cycles, is shorter than the delay of any relay that is fit for use.
//!
//! Source: frequency elements of `DER_A` and PVD1 in the WECC composite load model; IEEE 1547-2003 (59.3 and 60.5 Hz
//! within 0.16 s), VDE AR-N 4105 of 2011 on the plants that left at 50.2 Hz (all values from memory, not verified).
//! Not included: return, a different share for either side, what the frequency before the event was off its nominal value (it
//! adds to the settings).

use super::relay;
use crate::{
    load_model::{
        MotorCoordinates,
        composed::{Instant, Rest, Step},
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place, State},
    },
    numerics::{
        Elementary,
        elementary::{at_least, smooth_step},
    },
};

/// What the frequency switches off.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrequencyTrip;

/// Half width over which a relay picks up, pu: 5 to 6 mHz, ...
const SPREAD_LEAST_PU: f64 = 1e-4;
/// ... and this share of what settings differ by, so that one begins where another ends.
const SPREAD_SHARE: f64 = 0.2;
/// Relays with settings of their own, in half widths of what settings differ by.
const PLACES: [f64; 5] = [-0.8, -0.4, 0.0, 0.4, 0.8];
/// What stays open of a relay's frequency: a channel of frequency lags by one or two cycles (the frequency falls by some mHz
/// meanwhile), and the frequency before an event is off its nominal value by 10 to 20 mHz.
const RESOLUTION_PU: f64 = 3e-4;
/// The same of its delay: what relays take to notice a frequency (20 to 50 ms) is part of it.
const DELAY_RESOLUTION_S: f64 = 0.03;
/// Beyond what any recording shows, pu.
const NEVER: f64 = 0.06;

const fn timer(name: &'static str) -> State {
    State { name, unit: "s" }
}

const DECLARATION: Declaration = Declaration {
    name: "frequency_trip",
    title: "Generation or load that the frequency switches off",
    kind: Kind::Physics,
    version: 1,
    parameters: &[
        Parameter::two_sided(["share", "F", "1"], [-1.0, -0.1, 0.9, 0.02]),
        Parameter::positive_shape(["underfrequency", "u", "pu"], [0.002, 0.01, NEVER], 0.8)
            .with_resolution(RESOLUTION_PU),
        Parameter::positive_shape(["overfrequency", "o", "pu"], [0.002, 0.01, NEVER], 0.8)
            .with_resolution(RESOLUTION_PU),
        Parameter::positive_shape(["delay_s", "T", "s"], [0.02, 0.16, 10.0], 0.7)
            .with_resolution(DELAY_RESOLUTION_S),
        Parameter::positive_shape(["spread_s", "T_s", "s"], [0.004, 0.03, 1.0], 0.7),
        Parameter::positive_shape(["settings_spread", "w", "pu"], [2e-5, 2e-4, 1.5e-3], 0.8),
        Parameter::shape(["reactive_ratio", "t", "1"], [-0.3, 0.0, 0.6], 0.15),
    ],
    states: &[
        timer("timer_1"),
        timer("since_pick_up_1"),
        timer("timer_2"),
        timer("since_pick_up_2"),
        timer("timer_3"),
        timer("since_pick_up_3"),
        timer("timer_4"),
        timer("since_pick_up_4"),
        timer("timer_5"),
        timer("since_pick_up_5"),
    ],
    acts_on: &[Place::States, Place::Power],
    excludes: &[],
    resembles: &["static_frequency_dependence", "distributed_generation"],
    needs: Needs {
        frequency: true,
        voltage_below: None,
        frequency_deviation: Some(0.0025),
        window_s: 5.0,
        separating_event: "frequency deviations on both sides of the relay's setting",
        ..Needs::A_DIP
    },
    source: "WECC DER_A and PVD1 (frequency elements), IEEE 1547-2003, VDE AR-N 4105 (values from memory, not verified)",
};

impl Declared for FrequencyTrip {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }

    fn frequency_thresholds(&self) -> &'static [&'static str] {
        &["underfrequency", "overfrequency"]
    }

    fn nuisance_grid(&self, _motor: &MotorCoordinates<f64>) -> Vec<Vec<f64>> {
        // Off within a tenth of a second or more: the instant is looked for.
        [0.08, 0.25]
            .map(|delay_s| vec![NEVER, NEVER, delay_s, 0.1, 4e-4, 0.0])
            .to_vec()
    }

    fn beside_the_states(&self) -> Vec<usize> {
        vec![0, 4, 6]
    }
}

/// Exactly 1 where `x` is well above the threshold, exactly 0 where it is well below.
fn beyond<S: Elementary>(x: S, threshold: S, spread: S) -> S {
    smooth_step((x - threshold) / (spread * 2.0) + 0.5)
}

impl<S: Elementary> Equations<S> for FrequencyTrip {
    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let df = step.frequency_deviation;
        let spread = p[5] * SPREAD_SHARE + SPREAD_LEAST_PU;
        for (relay, place) in x.chunks_exact_mut(2).zip(PLACES) {
            let by = p[5] * place; // (4)
            let away = beyond(-df, p[1] + by, spread) + beyond(df, p[2] + by, spread); // (1)
            if let [timer, since] = relay {
                relay::run_timer(timer, [away; 3], step.duration_s);
                // Exact within a step: far from jumps steps are longer than what a relay's contacts take.
                *since = if since.value() > 0.0 {
                    *since + step.duration_s
                } else {
                    at_least(*timer - p[3], 0.0) // (2)
                };
            }
        }
    }

    fn power(&self, p: &[S], x: &[S], _at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let open = x.chunks_exact(2).map(|relay| smooth_step(relay[1] / p[4]));
        let open = open.fold(S::constant(0.0), |sum, one| sum + one);
        let lost = -(p[0] * open) * (1.0 / PLACES.len() as f64);
        [lost, p[6] * lost] // (3)
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::{ComposedModel, Drive, Structure, composed::contract::lasting};

    /// The deviation at 60 samples/s that falls by `fall_pu` between 1 and 3 s and stays.
    fn declining(fall_pu: f64) -> Vec<f64> {
        let fallen = |k: i32| ((f64::from(k) / 60.0 - 1.0) / 2.0).clamp(0.0, 1.0);
        (0..=360).map(|k| -fall_pu * fallen(k)).collect()
    }

    /// What is added to P at 60 samples/s in such a decline, F = -0.1.
    fn added(fall_pu: f64) -> Vec<f64> {
        let model = ComposedModel::new(&Structure::zip_im().with("frequency_trip").unwrap());
        let input = lasting(6.0, |_| [1.0, 0.0], &[]);
        let course = declining(fall_pu);
        let drive = Drive::new(&input, &course, 0.3);
        let with = model.simulate(&model.typical(), &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        let both = with.active.into_iter().zip(without.active);
        both.map(|(with, without)| with - without).collect()
    }

    #[test]
    fn generation_is_gone_once_the_frequency_has_been_low_for_the_delay() {
        // Below 0.01 after 1 + 2/1.25 s = 2.6 s, 0.16 s of delay, all off 0.05 s later.
        let added = added(0.0125);
        assert!(added[162].abs() < 1e-12, "{}", added[162]);
        for sample in [174, 360] {
            assert!(
                (added[sample] - 0.1).abs() < 1e-12,
                "{sample}: {}",
                added[sample]
            );
        }
    }

    #[test]
    fn settings_and_times_have_the_derivatives_of_differences() {
        let model = ComposedModel::new(&Structure::zip_im().with("frequency_trip").unwrap());
        let input = lasting(6.0, |_| [1.0, 0.0], &[]);
        let course = declining(0.0125);
        let drive = Drive::new(&input, &course, 0.3);
        let mut at = model.typical();
        // Off within half a second, so that several samples lie in the opening.
        let [u, delay, settings] = ["underfrequency", "delay_s", "settings_spread"]
            .map(|name| model.index(&format!("frequency_trip.{name}")).unwrap());
        let spread = model.index("frequency_trip.spread_s").unwrap();
        at[spread] = 0.5;
        for index in [u, delay, spread, settings] {
            let exact = model.simulate(&at, &[index], &drive).unwrap();
            let step = 1e-6 * at[index];
            let [low, high] = [-step, step].map(|by| {
                let mut moved = at.clone();
                moved[index] += by;
                model.simulate(&moved, &[], &drive).unwrap().active
            });
            let differences = high.iter().zip(&low).map(|(h, l)| (h - l) / (2.0 * step));
            let exact = &exact.active_derivatives[0];
            let largest = exact.iter().fold(0.0, |m: f64, d| m.max(d.abs()));
            assert!(largest > 0.0, "{index}");
            for (exact, difference) in exact.iter().zip(differences) {
                assert!(
                    (exact - difference).abs() < 1e-5 * largest,
                    "{index}: {exact} {difference}"
                );
            }
        }
    }

    #[test]
    fn at_the_nominal_frequency_no_setting_acts() {
        // The lowest settings, differing by as much as they may, without delay.
        let model = ComposedModel::new(&Structure::zip_im().with("frequency_trip").unwrap());
        let mut at = model.typical();
        for (index, parameter) in model.parameters().iter().enumerate() {
            let declared = &parameter.declaration;
            match declared.name {
                "underfrequency" | "overfrequency" | "delay_s" => at[index] = declared.lower,
                "settings_spread" => at[index] = declared.upper,
                _ => {}
            }
        }
        let input = lasting(6.0, |_| [1.0, 0.0], &[]);
        let out = model.simulate(&at, &[], &Drive::new(&input, &[], 0.3));
        assert!(out.unwrap().active.iter().all(|p| (p - 1.0).abs() < 1e-11));
    }

    #[test]
    fn a_smaller_deviation_does_nothing() {
        assert!(added(0.0095).iter().all(|p| p.abs() < 1e-15));
    }
}
