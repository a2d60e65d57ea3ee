//! The reader against small vectors of our own, against mutants of them, and, where the folder is
//! there, against files of real recorders with the decoding of python `comtrade` beside them.

use std::{fmt::Write as _, fs, path::PathBuf};

use serde_json::Value;

use super::*;

mod mutants;
mod variants;
mod writing;

const EXACT: f64 = 1e-12;

/// A configuration of two analog channels and one digital one, five samples.
fn configuration(revision: &str, format: &str, rates: &str, tail: &str) -> String {
    format!(
        "station,recorder{revision}\n3,2A,1D\n\
         1,Ua,A,bus,kV,0.5,1.0,0,-32767,32767,110,0.1,P\n\
         2,Ia,A,feeder,A,2,0,0,-32767,32767,600,5,S\n\
         1,trip,,,0\n50\n{rates}\n\
         02/01/2020,00:00:01.000000\n02/01/2020,00:00:01.002000\n{format}\n{tail}"
    )
}

const ONE_RATE: &str = "1\n1000,5";

fn ascii_data() -> String {
    "1,0,10,1,0\n2,1000,20,2,0\n3,2000,,3,1\n4,3000,40,99999,1\n5,4000,50,5,0\n".to_owned()
}

/// The same samples in a binary format; `None` is written as that format's "missing".
fn binary_data(write: impl Fn(Option<i16>) -> Vec<u8>) -> Vec<u8> {
    let rows = [
        (Some(10), Some(1), 0_u16),
        (Some(20), Some(2), 0),
        (None, Some(3), 1),
        (Some(40), None, 1),
        (Some(50), Some(5), 0),
    ];
    let mut bytes = Vec::new();
    for (index, (first, second, states)) in (0_u32..).zip(rows) {
        bytes.extend((index + 1).to_le_bytes());
        bytes.extend((index * 1000).to_le_bytes());
        bytes.extend(write(first));
        bytes.extend(write(second));
        bytes.extend(states.to_le_bytes());
    }
    bytes
}

fn binary_16() -> Vec<u8> {
    binary_data(|value| value.unwrap_or(i16::MIN).to_le_bytes().to_vec())
}

fn decode_text(configuration: &str, data: &[u8]) -> Result<Recording, Error> {
    decode(configuration.as_bytes(), data, &Options::default())
}

fn assert_is_the_reference(recording: &Recording) {
    assert_eq!(recording.len(), 5);
    assert_eq!(recording.start_ns, Some(1_577_923_201_000_000_000));
    let [volts, amperes] = [0, 1].map(|i| &recording.analog[i]);
    assert_eq!((volts.name.as_str(), volts.unit.as_str()), ("Ua", "kV"));
    assert_eq!(volts.to_primary(), Some(1.0));
    assert_eq!(amperes.to_primary(), Some(120.0));
    for (found, expected) in volts.values.iter().zip([6.0, 11.0, f64::NAN, 21.0, 26.0]) {
        assert!((found - expected).abs() < EXACT || expected.is_nan() && found.is_nan());
    }
    assert!(amperes.values[3].is_nan());
    let trip: Vec<bool> = (0..5).map(|i| recording.digital[0].state(i)).collect();
    assert_eq!(trip, [false, false, true, true, false]);
    assert!((recording.time_s[4] - 0.004).abs() < EXACT);
}

#[test]
fn every_format_gives_the_same_recording() {
    let read = |revision, format, tail, data: &[u8]| {
        decode_text(&configuration(revision, format, ONE_RATE, tail), data).unwrap()
    };
    assert_is_the_reference(&read(",1999", "ASCII", "1\n", ascii_data().as_bytes()));
    assert_is_the_reference(&read(",1999", "binary", "1\n", &binary_16()));
    let tail = "1\n0,0\n0,0\n";
    let binary_32 = binary_data(|v| v.map_or(i32::MIN, i32::from).to_le_bytes().to_vec());
    assert_is_the_reference(&read(",2013", "BINARY32", tail, &binary_32));
    let float_32 = binary_data(|v| v.map_or(f32::NAN, f32::from).to_le_bytes().to_vec());
    assert_is_the_reference(&read(",2013", "FLOAT32", tail, &float_32));
}

