//! The one owner of the service's state, and the only place where it changes.

mod publication;

use std::{collections::BTreeMap, sync::Arc};

use super::{
    Backlog, BacklogPart, Command, Event, Failure, ServiceOptions, SiteOptions, Work, fits::Fits,
    outbox::Outbox, publishing::Publishing, streams::Streams, windows::Windows,
};
use crate::{
    disturbance::Window,
    measurement::Progress,
    telemetry::{
        diagnoses::{SetsChanged, StructureChanged},
        intake::{MessagesDropped, PayloadRefused},
        jobs::{JobNotNeeded, JobQueued},
        process::{GraceExceeded, ServiceStopping},
        store::{StoreFailed, WorkTakenUp},
        windows::EventAnnounced,
    },
};

/// Time between measurements of the store, nanoseconds.
const MEASURE_NS: i64 = 15_000_000_000;
/// Time between two rounds of retention, nanoseconds.
const PRUNE_NS: i64 = 3_600_000_000_000;
/// Time between two writes of how far the sites have come: what a crash may count as passed over too much.
const PROGRESS_NS: i64 = 1_000_000_000;
/// A burst of events postpones a joint fit by at most this many settling times.
const SETTLE_TIMES_MAX: i64 = 10;

/// The state of the service.
///
/// [`State::apply`] is a function of the state, the time and the event; whatever is to be done in
/// the world comes back as commands. The order of a window's steps is fixed here: stored, screened,
/// announced, queued, fitted, decided on, published.
#[derive(Debug)]
pub struct State {
    options: ServiceOptions,
    streams: Streams,
    windows: Windows,
    fits: Fits,
    publishing: Publishing,
    /// Looks for documents to be published that have not been answered.
    documents_loading: usize,
    /// Jobs on their way to the queue.
    queueing: usize,
    /// Since when a joint fit of a site has been postponed.
    postponed_since_ns: BTreeMap<String, i64>,
    questions: usize,
    sweep: Sweep,
    measure_at_ns: i64,
    prune_at_ns: i64,
    /// Measurements and rounds of retention that the store has not answered.
    housekeeping: usize,
    /// When the sites' progress is written next; none while the store is at it.
    progress_at_ns: Option<i64>,
    phase: Phase,
}

#[derive(Debug)]
struct Sweep {
    part: BacklogPart,
    due_ns: i64,
    in_flight: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Running,
    /// The order is: no more intake, streams ended, windows stored, fits ended or given back.
    Stopping {
        cancel_at_ns: i64,
        deadline_ns: i64,
        intake_stopped: bool,
    },
    Stopped,
}

impl State {
    /// A service that has taken nothing in yet. Its first tick looks for what was left behind.
    #[must_use]
    pub fn new(options: ServiceOptions, sites: Vec<SiteOptions>) -> Self {
        Self {
            windows: Windows::new(&options, sites.len()),
            streams: Streams::new(sites, options.silence_ns),
            fits: Fits::new(),
            publishing: Publishing::default(),
            documents_loading: 0,
            queueing: 0,
            postponed_since_ns: BTreeMap::new(),
            questions: 0,
            sweep: Sweep {
                part: BacklogPart::Everything,
                due_ns: i64::MIN,
                in_flight: false,
            },
            measure_at_ns: i64::MIN,
            prune_at_ns: i64::MIN,
            housekeeping: 0,
            progress_at_ns: Some(i64::MIN),
            phase: Phase::Running,
            options,
        }
    }

    /// The same, going on where an earlier run had come to: what passed in between is counted.
    #[must_use]
    pub fn resuming(mut self, progress: Vec<(String, Progress)>) -> Self {
        self.streams.resume(progress);
        self
    }

    /// What follows from an event at `now_ns` (UTC, nanoseconds).
    #[must_use]
    pub fn apply(&mut self, now_ns: i64, event: Event) -> Vec<Command> {
        let mut out = Outbox::default();
        self.take(now_ns, event, &mut out);
        self.fits.claim(now_ns, &self.options, &mut out);
        self.stop_when_done(now_ns, &mut out);
        out.into_commands()
    }

