//! Each reason on a window made for it; the simulated sites and real recordings where at hand.

use super::*;
use crate::{
    disturbance::{
        Closing, DetectorOptions, Trigger,
        test_data::{directories, event_samples, json, phasors, shared_data},
        window_of_recording,
    },
    measurement::{Quality, Record, Sample, Site, record::grid_offset_ns},
};

const RATE_FPS: f64 = 50.0;
const ONSET: usize = 100;

/// Four seconds of a load with P = V^2 whose voltage dips by `dip_pu` for 0.2 s after two seconds.
fn dip(dip_pu: f64) -> Window {
    let sample = |k: usize| {
        let in_dip = (ONSET..ONSET + 10).contains(&k);
        let voltage_pu = if in_dip { 1.0 - dip_pu } else { 1.0 };
        Sample {
            voltage_pu,
            frequency_hz: 50.0,
            active_pu: 0.8 * voltage_pu * voltage_pu,
            reactive_pu: 0.2,
            negative_sequence_ratio: 0.0,
            quality: Quality::GOOD,
            ..Sample::missing(grid_offset_ns(k as f64, RATE_FPS))
        }
    };
    Window {
        id: "here".to_owned(),
        site: "here".to_owned(),
        record: Record {
            start_ns: 0,
            rate_fps: RATE_FPS,
            nominal_hz: 50.0,
            samples: (0..200).map(sample).collect(),
        },
        onset: ONSET,
        triggers: vec![Trigger::VoltageDip],
        closing: Closing::Recovered,
    }
}

fn changed(mut window: Window, change: impl Fn(usize, &mut Sample)) -> Window {
    for (k, sample) in window.record.samples.iter_mut().enumerate() {
        change(k, sample);
    }
    window
}

fn judged(window: &Window) -> Screening {
    screen(window, &ScreeningOptions::default())
}

fn refusals(window: &Window) -> Vec<&'static str> {
    labels(&judged(window).refusals)
}

fn labels(reasons: &[ScreeningReason]) -> Vec<&'static str> {
    reasons.iter().map(ScreeningReason::label).collect()
}

#[test]
fn a_clean_dip_is_usable_without_a_mark() {
    assert_eq!(judged(&dip(0.2)), Screening::default());
    assert_eq!(judged(&dip(0.01)), Screening::default());
}

#[test]
fn a_shallow_dip_is_refused_with_its_depth() {
    let refusal = judged(&dip(0.003)).refusals.remove(0);
    assert_eq!(
        refusal.to_string(),
        "the voltage changes by 0.0030 pu only, and a load's response is seen from 0.0080 pu on"
    );
}

#[test]
fn a_window_whose_frequency_moves_is_kept_with_a_steady_voltage() {
    let falling = |hertz: f64| {
        changed(dip(0.002), |k, s| {
            let since = k.saturating_sub(ONSET) as f64 / 100.0;
            s.frequency_hz -= hertz * since.min(1.0);
        })
    };
    assert!(refusals(&falling(0.3)).is_empty());
    assert!(refusals(&falling(0.05)).contains(&"too_shallow"));
    // One wild sample, and a frequency that is little but noise.
    let wild = changed(dip(0.002), |k, s| {
        s.frequency_hz += if k == ONSET + 5 { 2.0 } else { 0.0 };
    });
    assert!(refusals(&wild).contains(&"too_shallow"));
    let noisy = changed(dip(0.002), |k, s| {
        s.frequency_hz += 0.3 * ((k as f64 * 0.618_034).fract() - 0.5);
    });
    assert!(refusals(&noisy).contains(&"too_shallow"));
}

#[test]
fn a_voltage_that_is_little_but_noise_is_refused_and_a_swing_is_not() {
    // Golden-ratio steps: spread evenly, without a pattern from sample to sample.
    let noise = |k: usize| ((k as f64 * 0.618_034).fract() - 0.5) * 12.0_f64.sqrt();
    let noisy = |deviation: f64| changed(dip(0.1), |k, s| s.voltage_pu += deviation * noise(k));
    assert!(refusals(&noisy(0.3)).contains(&"too_shallow"));
    assert!(!refusals(&noisy(0.002)).contains(&"too_shallow"));
    let swing = changed(dip(0.1), |k, s| {
        s.voltage_pu += 0.05 * (k as f64 / 8.0).sin();
    });
    assert!(!refusals(&swing).contains(&"too_shallow"));
}

#[test]
fn many_bad_samples_are_refused_and_few_are_not() {
    let bad = |every: usize| {
        changed(dip(0.2), move |k, s| {
            if k.is_multiple_of(every) {
                s.quality = Quality::DATA_INVALID;
            }
        })
    };
    assert_eq!(refusals(&bad(4)), ["too_many_bad_samples"]);
    assert!(judged(&bad(4)).marks.is_empty());
    assert!(refusals(&bad(10)).is_empty());
    assert_eq!(labels(&judged(&bad(10)).marks), ["bad_samples"]);
}

