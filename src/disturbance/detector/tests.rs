//! Synthetic streams, and the simulated sites where they are at hand.

use std::path::Path;

use super::*;
use crate::disturbance::test_data::{directories, event_samples, json, shared_data};
use crate::measurement::{
    Channel, Concentrator, ConcentratorOptions, Quality, SampleBatch, record::grid_offset_ns,
};

const START_NS: i64 = 1_770_000_000_000_000_000;
const RATE_FPS: f64 = 60.0;

fn site() -> Site {
    Site {
        name: "here".to_owned(),
        s_base_mva: 100.0,
        v_base_kv: 110.0,
        nominal_hz: 60.0,
    }
}

/// A steady load with 0.1 % voltage noise and 1 mHz frequency noise, from a fixed congruential
/// generator.
fn steady(seconds: f64) -> Vec<Sample> {
    let mut state = 20_261_121_u64;
    let mut normal = || {
        (0..12)
            .map(|_| {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (state >> 40) as f64 / f64::from(1 << 24)
            })
            .sum::<f64>()
            - 6.0
    };
    samples_of(seconds, |_| Sample {
        voltage_pu: 0.99 + 0.001 * normal(),
        frequency_hz: 60.0 + 0.001 * normal(),
        active_pu: 0.9,
        reactive_pu: 0.3,
        quality: Quality::GOOD,
        ..Sample::missing(0)
    })
}

fn samples_of(seconds: f64, mut at: impl FnMut(f64) -> Sample) -> Vec<Sample> {
    let mut samples = Vec::new();
    while (samples.len() as f64) < seconds * RATE_FPS {
        let k = samples.len() as f64;
        let time_ns = START_NS + grid_offset_ns(k, RATE_FPS);
        samples.push(Sample {
            time_ns,
            ..at(k / RATE_FPS)
        });
    }
    samples
}

/// Changes the samples from second `from_s` to second `until_s`.
fn between(samples: &mut [Sample], from_s: f64, until_s: f64, change: impl Fn(f64, &mut Sample)) {
    for (k, sample) in samples.iter_mut().enumerate() {
        let time_s = k as f64 / RATE_FPS;
        if time_s >= from_s - 1e-9 && time_s < until_s - 1e-9 {
            change(time_s, sample);
        }
    }
}

fn windows_with(options: DetectorOptions, samples: &[Sample]) -> Vec<Window> {
    let mut detector = Detector::new(&site(), options);
    detector.begin(RATE_FPS);
    let mut windows: Vec<Window> = samples.iter().filter_map(|s| detector.push(*s)).collect();
    windows.extend(detector.flush(Closing::StreamSilent));
    windows
}

fn windows(samples: &[Sample]) -> Vec<Window> {
    windows_with(DetectorOptions::default(), samples)
}

/// Onset and triggers of each window: little enough to be printed by a failing test.
fn summaries(windows: &[Window]) -> Vec<(f64, Vec<Trigger>)> {
    windows
        .iter()
        .map(|w| (onset_s(w), w.triggers.clone()))
        .collect()
}

fn onset_s(window: &Window) -> f64 {
    (window.onset_ns() - START_NS) as f64 / 1e9
}

#[test]
fn noise_alone_opens_no_window() {
    assert_eq!(summaries(&windows(&steady(600.0))), []);
}

#[test]
fn a_dip_gives_one_window_with_the_time_before_and_after_it() {
    let mut samples = steady(30.0);
    between(&mut samples, 10.0, 10.15, |_, s| s.voltage_pu -= 0.3);
    let windows = windows(&samples);
    assert_eq!(windows.len(), 1);
    let window = &windows[0];
    assert!((onset_s(window) - 10.0).abs() < 1e-6, "{}", onset_s(window));
    assert_eq!(window.triggers[0], Trigger::VoltageDip);
    assert_eq!(window.closing, Closing::Recovered);
    assert_eq!(window.onset, 120, "2 s before the onset");
    let after_s = (window.record.samples.len() - 1 - window.onset) as f64 / RATE_FPS;
    assert!((8.1..9.5).contains(&after_s), "{after_s}");
    assert_eq!(window.id, "here-20260202T024010.000Z");
}

#[test]
fn a_step_of_one_percent_and_a_phase_jump_are_found() {
    let mut stepped = steady(20.0);
    between(&mut stepped, 8.0, 20.0, |_, s| s.voltage_pu -= 0.01);
    let found = windows(&stepped);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].triggers, [Trigger::VoltageStep]);
    assert!((onset_s(&found[0]) - 8.0).abs() < 2.1 / RATE_FPS);

    // 0.04 Hz for three samples: the angle turns by 0.7 degrees.
    let mut jumped = steady(20.0);
    between(&mut jumped, 8.0, 8.05, |_, s| s.frequency_hz -= 0.04);
    let found = windows(&jumped);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].triggers, [Trigger::PhaseJump]);
    assert!((onset_s(&found[0]) - 8.0).abs() < 2.1 / RATE_FPS);
}