    /// Whether nothing is under way and nothing waits for more samples. Jobs in the store that are
    /// not due yet are not known here.
    #[must_use]
    pub fn at_rest(&self) -> bool {
        self.streams.at_rest()
            && self.windows.at_rest()
            && self.fits.at_rest()
            && self.publishing.at_rest()
            && self.queueing + self.documents_loading == 0
            && !self.sweep.in_flight
            && self.sweep.part != BacklogPart::Everything
    }

    /// Fits that run.
    #[must_use]
    pub fn fits_running(&self) -> usize {
        self.fits.count()
    }

    fn take(&mut self, now_ns: i64, event: Event, out: &mut Outbox) {
        match event {
            Event::BatchDecoded(_)
            | Event::FramesDecoded(_)
            | Event::RecordingDecoded(_)
            | Event::PayloadRefused { .. }
            | Event::MessagesDropped { .. } => self.take_measurement(now_ns, event, out),
            Event::WindowStored { .. }
            | Event::WindowNotStored { .. }
            | Event::ScreeningStored { .. }
            | Event::EventAnnounced { .. }
            | Event::AnnouncementMarked { .. }
            | Event::WindowStepFailed { .. } => self.take_window_step(now_ns, event, out),
            Event::WorkQueued { .. }
            | Event::WorkNotNeeded { .. }
            | Event::WorkNotQueued { .. }
            | Event::WorkClaimed(_)
            | Event::NothingToClaim
            | Event::ClaimFailed(_)
            | Event::LeaseAnswered { .. }
            | Event::FitEnded { .. }
            | Event::FitStored { .. }
            | Event::DiagnosisStored { .. }
            | Event::DecisionCommitted { .. }
            | Event::WorkEnded { .. }
            | Event::WorkStepFailed { .. } => self.take_work_step(now_ns, event, out),
            Event::Published { .. }
            | Event::PublicationMarked { .. }
            | Event::PublicationFailed { .. }
            | Event::DocumentAsked { .. }
            | Event::QuestionAnswered { .. } => self.take_publication(now_ns, event, out),
            Event::StructureChanged { .. } | Event::SetsChanged { .. } => {
                self.take_change(now_ns, event, out);
            }
            Event::BacklogLoaded(part, backlog) => {
                self.answered(part);
                let taken = self.take_up(now_ns, backlog, out);
                if part != BacklogPart::Unpublished {
                    out.report(taken);
                }
            }
            Event::BacklogFailed(part, failure) => {
                self.answered(part);
                report_failure(failure, true, out);
                self.sweep_soon(now_ns, part);
            }
            Event::HousekeepingDone(result) => {
                self.housekeeping = self.housekeeping.saturating_sub(1);
                match result {
                    Ok(occurrence) => out.push(Command::Report(occurrence)),
                    Err(failure) => report_failure(failure, true, out),
                }
            }
            Event::ProgressKept(result) => {
                self.streams.progress_answered(result.is_ok());
                let pause_ns = match result {
                    Ok(()) => PROGRESS_NS,
                    Err(failure) => {
                        report_failure(failure, true, out);
                        PROGRESS_NS.max(self.options.store_retry_ns)
                    }
                };
                self.progress_at_ns = Some(now_ns.saturating_add(pause_ns));
            }
            Event::Tick => self.tick(now_ns, out),
            Event::StopRequested => self.begin_stop(now_ns, out),
            Event::IntakeStopped => self.end_streams(out),
        }
    }

    fn take_measurement(&mut self, now_ns: i64, event: Event, out: &mut Outbox) {
        match event {
            Event::BatchDecoded(batch) => {
                let windows = self.streams.push(now_ns, &batch, out);
                self.found(windows, out);
            }
            Event::FramesDecoded(frames) => out.report(frames),
            Event::RecordingDecoded(recording) => {
                let window = self.streams.push_recording(recording, out);
                self.found(window, out);
            }
            Event::PayloadRefused {
                source,
                key,
                reason,
                error,
            } => out.report(PayloadRefused {
                source,
                key,
                reason,
                error,
            }),
            Event::MessagesDropped { source, messages } => {
                out.report(MessagesDropped { source, messages });
            }
            _ => {}
        }
    }

