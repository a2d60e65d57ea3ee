//! Writing a recording as COMTRADE 2013: configuration and data, or one `.cff`.
//!
//! Times are written in UTC (`time_code` 0). Values are written as they are in the recording's
//! unit; ASCII holds them as reals of seven digits, FLOAT32 in single precision, BINARY and
//! BINARY32 as integers over each channel's own range.

use std::{fs, path::Path};

use thiserror::Error as ThisError;

use super::{
    recording::{
        AnalogChannel, DataFormat, DigitalChannel, LeapSecond, Recording, Revision, Scaling,
        TimeCode,
    },
    sample_ticks::{Ticks, ticks},
};

/// Why a recording cannot be written.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum WriteError {
    /// A file cannot be written.
    #[error("cannot write {}: {source}", path.display())]
    Io {
        /// The file.
        path: std::path::PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The name ends in neither `.cfg` nor `.cff`.
    #[error("{} is not named .cfg or .cff", path.display())]
    UnknownExtension {
        /// The file that was named.
        path: std::path::PathBuf,
    },
    /// A text with a comma or a control character, which would be read as two fields or lines.
    #[error("{field} '{text}' holds a comma or a control character")]
    Text {
        /// Field of the configuration.
        field: &'static str,
        /// The text.
        text: String,
    },
    /// Nothing to write.
    #[error("the recording has no {what}")]
    Empty {
        /// `samples` or `channels`.
        what: &'static str,
    },
    /// A channel does not have one value for each sample.
    #[error("channel '{name}' has {found} values for {samples} samples")]
    Length {
        /// Channel.
        name: String,
        /// Values it has.
        found: usize,
        /// Samples of the recording.
        samples: usize,
    },
    /// A value that the format cannot hold.
    #[error("channel '{name}': {value} is outside the range of single precision")]
    Range {
        /// Channel.
        name: String,
        /// The value.
        value: f64,
    },
    /// Times that do not increase, or that last longer than 32-bit counters can say.
    #[error("sample {sample} at {seconds} s does not follow the one before it by a step")]
    Time {
        /// The sample, counted from 1.
        sample: usize,
        /// Its time.
        seconds: f64,
    },
    /// A date that has no year of four digits.
    #[error("the date of {utc_ns} ns after 1970 cannot be written")]
    Date {
        /// The time.
        utc_ns: i64,
    },
}

/// The two parts of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Encoded {
    /// The configuration (`.cfg`).
    pub configuration: Vec<u8>,
    /// The samples (`.dat`).
    pub data: Vec<u8>,
}

/// Writes `recording` to `path`: a `.cff`, or a `.cfg` with its `.dat` beside it.
///
/// # Errors
/// The recording cannot be written in this format, or a file cannot be written.
pub fn write(path: &Path, recording: &Recording, format: DataFormat) -> Result<(), WriteError> {
    let save = |path: &Path, bytes: &[u8]| {
        fs::write(path, bytes).map_err(|source| WriteError::Io {
            path: path.to_owned(),
            source,
        })
    };
    let extension = path.extension().unwrap_or_default().to_string_lossy();
    match extension.to_ascii_lowercase().as_str() {
        "cff" => save(path, &encode_container(recording, format)?),
        "cfg" => {
            let encoded = encode(recording, format)?;
            // The configuration comes last: who sees it finds the data complete.
            save(&path.with_extension("dat"), &encoded.data)?;
            save(path, &encoded.configuration)
        }
        _ => Err(WriteError::UnknownExtension {
            path: path.to_owned(),
        }),
    }
}

/// `recording` as one `.cff`.
///
/// # Errors
/// See [`encode`].
pub fn encode_container(recording: &Recording, format: DataFormat) -> Result<Vec<u8>, WriteError> {
    let Encoded {
        configuration,
        data,
    } = encode(recording, format)?;
    let length = if format == DataFormat::Ascii {
        String::new()
    } else {
        format!(": {}", data.len())
    };
    let mut out = b"--- file type: CFG ---\r\n".to_vec();
    out.extend(configuration);
    out.extend(b"--- file type: INF ---\r\n--- file type: HDR ---\r\n");
    out.extend(format!("--- file type: DAT {}{length} ---\r\n", format.name()).bytes());
    out.extend(data);
    Ok(out)
}

/// `recording` as configuration and data.
///
/// # Errors
/// A text holds a comma, a value does not fit the format, times do not increase, or channels do
/// not have one value for each sample: see [`WriteError`].
pub fn encode(recording: &Recording, format: DataFormat) -> Result<Encoded, WriteError> {
    check(recording)?;
    let ticks = ticks(recording)?;
    let codes: Vec<Code> = recording
        .analog
        .iter()
        .map(|channel| code(channel, format))
        .collect::<Result<_, _>>()?;
    let configuration = configuration(recording, format, &codes, &ticks)?;
    let data = match format {
        DataFormat::Ascii => ascii(recording, &ticks).into_bytes(),
        DataFormat::Binary | DataFormat::Binary32 | DataFormat::Float32 => {
            binary(recording, format, &codes, &ticks)
        }
    };
    Ok(Encoded {
        configuration: configuration.into_bytes(),
        data,
    })
}