#[test]
fn container_gives_the_same_recording_as_two_files() {
    let text = configuration(",2013", "BINARY", ONE_RATE, "1\n0,0\n0,0\n");
    let data = binary_16();
    let mut file =
        format!("--- file type: CFG ---\r\n{text}\n--- file type: INF ---\n\n").into_bytes();
    file.extend(format!("--- file type: DAT BINARY: {} ---\r\n", data.len()).bytes());
    file.extend(&data);
    let sections = container::split(&file).unwrap();
    let recording = decode(sections.configuration, sections.data, &Options::default()).unwrap();
    assert_is_the_reference(&recording);
    let short = container::split(&file[..file.len() - 1]).unwrap_err();
    assert!(short.to_string().contains("data length"), "{short}");
}

#[test]
fn texts_are_read_in_the_code_page_of_the_file_or_of_the_caller() {
    let russian = "\u{421}\u{442}\u{430}\u{43d}\u{446}\u{438}\u{44f}";
    let chinese = "\u{6bcd}\u{7ebf}\u{53d8}\u{538b}\u{5668}";
    let german = "K\u{f6}ln";
    let with = |station: &str| {
        let text = configuration(",1999", "ASCII", ONE_RATE, "1\n");
        text.replacen("station", station, 1)
    };
    let station = |bytes: &[u8], options: &Options| {
        let data = ascii_data();
        decode(bytes, data.as_bytes(), options).unwrap().station
    };
    for (text, encoding) in [
        (russian, encoding_rs::WINDOWS_1251),
        (chinese, encoding_rs::GB18030),
        (german, encoding_rs::WINDOWS_1252),
        (chinese, encoding_rs::UTF_8),
    ] {
        let whole = with(text);
        let (bytes, _, _) = encoding.encode(&whole);
        assert_eq!(station(&bytes, &Options::default()), text);
    }
    let whole = with(russian);
    let (koi, _, _) = encoding_rs::KOI8_R.encode(&whole);
    let options = Options {
        code_page: Some(encoding_rs::KOI8_R),
        ..Options::default()
    };
    assert_eq!(station(&koi, &options), russian);
}

#[test]
fn files_in_utf_16_are_read_by_their_byte_order_mark() {
    let wide = |text: &str| -> Vec<u8> {
        let units = std::iter::once(0xfeff).chain(text.encode_utf16());
        units.flat_map(u16::to_le_bytes).collect()
    };
    let text = configuration(",1999", "ASCII", ONE_RATE, "1\n");
    let recording = decode(&wide(&text), &wide(&ascii_data()), &Options::default()).unwrap();
    assert_is_the_reference(&recording);
}

#[test]
fn time_code_moves_local_stamps_to_utc() {
    let text = configuration(",2013", "BINARY", ONE_RATE, "1\n-5h30,-5h30\nB,3\n");
    let recording = decode_text(&text, &binary_16()).unwrap();
    let local_ns = 1_577_923_201_000_000_000;
    assert_eq!(recording.start_ns, Some(local_ns + 19_800_000_000_000));
    let code = recording.time_code.unwrap();
    assert_eq!(
        (code.quality, code.leap_second),
        (Some(11), LeapSecond::Unknown)
    );
}

#[test]
fn stamps_are_the_times_when_no_rate_is_declared() {
    let text = configuration(",1999", "ASCII", "0\n0,5", "2.0\n");
    let recording = decode_text(&text, ascii_data().as_bytes()).unwrap();
    assert!((recording.time_s[4] - 0.008).abs() < EXACT, "timemult is 2");
    assert!((recording.segments[0].rate_hz - 500.0).abs() < 1e-9);
    let missing = ascii_data().replace("3,2000,", "3,,");
    let error = decode_text(&text, missing.as_bytes()).unwrap_err();
    assert!(matches!(error, Error::NoTime { row: 3 }), "{error}");
}

#[test]
fn jump_of_believable_stamps_is_a_gap_and_unbelievable_stamps_are_not_used() {
    let text = configuration(",1999", "ASCII", "2\n1000,3\n1000,5", "1\n");
    let jump = ascii_data()
        .replace("4,3000", "4,903000")
        .replace("5,4000", "5,904000");
    let recording = decode_text(&text, jump.as_bytes()).unwrap();
    assert!((recording.time_s[3] - 0.903).abs() < EXACT);
    assert!(matches!(recording.notes[..], [Note::Gap { sample: 3, .. }]));
    let milliseconds = ascii_data().replace("000,", ",");
    let recording = decode_text(&text, milliseconds.as_bytes()).unwrap();
    assert!((recording.time_s[4] - 0.004).abs() < EXACT);
    assert!(matches!(recording.notes[..], [Note::StampsDisagree { .. }]));
}

