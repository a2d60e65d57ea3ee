//! The store's thread: carries out, one after the other, what the core asks of the store.

use std::{
    sync::{Arc, mpsc::Receiver},
    thread::{self, JoinHandle},
};

use tokio::sync::mpsc::UnboundedSender;

use super::{
    backlog, clock,
    convert::{failure, job_kind, lease, store_lease, work_of},
    inputs::{diagnosis_hash, inputs_hash},
    settings::Settings,
    structures::{self, Wanted},
};
use crate::{
    adapters::{
        http::Health,
        store::{
            ClaimRequest, Enqueued, FitId, JobFailure, JobKind, LeaseAnswer, NewDecision,
            NewDiagnosis, NewFit, NewJob, Saved, Store, StoreError,
        },
    },
    disturbance::Window,
    service::{
        Claimed, Command, Diagnosed, DocumentKind, Event, Fitted, Lease, ServiceOptions, Work,
        WorkEnd, WorkKind,
    },
    telemetry::{
        Occurrence,
        store::{StoreMeasured, StorePruned},
    },
};

/// Calls of retention in one round: bounds how long other steps wait.
const PRUNE_CALLS_MAX: usize = 8;
/// With less than this left on its disk a store cannot be counted on to take a window.
const DISK_FREE_BYTES_MIN: u64 = 1_000_000;

/// Carries out the core's commands to the store.
#[derive(Clone, Debug)]
pub(super) struct Steps {
    pub(super) store: Arc<dyn Store>,
    pub(super) settings: Arc<Settings>,
    pub(super) health: Arc<Health>,
}

impl Steps {
    /// Works until the sender is dropped. The queue is as long as the core's own bounds admit.
    pub(super) fn spawn(
        self,
        commands: Receiver<Command>,
        events: UnboundedSender<Event>,
    ) -> std::io::Result<JoinHandle<()>> {
        thread::Builder::new()
            .name("store".to_owned())
            .spawn(move || {
                for command in commands {
                    if let Some(event) = self.carry_out(command)
                        && events.send(event).is_err()
                    {
                        return;
                    }
                }
            })
    }

    /// Carries out one command; none for a command that is not the store's.
    pub(super) fn carry_out(&self, command: Command) -> Option<Event> {
        let now_ns = clock::now_ns();
        Some(match command {
            Command::StoreWindow(window) => self.store_window(&window, now_ns),
            Command::StoreScreening { window, screening } => window_step(
                &window.id,
                self.store.save_screening(&window.id, &screening, now_ns),
                |window| Event::ScreeningStored { window },
            ),
            Command::MarkAnnounced { window } => {
                let marked = self.store.mark_announced(&window, now_ns);
                window_step(&window, marked, |window| Event::AnnouncementMarked {
                    window,
                })
            }
            Command::Queue { work, due_ns } => self.queue(work, due_ns, now_ns),
            Command::Claim { lease_until_ns } => self.claim(lease_until_ns, now_ns),
            Command::Heartbeat { lease, until_ns } => self.heartbeat(lease, until_ns),
            Command::StoreFit { claimed, fitted } => self.store_fit(&claimed, &fitted, now_ns),
            Command::StoreDiagnosis { claimed, diagnosed } => {
                self.store_diagnosis(&claimed, &diagnosed, now_ns)
            }
            Command::CommitDecision {
                job,
                fit,
                decision,
                in_force,
            } => {
                let decision = NewDecision {
                    fit: FitId(fit),
                    decision: &decision,
                    in_force: in_force.as_deref(),
                    actor: &self.settings.service.instance,
                };
                let committed = self.store.commit_decision(&decision, now_ns);
                work_step(job, committed, |committed| Event::DecisionCommitted {
                    job,
                    version: committed.version,
                    known: committed.saved == Saved::AlreadyStored,
                })
            }
            Command::EndWork { lease, end } => self.end_work(lease, &end, now_ns),
            Command::MarkPublished {
                kind,
                site,
                version,
            } => self.mark_published(kind, site, version, now_ns),
            Command::KeepProgress(progress) => {
                let kept = self.store.save_progress(&progress);
                Event::ProgressKept(kept.map_err(|error| failure(&error)))
            }
            Command::LoadBacklog(part) => {
                let joint_events_max = self.settings.service.joint_events_max;
                match backlog::load(self.store.as_ref(), part, joint_events_max) {
                    Ok(backlog) => Event::BacklogLoaded(part, backlog),
                    Err(error) => Event::BacklogFailed(part, failure(&error)),
                }
            }
            Command::MeasureStore => housekeeping(self.measure(now_ns)),
            Command::Prune => housekeeping(self.prune(now_ns)),
            _ => return None,
        })
    }

