//! Sample batches as JSON.

use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use super::{
    BatchError, VERSION,
    batch::{RawBatch, RawChannel},
    batch_error::shortened,
    channel_name,
    units::{channel_named, own_unit},
};
use crate::{
    adapters::wire::Encoding,
    measurement::{Quality, SampleBatch},
};

/// Writes a batch as JSON, in the domain's units. A value that is not finite becomes null.
///
/// # Errors
///
/// [`BatchError::NotWritten`]; no batch of the domain is known that causes it.
pub fn encode_batch_json(batch: &SampleBatch, nominal_hz: f64) -> Result<Vec<u8>, BatchError> {
    let document = Written {
        v: VERSION,
        site: &batch.site,
        stream: &batch.stream,
        sequence: batch.sequence,
        start_ns: batch.start_ns,
        rate_fps: batch.rate_fps,
        nominal_hz,
        channels: batch
            .channels
            .iter()
            .map(|(channel, values)| WrittenChannel {
                channel: channel_name(*channel),
                unit: own_unit(*channel),
                values,
            })
            .collect(),
        quality: &batch.quality,
    };
    serde_json::to_vec(&document).map_err(|error| BatchError::NotWritten {
        reason: error.to_string(),
    })
}

/// Reads the fields; what they hold is checked afterwards.
pub(super) fn parse(payload: &[u8]) -> Result<RawBatch, BatchError> {
    let read: Read =
        serde_json::from_slice(payload).map_err(|error| of_other_version(payload, &error))?;
    let channels = read
        .channels
        .map(|channels| channels.into_iter().map(ReadChannel::known).collect())
        .transpose()?;
    Ok(RawBatch {
        version: read.v,
        site: read.site,
        stream: read.stream,
        sequence: read.sequence,
        start_ns: read.start_ns,
        rate_fps: read.rate_fps,
        nominal_hz: read.nominal_hz,
        channels,
        quality: read.quality,
    })
}

/// A document of another version may differ in anything else too: its version is the better reason.
fn of_other_version(payload: &[u8], error: &serde_json::Error) -> BatchError {
    #[derive(Deserialize)]
    struct OnlyVersion {
        v: u64,
    }
    match serde_json::from_slice::<OnlyVersion>(payload) {
        Ok(OnlyVersion { v }) if v != VERSION => BatchError::UnknownVersion { found: v },
        _ => BatchError::Malformed {
            encoding: Encoding::Json,
            reason: error.to_string(),
        },
    }
}

#[derive(Serialize)]
struct Written<'a> {
    v: u64,
    site: &'a str,
    stream: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    sequence: Option<u64>,
    start_ns: i64,
    rate_fps: f64,
    nominal_hz: f64,
    channels: Vec<WrittenChannel<'a>>,
    #[serde(serialize_with = "write_quality")]
    quality: &'a [Quality],
}

#[derive(Serialize)]
struct WrittenChannel<'a> {
    channel: &'static str,
    unit: &'static str,
    values: &'a [f64],
}

#[allow(
    clippy::trivially_copy_pass_by_ref,
    reason = "the signature is serde's"
)]
fn write_quality<S: Serializer>(quality: &&[Quality], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(quality.iter().map(|flags| flags.0))
}

#[derive(Deserialize)]
struct Read {
    v: Option<u64>,
    site: Option<String>,
    stream: Option<String>,
    sequence: Option<u64>,
    #[serde(default, deserialize_with = "nanoseconds")]
    start_ns: Option<i64>,
    rate_fps: Option<f64>,
    nominal_hz: Option<f64>,
    channels: Option<Vec<ReadChannel>>,
    quality: Option<Vec<u32>>,
}

#[derive(Deserialize)]
struct ReadChannel {
    channel: String,
    unit: String,
    values: Vec<Option<f64>>,
}

impl ReadChannel {
    fn known(self) -> Result<RawChannel, BatchError> {
        let channel = channel_named(&self.channel).ok_or_else(|| BatchError::UnknownChannel {
            name: shortened(&self.channel),
        })?;
        Ok(RawChannel {
            channel,
            unit: self.unit,
            values: self
                .values
                .into_iter()
                .map(|value| value.unwrap_or(f64::NAN))
                .collect(),
        })
    }
}

/// Nanoseconds as a number or, for writers whose numbers end at 2^53, as a string of digits.
fn nanoseconds<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<i64>, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Spelled {
        Number(i64),
        Digits(String),
        Other(de::IgnoredAny),
    }
    let refused =
        || de::Error::custom("start_ns is no whole number of nanoseconds that fits 64 bits");
    match Option::<Spelled>::deserialize(deserializer)? {
        None => Ok(None),
        Some(Spelled::Number(number)) => Ok(Some(number)),
        Some(Spelled::Digits(digits)) => digits.parse().map(Some).map_err(|_| refused()),
        Some(Spelled::Other(_)) => Err(refused()),
    }
}
