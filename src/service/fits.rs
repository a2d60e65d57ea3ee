//! Jobs that are ours: claimed, fitted, stored, decided on, ended; or claimed, diagnosed, stored,
//! ended.
//!
//! Each job is at one stage, and a stage is one command that has been given and not answered yet.
//! A stage that fails is given again after a pause, so that a finished fit survives a store that
//! is out of order for a while.

use std::{collections::BTreeMap, sync::Arc};

use super::{
    Claimed, Command, Diagnosed, Failure, FitEnd, Fitted, Lease, ServiceOptions, WorkEnd, WorkKind,
    outbox::Outbox,
};
use crate::{
    identification::{Decision, Identification, InForce, ParameterSet, VerdictStatus, decide},
    telemetry::{
        diagnoses::{DiagnosisFacts, DiagnosisFailed, DiagnosisMade, DiagnosisRepeated},
        jobs::{
            FitFailed, FitFinished, FitInterrupted, FitResult, FitStarted, Interruption, JobParked,
            WorkersBusy,
        },
        sets::CandidateDecided,
        store::StoreFailed,
    },
};

/// Pause between two looks for a due job when there was none, nanoseconds.
const CLAIM_PAUSE_NS: i64 = 1_000_000_000;

/// Jobs that are ours.
#[derive(Debug)]
pub(super) struct Fits {
    running: BTreeMap<i64, Running>,
    /// A claim has been asked for and not been answered.
    claiming: bool,
    claim_at_ns: i64,
    /// No more claims: the service is stopping.
    closed: bool,
}

#[derive(Debug)]
struct Running {
    claimed: Claimed,
    stage: Stage,
    started_ns: i64,
    renew_at_ns: i64,
    retry_at_ns: Option<i64>,
    interrupted: Option<Interruption>,
}

/// The command that has been given.
#[derive(Debug)]
enum Stage {
    /// None: another job of the same kind runs for the same site, and the two must end in order.
    Waiting,
    Fitting,
    StoringFit(Arc<Fitted>),
    StoringDiagnosis(Arc<Diagnosed>),
    Committing {
        fit: i64,
        decision: Decision,
        in_force: Option<Box<InForce>>,
    },
    Ending(WorkEnd),
}

impl Stage {
    /// The same, said of a fit that was decided on before.
    fn decided_again(mut self, again: bool) -> Self {
        if let Self::Committing { decision, .. } = &mut self
            && again
        {
            let reason = decision.reason_mut();
            *reason = format!("these events were fitted with this structure before; {reason}");
        }
        self
    }
}

impl Fits {
    pub(super) const fn new() -> Self {
        Self {
            running: BTreeMap::new(),
            claiming: false,
            claim_at_ns: 0,
            closed: false,
        }
    }

    /// Asks for a job when a worker is free and it is time to look.
    pub(super) fn claim(&mut self, now_ns: i64, options: &ServiceOptions, out: &mut Outbox) {
        let free = self.running.len() < options.workers;
        if self.closed || self.claiming || !free || now_ns < self.claim_at_ns {
            return;
        }
        self.claiming = true;
        out.push(Command::Claim {
            lease_until_ns: now_ns.saturating_add(options.lease_ns),
        });
    }

    /// A job has been queued: look at once.
    pub(super) const fn look_now(&mut self) {
        self.claim_at_ns = 0;
    }

    /// There was no job, or the store did not answer.
    pub(super) const fn nothing_claimed(&mut self, now_ns: i64) {
        self.claiming = false;
        self.claim_at_ns = now_ns.saturating_add(CLAIM_PAUSE_NS);
    }

    /// A job is ours.
    pub(super) fn claimed(
        &mut self,
        now_ns: i64,
        claimed: Claimed,
        options: &ServiceOptions,
        out: &mut Outbox,
    ) {
        self.claiming = false;
        let stage = if self.closed {
            Stage::Ending(WorkEnd::Release)
        } else if self.same_work_runs(&claimed) {
            Stage::Waiting
        } else {
            Stage::Fitting
        };
        let job = claimed.job();
        let running = Running {
            claimed,
            stage,
            started_ns: now_ns,
            renew_at_ns: now_ns.saturating_add(options.lease_ns / 3),
            retry_at_ns: None,
            interrupted: None,
        };
        running.give(out);
        self.running.insert(job, running);
        self.report_busy(out);
    }

    /// A lease was extended, or is lost.
    pub(super) fn lease_answered(&mut self, job: i64, held: bool, out: &mut Outbox) {
        if let Some(running) = self.running.get_mut(&job)
            && !held
        {
            running.interrupt(Interruption::LeaseLost, out);
            if !matches!(running.stage, Stage::Fitting) {
                self.forget(job, out);
            }
        }
    }

