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

use serde_json::{Value, json};

use super::recordings::site_folder::{self, FolderEvent, Intake};
use crate::{
    measurement::Record,
    truth::{
        Effect, EventTruth, HiddenEffect, LoadBaseParameters, MotorCircuit, SyntheticSite, Zip,
        estimator_terms,
    },
};

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
    /// The site folder could not be written.
    #[error(transparent)]
    Folder(#[from] site_folder::Error),
    /// The truth file could not be written.
    #[error("cannot write {}", .path.display())]
    Truth {
        /// The file.
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
/// [`SyntheticError::Folder`] and [`SyntheticError::Truth`] naming the path.
pub fn write(site: &SyntheticSite, parent: &Path) -> Result<WrittenSite, SyntheticError> {
    let name = checked_name(&site.options.site.name)?;
    let folder = parent.join(name);
    if folder.join(event_file(0)).exists() {
        return Err(SyntheticError::Occupied { path: folder });
    }
    let truth = parent.join(format!("{name}.truth.json"));
    let events: Vec<_> = site.records.iter().enumerate().map(folder_event).collect();
    let options = &site.options;
    site_folder::write(&folder, &options.site, options.rate_fps, &events)?;
    let document = format!("{:#}\n", truth_document(site));
    fs::write(&truth, document).map_err(|source| SyntheticError::Truth {
        path: truth.clone(),
        source,
    })?;
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

fn event_name(index: usize) -> String {
    format!("event_{:02}", index + 1)
}

fn event_file(index: usize) -> String {
    format!("{}.csv", event_name(index))
}

fn folder_event((index, record): (usize, &Record)) -> FolderEvent {
    FolderEvent {
        name: event_name(index),
        utc_ns: Some(record.start_ns),
        record: record.clone(),
        intake: Intake::default(),
    }
}

fn truth_document(site: &SyntheticSite) -> Value {
    let options = &site.options;
    let names: Vec<_> = options.effects.iter().map(|h| h.effect().name()).collect();
    let events: Vec<_> = site
        .truth
        .iter()
        .enumerate()
        .map(|(index, truth)| event_document(index, truth))
        .collect();
    let showing: Vec<_> = (0..events.len())
        .filter(|index| !site.truth[*index].showing.is_empty())
        .map(event_file)
        .collect();
    let mut parameters = load_base(&site.motor);
    parameters["effects"] = effect_parameters(&options.effects);
    parameters["estimator_terms"] = terms(site);
    json!({
        "site": options.site.name,
        "effects": names,
        "also_present": also_present(site),
        "equally_right": equally_right(&options.effects),
        "simulator": concat!(
            "loadmodeld generate ", env!("CARGO_PKG_VERSION"),
            ": rotor flux linkages, closed-loop network, Dormand-Prince 5(4), discrete relays"
        ),
        "seed": options.seed,
        "zip_im": {
            "kpm": options.motor_share,
            "motor": motor_circuit(&options.motor),
            "zip": zip(&options.zip),
            "motor_fields": "pu on machine base; LF = active power over rating",
        },
        "parameters": parameters,
        "noise_rel": options.noise,
        "pmu_filter_cycles": options.filter_cycles,
        "p0_pu": options.active_pu,
        "q0_pu": options.reactive_pu,
        "level_spread": options.level_spread,
        "composition_spread": options.composition_spread,
        "events_showing_effect": showing,
        "events": events,
    })
}

/// What is in the data besides, so that naming it is right.
fn also_present(site: &SyntheticSite) -> Vec<&'static str> {
    let options = &site.options;
    let hidden = |effect: Effect| options.effects.iter().any(|h| h.effect() == effect);
    let mut present = Vec::new();
    if options.filter_cycles > 0.0 && !hidden(Effect::PhasorWindow) {
        present.push(Effect::PhasorWindow);
    }
    if options.motor.stator_resistance > 0.0 && !hidden(Effect::StatorResistance) {
        present.push(Effect::StatorResistance);
    }
    let behind = options
        .effects
        .iter()
        .find(|h| h.effect() == Effect::TapChanger);
    if behind.is_some_and(|taps| taps.value("reactance_pu") > 0.0)
        && !hidden(Effect::FeederImpedance)
    {
        present.push(Effect::FeederImpedance);
    }
    present.into_iter().map(Effect::name).collect()
}

/// Other names that describe the same data as well.
fn equally_right(effects: &[HiddenEffect]) -> Vec<&'static str> {
    let others = effects.iter().filter_map(|hidden| match hidden.effect() {
        // What never returns has disconnected, and a block that disconnects has dropped out.
        Effect::ElectronicLoadDropout if hidden.value("returning") < 0.05 => {
            Some(Effect::SelfDisconnection)
        }
        Effect::SelfDisconnection if hidden.value("power_factor") > 0.97 => {
            Some(Effect::ElectronicLoadDropout)
        }
        _ => None,
    });
    others.map(Effect::name).collect()
}

fn effect_parameters(effects: &[HiddenEffect]) -> Value {
    let effects = effects.iter().map(|hidden| {
        let values = hidden.values().map(|(declared, value)| {
            let value = declared
                .word(value)
                .map_or_else(|| json!(value), |word| json!(word));
            (declared.name.to_owned(), value)
        });
        (
            hidden.effect().name().to_owned(),
            Value::Object(values.collect()),
        )
    });
    Value::Object(effects.collect())
}

fn terms(site: &SyntheticSite) -> Value {
    let effects = estimator_terms(site).into_iter().map(|terms| {
        let values = terms.values.into_iter();
        let values = values.map(|(name, value)| (name.to_owned(), json!(value)));
        (
            terms.effect.name().to_owned(),
            Value::Object(values.collect()),
        )
    });
    Value::Object(effects.collect())
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
    let parts: Vec<_> = truth
        .powers
        .iter()
        .map(|power| json!({ "n": power.part, "p": power.active_pu, "q": power.reactive_pu }))
        .collect();
    let operations: Vec<_> = truth
        .operations
        .iter()
        .map(|o| json!({ "t": o.time_s, "part": o.part, "action": o.action }))
        .collect();
    let showing: Vec<_> = truth.showing.iter().map(|effect| effect.name()).collect();
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
        "parts": parts,
        "operations": operations,
        "shows": showing,
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
    fn the_truth_file_says_what_is_hidden_with_which_values_and_when_it_acts() {
        let parent = tempfile::tempdir().unwrap();
        let mut options = site("hidden-1").options;
        options.events = 4;
        let hidden = HiddenEffect::drawn(Effect::SelfDisconnection, 11);
        let share = hidden.value("share");
        let made = generate(&options.hiding(vec![hidden]), &mut |_| ()).unwrap();
        let written = write(&made, parent.path()).unwrap();
        let truth: Value =
            serde_json::from_str(&fs::read_to_string(&written.truth).unwrap()).unwrap();
        assert_eq!(truth["effects"], json!(["self_disconnection"]));
        assert_eq!(truth["also_present"], json!(["phasor_window"]));
        let hidden = &truth["parameters"]["effects"]["self_disconnection"];
        assert!((hidden["share"].as_f64().unwrap() - share).abs() < 1e-12);
        let showing = truth["events_showing_effect"].as_array().unwrap();
        assert!((1..4).contains(&showing.len()), "{showing:?}");
        let first = &truth["events"][0];
        assert_eq!(first["shows"], json!(["self_disconnection"]));
        assert_eq!(first["operations"][0]["action"], "drop");
        let total: f64 = first["parts"]
            .as_array()
            .unwrap()
            .iter()
            .map(|part| part["p"].as_f64().unwrap())
            .sum();
        assert!((total - first["p0_pu"].as_f64().unwrap()).abs() < 1e-9);
    }

    #[test]
    fn what_was_written_is_read_back_with_every_flag_but_those_of_intake() {
        let parent = tempfile::tempdir().unwrap();
        let site = site("synthetic-1");
        let written = write(&site, parent.path()).unwrap();
        let folder = site_folder::load_events(&written.folder).unwrap();
        assert_eq!(folder.site, site.options.site);
        assert_eq!(folder.notes.len(), 0);
        for (event, record) in folder.events.iter().zip(&site.records) {
            assert_eq!(event.record.start_ns, record.start_ns);
            for (read, made) in event.record.samples.iter().zip(&record.samples) {
                assert_eq!(read.usable(), made.usable(), "{made:?}");
                if made.usable() {
                    assert!((read.active_pu - made.active_pu).abs() < 1e-8);
                    assert!((read.angle_rad - made.angle_rad).abs() < 1e-8);
                }
            }
        }
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
