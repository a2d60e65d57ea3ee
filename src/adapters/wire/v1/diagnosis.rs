//! Diagnoses as they are published, stored and printed by `diagnose --json` (design, section 11).

use serde::{Deserialize, Serialize};

use super::{
    ErrorSummaryV1, ParameterV1, VERSION,
    failures::{EventFailureV1, SegmentResidualV1},
    identification::RefusedV1,
    json::{nullable, ordered},
};
use crate::{
    adapters::wire::DocumentError,
    diagnosis::{
        Candidate, Diagnosis, DiagnosisCost, EffectWorth, EventSets, GeneralForm, SeparatingEvent,
        StructureErrors, Unexplained, UnexplainedTerm, Untestable, misfit_root_floor,
    },
    identification::FittedStructure,
    load_model::effect::Kind,
};

const DOCUMENT: &str = "diagnosis";

/// Counterpart of [`Diagnosis`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisV1 {
    /// Version of this format: 1.
    pub v: u64,
    /// Site.
    pub site: String,
    /// Number of the diagnosis, counted per site from 1; 0 for one that no service has stored.
    pub version: u64,
    /// The structure judged.
    pub structure: Vec<String>,
    /// `adequate`, `missing_effect`, `instrument_suspect`, `unknown_effect` or `cannot_judge`.
    pub status: String,
    /// The answer in one sentence.
    pub summary: String,
    /// Each reason with its figure.
    pub reasons: Vec<String>,
    /// The declared effect and those not separable from it, best first; empty when none is.
    pub answer_set: Vec<String>,
    /// Events by use.
    pub events: EventSetsV1,
    /// Errors of the structure judged.
    pub baseline: StructureErrorsV1,
    /// Error over noise to quote: on the untouched events, else held out, else fitted.
    #[serde(with = "nullable")]
    pub error_to_noise: f64,
    /// Error over noise that a perfect model would have.
    #[serde(with = "nullable")]
    pub noise_floor: f64,
    /// What a perfect model leaves of `failures[].error_to_noise` and of the candidates'
    /// `held_out_error_before` and `_after`, which are roots of the misfit per sample.
    #[serde(default = "misfit_root_floor")]
    pub misfit_root_floor: f64,
    /// Residuals by segment and channel, all events together.
    pub segments: Vec<SegmentResidualV1>,
    /// Where it fails, event by event.
    pub failures: Vec<EventFailureV1>,
    /// What the effects that the structure has already are worth; absent in documents of earlier
    /// programs.
    #[serde(default)]
    pub effects: Vec<EffectWorthV1>,
    /// Candidates, best first.
    pub candidates: Vec<CandidateV1>,
    /// Effects on which these events are silent.
    pub untestable: Vec<UntestableV1>,
    /// What no effect of the catalogue explains; null where nothing is left.
    pub unexplained: Option<UnexplainedV1>,
    /// The fit of the structure judged; null where nothing could be judged, absent in documents of
    /// earlier programs.
    #[serde(default)]
    pub model: Option<FittedStructureV1>,
    /// What it cost.
    pub cost: DiagnosisCostV1,
    /// Version of the program that made the diagnosis.
    pub software_version: String,
}

/// Counterpart of [`EventSets`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct EventSetsV1 {
    /// Fitted.
    pub fit: Vec<String>,
    /// Held out to decide whether an effect may be declared.
    pub gate: Vec<String>,
    /// In neither: the error to quote comes from these.
    pub untouched: Vec<String>,
    /// Not used, with the reason.
    pub refused: Vec<RefusedV1>,
}

/// Counterpart of [`StructureErrors`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StructureErrorsV1 {
    /// On the fitted events.
    pub fit: ErrorSummaryV1,
    /// On the events of the gate.
    pub held_out: Option<ErrorSummaryV1>,
    /// On the untouched events.
    pub untouched: Option<ErrorSummaryV1>,
}

