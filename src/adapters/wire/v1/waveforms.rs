//! Waveforms of a window as bytes for storage.
//!
//! Layout, little endian: `LMW1` (4 bytes), count (u32), `start_ns` (i64), `rate_fps` (f64),
//! `nominal_hz` (f64), then column by column the samples' times relative to the grid (i64), the six
//! channels in wire order (f64) and the quality (u32), then the CRC-32 (ISO-HDLC) of everything
//! before it (u32). A column is written byte plane by byte plane (all lowest bytes, then all second
//! bytes ...) and each plane as runs (see [`write_plane`]): sign, exponent and high mantissa of
//! neighbouring samples are equal, so that these planes nearly vanish, while every bit, that of a
//! NaN's payload included, is kept.

use crate::measurement::{Channel, Quality, Record, Sample, record::grid_offset_ns};

const MARK: &[u8; 4] = b"LMW1";

/// Bytes before the columns.
const HEADER_BYTES: usize = 4 + 4 + 8 + 8 + 8;

/// Most samples in one window: 2^24 samples are 77 hours at 60 per second. Bounds what a damaged
/// count can make us allocate.
const COUNT_MAX: usize = 1 << 24;

/// Longest run or stretch of one control byte.
const RUN_MAX: usize = 128;

/// Why waveforms cannot be unpacked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WaveformError {
    /// It does not begin with the mark of a version known here.
    #[error("stored waveforms begin with {found:02x?}, known is `LMW1`")]
    UnknownFormat {
        /// The first four bytes (fewer are filled with zeros).
        found: [u8; 4],
    },
    /// The checksum is not that of the content.
    #[error("stored waveforms have checksum {computed:#010x}, not {stated:#010x} as they say")]
    ChecksumDiffers {
        /// Checksum stored with them.
        stated: u32,
        /// Checksum of what is there.
        computed: u32,
    },
    /// It ends too early, goes on too long or counts too many samples.
    #[error("stored waveforms are inconsistent at byte {at}")]
    Inconsistent {
        /// Where.
        at: usize,
    },
}

/// Packs a record, every bit of it.
#[must_use]
pub fn encode_waveforms(record: &Record) -> Vec<u8> {
    let samples = &record.samples[..record.samples.len().min(COUNT_MAX)];
    let mut bytes = Vec::with_capacity(HEADER_BYTES + 32 * samples.len());
    bytes.extend_from_slice(MARK);
    // Cannot be cut: COUNT_MAX fits.
    bytes.extend_from_slice(
        &u32::try_from(samples.len())
            .unwrap_or(u32::MAX)
            .to_le_bytes(),
    );
    bytes.extend_from_slice(&record.start_ns.to_le_bytes());
    bytes.extend_from_slice(&record.rate_fps.to_le_bytes());
    bytes.extend_from_slice(&record.nominal_hz.to_le_bytes());
    let offsets = samples.iter().enumerate().map(|(at, sample)| {
        sample
            .time_ns
            .wrapping_sub(grid_time_ns(record, at))
            .to_le_bytes()
    });
    write_column(&mut bytes, &offsets.collect::<Vec<_>>());
    for channel in Channel::ALL {
        let values = samples.iter().map(|s| s.value(channel).to_le_bytes());
        write_column(&mut bytes, &values.collect::<Vec<_>>());
    }
    let quality = samples.iter().map(|s| s.quality.0.to_le_bytes());
    write_column(&mut bytes, &quality.collect::<Vec<_>>());
    let checksum = crc32(&bytes);
    bytes.extend_from_slice(&checksum.to_le_bytes());
    bytes
}

/// Unpacks a record.
///
/// # Errors
///
/// [`WaveformError`]; bytes that were changed in any way are not accepted.
pub fn decode_waveforms(bytes: &[u8]) -> Result<Record, WaveformError> {
    let mut found = [0; 4];
    for (to, from) in found.iter_mut().zip(bytes) {
        *to = *from;
    }
    if &found != MARK {
        return Err(WaveformError::UnknownFormat { found });
    }
    let end = bytes.len().saturating_sub(4);
    let mut unpacker = Unpacker { bytes, at: end };
    let stated = u32::from_le_bytes(unpacker.take()?);
    let computed = crc32(&bytes[..end]);
    if stated != computed {
        return Err(WaveformError::ChecksumDiffers { stated, computed });
    }
    let content = &bytes[..end];
    unpacker = Unpacker {
        bytes: content,
        at: MARK.len(),
    };
    unpacker.record()
}

