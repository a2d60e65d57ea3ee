//! COMTRADE files as they travel over zenoh: a CBOR envelope around cfg and dat, or a .cff as it is.

use minicbor::{Encoder, decode, encode};

use super::{VERSION, cbor::Reader};

/// Fields of the envelope; the index is the key.
const FIELDS: [&str; 4] = ["v", "name", "cfg", "dat"];

/// First characters of a .cff file (IEEE C37.111-2013, 11): its first section's separator.
const CFF_MARK: &[u8] = b"--- file type:";

/// Longest name of a recording, bytes. Chosen: what file systems admit.
const NAME_BYTES_MAX: usize = 255;

/// The files of one recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RecordingFiles {
    /// Configuration and data apart.
    CfgDat {
        /// Name without extension.
        name: String,
        /// The .cfg file.
        cfg: Vec<u8>,
        /// The .dat file.
        dat: Vec<u8>,
    },
    /// Everything in one .cff file.
    Cff(Vec<u8>),
}

/// What a recording may cost us at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RecordingLimits {
    /// Longest payload, bytes. Default: 64 MiB, an hour of ten channels at 1 kHz.
    pub payload_bytes_max: usize,
    /// Longest configuration, bytes. Default: 4 MiB, tens of thousands of channels.
    pub cfg_bytes_max: usize,
}

impl Default for RecordingLimits {
    fn default() -> Self {
        Self {
            payload_bytes_max: 64 << 20,
            cfg_bytes_max: 4 << 20,
        }
    }
}

/// Why a recording's payload is refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// More bytes than admitted.
    #[error("the {part} has {bytes} bytes, at most {max} are admitted")]
    TooLarge {
        /// `payload` or `cfg`.
        part: &'static str,
        /// Bytes received.
        bytes: usize,
        /// Limit.
        max: usize,
    },
    /// Neither a .cff file nor a well-formed envelope.
    #[error("the recording is neither a .cff file nor a well-formed CBOR envelope: {reason}")]
    Malformed {
        /// Where and why, in the words of the parser.
        reason: String,
    },
    /// The envelope is of another version.
    #[error("the recording has version {found}, known is 1")]
    UnknownVersion {
        /// Version found.
        found: u64,
    },
    /// A field that must be there is not, or is empty.
    #[error("the recording has no `{field}`, or an empty one")]
    MissingField {
        /// Field.
        field: &'static str,
    },
    /// The name is too long or holds characters that no file name should.
    #[error(
        "the recording's name is no file name: 1 to {bytes_max} bytes without / \\ or control characters"
    )]
    BadName {
        /// Longest name admitted, bytes.
        bytes_max: usize,
    },
    /// The envelope could not be written.
    #[error("the recording cannot be written: {reason}")]
    NotWritten {
        /// Why.
        reason: String,
    },
}

impl RecordingError {
    /// One word for a metric's label.
    #[must_use]
    pub const fn label(&self) -> &'static str {
        match self {
            Self::TooLarge { .. } => "too_large",
            Self::Malformed { .. } => "malformed",
            Self::UnknownVersion { .. } => "unknown_version",
            Self::MissingField { .. } => "missing_field",
            Self::BadName { .. } => "bad_name",
            Self::NotWritten { .. } => "not_written",
        }
    }
}

impl From<decode::Error> for RecordingError {
    fn from(error: decode::Error) -> Self {
        Self::Malformed {
            reason: error.to_string(),
        }
    }
}

/// Takes the files out of a payload. What is in them is not looked at.
///
/// # Errors
///
/// [`RecordingError`].
pub fn decode_recording(
    payload: &[u8],
    limits: &RecordingLimits,
) -> Result<RecordingFiles, RecordingError> {
    bounded("payload", payload, limits.payload_bytes_max)?;
    if is_cff(payload) {
        return Ok(RecordingFiles::Cff(payload.to_vec()));
    }
    let (mut version, mut name, mut cfg, mut dat) = (None, None, None, None);
    Reader::new(payload).document(&FIELDS, |reader, field| {
        match field {
            0 => version = Some(known_version(reader.decoder.u64()?)?),
            1 => name = Some(reader.decoder.str()?),
            2 => cfg = Some(reader.decoder.bytes()?),
            _ => dat = Some(reader.decoder.bytes()?),
        }
        Ok::<(), RecordingError>(())
    })?;
    let missing = |field| RecordingError::MissingField { field };
    version.ok_or_else(|| missing("v"))?;
    let name = valid_name(name.ok_or_else(|| missing("name"))?)?;
    let not_empty = |bytes: &&[u8]| !bytes.is_empty();
    let cfg = cfg.filter(not_empty).ok_or_else(|| missing("cfg"))?;
    let dat = dat.filter(not_empty).ok_or_else(|| missing("dat"))?;
    bounded("cfg", cfg, limits.cfg_bytes_max)?;
    Ok(RecordingFiles::CfgDat {
        name,
        cfg: cfg.to_vec(),
        dat: dat.to_vec(),
    })
}

