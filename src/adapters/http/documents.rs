//! JSON of what the store holds, as `/api/v1` answers it.

use serde::Serialize;

use crate::{
    adapters::{
        store::{
            Answer, DecisionRecord, JobKind, StoredDiagnosis, StoredFit, StoredSet,
            StructureRecord, WindowSummary,
        },
        wire::v1::{ScreeningV1, closing_name, rfc3339, trigger_name, verdict_status_name},
    },
    identification::Decision,
    measurement::Site,
};

/// A site.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SiteDocument {
    /// Name.
    pub site: String,
    /// Power base, MVA.
    pub s_base_mva: f64,
    /// Voltage base, kV.
    pub v_base_kv: f64,
    /// Nominal frequency, Hz.
    pub nominal_hz: f64,
}

/// An event.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EventDocument {
    /// Identifier.
    pub event: String,
    /// Site.
    pub site: String,
    /// Onset, RFC 3339.
    pub onset_utc: String,
    /// Onset, UTC nanoseconds: `before_ns` of the next page.
    pub onset_ns: i64,
    /// Number of samples.
    pub sample_count: usize,
    /// Samples per second.
    pub rate_fps: f64,
    /// Lowest voltage, pu; null when no sample is usable.
    pub lowest_voltage_pu: Option<f64>,
    /// Triggers, in order of first appearance.
    pub triggers: Vec<&'static str>,
    /// Why the window ended.
    pub closing: &'static str,
    /// What screening said; null when it has not been asked yet.
    pub screening: Option<ScreeningV1>,
    /// Whether the waveforms are still kept.
    pub has_waveforms: bool,
}

/// A version of a parameter set, without its content.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SetDocument {
    /// Site.
    pub site: String,
    /// Version.
    pub version: u64,
    /// Hash of its content.
    pub content_hash: String,
    /// When the version was assigned, RFC 3339.
    pub committed_utc: String,
    /// When it was put on its key, RFC 3339; null until then.
    pub published_utc: Option<String>,
}

/// A fit, without its content.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FitDocument {
    /// Number.
    pub id: i64,
    /// Site.
    pub site: String,
    /// The event of a fit of one event alone; null for a joint fit.
    pub event: Option<String>,
    /// Names of the parts of the model.
    pub structure: Vec<String>,
    /// Verdict of validation.
    pub verdict: &'static str,
    /// Hash of the parameter set's content.
    pub content_hash: String,
    /// When it was stored, RFC 3339.
    pub stored_utc: String,
    /// Whether the whole fit is still kept.
    pub has_document: bool,
}

impl From<&StoredFit> for FitDocument {
    fn from(fit: &StoredFit) -> Self {
        Self {
            id: fit.id.0,
            site: fit.site.clone(),
            event: (fit.kind == JobKind::IdentifyEvent).then(|| fit.subject.clone()),
            structure: fit.structure.clone(),
            verdict: verdict_status_name(fit.verdict),
            content_hash: fit.content_hash.clone(),
            stored_utc: rfc3339(fit.stored_ns),
            has_document: fit.document.is_some(),
        }
    }
}

/// A decision.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DecisionDocument {
    /// Number.
    pub id: i64,
    /// Site.
    pub site: String,
    /// What was decided.
    pub decision: &'static str,
    /// Why, in words.
    pub reason: String,
    /// Version under which the set is published; null when it is not.
    pub version: Option<u64>,
    /// Whether it still waits for a person.
    pub awaiting_approval: bool,
    /// Who decided.
    pub actor: String,
    /// When, RFC 3339.
    pub decided_utc: String,
    /// What a person answered; null where nobody was asked or has answered yet.
    pub answer: Option<AnswerDocument>,
}

/// A person's answer to a decision.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct AnswerDocument {
    /// Whether the set is to be published.
    pub approved: bool,
    /// Who.
    pub actor: String,
    /// Why; may be empty.
    pub comment: String,
    /// When, RFC 3339.
    pub answered_utc: String,
}

impl From<&Answer> for AnswerDocument {
    fn from(answer: &Answer) -> Self {
        Self {
            approved: answer.approved,
            actor: answer.actor.clone(),
            comment: answer.comment.clone(),
            answered_utc: rfc3339(answer.answered_ns),
        }
    }
}

