//! Parameter sets as they are published, exported and stored (design, sections 6 and 11).

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::{
    ErrorSummaryV1, VERSION, VerdictV1,
    json::{nullable, ordered},
};
use crate::{
    adapters::wire::{DocumentError, content_hash},
    identification::{Bases, OperatingPoint, ParameterEstimate, ParameterSet, VerdictStatus},
};

const DOCUMENT: &str = "parameter set";

/// Fields that the content hash does not cover: itself, and the number the content is given when it
/// is published. The same content has the same hash under any number, which is how the service
/// knows that it has published it already.
const NOT_HASHED: [&str; 2] = ["version", "content_hash"];

/// Counterpart of [`ParameterSet`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterSetV1 {
    /// Version of this format: 1.
    pub v: u64,
    /// Site.
    pub site: String,
    /// Version of the set, counted per site from 1; 0 for one that has not been published.
    pub version: u64,
    /// SHA-256, in hexadecimal, of the document without `version` and `content_hash` in the
    /// canonical form of RFC 8785.
    pub content_hash: String,
    /// Whether validation on held-out events was passed.
    pub validated: bool,
    /// Names of the parts of the model.
    pub structure: Vec<String>,
    /// Version of each part's equations.
    pub structure_versions: Vec<u32>,
    /// The parameters by name, in the order of the set.
    #[serde(with = "ordered")]
    pub parameters: Vec<(String, ParameterV1)>,
    /// Quantities computed from them, by name.
    #[serde(with = "ordered")]
    pub derived: Vec<(String, ParameterV1)>,
    /// Base values.
    pub bases: BasesV1,
    /// Operating point.
    pub operating_point: OperatingPointV1,
    /// Events the set was fitted on.
    pub fitted_events: Vec<String>,
    /// Events held out.
    pub held_out_events: Vec<String>,
    /// Errors on the fitted events.
    pub fit: ErrorSummaryV1,
    /// Errors on the held-out events.
    pub held_out: Option<ErrorSummaryV1>,
    /// Residual over noise floor over the event parts of the fitted events (as in `fit`).
    #[serde(with = "nullable")]
    pub error_to_noise: f64,
    /// Verdict.
    pub verdict: VerdictV1,
    /// Rank of the sensitivity matrix.
    pub rank: usize,
    /// Its condition number; null when it is infinite.
    #[serde(with = "nullable")]
    pub condition: f64,
    /// Standard error of each coordinate over that of independent samples and a right model; absent
    /// where none was taken into account.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub inflation: Vec<f64>,
    /// What a reader should know of single values; absent when there is nothing.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Version of the program that made the set.
    pub software_version: String,
}

/// Counterpart of [`ParameterEstimate`], whose name is its key.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterV1 {
    /// Value in `unit`.
    #[serde(with = "nullable")]
    pub value: f64,
    /// Unit, `1` when dimensionless.
    pub unit: String,
    /// Standard error in `unit`; null where the data do not determine the parameter.
    pub standard_error: Option<f64>,
    /// Whether the estimate lies on a bound.
    pub at_bound: bool,
    /// Whether the data determine this parameter by itself.
    pub identifiable: bool,
    /// Lower bound of the search; null when there is none.
    #[serde(with = "nullable")]
    pub lower: f64,
    /// Upper bound of the search; null when there is none.
    #[serde(with = "nullable")]
    pub upper: f64,
    /// What it is, in words.
    pub meaning: String,
    /// Lowest and highest value that describe the data as well, where not identifiable.
    pub interval: Option<[Option<f64>; 2]>,
}

/// Counterpart of [`Bases`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct BasesV1 {
    /// Power base, MVA.
    #[serde(with = "nullable")]
    pub s_base_mva: f64,
    /// Voltage base, line to line, kV.
    #[serde(with = "nullable")]
    pub v_base_kv: f64,
    /// Nominal frequency, Hz.
    #[serde(with = "nullable")]
    pub nominal_hz: f64,
}

/// Counterpart of [`OperatingPoint`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OperatingPointV1 {
    /// Pre-event voltage, pu.
    #[serde(with = "nullable")]
    pub v0_pu: f64,
    /// Pre-event active power, pu.
    #[serde(with = "nullable")]
    pub p0_pu: f64,
    /// Pre-event reactive power, pu.
    #[serde(with = "nullable")]
    pub q0_pu: f64,
}

/// Writes a set as compact JSON. Numbers that are not finite become null.
///
/// # Errors
///
/// [`DocumentError::Malformed`]; no set of the domain is known that causes it.
pub fn encode_parameter_set(set: &ParameterSet) -> Result<String, DocumentError> {
    serde_json::to_string(&ParameterSetV1::new(set)?).map_err(malformed)
}

/// Reads a set that was written by [`encode_parameter_set`] and checks its content hash. A number
/// that was not finite comes back as NaN.
///
/// # Errors
///
/// [`DocumentError`].
pub fn decode_parameter_set(document: &str) -> Result<ParameterSet, DocumentError> {
    decode_without(document, &[])
}

