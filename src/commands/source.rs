//! Where the events of a site come from, and what is known of the site: a folder or the store of a
//! daemon, and the daemon's configuration.

use std::path::{Path, PathBuf};

use super::misuse::{self, Misuse};
use crate::{
    adapters::{
        recordings::site_folder::{self, Note},
        store::{SqliteOptions, SqliteStore, Store, StoreError},
    },
    config::{Config, Problems, SiteConfig},
    daemon::{Settings, SettingsError},
    diagnosis::DiagnosisOptions,
    disturbance::{ScreeningOptions, Window, screen},
    identification::IdentificationOptions,
    load_model::Structure,
    measurement::Site,
};

/// Where the events of a site come from.
#[derive(Clone, Debug, clap::Args)]
pub struct SourceArgs {
    /// The site folder (site.json and event_*.csv); with --store the name of the site.
    #[arg(value_name = "SITE_DIR")]
    pub site: PathBuf,
    /// Takes the site's disturbances from the store of a daemon.
    #[arg(long, value_name = "FILE")]
    pub store: Option<PathBuf>,
    /// Takes from this configuration of a daemon what it says of the site: its structure, bounds and
    /// priors of its parameters, screening, settings of fits and diagnoses, and effect files.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
}

/// The events of a site, cut and screened as the daemon does, and how it is fitted.
#[derive(Debug)]
pub(super) struct Events {
    /// The site.
    pub(super) site: Site,
    /// Windows that screening lets pass.
    pub(super) usable: Vec<Window>,
    /// Event and why it is not used.
    pub(super) refused: Vec<(String, String)>,
    /// What the reader should know.
    pub(super) notes: Vec<String>,
    /// The structure that the site has by the store or the configuration; that of every model where neither says.
    pub(super) structure: Vec<String>,
    /// Settings of fits.
    pub(super) identification: IdentificationOptions,
    /// Settings of diagnoses.
    pub(super) diagnosis: DiagnosisOptions,
}