    fn store_window(&self, window: &Window, now_ns: i64) -> Event {
        let id = window.id.clone();
        match self.store.save_window(window, now_ns) {
            Ok(saved) => Event::WindowStored {
                window: id,
                known: saved == Saved::AlreadyStored,
            },
            Err(error) => Event::WindowNotStored {
                window: id,
                failure: failure(&error),
            },
        }
    }

    fn store_fit(&self, claimed: &Claimed, fitted: &Fitted, now_ns: i64) -> Event {
        let fit = NewFit {
            kind: job_kind(claimed.work.kind),
            site: &claimed.work.site,
            subject: &claimed.work.subject,
            inputs_hash: &fitted.inputs_hash,
            identification: &fitted.identification,
        };
        let job = claimed.job();
        work_step(job, self.store.save_fit(&fit, now_ns), |(fit, _)| {
            Event::FitStored { job, fit: fit.0 }
        })
    }

    fn store_diagnosis(&self, claimed: &Claimed, diagnosed: &Diagnosed, now_ns: i64) -> Event {
        let new = NewDiagnosis {
            site: &claimed.work.site,
            inputs_hash: &diagnosed.inputs_hash,
            diagnosis: &diagnosed.diagnosis,
        };
        let (job, saved) = (claimed.job(), self.store.save_diagnosis(&new, now_ns));
        work_step(job, saved, |(version, saved)| Event::DiagnosisStored {
            job,
            version,
            known: saved == Saved::AlreadyStored,
        })
    }

    /// Queues a job, unless there is nothing to do for it yet. The inputs are what the store
    /// holds now; the fit itself looks again.
    fn queue(&self, work: Work, due_ns: i64, now_ns: i64) -> Event {
        let enqueued = self.inputs(&work).and_then(|inputs| {
            let inputs_hash = match inputs {
                Ok(inputs_hash) => inputs_hash,
                Err(reason) => return Ok(Err(reason)),
            };
            let job = NewJob {
                kind: job_kind(work.kind),
                site: &work.site,
                subject: &work.subject,
                inputs_hash: &inputs_hash,
                due_ns,
            };
            let enqueued = self.store.enqueue(&job, now_ns)?;
            Ok(Ok(matches!(enqueued, Enqueued::Known(..))))
        });
        match enqueued {
            Ok(Ok(known)) => Event::WorkQueued { work, known },
            Ok(Err(reason)) => Event::WorkNotNeeded { work, reason },
            Err(error) => Event::WorkNotQueued {
                work,
                failure: failure(&error),
            },
        }
    }

    /// Hash of the inputs of a job, or why there is nothing to do.
    fn inputs(&self, work: &Work) -> Result<Result<String, String>, StoreError> {
        let (store, options) = (self.store.as_ref(), &self.settings.service);
        let Wanted { structure, turn } = structures::in_force(store, &self.settings, &work.site)?;
        if work.kind == WorkKind::Event {
            let window = [work.subject.clone()];
            return Ok(Ok(inputs_hash(&window, &structure, 0, options)));
        }
        let usable = backlog::usable(store, &work.site, options.joint_events_max)?;
        let (found, needed) = (usable.len(), events_needed(work.kind, options));
        if found < needed {
            return Ok(Err(format!("{found} usable events, {needed} needed")));
        }
        let fit_hash = inputs_hash(&usable, &structure, turn, options);
        if work.kind == WorkKind::Site {
            return Ok(Ok(fit_hash));
        }
        let fit = store.fit_of(JobKind::IdentifySite, &work.site, &fit_hash)?;
        Ok(match fit {
            Some(_) => Ok(diagnosis_hash(&usable, &structure, turn, options)),
            None => Err("these events have not been fitted jointly".to_owned()),
        })
    }

    fn claim(&self, lease_until_ns: i64, now_ns: i64) -> Event {
        let request = ClaimRequest {
            worker: &self.settings.service.instance,
            kinds: &JobKind::ALL,
            now_ns,
            lease_until_ns,
            interruptions_max: self.settings.service.interruptions_max,
        };
        match self.store.claim(&request) {
            Ok(Some(job)) => Event::WorkClaimed(Claimed {
                lease: lease(&job.lease),
                work: work_of(&job),
            }),
            Ok(None) => Event::NothingToClaim,
            Err(error) => Event::ClaimFailed(failure(&error)),
        }
    }

