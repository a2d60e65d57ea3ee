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
//! t(z) = how long df has been below -(u + w z) or above o + w z     (1)
//! m(z) = the longest t(z) so far, for relays -1 <= z <= 1           (2)
//! g(z) = smooth_step((m(z) - T)/T_s)                                (3)
//! dP   = -F mean_z g(z),   dQ = t dP                                (4)
//! ```
//!
//! `df` is the frequency's deviation from that before the event, over the nominal one. `F` is negative for generation. Relays of one setting
//! differ by what they measure, evenly within `w` to both sides, and by their delays, which lie between `T` and `T + T_s`. So a frequency
//! that turns back just beyond the setting trips a part of them. `m` is followed at five `z` and is linear between them, so that the mean
//! of (4) is an integral in closed form. A phase jump, which a frequency channel
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
        effect::{
            Declaration, Declared, Equations, Kind, Needs, Parameter, Place, Prior, Scale, State,
        },
    },
    numerics::{
        Elementary,
        elementary::{larger, smooth_step},
    },
};

/// What the frequency switches off.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrequencyTrip;

/// Half width over which the relays of one place pick up, pu: 5 to 6 mHz, ...
const SPREAD_LEAST_PU: f64 = 1e-4;
/// ... and this share of what settings differ by.
const SPREAD_SHARE: f64 = 0.1;
/// Places whose relays are followed, in half widths of what settings differ by.
const PLACES: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];
/// What stays open of a relay's frequency: a channel of frequency lags by one or two cycles (the frequency falls by some mHz
/// meanwhile), and the frequency before an event is off its nominal value by 10 to 20 mHz.
const RESOLUTION_PU: f64 = 3e-4;
/// The same of its delay: what relays take to notice a frequency (20 to 50 ms) is part of it.
const DELAY_RESOLUTION_S: f64 = 0.03;
/// Beyond what any recording shows, pu.
const NEVER: f64 = 0.06;

/// A setting that no event has reached lies where none reaches: at a typical one the next event would be foretold to trip
/// what nothing has shown.
const UNSEEN: Prior = Prior {
    centre: 0.03,
    deviation: 1.0,
    scale: Scale::Logarithmic,
};

const fn timer(name: &'static str) -> State {
    State { name, unit: "s" }
}

const DECLARATION: Declaration = Declaration {
    name: "frequency_trip",
    title: "Generation or load that the frequency switches off",
    kind: Kind::Physics,
    version: 2,
    parameters: &[
        Parameter::two_sided(["share", "F", "1"], [-1.0, -0.1, 0.9, 0.02]),
        Parameter {
            prior: UNSEEN,
            ..Parameter::positive_shape(["underfrequency", "u", "pu"], [0.002, 0.01, NEVER], 1.0)
                .with_resolution(RESOLUTION_PU)
        },
        Parameter {
            prior: UNSEEN,
            ..Parameter::positive_shape(["overfrequency", "o", "pu"], [0.002, 0.01, NEVER], 1.0)
                .with_resolution(RESOLUTION_PU)
        },
        Parameter::positive_shape(["delay_s", "T", "s"], [0.02, 0.16, 10.0], 0.7)
            .with_resolution(DELAY_RESOLUTION_S),
        Parameter::positive_shape(["spread_s", "T_s", "s"], [0.004, 0.03, 1.0], 0.7),
        Parameter::positive_shape(["settings_spread", "w", "pu"], [2e-5, 2e-4, 1.5e-3], 0.8),
        Parameter::shape(["reactive_ratio", "t", "1"], [-0.3, 0.0, 0.6], 0.15),
    ],
    states: &[
        timer("timer_1"),
        timer("longest_1"),
        timer("timer_2"),
        timer("longest_2"),
        timer("timer_3"),
        timer("longest_3"),
        timer("timer_4"),
        timer("longest_4"),
        timer("timer_5"),
        timer("longest_5"),
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
        vec![0, 3, 4, 6]
    }
}

/// Exactly 1 where `x` is well above the threshold, exactly 0 where it is well below.
fn beyond<S: Elementary>(x: S, threshold: S, spread: S) -> S {
    smooth_step((x - threshold) / (spread * 2.0) + 0.5)
}

/// The integral of [`smooth_step`] from 0.
fn smooth_ramp<S: Elementary>(x: S) -> S {
    if x.value() <= 0.0 {
        S::constant(0.0)
    } else if x.value() >= 1.0 {
        x + -0.5
    } else {
        x * x * x * (x * -0.5 + 1.0)
    }
}

/// The mean of [`smooth_step`] between two arguments.
fn mean_smooth_step<S: Elementary>(x: S, y: S) -> S {
    // Nearer than this the difference of two integrals loses more than the middle is off, a quarter of its square.
    const NEAR: f64 = 1e-5;
    let (low, high) = (x.value().min(y.value()), x.value().max(y.value()));
    if high <= 0.0 || low >= 1.0 || high - low < NEAR {
        smooth_step((x + y) * 0.5)
    } else {
        (smooth_ramp(y) - smooth_ramp(x)) / (y - x)
    }
}

impl<S: Elementary> Equations<S> for FrequencyTrip {
    fn advance(&self, p: &[S], x: &mut [S], step: &Step<S>, _rest: &Rest<S>) {
        let df = step.frequency_deviation;
        let spread = p[5] * SPREAD_SHARE + SPREAD_LEAST_PU;
        for (relay, place) in x.chunks_exact_mut(2).zip(PLACES) {
            let by = p[5] * place;
            let away = beyond(-df, p[1] + by, spread) + beyond(df, p[2] + by, spread);
            if let [timer, longest] = relay {
                relay::run_timer(timer, [away; 3], step.duration_s); // (1)
                *longest = larger(*longest, *timer); // (2)
            }
        }
    }

    fn power(&self, p: &[S], x: &[S], _at: &Instant<S>, _rest: &Rest<S>) -> [S; 2] {
        let late = |relay: &[S]| (relay[1] - p[3]) / p[4];
        let relays = x.chunks_exact(2);
        let between = relays.clone().zip(relays.skip(1));
        let open = between.map(|(one, next)| mean_smooth_step(late(one), late(next))); // (3)
        let open = open.fold(S::constant(0.0), |sum, one| sum + one);
        let lost = -(p[0] * open) * (1.0 / (PLACES.len() - 1) as f64);
        [lost, p[6] * lost] // (4)
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
        // Below 0.01 after 1 + 2/1.25 s = 2.6 s, 0.16 s of delay, all off within 0.03 s of it and 0.064 s of settings.
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
    fn a_frequency_that_turns_back_at_the_setting_trips_half() {
        let model = ComposedModel::new(&Structure::zip_im().with("frequency_trip").unwrap());
        let input = lasting(6.0, |_| [1.0, 0.0], &[]);
        // Down to 0.0104 and back at 0.004/s: beyond 0.01 for 0.2 s, the delay and half of what delays differ by.
        let course: Vec<f64> = (0..=360)
            .map(|k| (4e-3 * (f64::from(k) / 60.0 - 3.0).abs() - 0.0104).min(0.0))
            .collect();
        let drive = Drive::new(&input, &course, 0.3);
        let mut at = model.typical();
        for (name, value) in [("delay_s", 0.15), ("spread_s", 0.1)] {
            at[model.index(&format!("frequency_trip.{name}")).unwrap()] = value;
        }
        let with = model.simulate(&at, &[], &drive).unwrap();
        let without = model.simulate(&model.neutral(), &[], &drive).unwrap();
        let added = with.active[360] - without.active[360];
        assert!((added - 0.05).abs() < 2e-4, "{added}");
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