/// Why there are no events.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SourceError {
    /// The site folder.
    #[error(transparent)]
    Folder(#[from] site_folder::Error),
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The store has no such site.
    #[error("{} holds no site `{site}`; it holds: {known}", .store.display())]
    UnknownSite {
        /// The store.
        store: PathBuf,
        /// The name.
        site: String,
        /// The names it holds.
        known: String,
    },
    /// The store does not exist; reading must not make one.
    #[error("{} does not exist", .store.display())]
    NoStore {
        /// The store.
        store: PathBuf,
    },
    /// The configuration has problems.
    #[error(transparent)]
    Configuration(#[from] Problems),
    /// The configuration asks for what cannot be done.
    #[error(transparent)]
    Settings(#[from] SettingsError),
}

/// Windows of a stored site that are read at most, the newest first.
const STORED_WINDOWS_MAX: usize = 200;

impl SourceArgs {
    /// Reads, cuts and screens the events of a site.
    ///
    /// # Errors
    ///
    /// See [`SourceError`].
    pub(super) fn events(&self) -> Result<Events, SourceError> {
        let config = self.config.as_deref().map(Config::load).transpose()?;
        let mut events = match &self.store {
            None => from_folder(&self.site, config.as_ref())?,
            Some(store) => from_store(store, &self.site.to_string_lossy())?,
        };
        if let (Some(config), Some(path)) = (config, &self.config) {
            events.configured_by(&config, path, self.store.is_some())?;
        }
        Ok(events)
    }
}

fn from_folder(path: &Path, config: Option<&Config>) -> Result<Events, SourceError> {
    let folder = site_folder::load_events(path)?;
    let mut events = Events::none_of(folder.site);
    for note in folder.notes {
        match note {
            Note::EventLeftOut { event, error } => events.refused.push((event, error.to_string())),
            other => events.notes.push(other.to_string()),
        }
    }
    let screening = config.map_or_else(ScreeningOptions::default, |config| {
        of_site(config, &events.site).screening
    });
    for event in &folder.events {
        let window = Window {
            id: event.name.clone(),
            ..site_folder::window(&events.site, &event.record)
        };
        events.admit(window, &screening);
    }
    Ok(events)
}

fn from_store(path: &Path, name: &str) -> Result<Events, SourceError> {
    if !path.exists() {
        return Err(SourceError::NoStore {
            store: path.to_path_buf(),
        });
    }
    let store = SqliteStore::open(path, &SqliteOptions::default())?;
    let sites = store.sites()?;
    let Some(site) = sites.iter().find(|site| site.name == name) else {
        let known: Vec<&str> = sites.iter().map(|site| site.name.as_str()).collect();
        return Err(SourceError::UnknownSite {
            store: path.to_path_buf(),
            site: name.to_owned(),
            known: known.join(", "),
        });
    };
    let mut events = Events::none_of(site.clone());
    events.usable = store.usable_windows(name, STORED_WINDOWS_MAX)?;
    events.usable.sort_by_key(Window::onset_ns);
    if let Some(newest) = store.structures(name, 1)?.into_iter().next() {
        events.structure = newest.structure;
    }
    Ok(events)
}

impl Events {
    fn none_of(site: Site) -> Self {
        Self {
            site,
            usable: Vec::new(),
            refused: Vec::new(),
            notes: Vec::new(),
            structure: Structure::zip_im().names(),
            identification: IdentificationOptions::default(),
            diagnosis: DiagnosisOptions::default(),
        }
    }

    fn admit(&mut self, window: Window, screening: &ScreeningOptions) {
        let verdict = screen(&window, screening);
        if verdict.usable() {
            self.usable.push(window);
        } else {
            let reasons: Vec<String> = verdict.refusals.iter().map(ToString::to_string).collect();
            self.refused.push((window.id, reasons.join("; ")));
        }
    }

    /// The structure of a store is newer than that of a configuration.
    fn configured_by(
        &mut self,
        config: &Config,
        path: &Path,
        is_stored: bool,
    ) -> Result<(), SettingsError> {
        let name = &self.site.name;
        if config.site(name).is_none() {
            self.notes.push(format!(
                "{} lists no site `{name}`: only what it says of all sites is taken",
                path.display()
            ));
        }
        let options = Settings::from_config(config)?.options_of(name);
        self.identification = options.identification;
        self.diagnosis = options.diagnosis;
        if !is_stored {
            self.structure = of_site(config, &self.site).structure;
        }
        Ok(())
    }

    /// The parts of the model: those that were asked for, or those of the site.
    ///
    /// # Errors
    ///
    /// [`Misuse`] where they cannot be composed.
    pub(super) fn parts(&self, asked: Option<&str>) -> Result<Vec<String>, Misuse> {
        let parts = asked.map_or_else(|| self.structure.clone(), parts_of);
        misuse::no_impossible_change(&parts, &[], &[])?;
        Ok(parts)
    }
}

/// What a configuration says of a site, listed or not.
fn of_site(config: &Config, site: &Site) -> SiteConfig {
    let listed = config.site(&site.name).cloned();
    listed.unwrap_or_else(|| config.for_unlisted(site.clone()))
}

/// The parts of `A+B` by name.
pub(super) fn parts_of(structure: &str) -> Vec<String> {
    let parts = structure.split('+');
    parts.map(|part| part.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::adapters::{
        bundled,
        store::{NewStructure, Origin, StructureChange},
    };

    fn folder(parent: &Path) -> SourceArgs {
        SourceArgs {
            site: bundled::sites()[0].extract_to(parent).unwrap(),
            store: None,
            config: None,
        }
    }

    #[test]
    fn an_event_that_cannot_be_read_is_among_the_refused() {
        let parent = tempfile::tempdir().unwrap();
        let source = folder(parent.path());
        fs::remove_file(source.site.join("event_02.csv")).unwrap();
        fs::write(source.site.join("event_03.csv"), "nonsense\n").unwrap();
        let events = source.events().unwrap();
        let reason = |name: &str| {
            let found = events.refused.iter().find(|(event, _)| event == name);
            found.map(|(_, reason)| reason.clone()).unwrap_or_default()
        };
        assert!(
            reason("event_02").contains("event_02.csv"),
            "{:?}",
            events.refused
        );
        assert!(
            reason("event_03").contains("time_s"),
            "{:?}",
            events.refused
        );
        assert!(events.notes.is_empty(), "{:?}", events.notes);
        assert!(events.usable.iter().all(|window| window.id != "event_02"));
    }

    #[test]
    fn a_configuration_says_how_its_site_is_fitted() {
        let parent = tempfile::tempdir().unwrap();
        let mut source = folder(parent.path());
        let plain = source.events().unwrap();
        assert_eq!(plain.structure, ["zip", "induction_motor"]);
        assert_eq!(plain.identification, IdentificationOptions::default());
        let config = parent.path().join("c.toml");
        source.config = Some(config.clone());
        let text = |name: &str| {
            format!(
                "[diagnosis]\nmax_refits = 3\n[[site]]\nname = {name:?}\ns_base_mva = 40\nv_base_kv = 110\n\
                 nominal_hz = 50\nstructure = [\"zip\", \"induction_motor\", \"second_motor\"]\n\
                 [[site.parameter]]\nname = \"motor_share\"\nlower = 0.3\n"
            )
        };
        fs::write(&config, text(&plain.site.name)).unwrap();
        let events = source.events().unwrap();
        assert_eq!(
            events.parts(None).unwrap(),
            ["zip", "induction_motor", "second_motor"]
        );
        assert_eq!(
            events.parts(Some("zip + induction_motor")).unwrap().len(),
            2
        );
        assert!(events.parts(Some("zip+nonsense")).is_err());
        assert_eq!(events.diagnosis.refits_max, 3);
        for fit in [&events.identification, &events.diagnosis.identification] {
            assert_eq!(fit.ranges.of("motor_share").unwrap().lower, Some(0.3));
        }
        assert!(events.notes.is_empty(), "{:?}", events.notes);
        fs::write(&config, text("elsewhere")).unwrap();
        let events = source.events().unwrap();
        assert_eq!(events.structure, plain.structure);
        assert!(events.identification.ranges.of("motor_share").is_none());
        assert!(
            events.notes[0].contains("lists no site"),
            "{:?}",
            events.notes
        );
        fs::write(&config, "[diagnosis]\nmax_refits = 0\n").unwrap();
        let error = source.events().unwrap_err().to_string();
        assert!(error.contains("max_refits"), "{error}");
    }

    #[test]
    fn a_stored_site_has_the_structure_that_it_was_given_last() {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("store.sqlite");
        let store = SqliteStore::open(&path, &SqliteOptions::default()).unwrap();
        let site = Site {
            name: "north".to_owned(),
            s_base_mva: 40.0,
            v_base_kv: 110.0,
            nominal_hz: 50.0,
        };
        store.save_site(&site, 1).unwrap();
        let source = SourceArgs {
            site: "north".into(),
            store: Some(path),
            config: None,
        };
        assert_eq!(source.events().unwrap().structure.len(), 2);
        let parts = ["zip", "induction_motor", "saturation"].map(str::to_owned);
        let new = NewStructure {
            site: "north",
            change: &StructureChange::Set(parts.to_vec()),
            origin: Origin::Configuration,
            actor: "service",
            comment: "",
        };
        store.change_structure(&new, 2).unwrap();
        assert_eq!(source.events().unwrap().structure, parts);
    }
}