fn check(recording: &Recording) -> Result<(), WriteError> {
    if recording.is_empty() {
        return Err(WriteError::Empty { what: "samples" });
    }
    if recording.analog.is_empty() && recording.digital.is_empty() {
        return Err(WriteError::Empty { what: "channels" });
    }
    let samples = recording.len();
    for channel in &recording.analog {
        let found = channel.values.len();
        if found != samples {
            return Err(WriteError::Length {
                name: channel.name.clone(),
                found,
                samples,
            });
        }
    }
    Ok(())
}

/// Value = `factor` * number + `offset`; numbers run from `low` to `high`.
#[derive(Clone, Copy, Debug)]
struct Code {
    factor: f64,
    offset: f64,
    low: f64,
    high: f64,
}

impl Code {
    /// The integer of `value` for a range of plus or minus `limit`.
    #[allow(
        clippy::cast_possible_truncation,
        reason = "the range of the channel maps to the range of the integer"
    )]
    fn integer(self, value: f64, limit: f64) -> i32 {
        ((value - self.offset) / self.factor)
            .round()
            .clamp(-limit, limit) as i32
    }
}

/// Largest number of a format of integers; none of a format of reals.
fn integer_limit(format: DataFormat) -> Option<f64> {
    match format {
        DataFormat::Binary => Some(f64::from(i16::MAX)),
        DataFormat::Binary32 => Some(f64::from(i32::MAX)),
        DataFormat::Ascii | DataFormat::Float32 => None,
    }
}

fn code(channel: &AnalogChannel, format: DataFormat) -> Result<Code, WriteError> {
    let finite = || channel.values.iter().copied().filter(|v| v.is_finite());
    if let Some(value) = finite().find(|v| v.abs() > f64::from(f32::MAX) * 0.999) {
        return Err(WriteError::Range {
            name: channel.name.clone(),
            value,
        });
    }
    let low = finite().fold(f64::INFINITY, f64::min);
    let high = finite().fold(f64::NEG_INFINITY, f64::max);
    let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
    let Some(limit) = integer_limit(format) else {
        return Ok(Code {
            factor: 1.0,
            offset: 0.0,
            low,
            high,
        });
    };
    let span = (high - low) / (2.0 * limit);
    Ok(Code {
        factor: if span > 0.0 { span } else { 1.0 },
        offset: 0.5 * (low + high),
        low: -limit,
        high: limit,
    })
}

/// A text as one field.
fn field(name: &'static str, text: &str) -> Result<String, WriteError> {
    if text.contains(|c: char| c == ',' || c.is_control()) {
        return Err(WriteError::Text {
            field: name,
            text: text.to_owned(),
        });
    }
    Ok(text.trim().to_owned())
}

fn configuration(
    recording: &Recording,
    format: DataFormat,
    codes: &[Code],
    ticks: &Ticks,
) -> Result<String, WriteError> {
    let (analog, digital) = (recording.analog.len(), recording.digital.len());
    let mut lines = vec![
        format!(
            "{},{},{}",
            field("station_name", &recording.station)?,
            field("rec_dev_id", &recording.recorder)?,
            Revision::Y2013.year()
        ),
        format!("{},{analog}A,{digital}D", analog + digital),
    ];
    for (index, (channel, code)) in recording.analog.iter().zip(codes).enumerate() {
        lines.push(analog_line(index + 1, channel, *code)?);
    }
    for (index, channel) in recording.digital.iter().enumerate() {
        lines.push(digital_line(index + 1, channel)?);
    }
    lines.push(format!("{}", recording.nominal_hz.unwrap_or(0.0)));
    lines.push(format!("{}", ticks.declared_rates));
    for (rate_hz, last) in &ticks.rates {
        lines.push(format!("{rate_hz},{last}"));
    }
    lines.push(stamp(recording.start_ns)?);
    lines.push(stamp(recording.trigger_ns.or(recording.start_ns))?);
    lines.push(format.name().to_owned());
    lines.push(format!("{}", ticks.multiplier));
    lines.push(format!("0,{}", local_code(recording.time_code)));
    lines.push(quality_line(recording.time_code));
    let mut text = lines.join("\r\n");
    text.push_str("\r\n");
    Ok(text)
}

fn analog_line(number: usize, channel: &AnalogChannel, code: Code) -> Result<String, WriteError> {
    let texts = [
        field("ch_id", &channel.name)?,
        field("ph", &channel.phase)?,
        field("ccbm", &channel.circuit)?,
        field("uu", &channel.unit)?,
    ];
    let scaling = match channel.scaling {
        Scaling::Primary => "P",
        Scaling::Secondary => "S",
        // The standard knows no third letter; a guess would turn volts into kilovolts.
        Scaling::Unstated => "",
    };
    Ok(format!(
        "{number},{},{:e},{:e},{},{:e},{:e},{},{},{scaling}",
        texts.join(","),
        code.factor,
        code.offset,
        channel.skew_us,
        code.low,
        code.high,
        channel.primary.unwrap_or(1.0),
        channel.secondary.unwrap_or(1.0),
    ))
}

