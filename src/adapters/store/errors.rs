//! What can go wrong with a store, told apart by what an operator has to do about it.

use std::{error::Error, fmt, path::PathBuf};

use crate::{adapters::wire::DocumentError, load_model::structure::StructureError};

/// Why the store did not do what it was asked to.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoreError {
    /// No space left: free some, or lower the retention. Nothing of the operation was kept.
    #[error("no space left for the store while it was to {operation}")]
    Full {
        /// What was asked.
        operation: Operation,
        /// What the database said.
        source: Cause,
    },
    /// The file is damaged or is no database: restore a copy.
    #[error("the store is damaged, seen while it was to {operation}: {source}")]
    Corrupt {
        /// What was asked.
        operation: Operation,
        /// What the database said.
        source: Cause,
    },
    /// A newer program has written this store.
    #[error(
        "the store has schema {found}, this program knows schemas up to {known}: use the newer program"
    )]
    NewerSchema {
        /// Number of the last migration of the store.
        found: i64,
        /// Number of the last migration known here.
        known: i64,
    },
    /// The file is a database of another program.
    #[error("`{}` is a database of another program (application id {application_id:#010x})", .path.display())]
    NotOurs {
        /// File.
        path: PathBuf,
        /// Its application id.
        application_id: i32,
    },
    /// Another process held the store for longer than the busy timeout: try again.
    #[error("the store was busy for too long while it was to {operation}")]
    Busy {
        /// What was asked.
        operation: Operation,
        /// What the database said.
        source: Cause,
    },
    /// The file cannot be created or opened.
    #[error("cannot open the store `{}`: {reason}", .path.display())]
    CannotOpen {
        /// File.
        path: PathBuf,
        /// Why, in words.
        reason: String,
    },
    /// The store can be read but not written.
    #[error("the store is read-only, seen while it was to {operation}")]
    ReadOnly {
        /// What was asked.
        operation: Operation,
        /// What the database said.
        source: Cause,
    },
    /// A record refers to one that is not there: a mistake of the caller.
    #[error("cannot {operation}: there is no {what} `{id}`")]
    Unknown {
        /// What was asked.
        operation: Operation,
        /// Kind of the record that is not there.
        what: &'static str,
        /// Its identifier.
        id: String,
    },
    /// A stored document cannot be understood.
    #[error("cannot {operation}: {source}")]
    Document {
        /// What was asked.
        operation: Operation,
        /// What is wrong with it.
        source: DocumentError,
    },
    /// The change asked for makes no model.
    #[error("cannot {operation}: {source}")]
    Structure {
        /// What was asked.
        operation: Operation,
        /// Why.
        source: StructureError,
    },
    /// Anything else, such as an error of the disk.
    #[error("cannot {operation}: {source}")]
    Other {
        /// What was asked.
        operation: Operation,
        /// What the database said.
        source: Cause,
    },
}

/// An error of the database behind the store, whichever it is.
pub type Cause = Box<dyn Error + Send + Sync>;

impl StoreError {
    /// Whether the same call may succeed later without anybody changing the call.
    #[must_use]
    pub const fn passing(&self) -> bool {
        matches!(self, Self::Full { .. } | Self::Busy { .. })
    }

    /// One word for a metric's label.
    #[must_use]
    pub const fn label(&self) -> &'static str {
        match self {
            Self::Full { .. } => "full",
            Self::Corrupt { .. } => "corrupt",
            Self::NewerSchema { .. } => "newer_schema",
            Self::NotOurs { .. } => "not_ours",
            Self::Busy { .. } => "busy",
            Self::CannotOpen { .. } => "cannot_open",
            Self::ReadOnly { .. } => "read_only",
            Self::Unknown { .. } => "unknown_record",
            Self::Document { .. } => "document",
            Self::Structure { .. } => "structure",
            Self::Other { .. } => "other",
        }
    }
}

/// What the store was asked to do, in the words of an error message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Operation(pub &'static str);

impl fmt::Display for Operation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.0)
    }
}
