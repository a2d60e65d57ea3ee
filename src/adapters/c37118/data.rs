//! Data frames (6.3, tables 5 and 6): what the PMUs of a stream measured at one instant.

use super::{
    bytes::Reader,
    configuration::{Configuration, PmuConfiguration},
    error::{EncodeError, Error, Reason},
    frame::{self, FrameKind, PREFIX_BYTES, Prefix},
    status::Status,
};
use crate::measurement::phasor::Complex;

/// Radians per step of an integer angle.
const ANGLE_UNIT_RAD: f64 = 1e-4;
/// Hertz per step of an integer frequency deviation.
const FREQUENCY_UNIT_HZ: f64 = 1e-3;
/// Hertz per second per step of an integer rate of change.
const ROCOF_UNIT_HZ_PER_S: f64 = 1e-2;

/// A data frame whose content waits for a configuration.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DataMessage {
    /// What the frame says about itself.
    pub prefix: Prefix,
    bytes: Vec<u8>,
}

/// A data frame.
#[derive(Clone, Debug, PartialEq)]
pub struct DataFrame {
    /// What the frame says about itself; IDCODE is the stream's.
    pub prefix: Prefix,
    /// One entry for each PMU of the configuration, in its order.
    pub pmus: Vec<PmuData>,
}

/// What one PMU measured.
#[derive(Clone, Debug, PartialEq)]
pub struct PmuData {
    /// STAT.
    pub status: Status,
    /// Phasors as sent.
    pub phasors: Vec<Phasor>,
    /// FREQ as sent: deviation from nominal in mHz as an integer, Hz in floating point.
    pub frequency: Number,
    /// DFREQ as sent: hundredths of Hz/s as an integer, Hz/s in floating point.
    pub rocof: Number,
    /// Analog values as sent.
    pub analogs: Vec<Number>,
    /// Words of contacts.
    pub digitals: Vec<u16>,
}

/// A phasor as sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phasor {
    /// Real and imaginary part, integers; -32768 stands for "absent".
    RectangularInteger {
        /// Real part.
        re: i16,
        /// Imaginary part.
        im: i16,
    },
    /// Magnitude and angle in 1e-4 rad, integers; an angle of -32768 stands for "absent".
    PolarInteger {
        /// Magnitude.
        magnitude: u16,
        /// Angle, 1e-4 rad.
        angle: i16,
    },
    /// Real and imaginary part.
    RectangularFloat {
        /// Real part.
        re: f32,
        /// Imaginary part.
        im: f32,
    },
    /// Magnitude and angle.
    PolarFloat {
        /// Magnitude.
        magnitude: f32,
        /// Angle, radians.
        angle_rad: f32,
    },
}

impl Phasor {
    /// The number without the channel's factor, not a number where absent, and whether it is an
    /// integer.
    pub(super) fn numbers(self) -> (Complex, bool) {
        const ABSENT: Complex = Complex::new(f64::NAN, f64::NAN);
        match self {
            Self::RectangularInteger { re: i16::MIN, .. }
            | Self::RectangularInteger { im: i16::MIN, .. }
            | Self::PolarInteger {
                angle: i16::MIN, ..
            } => (ABSENT, true),
            Self::RectangularInteger { re, im } => {
                (Complex::new(f64::from(re), f64::from(im)), true)
            }
            Self::PolarInteger { magnitude, angle } => {
                let angle_rad = f64::from(angle) * ANGLE_UNIT_RAD;
                (Complex::polar(f64::from(magnitude), angle_rad), true)
            }
            Self::RectangularFloat { re, im } => {
                (Complex::new(f64::from(re), f64::from(im)), false)
            }
            Self::PolarFloat {
                magnitude,
                angle_rad,
            } => {
                let value = Complex::polar(f64::from(magnitude), f64::from(angle_rad));
                (value, false)
            }
        }
    }
}

/// A number as sent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Number {
    /// 16 bits; -32768 stands for "absent".
    Integer(i16),
    /// Floating point; not a number stands for "absent".
    Float(f32),
}

