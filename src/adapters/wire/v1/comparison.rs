//! The document of `compare --json`: model against measurement, sample by sample.

use serde::Serialize;

use super::{ErrorSummaryV1, EventErrorsV1, ParameterSetV1, VERSION, VerdictV1, json::rfc3339};
use crate::{
    adapters::wire::DocumentError,
    identification::{Comparison, ErrorSummary, Judgement, ParameterSet},
};

/// All events of a comparison and the set they were compared with.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparisonsV1 {
    /// Version of this format: 1.
    pub v: u64,
    /// Site.
    pub site: String,
    /// The set.
    pub set: ParameterSetV1,
    /// What the set shows on these events.
    pub here: JudgementV1,
    /// Event by event.
    pub events: Vec<ComparisonV1>,
    /// Another set on the same events, where one was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<Box<Self>>,
}

/// Counterpart of [`Judgement`]. A summary is null where there is no such event.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JudgementV1 {
    /// Site of the events.
    pub site: String,
    /// As [`Judgement::fitted`].
    pub fitted: Option<ErrorSummaryV1>,
    /// As [`Judgement::held_out`].
    pub held_out: Option<ErrorSummaryV1>,
    /// As [`Judgement::others`].
    pub others: Option<ErrorSummaryV1>,
    /// The verdict on all events that the set was not fitted to; `set.verdict` is the one it was
    /// published with.
    pub verdict: VerdictV1,
    /// Why the set may not belong to these events.
    pub warnings: Vec<String>,
}

/// Counterpart of [`Comparison`]. A value that is missing is null.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ComparisonV1 {
    /// Event.
    pub event: String,
    /// Onset, RFC 3339.
    pub onset_utc: String,
    /// The errors.
    pub errors: EventErrorsV1,
    /// As [`Comparison::time_s`].
    pub time_s: Vec<f64>,
    /// As [`Comparison::voltage_pu`].
    pub voltage_pu: Vec<f64>,
    /// As [`Comparison::frequency_hz`].
    pub frequency_hz: Vec<f64>,
    /// As [`Comparison::active_measured_pu`].
    pub active_measured_pu: Vec<f64>,
    /// As [`Comparison::active_model_pu`].
    pub active_model_pu: Vec<f64>,
    /// As [`Comparison::reactive_measured_pu`].
    pub reactive_measured_pu: Vec<f64>,
    /// As [`Comparison::reactive_model_pu`].
    pub reactive_model_pu: Vec<f64>,
    /// As [`Comparison::active_noise_pu`].
    pub active_noise_pu: Vec<f64>,
    /// As [`Comparison::reactive_noise_pu`].
    pub reactive_noise_pu: Vec<f64>,
    /// As [`Comparison::used`].
    pub used: Vec<bool>,
    /// As [`Comparison::near_edge`].
    pub near_edge: Vec<bool>,
}

impl ComparisonsV1 {
    /// The counterpart of `comparisons` with `set`.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`]; no set of the domain is known that causes it.
    pub fn new(
        set: &ParameterSet,
        comparisons: &[Comparison],
        judgement: &Judgement,
    ) -> Result<Self, DocumentError> {
        Ok(Self {
            v: VERSION,
            site: set.site.clone(),
            set: ParameterSetV1::new(set)?,
            here: judgement.into(),
            events: comparisons.iter().map(ComparisonV1::from).collect(),
            against: None,
        })
    }
}

impl From<&Judgement> for JudgementV1 {
    fn from(judgement: &Judgement) -> Self {
        let summary = |of: &Option<ErrorSummary>| of.as_ref().map(ErrorSummaryV1::from);
        Self {
            site: judgement.site.clone(),
            fitted: summary(&judgement.fitted),
            held_out: summary(&judgement.held_out),
            others: summary(&judgement.others),
            verdict: (&judgement.verdict).into(),
            warnings: judgement.warnings.clone(),
        }
    }
}

impl From<&Comparison> for ComparisonV1 {
    fn from(comparison: &Comparison) -> Self {
        Self {
            event: comparison.event.clone(),
            onset_utc: rfc3339(comparison.onset_ns),
            errors: (&comparison.errors).into(),
            time_s: comparison.time_s.clone(),
            voltage_pu: comparison.voltage_pu.clone(),
            frequency_hz: comparison.frequency_hz.clone(),
            active_measured_pu: comparison.active_measured_pu.clone(),
            active_model_pu: comparison.active_model_pu.clone(),
            reactive_measured_pu: comparison.reactive_measured_pu.clone(),
            reactive_model_pu: comparison.reactive_model_pu.clone(),
            active_noise_pu: comparison.active_noise_pu.clone(),
            reactive_noise_pu: comparison.reactive_noise_pu.clone(),
            used: comparison.used.clone(),
            near_edge: comparison.near_edge.clone(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::wire::v1::examples;

    #[test]
    fn a_missing_value_becomes_null() {
        let comparison = examples::comparison();
        let (set, judgement) = (examples::parameter_set(), examples::judgement());
        let document = ComparisonsV1::new(&set, &[comparison], &judgement).unwrap();
        let value = serde_json::to_value(&document).unwrap();
        assert_eq!(value["events"][0]["voltage_pu"][1], serde_json::Value::Null);
        assert_eq!(value["events"][0]["active_model_pu"][1], 0.5);
        assert_eq!(value["set"]["site"], value["site"]);
    }
}
