//! What recorders may write in more than one way, against values computed by the rule that made the file.

use super::*;

/// Channels beyond the three digits that some writers allow for.
const ANALOG: usize = 1203;
const DIGITAL: usize = 37;
const SAMPLES: usize = 40;

fn analog_code(channel: usize, sample: usize) -> i16 {
    i16::try_from((channel * 7 + sample * 13) % 2000).unwrap() - 1000
}

fn state(channel: usize, sample: usize) -> bool {
    (channel + sample / 3) % 4 == 1
}

/// Rates, multiplier, digits of the first stamp's fraction, and each sample's stamp.
type Case<'a> = (&'a str, &'a str, &'a str, &'a dyn Fn(usize) -> String);

/// `analog` and `digital` channels, values `0.25 code - 3` in kV.
fn wide(analog: usize, digital: usize, revision: &str, format: &str) -> String {
    let mut text = format!("s,r{revision}\n{},{analog}A,{digital}D\n", analog + digital);
    for k in 0..analog {
        let ratings = if revision.is_empty() {
            ""
        } else {
            ",110,0.1,p"
        };
        writeln!(
            text,
            "{},U{k},A,bus,kV,0.25,-3,0,-1000,1000{ratings}",
            k + 1
        )
        .unwrap();
    }
    for k in 0..digital {
        let rest = if revision.is_empty() { "0" } else { ",,0" };
        writeln!(text, "{},trip {k},{rest}", k + 1).unwrap();
    }
    let date = if revision.is_empty() {
        "02/01/20"
    } else {
        "01/02/2020"
    };
    text + &format!(
        "50\n1\n1000,{SAMPLES}\n{date},00:00:01.000000\n{date},00:00:01.002000\n{format}\n"
    ) + if revision.is_empty() { "" } else { "1\n" }
        + if revision == ",2013" {
            "0,0\nB,3\n"
        } else {
            ""
        }
}

fn ascii(analog: usize, digital: usize) -> String {
    let mut text = String::new();
    for sample in 0..SAMPLES {
        write!(text, "{},{}", sample + 1, sample * 1000).unwrap();
        for k in 0..analog {
            write!(text, ", {}", analog_code(k, sample)).unwrap();
        }
        for k in 0..digital {
            write!(text, ",{}", u8::from(state(k, sample))).unwrap();
        }
        text.push('\n');
    }
    text
}

fn binary(analog: usize, digital: usize, write: impl Fn(i16) -> Vec<u8>) -> Vec<u8> {
    let mut bytes = Vec::new();
    for sample in 0..SAMPLES {
        let count = u32::try_from(sample).unwrap();
        bytes.extend((count + 1).to_le_bytes());
        bytes.extend((count * 1000).to_le_bytes());
        bytes.extend((0..analog).flat_map(|k| write(analog_code(k, sample))));
        for word in 0..digital.div_ceil(16) {
            let bit = |k: usize| {
                let channel = word * 16 + k;
                u16::from(channel < digital && state(channel, sample)) << k
            };
            bytes.extend((0..16).map(bit).sum::<u16>().to_le_bytes());
        }
    }
    bytes
}

fn assert_is_wide(recording: &Recording, analog: usize, digital: usize) {
    let counts = [
        recording.len(),
        recording.analog.len(),
        recording.digital.len(),
    ];
    assert_eq!(counts, [SAMPLES, analog, digital]);
    // 2020-02-01T00:00:01Z.
    assert_eq!(recording.start_ns, Some(1_580_515_201_000_000_000));
    assert_eq!(recording.trigger_ns, Some(1_580_515_201_002_000_000));
    for sample in 0..SAMPLES {
        for (k, channel) in recording.analog.iter().enumerate() {
            let expected = 0.25 * f64::from(analog_code(k, sample)) - 3.0;
            let found = channel.values[sample];
            assert!((found - expected).abs() < EXACT, "{k} {sample}: {found}");
        }
        for (k, channel) in recording.digital.iter().enumerate() {
            assert_eq!(channel.state(sample), state(k, sample), "{k} {sample}");
        }
        assert!((recording.time_s[sample] - sample as f64 * 1e-3).abs() < EXACT);
    }
}