/// The same of a document that holds a set's fields and, all of them or none, `others` beside them.
pub(super) fn decode_without(
    document: &str,
    others: &[&str],
) -> Result<ParameterSet, DocumentError> {
    let mut value: Value = serde_json::from_str(document).map_err(malformed)?;
    if let Some(fields) = value.as_object_mut()
        && others.iter().all(|other| fields.contains_key(*other))
    {
        fields.retain(|field, _| !others.contains(&field.as_str()));
    }
    if let Some(found) = value.get("v").and_then(Value::as_u64)
        && found != VERSION
    {
        return Err(DocumentError::UnknownVersion {
            document: DOCUMENT,
            found,
            known: VERSION,
        });
    }
    let computed = hash_of_content(&value);
    let set: ParameterSetV1 = serde_json::from_value(value).map_err(malformed)?;
    if set.content_hash != computed {
        return Err(DocumentError::HashDiffers {
            document: DOCUMENT,
            stated: set.content_hash,
            computed,
        });
    }
    set.try_into()
}

impl ParameterSetV1 {
    /// The counterpart of `set`, with its content hash.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`]; no set of the domain is known that causes it.
    pub fn new(set: &ParameterSet) -> Result<Self, DocumentError> {
        let mut document = Self::without_hash(set);
        let value = serde_json::to_value(&document).map_err(malformed)?;
        document.content_hash = hash_of_content(&value);
        Ok(document)
    }

    fn without_hash(set: &ParameterSet) -> Self {
        let named = |estimates: &[ParameterEstimate]| {
            estimates
                .iter()
                .map(|estimate| (estimate.name.clone(), ParameterV1::from(estimate)))
                .collect()
        };
        Self {
            v: VERSION,
            site: set.site.clone(),
            version: set.version,
            content_hash: String::new(),
            validated: set.verdict.status == VerdictStatus::Pass,
            structure: set.structure.clone(),
            structure_versions: set.structure_versions.clone(),
            parameters: named(&set.parameters),
            derived: named(&set.derived),
            bases: set.bases.into(),
            operating_point: set.operating_point.into(),
            fitted_events: set.fitted_events.clone(),
            held_out_events: set.held_out_events.clone(),
            fit: (&set.fit).into(),
            held_out: set.held_out.as_ref().map(ErrorSummaryV1::from),
            error_to_noise: set.fit.error_to_noise,
            verdict: (&set.verdict).into(),
            rank: set.rank,
            condition: set.condition,
            inflation: set.inflation.clone(),
            notes: set.notes.clone(),
            software_version: set.software_version.clone(),
        }
    }
}

impl TryFrom<ParameterSetV1> for ParameterSet {
    type Error = DocumentError;

    fn try_from(set: ParameterSetV1) -> Result<Self, DocumentError> {
        let estimates = |named: Vec<(String, ParameterV1)>| {
            named
                .into_iter()
                .map(|(name, parameter)| parameter.named(name))
                .collect()
        };
        Ok(Self {
            site: set.site,
            version: set.version,
            structure: set.structure,
            structure_versions: set.structure_versions,
            parameters: estimates(set.parameters),
            derived: estimates(set.derived),
            bases: set.bases.into(),
            operating_point: set.operating_point.into(),
            fitted_events: set.fitted_events,
            held_out_events: set.held_out_events,
            fit: set.fit.into(),
            held_out: set.held_out.map(Into::into),
            verdict: set.verdict.try_into()?,
            rank: set.rank,
            condition: set.condition,
            inflation: set.inflation,
            notes: set.notes,
            software_version: set.software_version,
        })
    }
}

impl From<&ParameterEstimate> for ParameterV1 {
    fn from(estimate: &ParameterEstimate) -> Self {
        let finite = |value: f64| value.is_finite().then_some(value);
        Self {
            value: estimate.value,
            unit: estimate.unit.clone(),
            standard_error: estimate.standard_error.and_then(finite),
            at_bound: estimate.at_bound,
            identifiable: estimate.identifiable,
            lower: estimate.lower,
            upper: estimate.upper,
            meaning: estimate.meaning.clone(),
            interval: estimate
                .interval
                .map(|(low, high)| [finite(low), finite(high)]),
        }
    }
}

impl ParameterV1 {
    fn named(self, name: String) -> ParameterEstimate {
        let number = |value: Option<f64>| value.unwrap_or(f64::NAN);
        ParameterEstimate {
            name,
            meaning: self.meaning,
            value: self.value,
            unit: self.unit,
            lower: self.lower,
            upper: self.upper,
            standard_error: self.standard_error,
            at_bound: self.at_bound,
            identifiable: self.identifiable,
            interval: self.interval.map(|[low, high]| (number(low), number(high))),
        }
    }
}

impl From<Bases> for BasesV1 {
    fn from(bases: Bases) -> Self {
        Self {
            s_base_mva: bases.s_base_mva,
            v_base_kv: bases.v_base_kv,
            nominal_hz: bases.nominal_hz,
        }
    }
}

impl From<BasesV1> for Bases {
    fn from(bases: BasesV1) -> Self {
        Self {
            s_base_mva: bases.s_base_mva,
            v_base_kv: bases.v_base_kv,
            nominal_hz: bases.nominal_hz,
        }
    }
}

