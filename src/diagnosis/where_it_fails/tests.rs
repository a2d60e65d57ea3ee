//! The whole look at an event, on events whose failure is put there by hand.

use super::{
    Channel, ChannelSeries, EventSeries, Quantity, Segment, failure_of_series as of_series, pooled,
    segments::clearing_s,
};

const RATE_FPS: f64 = 60.0;
const NOISE: f64 = 0.001;
const ONSET_S: f64 = 1.0;

/// Normal to three digits: sums of twelve uniform numbers of a linear congruence.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// Ten seconds with a given voltage, and `missed(t)` that the model of P does not follow.
fn event(voltage: impl Fn(f64) -> f64, missed: impl Fn(f64) -> f64) -> EventSeries {
    let mut noise = Noise(7);
    let time_s: Vec<f64> = (0..600)
        .map(|k| f64::from(k) / RATE_FPS - ONSET_S)
        .collect();
    let mut channel = |missed: &dyn Fn(f64) -> f64| ChannelSeries {
        measured: (time_s.iter())
            .map(|&t| voltage(t) + missed(t) + NOISE * noise.next())
            .collect(),
        model: time_s.iter().map(|&t| voltage(t)).collect(),
        deviation: vec![NOISE; time_s.len()],
    };
    let jump = |t: f64| (voltage(t + 0.02) - voltage(t - 0.02)).abs() > 0.1;
    EventSeries {
        active: channel(&missed),
        reactive: channel(&|_| 0.0),
        voltage: time_s.iter().map(|&t| voltage(t)).collect(),
        frequency_deviation: vec![0.0; time_s.len()],
        used: vec![true; time_s.len()],
        near_edge: time_s.iter().map(|&t| jump(t)).collect(),
        jumps_s: Vec::new(),
        time_s,
    }
}

fn dip(t: f64) -> f64 {
    match t {
        t if (0.05..0.25).contains(&t) => 0.6,
        t if t >= 0.25 => 1.0 - 0.1 * (-(t - 0.25) / 0.4).exp(),
        _ => 1.0,
    }
}

#[test]
fn a_dip_is_cut_at_its_clearing() {
    let failure = of_series("e", event(dip, |_| 0.0));
    let cleared = failure.clearing_s.unwrap();
    assert!((cleared - 0.25).abs() < 1.0 / RATE_FPS, "{cleared}");
    let of_p: Vec<_> = (failure.segments.iter())
        .filter(|r| r.channel == Channel::Active)
        .collect();
    let counts: Vec<_> = of_p.iter().map(|r| (r.segment, r.samples)).collect();
    assert_eq!(counts[0], (Segment::Before, 60));
    assert_eq!(counts[2], (Segment::EarlyRecovery, 30));
    assert_eq!(counts.iter().map(|c| c.1).sum::<usize>(), 600);
    assert!((failure.lowest_voltage - 0.6).abs() < 1e-12);
}

#[test]
fn a_known_jump_gives_the_instant_of_the_clearing() {
    let mut series = event(dip, |_| 0.0);
    series.jumps_s = vec![0.047, 0.247];
    assert_eq!(clearing_s(&series), Some(0.247));
}

#[test]
fn the_last_of_two_clearings_counts() {
    let twice = |t: f64| if t < 1.5 { dip(t) } else { dip(t - 1.5) };
    let cleared = clearing_s(&event(twice, |_| 0.0)).unwrap();
    assert!((cleared - 1.75).abs() < 1.0 / RATE_FPS, "{cleared}");
}

#[test]
fn steps_ramps_and_swings_have_no_clearing_and_still_segments() {
    let step = |t: f64| if t < 0.05 { 1.0 } else { 0.95 };
    let ramp = |t: f64| 1.0 - 0.02 * t.clamp(0.0, 5.0);
    let swing = |t: f64| 1.0 - 0.05 * (6.0 * t.max(0.0)).sin();
    let undisturbed = |_: f64| 1.0;
    for (name, series) in [
        ("step", event(step, |_| 0.0)),
        ("ramp", event(ramp, |_| 0.0)),
        ("swing", event(swing, |_| 0.0)),
        ("undisturbed", event(undisturbed, |_| 0.0)),
    ] {
        let failure = of_series(name, series);
        assert_eq!(failure.clearing_s, None, "{name}");
        assert_eq!(failure.segments.len(), 10, "{name}");
        assert_eq!(
            failure.sentence, "P and Q follow within the noise.",
            "{name}"
        );
    }
}

