//! What `identify` and `compare` share: the options of a fit, and the fit of a site folder.

use std::{
    path::{Path, PathBuf},
    time::{Duration, Instant},
};

use super::misuse::{self, Misuse};
use crate::{
    adapters::{
        recordings::site_folder::{self, Note},
        store::{SqliteOptions, SqliteStore, Store, StoreError},
    },
    disturbance::{ScreeningOptions, Window, screen},
    identification::{
        self, Identification, IdentificationError, IdentificationOptions, RobustLoss, Split,
        fit::{Formulation, SearchOptions},
        joint_problem::PAPER_SHARES,
    },
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
}

/// The events of a site, cut and screened as the daemon does.
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
}

/// Options of a fit.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct FitArgs {
    /// Parts of the model.
    #[arg(long, value_name = "A+B", default_value = "zip+induction_motor")]
    pub structure: String,
    /// Events to fit, by name; default: all that are not held out.
    #[arg(long, value_name = "EVENT,...", value_delimiter = ',')]
    pub train: Vec<String>,
    /// Events to hold out, by name; default: a third, or none with --train.
    #[arg(long, value_name = "EVENT,...", value_delimiter = ',')]
    pub hold_out: Vec<String>,
    /// Bounds the static shares of P to 0.1 to 0.9 and the motor share from 0.1, as the paper does.
    #[arg(long)]
    pub paper_box: bool,
    /// Lets samples with large residuals count less: `huber` or `cauchy`.
    #[arg(long, value_name = "LOSS")]
    pub robust: Option<RobustArg>,
    /// In which unknowns to search: three nonlinear coordinates, or the paper's nine parameters in
    /// its box (14) (with decades in logarithms, or all as they are).
    #[arg(long, value_enum, default_value_t = FormulationArg::Reduced)]
    pub formulation: FormulationArg,
}

/// Losses of a robust fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum RobustArg {
    /// Huber's: bounds the influence of an outlier
    Huber,
    /// Cauchy's: far outliers lose all influence
    Cauchy,
}

/// In which unknowns to search.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum FormulationArg {
    /// Three nonlinear coordinates.
    #[default]
    Reduced,
    /// The paper's nine parameters, decades in logarithms.
    Paper,
    /// The paper's nine parameters as they are.
    PaperLinear,
}

impl FitArgs {
    /// The settings these options stand for.
    #[must_use]
    pub fn options(&self) -> IdentificationOptions {
        let named = !(self.train.is_empty() && self.hold_out.is_empty());
        let mut default = IdentificationOptions::default();
        default.problem.static_shares = self.paper_box.then_some(PAPER_SHARES);
        default.robust = self.robust.map(|loss| match loss {
            RobustArg::Huber => RobustLoss::HUBER,
            RobustArg::Cauchy => RobustLoss::CAUCHY,
        });
        default.search = SearchOptions::of(match self.formulation {
            FormulationArg::Reduced => Formulation::Reduced,
            FormulationArg::Paper => Formulation::Paper,
            FormulationArg::PaperLinear => Formulation::PaperLinear,
        });
        if !named {
            return default;
        }
        let split = Split::Named {
            fitted: self.train.clone(),
            held_out: self.hold_out.clone(),
        };
        IdentificationOptions { split, ..default }
    }

    /// Refuses what cannot be, before anything is read.
    ///
    /// # Errors
    ///
    /// See [`Misuse`].
    pub fn check(&self) -> Result<(), Misuse> {
        misuse::no_event_twice(&self.train, &self.hold_out)?;
        misuse::no_impossible_change(&self.parts(), &[], &[])
    }

    /// The parts of the model by name.
    #[must_use]
    pub fn parts(&self) -> Vec<String> {
        parts_of(&self.structure)
    }
}

/// The parts of `A+B` by name.
pub(super) fn parts_of(structure: &str) -> Vec<String> {
    let parts = structure.split('+');
    parts.map(|part| part.trim().to_owned()).collect()
}

/// Windows of a stored site that are read at most, the newest first.
const STORED_WINDOWS_MAX: usize = 200;

/// Reads, cuts and screens the events of a site.
///
/// # Errors
///
/// See [`SourceError`].
pub(super) fn events(args: &SourceArgs) -> Result<Events, SourceError> {
    match &args.store {
        None => from_folder(&args.site),
        Some(store) => from_store(store, &args.site.to_string_lossy()),
    }
}

fn from_folder(path: &Path) -> Result<Events, SourceError> {
    let folder = site_folder::load_events(path)?;
    let mut events = Events {
        usable: Vec::new(),
        refused: Vec::new(),
        notes: Vec::new(),
        site: folder.site,
    };
    for note in folder.notes {
        match note {
            Note::EventLeftOut { event, error } => events.refused.push((event, error.to_string())),
            other => events.notes.push(other.to_string()),
        }
    }
    for event in &folder.events {
        let window = Window {
            id: event.name.clone(),
            ..site_folder::window(&events.site, &event.record)
        };
        events.admit(window);
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
    let mut windows = store.usable_windows(name, STORED_WINDOWS_MAX)?;
    windows.sort_by_key(Window::onset_ns);
    Ok(Events {
        site: site.clone(),
        usable: windows,
        refused: Vec::new(),
        notes: Vec::new(),
    })
}

impl Events {
    fn admit(&mut self, window: Window) {
        let verdict = screen(&window, &ScreeningOptions::default());
        if verdict.usable() {
            self.usable.push(window);
        } else {
            let reasons: Vec<String> = verdict.refusals.iter().map(ToString::to_string).collect();
            self.refused.push((window.id, reasons.join("; ")));
        }
    }
}

/// Fits the usable windows, with a spinner on a terminal; the cost carries the wall-clock time.
///
/// # Errors
///
/// See [`IdentificationError`].
#[allow(
    clippy::disallowed_methods,
    reason = "a command is where wall-clock time is measured"
)]
pub(super) fn identify(
    args: &FitArgs,
    events: &Events,
    options: &IdentificationOptions,
) -> Result<Identification, IdentificationError> {
    let spinner = indicatif::ProgressBar::new_spinner();
    spinner.set_message(format!("identifying from {} events", events.usable.len()));
    spinner.enable_steady_tick(Duration::from_millis(120));
    let begun = Instant::now();
    let found = identification::identify(
        &events.site,
        &events.usable,
        &args.parts(),
        options,
        &|| false,
    );
    spinner.finish_and_clear();
    let mut found = found.map_err(|error| with_screened(error, &events.refused))?;
    found.cost.seconds = begun.elapsed().as_secs_f64();
    found.refused.extend(events.refused.iter().cloned());
    found.refused.sort();
    Ok(found)
}

fn with_screened(error: IdentificationError, screened: &[(String, String)]) -> IdentificationError {
    match error {
        IdentificationError::NoUsableEvent { mut refused } => {
            refused.extend(screened.iter().cloned());
            IdentificationError::NoUsableEvent { refused }
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::bundled;

    #[test]
    fn an_event_that_cannot_be_read_is_among_the_refused() {
        let parent = tempfile::tempdir().unwrap();
        let site = bundled::sites()[0].extract_to(parent.path()).unwrap();
        std::fs::remove_file(site.join("event_02.csv")).unwrap();
        std::fs::write(site.join("event_03.csv"), "nonsense\n").unwrap();
        let events = events(&SourceArgs { site, store: None }).unwrap();
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
}
