//! What `inspect` says of a recording and of a site folder.

use std::fs;

use super::*;

fn args(path: PathBuf, json: bool) -> InspectArgs {
    InspectArgs {
        path,
        json,
        code_page: None,
        utc_offset: None,
        lenient: false,
        frames: false,
    }
}

fn output(args: &InspectArgs) -> String {
    let mut out = Vec::new();
    run(args, &mut out).unwrap();
    String::from_utf8(out).unwrap()
}

/// 0.1 s of 50 Hz at 1 kHz: 110 kV and 100 A in phase.
fn write_recording(directory: &Path) -> PathBuf {
    use std::{f64::consts::TAU, fmt::Write as _};
    let mut text = "here,recorder,1999\n6,6A,0D\n".to_owned();
    for (n, name) in (1..).zip(["Ua", "Ub", "Uc", "Ia", "Ib", "Ic"]) {
        let unit = if n < 4 { "kV" } else { "A" };
        writeln!(text, "{n},{name},,,{unit},0.01,0,0,-99999,99998,1,1,P").unwrap();
    }
    text += "50\n1\n1000,100\n02/01/2020,00:00:01.0\n02/01/2020,00:00:01.0\nASCII\n1\n";
    let mut data = String::new();
    for n in 0..100_u32 {
        write!(data, "{},{}", n + 1, n * 1000).unwrap();
        for peak in [110.0 * (2.0_f64 / 3.0).sqrt(), 100.0 * 2.0_f64.sqrt()] {
            for k in [0.0, 1.0, 2.0] {
                let wave = (TAU * (0.05 * f64::from(n) - k / 3.0)).cos();
                write!(data, ",{:.0}", 100.0 * peak * wave).unwrap();
            }
        }
        data.push('\n');
    }
    let path = directory.join("x.CFG");
    fs::write(&path, text).unwrap();
    fs::write(directory.join("x.DAT"), data).unwrap();
    path
}

#[test]
fn recording_is_described_with_the_load_it_seems_to_hold() {
    let directory = tempfile::tempdir().unwrap();
    let path = write_recording(directory.path());
    let text = output(&args(path.clone(), false));
    for expected in [
        "COMTRADE 1999 ASCII",
        "start      2020-01-02T00:00:01Z",
        "100 at 1000.000 per second",
        "I* with U*",
        "begins at 109.999 kV, 19.05",
        "      [[site.recording]]\n      voltages = [\"Ua\",\"Ub\",\"Uc\"]\n",
    ] {
        assert!(text.contains(expected), "{expected} in\n{text}");
    }
    let json: Value = serde_json::from_str(&output(&args(path, true))).unwrap();
    assert_eq!(json["loads"][0]["current"][2], "Ic");
    let active_mw = json["loads"][0]["preview"]["active_mw"].as_f64().unwrap();
    // sqrt(3) 110 kV 100 A
    assert!((active_mw - 19.0526).abs() < 1e-2, "{active_mw}");
    // The table is what the configuration takes.
    let table = json["loads"][0]["table"].as_str().unwrap();
    let site = "[[site]]\nname = \"a\"\ns_base_mva = 10\nv_base_kv = 110\nnominal_hz = 50\n";
    let config = crate::config::Config::parse(&format!("{site}{table}"), "test");
    assert!(config.is_ok(), "{config:?}");
}

#[test]
fn clock_offset_moves_the_start() {
    let directory = tempfile::tempdir().unwrap();
    let mut args = args(write_recording(directory.path()), true);
    args.utc_offset = Some(3.0);
    let json: Value = serde_json::from_str(&output(&args)).unwrap();
    assert_eq!(json["start_utc"], "2020-01-01T21:00:01Z");
    args.utc_offset = Some(30.0);
    let error = run(&args, &mut Vec::new()).unwrap_err();
    assert_eq!(error.to_string(), "utc offset is 30 h, must be -14 to 14");
}

