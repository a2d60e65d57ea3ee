//! The verdict of validation (design, section 11).

use serde::{Deserialize, Serialize};

use super::{
    json::nullable,
    words::{segment_named, verdict_channel_named, verdict_status_name, verdict_status_named},
};
use crate::{
    adapters::wire::DocumentError,
    identification::{ChannelVerdict, Verdict},
};

/// Counterpart of [`Verdict`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct VerdictV1 {
    /// `pass`, `fail` or `cannot_judge`.
    pub status: String,
    /// Each reason with its number.
    pub reasons: Vec<String>,
    /// The measured errors against the limits.
    pub channels: Vec<ChannelVerdictV1>,
}

/// Counterpart of [`ChannelVerdict`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChannelVerdictV1 {
    /// Event.
    pub event: String,
    /// `P` or `Q`.
    pub channel: String,
    /// `before`, `during` or `after`.
    pub segment: String,
    /// As [`ChannelVerdict::mxe_pu`].
    #[serde(with = "nullable")]
    pub mxe_pu: f64,
    /// As [`ChannelVerdict::me_pu`].
    #[serde(with = "nullable")]
    pub me_pu: f64,
    /// As [`ChannelVerdict::mae_pu`].
    #[serde(with = "nullable")]
    pub mae_pu: f64,
    /// Whether the three are within their limits.
    pub within_limits: bool,
}

impl From<&Verdict> for VerdictV1 {
    fn from(verdict: &Verdict) -> Self {
        Self {
            status: verdict_status_name(verdict.status).to_owned(),
            reasons: verdict.reasons.clone(),
            channels: verdict
                .channels
                .iter()
                .map(ChannelVerdictV1::from)
                .collect(),
        }
    }
}

impl From<&ChannelVerdict> for ChannelVerdictV1 {
    fn from(verdict: &ChannelVerdict) -> Self {
        Self {
            event: verdict.event.clone(),
            channel: verdict.channel.to_owned(),
            segment: verdict.segment.to_owned(),
            mxe_pu: verdict.mxe_pu,
            me_pu: verdict.me_pu,
            mae_pu: verdict.mae_pu,
            within_limits: verdict.within_limits,
        }
    }
}

impl TryFrom<VerdictV1> for Verdict {
    type Error = DocumentError;

    fn try_from(verdict: VerdictV1) -> Result<Self, DocumentError> {
        Ok(Self {
            status: verdict_status_named(&verdict.status)?,
            reasons: verdict.reasons,
            channels: verdict
                .channels
                .into_iter()
                .map(ChannelVerdict::try_from)
                .collect::<Result<_, _>>()?,
        })
    }
}

impl TryFrom<ChannelVerdictV1> for ChannelVerdict {
    type Error = DocumentError;

    fn try_from(verdict: ChannelVerdictV1) -> Result<Self, DocumentError> {
        Ok(Self {
            event: verdict.event,
            channel: verdict_channel_named(&verdict.channel)?,
            segment: segment_named(&verdict.segment)?,
            mxe_pu: verdict.mxe_pu,
            me_pu: verdict.me_pu,
            mae_pu: verdict.mae_pu,
            within_limits: verdict.within_limits,
        })
    }
}
