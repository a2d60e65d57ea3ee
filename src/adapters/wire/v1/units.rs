//! Channels and units as the wire names them.

use crate::measurement::{Channel, Site};

/// Name of a channel on the wire.
#[must_use]
pub const fn channel_name(channel: Channel) -> &'static str {
    match channel {
        Channel::VoltagePu => "voltage",
        Channel::AngleRad => "angle",
        Channel::FrequencyHz => "frequency",
        Channel::ActivePu => "active_power",
        Channel::ReactivePu => "reactive_power",
        Channel::NegativeSequenceRatio => "negative_sequence_ratio",
    }
}

/// The channel of that name on the wire.
pub(super) fn channel_named(name: &str) -> Option<Channel> {
    Channel::ALL
        .into_iter()
        .find(|channel| channel_name(*channel) == name)
}

/// The names of all channels, for a message.
pub(super) fn channel_names() -> String {
    Channel::ALL.map(channel_name).join(", ")
}

/// The unit in which the domain keeps a channel, and in which we write it.
pub(super) const fn own_unit(channel: Channel) -> &'static str {
    match channel {
        Channel::VoltagePu | Channel::ActivePu | Channel::ReactivePu => "pu",
        Channel::AngleRad => "rad",
        Channel::FrequencyHz => "Hz",
        Channel::NegativeSequenceRatio => "1",
    }
}

/// The units a channel may come in, for a message.
#[must_use]
pub const fn accepted_units(channel: Channel) -> &'static str {
    match channel {
        Channel::VoltagePu => "pu, kV (line to line)",
        Channel::AngleRad => "rad, deg",
        Channel::FrequencyHz => "Hz",
        Channel::ActivePu => "pu, MW",
        Channel::ReactivePu => "pu, MVAr, Mvar",
        Channel::NegativeSequenceRatio => "1, %",
    }
}

/// What a value of `channel` in `unit` has to be multiplied by to be in the domain's unit, on the
/// base of `site`; none when the channel cannot have this unit.
pub(super) fn factor_to_own(channel: Channel, unit: &str, site: &Site) -> Option<f64> {
    if unit == own_unit(channel) {
        return Some(1.0);
    }
    match (channel, unit) {
        (Channel::VoltagePu, "kV") => Some(1.0 / site.v_base_kv),
        (Channel::AngleRad, "deg") => Some(std::f64::consts::PI / 180.0),
        (Channel::ActivePu, "MW") | (Channel::ReactivePu, "MVAr" | "Mvar") => {
            Some(1.0 / site.s_base_mva)
        }
        (Channel::NegativeSequenceRatio, "%") => Some(0.01),
        _ => None,
    }
}