#[test]
fn stamps_rounded_to_milliseconds_are_no_gaps() {
    use std::fmt::Write as _;
    let text = configuration(",1999", "ASCII", "1\n960,100", "1\n");
    let mut data = String::new();
    for n in 0..100 {
        writeln!(data, "{},{}000,1,1,0", n + 1, n * 1000 / 960).unwrap();
    }
    let recording = decode_text(&text, data.as_bytes()).unwrap();
    assert_eq!(recording.notes, []);
    assert!((recording.time_s[99] - 99.0 / 960.0).abs() < EXACT);
}

#[test]
fn interval_across_a_change_of_rate_follows_the_stamps() {
    let text = configuration(",1999", "ASCII", "2\n1000,3\n100,5", "1\n");
    let data = "1,0,1,1,0\n2,1000,1,1,0\n3,2000,1,1,0\n4,3000,1,1,0\n5,13000,1,1,0\n";
    let recording = decode_text(&text, data.as_bytes()).unwrap();
    let expected = [0.0, 0.001, 0.002, 0.003, 0.013];
    for (found, expected) in recording.time_s.iter().zip(expected) {
        assert!((found - expected).abs() < EXACT, "{:?}", recording.time_s);
    }
}

#[test]
fn malformed_files_are_refused_with_part_line_and_field() {
    let good = configuration(",1999", "ASCII", ONE_RATE, "1\n");
    let data = ascii_data();
    let cases: &[(&str, &str, &str)] = &[
        (
            "kV,0.5,",
            "kV,x,",
            "configuration line 3, a: 'x' is not a number",
        ),
        (
            ",1999",
            ",19x9",
            "configuration line 1, rev_year: '19x9' is not a year",
        ),
        (
            "3,2A,1D",
            "3,2A",
            "configuration line 2: 2 fields, expected 3",
        ),
        (
            "1\n1000,5",
            "x\n1000,5",
            "configuration line 7, nrates: 'x' is not a count",
        ),
        (
            "1000,5",
            "1000,-5",
            "configuration line 8, endsamp: '-5' is not a sample number",
        ),
        (
            "1000,5",
            "1000,9",
            "data end after 5 samples, 9 are declared",
        ),
        (
            "02/01/2020,00:00:01.0",
            "31/02/2020,00:00:01.0",
            "configuration line 9, date",
        ),
        (
            "00:00:01.002",
            "24:00:01.002",
            "configuration line 10, time: '24:00:01.002000'",
        ),
        (
            "ASCII",
            "ASCI",
            "configuration line 11, ft: 'ASCI' is not ASCII, BINARY",
        ),
        (
            "3,2A,1D",
            "900000001,900000000A,1D",
            "configuration line 5: 5 fields",
        ),
    ];
    for (from, to, expected) in cases {
        let error = decode_text(&good.replacen(from, to, 1), data.as_bytes()).unwrap_err();
        assert!(error.to_string().contains(expected), "{to}: {error}");
    }
    let short_row = data.replace("2,1000,20,2,0", "2,1000,20");
    let error = decode_text(&good, short_row.as_bytes()).unwrap_err();
    assert_eq!(error.to_string(), "data line 2: 3 fields, expected 5");
    let bad_value = data.replace("20,2,0", "2o,2,0");
    let error = decode_text(&good, bad_value.as_bytes()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "data line 2, channel 1 (Ua): '2o' is not a number"
    );
}

#[test]
fn truncated_data_and_blank_lines_are_read_only_when_asked_for() {
    let text = configuration(",1999", "BINARY", ONE_RATE, "1\n");
    let bytes = binary_16();
    let cut = &bytes[..bytes.len() - 3];
    assert!(matches!(
        decode_text(&text, cut),
        Err(Error::DataEnds {
            found: 4,
            declared: 5
        })
    ));
    let options = Options {
        lenient: true,
        ..Options::default()
    };
    let recording = decode(text.as_bytes(), cut, &options).unwrap();
    assert_eq!(recording.len(), 4);
    assert_eq!(
        recording.notes,
        [Note::Truncated {
            found: 4,
            declared: 5
        }]
    );
    let text = configuration(",1999", "ASCII", ONE_RATE, "1\n");
    let blank = ascii_data().replace("3,2000", "\n3,2000") + "\n\n";
    let error = decode_text(&text, blank.as_bytes()).unwrap_err();
    assert!(error.to_string().contains("the line is blank"), "{error}");
    let recording = decode(text.as_bytes(), blank.as_bytes(), &options).unwrap();
    assert_eq!(recording.notes, [Note::BlankLines { count: 1 }]);
}

fn shared_vectors() -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data/protocol/comtrade");
    if folder.join("index.json").is_file() {
        return Some(folder);
    }
    println!("skipped: no COMTRADE vectors beside the project");
    None
}

