//! The frame around every message (6.2, table 2): SYNC, FRAMESIZE, IDCODE, SOC, FRACSEC, CHK; and
//! the two messages that need no configuration: header and command.

use std::fmt;

use super::{
    bytes::Reader,
    checksum::crc_ccitt,
    configuration::{Configuration, ConfigurationKind},
    configuration_fixed,
    configuration_variable::ConfigurationPart,
    data::DataMessage,
    error::{EncodeError, Error, Reason},
    name,
    time::Timestamp,
};

/// First byte of every frame.
pub(super) const SYNC: u8 = 0xaa;
/// Bytes before the message.
pub(super) const PREFIX_BYTES: usize = 14;
/// Bytes of CHK.
pub(super) const CHECK_BYTES: usize = 2;
/// Bytes of the shortest frame: a message without content.
pub(super) const FRAME_BYTES_MIN: usize = PREFIX_BYTES + CHECK_BYTES;
/// Bytes of the longest frame: FRAMESIZE has 16 bits.
pub(super) const FRAME_BYTES_MAX: usize = 65_535;

/// Kind of a frame: bits 6 to 4 of the second byte of SYNC.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameKind {
    /// Measurements.
    Data,
    /// Text for people.
    Header,
    /// What the source can send.
    Configuration1,
    /// What the source sends.
    Configuration2,
    /// A request to the source.
    Command,
    /// What the source sends, with names of any length, scale factors and place.
    Configuration3,
}

impl FrameKind {
    /// The code in SYNC.
    #[must_use]
    pub const fn code(self) -> u8 {
        match self {
            Self::Data => 0,
            Self::Header => 1,
            Self::Configuration1 => 2,
            Self::Configuration2 => 3,
            Self::Command => 4,
            Self::Configuration3 => 5,
        }
    }

    /// The kind with that code.
    pub(super) const fn from_code(code: u8) -> Option<Self> {
        Some(match code {
            0 => Self::Data,
            1 => Self::Header,
            2 => Self::Configuration1,
            3 => Self::Configuration2,
            4 => Self::Command,
            5 => Self::Configuration3,
            _ => return None,
        })
    }
}

impl fmt::Display for FrameKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Data => "data",
            Self::Header => "header",
            Self::Configuration1 => "CFG-1",
            Self::Configuration2 => "CFG-2",
            Self::Command => "command",
            Self::Configuration3 => "CFG-3",
        })
    }
}

/// Edition of the standard a message is defined in: bits 3 to 0 of SYNC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Version {
    /// IEEE C37.118-2005; code 1.
    Y2005,
    /// IEEE C37.118.2-2011; code 2.
    #[default]
    Y2011,
}

impl Version {
    const fn code(self) -> u8 {
        match self {
            Self::Y2005 => 1,
            Self::Y2011 => 2,
        }
    }
}

/// What every frame says about itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Prefix {
    /// Edition.
    pub version: Version,
    /// IDCODE: the stream (of a command: the stream addressed).
    pub id_code: u16,
    /// Time of the measurement; of other frames, time of sending.
    pub time: Timestamp,
}

/// A decoded frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Frame {
    /// Measurements, to be read with [`DataMessage::decode`].
    Data(DataMessage),
    /// Text for people.
    Header(HeaderFrame),
    /// CFG-1 or CFG-2.
    Configuration(Configuration),
    /// A CFG-3 or one part of it, for a [`super::ConfigurationAssembler`].
    ConfigurationPart(ConfigurationPart),
    /// A request.
    Command(CommandFrame),
}

/// Text for people (6.5, table 13).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct HeaderFrame {
    /// What every frame says about itself.
    pub prefix: Prefix,
    /// The text.
    pub text: String,
}

/// A request to a source (6.6, tables 14 and 15).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandFrame {
    /// What every frame says about itself; the IDCODE is the stream addressed.
    pub prefix: Prefix,
    /// What is asked for.
    pub command: Command,
}

/// What a command asks for (table 15).
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Command {
    /// 1: stop sending data.
    DataOff,
    /// 2: start sending data.
    DataOn,
    /// 3: send the header.
    SendHeader,
    /// 4: send CFG-1.
    SendConfiguration1,
    /// 5: send CFG-2.
    SendConfiguration2,
    /// 6: send CFG-3.
    SendConfiguration3,
    /// 8: an extended frame with these bytes.
    Extended(Vec<u8>),
    /// Any other code: reserved or agreed between users.
    Other(u16),
}

impl Command {
    /// The command word.
    #[must_use]
    pub const fn code(&self) -> u16 {
        match self {
            Self::DataOff => 1,
            Self::DataOn => 2,
            Self::SendHeader => 3,
            Self::SendConfiguration1 => 4,
            Self::SendConfiguration2 => 5,
            Self::SendConfiguration3 => 6,
            Self::Extended(_) => EXTENDED,
            Self::Other(code) => *code,
        }
    }
}

const EXTENDED: u16 = 8;