    fn found(&mut self, windows: impl IntoIterator<Item = Window>, out: &mut Outbox) {
        for window in windows {
            self.windows.found(window, out);
        }
    }

    fn take_window_step(&mut self, now_ns: i64, event: Event, out: &mut Outbox) {
        match event {
            Event::WindowStored { window, known } => {
                if let Some(window) = self.windows.stored(&window, known, out) {
                    self.screen(now_ns, &window, out);
                }
            }
            Event::WindowNotStored { window, failure } => {
                self.windows.not_stored(now_ns, &window, failure, out);
            }
            Event::ScreeningStored { window } => {
                if let Some((window, screening)) = self.windows.under_way(&window) {
                    if screening.usable() {
                        self.queue(now_ns, Work::event(&window.site, &window.id), out);
                        self.queue(now_ns, Work::site(&window.site), out);
                    }
                    self.windows.announce(window, screening, out);
                }
            }
            Event::EventAnnounced { window } => {
                out.report(EventAnnounced {
                    window: window.clone(),
                });
                out.push(Command::MarkAnnounced { window });
            }
            Event::AnnouncementMarked { window } => self.windows.leave(&window),
            Event::WindowStepFailed { window, failure } => {
                report_failure(failure, true, out);
                self.windows.leave(&window);
                self.sweep_soon(now_ns, BacklogPart::Everything);
            }
            _ => {}
        }
    }

    fn screen(&mut self, now_ns: i64, window: &Arc<Window>, out: &mut Outbox) {
        let screening = self.streams.screen(window);
        if !self.windows.screened(window, screening, out) {
            self.sweep_soon(now_ns, BacklogPart::Everything);
        }
    }

    fn queue(&mut self, now_ns: i64, work: Work, out: &mut Outbox) {
        let due_ns = match work.kind {
            super::WorkKind::Event | super::WorkKind::Diagnosis => now_ns,
            super::WorkKind::Site => self.settled_ns(now_ns, &work.site),
        };
        self.queueing += 1;
        out.push(Command::Queue { work, due_ns });
    }

    /// When a site's joint fit is due: after a quiet time, which a burst of events may renew only
    /// so many times.
    fn settled_ns(&mut self, now_ns: i64, site: &str) -> i64 {
        let settle_ns = self.options.settle_ns;
        let since_ns = *self
            .postponed_since_ns
            .entry(site.to_owned())
            .or_insert(now_ns);
        let latest_ns = since_ns.saturating_add(settle_ns.saturating_mul(SETTLE_TIMES_MAX));
        now_ns.saturating_add(settle_ns).min(latest_ns)
    }