#[test]
fn a_sample_lost_is_a_mark_at_the_onset_and_none_elsewhere() {
    let lost = |at: usize| {
        changed(dip(0.2), move |k, s| {
            if k == at {
                *s = Sample::missing(s.time_ns);
            }
        })
    };
    let at_onset = ScreeningReason::BadSamples {
        bad_share: 1.0 / dip(0.2).record.samples.len() as f64,
        at_onset: 1,
    };
    assert_eq!(labels(&judged(&lost(ONSET + 3)).marks), ["bad_samples"]);
    let sentence = judged(&lost(ONSET + 3)).marks.remove(0).to_string();
    assert_eq!(sentence, at_onset.to_string());
    assert_eq!(judged(&lost(0)), Screening::default());
}

#[test]
fn a_clock_out_of_step_is_a_mark() {
    let unsynchronised = changed(dip(0.2), |k, s| {
        if k < 3 {
            s.quality = Quality::NOT_SYNCHRONISED;
        }
    });
    let marked = judged(&unsynchronised);
    assert_eq!(labels(&marked.marks), ["clock_not_synchronised"]);
    assert!(marked.usable());
}

#[test]
fn generation_and_transit_are_not_a_load() {
    let generation = changed(dip(0.2), |_, s| s.active_pu = -s.active_pu);
    assert_eq!(refusals(&generation), ["not_a_load"]);
    let transit = changed(dip(0.2), |k, s| {
        if k > 150 {
            s.active_pu = -0.3;
        }
    });
    assert_eq!(refusals(&transit), ["not_a_load"]);
}

#[test]
fn a_load_switched_at_constant_voltage_does_not_follow_it() {
    let switched = changed(dip(0.02), |k, s| {
        s.active_pu = if k < ONSET { 0.8 } else { 0.5 };
    });
    assert_eq!(refusals(&switched), ["power_does_not_follow_voltage"]);
}

#[test]
fn what_is_lost_while_the_frequency_stays_away_is_an_answer_of_the_load() {
    let lost = |falls_by_hz: f64, for_samples: usize| {
        changed(dip(0.01), |k, s| {
            if k >= ONSET + 20 {
                s.active_pu *= 0.7;
            }
            if (ONSET + 5..ONSET + 5 + for_samples).contains(&k) {
                s.frequency_hz -= falls_by_hz;
            }
        })
    };
    assert!(refusals(&lost(0.3, 90)).is_empty());
    // A phase jump, as a fault inside the load makes one, or a frequency that hardly moves.
    for window in [lost(0.3, 5), lost(0.05, 90)] {
        assert_eq!(refusals(&window), ["power_does_not_follow_voltage"]);
    }
    // Any change that stands out may be enough; none is none.
    let any = ScreeningOptions {
        frequency_change_min_hz: 0.0,
        ..ScreeningOptions::default()
    };
    let steady = screen(&lost(0.0, 0), &any);
    assert_eq!(labels(&steady.refusals), ["power_does_not_follow_voltage"]);
}

#[test]
fn a_fault_inside_the_load_raises_its_power_while_the_voltage_is_low() {
    let inside = changed(dip(0.4), |k, s| {
        if (ONSET..ONSET + 10).contains(&k) {
            s.active_pu = 6.0;
        }
    });
    assert_eq!(refusals(&inside), ["power_does_not_follow_voltage"]);
}

#[test]
fn load_lost_after_a_deep_dip_is_no_objection() {
    let lost = changed(dip(0.4), |k, s| {
        if k >= ONSET + 10 {
            s.active_pu = 0.5;
        }
    });
    assert!(refusals(&lost).is_empty());
}

#[test]
fn a_short_or_unsteady_time_before_is_a_mark_and_none_is_a_refusal() {
    let mut short = dip(0.2);
    short.record.samples.drain(..90);
    short.onset -= 90;
    assert_eq!(labels(&judged(&short).marks), ["pre_event_too_short"]);
    assert!(refusals(&short).is_empty());
    let mut none = dip(0.2);
    none.record.samples.drain(..ONSET);
    none.onset = 0;
    assert!(refusals(&none).contains(&"pre_event_too_short"));

    let swinging = changed(dip(0.3), |k, s| {
        if k < ONSET {
            s.voltage_pu += 0.05 * (k as f64 / 10.0).sin();
        }
    });
    assert_eq!(labels(&judged(&swinging).marks), ["pre_event_not_steady"]);
    let strict = ScreeningOptions {
        refuse_unsteady: true,
        ..ScreeningOptions::default()
    };
    assert!(!screen(&swinging, &strict).usable());
}

