//! Summaries of recorded events, and what screening said of them.

use serde::{Deserialize, Serialize};

use super::{
    VERSION,
    json::{nullable, rfc3339},
    words::{closing_name, trigger_name},
};
use crate::{
    adapters::wire::DocumentError,
    disturbance::{Screening, ScreeningReason, Window},
};

/// What is published when an event has been recorded.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EventSummaryV1 {
    /// Version of this format: 1.
    pub v: u64,
    /// Site.
    pub site: String,
    /// Identifier of the event.
    pub event: String,
    /// Onset, RFC 3339.
    pub onset_utc: String,
    /// Triggers, in order of first appearance.
    pub triggers: Vec<&'static str>,
    /// Why the window ended.
    pub closing: &'static str,
    /// Seconds recorded before the onset.
    #[serde(with = "nullable")]
    pub pre_event_s: f64,
    /// Seconds recorded from the onset on.
    #[serde(with = "nullable")]
    pub duration_s: f64,
    /// Median of the voltage before the onset, pu.
    #[serde(with = "nullable")]
    pub pre_event_voltage_pu: f64,
    /// Lowest voltage, pu.
    #[serde(with = "nullable")]
    pub lowest_voltage_pu: f64,
    /// Largest change of the voltage from its median before the onset, pu.
    #[serde(with = "nullable")]
    pub depth_pu: f64,
    /// Samples per second.
    #[serde(with = "nullable")]
    pub rate_fps: f64,
    /// Share of the samples that may be used, 0 to 1.
    #[serde(with = "nullable")]
    pub usable_share: f64,
    /// What screening said; null when it has not been asked yet.
    pub screening: Option<ScreeningV1>,
}

/// Counterpart of [`Screening`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScreeningV1 {
    /// Whether the event may be fitted.
    pub usable: bool,
    /// Objections that forbid its use.
    pub refusals: Vec<ReasonV1>,
    /// Objections that do not.
    pub marks: Vec<ReasonV1>,
}

/// Counterpart of [`ScreeningReason`], told apart by the field `reason`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "snake_case")]
#[allow(
    missing_docs,
    reason = "each variant and field is that of the domain's type, documented there"
)]
pub enum ReasonV1 {
    TooShallow {
        #[serde(with = "nullable")]
        change_pu: f64,
        #[serde(with = "nullable")]
        required_pu: f64,
    },
    TooManyBadSamples {
        #[serde(with = "nullable")]
        usable_share: f64,
        #[serde(with = "nullable")]
        required_share: f64,
    },
    BadSamples {
        #[serde(with = "nullable")]
        bad_share: f64,
        at_onset: usize,
    },
    ClockNotSynchronised {
        #[serde(with = "nullable")]
        share: f64,
    },
    PreEventTooShort {
        #[serde(with = "nullable")]
        seconds: f64,
        #[serde(with = "nullable")]
        required_s: f64,
    },
    PreEventNotSteady {
        #[serde(with = "nullable")]
        voltage_range_pu: f64,
    },
    Unbalanced {
        #[serde(with = "nullable")]
        ratio: f64,
        #[serde(with = "nullable")]
        limit: f64,
    },
    NotALoad {
        #[serde(with = "nullable")]
        lowest_active_pu: f64,
        #[serde(with = "nullable")]
        highest_active_pu: f64,
    },
    PowerDoesNotFollowVoltage {
        #[serde(with = "nullable")]
        explained_share: f64,
    },
    NoPower {
        #[serde(with = "nullable")]
        active_pu: f64,
    },
    NoVoltage {
        #[serde(with = "nullable")]
        voltage_pu: f64,
    },
}

/// Writes the summary of an event as compact JSON.
///
/// # Errors
///
/// [`DocumentError::Malformed`]; no window is known that causes it.
pub fn encode_event_summary(
    window: &Window,
    screening: Option<&Screening>,
) -> Result<String, DocumentError> {
    serde_json::to_string(&EventSummaryV1::new(window, screening)).map_err(|source| {
        DocumentError::Malformed {
            document: "event summary",
            source,
        }
    })
}

impl EventSummaryV1 {
    /// The summary of `window`.
    #[must_use]
    pub fn new(window: &Window, screening: Option<&Screening>) -> Self {
        let record = &window.record;
        let voltages = |samples: &[crate::measurement::Sample]| -> Vec<f64> {
            let usable = samples.iter().filter(|sample| sample.usable());
            usable.map(|sample| sample.voltage_pu).collect()
        };
        let onset = window.onset.min(record.samples.len());
        let pre_event_voltage_pu = median(voltages(&record.samples[..onset]));
        let depth_pu = voltages(&record.samples[onset..])
            .into_iter()
            .map(|voltage| (voltage - pre_event_voltage_pu).abs())
            .fold(f64::NAN, f64::max);
        let pre_event_s = onset as f64 / record.rate_fps;
        Self {
            v: VERSION,
            site: window.site.clone(),
            event: window.id.clone(),
            onset_utc: rfc3339(window.onset_ns()),
            triggers: window.triggers.iter().copied().map(trigger_name).collect(),
            closing: closing_name(window.closing),
            pre_event_s,
            duration_s: record.duration_s() - pre_event_s,
            pre_event_voltage_pu,
            lowest_voltage_pu: record.lowest_voltage_pu(),
            depth_pu,
            rate_fps: record.rate_fps,
            usable_share: record.usable_share(),
            screening: screening.map(ScreeningV1::from),
        }
    }
}

/// The middle value, the lower of the two for an even count; NaN of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let middle = values.len().saturating_sub(1) / 2;
    values.get(middle).copied().unwrap_or(f64::NAN)
}

