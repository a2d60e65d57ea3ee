//! Why bytes are no frame, and why a message cannot be written as one.

use std::fmt;

use thiserror::Error as ThisError;

use super::frame::FrameKind;

/// Why bytes are no frame: which kind of frame, where, and what is wrong there.
#[derive(Clone, Debug, PartialEq, Eq, ThisError)]
#[error("{}, byte {offset}, {field}: {reason}", Title(*frame))]
pub struct Error {
    /// Kind of frame, once known.
    pub frame: Option<FrameKind>,
    /// Byte of the frame (for a configuration in parts: of the joined parts) the field starts at.
    pub offset: usize,
    /// Name of the field in the standard.
    pub field: &'static str,
    /// What is wrong.
    pub reason: Reason,
}

struct Title(Option<FrameKind>);

impl fmt::Display for Title {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(kind) => write!(f, "{kind} frame"),
            None => f.write_str("frame"),
        }
    }
}

/// What is wrong with a field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ThisError)]
#[non_exhaustive]
pub enum Reason {
    /// The frame ends inside the field.
    #[error("needs {needed} bytes, {left} are left")]
    Ends {
        /// Bytes the field takes.
        needed: usize,
        /// Bytes left.
        left: usize,
    },
    /// Bytes follow the last field.
    #[error("the last field is followed by {bytes} bytes that nothing describes")]
    LeftOver {
        /// How many.
        bytes: usize,
    },
    /// FRAMESIZE is not the number of bytes received.
    #[error("says {stated} bytes, {received} were received")]
    Length {
        /// FRAMESIZE.
        stated: usize,
        /// Bytes received.
        received: usize,
    },
    /// The check word does not fit the bytes.
    #[error("is {stated:#06x}, the bytes give {computed:#06x}")]
    Checksum {
        /// As received.
        stated: u16,
        /// As computed.
        computed: u16,
    },
    /// A value the standard does not allow.
    #[error("{found} is not {expected}")]
    Value {
        /// As received.
        found: i64,
        /// What the standard allows.
        expected: &'static str,
    },
    /// A name that is not UTF-8 where it has to be.
    #[error("is not UTF-8")]
    NotUtf8,
    /// The data frame belongs to another stream than the configuration.
    #[error("is of stream {found}, the configuration is of stream {expected}")]
    OtherStream {
        /// Of the data frame.
        found: u16,
        /// Of the configuration.
        expected: u16,
    },
    /// The data do not have the length the configuration gives.
    #[error("has {found} bytes of data, the configuration describes {expected}")]
    NotAsConfigured {
        /// Bytes received.
        found: usize,
        /// Bytes by the configuration.
        expected: usize,
    },
}

/// Why a message cannot be written as a frame.
#[derive(Clone, Debug, PartialEq, Eq, ThisError)]
#[non_exhaustive]
pub enum EncodeError {
    /// A name is longer than its field.
    #[error("{field} `{name}` has {bytes} bytes, the field has room for {bytes_max}")]
    Name {
        /// Field.
        field: &'static str,
        /// The name.
        name: String,
        /// Its length.
        bytes: usize,
        /// Room.
        bytes_max: usize,
    },
    /// More bytes or channels than a 16-bit count can say.
    #[error("{field}: {found} is more than {max}")]
    TooMany {
        /// Field.
        field: &'static str,
        /// How many there are.
        found: usize,
        /// How many there may be.
        max: usize,
    },
    /// A value does not fit its field.
    #[error("{field}: {found} is not {expected}")]
    Value {
        /// Field.
        field: &'static str,
        /// The value.
        found: i64,
        /// What fits.
        expected: &'static str,
    },
    /// A channel's scaling, or the station's place and filter, is that of another kind of
    /// configuration.
    #[error("PMU {id_code}: {field} does not exist in {kind}")]
    WrongKind {
        /// IDCODE of the PMU.
        id_code: u16,
        /// Field.
        field: &'static str,
        /// The kind to be written.
        kind: FrameKind,
    },
    /// Data that do not have the numbers or formats of the configuration.
    #[error("PMU {index} of the data: {field} is not as configured")]
    NotAsConfigured {
        /// Which PMU block, from 1.
        index: usize,
        /// Field.
        field: &'static str,
    },
}