#[test]
fn an_unbalanced_fault_is_marked_and_an_open_pole_refused() {
    let unbalanced = |ratio: f64| {
        changed(dip(0.2), move |k, s| {
            if (ONSET..ONSET + 10).contains(&k) {
                s.negative_sequence_ratio = ratio;
            }
        })
    };
    let marked = judged(&unbalanced(0.13));
    assert_eq!(
        (marked.usable(), labels(&marked.marks)),
        (true, vec!["unbalanced"])
    );
    assert_eq!(refusals(&unbalanced(0.6)), ["unbalanced"]);
    let without_channel = changed(dip(0.2), |_, s| s.negative_sequence_ratio = f64::NAN);
    assert_eq!(judged(&without_channel), Screening::default());
}

#[test]
fn zeros_and_nothing_are_refused() {
    let zeros = changed(dip(0.2), |_, s| {
        (s.voltage_pu, s.active_pu, s.reactive_pu) = (0.0, 0.0, 0.0);
    });
    assert_eq!(refusals(&zeros), ["no_voltage"]);
    let missing = changed(dip(0.2), |_, s| *s = Sample::missing(s.time_ns));
    assert_eq!(refusals(&missing), ["too_many_bad_samples"]);
    let unloaded = changed(dip(0.2), |_, s| s.active_pu = 0.001);
    assert_eq!(refusals(&unloaded), ["no_power"]);
    let mut empty = dip(0.2);
    empty.record.samples.clear();
    assert_eq!(refusals(&empty), ["too_many_bad_samples"]);
}

#[test]
fn one_wild_sample_changes_no_verdict() {
    let wild = changed(dip(0.2), |k, s| {
        if k == 150 {
            (s.active_pu, s.voltage_pu) = (-9.0, 7.0);
        }
    });
    assert_eq!(judged(&wild), Screening::default());
}

#[test]
fn of_the_simulated_events_only_shallow_ones_are_refused() {
    let Some(data) = shared_data("sites") else {
        return;
    };
    let (mut usable, mut faults) = (0, Vec::new());
    for directory in directories(&data.join("sites")) {
        let name = directory.file_name().unwrap().to_str().unwrap();
        let truth = json(&data.join("truth").join(format!("{name}.json")));
        let declared = json(&directory.join("site.json"));
        for event in truth["events"].as_array().unwrap() {
            let file = directory.join(event["file"].as_str().unwrap());
            let rate_fps = declared["sample_rate_fps"].as_f64().unwrap();
            let nominal_hz = declared["nominal_hz"].as_f64().unwrap();
            let screening = judged(&window_of(
                event_samples(&file, rate_fps),
                rate_fps,
                nominal_hz,
            ));
            usable += usize::from(screening.usable());
            let shallow = event["kind"] == "line";
            // What the stream did to a window is marked where the truth says that it did something.
            let of_the_stream = |mark: &ScreeningReason| {
                matches!(
                    mark,
                    ScreeningReason::BadSamples { .. }
                        | ScreeningReason::ClockNotSynchronised { .. }
                )
            };
            let whole = event["bad_samples"].is_null();
            let marked = screening.marks.iter().any(|m| whole || !of_the_stream(m));
            if marked || !screening.usable() && !shallow {
                faults.push(format!("{}: {screening:?}", file.display()));
            }
        }
    }
    println!("{usable} usable");
    assert!(faults.is_empty(), "{faults:#?}");
}

#[test]
fn of_the_real_recordings_the_loads_pass_and_the_others_are_refused() {
    let Some(data) = shared_data("recordings/reference_phasors") else {
        return;
    };
    let expected = [
        ("ru110_VL2", 50.0, None),
        ("ru110_VL3", 50.0, None),
        ("xtz_T1hv_seg0", 50.0, None),
        ("xtz_T1hv_seg1", 50.0, None),
        ("xtz_T2hv_seg0", 50.0, None),
        ("xtz_T2hv_seg1", 50.0, None),
        ("ymz_T1hv_seg0", 50.0, None),
        ("ymz_T1hv_seg1", 50.0, None),
        ("ymz_T2hv_seg0", 50.0, None),
        ("ymz_T2hv_seg1", 50.0, None),
        ("ru110_VL5", 50.0, Some("not_a_load")),
        ("oita_hv", 60.0, Some("power_does_not_follow_voltage")),
        ("c60", 50.0, Some("not_a_load")),
        ("strath275", 50.0, Some("unbalanced")),
    ];
    let folder = data.join("recordings/reference_phasors");
    for (name, nominal_hz, reason) in expected {
        let samples = phasors(&folder.join(format!("{name}.csv")));
        let found = refusals(&window_of(samples, 200.0, nominal_hz));
        match reason {
            None => assert!(found.is_empty(), "{name}: {found:?}"),
            Some(reason) => assert!(found.contains(&reason), "{name}: {found:?}"),
        }
    }
}

fn window_of(samples: Vec<Sample>, rate_fps: f64, nominal_hz: f64) -> Window {
    let site = Site {
        name: "here".to_owned(),
        s_base_mva: 1.0,
        v_base_kv: 1.0,
        nominal_hz,
    };
    let record = Record {
        start_ns: 0,
        rate_fps,
        nominal_hz,
        samples,
    };
    window_of_recording(&site, record, &DetectorOptions::default()).unwrap()
}
