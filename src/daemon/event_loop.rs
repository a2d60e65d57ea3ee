//! The loop: the one owner of the state. It selects what happened, has the state decide, and hands
//! the commands to whoever carries them out.

use std::{
    sync::{
        Arc,
        mpsc::{Sender, SyncSender, sync_channel},
    },
    time::{Duration, Instant},
};

use tokio::{
    sync::mpsc::{self, Receiver, UnboundedReceiver, UnboundedSender},
    time::{MissedTickBehavior, interval, timeout},
};
use tokio_util::sync::CancellationToken;

use super::{
    DaemonError, Observer,
    answers::{self, Task, Waiting},
    clock,
    decode::{Decoded, Decoder},
    fits::Fits,
    frames, publisher,
    run::Web,
    settings::Settings,
    status::StatusBoard,
    steps::Steps,
    systemd::{self, Supervisor},
};
use crate::{
    adapters::{
        http::Health,
        store::Store,
        zenoh::{Drops, Entrance, Exits, Keys, Link},
    },
    measurement::Progress,
    service::{Command, DocumentKind, Event, State},
    telemetry::{
        Metrics, Occurrence,
        intake::{MessageThrough, MessagesDropped, Source},
        process::LoopMeasured,
    },
};

/// Groups of decoded messages that wait for the loop; the decoders wait when there are as many, and the
/// intake queues before them drop and count.
const GROUPS_MAX: usize = 16;
/// Period of the loop's tick.
const TICK: Duration = Duration::from_millis(200);

/// What the loop is made from.
pub(super) struct Parts {
    pub(super) settings: Arc<Settings>,
    pub(super) store: Arc<dyn Store>,
    /// How far an earlier run had come.
    pub(super) progress: Vec<(String, Progress)>,
    pub(super) metrics: Arc<Metrics>,
    pub(super) health: Arc<Health>,
    pub(super) board: Arc<StatusBoard>,
    pub(super) observer: Observer,
    pub(super) link: Link,
    pub(super) entrance: Entrance,
}

/// Where the loop hears from.
pub(super) struct Inbox {
    decoded: Receiver<Vec<Decoded>>,
    events: UnboundedReceiver<Event>,
}

impl Parts {
    /// `(events_sender, events)` is where everybody reports to the loop.
    pub(super) fn assemble(
        mut self,
        exits: Exits,
        (events_sender, events): (UnboundedSender<Event>, UnboundedReceiver<Event>),
    ) -> Result<(Loop, Inbox), DaemonError> {
        let (decoded_sender, decoded) = mpsc::channel(GROUPS_MAX);
        let (steps, steps_receiver) = std::sync::mpsc::channel();
        let (publisher, publisher_receiver) = mpsc::unbounded_channel();
        let (tasks, tasks_receiver) = sync_channel(answers::TASKS_MAX);
        let waiting = Arc::new(Waiting::default());
        let keys = Keys::new(&self.settings.zenoh.prefix);

        let (wanted, wanted_receiver) = frames::questions();
        let decoder = Decoder::new(&self.settings, wanted);
        frames::spawn_asker(
            self.link.publisher(),
            self.entrance.clone(),
            wanted_receiver,
        );
        decoder
            .clone()
            .spawn("batches", exits.measurements, decoded_sender.clone())?;
        decoder.spawn("recordings", exits.recordings, decoded_sender)?;
        let store_thread = Steps {
            store: Arc::clone(&self.store),
            settings: Arc::clone(&self.settings),
            health: Arc::clone(&self.health),
        }
        .spawn(steps_receiver, events_sender.clone())?;
        answers::spawn_sorter(
            keys.clone(),
            Arc::clone(&waiting),
            exits.questions,
            events_sender.clone(),
            tasks.clone(),
        )?;
        answers::spawn_answerer(
            Arc::clone(&self.store),
            keys,
            Arc::clone(&self.board),
            tasks_receiver,
            events_sender.clone(),
        )?;
        publisher::spawn(
            self.link.publisher(),
            publisher_receiver,
            events_sender.clone(),
        );
        let fits = Fits::new(
            Arc::clone(&self.store),
            Arc::clone(&self.settings),
            Arc::clone(self.health.work()),
            events_sender.clone(),
        );
        let progress = std::mem::take(&mut self.progress);
        let state = State::new(self.settings.service.clone(), self.settings.sites.clone());
        let the_loop = Loop {
            state: state.resuming(progress),
            outlets: Outlets {
                steps,
                publisher,
                tasks,
                waiting,
                fits,
            },
            store_thread,
            events_sender,
            drops: exits.drops,
            supervisor: Supervisor::new(),
            queues_open: 2,
            longest_step: Duration::ZERO,
            parts: self,
        };
        Ok((the_loop, Inbox { decoded, events }))
    }
}

