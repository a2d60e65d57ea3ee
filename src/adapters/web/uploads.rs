//! Recordings that readers hold against a site's model: read into phasors and kept in memory only.

use std::{
    fs,
    sync::{Arc, Mutex, PoisonError},
};

use serde_json::json;
use sha2::{Digest, Sha256};

use super::problem::Problem;
use crate::{
    adapters::recordings::{
        comtrade::{self, Options, Recording},
        grouping, phasor_channels, site_folder,
    },
    disturbance::Window,
    measurement::{Record, Site},
};

/// Recordings kept; the oldest makes room.
pub(super) const KEPT_MAX: usize = 8;
/// Samples of a recording's phasors at most: half an hour at 60 frames/s.
const SAMPLES_MAX: usize = 108_000;
/// Time steps looked at to tell the rate of a CSV file.
const STEPS_MAX: usize = 5000;

/// A file as it was sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct File {
    pub(super) name: String,
    pub(super) bytes: Vec<u8>,
}

/// A recording that was read.
#[derive(Clone, Debug)]
pub(super) struct Upload {
    /// Name of the file.
    pub(super) name: String,
    /// Which channels were taken, where the file does not say it by itself.
    pub(super) note: Option<String>,
    pub(super) window: Window,
}

/// The newest recordings, over all sites.
#[derive(Debug, Default)]
pub(super) struct Uploads(Mutex<Vec<Arc<Upload>>>);

impl Uploads {
    /// Those of a site, newest first.
    pub(super) fn of(&self, site: &str) -> Vec<Arc<Upload>> {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let of_site = kept.iter().filter(|upload| upload.window.site == site);
        of_site.cloned().collect()
    }

    pub(super) fn get(&self, site: &str, id: &str) -> Option<Arc<Upload>> {
        let found = self.of(site);
        found.into_iter().find(|upload| upload.window.id == id)
    }

    /// Keeps it; the same content is kept once.
    pub(super) fn keep(&self, upload: Upload) {
        let mut kept = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        kept.retain(|other| other.window.id != upload.window.id);
        kept.insert(0, Arc::new(upload));
        kept.truncate(KEPT_MAX);
    }
}

/// Reads what was sent: one CSV file, one `.cff`, or a `.cfg` with its `.dat`. `load` chooses among
/// the loads of a recording with several, from 1.
///
/// # Errors
///
/// The refusal, for the reader.
pub(super) fn read(site: &Site, files: &[File], load: Option<usize>) -> Result<Upload, Problem> {
    let ending = |file: &File, ending: &str| file.name.to_ascii_lowercase().ends_with(ending);
    let one = |wanted: &str| files.iter().find(|file| ending(file, wanted));
    let (name, (record, note)) = match files {
        [file] if ending(file, ".csv") => (&file.name, (csv_record(site, &file.bytes)?, None)),
        [file] if ending(file, ".cff") => {
            let recording = comtrade::decode_container(&file.bytes, &Options::default());
            let recording = recording.map_err(|e| unfit(&e))?;
            (&file.name, comtrade_record(site, &recording, load)?)
        }
        [_, _] => {
            let (Some(configuration), Some(data)) = (one(".cfg"), one(".dat")) else {
                return Err(Problem::bad_request("two files are a .cfg and its .dat"));
            };
            let recording =
                comtrade::decode(&configuration.bytes, &data.bytes, &Options::default());
            let recording = recording.map_err(|e| unfit(&e))?;
            (
                &configuration.name,
                comtrade_record(site, &recording, load)?,
            )
        }
        _ => {
            return Err(Problem::bad_request(
                "send one .csv, one .cff, or a .cfg with its .dat",
            ));
        }
    };
    if record.samples.len() > SAMPLES_MAX {
        let detail = format!(
            "the recording has {} samples, and {SAMPLES_MAX} are looked at at most",
            record.samples.len()
        );
        return Err(Problem::bad_request(detail));
    }
    let mut hash = Sha256::new();
    for file in files {
        hash.update(&file.bytes);
    }
    hash.update([u8::try_from(load.unwrap_or(0)).unwrap_or(u8::MAX)]);
    let digest = hash.finalize();
    let digest = u64::from_be_bytes(std::array::from_fn(|k| digest[k]));
    let window = Window {
        id: format!("recording-{}-{digest:016x}", site.name),
        ..site_folder::window(site, &record)
    };
    Ok(Upload {
        name: name.clone(),
        note,
        window,
    })
}

fn unfit(error: &dyn std::fmt::Display) -> Problem {
    Problem::bad_request(format!("the recording cannot be read: {error}"))
}

/// By the reader of site folders, so that a file means the same here as there.
fn csv_record(site: &Site, bytes: &[u8]) -> Result<Record, Problem> {
    let rate_fps = rate_fps(bytes)?;
    let failed = |e: std::io::Error| Problem::unavailable(format!("no room to read it: {e}"));
    let folder = tempfile::tempdir().map_err(failed)?;
    let description = json!({
        "site": site.name, "sample_rate_fps": rate_fps, "nominal_hz": site.nominal_hz,
        "base_mva": site.s_base_mva, "base_kv": site.v_base_kv,
    });
    fs::write(folder.path().join("site.json"), description.to_string()).map_err(failed)?;
    fs::write(folder.path().join("event_01.csv"), bytes).map_err(failed)?;
    // Its errors name a path of ours: of no use to the reader.
    let place = format!("{}/", folder.path().display());
    let read = site_folder::load_events(folder.path())
        .map_err(|e| unfit(&e.to_string().replace(&place, "")))?;
    let event = read.events.into_iter().next();
    Ok(event.ok_or_else(|| unfit(&"it has no rows"))?.record)
}