    /// A fit ended.
    pub(super) fn fit_ended(
        &mut self,
        now_ns: i64,
        job: i64,
        end: FitEnd,
        options: &ServiceOptions,
        out: &mut Outbox,
    ) {
        let Some(running) = self.running.get_mut(&job) else {
            return;
        };
        if running.interrupted == Some(Interruption::LeaseLost) {
            self.forget(job, out);
            return;
        }
        let stage = running.stage_after(now_ns, end, options, out);
        running.enter(stage, out);
    }

    /// A fit is on durable storage.
    pub(super) fn fit_stored(
        &mut self,
        job: i64,
        fit: i64,
        options: &ServiceOptions,
        out: &mut Outbox,
    ) {
        let Some(running) = self.running.get_mut(&job) else {
            return;
        };
        let Stage::StoringFit(fitted) = &running.stage else {
            return;
        };
        let fitted = Arc::clone(fitted);
        let set = &fitted.identification.set;
        let stage = running.decide(fit, set, fitted.in_force.as_ref(), options);
        running.enter(stage, out);
    }

    /// A diagnosis is on durable storage.
    pub(super) fn diagnosis_stored(
        &mut self,
        job: i64,
        version: u64,
        known: bool,
        out: &mut Outbox,
    ) {
        let Some(running) = self.running.get_mut(&job) else {
            return;
        };
        let Stage::StoringDiagnosis(diagnosed) = &running.stage else {
            return;
        };
        let diagnosis = &diagnosed.diagnosis;
        out.report(DiagnosisMade::new(
            diagnosis_facts(diagnosed),
            version,
            known,
        ));
        let (status, summary) = (diagnosis.status.name(), &diagnosis.summary);
        let outcome = format!("diagnosis {version}: {status}: {summary}");
        running.enter(Stage::Ending(WorkEnd::Complete { outcome }), out);
    }

    /// A decision is on durable storage. Returns the site that it is about.
    pub(super) fn committed(
        &mut self,
        job: i64,
        version: Option<u64>,
        known: bool,
        out: &mut Outbox,
    ) -> Option<String> {
        let running = self.running.get_mut(&job)?;
        let Stage::Committing { decision, .. } = &running.stage else {
            return None;
        };
        let site = running.claimed.work.site.clone();
        let (name, reason) = name_and_reason(decision);
        let outcome = match version {
            Some(version) => format!("{name} as version {version}: {reason}"),
            None => format!("{name}: {reason}"),
        };
        out.report(CandidateDecided {
            site: site.clone(),
            decision: name,
            reason: reason.to_owned(),
            version,
            known,
        });
        running.enter(Stage::Ending(WorkEnd::Complete { outcome }), out);
        Some(site)
    }

    /// A job is off our hands.
    pub(super) fn ended(&mut self, job: i64, parked: bool, out: &mut Outbox) {
        if let Some(running) = self.running.get(&job)
            && parked
        {
            out.report(JobParked {
                kind: running.claimed.work.kind.name(),
                subject: running.claimed.work.subject.clone(),
            });
        }
        self.forget(job, out);
        self.look_now();
    }

    /// A step failed: it is tried again after a pause.
    pub(super) fn step_failed(
        &mut self,
        now_ns: i64,
        job: i64,
        failure: Failure,
        options: &ServiceOptions,
        out: &mut Outbox,
    ) {
        out.report(StoreFailed {
            reason: failure.reason,
            error: failure.error,
            retried: self.running.contains_key(&job),
        });
        if let Some(running) = self.running.get_mut(&job) {
            running.retry_at_ns = Some(now_ns.saturating_add(options.store_retry_ns));
        }
    }

    /// Extends leases, repeats failed steps, cancels fits that are over their budget.
    pub(super) fn tick(&mut self, now_ns: i64, options: &ServiceOptions, out: &mut Outbox) {
        for running in self.running.values_mut() {
            if now_ns >= running.renew_at_ns {
                running.renew_at_ns = now_ns.saturating_add(options.lease_ns / 3);
                out.push(Command::Heartbeat {
                    lease: running.claimed.lease,
                    until_ns: now_ns.saturating_add(options.lease_ns),
                });
            }
            if running.retry_at_ns.is_some_and(|at| now_ns >= at) {
                running.retry_at_ns = None;
                running.give(out);
            }
            let age_ns = now_ns.saturating_sub(running.started_ns);
            if matches!(running.stage, Stage::Fitting) && age_ns >= options.fit_budget_ns {
                running.interrupt(Interruption::Budget, out);
            }
        }
        self.start_waiting(now_ns, out);
    }

