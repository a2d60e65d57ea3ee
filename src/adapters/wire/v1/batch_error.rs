//! Why a sample batch is refused.

use super::units::{accepted_units, channel_name, channel_names};
use crate::{adapters::wire::Encoding, measurement::Channel};

/// Why a sample batch is refused as a whole. A value that is not finite does not refuse a batch: it
/// marks its sample.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BatchError {
    /// More bytes than admitted.
    #[error("the batch has {bytes} bytes, at most {max} are admitted")]
    TooLarge {
        /// Bytes received.
        bytes: usize,
        /// Limit.
        max: usize,
    },
    /// Neither a JSON object nor a CBOR map.
    #[error("the batch is neither a JSON object nor a CBOR map")]
    UnknownEncoding,
    /// Not well formed, or a field of the wrong type.
    #[error("the batch is not a well-formed {encoding} document: {reason}")]
    Malformed {
        /// What it was read as.
        encoding: Encoding,
        /// Where and why, in the words of the parser.
        reason: String,
    },
    /// The batch is of another version.
    #[error("the batch has version {found}, known is 1")]
    UnknownVersion {
        /// Version found.
        found: u64,
    },
    /// A field that must be there is not.
    #[error("the batch has no field `{field}`")]
    MissingField {
        /// Field.
        field: &'static str,
    },
    /// A name that cannot be part of a key.
    #[error("{field} `{name}` is no name: 1 to {bytes_max} bytes without / * $ ? # or white space")]
    BadName {
        /// Field.
        field: &'static str,
        /// Its value, shortened.
        name: String,
        /// Longest name admitted, bytes.
        bytes_max: usize,
    },
    /// The batch is of another site than the key said.
    #[error("the batch is of site `{found}`, its key says `{expected}`")]
    OtherSite {
        /// Site of the key.
        expected: String,
        /// Site of the batch.
        found: String,
    },
    /// Its nominal frequency is not the site's.
    #[error("the batch has a nominal frequency of {batch_hz} Hz, the site has {site_hz} Hz")]
    NominalDiffers {
        /// The site's, Hz.
        site_hz: f64,
        /// The batch's, Hz.
        batch_hz: f64,
    },
    /// Zero, negative, not finite or absurd.
    #[error("a rate of {rate_fps} samples per second is outside {min_fps} to {max_fps}")]
    BadRate {
        /// Rate found.
        rate_fps: f64,
        /// Lowest admitted.
        min_fps: f64,
        /// Highest admitted.
        max_fps: f64,
    },
    /// The time of the first or last sample is before 1970 or after 2262.
    #[error("a start at {start_ns} ns UTC puts samples outside the years 1970 to 2262")]
    BadStart {
        /// Start found, UTC nanoseconds.
        start_ns: i64,
    },
    /// No channel at all.
    #[error("the batch has no channel")]
    NoChannel,
    /// A channel nobody knows.
    #[error("unknown channel `{name}`; known: {}", channel_names())]
    UnknownChannel {
        /// Name or number found, shortened.
        name: String,
    },
    /// A channel that comes twice.
    #[error("channel `{}` comes twice", channel_name(*channel))]
    ChannelTwice {
        /// Channel.
        channel: Channel,
    },
    /// A unit the channel cannot have.
    #[error("channel `{}` cannot be in `{unit}`; accepted: {}", channel_name(*channel), accepted_units(*channel))]
    WrongUnit {
        /// Channel.
        channel: Channel,
        /// Unit found, shortened.
        unit: String,
    },
    /// No sample at all.
    #[error("the batch has no sample")]
    NoSample,
    /// More samples than admitted.
    #[error("more samples than the {max} admitted in one batch")]
    TooManySamples {
        /// Limit.
        max: usize,
    },
    /// An array of another length than the first channel's.
    #[error("`{field}` has {found} values, the first channel has {expected}")]
    UnequalLengths {
        /// Channel's name, or `quality`.
        field: &'static str,
        /// Values found.
        found: usize,
        /// Values of the first channel.
        expected: usize,
    },
    /// Flags without a meaning.
    #[error("quality {flags:#x} of sample {index} has bits without a meaning")]
    UnknownQuality {
        /// Index of the sample.
        index: usize,
        /// Flags found.
        flags: u32,
    },
    /// The batch could not be written.
    #[error("the batch cannot be written: {reason}")]
    NotWritten {
        /// Why.
        reason: String,
    },
}

impl BatchError {
    /// One word for a metric's label.
    #[must_use]
    pub const fn label(&self) -> &'static str {
        match self {
            Self::TooLarge { .. } => "too_large",
            Self::UnknownEncoding => "unknown_encoding",
            Self::Malformed { .. } => "malformed",
            Self::UnknownVersion { .. } => "unknown_version",
            Self::MissingField { .. } => "missing_field",
            Self::BadName { .. } => "bad_name",
            Self::OtherSite { .. } => "other_site",
            Self::NominalDiffers { .. } => "nominal_differs",
            Self::BadRate { .. } => "bad_rate",
            Self::BadStart { .. } => "bad_start",
            Self::NoChannel => "no_channel",
            Self::UnknownChannel { .. } => "unknown_channel",
            Self::ChannelTwice { .. } => "channel_twice",
            Self::WrongUnit { .. } => "wrong_unit",
            Self::NoSample => "no_sample",
            Self::TooManySamples { .. } => "too_many_samples",
            Self::UnequalLengths { .. } => "unequal_lengths",
            Self::UnknownQuality { .. } => "unknown_quality",
            Self::NotWritten { .. } => "not_written",
        }
    }
}

/// The beginning of a text from outside, for an error message.
pub(super) fn shortened(text: &str) -> String {
    const CHARACTERS_MAX: usize = 40;
    if text.chars().count() <= CHARACTERS_MAX {
        return text.to_owned();
    }
    let mut start: String = text.chars().take(CHARACTERS_MAX).collect();
    start.push_str("...");
    start
}