#[test]
fn site_folder_is_described_with_onset_depth_and_bad_samples() {
    use std::fmt::Write as _;
    let directory = tempfile::tempdir().unwrap();
    let site = r#"{"site": "s", "sample_rate_fps": 50, "nominal_hz": 50, "base_mva": 20,
        "base_kv": 23, "events": [{"file": "event_01.csv", "utc": "2026-02-11T03:07:00Z"}]}"#;
    fs::write(directory.path().join("site.json"), site).unwrap();
    let mut table = "time_s,v_pu,freq_hz,p_pu,q_pu,stat\n".to_owned();
    for n in 0..300_u32 {
        let v = if (100..110).contains(&n) { 0.8 } else { 1.0 };
        let stat = if n == 200 { 32768 } else { 0 };
        writeln!(table, "{:.2},{v},50.0,0.9,0.3,{stat}", f64::from(n) / 50.0).unwrap();
    }
    fs::write(directory.path().join("event_01.csv"), table).unwrap();
    let path = directory.path().to_owned();
    let text = output(&args(path.join("site.json"), false));
    assert!(text.contains("onset at 2.000 s"), "{text}");
    assert!(text.contains("bad samples: invalid 1"), "{text}");
    let json: Value = serde_json::from_str(&output(&args(path, true))).unwrap();
    let depth = json["events"][0]["depth_pu"].as_f64().unwrap();
    assert!((depth - 0.2).abs() < 1e-12);
    assert_eq!(json["events"][0]["quality"]["invalid"], 1);
}

#[test]
fn what_is_neither_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let text = directory.path().join("notes.txt");
    fs::write(&text, "hello").unwrap();
    let error = run(&args(text, false), &mut Vec::new()).unwrap_err();
    assert!(
        error
            .to_string()
            .ends_with("is not named .cfg, .dat or .cff")
    );
    let error = run(&args(directory.path().to_owned(), false), &mut Vec::new()).unwrap_err();
    assert!(error.to_string().contains("site.json"), "{error}");
}

#[test]
fn a_file_of_frames_is_described_with_a_table_that_the_configuration_takes() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let frames = root.join("fuzz/corpus/c37118_messages/configured");
    let text = output(&args(frames.clone(), false));
    assert!(text.contains("5 frames, 4 of data"), "{text}");
    let lines = text
        .lines()
        .skip_while(|line| line.trim() != "[[site.c37118]]");
    let table: Vec<&str> = lines.map(str::trim).collect();
    let bases = "[[site]]\nname = \"n\"\ns_base_mva = 1\nv_base_kv = 1\nnominal_hz = 60\n";
    let written = format!("{bases}{}", table.join("\n"));
    let config = crate::config::Config::parse(&written, "proposed").unwrap();
    assert_eq!(config.sites[0].streams.len(), 1);
    let json: Value = serde_json::from_str(&output(&args(frames, true))).unwrap();
    let phasors = &json["configurations"][0]["pmus"][0]["phasors"];
    assert_eq!(phasors[0]["name"], "V1");
}

/// The frames of the corpus: a configuration and four of data.
fn corpus() -> Vec<u8> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    fs::read(root.join("fuzz/corpus/c37118_messages/configured")).unwrap()
}

fn of_bytes(bytes: &[u8], json: bool) -> Result<String, Error> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("frames");
    fs::write(&path, bytes).unwrap();
    let mut args = args(path, json);
    args.frames = json;
    let mut out = Vec::new();
    run(&args, &mut out)?;
    Ok(String::from_utf8(out).unwrap())
}

#[test]
fn every_frame_is_told_with_its_numbers() {
    let json: Value = serde_json::from_str(&of_bytes(&corpus(), true).unwrap()).unwrap();
    let contents = json["contents"].as_array().unwrap();
    assert_eq!(contents.len(), 5, "{contents:?}");
    assert_eq!(contents[0]["kind"], "CFG-2");
    for frame in &contents[1..] {
        let pmu = &frame["pmus"][0];
        assert_eq!(pmu["phasors"][0]["name"], "V1");
        assert!(pmu["phasors"][0]["magnitude"].as_f64().unwrap() > 0.0);
        assert!((pmu["frequency_hz"].as_f64().unwrap() - 60.0).abs() < 1.0);
    }
}

#[test]
fn what_is_wrong_with_a_file_of_frames_is_said() {
    let whole = corpus();
    let length = |at: usize| usize::from(u16::from_be_bytes([whole[at + 2], whole[at + 3]]));
    let first = length(0);

    let error = of_bytes(&whole[..first - 1], false).unwrap_err();
    let expected = format!("FRAMESIZE: says {first} bytes, {} were received", first - 1);
    assert!(error.to_string().contains(&expected), "{error}");

    // The first data frame has a wrong check word, the last one is cut off.
    let mut damaged = whole[..whole.len() - 3].to_vec();
    damaged[first + length(first) - 1] ^= 1;
    let text = of_bytes(&damaged, false).unwrap();
    assert!(text.contains("3 frames, 2 of data"), "{text}");
    assert!(text.contains("1 with a wrong check word"), "{text}");
    assert!(text.contains("begin a frame and do not end it"), "{text}");

    let text = of_bytes(&whole[first..], false).unwrap();
    let expected = "4 of data before a configuration of their stream";
    assert!(text.contains(expected), "{text}");
}
