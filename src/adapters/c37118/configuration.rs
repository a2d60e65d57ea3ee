//! What a stream holds: the content of CFG-1, CFG-2 and CFG-3 frames.

use std::ops::BitOr;

use super::{
    bytes::Reader,
    channel::{AnalogChannel, DigitalWord, PhasorChannel},
    configuration_fixed, configuration_variable,
    error::{EncodeError, Error, Reason},
    frame::{FrameKind, Prefix},
    time::FRACTION_MAX,
};

/// Which frame a configuration was read from or is written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfigurationKind {
    /// What the source can send.
    Configuration1,
    /// What the source sends.
    Configuration2,
    /// What the source sends, in the layout of 2011.
    Configuration3,
}

impl ConfigurationKind {
    /// The frame's kind.
    #[must_use]
    pub const fn frame_kind(self) -> FrameKind {
        match self {
            Self::Configuration1 => FrameKind::Configuration1,
            Self::Configuration2 => FrameKind::Configuration2,
            Self::Configuration3 => FrameKind::Configuration3,
        }
    }
}

/// A configuration (tables 8 to 12).
#[derive(Clone, Debug, PartialEq)]
pub struct Configuration {
    /// What the frame says about itself; IDCODE is the stream's.
    pub prefix: Prefix,
    /// Layout.
    pub kind: ConfigurationKind,
    /// High byte of `TIME_BASE`, reserved.
    pub time_base_flags: u8,
    /// `TIME_BASE`: parts of a second FRACSEC counts, 1 to 2^24 - 1.
    pub time_base: u32,
    /// The PMUs whose data a data frame holds, in that order; at least one.
    pub pmus: Vec<PmuConfiguration>,
    /// Rate of data frames.
    pub rate: DataRate,
}

/// `DATA_RATE` as received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataRate(pub i16);

impl DataRate {
    /// Frames per second: the number itself, or one over its negative; none for zero.
    #[must_use]
    pub fn frames_per_second(self) -> Option<f64> {
        match self.0 {
            0 => None,
            rate @ 1.. => Some(f64::from(rate)),
            rate => Some(-1.0 / f64::from(rate)),
        }
    }
}

/// FORMAT as received: how numbers are written in data frames.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Format(pub u16);

impl Format {
    /// Bit 0: magnitude and angle instead of real and imaginary part.
    pub const PHASORS_POLAR: Self = Self(1);
    /// Bit 1: phasors in floating point.
    pub const PHASORS_FLOAT: Self = Self(2);
    /// Bit 2: analog values in floating point.
    pub const ANALOGS_FLOAT: Self = Self(4);
    /// Bit 3: FREQ and DFREQ in floating point.
    pub const FREQUENCY_FLOAT: Self = Self(8);

    /// Whether phasors are magnitude and angle.
    #[must_use]
    pub const fn phasors_polar(self) -> bool {
        self.holds(Self::PHASORS_POLAR)
    }

    /// Whether phasors are in floating point.
    #[must_use]
    pub const fn phasors_float(self) -> bool {
        self.holds(Self::PHASORS_FLOAT)
    }

    /// Whether analog values are in floating point.
    #[must_use]
    pub const fn analogs_float(self) -> bool {
        self.holds(Self::ANALOGS_FLOAT)
    }

    /// Whether FREQ and DFREQ are in floating point.
    #[must_use]
    pub const fn frequency_float(self) -> bool {
        self.holds(Self::FREQUENCY_FLOAT)
    }

    const fn holds(self, bit: Self) -> bool {
        self.0 & bit.0 != 0
    }
}

impl BitOr for Format {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// FNOM as received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NominalFrequencyCode(pub u16);

impl NominalFrequencyCode {
    /// 60 Hz.
    pub const HZ_60: Self = Self(0);
    /// 50 Hz.
    pub const HZ_50: Self = Self(1);

    /// Nominal frequency, Hz.
    #[must_use]
    pub const fn hz(self) -> f64 {
        if self.0 & 1 == 0 { 60.0 } else { 50.0 }
    }
}

/// One PMU of a configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct PmuConfiguration {
    /// STN: name of the station.
    pub station: String,
    /// IDCODE of the PMU.
    pub id_code: u16,
    /// How numbers are written.
    pub format: Format,
    /// Phasors, in the order of the data.
    pub phasors: Vec<PhasorChannel>,
    /// Analog values, in the order of the data.
    pub analogs: Vec<AnalogChannel>,
    /// Words of contacts, in the order of the data.
    pub digitals: Vec<DigitalWord>,
    /// Nominal frequency.
    pub nominal: NominalFrequencyCode,
    /// CFGCNT: how often the configuration has changed.
    pub changes: u16,
    /// What only CFG-3 says.
    pub place: Option<LocationAndFilter>,
}

