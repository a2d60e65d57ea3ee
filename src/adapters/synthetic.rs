//! Synthetic sites on disk: a site folder like any other, and beside it what is true of it.
//!
//! ```text
//! <parent>/<site>/site.json, event_01.csv, ...     what a program may see
//! <parent>/<site>.truth.json                       what it is judged by
//! ```

use std::{
    fs, io,
    path::{Path, PathBuf},
};

use jiff::Timestamp;
use serde_json::{Value, json};

use crate::{
    measurement::{Quality, Record},
    truth::{EventTruth, LoadBaseParameters, MotorCircuit, SyntheticSite, Zip},
};

/// STAT bits are the low half of [`Quality`]; what intake adds never leaves the program.
const STAT_BITS: u32 = 0xFFFF;

/// Where a synthetic site was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrittenSite {
    /// The site folder.
    pub folder: PathBuf,
    /// The truth file.
    pub truth: PathBuf,
}

/// Why a synthetic site could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SyntheticError {
    /// A directory or file could not be written.
    #[error("cannot write {}", .path.display())]
    Write {
        /// What was to be written.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The folder holds events already, which would mix with the new ones.
    #[error("{} holds events already; remove it or choose another place", .path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
    },
    /// The site's name cannot be the name of a folder and of a key.
    #[error(
        "site name `{name}` must be made of letters, digits, `-`, `_` and `.`, and begin with a letter or digit"
    )]
    Name {
        /// The name.
        name: String,
    },
}

/// Writes `site` below `parent`.
///
/// # Errors
///
/// [`SyntheticError::Name`], [`SyntheticError::Occupied`] before anything is written,
/// [`SyntheticError::Write`] naming the path.
pub fn write(site: &SyntheticSite, parent: &Path) -> Result<WrittenSite, SyntheticError> {
    let name = checked_name(&site.options.site.name)?;
    let folder = parent.join(name);
    if folder.join(event_file(0)).exists() {
        return Err(SyntheticError::Occupied { path: folder });
    }
    let truth = parent.join(format!("{name}.truth.json"));
    let failed = |path: &Path| {
        let path = path.to_path_buf();
        move |source| SyntheticError::Write { path, source }
    };
    fs::create_dir_all(&folder).map_err(failed(&folder))?;
    for (index, record) in site.records.iter().enumerate() {
        let path = folder.join(event_file(index));
        fs::write(&path, csv(record)).map_err(failed(&path))?;
    }
    for (path, document) in [
        (folder.join("site.json"), description(site)),
        (truth.clone(), truth_document(site)),
    ] {
        fs::write(&path, format!("{document:#}\n")).map_err(failed(&path))?;
    }
    Ok(WrittenSite { folder, truth })
}

/// `name`, if it can be a folder and a chunk of a key expression.
///
/// # Errors
///
/// [`SyntheticError::Name`].
pub fn checked_name(name: &str) -> Result<&str, SyntheticError> {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    let begins_well = name.starts_with(|c: char| c.is_ascii_alphanumeric());
    if begins_well && name.chars().all(plain) && name.len() <= 64 {
        Ok(name)
    } else {
        Err(SyntheticError::Name {
            name: name.to_owned(),
        })
    }
}

fn event_file(index: usize) -> String {
    format!("event_{:02}.csv", index + 1)
}

/// Rows of a record; a missing sample has no row, a value that is not a number an empty cell.
fn csv(record: &Record) -> String {
    let mut text = String::from("time_s,v_pu,angle_deg,freq_hz,p_pu,q_pu,stat\n");
    for (index, sample) in record.samples.iter().enumerate() {
        if sample.quality.contains(Quality::MISSING) {
            continue;
        }
        let cells = [
            cell(index as f64 / record.rate_fps, 6),
            cell(sample.voltage_pu, 6),
            cell(sample.angle_rad.to_degrees(), 4),
            cell(sample.frequency_hz, 5),
            cell(sample.active_pu, 6),
            cell(sample.reactive_pu, 6),
            (sample.quality.0 & STAT_BITS).to_string(),
        ];
        text.push_str(&cells.join(","));
        text.push('\n');
    }
    text
}

