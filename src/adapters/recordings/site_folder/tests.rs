//! Site folders of our own, and onsets on the simulated sites where they are there.

use std::{fs, path::PathBuf};

use super::*;
use crate::measurement::{Quality, Record, Sample, Site};

const SITE: &str = r#"{"site": "s", "sample_rate_fps": 10, "nominal_hz": 50, "base_mva": 20,
 "base_kv": 23, "events": [{"file": "event_01.csv", "utc": "2026-02-11T03:07:00Z"}]}"#;

fn folder(site: &str, events: &[(&str, &str)]) -> tempfile::TempDir {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("site.json"), site).unwrap();
    for (name, text) in events {
        fs::write(directory.path().join(name), text).unwrap();
    }
    directory
}

fn load(site: &str, events: &[(&str, &str)]) -> Result<SiteFolder, Error> {
    load_events(folder(site, events).path())
}

#[test]
fn rows_lie_on_the_grid_by_their_time_and_gaps_are_missing_samples() {
    let table = "time_s,v_pu,freq_hz,p_pu,q_pu,angle_deg,stat\n\
        0.0,1.0,50.0,0.9,0.3,-18,0\n0.1,,,,,,32768\n0.2,1.2,50.2,,0.3,-18,0\n\
        0.5,1.5,50.5,0.9,0.3,-18,0x2000\n0.4,1.4,50.4,0.9,0.3,-18,16\n0.4,9,9,9,9,9,0\n\
        0.6,nan,50.6,0.9,0.3,-18,0\n0.7,1.7,x,0.9,0.3,-18,0\nx,1,1,1,1,1,0\n0.8,1.8\n";
    let folder = load(SITE, &[("event_01.csv", table)]).unwrap();
    let event = &folder.events[0];
    let samples = &event.record.samples;
    assert_eq!(event.utc_ns, Some(1_770_779_220_000_000_000));
    assert_eq!(samples.len(), 9);
    assert_eq!(samples[3].time_ns, 1_770_779_220_300_000_000);
    let usable: Vec<usize> = (0..9).filter(|&k| samples[k].usable()).collect();
    assert_eq!(usable, [0, 5]);
    assert_eq!(samples[1].quality, Quality::MISSING | Quality::DATA_INVALID);
    assert_eq!(samples[2].quality, Quality::NOT_FINITE);
    assert_eq!(samples[3].quality, Quality::MISSING);
    assert_eq!(samples[4].quality, Quality::STALE);
    assert_eq!(samples[5].quality, Quality::NOT_SYNCHRONISED);
    assert!((samples[0].angle_rad + 0.1 * std::f64::consts::PI).abs() < 1e-12);
    let expected = Intake {
        rows: 10,
        bad_rows: 1,
        bad_cells: 2,
        first_bad: Some((9, "freq_hz")),
        duplicates: 1,
        out_of_order: 1,
        off_grid: 0,
        gaps: 1,
    };
    assert_eq!(event.intake, expected);
}

#[test]
fn optional_columns_and_the_list_of_events_may_be_left_out() {
    let site = r#"{"site": "s", "sample_rate_fps": 10, "nominal_hz": 50, "base_mva": 20,
        "base_kv": 23}"#;
    let table = "q_pu,p_pu,freq_hz,v_pu,time_s\n0.3,0.9,50,1,0\n0.3,0.9,50,1,0.1\n";
    let events = [
        ("event_02.csv", table),
        ("event_01.csv", table),
        ("other.csv", table),
    ];
    let folder = load(site, &events).unwrap();
    let names: Vec<&str> = folder.events.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["event_01", "event_02"]);
    assert!(folder.events[1].record.start_ns > folder.events[0].record.start_ns);
    assert!(
        folder
            .events
            .iter()
            .all(|e| e.record.samples.iter().all(Sample::usable))
    );
    assert_eq!(folder.notes.len(), 2, "no dates");
}

