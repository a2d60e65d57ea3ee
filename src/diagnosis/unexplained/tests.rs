//! Residuals of a known kind, made without the dictionary: the leading term must say what they are.

use super::{
    dictionary, effect_file,
    selection::{Chosen, Description},
    *,
};
use crate::{
    disturbance::{Closing, Trigger, Window},
    identification::intake::{IntakeOptions, prepare},
    load_model::user_effects::EffectFile,
    measurement::{Quality, Record, Sample},
};

const RATE_FPS: f64 = 60.0;
const SAMPLES: usize = 240;
/// Lowest voltage and length of the dips, s; afterwards the voltage stays 3 % low.
const DIPS: [(f64, f64); 6] = [
    (0.9, 0.2),
    (0.85, 0.15),
    (0.8, 0.3),
    (0.65, 0.2),
    (0.6, 0.12),
    (0.5, 0.25),
];
const NOISE: f64 = 1e-3;

/// A number between -1 and 1 with the variance of a uniform one, other ones for other seeds.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        // Knuth's linear congruential generator; the high bits are good enough for noise.
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

fn voltage(depth: f64, duration_s: f64, time_s: f64) -> f64 {
    let flank = |at: f64| 1.0 / (1.0 + (-(time_s - at) / 0.008).exp());
    let (begins, ends) = (flank(1.0), flank(1.0 + duration_s));
    1.0 - (1.0 - depth) * (begins - ends) - 0.03 * ends
}

/// Events whose load is a constant impedance with noise of its own, and the curves of that impedance.
fn events(seed: u64) -> (Vec<PreparedEvent>, Vec<Curves>) {
    let mut noise = Noise(seed.wrapping_mul(7919) + 1);
    let mut prepared = Vec::new();
    let mut curves = Vec::new();
    for (number, (depth, duration_s)) in DIPS.into_iter().enumerate() {
        let voltages: Vec<f64> = (0..SAMPLES)
            .map(|k| voltage(depth, duration_s, k as f64 / RATE_FPS))
            .collect();
        let sample = |v: &f64| Sample {
            time_ns: 0,
            voltage_pu: *v,
            angle_rad: -0.1 * (1.0 - v),
            frequency_hz: 50.0,
            active_pu: 0.8 * (v * v + NOISE * noise.next()),
            reactive_pu: 0.8 * (0.4 * v * v + NOISE * noise.next()),
            negative_sequence_ratio: 0.0,
            quality: Quality::default(),
        };
        let window = Window {
            id: format!("event_{number}"),
            site: "site".to_owned(),
            record: Record {
                start_ns: 0,
                rate_fps: RATE_FPS,
                nominal_hz: 50.0,
                samples: voltages.iter().map(sample).collect(),
            },
            onset: 58,
            triggers: vec![Trigger::Recording],
            closing: Closing::RecordingEnded,
        };
        let event = prepare(&window, &IntakeOptions::default()).unwrap();
        let own = |factor: f64| -> Vec<f64> { voltages.iter().map(|v| factor * v * v).collect() };
        curves.push(Curves {
            active: own(0.8 / event.p0_pu),
            reactive: own(0.32 / event.p0_pu),
        });
        prepared.push(event);
    }
    (prepared, curves)
}

/// The description after adding `active` and `reactive`, functions of the voltages so far.
fn described(
    active: impl Fn(&[f64]) -> f64,
    reactive: impl Fn(&[f64]) -> f64,
) -> Option<Unexplained> {
    let (mut events, curves) = events(1);
    for (event, (depth, duration_s)) in events.iter_mut().zip(DIPS) {
        let voltages: Vec<f64> = (0..SAMPLES)
            .map(|k| voltage(depth, duration_s, k as f64 / RATE_FPS))
            .collect();
        for k in 0..SAMPLES {
            event.active[k] += active(&voltages[..=k]);
            event.reactive[k] += reactive(&voltages[..=k]);
        }
    }
    describe(&events, &curves)
}

