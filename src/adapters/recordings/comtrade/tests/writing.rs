//! What is written is read back: values, times, texts, contacts.

use std::process::Command;

use crate::adapters::recordings::comtrade::{
    AnalogChannel, DataFormat, DigitalChannel, Encoded, LeapSecond, Options, Recording, Revision,
    Scaling, Segment, TimeCode, decode, decode_container, encode, encode_container, read, write,
};

const FORMATS: [DataFormat; 4] = [
    DataFormat::Ascii,
    DataFormat::Binary,
    DataFormat::Binary32,
    DataFormat::Float32,
];

fn recording() -> Recording {
    let samples = 120;
    let wave = |scale: f64, offset: f64| -> Vec<f64> {
        (0..samples)
            .map(|n| offset + scale * (f64::from(n) * 0.3).sin())
            .collect()
    };
    let channel = |number, name: &str, unit: &str, values| AnalogChannel {
        number,
        name: name.to_owned(),
        phase: "A".to_owned(),
        circuit: "T1".to_owned(),
        unit: unit.to_owned(),
        skew_us: 0.0,
        primary: Some(110.0),
        secondary: Some(0.1),
        scaling: Scaling::Primary,
        values,
    };
    let mut current = wave(600.0, 0.0);
    current[7] = f64::NAN;
    let contact = |number: u32, changes: &[usize]| DigitalChannel {
        number,
        name: format!("trip {number}"),
        phase: String::new(),
        circuit: "Q1".to_owned(),
        normal: Some(false),
        initial: number.is_multiple_of(2),
        changes: changes.to_vec(),
    };
    Recording {
        station: "\u{441}\u{442}\u{430}\u{43d}\u{446}\u{438}\u{44f} 1".to_owned(),
        recorder: "loadmodeld".to_owned(),
        revision: Revision::Y2013,
        format: DataFormat::Ascii,
        code_page: "UTF-8",
        nominal_hz: Some(50.0),
        start_ns: Some(1_577_923_201_250_000_000),
        trigger_ns: Some(1_577_923_202_000_000_000),
        time_code: Some(TimeCode {
            utc_offset_s: Some(0),
            local_offset_s: Some(-19_800),
            quality: Some(11),
            leap_second: LeapSecond::None,
        }),
        analog: vec![
            channel(1, "U1", "kV", wave(0.25, 63.5)),
            channel(2, "I1", "A", current),
            channel(3, "constant", "Hz", vec![50.0; 120]),
            channel(4, "missing", "MW", vec![f64::NAN; 120]),
        ],
        digital: (1..=18)
            .map(|n| contact(n, &[10, 50 + n as usize]))
            .collect(),
        time_s: (0..samples).map(|n| f64::from(n) / 60.0).collect(),
        segments: vec![Segment {
            first: 0,
            len: 120,
            rate_hz: 60.0,
        }],
        notes: Vec::new(),
    }
}

/// Largest error of a value: half a step of the integers, or seven digits.
fn tolerance(format: DataFormat, channel: &AnalogChannel) -> f64 {
    let finite = || channel.values.iter().filter(|v| v.is_finite());
    let low = finite().fold(f64::INFINITY, |a, b| a.min(*b));
    let high = finite().fold(f64::NEG_INFINITY, |a, b| a.max(*b));
    match format {
        DataFormat::Binary => 0.501 * (high - low) / 65_534.0,
        DataFormat::Binary32 => 1e-9 * (high - low) + 1e-12 * high.abs(),
        DataFormat::Ascii | DataFormat::Float32 => 5.1e-7 * high.abs().max(low.abs()),
    }
}

