//! The embedded store: one SQLite file.
//!
//! Write-ahead log, one writing connection behind a mutex, a few reading ones beside it. Commits
//! are synchronised to the disk (`synchronous=FULL`): with `NORMAL` a power cut may take back the
//! last commits in WAL mode, and with them a window that was promised to be on durable storage. The
//! price is one fsync per commit, and commits come at the pace of disturbances, not of samples.

mod connection;
mod decisions;
mod diagnoses;
mod failure;
mod fits;
mod jobs;
mod sets;
mod store;
mod structures;
mod upkeep;
mod windows;

#[cfg(test)]
mod tests;

pub use connection::{SqliteOptions, SqliteStore};