#[test]
fn a_falling_frequency_is_found_by_rate_and_by_distance() {
    let mut samples = steady(30.0);
    between(&mut samples, 10.0, 11.0, |t, s| {
        s.frequency_hz -= 0.4 * (t - 10.0);
    });
    between(&mut samples, 11.0, 30.0, |_, s| s.frequency_hz -= 0.4);
    let found = windows(&samples);
    assert_eq!(found.len(), 1);
    for trigger in [
        Trigger::RateOfChangeOfFrequency,
        Trigger::FrequencyExcursion,
    ] {
        assert!(
            found[0].triggers.contains(&trigger),
            "{:?}",
            found[0].triggers
        );
    }
    assert!(onset_s(&found[0]) > 9.9 && onset_s(&found[0]) < 10.5);
}

#[test]
fn spikes_and_phase_jumps_are_no_rate_of_change() {
    let only_rate = DetectorOptions {
        phase_jump_deg: None,
        step_pu: None,
        ..DetectorOptions::default()
    };
    let mut samples = steady(20.0);
    between(&mut samples, 5.0, 5.01, |_, s| s.frequency_hz += 5.0);
    between(&mut samples, 10.0, 10.06, |_, s| s.frequency_hz -= 0.5);
    assert_eq!(summaries(&windows_with(only_rate, &samples)), []);
}

#[test]
fn one_wild_sample_opens_no_window() {
    let mut samples = steady(20.0);
    between(&mut samples, 5.0, 5.01, |_, s| s.voltage_pu = 0.2);
    between(&mut samples, 8.0, 8.01, |_, s| s.frequency_hz = 63.0);
    assert_eq!(summaries(&windows(&samples)), []);
}

#[test]
fn bad_and_missing_samples_open_no_window() {
    let mut samples = steady(20.0);
    between(&mut samples, 5.0, 5.5, |_, s| {
        s.voltage_pu = 0.1;
        s.frequency_hz = 55.0;
        s.quality = Quality::DATA_INVALID;
    });
    between(&mut samples, 9.0, 9.5, |_, s| {
        *s = Sample::missing(s.time_ns);
    });
    assert_eq!(summaries(&windows(&samples)), []);
}

#[test]
fn a_trigger_switched_off_opens_no_window() {
    let off = DetectorOptions {
        dip_ratio: None,
        swell_ratio: None,
        step_pu: None,
        phase_jump_deg: None,
        frequency_deviation_hz: None,
        rocof_hz_per_s: None,
        ..DetectorOptions::default()
    };
    let mut samples = steady(20.0);
    between(&mut samples, 8.0, 9.0, |_, s| {
        s.voltage_pu = 0.5;
        s.frequency_hz = 58.0;
    });
    assert_eq!(summaries(&windows_with(off, &samples)), []);
}

#[test]
fn disturbances_closer_than_the_post_trigger_time_share_a_window() {
    let mut samples = steady(60.0);
    for at_s in [10.0, 16.0, 45.0] {
        between(&mut samples, at_s, at_s + 0.1, |_, s| s.voltage_pu -= 0.2);
    }
    let found = windows(&samples);
    let onsets: Vec<f64> = found.iter().map(onset_s).map(f64::round).collect();
    assert_eq!(onsets, [10.0, 45.0]);
    assert!(found[0].record.duration_s() > 15.0);
}

#[test]
fn a_lasting_dip_is_closed_at_the_longest_and_does_not_open_again() {
    let mut samples = steady(200.0);
    between(&mut samples, 10.0, 200.0, |_, s| {
        s.voltage_pu -= 0.25;
        s.frequency_hz -= 0.5;
    });
    for reference in VoltageReference::ALL {
        let options = DetectorOptions {
            voltage_reference: reference,
            ..DetectorOptions::default()
        };
        let found = windows_with(options, &samples);
        assert_eq!(found.len(), 1, "{reference:?}");
        assert_eq!(found[0].closing, Closing::LongestReached);
        assert!((found[0].record.duration_s() - 30.0).abs() < 0.1);
    }
}

#[test]
fn a_restart_of_the_stream_closes_the_window_and_forgets_what_was_before() {
    let mut samples = steady(12.0);
    between(&mut samples, 10.0, 10.2, |_, s| s.voltage_pu -= 0.3);
    let run = |samples: Vec<Sample>| Run {
        restarted: true,
        rate_fps: RATE_FPS,
        samples,
        missing: 0,
        incomplete: 0,
    };
    let mut detector = Detector::new(&site(), DetectorOptions::default());
    assert_eq!(detector.state(), DetectorState::NoData);
    assert_eq!(summaries(&detector.push_run(&run(samples))), []);
    assert!(matches!(detector.state(), DetectorState::Open { .. }));
    // Another recording at a lower voltage: no dip.
    let mut lower = steady(10.0);
    between(&mut lower, 0.0, 10.0, |_, s| s.voltage_pu -= 0.3);
    let found = detector.push_run(&run(lower));
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].closing, Closing::StreamGap);
    assert!(matches!(detector.state(), DetectorState::Idle { .. }));
}

