//! Rounds of diagnosis and addition: the document of `improve --json` (design, section 11).

use serde::{Deserialize, Serialize};

use super::{
    DiagnosisV1, ErrorSummaryV1, ParameterSetV1, ParameterV1, StructureErrorsV1, VERSION,
    json::{nullable, ordered},
};
use crate::{
    adapters::wire::DocumentError,
    diagnosis::{Improvement, ImprovementStep},
};

/// Counterpart of [`Improvement`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImprovementV1 {
    /// Version of this format: 1.
    pub v: u64,
    /// Site.
    pub site: String,
    /// The staircase, the structure at the start first.
    pub steps: Vec<ImprovementStepV1>,
    /// Where it ended.
    #[serde(rename = "final")]
    pub end: ImprovementEndV1,
    /// The diagnosis of each round, the last structure's last; a step that exchanged one effect for another is
    /// judged in none.
    pub diagnoses: Vec<DiagnosisV1>,
}

/// Counterpart of [`ImprovementStep`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImprovementStepV1 {
    /// Structure fitted in this step.
    pub structure: Vec<String>,
    /// The effect that this step added; null for the first step and for one that only dropped.
    pub added: Option<String>,
    /// Effects that this step dropped: superfluous, or the added one took their place.
    pub dropped: Vec<String>,
    /// Why.
    pub reason: String,
    /// Errors on the fitted events.
    pub fit: ErrorSummaryV1,
    /// Errors on the events of the gate.
    pub held_out: Option<ErrorSummaryV1>,
    /// Errors on the untouched events.
    pub untouched: Option<ErrorSummaryV1>,
    /// Error over noise to quote: on the untouched events, else held out, else fitted.
    #[serde(with = "nullable")]
    pub error_to_noise: f64,
    /// Number of free parameters.
    pub parameter_count: usize,
    /// As [`ImprovementStep::delta_bic`].
    #[serde(with = "nullable")]
    pub delta_bic: f64,
}

/// The last structure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ImprovementEndV1 {
    /// Status of the last diagnosis.
    pub status: String,
    /// The last diagnosis in one sentence.
    pub summary: String,
    /// The structure.
    pub structure: Vec<String>,
    /// Its parameters by name.
    #[serde(with = "ordered")]
    pub parameters: Vec<(String, ParameterV1)>,
    /// The whole set, validated, with version 0; null without a step.
    pub set: Option<ParameterSetV1>,
}

impl ImprovementV1 {
    /// The counterpart of `improvement`.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`]; no improvement is known that causes it.
    pub fn new(improvement: &Improvement) -> Result<Self, DocumentError> {
        let rounds = improvement.diagnoses.iter().chain([&improvement.last]);
        Ok(Self {
            v: VERSION,
            site: improvement.site.clone(),
            steps: improvement
                .steps
                .iter()
                .map(ImprovementStepV1::from)
                .collect(),
            end: ImprovementEndV1::new(improvement)?,
            diagnoses: rounds.map(|d| DiagnosisV1::new(d, 0)).collect(),
        })
    }

    /// As compact JSON.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`]; no improvement is known that causes it.
    pub fn to_json(&self) -> Result<String, DocumentError> {
        serde_json::to_string(self).map_err(|source| DocumentError::Malformed {
            document: "improvement",
            source,
        })
    }
}

impl ImprovementEndV1 {
    fn new(improvement: &Improvement) -> Result<Self, DocumentError> {
        let last = improvement.steps.last();
        let set = last
            .map(|step| ParameterSetV1::new(&step.set))
            .transpose()?;
        let structure = last.map_or(&improvement.last.structure, |step| &step.structure);
        Ok(Self {
            status: improvement.last.status.name().to_owned(),
            summary: improvement.last.summary.clone(),
            structure: structure.clone(),
            parameters: set
                .as_ref()
                .map_or_else(Vec::new, |set| set.parameters.clone()),
            set,
        })
    }
}

impl From<&ImprovementStep> for ImprovementStepV1 {
    fn from(step: &ImprovementStep) -> Self {
        let StructureErrorsV1 {
            fit,
            held_out,
            untouched,
        } = (&step.errors).into();
        Self {
            structure: step.structure.clone(),
            added: step.added.clone(),
            dropped: step.dropped.clone(),
            reason: step.reason.clone(),
            fit,
            held_out,
            untouched,
            error_to_noise: step.errors.quoted().error_to_noise,
            parameter_count: step.parameter_count,
            delta_bic: step.delta_bic,
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use crate::adapters::wire::v1::examples;

    #[test]
    fn the_fields_fixed_by_the_design_are_there() {
        let document = ImprovementV1::new(&examples::improvement()).unwrap();
        let value: Value = serde_json::from_str(&document.to_json().unwrap()).unwrap();
        for pointer in [
            "/steps/0/structure",
            "/steps/1/added",
            "/steps/1/fit/eps_p_percent",
            "/steps/1/held_out/eps_p_percent",
            "/steps/1/untouched",
            "/steps/1/error_to_noise",
            "/final/status",
            "/final/structure",
            "/final/parameters/M/value",
        ] {
            assert!(value.pointer(pointer).is_some(), "{pointer}");
        }
        assert_eq!(value["steps"][0]["added"], Value::Null);
        assert_eq!(value["diagnoses"].as_array().unwrap().len(), 2);
        assert_eq!(value["final"]["status"], "adequate");
        let text = document.to_json().unwrap();
        let back: ImprovementV1 = serde_json::from_str(&text).unwrap();
        assert_eq!(back.to_json().unwrap(), text);
    }
}