/// Where commands go.
struct Outlets {
    steps: Sender<Command>,
    publisher: UnboundedSender<Command>,
    tasks: SyncSender<Task>,
    waiting: Arc<Waiting>,
    fits: Fits,
}

/// The loop and everything it hands commands to.
pub(super) struct Loop {
    parts: Parts,
    state: State,
    outlets: Outlets,
    store_thread: std::thread::JoinHandle<()>,
    events_sender: UnboundedSender<Event>,
    drops: Arc<Drops>,
    supervisor: Supervisor,
    /// Intake queues that have not come to their end.
    queues_open: usize,
    longest_step: Duration,
}

/// Whether the loop goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    Continue,
    End,
}

impl Loop {
    pub(super) async fn run(
        mut self,
        mut inbox: Inbox,
        stop: CancellationToken,
        web: Option<Web>,
    ) -> Result<(), DaemonError> {
        systemd::ready("taking measurements");
        let result = self.select(&mut inbox, &stop).await;
        // Dropping the inbox releases whoever still wants to report.
        drop(inbox);
        self.end(web).await;
        result
    }

    async fn select(
        &mut self,
        inbox: &mut Inbox,
        stop: &CancellationToken,
    ) -> Result<(), DaemonError> {
        let mut tick = interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut stopping = false;
        loop {
            let next = tokio::select! {
                biased;
                () = stop.cancelled(), if !stopping => {
                    stopping = true;
                    self.begin_stop()?
                }
                _ = tick.tick() => self.tick()?,
                Some(event) = inbox.events.recv() => self.apply(event)?,
                Some(group) = inbox.decoded.recv() => self.take_group(group)?,
            };
            if next == Next::End {
                return Ok(());
            }
        }
    }

    fn begin_stop(&mut self) -> Result<Next, DaemonError> {
        systemd::stopping();
        self.parts.health.set_stopping();
        self.parts.board.update(|status| status.stopping = true);
        self.apply(Event::StopRequested)
    }

    fn tick(&mut self) -> Result<Next, DaemonError> {
        let sources = [Source::Measurement, Source::Recording, Source::Query];
        for (source, messages) in sources.into_iter().zip(self.drops.take()) {
            if messages > 0 {
                self.apply(Event::MessagesDropped { source, messages })?;
            }
        }
        let next = self.apply(Event::Tick)?;
        self.supervisor.alive();
        self.parts.health.progress(clock::now_ns());
        self.parts.health.set_zenoh(self.parts.link.is_open());
        let (at_rest, fits_running) = (self.state.at_rest(), self.state.fits_running());
        self.parts.board.update(|status| {
            status.at_rest = at_rest;
            status.fits_running = fits_running;
            status.ticks += 1;
        });
        self.report(&LoopMeasured {
            longest_step_ns: clock::nanoseconds(self.longest_step),
        });
        self.longest_step = Duration::ZERO;
        Ok(next)
    }

    fn take_group(&mut self, group: Vec<Decoded>) -> Result<Next, DaemonError> {
        for decoded in group {
            if self.take(decoded)? == Next::End {
                return Ok(Next::End);
            }
        }
        Ok(Next::Continue)
    }

