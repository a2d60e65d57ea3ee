//! A disturbance cut out of a stream, and what screening says of it.

use std::fmt;

use crate::measurement::Record;

/// Why a detector opened (or extended) a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Trigger {
    /// The voltage fell below the dip threshold (IEC 61000-4-30 terms).
    VoltageDip,
    /// The voltage rose above the swell threshold.
    VoltageSwell,
    /// The voltage moved by more than the step threshold within the step time.
    VoltageStep,
    /// The voltage's angle jumped by more than the threshold within the step time: line switching.
    PhaseJump,
    /// The frequency left the band around nominal.
    FrequencyExcursion,
    /// The frequency moved faster than the rate-of-change threshold.
    RateOfChangeOfFrequency,
    /// The whole recording was declared one disturbance by whoever recorded it.
    Recording,
}

impl Trigger {
    /// Every trigger.
    pub const ALL: [Self; 7] = [
        Self::VoltageDip,
        Self::VoltageSwell,
        Self::VoltageStep,
        Self::PhaseJump,
        Self::FrequencyExcursion,
        Self::RateOfChangeOfFrequency,
        Self::Recording,
    ];

    /// Short name from a closed set, for documents and metrics' labels.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::VoltageDip => "voltage_dip",
            Self::VoltageSwell => "voltage_swell",
            Self::VoltageStep => "voltage_step",
            Self::PhaseJump => "phase_jump",
            Self::FrequencyExcursion => "frequency_excursion",
            Self::RateOfChangeOfFrequency => "rate_of_change_of_frequency",
            Self::Recording => "recording",
        }
    }
}

/// Why a window was closed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Closing {
    /// Voltage and frequency were back in their bands and the post-trigger time had passed.
    Recovered,
    /// The longest admissible window was reached.
    LongestReached,
    /// The stream jumped in time.
    StreamGap,
    /// No sample arrived for longer than the silence limit, or the service is stopping.
    StreamSilent,
    /// The recording ended.
    RecordingEnded,
}

impl Closing {
    /// Short name from a closed set, for documents and metrics' labels.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Recovered => "recovered",
            Self::LongestReached => "longest_reached",
            Self::StreamGap => "stream_gap",
            Self::StreamSilent => "stream_silent",
            Self::RecordingEnded => "recording_ended",
        }
    }
}

/// A disturbance with the time before and after it.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Stable identifier: site and onset time, the same however often the data arrive.
    pub id: String,
    /// Site the load belongs to.
    pub site: String,
    /// The samples.
    pub record: Record,
    /// Index in `record.samples` of the first sample that met a trigger.
    pub onset: usize,
    /// Every trigger that was met, in order of first appearance.
    pub triggers: Vec<Trigger>,
    /// Why the window ended.
    pub closing: Closing,
}

impl Window {
    /// Time of the onset, UTC nanoseconds.
    #[must_use]
    pub fn onset_ns(&self) -> i64 {
        self.record.time_ns(self.onset)
    }
}

/// Identifier of a window: site and onset time to the millisecond, UTC, such as
/// `site-02-20260410T051102.585Z`. A time outside the calendar is written in nanoseconds.
#[must_use]
pub fn window_id(site: &str, onset_ns: i64) -> String {
    let rounded = jiff::Timestamp::from_nanosecond(i128::from(onset_ns)).and_then(|time| {
        time.round(
            jiff::TimestampRound::new()
                .smallest(jiff::Unit::Millisecond)
                .mode(jiff::RoundMode::HalfExpand),
        )
    });
    match rounded {
        Ok(time) => format!("{site}-{}", time.strftime("%Y%m%dT%H%M%S.%3fZ")),
        Err(_) => format!("{site}-{onset_ns}ns"),
    }
}

/// One objection of screening, with the number that caused it.
#[derive(Clone, Debug, PartialEq)]
pub enum ScreeningReason {
    /// Too little voltage change to see a load response.
    TooShallow {
        /// Largest voltage change, pu.
        change_pu: f64,
        /// Least change required, pu.
        required_pu: f64,
    },
    /// Too few usable samples.
    TooManyBadSamples {
        /// Usable share, 0 to 1.
        usable_share: f64,
        /// Least share required, 0 to 1.
        required_share: f64,
    },
    /// Enough samples are usable, but not all: a gap, or flags of the source.
    BadSamples {
        /// Share of the samples that are missing or not usable, 0 to 1.
        bad_share: f64,
        /// How many of them lie around the onset, where a load says most.
        at_onset: usize,
    },
    /// The source's clock was not synchronised.
    ClockNotSynchronised {
        /// Share of the samples for which it was not, 0 to 1.
        share: f64,
    },
    /// The record before the onset is too short to know the operating point.
    PreEventTooShort {
        /// Seconds before the onset.
        seconds: f64,
        /// Seconds required.
        required_s: f64,
    },
    /// The operating point moved before the onset.
    PreEventNotSteady {
        /// Range of the voltage before the onset, pu.
        voltage_range_pu: f64,
    },
    /// Negative-sequence voltage above the limit: an unbalanced fault.
    Unbalanced {
        /// Largest negative-sequence voltage over the positive-sequence voltage before the onset.
        ratio: f64,
        /// Limit.
        limit: f64,
    },
    /// Active power changes sign or is not positive: generation or transit, not a load.
    NotALoad {
        /// Lowest active power, pu.
        lowest_active_pu: f64,
        /// Highest active power, pu.
        highest_active_pu: f64,
    },
    /// The power moves without the voltage: the load itself was switched, or the fault is inside it.
    PowerDoesNotFollowVoltage {
        /// Share of the power's variation that voltage and frequency explain, 0 to 1.
        explained_share: f64,
    },
    /// The power before the onset is too small against its noise.
    NoPower {
        /// Mean active power before the onset, pu.
        active_pu: f64,
    },
    /// There is no voltage before the onset: a dead bus, or a file of zeros.
    NoVoltage {
        /// Median voltage before the onset, pu.
        voltage_pu: f64,
    },
}

