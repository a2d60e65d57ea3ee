//! Why a site folder cannot be used.

use std::{io, path::PathBuf};

use thiserror::Error as ThisError;

/// Why a site folder, or one event of it, cannot be used at all.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be read or written.
    #[error("cannot access {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// A file is larger than the reader accepts.
    #[error("{} has {bytes} bytes, more than the {limit_bytes} accepted", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The largest size accepted.
        limit_bytes: u64,
    },
    /// `site.json` is not what it should be.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        source: serde_json::Error,
    },
    /// A key of `site.json` has an inadmissible value.
    #[error("{}: {key} is '{found}', must be {expected}", path.display())]
    Value {
        /// The file.
        path: PathBuf,
        /// The key.
        key: &'static str,
        /// The value found.
        found: String,
        /// The admissible range.
        expected: &'static str,
    },
    /// The folder holds no events.
    #[error("{} lists no events and holds no event_*.csv", path.display())]
    NoEvents {
        /// The folder.
        path: PathBuf,
    },
    /// A CSV file lacks a column.
    #[error("{} line 1: no column {column}", path.display())]
    NoColumn {
        /// The file.
        path: PathBuf,
        /// The column.
        column: &'static str,
    },
    /// A CSV file holds no row with a time.
    #[error("{} holds no row with a usable time_s", path.display())]
    NoRows {
        /// The file.
        path: PathBuf,
    },
    /// A row's time is absurdly far from the first row's.
    #[error(
        "{} line {line}, column time_s: {time_s} s is {points:.0} samples from the first row, more \
         than {limit:.0}",
        path.display()
    )]
    TooLong {
        /// The file.
        path: PathBuf,
        /// The line.
        line: u64,
        /// The time in that line.
        time_s: f64,
        /// Its distance, samples.
        points: f64,
        /// Most accepted.
        limit: f64,
    },
    /// Most rows do not lie on the grid of the declared rate.
    #[error(
        "{}: {misplaced} of {rows} rows do not fit {rate_fps} rows per second (sample_rate_fps)",
        path.display()
    )]
    RateDoesNotFit {
        /// The file.
        path: PathBuf,
        /// Rows off the grid or sharing a grid point with another.
        misplaced: usize,
        /// All rows.
        rows: usize,
        /// The declared rate.
        rate_fps: f64,
    },
}
