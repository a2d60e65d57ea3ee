//! Opening the file, bringing its schema up to date, and lending out connections.

use std::{
    path::{Path, PathBuf},
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

use rusqlite::{Connection, ErrorCode, OpenFlags, Transaction, TransactionBehavior};

use super::{failure::Trouble, windows::count};
use crate::adapters::store::{Operation, StoreError};

/// `LMD1`: tells our files from those of others (`file(1)` and ourselves).
const APPLICATION_ID: i32 = 0x4c4d_4431;

/// The schema, step by step; the number of a step is its place, from 1. A step that has been
/// released is never changed.
const MIGRATIONS: [&str; 3] = [
    include_str!("migrations/0001_initial.sql"),
    include_str!("migrations/0002_diagnoses_and_structures.sql"),
    include_str!("migrations/0003_progress.sql"),
];

/// Bytes per page, SQLite's own default, fixed here because the size limit counts pages.
const PAGE_BYTES: i64 = 4096;

const OPEN: Operation = Operation("open the store");

/// Settings of the embedded store.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SqliteOptions {
    /// How long to wait for another process that writes. Default: 5 s.
    pub busy_timeout: Duration,
    /// Reading connections kept open. Default: 4.
    pub readers_max: usize,
    /// Size the file must not exceed, bytes; what does not fit is refused with
    /// [`StoreError::Full`]. Default: none, the disk is the limit.
    pub size_bytes_max: Option<u64>,
}

impl Default for SqliteOptions {
    fn default() -> Self {
        Self {
            busy_timeout: Duration::from_secs(5),
            readers_max: 4,
            size_bytes_max: None,
        }
    }
}

/// The embedded store.
#[derive(Debug)]
pub struct SqliteStore {
    path: PathBuf,
    options: SqliteOptions,
    writer: Mutex<Connection>,
    readers: Mutex<Vec<Connection>>,
}

impl SqliteStore {
    /// Opens the file, creates it where there is none, and brings its schema up to date.
    ///
    /// # Errors
    ///
    /// [`StoreError::CannotOpen`] with the reason, [`StoreError::NotOurs`],
    /// [`StoreError::NewerSchema`], [`StoreError::Corrupt`], [`StoreError::Busy`],
    /// [`StoreError::Full`].
    pub fn open(path: &Path, options: &SqliteOptions) -> Result<Self, StoreError> {
        let writer = open_writer(path, options).map_err(|trouble| match trouble.during(OPEN) {
            StoreError::Other { source, .. } | StoreError::ReadOnly { source, .. } => {
                StoreError::CannotOpen {
                    path: path.to_owned(),
                    reason: source.to_string(),
                }
            }
            error => error,
        })?;
        Ok(Self {
            path: path.to_owned(),
            options: *options,
            writer: Mutex::new(writer),
            readers: Mutex::new(Vec::new()),
        })
    }

    /// Bytes that the file's disk has left for who runs this.
    pub(super) fn free_bytes(&self) -> Option<u64> {
        let disk = rustix::fs::statvfs(&self.path).ok()?;
        Some(disk.f_bavail.saturating_mul(disk.f_frsize))
    }