    /// No more claims.
    pub(super) fn close(&mut self, out: &mut Outbox) {
        self.closed = true;
        for running in self.running.values_mut() {
            if matches!(running.stage, Stage::Waiting) {
                running.enter(Stage::Ending(WorkEnd::Release), out);
            }
        }
    }

    /// Cancels what is still being fitted: the service is stopping.
    pub(super) fn cancel_all(&mut self, out: &mut Outbox) {
        for running in self.running.values_mut() {
            if matches!(running.stage, Stage::Fitting) {
                running.interrupt(Interruption::Shutdown, out);
            }
        }
    }

    /// Jobs in our hands.
    pub(super) fn count(&self) -> usize {
        self.running.len()
    }

    /// Whether nothing is under way.
    pub(super) fn at_rest(&self) -> bool {
        self.running.is_empty() && !self.claiming
    }

    fn same_work_runs(&self, claimed: &Claimed) -> bool {
        claimed.work.kind != WorkKind::Event
            && self
                .running
                .values()
                .any(|r| r.claimed.work == claimed.work)
    }

    /// Starts what waited for its predecessor, which has ended.
    fn start_waiting(&mut self, now_ns: i64, out: &mut Outbox) {
        let ready: Vec<i64> = self
            .running
            .iter()
            .filter(|(_, waiting)| matches!(waiting.stage, Stage::Waiting))
            .filter(|(job, waiting)| {
                !self.running.iter().any(|(other, r)| {
                    other != *job
                        && r.claimed.work == waiting.claimed.work
                        && !matches!(r.stage, Stage::Waiting)
                })
            })
            .map(|(job, _)| *job)
            .take(1)
            .collect();
        for job in ready {
            if let Some(running) = self.running.get_mut(&job) {
                running.started_ns = now_ns;
                running.enter(Stage::Fitting, out);
            }
        }
    }

    fn forget(&mut self, job: i64, out: &mut Outbox) {
        self.running.remove(&job);
        self.report_busy(out);
    }

    fn report_busy(&self, out: &mut Outbox) {
        out.report(WorkersBusy {
            workers: self.running.len(),
        });
    }
}

impl Running {
    fn enter(&mut self, stage: Stage, out: &mut Outbox) {
        self.stage = stage;
        self.retry_at_ns = None;
        self.give(out);
    }

    /// Gives the stage's command.
    fn give(&self, out: &mut Outbox) {
        let lease: Lease = self.claimed.lease;
        match &self.stage {
            Stage::Waiting => {}
            Stage::Fitting => {
                out.report(FitStarted {
                    kind: self.claimed.work.kind.name(),
                    subject: self.claimed.work.subject.clone(),
                });
                out.push(Command::RunFit(self.claimed.clone()));
            }
            Stage::StoringFit(fitted) => out.push(Command::StoreFit {
                claimed: self.claimed.clone(),
                fitted: Arc::clone(fitted),
            }),
            Stage::StoringDiagnosis(diagnosed) => out.push(Command::StoreDiagnosis {
                claimed: self.claimed.clone(),
                diagnosed: Arc::clone(diagnosed),
            }),
            Stage::Committing {
                fit,
                decision,
                in_force,
            } => out.push(Command::CommitDecision {
                job: lease.job,
                fit: *fit,
                decision: decision.clone(),
                in_force: in_force.clone(),
            }),
            Stage::Ending(end) => out.push(Command::EndWork {
                lease,
                end: end.clone(),
            }),
        }
    }

    fn interrupt(&mut self, reason: Interruption, out: &mut Outbox) {
        if self.interrupted.is_none() {
            self.interrupted = Some(reason);
            self.report_interrupted(reason, String::new(), out);
            if matches!(self.stage, Stage::Fitting) {
                out.push(Command::CancelFit {
                    job: self.claimed.job(),
                });
            }
        }
    }