struct Unpacker<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Unpacker<'_> {
    fn record(&mut self) -> Result<Record, WaveformError> {
        let count = u32::from_le_bytes(self.take()?) as usize;
        // A sample takes at least 60 planes of 2 bytes per run of 128, so nearly one byte.
        if count > COUNT_MAX || count > 2 * self.bytes.len() {
            return Err(self.inconsistent());
        }
        let mut record = Record {
            start_ns: i64::from_le_bytes(self.take()?),
            rate_fps: f64::from_le_bytes(self.take()?),
            nominal_hz: f64::from_le_bytes(self.take()?),
            samples: vec![Sample::missing(0); count],
        };
        for (at, offset) in self.column::<8>(count)?.into_iter().enumerate() {
            record.samples[at].time_ns =
                grid_time_ns(&record, at).wrapping_add(i64::from_le_bytes(offset));
        }
        for channel in Channel::ALL {
            let values = self.column::<8>(count)?;
            for (sample, value) in record.samples.iter_mut().zip(values) {
                sample.set(channel, f64::from_le_bytes(value));
            }
        }
        for (sample, flags) in record.samples.iter_mut().zip(self.column::<4>(count)?) {
            sample.quality = Quality(u32::from_le_bytes(flags));
        }
        if self.at == self.bytes.len() {
            Ok(record)
        } else {
            Err(self.inconsistent())
        }
    }

    fn column<const N: usize>(&mut self, count: usize) -> Result<Vec<[u8; N]>, WaveformError> {
        let mut values = vec![[0; N]; count];
        for plane in 0..N {
            let mut filled = 0;
            while filled < count {
                let [control] = self.take::<1>()?;
                let length = usize::from(control & 0x7f) + 1;
                if length > count - filled {
                    return Err(self.inconsistent());
                }
                let repeated = control & 0x80 != 0;
                let [mut byte] = if repeated { self.take::<1>()? } else { [0] };
                for value in &mut values[filled..filled + length] {
                    if !repeated {
                        [byte] = self.take::<1>()?;
                    }
                    value[plane] = byte;
                }
                filled += length;
            }
        }
        Ok(values)
    }

    fn take<const N: usize>(&mut self) -> Result<[u8; N], WaveformError> {
        let piece = self
            .bytes
            .get(self.at..)
            .and_then(<[u8]>::first_chunk::<N>)
            .ok_or_else(|| self.inconsistent())?;
        self.at += N;
        Ok(*piece)
    }

    const fn inconsistent(&self) -> WaveformError {
        WaveformError::Inconsistent { at: self.at }
    }
}

/// As [`Record::time_ns`], for a start and a rate that nobody has checked.
fn grid_time_ns(record: &Record, index: usize) -> i64 {
    record
        .start_ns
        .wrapping_add(grid_offset_ns(index as f64, record.rate_fps))
}

fn write_column<const N: usize>(bytes: &mut Vec<u8>, values: &[[u8; N]]) {
    for plane in 0..N {
        let plane: Vec<u8> = values.iter().map(|value| value[plane]).collect();
        write_plane(bytes, &plane);
    }
}

/// Writes a plane as runs: a control byte `0x80 + n - 1` and one byte stand for `n` equal bytes, a
/// control byte `n - 1` is followed by `n` bytes as they are; `n` is 1 to 128.
fn write_plane(bytes: &mut Vec<u8>, plane: &[u8]) {
    /// Shorter runs cost as much as they save.
    const RUN_MIN: usize = 3;
    let mut literal = 0;
    let mut at = 0;
    while at < plane.len() {
        let run = plane[at..]
            .iter()
            .take(RUN_MAX)
            .take_while(|byte| **byte == plane[at])
            .count();
        if run >= RUN_MIN {
            write_stretch(bytes, &plane[literal..at]);
            bytes.extend_from_slice(&[0x80 | control(run), plane[at]]);
            at += run;
            literal = at;
        } else {
            at += 1;
        }
    }
    write_stretch(bytes, &plane[literal..]);
}

fn write_stretch(bytes: &mut Vec<u8>, stretch: &[u8]) {
    for piece in stretch.chunks(RUN_MAX) {
        bytes.push(control(piece.len()));
        bytes.extend_from_slice(piece);
    }
}