fn assert_same(written: &Recording, found: &Recording, format: DataFormat) {
    assert_eq!(found.format, format);
    assert_eq!(found.revision, Revision::Y2013);
    assert_eq!(found.station, written.station);
    assert_eq!(found.recorder, written.recorder);
    assert_eq!(found.start_ns, written.start_ns);
    assert_eq!(found.trigger_ns, written.trigger_ns);
    assert_eq!(found.nominal_hz, written.nominal_hz);
    assert_eq!(found.time_code, written.time_code);
    assert_eq!(found.digital, written.digital);
    assert_eq!(found.segments, written.segments);
    assert_eq!(found.notes, []);
    for (found, expected) in found.time_s.iter().zip(&written.time_s) {
        assert!((found - expected).abs() < 1e-8, "{found} {expected}");
    }
    for (found, expected) in found.analog.iter().zip(&written.analog) {
        let tolerance = tolerance(format, expected);
        for (x, y) in found.values.iter().zip(&expected.values) {
            let same = x.is_nan() && y.is_nan() || (x - y).abs() <= tolerance;
            assert!(same, "{format:?} {}: {x}, not {y}", expected.name);
        }
        // Values that are not a number equal nothing.
        let without_values = |channel: &AnalogChannel| AnalogChannel {
            values: Vec::new(),
            ..channel.clone()
        };
        assert_eq!(without_values(found), without_values(expected));
    }
}

#[test]
fn every_format_is_read_back_with_its_own_accuracy() {
    let written = recording();
    for format in FORMATS {
        let Encoded {
            configuration,
            data,
        } = encode(&written, format).unwrap();
        let found = decode(&configuration, &data, &Options::default()).unwrap();
        assert_same(&written, &found, format);
        let container = encode_container(&written, format).unwrap();
        let found = decode_container(&container, &Options::default()).unwrap();
        assert_same(&written, &found, format);
    }
}

/// Values of the files named on the command line, as the Python package `comtrade` reads them.
const READER: &str = "
import comtrade, json, sys
for path in sys.argv[1:]:
    found = comtrade.load(path)
    print(json.dumps({
        'station': found.station_name, 'count': found.total_samples, 'names': found.analog_channel_ids,
        'times': list(found.time), 'analog': [list(values) for values in found.analog],
        'contacts': [list(values) for values in found.status],
    }))
";