fn digital_line(number: usize, channel: &DigitalChannel) -> Result<String, WriteError> {
    Ok(format!(
        "{number},{},{},{},{}",
        field("ch_id", &channel.name)?,
        field("ph", &channel.phase)?,
        field("ccbm", &channel.circuit)?,
        u8::from(channel.normal.unwrap_or(false))
    ))
}

/// `dd/mm/yyyy,hh:mm:ss.ssssss`, zeros for an unknown time. Nine digits would make the time stamps of the
/// data nanoseconds, so the fraction has six; the first sample is less than a microsecond off.
fn stamp(utc_ns: Option<i64>) -> Result<String, WriteError> {
    let Some(utc_ns) = utc_ns else {
        return Ok("00/00/0000,00:00:00.000000".to_owned());
    };
    let microseconds = utc_ns.div_euclid(1000) + i64::from(utc_ns.rem_euclid(1000) >= 500);
    let time = jiff::Timestamp::from_microsecond(microseconds)
        .map_err(|_| WriteError::Date { utc_ns })?
        .to_zoned(jiff::tz::TimeZone::UTC)
        .datetime();
    Ok(format!(
        "{:02}/{:02}/{:04},{:02}:{:02}:{:02}.{:06}",
        time.day(),
        time.month(),
        time.year(),
        time.hour(),
        time.minute(),
        time.second(),
        time.subsec_nanosecond() / 1000
    ))
}

/// The recorder's own offset from UTC, `x` when unknown.
fn local_code(code: Option<TimeCode>) -> String {
    let Some(offset_s) = code.and_then(|code| code.local_offset_s) else {
        return "x".to_owned();
    };
    let sign = if offset_s < 0 { "-" } else { "" };
    let minutes = offset_s.unsigned_abs() / 60;
    match (minutes / 60, minutes % 60) {
        (0, 0) => "0".to_owned(),
        (hours, 0) => format!("{sign}{hours}"),
        (hours, minutes) => format!("{sign}{hours}h{minutes:02}"),
    }
}

/// Time quality and leap second. A clock of which nothing is known is written as not reliable.
fn quality_line(code: Option<TimeCode>) -> String {
    const NOT_RELIABLE: u8 = 15;
    let quality = code.and_then(|code| code.quality).unwrap_or(NOT_RELIABLE);
    let leap_second = match code.map(|code| code.leap_second) {
        Some(LeapSecond::None) => 0,
        Some(LeapSecond::Inserted) => 1,
        Some(LeapSecond::Removed) => 2,
        Some(LeapSecond::Unknown) | None => 3,
    };
    format!("{quality:X},{leap_second}")
}

/// Reals of seven significant digits in scientific notation: at most 13 characters, and never
/// the 99999 that stands for "missing".
fn ascii(recording: &Recording, ticks: &Ticks) -> String {
    let mut out = String::new();
    for (index, tick) in ticks.stamps.iter().enumerate() {
        let mut fields = vec![(index + 1).to_string(), tick.to_string()];
        fields.extend(recording.analog.iter().map(|channel| {
            let value = channel.values[index];
            // Exponents of three digits would be too long for the field.
            let value = if value.abs() < 1e-99 { 0.0 } else { value };
            if value.is_finite() {
                format!("{value:.6e}")
            } else {
                "99999".to_owned()
            }
        }));
        let contacts = recording.digital.iter();
        fields.extend(contacts.map(|channel| u8::from(channel.state(index)).to_string()));
        out.push_str(&fields.join(","));
        out.push_str("\r\n");
    }
    out
}

fn binary(recording: &Recording, format: DataFormat, codes: &[Code], ticks: &Ticks) -> Vec<u8> {
    let mut out = Vec::new();
    for (number, (index, tick)) in (1_u32..).zip(ticks.stamps.iter().enumerate()) {
        out.extend(number.to_le_bytes());
        out.extend(tick.to_le_bytes());
        for (channel, code) in recording.analog.iter().zip(codes) {
            push_value(&mut out, channel.values[index], format, *code);
        }
        for word in recording.digital.chunks(16) {
            let bits = word.iter().enumerate();
            let states = bits.map(|(bit, channel)| u16::from(channel.state(index)) << bit);
            out.extend(states.fold(0, |word, bit| word | bit).to_le_bytes());
        }
    }
    out
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "values were checked against the range of single precision; integers against i16"
)]
fn push_value(out: &mut Vec<u8>, value: f64, format: DataFormat, code: Code) {
    let limit = integer_limit(format).unwrap_or(0.0);
    match format {
        DataFormat::Binary => {
            let number = if value.is_finite() {
                code.integer(value, limit) as i16
            } else {
                i16::MIN
            };
            out.extend(number.to_le_bytes());
        }
        DataFormat::Binary32 => {
            let number = if value.is_finite() {
                code.integer(value, limit)
            } else {
                i32::MIN
            };
            out.extend(number.to_le_bytes());
        }
        DataFormat::Float32 | DataFormat::Ascii => {
            let number = if value.is_finite() {
                value as f32
            } else {
                f32::MIN
            };
            out.extend(number.to_le_bytes());
        }
    }
}