/// Reads one frame; `bytes` must be the whole frame and nothing else.
///
/// # Errors
/// [`Error`]: the frame is cut, too long, of an unknown kind or version, its check word is wrong,
/// or a field of its message is.
pub fn decode(bytes: &[u8]) -> Result<Frame, Error> {
    let (kind, prefix) = envelope(bytes)?;
    let message = &bytes[..bytes.len() - CHECK_BYTES];
    let mut reader = Reader::new(message, PREFIX_BYTES, Some(kind));
    let frame = match kind {
        FrameKind::Data => Frame::Data(DataMessage::new(prefix, reader.rest())),
        FrameKind::Header => Frame::Header(HeaderFrame {
            prefix,
            text: name::text(reader.rest()),
        }),
        FrameKind::Configuration1 => {
            let kind = ConfigurationKind::Configuration1;
            Frame::Configuration(configuration_fixed::read(prefix, kind, &mut reader)?)
        }
        FrameKind::Configuration2 => {
            let kind = ConfigurationKind::Configuration2;
            Frame::Configuration(configuration_fixed::read(prefix, kind, &mut reader)?)
        }
        FrameKind::Configuration3 => {
            Frame::ConfigurationPart(ConfigurationPart::read(prefix, &mut reader)?)
        }
        FrameKind::Command => Frame::Command(command(prefix, &mut reader)?),
    };
    reader.end("CHK")?;
    Ok(frame)
}

/// Checks SYNC, FRAMESIZE and CHK, and reads the prefix.
fn envelope(bytes: &[u8]) -> Result<(FrameKind, Prefix), Error> {
    let mut reader = Reader::new(bytes, 0, None);
    let sync = reader.u8("SYNC")?;
    if sync != SYNC {
        let found = i64::from(sync);
        let expected = "0xAA";
        return Err(reader.error(0, "SYNC", Reason::Value { found, expected }));
    }
    let second = reader.u8("SYNC")?;
    let found = i64::from(second);
    let (kind, version) = kind_and_version(second).map_err(|expected| {
        let reason = Reason::Value { found, expected };
        reader.error(1, "SYNC", reason)
    })?;
    let mut reader = Reader::new(bytes, 2, Some(kind));
    let stated = usize::from(reader.u16("FRAMESIZE")?);
    let received = bytes.len();
    if stated != received {
        return Err(reader.error(2, "FRAMESIZE", Reason::Length { stated, received }));
    }
    let Some((checked, check)) = bytes
        .split_last_chunk::<CHECK_BYTES>()
        .filter(|_| received >= FRAME_BYTES_MIN)
    else {
        let needed = FRAME_BYTES_MIN;
        let left = received;
        return Err(reader.error(2, "FRAMESIZE", Reason::Ends { needed, left }));
    };
    let stated = u16::from_be_bytes(*check);
    let computed = crc_ccitt(checked);
    if stated != computed {
        let reason = Reason::Checksum { stated, computed };
        return Err(reader.error(checked.len(), "CHK", reason));
    }
    let id_code = reader.u16("IDCODE")?;
    let time = Timestamp::read(&mut reader)?;
    let prefix = Prefix {
        version,
        id_code,
        time,
    };
    Ok((kind, prefix))
}

/// The second byte of SYNC, or what it should be.
fn kind_and_version(byte: u8) -> Result<(FrameKind, Version), &'static str> {
    let kind = FrameKind::from_code(byte >> 4)
        .ok_or("a frame type of 0 to 5 (bits 6 to 4) below a zero bit 7")?;
    let version = match byte & 0x0f {
        1 => Version::Y2005,
        2 => Version::Y2011,
        _ => return Err("version 1 (2005) or 2 (2011) (bits 3 to 0)"),
    };
    Ok((kind, version))
}

fn command(prefix: Prefix, reader: &mut Reader<'_>) -> Result<CommandFrame, Error> {
    let command = match reader.u16("CMD")? {
        1 => Command::DataOff,
        2 => Command::DataOn,
        3 => Command::SendHeader,
        4 => Command::SendConfiguration1,
        5 => Command::SendConfiguration2,
        6 => Command::SendConfiguration3,
        EXTENDED => Command::Extended(reader.rest().to_vec()),
        code => Command::Other(code),
    };
    Ok(CommandFrame { prefix, command })
}

/// Puts the frame around `message`.
pub(super) fn seal(
    kind: FrameKind,
    prefix: Prefix,
    message: &[u8],
) -> Result<Vec<u8>, EncodeError> {
    let found = PREFIX_BYTES + message.len() + CHECK_BYTES;
    let size = u16::try_from(found).map_err(|_| EncodeError::TooMany {
        field: "FRAMESIZE",
        found,
        max: FRAME_BYTES_MAX,
    })?;
    let mut out = Vec::with_capacity(found);
    out.extend([SYNC, kind.code() << 4 | prefix.version.code()]);
    out.extend(size.to_be_bytes());
    out.extend(prefix.id_code.to_be_bytes());
    prefix.time.write(&mut out)?;
    out.extend(message);
    let check = crc_ccitt(&out);
    out.extend(check.to_be_bytes());
    Ok(out)
}

impl HeaderFrame {
    /// The frame's bytes.
    ///
    /// # Errors
    /// The text is longer than a frame.
    pub fn encode(&self) -> Result<Vec<u8>, EncodeError> {
        seal(FrameKind::Header, self.prefix, self.text.as_bytes())
    }
}

impl CommandFrame {
    /// The frame's bytes.
    ///
    /// # Errors
    /// The bytes of an extended frame are longer than a frame.
    pub fn encode(&self) -> Result<Vec<u8>, EncodeError> {
        let mut message = self.command.code().to_be_bytes().to_vec();
        if let Command::Extended(bytes) = &self.command {
            message.extend(bytes);
        }
        seal(FrameKind::Command, self.prefix, &message)
    }
}