#[test]
fn the_sentence_names_stretch_size_and_noise() {
    let missed = |t: f64| {
        if (0.65..1.45).contains(&t) {
            0.041
        } else {
            0.0
        }
    };
    let failure = of_series("e", event(dip, missed));
    assert_eq!(
        failure.sentence,
        "0.4-1.2 s after the clearing P is 4.1 % of P0 above the model, 41 times the noise; Q follows \
         within the noise."
    );
    assert!(failure.error_to_noise > 5.0, "{}", failure.error_to_noise);
}

#[test]
fn what_is_grave_is_many_times_the_noise_and_lasts() {
    let gravest = |size: f64, lasts_s: f64| {
        let missed = |t: f64| {
            if (0.65..0.65 + lasts_s).contains(&t) {
                size
            } else {
                0.0
            }
        };
        let series = event(dip, missed);
        super::sentence::gravest(&series, clearing_s(&series))
    };
    let told = gravest(-0.006, 0.5).unwrap();
    assert!(
        told.contains("P is 0.6") && told.contains("below"),
        "{told}"
    );
    assert_eq!(gravest(-0.006, 0.05), None);
    assert_eq!(gravest(-0.003, 0.5), None);
    assert_eq!(gravest(0.0, 0.5), None);
}

#[test]
fn a_failure_within_the_dip_is_told_from_the_onset() {
    let missed = |t: f64| {
        if (0.05..0.25).contains(&t) {
            -0.02
        } else {
            0.0
        }
    };
    let sentence = of_series("e", event(dip, missed)).sentence;
    assert!(
        sentence.contains("s after the onset P is 2.0 % of P0 below the model, 20 times"),
        "{sentence}"
    );
}

#[test]
fn a_failure_that_lasts_is_told_to_the_end() {
    let missed = |t: f64| if t >= 0.65 { 0.02 } else { 0.0 };
    let sentence = of_series("e", event(dip, missed)).sentence;
    assert!(
        sentence.starts_with("From 0.4 s after the clearing to the end P is 2.0 % of P0 above"),
        "{sentence}"
    );
}

#[test]
fn failure_at_the_edges_alone_is_said() {
    let missed = |t: f64| if (0.24..0.26).contains(&t) { 0.2 } else { 0.0 };
    let sentence = of_series("e", event(dip, missed)).sentence;
    assert!(sentence.contains("except near the edges"), "{sentence}");
}

#[test]
fn a_threshold_in_the_voltage_shows_as_dependence_on_it() {
    let swing = |t: f64| 1.0 - 0.05 * (9.0 * t.max(0.0)).sin() - 0.02 * (2.3 * t.max(0.0)).sin();
    let missed = |t: f64| if swing(t) < 0.97 { 0.02 } else { 0.0 };
    let found = of_series("e", event(swing, missed)).dependences;
    assert_eq!(
        (found[0].channel, found[0].quantity),
        (Channel::Active, Quantity::Voltage)
    );
    assert!(found[0].explained > 0.8, "{:?}", found[0]);
    let lowest = found[0].bins[0];
    assert!((lowest.1 - 0.02).abs() < 0.002, "{lowest:?}");
    let of_q = found.iter().filter(|d| d.channel == Channel::Reactive);
    for dependence in of_q {
        assert!(dependence.explained < 0.1, "{dependence:?}");
    }
}

#[test]
fn a_slow_residual_depends_on_the_time_since_the_clearing_and_noise_on_nothing() {
    let missed = |t: f64| {
        if t < 0.25 {
            0.0
        } else {
            0.02 * (-(t - 0.25) / 2.0).exp()
        }
    };
    let found = of_series("e", event(dip, missed)).dependences;
    let of_time = (found.iter())
        .find(|d| (d.channel, d.quantity) == (Channel::Active, Quantity::TimeSinceClearing))
        .unwrap();
    assert!(of_time.explained > 0.8, "{of_time:?}");
    for dependence in of_series("e", event(dip, |_| 0.0)).dependences {
        assert!(dependence.explained < 0.05, "{dependence:?}");
    }
}