    /// Runs `work` in one writing transaction; an error takes everything back.
    pub(super) fn write<T>(
        &self,
        operation: Operation,
        work: impl FnOnce(&Transaction<'_>) -> Result<T, Trouble>,
    ) -> Result<T, StoreError> {
        let mut writer = lock(&self.writer);
        let done = || {
            // Immediate: a transaction that starts by reading could not become a writing one while
            // another process writes, and would fail without waiting.
            let transaction = writer.transaction_with_behavior(TransactionBehavior::Immediate)?;
            let result = work(&transaction)?;
            transaction.commit()?;
            Ok(result)
        };
        done().map_err(|trouble: Trouble| trouble.during(operation))
    }

    /// Runs `work` on the writing connection without a transaction, for what needs none.
    pub(super) fn maintain(
        &self,
        operation: Operation,
        work: impl FnOnce(&Connection) -> Result<(), Trouble>,
    ) -> Result<(), StoreError> {
        work(&lock(&self.writer)).map_err(|trouble| trouble.during(operation))
    }

    /// Runs `work` on a reading connection. One statement sees one state of the store; `work` with
    /// several statements may see several.
    pub(super) fn read<T>(
        &self,
        operation: Operation,
        work: impl FnOnce(&Connection) -> Result<T, Trouble>,
    ) -> Result<T, StoreError> {
        let pooled = lock(&self.readers).pop();
        let reader = match pooled {
            Some(reader) => reader,
            None => self
                .open_reader()
                .map_err(|error| Trouble::from(error).during(operation))?,
        };
        let result = work(&reader);
        // A connection that met an error is not used again: it may be what is wrong.
        if result.is_ok() {
            let mut readers = lock(&self.readers);
            if readers.len() < self.options.readers_max {
                readers.push(reader);
            }
        }
        result.map_err(|trouble| trouble.during(operation))
    }

    fn open_reader(&self) -> rusqlite::Result<Connection> {
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let reader = Connection::open_with_flags(&self.path, flags)?;
        prepare_connection(&reader, &self.options)?;
        Ok(reader)
    }
}

fn open_writer(path: &Path, options: &SqliteOptions) -> Result<Connection, Trouble> {
    let cannot = |reason: String| {
        Trouble::Named(StoreError::CannotOpen {
            path: path.to_owned(),
            reason,
        })
    };
    if let Some(reason) = obvious_obstacle(path) {
        return Err(cannot(reason));
    }
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
        | OpenFlags::SQLITE_OPEN_CREATE
        | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let mut writer = Connection::open_with_flags(path, flags)?;
    // SQLite falls back to reading when it may not write.
    if writer.is_readonly(rusqlite::MAIN_DB)? {
        return Err(cannot("it is read-only".to_owned()));
    }
    prepare_connection(&writer, options)?;
    refuse_what_is_not_ours(&writer, path)?;
    prepare_file(&writer, options)?;
    migrate(&mut writer)?;
    Ok(writer)
}

/// A thread that panicked while it held the lock has rolled back its transaction on its way out.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What can be said better than SQLite's "unable to open database file".
fn obvious_obstacle(path: &Path) -> Option<String> {
    if path.is_dir() {
        return Some("it is a directory".to_owned());
    }
    let parent = path
        .parent()
        .filter(|parent| !parent.as_os_str().is_empty())?;
    match std::fs::metadata(parent) {
        Ok(metadata) if metadata.is_dir() => None,
        Ok(_) => Some(format!("`{}` is not a directory", parent.display())),
        Err(error) => Some(format!("directory `{}`: {error}", parent.display())),
    }
}

fn prepare_connection(connection: &Connection, options: &SqliteOptions) -> rusqlite::Result<()> {
    connection.busy_timeout(options.busy_timeout)?;
    connection.pragma_update(None, "foreign_keys", true)?;
    connection.pragma_update(None, "trusted_schema", false)
}

fn refuse_what_is_not_ours(connection: &Connection, path: &Path) -> Result<(), Trouble> {
    // One transaction: another process may be creating the schema at this moment.
    let state = connection.unchecked_transaction()?;
    let application_id: i32 = pragma(&state, "application_id")?;
    let tables: i64 =
        state.query_row("SELECT count(*) FROM sqlite_schema", [], |row| row.get(0))?;
    let version: i64 = pragma(&state, "user_version")?;
    state.commit()?;
    let empty = application_id == 0 && tables == 0;
    if application_id != APPLICATION_ID && !empty {
        return Err(Trouble::Named(StoreError::NotOurs {
            path: path.to_owned(),
            application_id,
        }));
    }
    refuse_newer(version)
}

fn refuse_newer(found: i64) -> Result<(), Trouble> {
    let known = count(MIGRATIONS.len());
    if found <= known {
        return Ok(());
    }
    Err(Trouble::Named(StoreError::NewerSchema { found, known }))
}

/// What belongs to the file rather than to the connection. The first two take effect only while the
/// file is empty.
fn prepare_file(connection: &Connection, options: &SqliteOptions) -> Result<(), Trouble> {
    connection.pragma_update(None, "page_size", PAGE_BYTES)?;
    connection.pragma_update(None, "auto_vacuum", "incremental")?;
    let mode = switch_to_log(connection)?;
    if mode != "wal" {
        return Err(Trouble::Named(StoreError::CannotOpen {
            path: connection.path().map(PathBuf::from).unwrap_or_default(),
            reason: format!("its file system admits no write-ahead log (journal mode `{mode}`)"),
        }));
    }
    connection.pragma_update(None, "synchronous", "full")?;
    // The log shrinks again after a burst.
    connection.pragma_update_and_check(None, "journal_size_limit", 64 << 20, |_| Ok(()))?;
    if let Some(bytes) = options.size_bytes_max {
        let bytes = i64::try_from(bytes).unwrap_or(i64::MAX);
        let pages = (bytes / PAGE_BYTES).max(1);
        connection.pragma_update_and_check(None, "max_page_count", pages, |_| Ok(()))?;
    }
    Ok(())
}

/// Switches a file to its write-ahead log, once in its life. SQLite reports a collision with another
/// process that does the same at once instead of waiting for it, since waiting could be for ever.
fn switch_to_log(connection: &Connection) -> rusqlite::Result<String> {
    const ATTEMPTS: u32 = 40;
    const PAUSE: Duration = Duration::from_millis(25);
    let mut attempt = 1;
    loop {
        let switched =
            connection.pragma_update_and_check(None, "journal_mode", "wal", |row| row.get(0));
        match switched {
            Err(error)
                if error.sqlite_error_code() == Some(ErrorCode::DatabaseBusy)
                    && attempt < ATTEMPTS =>
            {
                attempt += 1;
                std::thread::sleep(PAUSE);
            }
            other => return other,
        }
    }
}

/// Applies what the file lacks, each step in a transaction of its own; another process may be doing
/// the same.
fn migrate(connection: &mut Connection) -> Result<(), Trouble> {
    for (at, step) in MIGRATIONS.iter().enumerate() {
        let number = count(at) + 1;
        if pragma::<i64>(connection, "user_version")? >= number {
            continue;
        }
        let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        if pragma::<i64>(&transaction, "user_version")? < number {
            transaction.execute_batch(step)?;
            transaction.pragma_update(None, "application_id", APPLICATION_ID)?;
            transaction.pragma_update(None, "user_version", number)?;
        }
        transaction.commit()?;
    }
    Ok(())
}

pub(super) fn pragma<T: rusqlite::types::FromSql>(
    connection: &Connection,
    name: &str,
) -> rusqlite::Result<T> {
    connection.pragma_query_value(None, name, |row| row.get(0))
}