    fn take_work_step(&mut self, now_ns: i64, event: Event, out: &mut Outbox) {
        if let Event::WorkQueued { .. }
        | Event::WorkNotNeeded { .. }
        | Event::WorkNotQueued { .. } = event
        {
            self.queueing = self.queueing.saturating_sub(1);
        }
        let options = &self.options;
        match event {
            Event::WorkQueued { work, known } => {
                out.report(JobQueued {
                    kind: work.kind.name(),
                    subject: work.subject,
                    known,
                });
                self.fits.look_now();
            }
            Event::WorkNotNeeded { work, reason } => {
                out.report(JobNotNeeded {
                    kind: work.kind.name(),
                    subject: work.subject,
                    reason,
                });
            }
            Event::WorkNotQueued { failure, .. } => {
                report_failure(failure, true, out);
                self.sweep_soon(now_ns, BacklogPart::Everything);
            }
            Event::WorkClaimed(claimed) => {
                self.postponed_since_ns.remove(&claimed.work.subject);
                self.fits.claimed(now_ns, claimed, options, out);
            }
            Event::NothingToClaim => self.fits.nothing_claimed(now_ns),
            Event::ClaimFailed(failure) => {
                self.fits.nothing_claimed(now_ns);
                report_failure(failure, true, out);
            }
            Event::LeaseAnswered { job, held } => self.fits.lease_answered(job, held, out),
            Event::FitEnded { job, end } => self.fit_ended(now_ns, job, end, out),
            Event::FitStored { job, fit } => self.fits.fit_stored(job, fit, options, out),
            Event::DecisionCommitted {
                job,
                version,
                known,
            } => {
                let site = self.fits.committed(job, version, known, out);
                if version.is_some() {
                    self.load_unpublished(out);
                }
                if let Some(site) = site {
                    self.queue_diagnosis(now_ns, &site, out);
                }
            }
            Event::DiagnosisStored {
                job,
                version,
                known,
            } => {
                self.fits.diagnosis_stored(job, version, known, out);
                self.load_unpublished(out);
            }
            Event::WorkEnded { job, parked } => self.fits.ended(job, parked, out),
            Event::WorkStepFailed { job, failure } => {
                self.fits.step_failed(now_ns, job, failure, options, out);
            }
            _ => {}
        }
    }

    /// A joint fit of the site has been decided on: what does its model miss?
    fn queue_diagnosis(&mut self, now_ns: i64, site: &str, out: &mut Outbox) {
        // A service that is stopping leaves it to the next start.
        if self.options.diagnose && self.phase == Phase::Running {
            self.queue(now_ns, Work::diagnosis(site), out);
        }
    }

    /// Somebody has changed what is to be fitted, or which set counts.
    fn take_change(&mut self, now_ns: i64, event: Event, out: &mut Outbox) {
        match event {
            Event::StructureChanged {
                site,
                structure,
                origin,
                actor,
            } => {
                self.queue_refit(now_ns, &site, out);
                out.report(StructureChanged {
                    site,
                    structure,
                    origin,
                    actor,
                });
            }
            Event::SetsChanged {
                site,
                action,
                version,
                actor,
            } => {
                self.load_unpublished(out);
                out.report(SetsChanged {
                    site,
                    action,
                    version,
                    actor,
                });
            }
            _ => {}
        }
    }

    /// A joint fit without the quiet time that a burst of events asks for: somebody waits for it.
    fn queue_refit(&mut self, now_ns: i64, site: &str, out: &mut Outbox) {
        self.queueing += 1;
        out.push(Command::Queue {
            work: Work::site(site),
            due_ns: now_ns,
        });
    }

    /// Takes up what the store holds and nobody works on.
    fn take_up(&mut self, now_ns: i64, backlog: Backlog, out: &mut Outbox) -> WorkTakenUp {
        let mut taken = WorkTakenUp::default();
        for window in backlog.unscreened {
            if !self.windows.knows(&window.id) {
                taken.windows += 1;
                self.screen(now_ns, &window, out);
            }
        }
        for (window, screening) in backlog.unannounced {
            if !self.windows.knows(&window.id) && self.windows.announce(window, screening, out) {
                taken.events += 1;
            }
        }
        for set in backlog.unpublished {
            taken.sets += usize::from(self.publishing.begin(set, out));
        }
        for (site, windows) in backlog.usable {
            for window in &windows {
                self.queue(now_ns, Work::event(&site, window), out);
            }
            self.queue(now_ns, Work::site(&site), out);
            self.queue_diagnosis(now_ns, &site, out);
        }
        for site in backlog.restructured {
            self.queue_refit(now_ns, &site, out);
        }
        if backlog.more {
            self.sweep_soon(now_ns, BacklogPart::WindowsAndUnpublished);
        }
        taken
    }

    /// What is to be published alone is asked for out of turn, after each decision or diagnosis.
    const fn answered(&mut self, part: BacklogPart) {
        match part {
            BacklogPart::Unpublished => {
                self.documents_loading = self.documents_loading.saturating_sub(1);
            }
            BacklogPart::Everything | BacklogPart::WindowsAndUnpublished => {
                self.sweep.in_flight = false;
            }
        }
    }