/// Counterpart of [`SeparatingEvent`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeparatingEventV1 {
    /// The effect that it tells from the candidate.
    pub from: String,
    /// The disturbance, in words.
    pub disturbance: String,
    /// By how much the weighted squares of the wrong effect would rise.
    pub squares: f64,
    /// What is enough for an answer.
    pub needed: f64,
    /// How many of them would be enough.
    pub events: u32,
    /// Where the two differ most: `P` or `Q`, ...
    pub channel: String,
    /// ... so long after `since`, s, ...
    pub time_s: f64,
    /// ... by so much of P0.
    pub difference: f64,
    /// What the time counts from, in words.
    pub since: String,
    /// Where one of the two can follow what the other foretells, whether that is the candidate.
    pub follows: Option<bool>,
}

/// Counterpart of [`Candidate`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CandidateV1 {
    /// Its name in the catalogue.
    pub effect: String,
    /// `physics` or `instrument`.
    pub kind: String,
    /// As [`Candidate::score_share`].
    #[serde(with = "nullable")]
    pub score_share: f64,
    /// As [`Candidate::visibility`].
    #[serde(with = "nullable")]
    pub visibility: f64,
    /// As [`Candidate::delta_bic`].
    pub delta_bic: Option<f64>,
    /// As [`Candidate::held_out_error_before`].
    pub held_out_error_before: Option<f64>,
    /// As [`Candidate::held_out_error_after`].
    pub held_out_error_after: Option<f64>,
    /// As [`Candidate::share_of_best_gain`].
    pub share_of_best_gain: Option<f64>,
    /// Effects, this one included, that these events do not separate from it.
    pub group: Vec<String>,
    /// What would separate it from the first of the group, the first from the others; empty when it is alone.
    pub would_separate: String,
    /// The ordinary disturbances that would; absent in documents of earlier programs.
    #[serde(default)]
    pub separating_events: Vec<SeparatingEventV1>,
    /// Its parameters after the refit, by name.
    #[serde(with = "ordered")]
    pub parameters: Vec<(String, ParameterV1)>,
    /// The refit as a whole; null without one, absent in documents of earlier programs.
    #[serde(default)]
    pub model: Option<FittedStructureV1>,
    /// Whether it passed every test of a declaration.
    pub declared: bool,
    /// Why it is not declared, with the figure; empty when it is.
    pub refused: Vec<String>,
}

/// Counterpart of [`FittedStructure`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FittedStructureV1 {
    /// The parts.
    pub structure: Vec<String>,
    /// Every parameter of the model by its name, as the model declares it.
    #[serde(with = "ordered")]
    pub values: Vec<(String, f64)>,
}

/// Counterpart of [`EffectWorth`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EffectWorthV1 {
    /// Its name.
    pub effect: String,
    /// As [`EffectWorth::delta_bic_without`].
    #[serde(with = "nullable")]
    pub delta_bic_without: f64,
    /// As [`EffectWorth::untouched_without`].
    pub untouched_without: Option<f64>,
    /// Whether the events are described less well without it.
    pub needed: bool,
}

/// Counterpart of [`Untestable`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UntestableV1 {
    /// Its name in the catalogue.
    pub effect: String,
    /// As [`Untestable::smallest_detectable_amplitude`]; null where no amplitude would have shown.
    #[serde(with = "nullable")]
    pub smallest_detectable_amplitude: f64,
    /// As [`Untestable::meaningful_amplitude`].
    #[serde(with = "nullable")]
    pub meaningful_amplitude: f64,
    /// Name of the amplitude.
    pub amplitude: String,
    /// Its unit.
    pub unit: String,
    /// What events would test it.
    pub needs: String,
}

/// Counterpart of [`Unexplained`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnexplainedV1 {
    /// What the residual looks like, in a sentence.
    pub signature: String,
    /// A sparse description, most important term first.
    pub terms: Vec<UnexplainedTermV1>,
    /// A ready effect file that adds these terms; null where no term explains much.
    pub effect_file: Option<String>,
    /// The general form that explains most; null where none explains more than the catalogue, absent in documents of
    /// earlier programs.
    #[serde(default)]
    pub general_form: Option<GeneralFormV1>,
}

