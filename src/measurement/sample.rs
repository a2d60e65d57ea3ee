//! One instant of one load.

use super::Quality;

/// A measured quantity of a load.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Channel {
    /// Positive-sequence voltage magnitude, per unit of `v_base_kv`.
    VoltagePu,
    /// Positive-sequence voltage angle in a frame that turns at nominal frequency, radians.
    AngleRad,
    /// Frequency, hertz.
    FrequencyHz,
    /// Active power into the load, per unit of `s_base_mva`.
    ActivePu,
    /// Reactive power into the load, per unit of `s_base_mva`.
    ReactivePu,
    /// Negative-sequence voltage divided by positive-sequence voltage.
    NegativeSequenceRatio,
}

impl Channel {
    /// Every channel, in wire order.
    pub const ALL: [Self; 6] = [
        Self::VoltagePu,
        Self::AngleRad,
        Self::FrequencyHz,
        Self::ActivePu,
        Self::ReactivePu,
        Self::NegativeSequenceRatio,
    ];

    /// Whether a load can be followed without this channel.
    #[must_use]
    pub const fn optional(self) -> bool {
        matches!(self, Self::AngleRad | Self::NegativeSequenceRatio)
    }
}

/// One instant of one load: positive sequence, per unit on the load's base, consumption positive.
/// A quantity that is not measured is NaN.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// UTC, nanoseconds since 1970-01-01.
    pub time_ns: i64,
    /// Voltage magnitude, pu of `v_base_kv`.
    pub voltage_pu: f64,
    /// Voltage angle in a frame that turns at nominal frequency, radians; NaN without the channel.
    pub angle_rad: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Active power into the load, pu of `s_base_mva`.
    pub active_pu: f64,
    /// Reactive power into the load, pu of `s_base_mva`.
    pub reactive_pu: f64,
    /// Negative- over positive-sequence voltage; NaN without the channel.
    pub negative_sequence_ratio: f64,
    /// Flags of the source and of intake.
    pub quality: Quality,
}

impl Sample {
    /// The placeholder for an instant at which nothing was received.
    #[must_use]
    pub const fn missing(time_ns: i64) -> Self {
        Self {
            time_ns,
            voltage_pu: f64::NAN,
            angle_rad: f64::NAN,
            frequency_hz: f64::NAN,
            active_pu: f64::NAN,
            reactive_pu: f64::NAN,
            negative_sequence_ratio: f64::NAN,
            quality: Quality::MISSING,
        }
    }

    /// Whether voltage, frequency, P and Q are all finite and no flag forbids their use.
    #[must_use]
    pub fn usable(&self) -> bool {
        self.quality.usable()
            && self.voltage_pu.is_finite()
            && self.frequency_hz.is_finite()
            && self.active_pu.is_finite()
            && self.reactive_pu.is_finite()
    }

    /// The value of one channel.
    #[must_use]
    pub const fn value(&self, channel: Channel) -> f64 {
        match channel {
            Channel::VoltagePu => self.voltage_pu,
            Channel::AngleRad => self.angle_rad,
            Channel::FrequencyHz => self.frequency_hz,
            Channel::ActivePu => self.active_pu,
            Channel::ReactivePu => self.reactive_pu,
            Channel::NegativeSequenceRatio => self.negative_sequence_ratio,
        }
    }

    /// Sets the value of one channel.
    pub const fn set(&mut self, channel: Channel, value: f64) {
        match channel {
            Channel::VoltagePu => self.voltage_pu = value,
            Channel::AngleRad => self.angle_rad = value,
            Channel::FrequencyHz => self.frequency_hz = value,
            Channel::ActivePu => self.active_pu = value,
            Channel::ReactivePu => self.reactive_pu = value,
            Channel::NegativeSequenceRatio => self.negative_sequence_ratio = value,
        }
    }
}