    fn tick(&mut self, now_ns: i64, out: &mut Outbox) {
        let ended = self.streams.end_silent(now_ns, out);
        self.found(ended, out);
        self.windows.retry(now_ns, out);
        self.fits.tick(now_ns, &self.options, out);
        self.publishing.tick(now_ns, out);
        if now_ns >= self.sweep.due_ns && !self.sweep.in_flight {
            self.sweep.in_flight = true;
            out.push(Command::LoadBacklog(self.sweep.part));
            self.sweep.part = BacklogPart::WindowsAndUnpublished;
            self.sweep.due_ns = now_ns.saturating_add(self.options.sweep_ns);
        }
        if self.progress_at_ns.is_some_and(|at_ns| now_ns >= at_ns) {
            self.keep_progress(out);
        }
        self.keep_house(now_ns, out);
    }

    /// Not while the store is slow: what it has not done yet would only gather.
    fn keep_house(&mut self, now_ns: i64, out: &mut Outbox) {
        if self.housekeeping > 0 {
            return;
        }
        if now_ns >= self.measure_at_ns {
            self.measure_at_ns = now_ns.saturating_add(MEASURE_NS);
            self.housekeeping += 1;
            out.push(Command::MeasureStore);
        }
        if now_ns >= self.prune_at_ns {
            self.prune_at_ns = now_ns.saturating_add(PRUNE_NS);
            self.housekeeping += 1;
            out.push(Command::Prune);
        }
    }

    fn keep_progress(&mut self, out: &mut Outbox) {
        let progress = self.streams.progress();
        if !progress.is_empty() {
            self.progress_at_ns = None;
            out.push(Command::KeepProgress(progress));
        }
    }

    fn sweep_soon(&mut self, now_ns: i64, part: BacklogPart) {
        let soon_ns = now_ns.saturating_add(self.options.store_retry_ns);
        self.sweep.due_ns = self.sweep.due_ns.min(soon_ns);
        if part == BacklogPart::Everything {
            self.sweep.part = part;
        }
    }

    fn begin_stop(&mut self, now_ns: i64, out: &mut Outbox) {
        if self.phase != Phase::Running {
            return;
        }
        let grace_ns = self.options.shutdown_grace_ns;
        self.phase = Phase::Stopping {
            cancel_at_ns: now_ns.saturating_add(grace_ns / 2),
            deadline_ns: now_ns.saturating_add(grace_ns),
            intake_stopped: false,
        };
        out.report(ServiceStopping {
            fits: self.fits.count(),
            windows: self.windows.spooled(),
        });
        self.fits.close(out);
        out.push(Command::StopIntake);
    }

    fn end_streams(&mut self, out: &mut Outbox) {
        if let Phase::Stopping { intake_stopped, .. } = &mut self.phase {
            *intake_stopped = true;
        }
        let ended = self.streams.end_all(out);
        self.found(ended, out);
        self.keep_progress(out);
    }

    fn stop_when_done(&mut self, now_ns: i64, out: &mut Outbox) {
        let Phase::Stopping {
            cancel_at_ns,
            deadline_ns,
            intake_stopped,
        } = self.phase
        else {
            return;
        };
        if now_ns >= cancel_at_ns {
            self.fits.cancel_all(out);
        }
        let done = intake_stopped
            && self.windows.at_rest()
            && self.fits.at_rest()
            && self.queueing + self.documents_loading == 0
            && self.publishing.at_rest();
        if !done && now_ns < deadline_ns {
            return;
        }
        if !done {
            out.report(GraceExceeded {
                fits: self.fits.count(),
                windows: self.windows.spooled(),
            });
        }
        self.phase = Phase::Stopped;
        out.push(Command::Stop);
    }
}

fn report_failure(failure: Failure, retried: bool, out: &mut Outbox) {
    out.report(StoreFailed {
        reason: failure.reason,
        error: failure.error,
        retried,
    });
}