/// A diagnosis, without its content.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DiagnosisDocument {
    /// Site.
    pub site: String,
    /// Number.
    pub version: u64,
    /// The structure judged.
    pub structure: Vec<String>,
    /// Status.
    pub status: String,
    /// The answer in one sentence.
    pub summary: String,
    /// The declared effect and those not separable from it, best first.
    pub answer_set: Vec<String>,
    /// Error over noise to quote; null when there is none.
    pub error_to_noise: Option<f64>,
    /// When it was stored, RFC 3339.
    pub stored_utc: String,
    /// When it was put on its key, RFC 3339; null until then.
    pub published_utc: Option<String>,
}

/// Which model a site is to have since when.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StructureDocument {
    /// Site.
    pub site: String,
    /// Names of the parts.
    pub structure: Vec<String>,
    /// `configuration`, `command_line` or `http`.
    pub origin: &'static str,
    /// Who said so.
    pub actor: String,
    /// Why, in words; may be empty.
    pub comment: String,
    /// Since when, RFC 3339.
    pub changed_utc: String,
}

impl From<&Site> for SiteDocument {
    fn from(site: &Site) -> Self {
        Self {
            site: site.name.clone(),
            s_base_mva: site.s_base_mva,
            v_base_kv: site.v_base_kv,
            nominal_hz: site.nominal_hz,
        }
    }
}

impl From<&WindowSummary> for EventDocument {
    fn from(window: &WindowSummary) -> Self {
        let lowest = window.lowest_voltage_pu;
        Self {
            event: window.id.clone(),
            site: window.site.clone(),
            onset_utc: rfc3339(window.onset_ns),
            onset_ns: window.onset_ns,
            sample_count: window.sample_count,
            rate_fps: window.rate_fps,
            lowest_voltage_pu: lowest.is_finite().then_some(lowest),
            triggers: window.triggers.iter().copied().map(trigger_name).collect(),
            closing: closing_name(window.closing),
            screening: window.screening.as_ref().map(ScreeningV1::from),
            has_waveforms: window.has_waveforms,
        }
    }
}

impl From<&StoredSet> for SetDocument {
    fn from(set: &StoredSet) -> Self {
        Self {
            site: set.site.clone(),
            version: set.version,
            content_hash: set.content_hash.clone(),
            committed_utc: rfc3339(set.committed_ns),
            published_utc: set.published_ns.map(rfc3339),
        }
    }
}

impl From<&StoredDiagnosis> for DiagnosisDocument {
    fn from(stored: &StoredDiagnosis) -> Self {
        let error = stored.error_to_noise;
        Self {
            site: stored.site.clone(),
            version: stored.version,
            structure: stored.structure.clone(),
            status: stored.status.clone(),
            summary: stored.summary.clone(),
            answer_set: stored.answer_set.clone(),
            error_to_noise: error.is_finite().then_some(error),
            stored_utc: rfc3339(stored.stored_ns),
            published_utc: stored.published_ns.map(rfc3339),
        }
    }
}

impl From<&StructureRecord> for StructureDocument {
    fn from(record: &StructureRecord) -> Self {
        Self {
            site: record.site.clone(),
            structure: record.structure.clone(),
            origin: record.origin.name(),
            actor: record.actor.clone(),
            comment: record.comment.clone(),
            changed_utc: rfc3339(record.changed_ns),
        }
    }
}

impl From<&DecisionRecord> for DecisionDocument {
    fn from(record: &DecisionRecord) -> Self {
        let (decision, reason) = match &record.decision {
            Decision::Publish { reason } => ("publish", reason),
            Decision::PublishUnvalidated { reason } => ("publish_unvalidated", reason),
            Decision::AwaitApproval { reason } => ("await_approval", reason),
            Decision::Reject { reason } => ("reject", reason),
        };
        Self {
            id: record.id.0,
            site: record.site.clone(),
            decision,
            reason: reason.clone(),
            version: record.version,
            awaiting_approval: record.awaiting_approval,
            actor: record.actor.clone(),
            decided_utc: rfc3339(record.decided_ns),
            answer: record.answer.as_ref().map(AnswerDocument::from),
        }
    }
}
