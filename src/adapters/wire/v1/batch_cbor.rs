//! Sample batches as CBOR: maps with numeric keys (their names are accepted as well), values as
//! arrays of numbers or as typed arrays (RFC 8746).

use minicbor::{
    Encoder,
    data::{Tag, Type},
    decode, encode,
};

use super::{
    BatchError, VERSION,
    batch::{RawBatch, RawChannel},
    batch_error::shortened,
    cbor::Reader,
    units::{channel_named, own_unit},
};
use crate::{
    adapters::wire::Encoding,
    measurement::{Channel, SampleBatch},
};

/// Fields of a batch; the index is the key.
const FIELDS: [&str; 9] = [
    "v",
    "site",
    "stream",
    "sequence",
    "start_ns",
    "rate_fps",
    "nominal_hz",
    "channels",
    "quality",
];

/// Fields of a channel; the index is the key.
const CHANNEL_FIELDS: [&str; 3] = ["channel", "unit", "values"];

/// RFC 8746, 2.1: arrays of IEEE 754 binary32 and binary64, big and little endian.
const FLOAT32_BIG: u64 = 81;
const FLOAT64_BIG: u64 = 82;
const FLOAT32_LITTLE: u64 = 85;
const FLOAT64_LITTLE: u64 = 86;

/// Writes a batch as CBOR, in the domain's units, values as little-endian binary64 arrays.
///
/// # Errors
///
/// [`BatchError::NotWritten`]; no batch of the domain is known that causes it.
pub fn encode_batch_cbor(batch: &SampleBatch, nominal_hz: f64) -> Result<Vec<u8>, BatchError> {
    let mut encoder = Encoder::new(Vec::new());
    write(&mut encoder, batch, nominal_hz).map_err(|error| BatchError::NotWritten {
        reason: error.to_string(),
    })?;
    Ok(encoder.into_writer())
}

type Written = Result<(), encode::Error<std::convert::Infallible>>;

fn write(encoder: &mut Encoder<Vec<u8>>, batch: &SampleBatch, nominal_hz: f64) -> Written {
    encoder.map(if batch.sequence.is_some() { 9 } else { 8 })?;
    encoder.u8(0)?.u64(VERSION)?;
    encoder.u8(1)?.str(&batch.site)?;
    encoder.u8(2)?.str(&batch.stream)?;
    if let Some(sequence) = batch.sequence {
        encoder.u8(3)?.u64(sequence)?;
    }
    encoder.u8(4)?.i64(batch.start_ns)?;
    encoder.u8(5)?.f64(batch.rate_fps)?;
    encoder.u8(6)?.f64(nominal_hz)?;
    encoder.u8(7)?.array(batch.channels.len() as u64)?;
    for (channel, values) in &batch.channels {
        encoder.map(3)?.u8(0)?.u64(channel_number(*channel))?;
        encoder.u8(1)?.str(own_unit(*channel))?;
        let bytes: Vec<u8> = values
            .iter()
            .flat_map(|value| value.to_le_bytes())
            .collect();
        encoder
            .u8(2)?
            .tag(Tag::new(FLOAT64_LITTLE))?
            .bytes(&bytes)?;
    }
    encoder.u8(8)?.array(batch.quality.len() as u64)?;
    for flags in &batch.quality {
        encoder.u32(flags.0)?;
    }
    Ok(())
}

/// Number of a channel on the wire: its place in [`Channel::ALL`].
fn channel_number(channel: Channel) -> u64 {
    Channel::ALL
        .iter()
        .position(|one| *one == channel)
        .unwrap_or_default() as u64
}

impl From<decode::Error> for BatchError {
    fn from(error: decode::Error) -> Self {
        Self::Malformed {
            encoding: Encoding::Cbor,
            reason: error.to_string(),
        }
    }
}

/// Reads the fields; what they hold is checked afterwards. No array of more than `values_max`
/// values is read to its end.
pub(super) fn parse(payload: &[u8], values_max: usize) -> Result<RawBatch, BatchError> {
    let mut raw = RawBatch::default();
    Reader::new(payload).document(&FIELDS, |reader, field| {
        let decoder = &mut reader.decoder;
        match field {
            0 => raw.version = Some(known_version(decoder.u64()?)?),
            1 => raw.site = Some(decoder.str()?.to_owned()),
            2 => raw.stream = Some(decoder.str()?.to_owned()),
            3 => raw.sequence = reader.optional(|reader| reader.decoder.u64())?,
            4 => raw.start_ns = Some(decoder.i64()?),
            5 => raw.rate_fps = Some(reader.number()?),
            6 => raw.nominal_hz = Some(reader.number()?),
            7 => raw.channels = Some(channels(reader, values_max)?),
            _ => raw.quality = reader.optional(|reader| quality(reader, values_max))?,
        }
        Ok::<(), BatchError>(())
    })?;
    Ok(raw)
}

