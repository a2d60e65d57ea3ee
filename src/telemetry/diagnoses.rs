//! Diagnoses, and changes of what is fitted or counts.

use tracing::{info, warn};

use super::{Metrics, Occurrence, catalogue};

/// What a diagnosis says, as far as operators see it.
#[derive(Clone, Debug, PartialEq)]
pub struct DiagnosisFacts {
    /// Site.
    pub site: String,
    /// Status, from a closed list.
    pub status: &'static str,
    /// The answer in one sentence.
    pub summary: String,
    /// Effects named, best first: names of the catalogue.
    pub answer_set: Vec<String>,
    /// Error over noise of the structure judged: of the untouched events where there are any.
    pub error_before: f64,
    /// The same with the first effect named, on the untouched events, from which `error_before` comes
    /// too; none where no effect is named or no event is untouched.
    pub error_after: Option<f64>,
    /// Wall-clock seconds.
    pub seconds: f64,
}

/// A diagnosis is on durable storage.
#[derive(Clone, Debug, PartialEq)]
pub struct DiagnosisMade {
    facts: DiagnosisFacts,
    version: u64,
    known: bool,
}

impl DiagnosisMade {
    /// The diagnosis under its number; `known` when it was there before.
    #[must_use]
    pub const fn new(facts: DiagnosisFacts, version: u64, known: bool) -> Self {
        Self {
            facts,
            version,
            known,
        }
    }
}

impl Occurrence for DiagnosisMade {
    fn emit(&self, metrics: &Metrics) {
        let facts = &self.facts;
        if !self.known {
            metrics.add(&catalogue::DIAGNOSES, &[facts.status], 1);
            metrics.observe(&catalogue::DIAGNOSIS_SECONDS, &[], facts.seconds);
            let error = &catalogue::DIAGNOSIS_ERROR_TO_NOISE;
            metrics.observe(error, &["before"], facts.error_before);
            if let Some(after) = facts.error_after {
                metrics.observe(error, &["after"], after);
            }
            if let Some(effect) = facts.answer_set.first() {
                metrics.add(&catalogue::DIAGNOSED_EFFECTS, &[effect], 1);
            }
        }
        info!(
            site = facts.site,
            version = self.version,
            status = facts.status,
            effects = facts.answer_set.join(" "),
            error_to_noise = facts.error_before,
            error_to_noise_after = facts.error_after,
            seconds = facts.seconds,
            known = self.known,
            "diagnosed"
        );
    }

    fn sentence(&self) -> Option<String> {
        let DiagnosisFacts {
            site,
            summary,
            error_before,
            error_after,
            seconds,
            ..
        } = &self.facts;
        let fall = error_after.map_or_else(String::new, |after| {
            format!(", {after:.2} with the effect named")
        });
        Some(format!(
            "diagnosis of {site} in {seconds:.1} s: error to noise {error_before:.2}{fall}: {summary}"
        ))
    }
}

/// A site came back to a structure: what was found of it before is the newest diagnosis again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiagnosisRepeated {
    /// Site.
    pub site: String,
    /// Number of the diagnosis that was made.
    pub earlier: u64,
    /// Number that it has now as well.
    pub version: u64,
}

impl Occurrence for DiagnosisRepeated {
    fn emit(&self, _metrics: &Metrics) {
        info!(
            site = self.site,
            version = self.version,
            as_version = self.earlier,
            "diagnosed before: the diagnosis on record counts again"
        );
    }

    fn sentence(&self) -> Option<String> {
        Some(format!(
            "diagnosis of {}: as number {}, kept as {} again",
            self.site, self.earlier, self.version
        ))
    }
}

/// A diagnosis ended with an error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiagnosisFailed {
    /// Site.
    pub site: String,
    /// What went wrong.
    pub error: String,
}

impl Occurrence for DiagnosisFailed {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::DIAGNOSES, &["error"], 1);
        warn!(site = self.site, error = self.error, "diagnosis failed");
    }

    fn sentence(&self) -> Option<String> {
        Some(format!("no diagnosis of {}: {}", self.site, self.error))
    }
}

/// A diagnosis is on its key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DiagnosisPublished {
    /// Site.
    pub site: String,
    /// Number.
    pub version: u64,
}

impl Occurrence for DiagnosisPublished {
    fn emit(&self, _metrics: &Metrics) {
        info!(
            site = self.site,
            version = self.version,
            "diagnosis published"
        );
    }
}

/// Somebody changed which model a site is to have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StructureChanged {
    /// Site.
    pub site: String,
    /// Names of the parts.
    pub structure: Vec<String>,
    /// How it was said, from a closed list.
    pub origin: &'static str,
    /// Who.
    pub actor: String,
}

impl Occurrence for StructureChanged {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::STRUCTURE_CHANGES, &[self.origin], 1);
        info!(
            site = self.site,
            structure = self.structure.join("+"),
            origin = self.origin,
            actor = self.actor,
            "structure changed"
        );
    }

    fn sentence(&self) -> Option<String> {
        let structure = self.structure.join("+");
        Some(format!(
            "{}: to be fitted as {structure} ({})",
            self.site, self.actor
        ))
    }
}

/// Somebody changed which set counts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SetsChanged {
    /// Site.
    pub site: String,
    /// What was done, from a closed list.
    pub action: &'static str,
    /// Version that counts now; none when it stays as it was.
    pub version: Option<u64>,
    /// Who.
    pub actor: String,
}

impl Occurrence for SetsChanged {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::SET_ACTIONS, &[self.action], 1);
        info!(
            site = self.site,
            action = self.action,
            version = self.version,
            actor = self.actor,
            "parameter sets changed by a person"
        );
    }

    fn sentence(&self) -> Option<String> {
        let version = self.version.map_or_else(
            || "the set in force stays".to_owned(),
            |version| format!("version {version} counts"),
        );
        Some(format!(
            "{}: {} by {}: {version}",
            self.site, self.action, self.actor
        ))
    }
}