impl ScreeningReason {
    /// Short name from a closed set, for documents and metrics' labels.
    #[must_use]
    pub const fn label(&self) -> &'static str {
        match self {
            Self::TooShallow { .. } => "too_shallow",
            Self::TooManyBadSamples { .. } => "too_many_bad_samples",
            Self::BadSamples { .. } => "bad_samples",
            Self::ClockNotSynchronised { .. } => "clock_not_synchronised",
            Self::PreEventTooShort { .. } => "pre_event_too_short",
            Self::PreEventNotSteady { .. } => "pre_event_not_steady",
            Self::Unbalanced { .. } => "unbalanced",
            Self::NotALoad { .. } => "not_a_load",
            Self::PowerDoesNotFollowVoltage { .. } => "power_does_not_follow_voltage",
            Self::NoPower { .. } => "no_power",
            Self::NoVoltage { .. } => "no_voltage",
        }
    }
}

/// One plain sentence, lower case and without a full stop.
impl fmt::Display for ScreeningReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooShallow {
                change_pu,
                required_pu,
            } => write!(
                f,
                "the voltage changes by {change_pu:.4} pu only, and a load's response is seen from {required_pu:.4} pu on"
            ),
            Self::TooManyBadSamples {
                usable_share,
                required_share,
            } => write!(
                f,
                "{:.1} % of the samples are usable, and {:.1} % are required",
                100.0 * usable_share,
                100.0 * required_share
            ),
            Self::BadSamples {
                bad_share,
                at_onset,
            } => write!(
                f,
                "{:.1} % of the samples are missing or not usable, {at_onset} of them around the onset",
                100.0 * bad_share
            ),
            Self::ClockNotSynchronised { share } => write!(
                f,
                "the source's clock was not synchronised during {:.1} % of the samples",
                100.0 * share
            ),
            Self::PreEventTooShort {
                seconds,
                required_s,
            } => write!(
                f,
                "there are {seconds:.3} s before the onset, and {required_s:.3} s are wanted to know the operating point"
            ),
            Self::PreEventNotSteady { voltage_range_pu } => write!(
                f,
                "the voltage moves by {voltage_range_pu:.4} pu before the onset"
            ),
            Self::Unbalanced { ratio, limit } => write!(
                f,
                "the negative-sequence voltage reaches {:.1} % of the voltage before the onset, above the limit of {:.1} %",
                100.0 * ratio,
                100.0 * limit
            ),
            Self::NotALoad {
                lowest_active_pu,
                highest_active_pu,
            } => write!(
                f,
                "not a load: the active power lies between {lowest_active_pu:.4} and {highest_active_pu:.4} pu, which is generation or transit"
            ),
            Self::PowerDoesNotFollowVoltage { explained_share } => write!(
                f,
                "the voltage explains {:.0} % of the active power's change: the load itself was switched, or the fault is inside it",
                100.0 * explained_share
            ),
            Self::NoPower { active_pu } => write!(
                f,
                "the active power before the onset is {active_pu:.5} pu, too little against its noise"
            ),
            Self::NoVoltage { voltage_pu } => write!(
                f,
                "the voltage before the onset is {voltage_pu:.4} pu: the bus is dead or the record empty"
            ),
        }
    }
}

/// The verdict of screening on one window.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Screening {
    /// Objections that forbid the use of the window; empty when it is usable.
    pub refusals: Vec<ScreeningReason>,
    /// Objections that are kept with the window but do not forbid its use.
    pub marks: Vec<ScreeningReason>,
}

impl Screening {
    /// Whether the window may be fitted.
    #[must_use]
    pub fn usable(&self) -> bool {
        self.refusals.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_window_is_named_after_site_and_onset() {
        assert_eq!(
            window_id("site-02", 1_775_797_862_584_999_999),
            "site-02-20260410T051102.585Z"
        );
        assert_eq!(window_id("a", 0), "a-19700101T000000.000Z");
    }
}
