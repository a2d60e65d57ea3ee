//! What a COMTRADE file holds.

/// Edition of the standard a file follows, as far as its layout differs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Revision {
    /// No revision field, or a year up to 1991.
    Y1991,
    /// Years 1992 to 2012; recorders write 1997, 2000, 2001 for the 1999 layout.
    Y1999,
    /// Years from 2013 on.
    Y2013,
}

impl Revision {
    /// The year of the edition.
    #[must_use]
    pub const fn year(self) -> u16 {
        match self {
            Self::Y1991 => 1991,
            Self::Y1999 => 1999,
            Self::Y2013 => 2013,
        }
    }
}

/// Coding of the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DataFormat {
    /// Comma-separated text.
    Ascii,
    /// 16-bit integers.
    Binary,
    /// 32-bit integers.
    Binary32,
    /// 32-bit IEEE 754 floating point.
    Float32,
}

impl DataFormat {
    /// The name the standard gives it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ascii => "ASCII",
            Self::Binary => "BINARY",
            Self::Binary32 => "BINARY32",
            Self::Float32 => "FLOAT32",
        }
    }

    /// The format called `name`, in any case.
    pub(super) fn from_name(name: &str) -> Option<Self> {
        [Self::Ascii, Self::Binary, Self::Binary32, Self::Float32]
            .into_iter()
            .find(|format| format.name().eq_ignore_ascii_case(name.trim()))
    }
}

/// Which side of the instrument transformer the values of a channel are on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scaling {
    /// Values are primary.
    Primary,
    /// Values are secondary; multiply by primary / secondary.
    Secondary,
    /// The file does not say (always so in 1991 files).
    Unstated,
}

/// One measured quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalogChannel {
    /// The channel's number in the file.
    pub number: u32,
    /// Name, white space trimmed.
    pub name: String,
    /// Phase as written: A, B, C, N, R, a number, or empty.
    pub phase: String,
    /// Circuit component being monitored, as written.
    pub circuit: String,
    /// Unit of the values: V, kV, A, kA and so on, as written.
    pub unit: String,
    /// Delay of the sampling against the time stamp, microseconds, as written. Not applied: see
    /// `docs/phasors.md`.
    pub skew_us: f64,
    /// Primary rating of the instrument transformer; none when absent or zero.
    pub primary: Option<f64>,
    /// Secondary rating of the instrument transformer; none when absent or zero.
    pub secondary: Option<f64>,
    /// Which side the values are on.
    pub scaling: Scaling,
    /// Values in `unit`, one per sample; NaN where the recorder marked the sample as missing.
    pub values: Vec<f64>,
}

impl AnalogChannel {
    /// Factor from the recorded value to the primary value; none when the file does not say.
    #[must_use]
    pub fn to_primary(&self) -> Option<f64> {
        match self.scaling {
            Scaling::Primary => Some(1.0),
            Scaling::Secondary => Some(self.primary? / self.secondary?),
            Scaling::Unstated => None,
        }
    }

    /// How many samples are missing or not finite.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.values.iter().filter(|v| !v.is_finite()).count()
    }
}

/// One contact or alarm, kept as its changes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DigitalChannel {
    /// The channel's number in the file.
    pub number: u32,
    /// Name, white space trimmed.
    pub name: String,
    /// Phase as written.
    pub phase: String,
    /// Circuit component being monitored, as written.
    pub circuit: String,
    /// State when nothing is wrong, when the file says so.
    pub normal: Option<bool>,
    /// State at the first sample.
    pub initial: bool,
    /// Index of each sample at which the state changes.
    pub changes: Vec<usize>,
}

impl DigitalChannel {
    /// State at sample `index`.
    #[must_use]
    pub fn state(&self, index: usize) -> bool {
        let flips = self.changes.partition_point(|&change| change <= index);
        self.initial ^ (flips % 2 == 1)
    }
}

/// A run of samples for which one sampling rate is declared.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// Index of the first sample.
    pub first: usize,
    /// Number of samples.
    pub len: usize,
    /// Samples per second; where the file declares none, the mean rate of the time stamps.
    pub rate_hz: f64,
}

/// Leap-second field of a 2013 file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LeapSecond {
    /// None in this recording.
    None,
    /// A second is inserted during this recording: later samples are one second too late.
    Inserted,
    /// A second is removed during this recording: later samples are one second too early.
    Removed,
    /// The recorder cannot tell.
    Unknown,
}