/// The control byte for a length of 1 to 128.
fn control(length: usize) -> u8 {
    u8::try_from(length.saturating_sub(1)).unwrap_or(u8::MAX)
}

/// CRC-32 as in zlib and ISO 3309: polynomial 0x04c11db7 reflected, initial value and final
/// exclusive or all ones.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(u32::MAX, |crc, byte| {
        CRC_TABLE[((crc ^ u32::from(*byte)) & 0xff) as usize] ^ (crc >> 8)
    })
}

const CRC_TABLE: [u32; 256] = {
    let mut table = [0; 256];
    let mut index = 0;
    while index < table.len() {
        #[allow(
            clippy::cast_possible_truncation,
            reason = "the index is below 256; try_from is not const"
        )]
        let mut crc = index as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 {
                0xedb8_8320 ^ (crc >> 1)
            } else {
                crc >> 1
            };
            bit += 1;
        }
        table[index] = crc;
        index += 1;
    }
    table
};

#[cfg(test)]
mod tests {
    use super::*;

    /// A dip with noise in the low bits, a gap, and a NaN with a payload.
    fn record() -> Record {
        let mut state = 1_u64;
        let mut noise = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 40) as f64 / f64::from(1 << 24) * 1e-4
        };
        let mut record = Record {
            start_ns: 1_770_873_060_000_000_000,
            rate_fps: 60.0,
            nominal_hz: 60.0,
            samples: Vec::new(),
        };
        for at in 0..600 {
            let mut sample = Sample::missing(record.time_ns(at));
            if at != 300 {
                sample.voltage_pu = 1.0 + noise();
                sample.frequency_hz = 60.0;
                sample.active_pu = 0.9 + noise();
                sample.reactive_pu = -0.0;
                sample.quality = Quality(0x2000);
            }
            record.samples.push(sample);
        }
        record.samples[10].active_pu = f64::from_bits(0x7ff8_dead_beef_0001);
        record.samples[11].active_pu = f64::NEG_INFINITY;
        record.samples[12].time_ns += 1;
        record
    }

    fn bits(record: &Record) -> Vec<(i64, Vec<u64>, u32)> {
        record
            .samples
            .iter()
            .map(|s| {
                let values = Channel::ALL.map(|c| s.value(c).to_bits()).to_vec();
                (s.time_ns, values, s.quality.0)
            })
            .collect()
    }

    #[test]
    fn every_bit_comes_back() {
        let record = record();
        let bytes = encode_waveforms(&record);
        let back = decode_waveforms(&bytes).unwrap();
        assert_eq!(bits(&back), bits(&record));
        assert_eq!(back.start_ns, record.start_ns);
        assert_eq!(back.rate_fps.to_bits(), record.rate_fps.to_bits());
        let plain = record.samples.len() * (8 + 6 * 8 + 4);
        assert!(bytes.len() * 2 < plain, "{} of {plain}", bytes.len());
    }

    #[test]
    fn an_empty_record_comes_back() {
        let empty = Record {
            samples: Vec::new(),
            ..record()
        };
        assert_eq!(decode_waveforms(&encode_waveforms(&empty)).unwrap(), empty);
    }

    #[test]
    fn the_checksum_is_the_one_of_zlib() {
        // The check value of CRC-32/ISO-HDLC in the catalogue of parametrised CRC algorithms.
        assert_eq!(crc32(b"123456789"), 0xcbf4_3926);
    }

    #[test]
    fn no_changed_byte_and_no_prefix_is_accepted() {
        let bytes = encode_waveforms(&record());
        for at in (0..bytes.len()).step_by(7) {
            let mut changed = bytes.clone();
            changed[at] ^= 0x10;
            assert!(decode_waveforms(&changed).is_err(), "byte {at}");
            assert!(decode_waveforms(&bytes[..at]).is_err(), "length {at}");
        }
    }

    #[test]
    fn inconsistent_content_under_a_right_checksum_is_refused() {
        let bytes = encode_waveforms(&record());
        for at in (4..bytes.len() - 4).step_by(5) {
            let mut changed = bytes[..bytes.len() - 4].to_vec();
            changed[at] = changed[at].wrapping_add(0x7b);
            let checksum = crc32(&changed);
            changed.extend_from_slice(&checksum.to_le_bytes());
            // Values may change; what counts is that nothing worse than an error happens.
            if let Ok(back) = decode_waveforms(&changed) {
                assert!(back.samples.len() <= COUNT_MAX);
            }
        }
    }
}
