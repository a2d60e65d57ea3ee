//! Writing a site folder.

use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

use serde::Serialize;

use super::{error::Error, read::FolderEvent};
use crate::measurement::{Quality, Record, Sample, Site};

/// STAT bits of a quality word; the bits above are intake's own.
const STAT_MASK: u32 = 0xffff;

#[derive(Serialize)]
struct SiteFile<'a> {
    site: &'a str,
    sample_rate_fps: f64,
    nominal_hz: f64,
    base_mva: f64,
    base_kv: f64,
    events: Vec<EventEntry>,
}

#[derive(Serialize)]
struct EventEntry {
    file: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    utc: Option<String>,
}

/// Writes `site.json` and `<name>.csv` for each event into `directory`, which is created. A missing
/// sample has no row, a value that is not finite an empty cell; `time_s` counts from the event's
/// first sample, or from its `utc_ns` where it has one. [`load_events`] reads the same values back
/// to 1e-9.
///
/// [`load_events`]: super::load_events
///
/// # Errors
/// The directory or a file cannot be written.
pub fn write(
    directory: &Path,
    site: &Site,
    rate_fps: f64,
    events: &[FolderEvent],
) -> Result<(), Error> {
    fs::create_dir_all(directory).map_err(failed(directory))?;
    let entries = events.iter().map(|event| EventEntry {
        file: format!("{}.csv", event.name),
        utc: event.utc_ns.and_then(timestamp),
    });
    let file = SiteFile {
        site: &site.name,
        sample_rate_fps: rate_fps,
        nominal_hz: site.nominal_hz,
        base_mva: site.s_base_mva,
        base_kv: site.v_base_kv,
        events: entries.collect(),
    };
    let path = directory.join("site.json");
    let mut text = serde_json::to_string_pretty(&file).map_err(|source| Error::Json {
        path: path.clone(),
        source,
    })?;
    text.push('\n');
    fs::write(&path, text).map_err(failed(&path))?;
    for event in events {
        let path = directory.join(format!("{}.csv", event.name));
        let zero_ns = event.utc_ns.unwrap_or(event.record.start_ns);
        fs::write(&path, table(&event.record, zero_ns)).map_err(failed(&path))?;
    }
    Ok(())
}

fn failed(path: &Path) -> impl FnOnce(std::io::Error) -> Error {
    let path = PathBuf::from(path);
    |source| Error::Io { path, source }
}

fn timestamp(utc_ns: i64) -> Option<String> {
    let time = jiff::Timestamp::from_nanosecond(i128::from(utc_ns)).ok()?;
    Some(time.to_string())
}

fn table(record: &Record, zero_ns: i64) -> String {
    let with_angle = record.samples.iter().any(|s| s.angle_rad.is_finite());
    let angle_header = if with_angle { ",angle_deg" } else { "" };
    let mut text = format!("time_s,v_pu,freq_hz,p_pu,q_pu{angle_header},stat\n");
    for (index, sample) in record.samples.iter().enumerate() {
        if sample.quality == Quality::MISSING {
            continue;
        }
        let time_s = (record.time_ns(index) - zero_ns) as f64 * 1e-9;
        append(&mut text, time_s, sample, with_angle);
    }
    text
}

fn append(text: &mut String, time_s: f64, sample: &Sample, with_angle: bool) {
    let cell = |value: f64| {
        if value.is_finite() {
            format!("{value:.9}")
        } else {
            String::new()
        }
    };
    let angle = if with_angle {
        format!(",{}", cell(sample.angle_rad.to_degrees()))
    } else {
        String::new()
    };
    // Writing to a string cannot fail.
    let _written = writeln!(
        text,
        "{time_s:.6},{},{},{},{}{angle},{}",
        cell(sample.voltage_pu),
        cell(sample.frequency_hz),
        cell(sample.active_pu),
        cell(sample.reactive_pu),
        sample.quality.0 & STAT_MASK
    );
}
