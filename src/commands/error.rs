//! Why a command did not do what it was asked to.

use std::{io, path::PathBuf};

use super::misuse::MayBeMisuse;
use crate::{
    adapters::{
        bundled::BundledError,
        recordings::site_folder,
        wire::v1::{BatchError, RecordingError},
        zenoh::ZenohError,
    },
    config::Problems,
    daemon::{DaemonError, SettingsError, logging::LogError},
};

/// Why a command did not do what it was asked to.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// It was used wrongly.
    #[error("{0}")]
    Usage(String),
    /// The result could not be written.
    #[error("cannot write the result: {0}")]
    Output(#[from] io::Error),
    /// A file or directory could not be read or made.
    #[error("{}: {source}", .path.display())]
    File {
        /// Path.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The daemon.
    #[error(transparent)]
    Daemon(#[from] DaemonError),
    /// Zenoh.
    #[error(transparent)]
    Zenoh(#[from] ZenohError),
    /// Logging.
    #[error(transparent)]
    Log(#[from] LogError),
    /// A site folder.
    #[error(transparent)]
    SiteFolder(#[from] site_folder::Error),
    /// Bundled recordings.
    #[error(transparent)]
    Bundled(#[from] BundledError),
    /// A batch could not be encoded.
    #[error("{event}: {source}")]
    Batch {
        /// The event.
        event: String,
        /// Why.
        source: BatchError,
    },
    /// A recording could not be encoded.
    #[error("{}: {source}", .path.display())]
    Recording {
        /// File.
        path: PathBuf,
        /// Why.
        source: RecordingError,
    },
    /// A configuration has problems, which have been told.
    #[error("the configuration cannot be used")]
    UnusableConfiguration,
    /// An effect file has problems.
    #[error("the effect file cannot be used:\n{problems}")]
    EffectFile {
        /// One a line, with file, line and column.
        problems: String,
    },
    /// Effect files have problems, which have been told.
    #[error("the effect files cannot be used")]
    UnusableEffectFile,
    /// The configuration has problems.
    #[error(transparent)]
    Configuration(#[from] Problems),
    /// The configuration asks for what cannot be done.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The command was interrupted before it was done.
    #[error("interrupted")]
    Interrupted,
    /// Anything else, in words of its own.
    #[error(transparent)]
    Other(#[from] Box<dyn std::error::Error + Send + Sync>),
}

impl Error {
    /// The same, which may be the fault of whoever typed the command.
    pub(super) fn of(error: impl MayBeMisuse) -> Self {
        if error.is_misuse() {
            Self::Usage(error.to_string())
        } else {
            Self::other(error)
        }
    }

    /// An error of a command that has its own kinds.
    pub fn other(error: impl std::error::Error + Send + Sync + 'static) -> Self {
        Self::Other(Box::new(error))
    }

    /// Whether the command was used wrongly.
    #[must_use]
    pub const fn is_usage(&self) -> bool {
        matches!(self, Self::Usage(_))
    }
}
