//! Where a model fails: residuals by event, channel and segment, what they depend on, and one plain
//! sentence for each event.
//!
//! [`failure`] looks at one event, [`pooled`] adds events up. Both are pure and deterministic; their
//! cost is linear in the samples but for the correlations (samples times lags).

mod autocorrelation;
mod cross_correlation;
mod dependence;
mod failure;
mod segments;
mod sentence;
mod series;
#[cfg(test)]
mod tests;

pub use failure::{departure, failure, failure_of_series};
pub use segments::pooled;
pub use series::{ChannelSeries, EventSeries};

/// A part of a window, by what the voltage does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Segment {
    /// Before the disturbance.
    Before,
    /// From the onset to the clearing, or of a step without clearing the first moments.
    During,
    /// The first half second after the clearing.
    EarlyRecovery,
    /// Until two seconds after the clearing.
    Late,
    /// The rest of the window.
    After,
}

impl Segment {
    /// As JSON writes it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Before => "before",
            Self::During => "during",
            Self::EarlyRecovery => "early_recovery",
            Self::Late => "late",
            Self::After => "after",
        }
    }
}

/// A measured channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Channel {
    /// Active power.
    Active,
    /// Reactive power.
    Reactive,
}

impl Channel {
    /// `P` or `Q`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Active => "P",
            Self::Reactive => "Q",
        }
    }
}

/// Residual (measured minus model) of one channel in one segment. Every used sample counts by the
/// inverse square of its deviation in the fit, so that samples near edges, which the measurement
/// leaves uncertain, count little.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentResidual {
    /// Segment.
    pub segment: Segment,
    /// Channel.
    pub channel: Channel,
    /// Begin and end, seconds since the onset; of the earliest and latest when events are pooled.
    pub begin_s: f64,
    /// End.
    pub end_s: f64,
    /// Used samples.
    pub samples: usize,
    /// Mean, pu of P0.
    pub mean_pu: f64,
    /// Root mean square, pu of P0.
    pub rms_pu: f64,
    /// Root mean square of residual over the sample's deviation; 1 is noise alone.
    pub to_noise: f64,
}

/// What a residual may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Voltage over its value before the event.
    Voltage,
    /// Its rate of change, 1/s.
    VoltageRate,
    /// Frequency deviation, relative.
    FrequencyDeviation,
    /// Time since the clearing, or since the onset where nothing clears, s.
    TimeSinceClearing,
}

impl Quantity {
    /// As JSON writes it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Voltage => "voltage",
            Self::VoltageRate => "voltage_rate",
            Self::FrequencyDeviation => "frequency_deviation",
            Self::TimeSinceClearing => "time_since_clearing",
        }
    }
}

/// How a residual depends on a quantity: means in bins of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Dependence {
    /// Channel.
    pub channel: Channel,
    /// Quantity.
    pub quantity: Quantity,
    /// Share of the residual's variance over the event that the bins' means explain, 0 to 1,
    /// corrected for the number of bins and for how few of the samples are independent.
    pub explained: f64,
    /// Centre, mean residual (pu of P0), its standard error and the number of samples of each bin.
    pub bins: Vec<(f64, f64, f64, usize)>,
}

/// Cross-correlation of a channel's residual with the voltage deviation.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossCorrelation {
    /// Channel.
    pub channel: Channel,
    /// Lags, seconds; positive: the residual follows the voltage.
    pub lags_s: Vec<f64>,
    /// Correlation at each lag, -1 to 1.
    pub correlation: Vec<f64>,
    /// Absolute values below this are what a residual that has nothing to do with the voltage, but
    /// is as slow as this one, shows at a given lag in 95 of 100 cases (Bartlett).
    pub band: f64,
}

/// Where a model fails in one event.
#[derive(Clone, Debug, PartialEq)]
pub struct EventFailure {
    /// Event.
    pub event: String,
    /// The failure in one sentence, or that there is none.
    pub sentence: String,
    /// Lowest voltage, pu of the pre-event voltage: the rung of the severity ladder.
    pub lowest_voltage: f64,
    /// Largest relative frequency deviation, signed.
    pub frequency_deviation: f64,
    /// Root mean square of residual over deviation of the event part, both channels; near edges the
    /// deviation is what the fit takes it to be.
    pub error_to_noise: f64,
    /// Instant of the clearing, seconds since the onset; none where the voltage steps, ramps or
    /// swings without one.
    pub clearing_s: Option<f64>,
    /// Residuals by segment and channel.
    pub segments: Vec<SegmentResidual>,
    /// Dependences, strongest first.
    pub dependences: Vec<Dependence>,
    /// Cross-correlations of P and Q.
    pub cross_correlations: Vec<CrossCorrelation>,
    /// What all of it was computed from, for whoever draws it.
    pub series: EventSeries,
}