#[test]
fn load_that_leaves_in_deep_dips_is_named_with_its_size() {
    let lost = |v: &[f64]| {
        if v.iter().any(|v| *v < 0.7) {
            -0.12
        } else {
            0.0
        }
    };
    let found = described(lost, |v| 0.25 * lost(v)).unwrap();
    let [p, q] = [&found.terms[0], &found.terms[1]];
    assert!(p.formula.starts_with("latch("), "{found:?}");
    assert_eq!((p.channel, q.channel), ("P", "Q"));
    assert!((p.coefficient + 0.12).abs() < 0.01, "{found:?}");
    assert!((q.coefficient + 0.03).abs() < 0.01, "{found:?}");
    assert!(found.signature.contains("stay"), "{}", found.signature);
    assert!(
        found.signature.contains("3 of 6 events"),
        "{}",
        found.signature
    );
    EffectFile::parse(&found.effect_file.unwrap()).unwrap();
}

#[test]
fn load_that_recovers_is_a_lag_with_its_time() {
    // dz/dt = (v - z)/T with T = 2 s, by Euler's method on the samples.
    let recovering = |v: &[f64]| {
        let mut z = 1.0;
        for v in v {
            z += (v - z) / (2.0 * RATE_FPS);
        }
        0.8 * (v[v.len() - 1] - z)
    };
    let found = described(recovering, |_| 0.0).unwrap();
    assert!(found.terms[0].formula.contains("lag(v, 1.5s)"), "{found:?}");
    assert!(
        found
            .terms
            .iter()
            .all(|t| t.channel == "P" || t.share < 0.03)
    );
}

#[test]
fn noise_is_described_by_nothing() {
    for seed in 0..3 {
        let (events, curves) = events(seed);
        let found = describe(&events, &curves);
        assert_eq!(found, None, "seed {seed}");
    }
}

#[test]
fn what_no_term_can_say_gets_a_sentence_and_no_file() {
    // A hum of 7 Hz in the later half, of another phase in every event.
    let found = described(
        |v| {
            let phase = 50.0 * v.iter().fold(1.0_f64, |m, v| m.min(*v));
            if v.len() > 120 {
                0.03 * (0.7 * v.len() as f64 + phase).sin()
            } else {
                0.0
            }
        },
        |_| 0.0,
    )
    .unwrap();
    assert_eq!(found.effect_file, None, "{found:?}");
    assert!(
        found.signature.contains("in P away from"),
        "{}",
        found.signature
    );
}

#[test]
fn curves_that_do_not_fit_the_events_are_left_aside() {
    let (events, mut curves) = events(3);
    assert_eq!(describe(&events, &[]), None);
    curves[0].active[10] = f64::NAN;
    for curve in &mut curves[1..] {
        curve.reactive.pop();
    }
    assert_eq!(describe(&events, &curves), None);
    assert_eq!(describe(&[], &curves), None);
}

#[test]
fn every_term_makes_a_sound_file() {
    let (mut events, curves) = events(4);
    events[0].highest_voltage = 1.1;
    let usable: Vec<_> = events.iter().zip(&curves).collect();
    let terms = dictionary::terms(&usable);
    assert!(terms.len() > 150, "{}", terms.len());
    for (term, coefficients) in
        (0..terms.len()).zip([[0.1, 0.0], [0.0, -2.0], [-0.3, 0.05]].iter().cycle())
    {
        let found = Description {
            chosen: vec![Chosen {
                term,
                thresholds: None,
                coefficients: *coefficients,
                shares: [0.5, 0.0],
                largest_pu: 0.1,
            }],
            squares_per_row: 4.0,
            held_out_share: None,
        };
        let text = effect_file::text(&terms, &found).unwrap();
        let parsed = EffectFile::parse(&text);
        assert!(parsed.is_ok(), "{text}\n{parsed:?}");
    }
}
