//! Records of what models were found to miss, and of which model each site is to have.

use std::fmt;

use super::{Saved, Store, StoreError};
use crate::{
    adapters::wire::{DocumentError, v1::DiagnosisV1},
    diagnosis::Diagnosis,
    load_model::{Structure, structure::StructureError},
};

/// A diagnosis to be kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewDiagnosis<'a> {
    /// Site.
    pub site: &'a str,
    /// Hash of its inputs.
    pub inputs_hash: &'a str,
    /// The diagnosis; `cost.seconds` filled in by the caller.
    pub diagnosis: &'a Diagnosis,
}

/// A diagnosis as it was kept.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredDiagnosis {
    /// Site.
    pub site: String,
    /// Number, counted per site from 1.
    pub version: u64,
    /// Hash of its inputs.
    pub inputs_hash: String,
    /// The structure judged.
    pub structure: Vec<String>,
    /// Its status, as JSON writes it.
    pub status: String,
    /// The answer in one sentence.
    pub summary: String,
    /// The declared effect and those not separable from it, best first.
    pub answer_set: Vec<String>,
    /// Error over noise to quote; NaN when there is none.
    pub error_to_noise: f64,
    /// When it was stored, UTC nanoseconds.
    pub stored_ns: i64,
    /// When it was put on its key, UTC nanoseconds; none until then.
    pub published_ns: Option<i64>,
    /// The diagnosis as JSON (`DiagnosisV1`): these bytes are what is published; none when pruned.
    pub document: Option<String>,
}

impl StoredDiagnosis {
    /// The diagnosis; none when pruned.
    ///
    /// # Errors
    ///
    /// [`DocumentError`] when the document cannot be understood.
    pub fn diagnosis(&self) -> Result<Option<DiagnosisV1>, DocumentError> {
        self.document
            .as_deref()
            .map(DiagnosisV1::from_json)
            .transpose()
    }
}

/// How somebody said which model a site is to have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Origin {
    /// The configuration says so since the start of a service.
    Configuration,
    /// A command.
    CommandLine,
    /// The HTTP interface.
    Http,
}

impl Origin {
    /// Every origin.
    pub const ALL: [Self; 3] = [Self::Configuration, Self::CommandLine, Self::Http];

    /// Name in the database, in documents and in metrics.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Configuration => "configuration",
            Self::CommandLine => "command_line",
            Self::Http => "http",
        }
    }

    /// The origin of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|origin| origin.name() == name)
    }
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// What is to become of a site's structure.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum StructureChange {
    /// One more effect.
    Add(String),
    /// One effect less.
    Remove(String),
    /// Exactly these parts.
    Set(Vec<String>),
}

impl StructureChange {
    /// The structure that it makes of `current`.
    ///
    /// # Errors
    ///
    /// [`StructureError`] when that is no structure, or nothing is there to be removed.
    pub fn applied_to(&self, current: &[String]) -> Result<Structure, StructureError> {
        match self {
            Self::Set(names) => Structure::parse(names),
            Self::Add(name) => {
                let mut names = current.to_vec();
                names.push(name.clone());
                Structure::parse(&names)
            }
            Self::Remove(name) => {
                if !current.contains(name) {
                    return Err(StructureError::NotThere { name: name.clone() });
                }
                let kept = current.iter().filter(|part| *part != name);
                Structure::parse(&kept.collect::<Vec<_>>())
            }
        }
    }
}

/// A change of a site's structure to be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NewStructure<'a> {
    /// Site.
    pub site: &'a str,
    /// What changes.
    pub change: &'a StructureChange,
    /// How it was said.
    pub origin: Origin,
    /// Who.
    pub actor: &'a str,
    /// Why, in words; may be empty.
    pub comment: &'a str,
}

/// A site's structure as it was kept. The newest one is what is fitted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StructureRecord {
    /// Site.
    pub site: String,
    /// Names of the parts.
    pub structure: Vec<String>,
    /// How it was said.
    pub origin: Origin,
    /// Who.
    pub actor: String,
    /// Why, in words; may be empty.
    pub comment: String,
    /// When, UTC nanoseconds.
    pub changed_ns: i64,
}

/// Since when a site is to have its structure, and how often it was to have the same one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Standing {
    /// When the structure was taken up, UTC nanoseconds: who repeats it later changes nothing.
    pub since_ns: i64,
    /// Earlier times at which it was taken up, with other structures in between.
    pub times_before: usize,
}

impl Standing {
    /// Of a site's records, newest first; none without records.
    #[must_use]
    pub fn of(newest_first: &[StructureRecord]) -> Option<Self> {
        let current = newest_first.first()?;
        let mut standing = Self {
            since_ns: current.changed_ns,
            times_before: 0,
        };
        let runs = newest_first.chunk_by(|later, earlier| later.structure == earlier.structure);
        for (place, run) in runs.enumerate() {
            let (Some(named), Some(oldest)) = (run.first(), run.last()) else {
                continue;
            };
            if place == 0 {
                standing.since_ns = oldest.changed_ns;
            } else if named.structure == current.structure {
                standing.times_before += 1;
            }
        }
        Some(standing)
    }
}

/// What a change of a site's structure leads to, in words for whoever made it.
///
/// # Errors
///
/// [`StoreError`] when the store does not say whether the structure was fitted before.
pub fn what_follows(
    store: &dyn Store,
    record: &StructureRecord,
    saved: Saved,
) -> Result<String, StoreError> {
    if saved == Saved::AlreadyStored {
        return Ok("nothing changes: the site is to have this structure already".to_owned());
    }
    let standing = Standing::of(&store.structures(&record.site, usize::MAX)?);
    if standing.is_none_or(|standing| standing.times_before == 0) {
        return Ok("a joint fit, its validation, a decision and a diagnosis follow".to_owned());
    }
    Ok(
        "the site had this structure before: where its events are still the same, the fit and the \
         diagnosis on record are taken, and the fit is decided on again against the set in force"
            .to_owned(),
    )
}

/// An older version that is to be in force again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RollBack<'a> {
    /// Site.
    pub site: &'a str,
    /// Version.
    pub version: u64,
    /// Who.
    pub actor: &'a str,
    /// Why, in words; may be empty.
    pub comment: &'a str,
}