/// What only CFG-3 says of a PMU (table 11).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocationAndFilter {
    /// `G_PMU_ID`: a number agreed between users.
    pub global_id: [u8; 16],
    /// Latitude, degrees north; infinite when unknown.
    pub latitude_deg: f32,
    /// Longitude, degrees east; infinite when unknown.
    pub longitude_deg: f32,
    /// Height, metres above sea level; infinite when unknown.
    pub elevation_m: f32,
    /// Service class of C37.118.1: `M` or `P`.
    pub service_class: u8,
    /// Length of the measurement window with all filters, microseconds.
    pub window_us: i32,
    /// Group delay, microseconds; already compensated in the time stamps.
    pub group_delay_us: i32,
}

impl PmuConfiguration {
    /// Bytes of this PMU in a data frame (table 5).
    #[must_use]
    pub const fn data_bytes(&self) -> usize {
        let phasor = if self.format.phasors_float() { 8 } else { 4 };
        let frequency = if self.format.frequency_float() { 8 } else { 4 };
        let analog = if self.format.analogs_float() { 4 } else { 2 };
        2 + phasor * self.phasors.len()
            + frequency
            + analog * self.analogs.len()
            + 2 * self.digitals.len()
    }
}

impl Configuration {
    /// Bytes of the data in a data frame, without prefix and CHK.
    #[must_use]
    pub fn data_bytes(&self) -> usize {
        self.pmus.iter().map(PmuConfiguration::data_bytes).sum()
    }

    /// Whether the two describe the same data: all but the time at which they were sent.
    #[must_use]
    pub fn says_the_same_as(&self, other: &Self) -> bool {
        let at_our_time = Self {
            prefix: Prefix {
                time: self.prefix.time,
                ..other.prefix
            },
            ..other.clone()
        };
        *self == at_our_time
    }

    /// The frames' bytes: one frame, or for a CFG-3 that is longer than a frame as many as it
    /// takes.
    ///
    /// # Errors
    /// A name, a count or a scaling does not fit the layout: see [`EncodeError`].
    pub fn encode(&self) -> Result<Vec<Vec<u8>>, EncodeError> {
        if self.pmus.is_empty() {
            return Err(EncodeError::Value {
                field: "NUM_PMU",
                found: 0,
                expected: "at least one PMU",
            });
        }
        if self.time_base == 0 || self.time_base > FRACTION_MAX {
            return Err(EncodeError::Value {
                field: "TIME_BASE",
                found: i64::from(self.time_base),
                expected: "1 to 16777215",
            });
        }
        match self.kind {
            ConfigurationKind::Configuration3 => configuration_variable::write(self),
            _ => Ok(vec![configuration_fixed::write(self)?]),
        }
    }

    pub(super) fn write_time_base(&self, out: &mut Vec<u8>) {
        out.extend((u32::from(self.time_base_flags) << 24 | self.time_base).to_be_bytes());
    }
}

/// Reads `TIME_BASE`: flags and parts of a second.
pub(super) fn time_base(reader: &mut Reader<'_>) -> Result<(u8, u32), Error> {
    const FIELD: &str = "TIME_BASE";
    let offset = reader.offset();
    let word = reader.u32(FIELD)?;
    let time_base = word & FRACTION_MAX;
    if time_base == 0 {
        let (found, expected) = (0, "a number of parts of a second");
        return Err(reader.error(offset, FIELD, Reason::Value { found, expected }));
    }
    Ok((word.to_be_bytes()[0], time_base))
}

/// Reads `NUM_PMU`.
pub(super) fn pmu_count(reader: &mut Reader<'_>) -> Result<usize, Error> {
    const FIELD: &str = "NUM_PMU";
    let offset = reader.offset();
    let count = reader.u16(FIELD)?;
    if count == 0 {
        let (found, expected) = (0, "at least one PMU");
        return Err(reader.error(offset, FIELD, Reason::Value { found, expected }));
    }
    Ok(usize::from(count))
}

/// PHNMR, ANNMR, DGNMR.
pub(super) fn channel_counts(reader: &mut Reader<'_>) -> Result<[usize; 3], Error> {
    Ok([
        usize::from(reader.u16("PHNMR")?),
        usize::from(reader.u16("ANNMR")?),
        usize::from(reader.u16("DGNMR")?),
    ])
}