    fn stage_after(
        &self,
        now_ns: i64,
        end: FitEnd,
        options: &ServiceOptions,
        out: &mut Outbox,
    ) -> Stage {
        let fail = |error: String| {
            Stage::Ending(WorkEnd::Fail {
                error,
                retry_at_ns: now_ns.saturating_add(options.retry_ns),
            })
        };
        match end {
            FitEnd::Fitted(fitted) => {
                out.report(self.finished(&fitted.identification));
                Stage::StoringFit(fitted)
            }
            FitEnd::Known {
                fit,
                candidate,
                again,
            } => {
                let in_force = candidate.in_force.as_ref();
                self.decide(fit, &candidate.set, in_force, options)
                    .decided_again(again)
            }
            FitEnd::Diagnosed(diagnosed) => Stage::StoringDiagnosis(diagnosed),
            FitEnd::DiagnosisKnown { version } => Stage::Ending(WorkEnd::Complete {
                outcome: format!("diagnosis {version} is on record"),
            }),
            FitEnd::DiagnosedBefore { earlier, version } => {
                out.report(DiagnosisRepeated {
                    site: self.claimed.work.site.clone(),
                    earlier,
                    version,
                });
                Stage::Ending(WorkEnd::Complete {
                    outcome: format!("diagnosis {version}: as {earlier}"),
                })
            }
            FitEnd::NoSet { reason } => {
                self.report_failed(reason.clone(), out);
                Stage::Ending(WorkEnd::Complete {
                    outcome: format!("no set: {reason}"),
                })
            }
            FitEnd::Failed { error } => {
                self.report_failed(error.clone(), out);
                fail(error)
            }
            FitEnd::Cancelled if self.interrupted == Some(Interruption::Budget) => {
                let seconds = options.fit_budget_ns / 1_000_000_000;
                fail(format!(
                    "the fit took longer than its budget of {seconds} s"
                ))
            }
            FitEnd::Cancelled => Stage::Ending(WorkEnd::Release),
            FitEnd::Panicked { message } => {
                self.report_interrupted(Interruption::Panic, message.clone(), out);
                fail(format!("the fit panicked: {message}"))
            }
        }
    }

    /// A joint fit is decided on; the fit of one event is only kept.
    fn decide(
        &self,
        fit: i64,
        set: &ParameterSet,
        in_force: Option<&InForce>,
        options: &ServiceOptions,
    ) -> Stage {
        match self.claimed.work.kind {
            WorkKind::Event | WorkKind::Diagnosis => Stage::Ending(WorkEnd::Complete {
                outcome: format!("fitted: {}", result_of(set).name()),
            }),
            WorkKind::Site => Stage::Committing {
                fit,
                decision: decide(set, in_force, &options.decision),
                in_force: in_force.cloned().map(Box::new),
            },
        }
    }

    fn finished(&self, identification: &Identification) -> FitFinished {
        let (set, cost) = (&identification.set, &identification.cost);
        FitFinished {
            kind: self.claimed.work.kind.name(),
            subject: self.claimed.work.subject.clone(),
            site: self.claimed.work.site.clone(),
            result: result_of(set),
            reasons: set.verdict.reasons.clone(),
            seconds: cost.seconds,
            simulations: cost.simulations,
            sensitivity_simulations: cost.sensitivity_simulations,
            error_to_noise: set.fit.error_to_noise,
            held_out: set
                .held_out
                .as_ref()
                .map(|h| (h.eps_p_percent, h.eps_q_percent, h.error_to_noise)),
            joint: self.claimed.work.kind == WorkKind::Site,
        }
    }

    fn report_failed(&self, error: String, out: &mut Outbox) {
        if self.claimed.work.kind == WorkKind::Diagnosis {
            out.report(DiagnosisFailed {
                site: self.claimed.work.site.clone(),
                error,
            });
            return;
        }
        out.report(FitFailed {
            kind: self.claimed.work.kind.name(),
            subject: self.claimed.work.subject.clone(),
            site: self.claimed.work.site.clone(),
            error,
        });
    }

    fn report_interrupted(&self, reason: Interruption, detail: String, out: &mut Outbox) {
        out.report(FitInterrupted {
            kind: self.claimed.work.kind.name(),
            subject: self.claimed.work.subject.clone(),
            reason,
            detail,
        });
    }
}

fn diagnosis_facts(diagnosed: &Diagnosed) -> DiagnosisFacts {
    let diagnosis = &diagnosed.diagnosis;
    DiagnosisFacts {
        site: diagnosis.site.clone(),
        status: diagnosis.status.name(),
        summary: diagnosis.summary.clone(),
        answer_set: diagnosis.answer_set.clone(),
        error_before: diagnosis.baseline.quoted().error_to_noise,
        error_after: diagnosed.error_after,
        seconds: diagnosis.cost.seconds,
    }
}

fn result_of(set: &ParameterSet) -> FitResult {
    match set.verdict.status {
        VerdictStatus::Pass => FitResult::Pass,
        VerdictStatus::Fail => FitResult::Fail,
        VerdictStatus::CannotJudge => FitResult::CannotJudge,
    }
}

fn name_and_reason(decision: &Decision) -> (&'static str, &str) {
    let name = match decision {
        Decision::Publish { .. } => "publish",
        Decision::PublishUnvalidated { .. } => "publish_unvalidated",
        Decision::AwaitApproval { .. } => "await_approval",
        Decision::Reject { .. } => "reject",
    };
    (name, decision.reason())
}
