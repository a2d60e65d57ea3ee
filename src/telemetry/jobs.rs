//! Fits, from the queue to their end.

use tracing::{debug, error, info, warn};

use super::{Metrics, Occurrence, catalogue};

/// A job went into the queue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobQueued {
    /// Kind.
    pub kind: &'static str,
    /// Window id or site.
    pub subject: String,
    /// Whether it was there before, in whatever state.
    pub known: bool,
}

impl Occurrence for JobQueued {
    fn emit(&self, _metrics: &Metrics) {
        debug!(
            kind = self.kind,
            subject = self.subject,
            known = self.known,
            "job queued"
        );
    }
}

/// A fit was started.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FitStarted {
    /// Kind.
    pub kind: &'static str,
    /// Window id or site.
    pub subject: String,
}

impl Occurrence for FitStarted {
    fn emit(&self, _metrics: &Metrics) {
        info!(kind = self.kind, subject = self.subject, "fit started");
    }
}

/// How a fit ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FitResult {
    /// Validated.
    Pass,
    /// Failed validation.
    Fail,
    /// The data do not allow a judgement.
    CannotJudge,
}

impl FitResult {
    /// The label.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Fail => "fail",
            Self::CannotJudge => "cannot_judge",
        }
    }
}

/// A fit came to its end.
#[derive(Clone, Debug, PartialEq)]
pub struct FitFinished {
    /// Kind.
    pub kind: &'static str,
    /// Window id or site.
    pub subject: String,
    /// Site.
    pub site: String,
    /// Verdict of validation.
    pub result: FitResult,
    /// Why, in words.
    pub reasons: Vec<String>,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Plain simulations.
    pub simulations: u64,
    /// Simulations with sensitivities.
    pub sensitivity_simulations: u64,
    /// Residual over noise floor on the fitted events.
    pub error_to_noise: f64,
    /// Errors on the held-out events: P and Q in percent, residual over noise floor.
    pub held_out: Option<(f64, f64, f64)>,
    /// Whether this is a site's joint fit, the one that is published.
    pub joint: bool,
}

impl Occurrence for FitFinished {
    fn emit(&self, metrics: &Metrics) {
        let site = self.site.as_str();
        metrics.add(&catalogue::FITS, &[site, self.result.name()], 1);
        metrics.observe(&catalogue::FIT_SECONDS, &[], self.seconds);
        metrics.add(&catalogue::SIMULATIONS, &["plain"], self.simulations);
        metrics.add(
            &catalogue::SIMULATIONS,
            &["sensitivity"],
            self.sensitivity_simulations,
        );
        if self.joint {
            metrics.set(&catalogue::ERROR_TO_NOISE, &[site], self.error_to_noise);
            if let Some((p_percent, q_percent, to_noise)) = self.held_out {
                metrics.set(&catalogue::HELD_OUT_ERROR, &[site, "p"], p_percent);
                metrics.set(&catalogue::HELD_OUT_ERROR, &[site, "q"], q_percent);
                metrics.set(
                    &catalogue::HELD_OUT_RATIO,
                    &[site],
                    to_noise / self.error_to_noise,
                );
            }
        }
        info!(
            kind = self.kind,
            subject = self.subject,
            verdict = self.result.name(),
            seconds = self.seconds,
            error_to_noise = self.error_to_noise,
            "fit finished"
        );
    }

    fn sentence(&self) -> Option<String> {
        let what = if self.joint { "joint fit" } else { "fit" };
        let held_out = self
            .held_out
            .map_or_else(String::new, |(p_percent, q_percent, _)| {
                format!(", held out eps_P {p_percent:.3} % eps_Q {q_percent:.3} %")
            });
        let reasons = shortened(&self.reasons);
        let verdict = match self.result {
            FitResult::Pass => "; passed".to_owned(),
            FitResult::Fail => format!("; failed validation: {reasons}"),
            // One event alone can never be judged.
            FitResult::CannotJudge if !self.joint => String::new(),
            FitResult::CannotJudge => format!("; cannot be judged: {reasons}"),
        };
        Some(format!(
            "{what} of {} in {:.1} s: error to noise {:.2}{held_out}{verdict}",
            self.subject, self.seconds, self.error_to_noise
        ))
    }
}

/// The first reasons; a long list says less.
fn shortened(reasons: &[String]) -> String {
    const SHOWN_MAX: usize = 2;
    let shown = reasons.iter().take(SHOWN_MAX).cloned().collect::<Vec<_>>();
    let left = reasons.len().saturating_sub(SHOWN_MAX);
    if left == 0 {
        return shown.join("; ");
    }
    format!("{}; and {left} more", shown.join("; "))
}

/// A fit ended with an error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FitFailed {
    /// Kind.
    pub kind: &'static str,
    /// Window id or site.
    pub subject: String,
    /// Site.
    pub site: String,
    /// What went wrong.
    pub error: String,
}

impl Occurrence for FitFailed {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::FITS, &[&self.site, "error"], 1);
        warn!(
            kind = self.kind,
            subject = self.subject,
            error = self.error,
            "fit failed"
        );
    }

    fn sentence(&self) -> Option<String> {
        Some(format!("no fit of {}: {}", self.subject, self.error))
    }
}

/// Why a fit did not end by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interruption {
    /// It took longer than its budget.
    Budget,
    /// The service is stopping.
    Shutdown,
    /// Somebody else has the job now.
    LeaseLost,
    /// It panicked: a defect of this program.
    Panic,
}

impl Interruption {
    /// The label.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Budget => "budget",
            Self::Shutdown => "shutdown",
            Self::LeaseLost => "lease_lost",
            Self::Panic => "panic",
        }
    }
}

/// A fit did not end by itself.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FitInterrupted {
    /// Kind.
    pub kind: &'static str,
    /// Window id or site.
    pub subject: String,
    /// Why.
    pub reason: Interruption,
    /// More about it, in words; may be empty.
    pub detail: String,
}

impl Occurrence for FitInterrupted {
    fn emit(&self, metrics: &Metrics) {
        let reason = self.reason.name();
        metrics.add(&catalogue::FITS_INTERRUPTED, &[reason], 1);
        if self.reason == Interruption::Panic {
            error!(
                kind = self.kind,
                subject = self.subject,
                detail = self.detail,
                "fit panicked"
            );
        } else {
            warn!(
                kind = self.kind,
                subject = self.subject,
                reason,
                detail = self.detail,
                "fit interrupted"
            );
        }
    }

    fn sentence(&self) -> Option<String> {
        let reason = self.reason.name();
        Some(format!(
            "fit of {} interrupted ({reason}) {}",
            self.subject, self.detail
        ))
    }
}

/// A job failed too often.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct JobParked {
    /// Kind.
    pub kind: &'static str,
    /// Window id or site.
    pub subject: String,
}

impl Occurrence for JobParked {
    fn emit(&self, metrics: &Metrics) {
        metrics.add(&catalogue::JOBS_PARKED, &[], 1);
        error!(
            kind = self.kind,
            subject = self.subject,
            "job parked: it failed too often"
        );
    }

    fn sentence(&self) -> Option<String> {
        Some(format!(
            "gave up on the fit of {}: it failed too often",
            self.subject
        ))
    }
}

/// How many fits are running.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WorkersBusy {
    /// Fits.
    pub workers: usize,
}

impl Occurrence for WorkersBusy {
    fn emit(&self, metrics: &Metrics) {
        metrics.set(&catalogue::WORKERS_BUSY, &[], self.workers as f64);
    }
}