fn known_version(found: u64) -> Result<u64, BatchError> {
    if found == VERSION {
        Ok(found)
    } else {
        Err(BatchError::UnknownVersion { found })
    }
}

fn channels(reader: &mut Reader<'_>, values_max: usize) -> Result<Vec<RawChannel>, BatchError> {
    let mut channels = Vec::new();
    reader.array(|reader| {
        // One more than exist: then some channel comes twice, which is found out by name.
        if channels.len() > Channel::ALL.len() {
            return Err(decode::Error::message("more channels than there are").into());
        }
        channels.push(channel(reader, values_max)?);
        Ok::<(), BatchError>(())
    })?;
    Ok(channels)
}

fn channel(reader: &mut Reader<'_>, values_max: usize) -> Result<RawChannel, BatchError> {
    let (mut channel, mut unit, mut values) = (None, None, None);
    reader.map(&CHANNEL_FIELDS, |reader, field| {
        match field {
            0 => channel = Some(known_channel(reader)?),
            1 => unit = Some(reader.decoder.str()?.to_owned()),
            _ => values = Some(numbers(reader, values_max)?),
        }
        Ok::<(), BatchError>(())
    })?;
    let missing = |field| BatchError::MissingField { field };
    Ok(RawChannel {
        channel: channel.ok_or_else(|| missing("channel"))?,
        unit: unit.ok_or_else(|| missing("unit"))?,
        values: values.ok_or_else(|| missing("values"))?,
    })
}

fn known_channel(reader: &mut Reader<'_>) -> Result<Channel, BatchError> {
    let (channel, name) = if reader.decoder.datatype()? == Type::String {
        let name = reader.decoder.str()?;
        (channel_named(name), shortened(name))
    } else {
        let number = reader.decoder.u64()?;
        let at = usize::try_from(number).ok();
        let channel = at.and_then(|at| Channel::ALL.get(at).copied());
        (channel, number.to_string())
    };
    channel.ok_or(BatchError::UnknownChannel { name })
}

fn numbers(reader: &mut Reader<'_>, values_max: usize) -> Result<Vec<f64>, BatchError> {
    if reader.decoder.datatype()? == Type::Tag {
        return typed_array(reader, values_max);
    }
    let mut values = Vec::new();
    reader.array(|reader| {
        admit(values.len(), values_max)?;
        values.push(reader.number()?);
        Ok::<(), BatchError>(())
    })?;
    Ok(values)
}

fn typed_array(reader: &mut Reader<'_>, values_max: usize) -> Result<Vec<f64>, BatchError> {
    let tag = reader.decoder.tag()?.as_u64();
    let at = reader.decoder.position();
    let bytes = reader.decoder.bytes()?;
    let values = match tag {
        FLOAT32_BIG => pieces(bytes, |piece| f64::from(f32::from_be_bytes(piece))),
        FLOAT32_LITTLE => pieces(bytes, |piece| f64::from(f32::from_le_bytes(piece))),
        FLOAT64_BIG => pieces(bytes, f64::from_be_bytes),
        FLOAT64_LITTLE => pieces(bytes, f64::from_le_bytes),
        _ => None,
    };
    let values = values.ok_or_else(|| {
        decode::Error::message("no array of whole 32- or 64-bit floats (tags 81, 82, 85, 86)")
            .at(at)
    })?;
    if values.len() > values_max {
        return Err(BatchError::TooManySamples { max: values_max });
    }
    Ok(values)
}

/// The values of `bytes` cut into pieces of `N`; none when they do not come out even.
fn pieces<const N: usize>(bytes: &[u8], value: impl Fn([u8; N]) -> f64) -> Option<Vec<f64>> {
    let (pieces, rest) = bytes.as_chunks::<N>();
    rest.is_empty()
        .then(|| pieces.iter().map(|piece| value(*piece)).collect())
}

fn quality(reader: &mut Reader<'_>, values_max: usize) -> Result<Vec<u32>, BatchError> {
    let mut quality = Vec::new();
    reader.array(|reader| {
        admit(quality.len(), values_max)?;
        quality.push(reader.decoder.u32()?);
        Ok::<(), BatchError>(())
    })?;
    Ok(quality)
}

/// Whether one more value may follow `count` others.
const fn admit(count: usize, max: usize) -> Result<(), BatchError> {
    if count < max {
        Ok(())
    } else {
        Err(BatchError::TooManySamples { max })
    }
}