#[test]
fn a_thousand_channels_or_contacts_alone_are_read_in_every_edition_and_format() {
    for (analog, digital) in [(ANALOG, DIGITAL), (0, DIGITAL), (3, 0), (1, 16)] {
        let text = ascii(analog, digital);
        for revision in ["", ",1991", ",1999", ",2013"] {
            // A revision of 1991 is written in the layout of later ones, which is accepted.
            let layout = wide(analog, digital, revision, "ascii");
            let layout = if revision == ",1991" {
                layout.replace("01/02/2020", "02/01/2020")
            } else {
                layout
            };
            assert_is_wide(
                &decode_text(&layout, text.as_bytes()).unwrap(),
                analog,
                digital,
            );
        }
        let sixteen = binary(analog, digital, |v| v.to_le_bytes().to_vec());
        for revision in ["", ",1999", ",2013"] {
            let layout = wide(analog, digital, revision, "Binary");
            assert_is_wide(&decode_text(&layout, &sixteen).unwrap(), analog, digital);
        }
        let thirty_two = binary(analog, digital, |v| i32::from(v).to_le_bytes().to_vec());
        let layout = wide(analog, digital, ",2013", "binary32");
        assert_is_wide(&decode_text(&layout, &thirty_two).unwrap(), analog, digital);
        let floating = binary(analog, digital, |v| f32::from(v).to_le_bytes().to_vec());
        let layout = wide(analog, digital, ",2013", "Float32");
        assert_is_wide(&decode_text(&layout, &floating).unwrap(), analog, digital);
    }
}

#[test]
fn ends_of_lines_and_of_files_change_nothing() {
    let (layout, data) = (wide(3, 17, ",2013", "ASCII"), ascii(3, 17));
    let plain = decode_text(&layout, data.as_bytes()).unwrap();
    assert_is_wide(&plain, 3, 17);
    for end in ["\n", "\r\n", "\r"] {
        for tail in ["", "\n", "\n\n\n", "\u{1a}", "\n\u{1a}\u{1a}"] {
            let with = |text: &str| (text.trim_end().to_owned() + tail).replace('\n', end);
            let read = decode_text(&with(&layout), with(&data).as_bytes());
            assert_eq!(read.unwrap(), plain, "{end:?} {tail:?}");
        }
    }
    let marked = format!("\u{feff}{layout}");
    assert_eq!(
        decode_text(&marked, data.as_bytes()).unwrap().analog,
        plain.analog
    );
}

#[test]
fn minus_one_is_a_value_in_1991_where_negative_values_are_declared() {
    let data = binary(1, 0, |v| {
        if v == -987 {
            vec![0xff; 2]
        } else {
            v.to_le_bytes().to_vec()
        }
    });
    assert_eq!(analog_code(0, 1), -987);
    let read = |lowest: &str| {
        let layout = wide(1, 0, "", "BINARY").replace("-1000,1000", lowest);
        decode_text(&layout, &data).unwrap().analog[0].values[1]
    };
    assert!((read("-1000,1000") - (-3.25)).abs() < EXACT);
    assert!(read("0,65534").is_nan());
    assert!(read(",").is_nan());
}

#[test]
fn a_container_may_hold_notes_with_rules_and_sections_behind_the_data() {
    let (layout, data) = (wide(3, 2, ",2013", "ASCII"), ascii(3, 2));
    let notes = "--- file type: HDR ---\n------------\nMeasured by hand\n--- see below ---\n";
    let with_length = format!("--- file type: DAT ASCII: {} ---\n{data}", data.len());
    let without = format!("--- file type: DAT ASCII ---\n{data}");
    for file in [
        format!("--- file type: CFG ---\n{layout}{notes}{without}"),
        format!("--- file type: CFG ---\n{layout}--- file type: INF ---\n{notes}{with_length}"),
        format!("--- FILE TYPE: CFG---\r\n{layout}{with_length}{notes}"),
        format!("{notes}--- file type: CFG ---\n{layout}{without}"),
    ] {
        let recording = decode_container(file.as_bytes(), &Options::default());
        assert_is_wide(&recording.unwrap(), 3, 2);
    }
    // Dashes in a configuration are no note, and a bad header in notes is still a bad header.
    for (from, to) in [
        ("50\n1\n", "---\n50\n1\n"),
        ("--- file type: DAT", "--- file type DAT"),
    ] {
        let file = format!("--- file type: CFG ---\n{layout}{notes}{without}");
        let file = file.replacen(from, to, 1);
        let error = decode_container(file.as_bytes(), &Options::default()).unwrap_err();
        assert!(error.to_string().contains("section header"), "{error}");
    }
}