/// Counterpart of [`GeneralForm`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GeneralFormV1 {
    /// Its name, with which it can be added to a structure.
    pub name: String,
    /// What it does, in words.
    pub title: String,
    /// Weighted squares per sample without it.
    pub misfit_before: f64,
    /// The same with it.
    pub misfit_after: f64,
    /// Change of the Bayesian information criterion by it.
    pub delta_bic: f64,
    /// Error over noise on the gate's events without it; null without a gate.
    pub held_out_error_before: Option<f64>,
    /// The same with it.
    pub held_out_error_after: Option<f64>,
    /// Its parameters after the fit, by name.
    #[serde(with = "ordered")]
    pub parameters: Vec<(String, ParameterV1)>,
    /// The fit as a whole.
    pub model: FittedStructureV1,
    /// It as an effect file with the fitted values.
    pub effect_file: String,
}

/// Counterpart of [`UnexplainedTerm`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct UnexplainedTermV1 {
    /// The term as a formula, in the variables of effects written in files.
    pub formula: String,
    /// `P` or `Q`.
    pub channel: String,
    /// As [`UnexplainedTerm::coefficient`].
    #[serde(with = "nullable")]
    pub coefficient: f64,
    /// As [`UnexplainedTerm::share`].
    #[serde(with = "nullable")]
    pub share: f64,
}

/// Counterpart of [`DiagnosisCost`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DiagnosisCostV1 {
    /// Joint simulations of all events.
    pub simulations: u64,
    /// Effects refitted.
    pub refits: u64,
    /// Wall-clock seconds.
    #[serde(with = "nullable")]
    pub seconds: f64,
}

impl DiagnosisV1 {
    /// The counterpart of `diagnosis` under `version`: 0 for one that no service has stored.
    #[must_use]
    pub fn new(diagnosis: &Diagnosis, version: u64) -> Self {
        Self {
            v: VERSION,
            site: diagnosis.site.clone(),
            version,
            structure: diagnosis.structure.clone(),
            status: diagnosis.status.name().to_owned(),
            summary: diagnosis.summary.clone(),
            reasons: diagnosis.reasons.clone(),
            answer_set: diagnosis.answer_set.clone(),
            events: (&diagnosis.events).into(),
            baseline: (&diagnosis.baseline).into(),
            error_to_noise: diagnosis.baseline.quoted().error_to_noise,
            noise_floor: diagnosis.noise_floor,
            misfit_root_floor: misfit_root_floor(),
            segments: all(&diagnosis.segments),
            failures: all(&diagnosis.failures),
            effects: all(&diagnosis.effects),
            candidates: all(&diagnosis.candidates),
            untestable: all(&diagnosis.untestable),
            unexplained: diagnosis.unexplained.as_ref().map(UnexplainedV1::from),
            model: diagnosis.model.as_ref().map(FittedStructureV1::from),
            cost: diagnosis.cost.into(),
            software_version: env!("CARGO_PKG_VERSION").to_owned(),
        }
    }

    /// As compact JSON.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`]; no diagnosis is known that causes it.
    pub fn to_json(&self) -> Result<String, DocumentError> {
        serde_json::to_string(self).map_err(malformed)
    }

    /// Reads what [`DiagnosisV1::to_json`] wrote. A number that was not finite comes back as NaN.
    ///
    /// # Errors
    ///
    /// [`DocumentError::Malformed`] or [`DocumentError::UnknownVersion`].
    pub fn from_json(document: &str) -> Result<Self, DocumentError> {
        let read: Self = serde_json::from_str(document).map_err(malformed)?;
        if read.v != VERSION {
            return Err(DocumentError::UnknownVersion {
                document: DOCUMENT,
                found: read.v,
                known: VERSION,
            });
        }
        Ok(read)
    }
}