/// Time fields of a 2013 file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TimeCode {
    /// Offset of the file's time stamps from UTC, seconds; none when "not applicable".
    pub utc_offset_s: Option<i32>,
    /// Offset of the recorder's place from UTC, seconds; none when "not applicable".
    pub local_offset_s: Option<i32>,
    /// Time quality of the clock: 0 is locked, 15 is failed, the rest as C37.118's codes.
    pub quality: Option<u8>,
    /// Leap second during the recording.
    pub leap_second: LeapSecond,
}

/// Something a recorder did oddly that was read all the same.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Note {
    /// The file names a year that is no edition; the layout of `read_as` was used.
    UnusualRevision {
        /// Year in the file.
        year: u16,
        /// Layout used.
        read_as: Revision,
    },
    /// The total number of channels is not the sum of analog and digital ones.
    ChannelTotal {
        /// Total in the file.
        total: u64,
        /// Sum of the two.
        sum: u64,
    },
    /// A year of two digits was completed (70 to 99 are 19xx).
    ShortYear {
        /// Line in the configuration.
        line: usize,
        /// The year taken.
        year: i16,
    },
    /// Day and month are not in the order of the edition: the other order is the only possible one.
    DayAndMonthSwapped {
        /// Line in the configuration.
        line: usize,
    },
    /// The time stamp of this line is empty or zero: the time is unknown.
    TimeUnknown {
        /// Line in the configuration.
        line: usize,
    },
    /// Seconds of 60 (a leap second) were read as the next full second.
    SecondSixty {
        /// Line in the configuration.
        line: usize,
    },
    /// Lines at the end of the configuration that this edition should have are absent.
    LinesAbsent {
        /// The first of them.
        field: &'static str,
    },
    /// The data hold more samples than declared; the rest was not read.
    MoreDataThanDeclared {
        /// Samples declared.
        declared: usize,
    },
    /// The data end early and the caller asked to read them all the same.
    Truncated {
        /// Samples found.
        found: usize,
        /// Samples declared.
        declared: usize,
    },
    /// Time stamps contradict the declared rates and were not used.
    StampsDisagree {
        /// Median of stamp interval over declared interval.
        ratio: f64,
    },
    /// Time stamps jump between two samples; the jump was taken as a gap in the recording.
    Gap {
        /// Index of the sample after the gap.
        sample: usize,
        /// Length, seconds.
        seconds: f64,
    },
    /// Blank lines between samples were skipped because the caller asked for it.
    BlankLines {
        /// How many.
        count: usize,
    },
    /// Digital values other than 0 and 1 were taken as "no change".
    DigitalValues {
        /// How many.
        count: usize,
    },
}

/// A decoded COMTRADE recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Station, as written.
    pub station: String,
    /// Recorder, as written.
    pub recorder: String,
    /// Edition of the standard.
    pub revision: Revision,
    /// Coding of the samples.
    pub format: DataFormat,
    /// Name of the code page the texts were read with.
    pub code_page: &'static str,
    /// Line frequency, Hz; none when the file gives none.
    pub nominal_hz: Option<f64>,
    /// Time of the first sample, UTC nanoseconds; none when the recorder had no clock.
    pub start_ns: Option<i64>,
    /// Time of the trigger, UTC nanoseconds.
    pub trigger_ns: Option<i64>,
    /// Time fields of a 2013 file.
    pub time_code: Option<TimeCode>,
    /// Measured quantities.
    pub analog: Vec<AnalogChannel>,
    /// Contacts and alarms.
    pub digital: Vec<DigitalChannel>,
    /// Time of each sample after the first one, seconds.
    pub time_s: Vec<f64>,
    /// Runs with one declared rate, in order, without the empty ones.
    pub segments: Vec<Segment>,
    /// What was odd about the files.
    pub notes: Vec<Note>,
}

impl Recording {
    /// Number of samples.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.time_s.len()
    }

    /// Whether there is no sample; a decoded recording always has one.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.time_s.is_empty()
    }

    /// Seconds from the first sample to the last.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.time_s.last().copied().unwrap_or(0.0)
    }

    /// The analog channel called `name`, or with that number when no name matches.
    #[must_use]
    pub fn channel(&self, name: &str) -> Option<&AnalogChannel> {
        let by_name = self.analog.iter().find(|c| c.name == name.trim());
        by_name.or_else(|| {
            let number: u32 = name.trim().parse().ok()?;
            self.analog.iter().find(|c| c.number == number)
        })
    }
}