/// The payload for a recording.
///
/// # Errors
///
/// [`RecordingError::NotWritten`]; no recording is known that causes it.
pub fn encode_recording(recording: &RecordingFiles) -> Result<Vec<u8>, RecordingError> {
    match recording {
        RecordingFiles::Cff(bytes) => Ok(bytes.clone()),
        RecordingFiles::CfgDat { name, cfg, dat } => {
            write(name, cfg, dat).map_err(|error| RecordingError::NotWritten {
                reason: error.to_string(),
            })
        }
    }
}

fn write(
    name: &str,
    cfg: &[u8],
    dat: &[u8],
) -> Result<Vec<u8>, encode::Error<std::convert::Infallible>> {
    let mut encoder = Encoder::new(Vec::with_capacity(cfg.len() + dat.len() + name.len() + 32));
    encoder.map(4)?.u8(0)?.u64(VERSION)?;
    encoder.u8(1)?.str(name)?;
    encoder.u8(2)?.bytes(cfg)?;
    encoder.u8(3)?.bytes(dat)?;
    Ok(encoder.into_writer())
}

fn is_cff(payload: &[u8]) -> bool {
    let text = payload
        .strip_prefix(b"\xef\xbb\xbf")
        .unwrap_or(payload)
        .trim_ascii_start();
    text.get(..CFF_MARK.len())
        .is_some_and(|start| start.eq_ignore_ascii_case(CFF_MARK))
}

fn bounded(part: &'static str, bytes: &[u8], max: usize) -> Result<(), RecordingError> {
    if bytes.len() <= max {
        return Ok(());
    }
    Err(RecordingError::TooLarge {
        part,
        bytes: bytes.len(),
        max,
    })
}

fn known_version(found: u64) -> Result<u64, RecordingError> {
    if found == VERSION {
        Ok(found)
    } else {
        Err(RecordingError::UnknownVersion { found })
    }
}

fn valid_name(name: &str) -> Result<String, RecordingError> {
    let admitted = |c: char| !"/\\".contains(c) && !c.is_control();
    if (1..=NAME_BYTES_MAX).contains(&name.len()) && name.chars().all(admitted) {
        return Ok(name.to_owned());
    }
    Err(RecordingError::BadName {
        bytes_max: NAME_BYTES_MAX,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files() -> RecordingFiles {
        RecordingFiles::CfgDat {
            name: "fault 12".to_owned(),
            cfg: b"station,1,1999\r\n".to_vec(),
            dat: vec![0, 1, 2, 255],
        }
    }

    #[test]
    fn the_files_come_out_as_they_went_in() {
        let payload = encode_recording(&files()).unwrap();
        assert_eq!(
            decode_recording(&payload, &RecordingLimits::default()).unwrap(),
            files()
        );
        let cff = RecordingFiles::Cff(b"--- file type: CFG ---\r\nstation".to_vec());
        let payload = encode_recording(&cff).unwrap();
        assert_eq!(
            decode_recording(&payload, &RecordingLimits::default()).unwrap(),
            cff
        );
    }

    #[test]
    fn names_are_accepted_as_keys() {
        let mut encoder = Encoder::new(Vec::new());
        encoder.begin_map().unwrap();
        encoder.str("dat").unwrap().bytes(b"d").unwrap();
        encoder.str("cfg").unwrap().bytes(b"c").unwrap();
        encoder
            .str("comment")
            .unwrap()
            .array(1)
            .unwrap()
            .u8(1)
            .unwrap();
        encoder.str("name").unwrap().str("n").unwrap();
        encoder.str("v").unwrap().u8(1).unwrap().end().unwrap();
        let decoded = decode_recording(encoder.writer(), &RecordingLimits::default()).unwrap();
        assert!(matches!(decoded, RecordingFiles::CfgDat { name, .. } if name == "n"));
    }

    #[test]
    fn a_bad_envelope_is_refused_with_its_reason() {
        let limits = RecordingLimits {
            payload_bytes_max: 64,
            cfg_bytes_max: 16,
        };
        let refused = |payload: &[u8]| decode_recording(payload, &limits).unwrap_err().label();
        let written = |name: &str, cfg: &[u8], dat: &[u8]| write(name, cfg, dat).unwrap();
        assert_eq!(refused(&[b' '; 65]), "too_large");
        assert_eq!(refused(b""), "malformed");
        assert_eq!(refused(b"\xa1\x00\x02"), "unknown_version");
        assert_eq!(refused(b"\xa1\x00\x01"), "missing_field");
        assert_eq!(refused(&written("n", b"", b"d")), "missing_field");
        assert_eq!(refused(&written("n", &[0; 17], b"d")), "too_large");
        assert_eq!(refused(&written("../n", b"c", b"d")), "bad_name");
        let mut trailing = written("n", b"c", b"d");
        trailing.push(0);
        assert_eq!(refused(&trailing), "malformed");
    }

    #[test]
    fn no_prefix_of_an_envelope_is_accepted() {
        let payload = encode_recording(&files()).unwrap();
        for length in 0..payload.len() {
            assert!(decode_recording(&payload[..length], &RecordingLimits::default()).is_err());
        }
    }
}
