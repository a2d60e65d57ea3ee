//! SQLite's errors in the store's words.

use rusqlite::ErrorCode;

use crate::{
    adapters::{
        store::{Operation, StoreError},
        wire::DocumentError,
    },
    load_model::structure::StructureError,
};

/// What may go wrong inside one operation, before the operation's name is put to it.
#[derive(Debug)]
pub(super) enum Trouble {
    Database(rusqlite::Error),
    Document(DocumentError),
    Structure(StructureError),
    Unknown {
        what: &'static str,
        id: String,
    },
    /// It has its name already.
    Named(StoreError),
}

impl Trouble {
    pub(super) fn unknown(what: &'static str, id: impl Into<String>) -> Self {
        Self::Unknown {
            what,
            id: id.into(),
        }
    }

    pub(super) fn during(self, operation: Operation) -> StoreError {
        match self {
            Self::Document(source) => StoreError::Document { operation, source },
            Self::Structure(source) => StoreError::Structure { operation, source },
            Self::Unknown { what, id } => StoreError::Unknown {
                operation,
                what,
                id,
            },
            Self::Database(error) => of_database(error, operation),
            Self::Named(error) => error,
        }
    }
}

impl From<rusqlite::Error> for Trouble {
    fn from(error: rusqlite::Error) -> Self {
        Self::Database(error)
    }
}

impl From<DocumentError> for Trouble {
    fn from(error: DocumentError) -> Self {
        Self::Document(error)
    }
}

impl From<StructureError> for Trouble {
    fn from(error: StructureError) -> Self {
        Self::Structure(error)
    }
}

/// Whether a write was refused because it refers to a row that is not there.
pub(super) fn refers_to_nothing(error: &rusqlite::Error) -> bool {
    error.sqlite_extended_error_code() == Some(rusqlite::ffi::SQLITE_CONSTRAINT_FOREIGNKEY)
}

fn of_database(error: rusqlite::Error, operation: Operation) -> StoreError {
    // The file of shared memory grows by itself and reports a full disk in its own way.
    let no_shared_memory =
        error.sqlite_extended_error_code() == Some(rusqlite::ffi::SQLITE_IOERR_SHMSIZE);
    let code = error.sqlite_error_code();
    let source = Box::new(error);
    match code {
        Some(ErrorCode::DiskFull) => StoreError::Full { operation, source },
        _ if no_shared_memory => StoreError::Full { operation, source },
        Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase) => {
            StoreError::Corrupt { operation, source }
        }
        Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => {
            StoreError::Busy { operation, source }
        }
        Some(ErrorCode::ReadOnly) => StoreError::ReadOnly { operation, source },
        _ => StoreError::Other { operation, source },
    }
}
