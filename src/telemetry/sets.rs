//! Decisions, parameter sets and the questions after them.

use tracing::{debug, info, warn};

use super::{Metrics, Occurrence, catalogue, intake::seconds};

/// A candidate was decided on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CandidateDecided {
    /// Site.
    pub site: String,
    /// Decision, from a closed list.
    pub decision: &'static str,
    /// Why, in words.
    pub reason: String,
    /// Version under which it is published; none when it is not.
    pub version: Option<u64>,
    /// Whether the same decision was on record before.
    pub known: bool,
}

impl Occurrence for CandidateDecided {
    fn emit(&self, metrics: &Metrics) {
        if !self.known {
            metrics.add(&catalogue::DECISIONS, &[&self.site, self.decision], 1);
        }
        info!(
            site = self.site,
            decision = self.decision,
            reason = self.reason,
            version = self.version,
            known = self.known,
            "candidate decided on"
        );
    }

    fn sentence(&self) -> Option<String> {
        let decision = match (self.decision, self.version) {
            ("reject", _) => "kept the set in force".to_owned(),
            ("await_approval", _) => "waits for approval".to_owned(),
            (_, Some(version)) => format!("to be published as version {version}"),
            (other, None) => other.to_owned(),
        };
        Some(format!("{}: {decision}: {}", self.site, self.reason))
    }
}

/// A set is on its key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SetPublished {
    /// Site.
    pub site: String,
    /// Version.
    pub version: u64,
    /// When, UTC nanoseconds.
    pub at_ns: i64,
}

impl Occurrence for SetPublished {
    fn emit(&self, metrics: &Metrics) {
        let site = self.site.as_str();
        metrics.add(&catalogue::SETS_PUBLISHED, &[site], 1);
        metrics.set(&catalogue::SET_VERSION, &[site], self.version as f64);
        metrics.set(&catalogue::SET_TIMESTAMP, &[site], seconds(self.at_ns));
        info!(site, version = self.version, "parameter set published");
    }

    fn sentence(&self) -> Option<String> {
        Some(format!("{}: version {} published", self.site, self.version))
    }
}

/// What was to be published.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Publication {
    /// A parameter set.
    Set,
    /// An event summary.
    Event,
    /// A diagnosis.
    Diagnosis,
}

impl Publication {
    /// The label.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Set => "set",
            Self::Event => "event",
            Self::Diagnosis => "diagnosis",
        }
    }
}

/// Zenoh refused a publication; it is tried again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PublishFailed {
    /// What.
    pub what: Publication,
    /// Site or window.
    pub subject: String,
    /// Why, in words.
    pub error: String,
}

impl Occurrence for PublishFailed {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::PUBLISH_ERRORS, &[self.what.name()], 1);
        warn!(
            what = self.what.name(),
            subject = self.subject,
            error = self.error,
            "publication failed"
        );
    }

    fn sentence(&self) -> Option<String> {
        Some(format!(
            "could not publish {}: {}",
            self.subject, self.error
        ))
    }
}

/// How a query ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QueryOutcome {
    /// With a document.
    Answered,
    /// There is no such site or version.
    NotFound,
    /// The question makes no sense.
    Malformed,
    /// The store did not answer.
    Failed,
}

impl QueryOutcome {
    /// The label.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Answered => "answered",
            Self::NotFound => "not_found",
            Self::Malformed => "malformed",
            Self::Failed => "failed",
        }
    }
}

/// Somebody asked for a parameter set or a diagnosis.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QueryAnswered {
    /// The question.
    pub selector: String,
    /// How it ended.
    pub outcome: QueryOutcome,
}

impl Occurrence for QueryAnswered {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::QUERIES, &[self.outcome.name()], 1);
        debug!(
            selector = self.selector,
            outcome = self.outcome.name(),
            "query answered"
        );
    }
}