/// The counterparts of several things.
pub(super) fn all<'a, T, V: From<&'a T>>(things: &'a [T]) -> Vec<V> {
    things.iter().map(V::from).collect()
}

fn malformed(source: serde_json::Error) -> DocumentError {
    DocumentError::Malformed {
        document: DOCUMENT,
        source,
    }
}

impl From<&EventSets> for EventSetsV1 {
    fn from(sets: &EventSets) -> Self {
        let refused = sets.refused.iter().map(|(event, reason)| RefusedV1 {
            event: event.clone(),
            reason: reason.clone(),
        });
        Self {
            fit: sets.fit.clone(),
            gate: sets.gate.clone(),
            untouched: sets.untouched.clone(),
            refused: refused.collect(),
        }
    }
}

impl From<&StructureErrors> for StructureErrorsV1 {
    fn from(errors: &StructureErrors) -> Self {
        Self {
            fit: (&errors.fit).into(),
            held_out: errors.gate.as_ref().map(ErrorSummaryV1::from),
            untouched: errors.untouched.as_ref().map(ErrorSummaryV1::from),
        }
    }
}

impl From<&EffectWorth> for EffectWorthV1 {
    fn from(worth: &EffectWorth) -> Self {
        Self {
            effect: worth.effect.clone(),
            delta_bic_without: worth.delta_bic_without,
            untouched_without: worth.untouched_without,
            needed: !worth.is_superfluous,
        }
    }
}

impl From<&SeparatingEvent> for SeparatingEventV1 {
    fn from(event: &SeparatingEvent) -> Self {
        Self {
            from: event.from.clone(),
            disturbance: event.disturbance.clone(),
            squares: event.squares,
            needed: event.needed,
            events: event.events,
            channel: event.channel.name().to_owned(),
            time_s: event.time_s,
            difference: event.difference,
            since: event.since.to_owned(),
            follows: event.follows,
        }
    }
}

impl From<&Candidate> for CandidateV1 {
    fn from(candidate: &Candidate) -> Self {
        let parameters = candidate.parameters.iter();
        Self {
            effect: candidate.effect.clone(),
            kind: kind_name(candidate.kind).to_owned(),
            score_share: candidate.score_share,
            visibility: candidate.visibility,
            delta_bic: candidate.delta_bic,
            held_out_error_before: candidate.held_out_error_before,
            held_out_error_after: candidate.held_out_error_after,
            share_of_best_gain: candidate.share_of_best_gain,
            group: candidate.group.clone(),
            would_separate: candidate.would_separate.clone(),
            separating_events: candidate
                .separating_events
                .iter()
                .map(SeparatingEventV1::from)
                .collect(),
            parameters: parameters.map(|p| (p.name.clone(), p.into())).collect(),
            model: candidate.model.as_ref().map(FittedStructureV1::from),
            declared: candidate.declared,
            refused: candidate.refused.clone(),
        }
    }
}

impl From<&FittedStructure> for FittedStructureV1 {
    fn from(fitted: &FittedStructure) -> Self {
        Self {
            structure: fitted.structure.clone(),
            values: fitted.values.clone(),
        }
    }
}

impl From<&FittedStructureV1> for FittedStructure {
    fn from(fitted: &FittedStructureV1) -> Self {
        Self {
            structure: fitted.structure.clone(),
            values: fitted.values.clone(),
        }
    }
}

const fn kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::Physics => "physics",
        Kind::Instrument => "instrument",
    }
}

impl From<&Untestable> for UntestableV1 {
    fn from(untestable: &Untestable) -> Self {
        Self {
            effect: untestable.effect.clone(),
            smallest_detectable_amplitude: untestable.smallest_detectable_amplitude,
            meaningful_amplitude: untestable.meaningful_amplitude,
            amplitude: untestable.amplitude.clone(),
            unit: untestable.unit.clone(),
            needs: untestable.needs.clone(),
        }
    }
}