#[test]
fn what_cannot_be_used_at_all_is_said_with_file_line_and_column() {
    let good = "time_s,v_pu,freq_hz,p_pu,q_pu\n0,1,50,1,0\n0.1,1,50,1,0\n";
    let say = |site: &str, table: &str| {
        load(site, &[("event_01.csv", table)])
            .unwrap_err()
            .to_string()
    };
    let replaced = |from, to| say(&SITE.replace(from, to), good);
    assert!(replaced("\"base_kv\": 23, ", "").contains("missing field `base_kv`"));
    assert!(
        replaced("\"base_kv\": 23", "\"base_kv\": -1").contains("base_kv is '-1', must be above 0")
    );
    assert!(replaced("\"s\"", "\"a/b\"").contains("site is 'a/b'"));
    assert!(replaced("03:07:00Z", "25:00:00Z").contains("utc is '2026-02-11T25:00:00Z'"));
    assert!(replaced("event_01.csv", "event_07.csv").contains("event_07.csv"));
    assert!(say(SITE, &good.replace("q_pu", "q")).contains("event_01.csv line 1: no column q_pu"));
    assert!(say(SITE, "time_s,v_pu,freq_hz,p_pu,q_pu\n").contains("no row with a usable time_s"));
    let far = say(SITE, &good.replace("0.1,", "1e9,"));
    assert!(far.contains("line 3, column time_s: 1000000000 s"), "{far}");
    let rate = say(
        &SITE.replace(": 10,", ": 3,"),
        &(good.to_owned() + "0.2,1,50,1,0\n0.3,1,50,1,0\n"),
    );
    assert!(rate.contains("do not fit 3 rows per second"), "{rate}");
}

#[test]
fn event_that_cannot_be_used_is_left_out_with_a_note() {
    let site = SITE.replace("}]", "}, {\"file\": \"event_02.csv\"}]");
    let good = "time_s,v_pu,freq_hz,p_pu,q_pu\n0,1,50,1,0\n0.1,1,50,1,0\n";
    let folder = load(
        &site,
        &[("event_01.csv", good), ("event_02.csv", "time_s\n1\n")],
    )
    .unwrap();
    assert_eq!(folder.events.len(), 1);
    assert!(
        folder.notes[0]
            .to_string()
            .contains("event_02.csv line 1: no column v_pu")
    );
}

/// Ten seconds at 60 per second with `value(k)` for voltage and frequency.
fn record(value: impl Fn(usize) -> (f64, f64)) -> Record {
    let mut record = Record {
        start_ns: 0,
        rate_fps: 60.0,
        nominal_hz: 60.0,
        samples: Vec::new(),
    };
    for k in 0..600 {
        let (voltage_pu, frequency_hz) = value(k);
        let sample = Sample {
            voltage_pu,
            frequency_hz,
            active_pu: 0.9,
            reactive_pu: 0.3,
            quality: Quality::GOOD,
            ..Sample::missing(record.time_ns(k))
        };
        record.samples.push(sample);
    }
    record
}

/// A deterministic ripple that stands for noise.
fn ripple(k: usize) -> f64 {
    let k = k as f64;
    (0.7 * k).sin() + (1.9 * k + 1.0).sin()
}

#[test]
fn onset_is_the_first_sample_of_the_edge_and_no_spike_or_noise() {
    let dip = |k: usize| match k {
        40 => 0.5,
        95 => 0.98,
        96..=110 => 0.8,
        _ => 1.0 + 0.0003 * ripple(k),
    };
    assert_eq!(onset(&record(|k| (dip(k), 60.0))), Some(95));
    assert_eq!(onset(&record(|k| (1.0 + 0.0003 * ripple(k), 60.0))), None);
}

#[test]
fn slow_departure_is_found_before_it_crosses_the_whole_band() {
    let drift = |k: usize| 60.0 - 0.0002 * (k.max(120) - 120) as f64 + 0.0005 * ripple(k);
    let found = onset(&record(|k| (1.0, drift(k)))).unwrap();
    assert!((130..=170).contains(&found), "{found}");
}