fn cell(value: f64, decimals: usize) -> String {
    if value.is_finite() {
        format!("{value:.decimals$}")
    } else {
        String::new()
    }
}

fn description(site: &SyntheticSite) -> Value {
    let of = &site.options.site;
    let events: Vec<_> = site
        .records
        .iter()
        .enumerate()
        .map(|(index, record)| json!({ "file": event_file(index), "utc": utc(record.start_ns) }))
        .collect();
    json!({
        "site": of.name,
        "sample_rate_fps": site.options.rate_fps,
        "nominal_hz": of.nominal_hz,
        "base_mva": of.s_base_mva,
        "base_kv": of.v_base_kv,
        "columns": {
            "time_s": "seconds from window start",
            "v_pu": "positive-sequence magnitude / base_kv",
            "angle_deg": "relative to nominal-frequency frame",
            "freq_hz": "bus frequency",
            "p_pu": "real power into the load / base_mva",
            "q_pu": "reactive power into the load / base_mva",
            "stat": "0 good; 32768 data invalid; 8192 time sync lost; 16 stale/interpolated",
        },
        "events": events,
    })
}

fn utc(time_ns: i64) -> String {
    Timestamp::from_nanosecond(i128::from(time_ns))
        .map_or_else(|_| time_ns.to_string(), |time| time.to_string())
}

fn truth_document(site: &SyntheticSite) -> Value {
    let options = &site.options;
    let mut also_present = Vec::new();
    if options.filter_cycles > 0.0 {
        also_present.push("phasor_window");
    }
    if options.motor.stator_resistance > 0.0 {
        also_present.push("stator_resistance");
    }
    let events: Vec<_> = site
        .truth
        .iter()
        .enumerate()
        .map(|(index, truth)| event_document(index, truth))
        .collect();
    json!({
        "site": options.site.name,
        "effects": [],
        "also_present": also_present,
        "simulator": concat!(
            "loadmodeld generate ", env!("CARGO_PKG_VERSION"),
            ": rotor flux linkages, closed-loop network, Dormand-Prince 5(4)"
        ),
        "seed": options.seed,
        "zip_im": {
            "kpm": options.motor_share,
            "motor": motor_circuit(&options.motor),
            "zip": zip(&options.zip),
            "motor_fields": "pu on machine base; LF = active power over rating",
        },
        "parameters": load_base(&site.motor),
        "noise_rel": options.noise,
        "pmu_filter_cycles": options.filter_cycles,
        "p0_pu": options.active_pu,
        "q0_pu": options.reactive_pu,
        "level_spread": options.level_spread,
        "composition_spread": options.composition_spread,
        "events": events,
    })
}

fn motor_circuit(motor: &MotorCircuit) -> Value {
    json!({
        "rs": motor.stator_resistance,
        "lls": motor.stator_reactance,
        "lm": motor.magnetising_reactance,
        "rr": motor.rotor_resistance,
        "llr": motor.rotor_reactance,
        "h": motor.inertia_s,
        "LF": motor.load_factor,
    })
}

fn zip(zip: &Zip) -> Value {
    json!({
        "Pz": zip.active_impedance,
        "Pi": zip.active_current,
        "Pp": 1.0 - zip.active_impedance - zip.active_current,
        "Qz": zip.reactive_impedance,
        "Qi": zip.reactive_current,
        "Qq": 1.0 - zip.reactive_impedance - zip.reactive_current,
    })
}

fn load_base(motor: &LoadBaseParameters) -> Value {
    json!({
        "M": motor.inertia,
        "T0_prime": motor.transient_open_circuit_time_constant_s,
        "X": motor.reactance,
        "X_prime": motor.transient_reactance,
    })
}