impl From<&Screening> for ScreeningV1 {
    fn from(screening: &Screening) -> Self {
        let counterparts = |reasons: &[ScreeningReason]| reasons.iter().map(Into::into).collect();
        Self {
            usable: screening.usable(),
            refusals: counterparts(&screening.refusals),
            marks: counterparts(&screening.marks),
        }
    }
}

impl From<ScreeningV1> for Screening {
    fn from(screening: ScreeningV1) -> Self {
        let reasons = |reasons: Vec<ReasonV1>| reasons.into_iter().map(Into::into).collect();
        Self {
            refusals: reasons(screening.refusals),
            marks: reasons(screening.marks),
        }
    }
}

impl From<&ScreeningReason> for ReasonV1 {
    fn from(reason: &ScreeningReason) -> Self {
        match reason.clone() {
            ScreeningReason::TooShallow {
                change_pu,
                required_pu,
            } => Self::TooShallow {
                change_pu,
                required_pu,
            },
            ScreeningReason::TooManyBadSamples {
                usable_share,
                required_share,
            } => Self::TooManyBadSamples {
                usable_share,
                required_share,
            },
            ScreeningReason::BadSamples {
                bad_share,
                at_onset,
            } => Self::BadSamples {
                bad_share,
                at_onset,
            },
            ScreeningReason::ClockNotSynchronised { share } => Self::ClockNotSynchronised { share },
            ScreeningReason::PreEventTooShort {
                seconds,
                required_s,
            } => Self::PreEventTooShort {
                seconds,
                required_s,
            },
            ScreeningReason::PreEventNotSteady { voltage_range_pu } => {
                Self::PreEventNotSteady { voltage_range_pu }
            }
            ScreeningReason::Unbalanced { ratio, limit } => Self::Unbalanced { ratio, limit },
            ScreeningReason::NotALoad {
                lowest_active_pu,
                highest_active_pu,
            } => Self::NotALoad {
                lowest_active_pu,
                highest_active_pu,
            },
            ScreeningReason::PowerDoesNotFollowVoltage { explained_share } => {
                Self::PowerDoesNotFollowVoltage { explained_share }
            }
            ScreeningReason::NoPower { active_pu } => Self::NoPower { active_pu },
            ScreeningReason::NoVoltage { voltage_pu } => Self::NoVoltage { voltage_pu },
        }
    }
}

impl From<ReasonV1> for ScreeningReason {
    fn from(reason: ReasonV1) -> Self {
        match reason {
            ReasonV1::TooShallow {
                change_pu,
                required_pu,
            } => Self::TooShallow {
                change_pu,
                required_pu,
            },
            ReasonV1::TooManyBadSamples {
                usable_share,
                required_share,
            } => Self::TooManyBadSamples {
                usable_share,
                required_share,
            },
            ReasonV1::BadSamples {
                bad_share,
                at_onset,
            } => Self::BadSamples {
                bad_share,
                at_onset,
            },
            ReasonV1::ClockNotSynchronised { share } => Self::ClockNotSynchronised { share },
            ReasonV1::PreEventTooShort {
                seconds,
                required_s,
            } => Self::PreEventTooShort {
                seconds,
                required_s,
            },
            ReasonV1::PreEventNotSteady { voltage_range_pu } => {
                Self::PreEventNotSteady { voltage_range_pu }
            }
            ReasonV1::Unbalanced { ratio, limit } => Self::Unbalanced { ratio, limit },
            ReasonV1::NotALoad {
                lowest_active_pu,
                highest_active_pu,
            } => Self::NotALoad {
                lowest_active_pu,
                highest_active_pu,
            },
            ReasonV1::PowerDoesNotFollowVoltage { explained_share } => {
                Self::PowerDoesNotFollowVoltage { explained_share }
            }
            ReasonV1::NoPower { active_pu } => Self::NoPower { active_pu },
            ReasonV1::NoVoltage { voltage_pu } => Self::NoVoltage { voltage_pu },
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use crate::adapters::wire::v1::examples;

    #[test]
    fn a_summary_says_when_how_deep_and_what_screening_thinks() {
        let window = examples::window("site-01 2026-02-12T05:11:00Z");
        let screening = examples::screening();
        let document = encode_event_summary(&window, Some(&screening)).unwrap();
        let value: Value = serde_json::from_str(&document).unwrap();
        assert_eq!(value["onset_utc"], "2026-02-12T05:11:00.5Z");
        assert_eq!(value["triggers"][0], "voltage_dip");
        assert_eq!(value["closing"], "recovered");
        assert_eq!(value["pre_event_s"], 0.5);
        assert_eq!(value["lowest_voltage_pu"], 0.75);
        assert_eq!(value["depth_pu"], 0.25);
        assert_eq!(value["screening"]["usable"], false);
        assert_eq!(value["screening"]["refusals"][0]["reason"], "not_a_load");
        assert_eq!(value["screening"]["refusals"][0]["lowest_active_pu"], -0.5);
    }

    #[test]
    fn screening_comes_back_from_its_document() {
        let screening = examples::screening();
        let document = serde_json::to_string(&ScreeningV1::from(&screening)).unwrap();
        let back: ScreeningV1 = serde_json::from_str(&document).unwrap();
        assert_eq!(Screening::from(back), screening);
    }

    #[test]
    fn a_window_without_a_usable_sample_has_a_summary() {
        let mut window = examples::window("empty");
        window.record.samples.clear();
        window.onset = 7;
        let value = serde_json::to_value(EventSummaryV1::new(&window, None)).unwrap();
        assert_eq!(value["lowest_voltage_pu"], Value::Null);
        assert_eq!(value["screening"], Value::Null);
    }
}