#[test]
fn files_of_real_recorders_decode_as_the_reference_reader_does() {
    let Some(folder) = shared_vectors() else {
        return;
    };
    let index: Value =
        serde_json::from_slice(&fs::read(folder.join("index.json")).unwrap()).unwrap();
    let mut problems = String::new();
    for entry in index.as_array().unwrap() {
        let name = entry["name"].as_str().unwrap();
        let cff = folder.join(format!("{name}.cff"));
        let path = if cff.is_file() {
            cff
        } else {
            folder.join(format!("{name}.cfg"))
        };
        let result = read(&path, &Options::default());
        if name.starts_with("bad_") {
            match result {
                Ok(_) => writeln!(problems, "{name}: read, should be refused").unwrap(),
                Err(error) => println!("{name}: {error}"),
            }
            continue;
        }
        match result {
            Ok(recording) => {
                println!(
                    "{name}: {} {}, {} samples, {:?}",
                    recording.code_page,
                    recording.format.name(),
                    recording.len(),
                    recording.notes
                );
                compare_header(&mut problems, name, entry, &recording);
                let table = folder.join(format!("{name}.ref.csv"));
                compare_values(&mut problems, name, &table, &recording);
            }
            Err(error) => writeln!(problems, "{name}: {error}").unwrap(),
        }
    }
    assert!(problems.is_empty(), "\n{problems}");
}

fn compare_header(problems: &mut String, name: &str, entry: &Value, recording: &Recording) {
    let mut check = |what: &str, same: bool| {
        if !same {
            writeln!(problems, "{name}: {what} differs").unwrap();
        }
    };
    let count = |key: &str| usize::try_from(entry[key].as_u64().unwrap()).unwrap();
    check("sample count", count("n") == recording.len());
    check("analog count", count("na") == recording.analog.len());
    check("digital count", count("nd") == recording.digital.len());
    check(
        "frequency",
        (entry["f"].as_f64().unwrap() - recording.nominal_hz.unwrap_or(0.0)).abs() < EXACT,
    );
    let encoding = entry["encoding"]
        .as_str()
        .unwrap()
        .replace("cp1251", "windows-1251");
    check(
        "code page",
        encoding.eq_ignore_ascii_case(recording.code_page),
    );
    let trigger_s = entry["trigger_time"].as_f64().unwrap();
    let found_s = (recording.trigger_ns.unwrap() - recording.start_ns.unwrap()) as f64 * 1e-9;
    check("trigger time", (trigger_s - found_s).abs() < 1e-6);
    let channels = entry["channels"].as_array().unwrap();
    for (expected, found) in channels.iter().zip(&recording.analog) {
        let same = expected["name"].as_str().unwrap().trim() == found.name
            && expected["ph"].as_str().unwrap().trim() == found.phase
            && expected["uu"].as_str().unwrap().trim() == found.unit
            && (expected["skew"].as_f64().unwrap() - found.skew_us).abs() < EXACT
            && (expected["primary"].as_f64().unwrap() - found.primary.unwrap_or(0.0)).abs() < EXACT;
        check(&format!("channel {}", found.name), same);
    }
}

/// The reference holds single-precision values of the first 200 samples and the last. Its times
/// count from sample number 1 and give the interval across a change of rate the later rate; the
/// stamps of the same files say the earlier one, so times are compared in the first segment.
fn compare_values(problems: &mut String, name: &str, table: &PathBuf, recording: &Recording) {
    let mut reader = csv::Reader::from_path(table).unwrap();
    let mut origin_s = None;
    for row in reader.records().map(Result::unwrap) {
        let index: usize = row[0].parse().unwrap();
        let time_s: f64 = row[1].parse().unwrap();
        let origin_s = *origin_s.get_or_insert(time_s);
        let off_s = (time_s - origin_s - recording.time_s[index]).abs();
        if index < recording.segments[0].len && off_s > 2e-6 {
            writeln!(problems, "{name}: sample {index} is {off_s} s off").unwrap();
            return;
        }
        for (text, channel) in row.iter().skip(2).zip(&recording.analog) {
            let expected: f64 = text.parse().unwrap();
            let found = channel.values[index];
            let tolerance = 2e-6 * expected.abs() + 1e-9;
            if !((found - expected).abs() <= tolerance || expected.is_nan() && found.is_nan()) {
                let channel = &channel.name;
                writeln!(
                    problems,
                    "{name}: {channel}[{index}] {found}, not {expected}"
                )
                .unwrap();
                return;
            }
        }
    }
}