#[test]
fn rates_and_stamps_in_every_combination_give_the_same_times() {
    let data = |stamp: &dyn Fn(usize) -> String| -> String {
        let row = |k: usize| format!("{},{},{},0,0\n", k + 1, stamp(k), k);
        (0..6).map(row).collect()
    };
    // Two rates: four samples a millisecond apart, then two of half a millisecond.
    let times = [0.0, 1e-3, 2e-3, 3e-3, 3.5e-3, 4e-3];
    let microseconds = |k: usize| format!("{:.0}", times[k] * 1e6);
    let nanoseconds = |k: usize| format!("{:.0}", times[k] * 1e9);
    let tenths = |k: usize| format!("{:.0}", times[k] * 1e7);
    let none = |_: usize| String::new();
    let fine = ".000000000";
    let cases: [Case<'_>; 7] = [
        ("2\n1000,4\n2000,6", "1", ".000000", &microseconds),
        ("2\n1000,4\n2000,6", "1", ".000000", &none),
        ("2\n1000,4\n2000,6", "0.1", ".000000", &tenths),
        ("2\n1000,4\n2000,6", "1.0E+00", fine, &nanoseconds),
        ("0\n0,6", "1", ".000000", &microseconds),
        ("0\n0,6", "1e-1", ".000000", &tenths),
        ("1\n0,6", "1", fine, &nanoseconds),
    ];
    for (rates, multiplier, fraction, stamp) in cases {
        let layout = configuration(",1999", "ASCII", rates, &format!("{multiplier}\n"))
            .replace("01.000000", &format!("01{fraction}"))
            .replace("01.002000", &format!("01{fraction}"));
        let read = decode_text(&layout, data(stamp).as_bytes()).unwrap();
        for (found, expected) in read.time_s.iter().zip(times) {
            let error = (found - expected).abs();
            // Without stamps the interval across the change is that of the earlier or the later rate.
            let tolerance = if stamp(1).is_empty() { 5.1e-4 } else { 1e-9 };
            assert!(error < tolerance, "{rates} {multiplier}: {:?}", read.time_s);
        }
    }
}

#[test]
fn years_zones_and_qualities_are_read_as_they_are_written() {
    let start = |revision: &str, date: &str, tail: &str| {
        let layout = configuration(revision, "ASCII", ONE_RATE, tail)
            .replace("02/01/2020,00:00:01.0", &format!("{date},00:00:01.0"));
        decode_text(&layout, ascii_data().as_bytes())
            .unwrap()
            .start_ns
    };
    // 1995-03-04T00:00:01Z, by `date -u -d`.
    let march_4 = Some(794_275_201_000_000_000);
    assert_eq!(start("", "03/04/95", ""), march_4);
    assert_eq!(start("", "3/4/1995", ""), march_4);
    assert_eq!(start(",1999", "04/03/1995", "1\n"), march_4);
    assert_eq!(start(",1999", " 4/3/95 ", "1\n"), march_4);
    assert_eq!(start(",1999", "1995-03-04", "1\n"), march_4);
    let hour_ns = 3.6e12;
    for (code, hours) in [
        ("-5", -5.0),
        ("+5h30", 5.5),
        ("-3h30", -3.5),
        ("5:45", 5.75),
    ] {
        let tail = format!("1\n{code},{code}\nF,2\n");
        #[allow(clippy::cast_possible_truncation, reason = "whole nanoseconds")]
        let expected = march_4.map(|ns| ns - (hours * hour_ns) as i64);
        assert_eq!(start(",2013", "04/03/1995", &tail), expected, "{code}");
    }
    let layout = configuration(",2013", "ASCII", ONE_RATE, "1\n0,x\nb,1\n");
    let code = decode_text(&layout, ascii_data().as_bytes()).unwrap();
    let code = code.time_code.unwrap();
    assert_eq!((code.utc_offset_s, code.local_offset_s), (Some(0), None));
    assert_eq!(
        (code.quality, code.leap_second),
        (Some(11), LeapSecond::Inserted)
    );
}
