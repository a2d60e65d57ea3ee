//! One side of a comparison: a set from a file or a store, or one that is identified.

use std::{
    fs,
    path::{Path, PathBuf},
};

use super::CompareError;
use crate::{
    adapters::{
        report::{Rival, Search},
        store::{SqliteOptions, SqliteStore, Store},
        wire::v1::{decode_identified_set, decode_parameter_set},
    },
    commands::{
        fitting,
        source::{Events, parts_of},
    },
    identification::{
        self, Comparison, Identification, IdentificationError, IdentificationOptions, Judgement,
        ParameterSet, Verdict,
    },
};

/// What one side of a comparison is, as asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Asked {
    /// A set in a file.
    File(PathBuf),
    /// A set of the store, by its version.
    Version(u64),
    /// A structure, to be identified; none: that of the site.
    Structure(Option<String>),
}

/// A set held against the measurements.
pub(super) struct Side {
    pub(super) label: String,
    source: Source,
    pub(super) comparisons: Vec<Comparison>,
    /// What it shows on these events.
    pub(super) judgement: Judgement,
}

/// Where the parameters come from.
enum Source {
    Given(Box<ParameterSet>),
    Fit(Box<Identification>),
}

impl Asked {
    /// What `words` mean: a version where there is a store and they are a number, a file where there
    /// is one of this name or they look like one, otherwise parts of a structure.
    pub(super) fn parse(words: &str, has_store: bool) -> Self {
        let path = Path::new(words);
        let looks_like_file = words.contains('/') || path.extension().is_some();
        match words.parse() {
            Ok(version) if has_store => Self::Version(version),
            _ if path.is_file() || looks_like_file => Self::File(path.to_path_buf()),
            _ => Self::Structure(Some(words.to_owned())),
        }
    }

    fn label(&self) -> String {
        match self {
            Self::File(path) => path.file_stem().map_or_else(
                || "other set".to_owned(),
                |stem| stem.to_string_lossy().into_owned(),
            ),
            Self::Version(version) => format!("version {version}"),
            Self::Structure(parts) => parts.as_deref().map_or_else(
                || "the site's structure".to_owned(),
                |parts| parts_of(parts).join(" + "),
            ),
        }
    }
}

impl Side {
    /// Reads or identifies the set and holds it against the events.
    ///
    /// # Errors
    ///
    /// See [`CompareError`].
    pub(super) fn new(
        asked: &Asked,
        store: Option<&Path>,
        events: &Events,
        options: &IdentificationOptions,
    ) -> Result<Self, CompareError> {
        let source = match asked {
            Asked::File(path) => Source::Given(Box::new(read_file(path)?)),
            Asked::Version(version) => {
                let site = &events.site.name;
                let set = store.map(|store| read_stored(store, site, *version));
                Source::Given(Box::new(set.unwrap_or_else(|| {
                    Err(CompareError::NoVersion {
                        site: site.clone(),
                        version: *version,
                    })
                })?))
            }
            Asked::Structure(structure) => {
                let structure = events.parts(structure.as_deref())?;
                let found = fitting::identify(events, &structure, options)?;
                Source::Fit(Box::new(found))
            }
        };
        let comparisons = compare(source.set(), events, options)?;
        let judged =
            identification::judge(source.set(), &events.site.name, &events.usable, options)?;
        let judgement = match &source {
            Source::Given(_) => judged,
            // Of these very events, without those that neither list names.
            Source::Fit(found) => Judgement {
                verdict: found.set.verdict.clone(),
                ..judged
            },
        };
        Ok(Self {
            label: asked.label(),
            source,
            comparisons,
            judgement,
        })
    }

    pub(super) fn set(&self) -> &ParameterSet {
        self.source.set()
    }

    /// The verdict that a given set brings along.
    pub(super) fn published(&self) -> Option<&Verdict> {
        match &self.source {
            Source::Given(set) => Some(&set.verdict),
            Source::Fit(_) => None,
        }
    }

    pub(super) fn search(&self) -> Option<Search<'_>> {
        match &self.source {
            Source::Given(_) => None,
            Source::Fit(identification) => Some(Search {
                solutions: &identification.solutions,
                directions: &identification.directions,
                cost: identification.cost,
            }),
        }
    }

    pub(super) fn refused(&self) -> &[(String, String)] {
        match &self.source {
            Source::Given(_) => &[],
            Source::Fit(identification) => &identification.refused,
        }
    }

    pub(super) fn as_rival(&self) -> Rival<'_> {
        Rival {
            label: &self.label,
            set: self.set(),
            comparisons: &self.comparisons,
        }
    }
}

impl Source {
    fn set(&self) -> &ParameterSet {
        match self {
            Self::Given(set) => set,
            Self::Fit(identification) => &identification.set,
        }
    }
}

fn compare(
    set: &ParameterSet,
    events: &Events,
    options: &IdentificationOptions,
) -> Result<Vec<Comparison>, IdentificationError> {
    identification::compare(set, &events.usable, options)
}

fn read_file(path: &Path) -> Result<ParameterSet, CompareError> {
    let document = fs::read_to_string(path).map_err(|source| CompareError::ReadParameters {
        path: path.to_path_buf(),
        source,
    })?;
    decode_identified_set(&document).map_err(|source| CompareError::Parameters {
        path: path.to_path_buf(),
        source,
    })
}

fn read_stored(path: &Path, site: &str, version: u64) -> Result<ParameterSet, CompareError> {
    let store = SqliteStore::open(path, &SqliteOptions::default())?;
    let stored = store
        .set(site, version)?
        .ok_or_else(|| CompareError::NoVersion {
            site: site.to_owned(),
            version,
        })?;
    decode_parameter_set(&stored.document).map_err(|source| CompareError::Parameters {
        path: path.to_path_buf(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_side_is_a_version_a_file_or_a_structure() {
        assert_eq!(Asked::parse("7", true), Asked::Version(7));
        assert_eq!(
            Asked::parse("7", false),
            Asked::Structure(Some("7".to_owned()))
        );
        assert_eq!(
            Asked::parse("old.json", true),
            Asked::File("old.json".into())
        );
        let structure = "zip+induction_motor";
        assert_eq!(
            Asked::parse(structure, true),
            Asked::Structure(Some(structure.to_owned()))
        );
        assert_eq!(
            Asked::parse(structure, true).label(),
            "zip + induction_motor"
        );
        assert_eq!(Asked::parse("sets/old.json", false).label(), "old");
    }
}
