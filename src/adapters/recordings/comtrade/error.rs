//! Why a COMTRADE file cannot be used.

use std::{fmt, io, path::PathBuf};

use thiserror::Error as ThisError;

/// The part of a recording an error lies in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// The configuration (`.cfg`).
    Configuration,
    /// The samples (`.dat`).
    Data,
    /// The single-file container (`.cff`).
    Container,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Configuration => "configuration",
            Self::Data => "data",
            Self::Container => "container",
        })
    }
}

/// Why a COMTRADE file cannot be used. Lines count from 1 within their part.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// A file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
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
    /// The file that belongs to the given one is not there.
    #[error("no {missing} file beside {}", path.display())]
    NoCompanion {
        /// The file that was named.
        path: PathBuf,
        /// The part that is missing.
        missing: Part,
    },
    /// The name ends in none of `.cfg`, `.dat`, `.cff`.
    #[error("{} is not named .cfg, .dat or .cff", path.display())]
    UnknownExtension {
        /// The file that was named.
        path: PathBuf,
    },
    /// The text ends before a line that must be there.
    #[error("{part} ends before line {line}, which should hold {field}")]
    MissingLine {
        /// Where.
        part: Part,
        /// The line that is missing.
        line: usize,
        /// What it should hold.
        field: &'static str,
    },
    /// A line has the wrong number of comma-separated fields.
    #[error("{part} line {line}: {found} fields, expected {expected}")]
    FieldCount {
        /// Where.
        part: Part,
        /// The line.
        line: usize,
        /// How many fields it has.
        found: usize,
        /// What it should have.
        expected: String,
    },
    /// A field does not hold what it should.
    #[error("{part} line {line}, {field}: '{found}' is not {expected}")]
    Field {
        /// Where.
        part: Part,
        /// The line.
        line: usize,
        /// The field's name in the standard, or a channel.
        field: String,
        /// The text found, cut after 40 characters.
        found: String,
        /// What the field should hold.
        expected: &'static str,
    },
    /// A time stamp is missing although no sampling rate is declared.
    #[error("data row {row}: no time stamp, and the configuration declares no sampling rate")]
    NoTime {
        /// The sample, counted from 1.
        row: usize,
    },
    /// Time stamps do not increase although no sampling rate is declared.
    #[error("data row {row}: time stamp does not increase, and no sampling rate is declared")]
    TimeNotIncreasing {
        /// The sample, counted from 1.
        row: usize,
    },
    /// The data end before the declared number of samples.
    #[error("data end after {found} samples, {declared} are declared")]
    DataEnds {
        /// Complete samples found.
        found: usize,
        /// Samples declared by the last sampling rate.
        declared: usize,
    },
    /// The configuration declares no samples or no channels.
    #[error("the recording declares no {what}")]
    Empty {
        /// `samples` or `channels`.
        what: &'static str,
    },
    /// A container's header and its configuration name different data formats.
    #[error("container header says {header}, configuration says {configuration}")]
    FormatsDisagree {
        /// Format in the header of the data section.
        header: &'static str,
        /// Format in the configuration.
        configuration: &'static str,
    },
}

impl Error {
    /// A field that does not hold what it should.
    pub(super) fn field(
        part: Part,
        line: usize,
        field: impl Into<String>,
        found: &str,
        expected: &'static str,
    ) -> Self {
        Self::Field {
            part,
            line,
            field: field.into(),
            found: found.chars().take(40).collect(),
            expected,
        }
    }
}
