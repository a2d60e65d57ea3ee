//! The binary data formats: fixed rows of sample number, time stamp, analog values and words of
//! sixteen digital states, all little-endian.

use super::{
    configuration::{Analog, Configuration},
    recording::{DataFormat, Revision},
    sample_times::{RawTime, Rows},
};

/// The time stamp that stands for "none".
const STAMP_MISSING: u32 = u32::MAX;

/// Reads as many complete rows as are there and declared.
pub(super) fn parse(configuration: &Configuration, bytes: &[u8]) -> Rows {
    let format = configuration.format;
    let value_bytes = if format == DataFormat::Binary { 2 } else { 4 };
    let words = configuration.digital.len().div_ceil(16);
    let row_bytes = 8 + value_bytes * configuration.analog.len() + 2 * words;
    let declared = configuration.samples();
    let available = bytes.len() / row_bytes;
    let mut rows = Rows::new(configuration, available.min(declared));
    for row in bytes.chunks_exact(row_bytes).take(declared) {
        let (head, values) = row.split_at(8);
        let (values, states) = values.split_at(value_bytes * configuration.analog.len());
        let stamp = u32_at(&head[4..]);
        rows.times.push(RawTime {
            number: i64::from(u32_at(head)),
            stamp: (stamp != STAMP_MISSING).then_some(f64::from(stamp)),
        });
        let channels = configuration.analog.iter().zip(&mut rows.analog);
        for ((channel, column), field) in channels.zip(values.chunks_exact(value_bytes)) {
            let recorded = value(format, missing_code(configuration.revision, channel), field);
            column.push(channel.factor * recorded + channel.offset);
        }
        let index = rows.times.len() - 1;
        for (channel, track) in rows.digital.iter_mut().enumerate() {
            let at = channel / 16 * 2;
            let word = u16::from_le_bytes([states[at], states[at + 1]]);
            track.push(index, word >> (channel % 16) & 1 == 1);
        }
    }
    rows.more_than_declared = available > declared;
    rows.unwrap_stamps();
    rows
}

fn u32_at(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// The code of sixteen bits that stands for "missing": 0x8000, or 0xFFFF in 1991. Recorders of that time that
/// declare negative values write them as two's complements: there 0xFFFF is the value next to zero.
fn missing_code(revision: Revision, channel: &Analog) -> Option<i16> {
    if revision > Revision::Y1991 {
        return Some(i16::MIN);
    }
    let has_negative = channel.lowest.is_some_and(|lowest| lowest < 0.0);
    (!has_negative).then_some(-1)
}

/// The recorded number, or NaN for the code that stands for "missing".
fn value(format: DataFormat, missing: Option<i16>, field: &[u8]) -> f64 {
    match format {
        DataFormat::Binary => {
            let code = i16::from_le_bytes([field[0], field[1]]);
            if Some(code) == missing {
                f64::NAN
            } else {
                f64::from(code)
            }
        }
        DataFormat::Float32 => {
            let code = f32::from_bits(u32_at(field));
            if code.is_finite() && code > f32::MIN {
                f64::from(code)
            } else {
                f64::NAN
            }
        }
        DataFormat::Binary32 | DataFormat::Ascii => {
            let code = u32_at(field).cast_signed();
            if code == i32::MIN {
                f64::NAN
            } else {
                f64::from(code)
            }
        }
    }
}
