//! Reading of the development data, for tests only: they skip, saying so, where it is absent.

use std::path::{Path, PathBuf};

use crate::measurement::{Quality, Sample, record::grid_offset_ns};

/// The folder of development data, if `part` of it is there.
pub(super) fn shared_data(part: &str) -> Option<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    if data.join(part).is_dir() {
        Some(data)
    } else {
        println!("skipped: no development data `{part}`");
        None
    }
}

/// The samples of a site folder's event file on a grid that starts at 0 ns.
pub(super) fn event_samples(path: &Path, rate_fps: f64) -> Vec<Sample> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header = reader.headers().unwrap().clone();
    let mut samples: Vec<Sample> = Vec::new();
    for row in reader.records() {
        let row = row.unwrap();
        let cell = |name: &str| {
            let at = header.iter().position(|column| column == name)?;
            row[at].parse::<f64>().ok()
        };
        let value = |name: &str| cell(name).unwrap_or(f64::NAN);
        let index = (value("time_s") * rate_fps).round();
        let mut sample = Sample::missing(grid_offset_ns(index, rate_fps));
        sample.voltage_pu = value("v_pu");
        sample.frequency_hz = value("freq_hz");
        sample.active_pu = value("p_pu");
        sample.reactive_pu = value("q_pu");
        sample.quality = Quality(cell("stat").map_or(0, |stat| format!("{stat}").parse().unwrap()));
        while (samples.len() as f64) < index {
            let k = samples.len() as f64;
            samples.push(Sample::missing(grid_offset_ns(k, rate_fps)));
        }
        samples.push(sample);
    }
    samples
}

/// Site folders in a folder, in order.
pub(super) fn directories(path: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(path).unwrap();
    let mut directories: Vec<PathBuf> = entries
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.join("site.json").is_file())
        .collect();
    directories.sort();
    directories
}

/// A JSON document.
pub(super) fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A file of reference phasors at 200 samples per second; the power before is 1 pu.
pub(super) fn phasors(path: &Path) -> Vec<Sample> {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let header = reader.headers().unwrap().clone();
    let mut samples: Vec<Sample> = Vec::new();
    for row in reader.records() {
        let row = row.unwrap();
        let value = |name: &str| {
            let at = header.iter().position(|column| column == name).unwrap();
            row[at].parse::<f64>().unwrap()
        };
        samples.push(Sample {
            voltage_pu: value("v_pu"),
            frequency_hz: value("freq_hz"),
            active_pu: value("p1"),
            reactive_pu: value("q1"),
            negative_sequence_ratio: value("v2_pu") / value("v_pu"),
            quality: Quality::GOOD,
            ..Sample::missing(grid_offset_ns(samples.len() as f64, 200.0))
        });
    }
    let base = samples[0].active_pu.abs();
    for sample in &mut samples {
        sample.active_pu /= base;
        sample.reactive_pu /= base;
    }
    samples
}