impl Number {
    /// The number, not a number where absent.
    #[must_use]
    pub fn value(self) -> f64 {
        match self {
            Self::Integer(i16::MIN) => f64::NAN,
            Self::Integer(number) => f64::from(number),
            Self::Float(number) => f64::from(number),
        }
    }
}

impl PmuData {
    /// Frequency, Hz: nominal plus the deviation of an integer FREQ; a floating-point FREQ as it is.
    #[must_use]
    pub fn frequency_hz(&self, nominal_hz: f64) -> f64 {
        match self.frequency {
            Number::Integer(_) => nominal_hz + self.frequency.value() * FREQUENCY_UNIT_HZ,
            Number::Float(_) => self.frequency.value(),
        }
    }

    /// Rate of change of frequency, Hz/s.
    #[must_use]
    pub fn rocof_hz_per_s(&self) -> f64 {
        match self.rocof {
            Number::Integer(_) => self.rocof.value() * ROCOF_UNIT_HZ_PER_S,
            Number::Float(_) => self.rocof.value(),
        }
    }
}

impl DataMessage {
    pub(super) fn new(prefix: Prefix, bytes: &[u8]) -> Self {
        Self {
            prefix,
            bytes: bytes.to_vec(),
        }
    }

    /// Reads the content by `configuration`.
    ///
    /// # Errors
    /// The frame is of another stream, or does not have exactly the length the configuration
    /// gives: the source changed its configuration, which has to be asked for again.
    pub fn decode(&self, configuration: &Configuration) -> Result<DataFrame, Error> {
        let mut reader = Reader::new(&self.bytes, 0, Some(FrameKind::Data));
        let (found, expected) = (self.prefix.id_code, configuration.prefix.id_code);
        if found != expected {
            let reason = Reason::OtherStream { found, expected };
            return Err(reader.error(4, "IDCODE", reason));
        }
        let (found, expected) = (self.bytes.len(), configuration.data_bytes());
        if found != expected {
            let reason = Reason::NotAsConfigured { found, expected };
            return Err(reader.error(PREFIX_BYTES, "data", reason));
        }
        let pmus = configuration.pmus.iter();
        let pmus = pmus.map(|pmu| read_pmu(pmu, &mut reader));
        let pmus = pmus.collect::<Result<_, Error>>().map_err(|mut error| {
            error.offset += PREFIX_BYTES;
            error
        })?;
        Ok(DataFrame {
            prefix: self.prefix,
            pmus,
        })
    }
}

fn read_pmu(pmu: &PmuConfiguration, reader: &mut Reader<'_>) -> Result<PmuData, Error> {
    let format = pmu.format;
    let status = Status(reader.u16("STAT")?);
    let phasors = (0..pmu.phasors.len()).map(|_| read_phasor(pmu, reader));
    let phasors = phasors.collect::<Result<_, Error>>()?;
    let frequency = read_number(format.frequency_float(), reader, "FREQ")?;
    let rocof = read_number(format.frequency_float(), reader, "DFREQ")?;
    let analogs =
        (0..pmu.analogs.len()).map(|_| read_number(format.analogs_float(), reader, "ANALOG"));
    let analogs = analogs.collect::<Result<_, Error>>()?;
    let digitals = (0..pmu.digitals.len()).map(|_| reader.u16("DIGITAL"));
    let digitals = digitals.collect::<Result<_, Error>>()?;
    Ok(PmuData {
        status,
        phasors,
        frequency,
        rocof,
        analogs,
        digitals,
    })
}

fn read_phasor(pmu: &PmuConfiguration, reader: &mut Reader<'_>) -> Result<Phasor, Error> {
    const FIELD: &str = "PHASORS";
    let format = pmu.format;
    Ok(match (format.phasors_polar(), format.phasors_float()) {
        (false, false) => Phasor::RectangularInteger {
            re: reader.i16(FIELD)?,
            im: reader.i16(FIELD)?,
        },
        (true, false) => Phasor::PolarInteger {
            magnitude: reader.u16(FIELD)?,
            angle: reader.i16(FIELD)?,
        },
        (false, true) => Phasor::RectangularFloat {
            re: reader.f32(FIELD)?,
            im: reader.f32(FIELD)?,
        },
        (true, true) => Phasor::PolarFloat {
            magnitude: reader.f32(FIELD)?,
            angle_rad: reader.f32(FIELD)?,
        },
    })
}