#[test]
fn window_of_a_recording_is_the_whole_record() {
    let site = Site {
        name: "s".to_owned(),
        s_base_mva: 1.0,
        v_base_kv: 1.0,
        nominal_hz: 60.0,
    };
    let record = record(|k| (if k < 120 { 1.0 } else { 0.9 }, 60.0));
    let window = window(&site, &record);
    assert_eq!((window.onset, window.record.samples.len()), (120, 600));
    assert_eq!(window.id, "s-2000000000");
}

#[test]
fn written_folder_reads_back_the_same() {
    let directory = tempfile::tempdir().unwrap();
    let site = Site {
        name: "s".to_owned(),
        s_base_mva: 20.0,
        v_base_kv: 23.0,
        nominal_hz: 60.0,
    };
    let mut original = record(|k| (1.0 + 0.01 * ripple(k), 60.0 + 0.01 * ripple(k)));
    original.start_ns = 1_770_779_220_000_000_000;
    for k in 0..600 {
        original.samples[k].time_ns = original.time_ns(k);
        original.samples[k].angle_rad = 0.1 * ripple(k);
    }
    original.samples[7] = Sample::missing(original.time_ns(7));
    original.samples[9].active_pu = f64::NAN;
    original.samples[9].quality = Quality::NOT_FINITE;
    original.samples[11].quality = Quality::NOT_SYNCHRONISED;
    let event = FolderEvent {
        name: "event_01".to_owned(),
        utc_ns: Some(original.start_ns),
        record: original.clone(),
        intake: Intake::default(),
    };
    write(directory.path(), &site, 60.0, &[event]).unwrap();
    let folder = load_events(directory.path()).unwrap();
    assert_eq!((folder.site, folder.rate_fps), (site, 60.0));
    assert_eq!(folder.events[0].record.start_ns, original.start_ns);
    for (found, expected) in folder.events[0]
        .record
        .samples
        .iter()
        .zip(&original.samples)
    {
        assert_eq!(
            (found.time_ns, found.quality),
            (expected.time_ns, expected.quality)
        );
        for channel in crate::measurement::Channel::ALL {
            let (found, expected) = (found.value(channel), expected.value(channel));
            assert!((found - expected).abs() < 1e-9 || found.is_nan() && expected.is_nan());
        }
    }
}

#[test]
fn onsets_of_simulated_sites_lie_at_the_disturbance() {
    let shared = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    let Ok(entries) = fs::read_dir(shared.join("sites")) else {
        println!("skipped: no sites beside the project");
        return;
    };
    let mut sites: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    sites.sort();
    let mut off_s = Vec::new();
    for site in &sites {
        let folder = load_events(site).unwrap();
        let name = format!("truth/{}.json", folder.site.name);
        let Ok(truth) = fs::read(shared.join(&name)) else {
            continue;
        };
        let truth: serde_json::Value = serde_json::from_slice(&truth).unwrap();
        let truths = truth["events"].as_array().unwrap();
        for (event, truth) in folder.events.iter().zip(truths) {
            let Some(begins_s) = truth["t_event"].as_f64() else {
                continue;
            };
            let onset_s = onset(&event.record).map(|k| k as f64 / folder.rate_fps);
            off_s.push(onset_s.map_or(f64::INFINITY, |s| s - begins_s));
        }
    }
    off_s.sort_by(f64::total_cmp);
    let (first, last) = (off_s[0], off_s[off_s.len() - 1]);
    println!(
        "{} onsets, {first:.3} to {last:.3} s from t_event",
        off_s.len()
    );
    // The clock of t_event runs some 50 ms behind that of the tables: their edges show it. The
    // spread is what the onset adds: less than three samples and the two cycles of the filter.
    assert!(last - first < 0.06, "{off_s:?}");
}