fn event_document(index: usize, truth: &EventTruth) -> Value {
    let plan = &truth.plan;
    let bad_samples = truth
        .bad_samples
        .map(|bad| json!({ "kind": bad.defect.name(), "first": bad.first, "rows": bad.count }));
    json!({
        "event": index + 1,
        "file": event_file(index),
        "kind": plan.kind.name(),
        "t_event": plan.onset_s,
        "cycles": plan.cycles,
        "sag_target": if plan.kind.is_fault() { json!(plan.retained) } else { Value::Null },
        "v0": truth.voltage_pu,
        "p0_pu": truth.active_pu,
        "q0_pu": truth.reactive_pu,
        "kpm": truth.motor_share,
        "zip": zip(&truth.zip),
        "parameters": load_base(&truth.motor),
        "v_min": truth.lowest_voltage_pu,
        "f_min": truth.frequency_range_hz.0,
        "f_max": truth.frequency_range_hz.1,
        "bad_samples": bad_samples,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        measurement::Site,
        truth::{SiteOptions, generate},
    };

    fn site(name: &str) -> SyntheticSite {
        let site = Site {
            name: name.to_owned(),
            s_base_mva: 200.0,
            v_base_kv: 23.0,
            nominal_hz: 60.0,
        };
        let options = SiteOptions {
            events: 2,
            duration_s: 4.0,
            ..SiteOptions::new(site, 11)
        };
        generate(&options, &mut |_| ()).unwrap()
    }

    #[test]
    fn a_site_folder_holds_its_events_and_the_truth_lies_beside_it() {
        let parent = tempfile::tempdir().unwrap();
        let site = site("synthetic-1");
        let written = write(&site, parent.path()).unwrap();
        let description: Value =
            serde_json::from_str(&fs::read_to_string(written.folder.join("site.json")).unwrap())
                .unwrap();
        assert_eq!(description["sample_rate_fps"], 60.0);
        assert_eq!(description["events"][1]["file"], "event_02.csv");
        assert_eq!(description["events"][1]["utc"], "2026-01-06T04:14:00Z");
        let truth: Value =
            serde_json::from_str(&fs::read_to_string(&written.truth).unwrap()).unwrap();
        assert_eq!(truth["effects"], json!([]));
        assert_eq!(truth["events"][0]["kind"], "fault");
        assert!(
            !fs::read_to_string(written.folder.join("site.json"))
                .unwrap()
                .contains("kpm")
        );
        assert_eq!(fs::read_dir(&written.folder).unwrap().count(), 3);
    }

    #[test]
    fn a_gap_has_no_rows_and_a_value_that_is_no_number_an_empty_cell() {
        let site = site("synthetic-1");
        let index = site.truth.iter().position(|t| t.bad_samples.is_none());
        let mut record = site.records[index.unwrap_or(0)].clone();
        let sample = &mut record.samples[5];
        sample.active_pu = f64::NAN;
        sample.quality = Quality::NOT_FINITE;
        let gap = record.samples[7].time_ns;
        record.samples[7] = crate::measurement::Sample::missing(gap);
        let text = csv(&record);
        let rows: Vec<_> = text.lines().collect();
        assert_eq!(rows.len(), record.samples.len());
        let cells: Vec<_> = rows[6].split(',').collect();
        assert_eq!((cells[4], cells[6]), ("", "0"));
        assert!(rows[8].starts_with("0.133333,"), "{}", rows[8]);
    }

    #[test]
    fn an_occupied_folder_is_left_alone() {
        let parent = tempfile::tempdir().unwrap();
        let site = site("synthetic-1");
        write(&site, parent.path()).unwrap();
        let error = write(&site, parent.path()).unwrap_err();
        assert!(
            error.to_string().contains("holds events already"),
            "{error}"
        );
    }

    #[test]
    fn a_name_that_leaves_the_folder_is_refused() {
        for name in ["../x", "", "a/b", "a b", ".hidden", "a*"] {
            assert!(checked_name(name).is_err(), "{name}");
        }
        assert!(checked_name("site-02_b.1").is_ok());
    }
}