impl From<OperatingPoint> for OperatingPointV1 {
    fn from(point: OperatingPoint) -> Self {
        Self {
            v0_pu: point.v0_pu,
            p0_pu: point.p0_pu,
            q0_pu: point.q0_pu,
        }
    }
}

impl From<OperatingPointV1> for OperatingPoint {
    fn from(point: OperatingPointV1) -> Self {
        Self {
            v0_pu: point.v0_pu,
            p0_pu: point.p0_pu,
            q0_pu: point.q0_pu,
        }
    }
}

fn hash_of_content(document: &Value) -> String {
    let mut content = document.clone();
    if let Some(fields) = content.as_object_mut() {
        fields.retain(|field, _| !NOT_HASHED.contains(&field.as_str()));
    }
    content_hash(&content)
}

fn malformed(source: serde_json::Error) -> DocumentError {
    DocumentError::Malformed {
        document: DOCUMENT,
        source,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::wire::v1::examples;

    #[test]
    fn a_set_comes_back_bit_by_bit() {
        let set = examples::parameter_set();
        let document = encode_parameter_set(&set).unwrap();
        let back = decode_parameter_set(&document).unwrap();
        assert_eq!(back, set);
        assert_eq!(encode_parameter_set(&back).unwrap(), document);
    }

    #[test]
    fn the_fields_fixed_by_the_design_are_there_in_order() {
        let document = encode_parameter_set(&examples::parameter_set()).unwrap();
        let value: Value = serde_json::from_str(&document).unwrap();
        let names: Vec<_> = value["parameters"].as_object().unwrap().keys().collect();
        assert_eq!(names, ["X", "M"], "the set's order, not the alphabet's");
        let parameter = value["parameters"]["M"].as_object().unwrap();
        for field in [
            "value",
            "unit",
            "standard_error",
            "at_bound",
            "identifiable",
        ] {
            assert!(parameter.contains_key(field), "{field}");
        }
        for pointer in [
            "/structure/0",
            "/fit/eps_p_percent",
            "/fit/events/0/event_eps_q_percent",
            "/held_out/events/0/skill_q",
            "/error_to_noise",
            "/verdict/reasons/0",
        ] {
            assert!(value.pointer(pointer).is_some(), "{pointer}");
        }
        assert_eq!(value["verdict"]["status"], "pass");
        assert_eq!(value["v"], 1);
    }

    #[test]
    fn numbers_that_are_not_finite_become_null_and_come_back_as_nan() {
        let mut set = examples::parameter_set();
        set.condition = f64::INFINITY;
        set.parameters[0].value = f64::NAN;
        set.parameters[0].standard_error = Some(f64::NAN);
        let document = encode_parameter_set(&set).unwrap();
        assert!(document.contains("\"condition\":null"));
        let back = decode_parameter_set(&document).unwrap();
        assert!(back.condition.is_nan() && back.parameters[0].value.is_nan());
        assert_eq!(back.parameters[0].standard_error, None);
    }

    #[test]
    fn inflation_and_notes_are_written_only_where_there_are_some() {
        let plain = examples::parameter_set();
        let document = encode_parameter_set(&plain).unwrap();
        assert!(!document.contains("inflation") && !document.contains("notes"));
        let told = ParameterSet {
            inflation: vec![1.5, 2.0, 1.25, 1.0, 1.0, 1.0, 1.0, 1.0],
            notes: vec!["slip 0.090 is outside the ordinary range 0.002 to 0.08".to_owned()],
            ..plain
        };
        let document = encode_parameter_set(&told).unwrap();
        assert_eq!(decode_parameter_set(&document).unwrap(), told);
    }

    #[test]
    fn the_hash_covers_the_content_and_not_the_version() {
        let set = examples::parameter_set();
        let hash = |set: &ParameterSet| ParameterSetV1::new(set).unwrap().content_hash;
        let renumbered = ParameterSet {
            version: 17,
            ..set.clone()
        };
        assert_eq!(hash(&renumbered), hash(&set));
        let mut changed = set.clone();
        // One unit in the last place.
        changed.parameters[0].value = f64::from_bits(set.parameters[0].value.to_bits() + 1);
        assert_ne!(hash(&changed), hash(&set));
    }

    #[test]
    fn a_changed_document_is_refused() {
        let document = encode_parameter_set(&examples::parameter_set()).unwrap();
        let changed = document.replace("\"rank\":5", "\"rank\":6");
        assert!(matches!(
            decode_parameter_set(&changed),
            Err(DocumentError::HashDiffers { .. })
        ));
        let extended = document.replacen('{', "{\"note\":\"x\",", 1);
        assert!(matches!(
            decode_parameter_set(&extended),
            Err(DocumentError::HashDiffers { .. })
        ));
        let newer = document.replacen("\"v\":1", "\"v\":2", 1);
        assert!(matches!(
            decode_parameter_set(&newer),
            Err(DocumentError::UnknownVersion { found: 2, .. })
        ));
        assert!(matches!(
            decode_parameter_set("{}"),
            Err(DocumentError::Malformed { .. })
        ));
    }
}