impl From<&Unexplained> for UnexplainedV1 {
    fn from(unexplained: &Unexplained) -> Self {
        Self {
            signature: unexplained.signature.clone(),
            terms: all(&unexplained.terms),
            effect_file: unexplained.effect_file.clone(),
            general_form: unexplained.general_form.as_ref().map(GeneralFormV1::from),
        }
    }
}

impl From<&GeneralForm> for GeneralFormV1 {
    fn from(form: &GeneralForm) -> Self {
        let parameters = form.parameters.iter();
        Self {
            name: form.name.clone(),
            title: form.title.clone(),
            misfit_before: form.misfit_before,
            misfit_after: form.misfit_after,
            delta_bic: form.delta_bic,
            held_out_error_before: form.held_out_error_before,
            held_out_error_after: form.held_out_error_after,
            parameters: parameters.map(|p| (p.name.clone(), p.into())).collect(),
            model: FittedStructureV1::from(&form.model),
            effect_file: form.effect_file.clone(),
        }
    }
}

impl From<&UnexplainedTerm> for UnexplainedTermV1 {
    fn from(term: &UnexplainedTerm) -> Self {
        Self {
            formula: term.formula.clone(),
            channel: term.channel.to_owned(),
            coefficient: term.coefficient,
            share: term.share,
        }
    }
}

impl From<DiagnosisCost> for DiagnosisCostV1 {
    fn from(cost: DiagnosisCost) -> Self {
        Self {
            simulations: cost.simulations,
            refits: cost.refits,
            seconds: cost.seconds,
        }
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;
    use crate::adapters::wire::v1::examples;

    #[test]
    fn a_document_comes_back_as_it_was_written() {
        let document = DiagnosisV1::new(&examples::diagnosis(), 3);
        let text = document.to_json().unwrap();
        let back = DiagnosisV1::from_json(&text).unwrap();
        assert_eq!(back.to_json().unwrap(), text);
        assert_eq!(back.version, 3);
        let newer = text.replacen("\"v\":1", "\"v\":2", 1);
        assert!(DiagnosisV1::from_json(&newer).is_err());
    }

    #[test]
    fn the_fields_fixed_by_the_design_are_there() {
        let document = DiagnosisV1::new(&examples::diagnosis(), 0);
        let value: Value = serde_json::from_str(&document.to_json().unwrap()).unwrap();
        for pointer in [
            "/status",
            "/baseline/fit/eps_p_percent",
            "/baseline/held_out/eps_q_percent",
            "/baseline/untouched",
            "/segments/0/segment",
            "/segments/0/channel",
            "/segments/0/rms_pu",
            "/segments/0/to_noise",
            "/candidates/0/effect",
            "/candidates/0/kind",
            "/candidates/0/score_share",
            "/candidates/0/delta_bic",
            "/candidates/0/held_out_error_before",
            "/candidates/0/held_out_error_after",
            "/candidates/0/group/0",
            "/candidates/0/would_separate",
            "/candidates/0/parameters/stator_resistance.r_s/value",
            "/cost/simulations",
        ] {
            assert!(value.pointer(pointer).is_some(), "{pointer}");
        }
        assert_eq!(value["status"], "missing_effect");
        assert_eq!(
            value["error_to_noise"], 1.25,
            "the gate's, nothing is untouched"
        );
    }

    #[test]
    fn what_is_not_finite_is_null() {
        let mut diagnosis = examples::diagnosis();
        diagnosis.untestable[0].smallest_detectable_amplitude = f64::INFINITY;
        diagnosis.failures[0].cross_correlations[0].correlation[0] = f64::NAN;
        let text = DiagnosisV1::new(&diagnosis, 0).to_json().unwrap();
        let back = DiagnosisV1::from_json(&text).unwrap();
        assert!(back.untestable[0].smallest_detectable_amplitude.is_nan());
        assert_eq!(back.failures[0].cross_correlations[0].correlation[0], None);
    }
}