    /// A lease that cannot be extended for want of a store is not lost yet.
    fn heartbeat(&self, lease: Lease, until_ns: i64) -> Event {
        let answer = self.store.heartbeat(&store_lease(lease), until_ns);
        Event::LeaseAnswered {
            job: lease.job,
            held: !matches!(answer, Ok(LeaseAnswer::Lost)),
        }
    }

    fn end_work(&self, lease: Lease, end: &WorkEnd, now_ns: i64) -> Event {
        let (job, held) = (lease.job, store_lease(lease));
        let answer = match end {
            WorkEnd::Complete { outcome } => self.store.complete(&held, outcome, now_ns),
            WorkEnd::Release => self.store.release(&held, now_ns),
            WorkEnd::Fail { error, retry_at_ns } => {
                let failure = JobFailure {
                    error,
                    retry_at_ns: *retry_at_ns,
                    failures_max: self.settings.service.failures_max,
                };
                self.store.fail(&held, &failure, now_ns)
            }
        };
        work_step(job, answer, |answer| Event::WorkEnded {
            job,
            parked: answer == LeaseAnswer::Parked,
        })
    }

    fn mark_published(&self, kind: DocumentKind, site: String, version: u64, now_ns: i64) -> Event {
        let marked = match kind {
            DocumentKind::Set => self.store.mark_published(&site, version, now_ns),
            DocumentKind::Diagnosis => self.store.mark_diagnosis_published(&site, version, now_ns),
        };
        match marked {
            Ok(_) => Event::PublicationMarked {
                kind,
                site,
                version,
            },
            Err(error) => Event::PublicationFailed {
                kind,
                site,
                version,
                failure: failure(&error),
            },
        }
    }

    fn measure(&self, now_ns: i64) -> Result<StoreMeasured, StoreError> {
        let answer = self.store.check().and_then(|()| self.store.counts(now_ns));
        let disk_free_bytes = self.store.disk_free_bytes();
        let has_space = disk_free_bytes.is_none_or(|free| free >= DISK_FREE_BYTES_MIN);
        self.health.set_store(answer.is_ok() && has_space);
        let counts = answer?;
        Ok(StoreMeasured {
            jobs_queued: counts.jobs_queued,
            jobs_claimed: counts.jobs_claimed,
            jobs_parked: counts.jobs_parked,
            oldest_due_job_age_ns: counts.oldest_due_job_age_ns,
            bytes: counts.bytes,
            disk_free_bytes,
        })
    }

    fn prune(&self, now_ns: i64) -> Result<StorePruned, StoreError> {
        let mut sum = StorePruned::default();
        let Some(keep) = &self.settings.keep else {
            return Ok(sum);
        };
        for _ in 0..PRUNE_CALLS_MAX {
            let pruned = self.store.prune(keep, now_ns)?;
            sum.waveforms += pruned.waveforms;
            sum.windows += pruned.windows;
            sum.fits += pruned.fits;
            sum.jobs += pruned.jobs;
            if !pruned.more {
                break;
            }
        }
        Ok(sum)
    }
}

/// Usable events from which on a joint fit or a diagnosis is made.
fn events_needed(kind: WorkKind, options: &ServiceOptions) -> usize {
    match kind {
        WorkKind::Event => 1,
        WorkKind::Site => options.joint_events_min,
        WorkKind::Diagnosis => options.diagnosis_events_min,
    }
}

fn window_step(
    window: &str,
    answer: Result<Saved, StoreError>,
    done: impl FnOnce(String) -> Event,
) -> Event {
    match answer {
        Ok(_) => done(window.to_owned()),
        Err(error) => Event::WindowStepFailed {
            window: window.to_owned(),
            failure: failure(&error),
        },
    }
}

fn work_step<T>(job: i64, answer: Result<T, StoreError>, done: impl FnOnce(T) -> Event) -> Event {
    match answer {
        Ok(value) => done(value),
        Err(error) => Event::WorkStepFailed {
            job,
            failure: failure(&error),
        },
    }
}

fn housekeeping<T: Occurrence + 'static>(result: Result<T, StoreError>) -> Event {
    Event::HousekeepingDone(match result {
        Ok(occurrence) => Ok(Box::new(occurrence)),
        Err(error) => Err(failure(&error)),
    })
}