#[test]
fn bins_hold_every_sample_once_and_equal_values_together() {
    let found = of_series("e", event(dip, |_| 0.0)).dependences;
    for dependence in found {
        let samples: usize = dependence.bins.iter().map(|bin| bin.3).sum();
        assert!((400..=540).contains(&samples), "{dependence:?}");
        assert!(
            dependence.bins.is_sorted_by(|a, b| a.0 < b.0),
            "{dependence:?}"
        );
    }
}

/// A series whose memory is `memory` per sample.
fn slow(noise: &mut Noise, memory: f64) -> Vec<f64> {
    let mut x = 0.0;
    let fresh = (1.0 - memory * memory).sqrt();
    (0..600)
        .map(|_| {
            x = memory * x + fresh * noise.next();
            x
        })
        .collect()
}

#[test]
fn a_residual_that_follows_the_voltage_is_correlated_at_its_delay() {
    let mut series = event(|_| 1.0, |_| 0.0);
    let motion = slow(&mut Noise(3), 0.9);
    for k in 0..600 {
        series.voltage[k] = 1.0 + 0.01 * motion[k];
        // Twelve samples late: 0.2 s.
        series.active.measured[k] += if k >= 12 { 0.01 * motion[k - 12] } else { 0.0 };
    }
    let failure = of_series("e", series);
    let found = &failure.cross_correlations[0];
    let (lag, peak) = (found.lags_s.iter().zip(&found.correlation))
        .max_by(|a, b| a.1.total_cmp(b.1))
        .unwrap();
    assert!((lag - 0.2).abs() < 1e-9, "{lag}");
    assert!(*peak > 0.9 && found.band < 0.6, "{peak} {}", found.band);
}

#[test]
fn the_band_holds_nineteen_of_twenty_correlations_of_slow_independent_series() {
    let mut noise = Noise(11);
    let (mut inside, mut all) = (0, 0);
    for _ in 0..40 {
        let mut series = event(|_| 1.0, |_| 0.0);
        let (motion, missed) = (slow(&mut noise, 0.9), slow(&mut noise, 0.9));
        for k in 0..600 {
            series.voltage[k] = 1.0 + 0.01 * motion[k];
            series.active.measured[k] += 0.01 * missed[k];
        }
        let failure = of_series("e", series);
        let found = &failure.cross_correlations[0];
        inside += (found.correlation.iter())
            .filter(|c| c.abs() <= found.band)
            .count();
        all += found.correlation.len();
        assert!(
            found.band > 0.12,
            "white noise would have 0.084: {}",
            found.band
        );
    }
    let share = f64::from(u32::try_from(inside).unwrap()) / f64::from(u32::try_from(all).unwrap());
    assert!((0.88..=0.99).contains(&share), "{share}");
}

#[test]
fn pooled_residuals_weigh_by_samples() {
    let quiet = of_series("a", event(dip, |_| 0.0));
    let off = of_series("b", event(dip, |t| if t > 2.25 { 0.01 } else { 0.0 }));
    let pool = pooled(&[quiet.clone(), off.clone()]);
    assert_eq!(pool.len(), 10);
    let after = pool.iter().find(|r| r.segment == Segment::After).unwrap();
    // Half of the samples are ten deviations off: sqrt((1 + 101) / 2) = 7.1.
    assert!((after.to_noise - 7.1).abs() < 0.4, "{after:?}");
    assert!((after.mean_pu - 0.005).abs() < 1e-4, "{after:?}");
    assert!(pooled(&[]).is_empty());
}

#[test]
fn events_without_a_single_number_are_no_reason_to_stop() {
    let nothing = of_series("none", EventSeries::default());
    assert!(nothing.segments.is_empty() && nothing.cross_correlations.is_empty());
    let mut series = event(dip, |_| 0.0);
    series.voltage.fill(f64::NAN);
    series.active.measured.fill(f64::NAN);
    series.reactive.deviation.fill(0.0);
    let failure = of_series("nan", series);
    assert!(failure.segments.is_empty(), "{:?}", failure.segments);
    assert!(!failure.error_to_noise.is_nan());
    let mut short = event(dip, |_| 0.0);
    for series in [
        &mut short.time_s,
        &mut short.voltage,
        &mut short.frequency_deviation,
    ] {
        series.truncate(61);
    }
    assert_eq!(of_series("short", short).segments.len(), 4);
}