    fn take(&mut self, decoded: Decoded) -> Result<Next, DaemonError> {
        match decoded {
            Decoded::Event(event) => self.apply(event),
            Decoded::Measured { events, arrived_ns } => {
                for event in events {
                    if self.apply(event)? == Next::End {
                        return Ok(Next::End);
                    }
                }
                let took_ns = clock::now_ns().saturating_sub(arrived_ns);
                self.report(&MessageThrough { took_ns });
                Ok(Next::Continue)
            }
            Decoded::Barrier(question) => {
                self.give_task(Task::Status(question));
                Ok(Next::Continue)
            }
            Decoded::End => {
                self.queues_open = self.queues_open.saturating_sub(1);
                if self.queues_open == 0 {
                    return self.apply(Event::IntakeStopped);
                }
                Ok(Next::Continue)
            }
        }
    }

    fn apply(&mut self, event: Event) -> Result<Next, DaemonError> {
        let started: Instant = clock::instant();
        match event {
            Event::Published {
                kind: DocumentKind::Set,
                ..
            } => self.parts.board.update(|status| status.sets_published += 1),
            Event::Published {
                kind: DocumentKind::Diagnosis,
                ..
            } => self
                .parts
                .board
                .update(|status| status.diagnoses_published += 1),
            _ => {}
        }
        let commands = self.state.apply(clock::now_ns(), event);
        let mut next = Next::Continue;
        for command in commands {
            if self.carry_out(command)? == Next::End {
                next = Next::End;
            }
        }
        self.longest_step = self.longest_step.max(started.elapsed());
        Ok(next)
    }

    fn carry_out(&mut self, command: Command) -> Result<Next, DaemonError> {
        match command {
            Command::Report(occurrence) => self.report(occurrence.as_ref()),
            Command::Stop => return Ok(Next::End),
            Command::StopIntake => self.stop_intake(),
            Command::RunFit(claimed) => self.outlets.fits.run(claimed),
            Command::CancelFit { job } => self.outlets.fits.cancel(job),
            Command::Answer { question, asked } => {
                if let Some(question) = self.outlets.waiting.take(question) {
                    self.give_task(Task::Document(question, asked));
                }
            }
            Command::Refuse { question, reason } => {
                if let Some(question) = self.outlets.waiting.take(question) {
                    self.give_task(Task::Refuse(question, reason));
                }
            }
            Command::Publish(_) | Command::Announce { .. } => self
                .outlets
                .publisher
                .send(command)
                .map_err(|_| DaemonError::PartEnded { part: "publisher" })?,
            _ => self
                .outlets
                .steps
                .send(command)
                .map_err(|_| DaemonError::PartEnded {
                    part: "store's thread",
                })?,
        }
        Ok(Next::Continue)
    }

    /// A full queue of tasks drops the question: whoever asked sees that nobody answered.
    fn give_task(&self, task: Task) {
        if self.outlets.tasks.try_send(task).is_err() {
            self.report(&MessagesDropped {
                source: Source::Query,
                messages: 1,
            });
        }
    }

    /// Undeclares the subscribers, then marks the end of the queues behind what is in them.
    fn stop_intake(&mut self) {
        let undeclared = self.parts.link.stop_intake();
        let entrance = self.parts.entrance.clone();
        tokio::spawn(async move {
            undeclared.await;
            tokio::task::spawn_blocking(move || entrance.end())
                .await
                .ok();
        });
    }

    pub(super) fn report(&self, occurrence: &dyn Occurrence) {
        occurrence.emit(&self.parts.metrics);
        (self.parts.observer)(occurrence);
    }

    /// The end of the end: the store's thread carries out what it was given, then HTTP and zenoh
    /// close, each within its limit.
    async fn end(self, web: Option<Web>) {
        let Self {
            parts,
            outlets,
            store_thread,
            events_sender,
            ..
        } = self;
        drop((outlets, events_sender));
        let grace = clock::duration(parts.settings.service.shutdown_grace_ns);
        let joined = tokio::task::spawn_blocking(move || store_thread.join());
        if timeout(grace, joined).await.is_err() {
            tracing::error!("the store did not finish in time");
        }
        if let Some(web) = web {
            web.close().await;
        }
        if !parts.link.close().await {
            tracing::warn!("zenoh did not close in time");
        }
        tracing::info!("stopped");
    }
}
