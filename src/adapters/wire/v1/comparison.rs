//! The document of `compare --json`: model against measurement, sample by sample.

use serde::Serialize;

use super::{EventErrorsV1, ParameterSetV1, VERSION, json::rfc3339};
use crate::{
    adapters::wire::DocumentError,
    identification::{Comparison, ParameterSet},
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
    /// Event by event.
    pub events: Vec<ComparisonV1>,
    /// Another set on the same events, where one was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub against: Option<Box<Self>>,
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
    pub fn new(set: &ParameterSet, comparisons: &[Comparison]) -> Result<Self, DocumentError> {
        Ok(Self {
            v: VERSION,
            site: set.site.clone(),
            set: ParameterSetV1::new(set)?,
            events: comparisons.iter().map(ComparisonV1::from).collect(),
            against: None,
        })
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
        let document = ComparisonsV1::new(&examples::parameter_set(), &[comparison]).unwrap();
        let value = serde_json::to_value(&document).unwrap();
        assert_eq!(value["events"][0]["voltage_pu"][1], serde_json::Value::Null);
        assert_eq!(value["events"][0]["active_model_pu"][1], 0.5);
        assert_eq!(value["set"]["site"], value["site"]);
    }
}