fn read_number(float: bool, reader: &mut Reader<'_>, field: &'static str) -> Result<Number, Error> {
    Ok(if float {
        Number::Float(reader.f32(field)?)
    } else {
        Number::Integer(reader.i16(field)?)
    })
}

impl DataFrame {
    /// The frame's bytes.
    ///
    /// # Errors
    /// The data do not have the numbers and formats of `configuration`, or are longer than a frame.
    pub fn encode(&self, configuration: &Configuration) -> Result<Vec<u8>, EncodeError> {
        if self.pmus.len() != configuration.pmus.len() {
            let index = self.pmus.len().min(configuration.pmus.len()) + 1;
            let field = "the number of PMUs";
            return Err(EncodeError::NotAsConfigured { index, field });
        }
        let mut out = Vec::with_capacity(configuration.data_bytes());
        let pairs = self.pmus.iter().zip(&configuration.pmus);
        for (number, (data, pmu)) in pairs.enumerate() {
            let index = number + 1;
            write_pmu(data, pmu, &mut out)
                .map_err(|field| EncodeError::NotAsConfigured { index, field })?;
        }
        frame::seal(FrameKind::Data, self.prefix, &out)
    }
}

/// Writes one PMU's data, or names the field that is not as configured.
fn write_pmu(
    data: &PmuData,
    pmu: &PmuConfiguration,
    out: &mut Vec<u8>,
) -> Result<(), &'static str> {
    let same = |a: usize, b: usize, field| if a == b { Ok(()) } else { Err(field) };
    same(data.phasors.len(), pmu.phasors.len(), "PHASORS")?;
    same(data.analogs.len(), pmu.analogs.len(), "ANALOG")?;
    same(data.digitals.len(), pmu.digitals.len(), "DIGITAL")?;
    let format = pmu.format;
    out.extend(data.status.0.to_be_bytes());
    for &phasor in &data.phasors {
        let (polar, float) = match phasor {
            Phasor::RectangularInteger { re, im } => {
                out.extend([re.to_be_bytes(), im.to_be_bytes()].concat());
                (false, false)
            }
            Phasor::PolarInteger { magnitude, angle } => {
                out.extend([magnitude.to_be_bytes(), angle.to_be_bytes()].concat());
                (true, false)
            }
            Phasor::RectangularFloat { re, im } => {
                out.extend([re.to_be_bytes(), im.to_be_bytes()].concat());
                (false, true)
            }
            Phasor::PolarFloat {
                magnitude,
                angle_rad,
            } => {
                out.extend([magnitude.to_be_bytes(), angle_rad.to_be_bytes()].concat());
                (true, true)
            }
        };
        if (polar, float) != (format.phasors_polar(), format.phasors_float()) {
            return Err("PHASORS");
        }
    }
    write_number(data.frequency, format.frequency_float(), out).ok_or("FREQ")?;
    write_number(data.rocof, format.frequency_float(), out).ok_or("DFREQ")?;
    for &number in &data.analogs {
        write_number(number, format.analogs_float(), out).ok_or("ANALOG")?;
    }
    for word in &data.digitals {
        out.extend(word.to_be_bytes());
    }
    Ok(())
}

/// None when the number is not of the configured format.
fn write_number(number: Number, float: bool, out: &mut Vec<u8>) -> Option<()> {
    match number {
        Number::Integer(number) if !float => out.extend(number.to_be_bytes()),
        Number::Float(number) if float => out.extend(number.to_be_bytes()),
        Number::Integer(_) | Number::Float(_) => return None,
    }
    Some(())
}