#[test]
fn a_recorder_that_keeps_a_tenth_of_a_second_before_the_fault_is_enough() {
    let mut samples = steady(3.0);
    between(&mut samples, 0.1, 0.2, |_, s| s.voltage_pu -= 0.15);
    let found = windows(&samples);
    assert_eq!(found.len(), 1);
    assert_eq!(found[0].onset, 6);
}

#[test]
fn windows_do_not_depend_on_how_the_samples_arrive() {
    let mut samples = steady(30.0);
    between(&mut samples, 10.0, 10.15, |_, s| s.voltage_pu -= 0.3);
    let found = |batch_length: usize, swapped: bool| {
        let mut batches: Vec<SampleBatch> = samples.chunks(batch_length).map(batch_of).collect();
        if swapped {
            batches.chunks_mut(2).for_each(<[SampleBatch]>::reverse);
        }
        let mut concentrator = Concentrator::new(&site(), ConcentratorOptions::default());
        let mut detector = Detector::new(&site(), DetectorOptions::default());
        let mut windows = Vec::new();
        for batch in &batches {
            concentrator.push(batch);
            for run in concentrator.drain() {
                windows.extend(detector.push_run(&run));
            }
        }
        windows.iter().map(|w| format!("{w:?}")).collect::<Vec<_>>()
    };
    let orderly = found(6, false);
    assert_eq!(orderly.len(), 1);
    assert!(found(6, true) == orderly);
    assert!(found(1, false) == orderly);
    assert!(found(600, false) == orderly);
}

fn batch_of(samples: &[Sample]) -> SampleBatch {
    SampleBatch {
        site: "here".to_owned(),
        stream: "pmu".to_owned(),
        sequence: None,
        start_ns: samples[0].time_ns,
        rate_fps: RATE_FPS,
        channels: Channel::ALL
            .iter()
            .filter(|c| !c.optional())
            .map(|c| (*c, samples.iter().map(|s| s.value(*c)).collect()))
            .collect(),
        quality: samples.iter().map(|s| s.quality).collect(),
    }
}

/// The files' time zero lies 0.05 s after the simulations'. The phasor filter reaches 2 cycles.
const TRIMMED_S: f64 = 0.05;

#[test]
fn every_event_of_the_simulated_sites_gives_one_window_at_its_edge() {
    let Some(data) = shared_data("sites") else {
        return;
    };
    let mut events = 0;
    let mut faults = Vec::new();
    for folder in ["sites", "demo"] {
        for directory in directories(&data.join(folder)) {
            let name = directory.file_name().unwrap().to_str().unwrap().to_owned();
            let truth = json(&data.join("truth").join(format!("{name}.json")));
            let declared = json(&directory.join("site.json"));
            for event in truth["events"].as_array().unwrap() {
                events += 1;
                if let Some(fault) = fault_of(&directory, &declared, event) {
                    faults.push(fault);
                }
            }
        }
    }
    println!("{events} events");
    assert!(faults.is_empty(), "{faults:#?}");
}

/// What is wrong with the windows of one event file, if anything.
fn fault_of(
    directory: &Path,
    declared: &serde_json::Value,
    event: &serde_json::Value,
) -> Option<String> {
    let rate_fps = declared["sample_rate_fps"].as_f64().unwrap();
    let nominal_hz = declared["nominal_hz"].as_f64().unwrap();
    let file = directory.join(event["file"].as_str().unwrap());
    let site = Site {
        nominal_hz,
        ..site()
    };
    let mut detector = Detector::new(&site, DetectorOptions::default());
    detector.begin(rate_fps);
    let mut windows = Vec::new();
    for sample in event_samples(&file, rate_fps) {
        windows.extend(detector.push(sample));
    }
    windows.extend(detector.flush(Closing::RecordingEnded));
    let edge_s = event["t_event"].as_f64().unwrap() - TRIMMED_S;
    let [window] = &windows[..] else {
        return Some(format!("{}: {} windows", file.display(), windows.len()));
    };
    let off_s = window.onset_ns() as f64 / 1e9 - edge_s;
    let tolerance_s = f64::max(2.0 / rate_fps, 2.0 / nominal_hz);
    (off_s.abs() > tolerance_s).then(|| format!("{}: onset off by {off_s:.3} s", file.display()))
}
