//! Captures of real devices and of simulators, with tshark's decoding of selected frames beside
//! them. They are not part of the project.

use std::{fmt::Write as _, fs, path::PathBuf};

use super::fixture::bytes;
use crate::adapters::c37118::{Configuration, DataFrame, Frame, StreamDecoder, decode};

fn folder() -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data/protocol/c37118");
    if folder.is_dir() {
        return Some(folder);
    }
    println!("skipped: no C37.118 captures beside the project");
    None
}

/// The frames of all captures by name. A line is a frame, or `C|S frame crc=..`.
fn captures(folder: &PathBuf) -> Vec<(String, Vec<Vec<u8>>)> {
    let mut names: Vec<PathBuf> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "hex"))
        .collect();
    names.sort();
    names
        .into_iter()
        .map(|path| {
            let text = fs::read_to_string(&path).unwrap();
            let frame = |line: &str| {
                let mut words = line.split_whitespace();
                bytes(words.find(|word| word.starts_with("aa")).unwrap())
            };
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            (name, text.lines().map(frame).collect())
        })
        .collect()
}

/// All data frames with the configuration before them, after writing every frame again.
fn decoded(name: &str, frames: &[Vec<u8>]) -> Vec<(Configuration, DataFrame)> {
    let mut configuration = None;
    let mut data = Vec::new();
    for (number, frame) in frames.iter().enumerate() {
        let decoded = decode(frame).unwrap_or_else(|e| panic!("{name}, frame {number}: {e}"));
        let written = match decoded {
            Frame::Data(message) => {
                let configuration: &Configuration = configuration.as_ref().unwrap();
                let read = message.decode(configuration).unwrap();
                data.push((configuration.clone(), read.clone()));
                read.encode(configuration).unwrap()
            }
            Frame::Configuration(read) => {
                let written = read.encode().unwrap().remove(0);
                configuration = Some(read);
                written
            }
            Frame::Header(header) => header.encode().unwrap(),
            Frame::Command(command) => command.encode().unwrap(),
            Frame::ConfigurationPart(_) => panic!("no capture holds a CFG-3"),
        };
        assert_eq!(&written, frame, "{name}, frame {number}");
    }
    data
}

#[test]
fn every_captured_frame_decodes_and_is_written_back_byte_for_byte() {
    let Some(folder) = folder() else { return };
    let mut total = 0;
    for (name, frames) in captures(&folder) {
        let data = decoded(&name, &frames);
        println!("{name}: {} frames, {} with data", frames.len(), data.len());
        total += frames.len();
        let mut stream = StreamDecoder::new();
        let mut cut = 0;
        for piece in frames.concat().chunks(1000) {
            stream.push(piece);
            cut += std::iter::from_fn(|| stream.next_frame()).count();
        }
        assert_eq!(cut, frames.len(), "{name}");
        assert_eq!(stream.counters().skipped_bytes, 0);
    }
    assert!(total > 3000, "{total} frames");
}

/// Decoded values in the words of tshark: magnitude and degrees of phasors, Hz, Hz/s, contacts.
pub(super) fn in_tshark_words(configuration: &Configuration, frame: &DataFrame) -> Vec<f64> {
    let mut values = Vec::new();
    for (pmu, data) in configuration.pmus.iter().zip(&frame.pmus) {
        for (channel, phasor) in pmu.phasors.iter().zip(&data.phasors) {
            let value = channel.value(*phasor);
            values.extend([value.magnitude(), value.angle_rad().to_degrees()]);
        }
        values.push(data.frequency_hz(pmu.nominal.hz()));
        values.push(data.rocof_hz_per_s());
        values.extend(data.digitals.iter().map(|word| f64::from(*word)));
    }
    values
}

/// The same numbers out of tshark's text; one list for each data frame.
pub(super) fn out_of_tshark(text: &str) -> Vec<Vec<f64>> {
    let number = |text: &str| -> f64 {
        let text = text.trim().trim_end_matches(['H', 'z', '/', 's', ')']);
        match text.strip_prefix("0x") {
            Some(digits) => f64::from(u16::from_str_radix(digits, 16).unwrap()),
            None => text.parse().unwrap_or_else(|_| panic!("{text}")),
        }
    };
    let mut frames: Vec<Vec<f64>> = Vec::new();
    for line in text.lines().map(str::trim) {
        if line.starts_with("Measurement data") {
            frames.push(Vec::new());
        }
        let Some(frame) = frames.last_mut() else {
            continue;
        };
        let after = |mark: &str| line.split_once(mark).map(|(_, rest)| rest);
        if line.starts_with("Phasor #") && line.contains('\u{2220}') {
            let (_, value) = line.split_once("\",").unwrap();
            let (magnitude, rest) = value.split_once(['V', 'A']).unwrap();
            let (angle, _) = rest.split_once('\u{b0}').unwrap();
            frame.push(number(magnitude));
            frame.push(number(angle.trim().trim_start_matches('\u{2220}')));
        } else if let Some(value) = after("(actual frequency: ") {
            frame.push(number(value));
        } else if let Some(value) = after("Actual frequency value: ") {
            frame.push(number(value));
        } else if let Some(value) = after("Rate of change of frequency: ") {
            frame.push(number(value));
        } else if line.starts_with("Digital status word #") {
            frame.push(number(after(": ").unwrap()));
        }
    }
    frames
}

#[test]
fn captured_data_have_the_values_that_tshark_reads() {
    let Some(folder) = folder() else { return };
    let mut problems = String::new();
    let mut compared = 0;
    for (name, frames) in captures(&folder) {
        let Ok(text) = fs::read_to_string(folder.join(format!("{name}.first.tshark.txt"))) else {
            continue;
        };
        let reference = out_of_tshark(&text);
        let data = decoded(&name, &frames);
        assert!(
            !reference.is_empty() && reference.len() <= data.len(),
            "{name}"
        );
        for (index, (expected, (configuration, frame))) in reference.iter().zip(&data).enumerate() {
            let found = in_tshark_words(configuration, frame);
            if found.len() != expected.len() {
                writeln!(problems, "{name} {index}: {} numbers", found.len()).unwrap();
                continue;
            }
            for (found, expected) in found.iter().zip(expected) {
                // Printed with three decimals or six digits; an angle of -180 may be one of 180.
                let tolerance = 6e-4 + 6e-6 * expected.abs();
                let off = (found - expected).abs();
                compared += 1;
                if off > tolerance && (off - 360.0).abs() > tolerance {
                    writeln!(problems, "{name} {index}: {found}, not {expected}").unwrap();
                }
            }
        }
    }
    println!("{compared} numbers compared");
    assert!(problems.is_empty(), "\n{problems}");
    assert!(compared > 1000, "{compared}");
}