/// The rate that most steps of `time_s` have, whole where it is nearly so.
fn rate_fps(bytes: &[u8]) -> Result<f64, Problem> {
    let text = String::from_utf8_lossy(bytes);
    let mut reader = csv::ReaderBuilder::new()
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.trim_start_matches('\u{feff}').as_bytes());
    let header = reader.headers().map_err(|e| unfit(&e))?;
    let column = header.iter().position(|name| name == "time_s");
    let column = column.ok_or_else(|| unfit(&"it has no column `time_s`"))?;
    let cells = reader.records().flatten();
    let times: Vec<f64> = cells
        .filter_map(|row| row.get(column)?.parse().ok())
        .take(STEPS_MAX)
        .collect();
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.retain(|step| step.is_finite() && *step > 0.0);
    steps.sort_by(f64::total_cmp);
    let middle = steps.get(steps.len() / 2);
    let middle = middle.ok_or_else(|| unfit(&"its times do not increase"))?;
    let rate = 1.0 / middle;
    // Times are written with some decimals: 0.0167 s stands for 60 frames/s.
    let whole = rate.round();
    Ok(if (rate - whole).abs() < 0.005 * rate {
        whole
    } else {
        rate
    })
}

fn comtrade_record(
    site: &Site,
    recording: &Recording,
    load: Option<usize>,
) -> Result<(Record, Option<String>), Problem> {
    if let Ok(record) = phasor_channels::record(recording, site) {
        return Ok((record, None));
    }
    let proposals = grouping::propose(recording, &grouping::group(recording));
    let chosen = match (load, proposals.as_slice()) {
        (_, []) => {
            return Err(unfit(
                &"it holds neither the channels of an exported event nor three voltages with three currents",
            ));
        }
        (None, [only]) => only,
        (Some(number), list) if (1..=list.len()).contains(&number) => &list[number - 1],
        (_, list) => {
            let names = (1..).zip(list).map(|(k, p)| format!("{k} is {}", p.label));
            let names: Vec<_> = names.collect();
            return Err(Problem::bad_request(format!(
                "the recording holds {} loads: say which by its number: {}",
                list.len(),
                names.join(", ")
            )));
        }
    };
    let record = chosen
        .mapping
        .record(recording, site)
        .map_err(|e| unfit(&e))?;
    let note = format!(
        "Taken as the load: currents {}, voltages {}. Their polarity is not known from the file.",
        chosen.label, chosen.voltage_label
    );
    Ok((record, Some(note)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::wire::v1::examples;

    fn csv(rows: usize) -> File {
        let row = |k: usize| {
            let voltage = if k > 60 { 0.9 } else { 1.0 };
            format!("{:.4},{voltage},60,0.8,0.2", k as f64 / 60.0)
        };
        let header = "time_s,v_pu,freq_hz,p_pu,q_pu".to_owned();
        let lines: Vec<String> = std::iter::once(header).chain((0..rows).map(row)).collect();
        let text = lines.join("\n");
        File {
            name: "Dip.CSV".to_owned(),
            bytes: text.into_bytes(),
        }
    }

    #[test]
    fn a_csv_file_becomes_a_window_with_its_own_rate() {
        let upload = read(&examples::site(), &[csv(200)], None).unwrap();
        assert!((upload.window.record.rate_fps - 60.0).abs() < 1e-9);
        assert_eq!(upload.window.record.samples.len(), 200);
        assert_eq!(upload.window.onset, 61);
    }

    #[test]
    fn an_exported_event_comes_back_as_it_was() {
        let site = examples::site();
        let record = read(&site, &[csv(200)], None).unwrap().window.record;
        let recording = phasor_channels::recording(&record, &site, None);
        let format = comtrade::DataFormat::Float32;
        let file = File {
            name: "event.cff".to_owned(),
            bytes: comtrade::encode_container(&recording, format).unwrap(),
        };
        let again = read(&site, &[file], None).unwrap().window.record;
        assert_eq!(again.samples.len(), 200);
        let (before, after) = (record.samples[100].active_pu, again.samples[100].active_pu);
        assert!((before - after).abs() < 1e-6, "{before} and {after}");
    }

    #[test]
    fn what_is_no_recording_is_refused_with_the_reason() {
        let file = |name: &str, text: &str| File {
            name: name.to_owned(),
            bytes: text.as_bytes().to_vec(),
        };
        let refused = |files: &[File]| read(&examples::site(), files, None).unwrap_err().detail;
        assert!(refused(&[file("a.csv", "t,v\n1,2\n")]).contains("time_s"));
        assert!(refused(&[file("a.csv", "time_s,v_pu\n0,1\n0.1,1\n")]).contains("freq_hz"));
        assert!(refused(&[file("a.cff", "hello")]).contains("cannot be read"));
        assert!(refused(&[file("a.exe", "MZ")]).contains(".csv"));
        assert!(refused(&[file("a.cfg", ""), file("b.txt", "")]).contains(".dat"));
    }

    #[test]
    fn the_oldest_recording_makes_room() {
        let uploads = Uploads::default();
        for rows in 0..KEPT_MAX + 2 {
            uploads.keep(read(&examples::site(), &[csv(200 + rows)], None).unwrap());
        }
        assert_eq!(uploads.of(&examples::site().name).len(), KEPT_MAX);
        assert!(uploads.of("elsewhere").is_empty());
    }
}