#[test]
fn python_comtrade_reads_the_same_values_from_what_is_written() {
    let python = std::env::var_os("LOADMODELD_TEST_PYTHON").unwrap_or_else(|| "python3".into());
    let run = |code: &str, paths: &[std::path::PathBuf]| {
        let mut command = Command::new(&python);
        command.args(["-c", code]).args(paths).output()
    };
    if !run("import comtrade", &[]).is_ok_and(|tried| tried.status.success()) {
        println!("SKIPPED: files in the eyes of python (no Python with the PyPI package comtrade)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let written = recording();
    let names = FORMATS.map(|format| ["cfg", "cff"].map(|ending| (format, ending)));
    let mut paths = Vec::new();
    for (format, ending) in names.as_flattened() {
        let path = folder.path().join(format!("{format:?}.{ending}"));
        write(&path, &written, *format).unwrap();
        paths.push(path);
    }
    let output = run(READER, &paths).unwrap();
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{words}");
    let text = String::from_utf8(output.stdout).unwrap();
    let found: Vec<serde_json::Value> = text
        .lines()
        // Missing values are NaN in Python's JSON.
        .map(|line| serde_json::from_str(&line.replace("NaN", "null")).unwrap())
        .collect();
    assert_eq!(found.len(), paths.len());
    for ((format, _), found) in names.as_flattened().iter().zip(&found) {
        assert_as_python_reads(&written, found, *format);
    }
}

fn assert_as_python_reads(written: &Recording, found: &serde_json::Value, format: DataFormat) {
    assert_eq!(found["station"], written.station.as_str());
    assert_eq!(found["count"], written.time_s.len());
    for (n, time_s) in written.time_s.iter().enumerate() {
        // It holds times in single precision.
        let off_s = found["times"][n].as_f64().unwrap() - time_s;
        assert!(
            off_s.abs() < 1e-6,
            "{format:?}, sample {n}: off by {off_s} s"
        );
    }
    for (at, channel) in written.analog.iter().enumerate() {
        assert_eq!(found["names"][at], channel.name.as_str());
        let tolerance = tolerance(format, channel);
        for (n, value) in channel
            .values
            .iter()
            .enumerate()
            .filter(|(_, v)| v.is_finite())
        {
            let read = found["analog"][at][n].as_f64().unwrap();
            // And values likewise.
            let off = (read - value).abs() - 2e-7 * value.abs();
            assert!(
                off <= tolerance,
                "{format:?} {}: {read}, not {value}",
                channel.name
            );
        }
    }
    for (at, contact) in written.digital.iter().enumerate() {
        let closed = |n: usize| {
            let changes = contact
                .changes
                .iter()
                .filter(|change| **change <= n)
                .count();
            contact.initial ^ !changes.is_multiple_of(2)
        };
        for n in 0..written.time_s.len() {
            let read = found["contacts"][at][n].as_i64().unwrap();
            assert_eq!(
                read == 1,
                closed(n),
                "{format:?} {}, sample {n}",
                contact.name
            );
        }
    }
}

#[test]
fn files_are_read_back_from_disk() {
    let folder = tempfile::tempdir().unwrap();
    let written = recording();
    for (name, format) in [
        ("a.cfg", DataFormat::Binary),
        ("b.cff", DataFormat::Float32),
        ("c.CFF", DataFormat::Ascii),
    ] {
        let path = folder.path().join(name);
        write(&path, &written, format).unwrap();
        assert_same(&written, &read(&path, &Options::default()).unwrap(), format);
    }
    let error = write(&folder.path().join("d.txt"), &written, DataFormat::Ascii).unwrap_err();
    assert!(
        error
            .to_string()
            .ends_with("d.txt is not named .cfg or .cff")
    );
}

#[test]
fn gaps_and_changes_of_rate_keep_their_times() {
    let mut gap = recording();
    for time in &mut gap.time_s[60..] {
        *time += 12.5;
    }
    let mut rates = recording();
    rates.time_s = (0..120)
        .map(|n| f64::from(n.min(60)) / 1000.0 + f64::from((n - 60).max(0)) / 60.0)
        .collect();
    rates.segments = vec![
        Segment {
            first: 0,
            len: 60,
            rate_hz: 1000.0,
        },
        Segment {
            first: 60,
            len: 60,
            rate_hz: 60.0,
        },
    ];
    for written in [gap, rates] {
        for format in FORMATS {
            let Encoded {
                configuration,
                data,
            } = encode(&written, format).unwrap();
            let found = decode(&configuration, &data, &Options::default()).unwrap();
            for (found, expected) in found.time_s.iter().zip(&written.time_s) {
                assert!((found - expected).abs() < 2e-8, "{found} {expected}");
            }
        }
    }
}

#[test]
fn long_recordings_get_coarser_ticks() {
    let mut written = recording();
    for time in &mut written.time_s {
        *time *= 60_000.0;
    }
    written.segments[0].rate_hz = 1e-3;
    let Encoded {
        configuration,
        data,
    } = encode(&written, DataFormat::Binary).unwrap();
    assert!(String::from_utf8_lossy(&configuration).contains("BINARY\r\n100\r\n"));
    let found = decode(&configuration, &data, &Options::default()).unwrap();
    assert!((found.time_s[119] - 119_000.0).abs() < 1e-3);
}

#[test]
fn recording_without_a_clock_keeps_its_unknown_time() {
    let mut written = recording();
    written.start_ns = None;
    written.trigger_ns = None;
    let container = encode_container(&written, DataFormat::Float32).unwrap();
    let found = decode_container(&container, &Options::default()).unwrap();
    assert_eq!((found.start_ns, found.trigger_ns), (None, None));
}

#[test]
fn what_cannot_be_written_is_named() {
    let message = |change: fn(&mut Recording)| {
        let mut broken = recording();
        change(&mut broken);
        encode(&broken, DataFormat::Ascii).unwrap_err().to_string()
    };
    assert_eq!(
        message(|r| r.analog[0].name = "U1, bus".to_owned()),
        "ch_id 'U1, bus' holds a comma or a control character"
    );
    assert_eq!(
        message(|r| r.analog[1].values[3] = 1e39),
        format!(
            "channel 'I1': {} is outside the range of single precision",
            1e39
        )
    );
    assert_eq!(
        message(|r| r.analog[2].values.truncate(119)),
        "channel 'constant' has 119 values for 120 samples"
    );
    assert_eq!(
        message(|r| r.time_s[5] = r.time_s[4]),
        format!(
            "sample 6 at {} s does not follow the one before it by a step",
            4.0 / 60.0
        )
    );
    assert_eq!(
        message(|r| r.time_s.clear()),
        "the recording has no samples"
    );
}
