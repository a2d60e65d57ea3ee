//! Start, loop and end.

use std::{
    fmt, io,
    net::SocketAddr,
    sync::{
        Arc,
        mpsc::{Sender, SyncSender, sync_channel},
    },
    time::{Duration, Instant},
};

use tokio::{
    sync::mpsc::{self, Receiver, UnboundedReceiver, UnboundedSender},
    task::JoinHandle,
    time::{MissedTickBehavior, interval, timeout},
};
use tokio_util::sync::CancellationToken;

use super::{
    answers::{self, Task, Waiting},
    clock,
    decode::{Decoded, Decoder},
    fits::Fits,
    publisher,
    settings::Settings,
    status::{Status, StatusBoard},
    steps::Steps,
    systemd::Supervisor,
};
use crate::{
    adapters::{
        http::{self, Health},
        store::{SqliteStore, Store, StoreError},
        zenoh::{Drops, Entrance, Exits, Keys, Link, ZenohError, queues},
    },
    service::{Command, Event, State},
    telemetry::{
        Metrics, MetricsError, Occurrence,
        intake::{MessagesDropped, Source},
        process::{LoopMeasured, ServiceReady},
    },
};

/// Decoded messages that wait for the loop; the decoders wait when it is full, and the intake
/// queues before them drop and count.
const DECODED_MAX: usize = 256;
/// Period of the loop's tick.
const TICK: Duration = Duration::from_millis(200);
/// Longest wait for HTTP connections to end.
const HTTP_CLOSE_LIMIT: Duration = Duration::from_secs(1);

/// Is shown every occurrence beside the log and the metrics; must return at once.
pub type Observer = Arc<dyn Fn(&dyn Occurrence) + Send + Sync>;

/// Why the daemon did not start, or did not end well.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DaemonError {
    /// The store.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// Zenoh.
    #[error(transparent)]
    Zenoh(#[from] ZenohError),
    /// The metrics.
    #[error("the metrics cannot be declared: {0}")]
    Metrics(#[from] MetricsError),
    /// HTTP.
    #[error("cannot listen on {address}: {source}")]
    Http {
        /// Address.
        address: SocketAddr,
        /// What the system said.
        source: io::Error,
    },
    /// A thread could not be started.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] io::Error),
    /// A part of the daemon ended although it was not told to: a defect.
    #[error("the {part} ended unexpectedly")]
    PartEnded {
        /// Which one.
        part: &'static str,
    },
}

/// A daemon that runs.
pub struct Daemon {
    endpoints: Vec<String>,
    http: Option<SocketAddr>,
    board: Arc<StatusBoard>,
    store: Arc<dyn Store>,
    stop: CancellationToken,
    ended: CancellationToken,
    task: JoinHandle<Result<(), DaemonError>>,
}

impl fmt::Debug for Daemon {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Daemon")
            .field("endpoints", &self.endpoints)
            .field("http", &self.http)
            .finish_non_exhaustive()
    }
}

impl Daemon {
    /// Endpoints that zenoh really listens on.
    #[must_use]
    pub fn endpoints(&self) -> &[String] {
        &self.endpoints
    }

    /// Address of the HTTP server.
    #[must_use]
    pub const fn http_address(&self) -> Option<SocketAddr> {
        self.http
    }

    /// How it is doing.
    #[must_use]
    pub fn status(&self) -> Status {
        self.board.read()
    }

    /// Whether there is nothing left to do: nothing under way, no job, no set to be published.
    ///
    /// # Errors
    ///
    /// When the store does not answer.
    pub async fn settled(&self) -> Result<bool, DaemonError> {
        if !self.status().at_rest {
            return Ok(false);
        }
        let store = Arc::clone(&self.store);
        let counts = blocking(move || store.counts(clock::now_ns())).await??;
        Ok(counts.jobs_queued + counts.jobs_claimed + counts.sets_unpublished == 0)
    }

    /// Asks it to stop.
    pub fn stop(&self) {
        self.stop.cancel();
    }

    /// Whether it has ended.
    #[must_use]
    pub fn has_ended(&self) -> bool {
        self.task.is_finished()
    }

    /// Is ready when it has ended, for whatever reason.
    pub async fn ended(&self) {
        self.ended.cancelled().await;
    }

    /// Waits for its end.
    ///
    /// # Errors
    ///
    /// [`DaemonError::PartEnded`] when it did not end because it was asked to.
    pub async fn join(self) -> Result<(), DaemonError> {
        self.task
            .await
            .map_err(|_| DaemonError::PartEnded { part: "loop" })?
    }
}

/// Starts a daemon on the current tokio runtime, which must have several threads.
///
/// # Errors
///
/// [`DaemonError`] when the store, zenoh or HTTP cannot be had.
pub async fn start(settings: Settings, observer: Observer) -> Result<Daemon, DaemonError> {
    let started_ns = clock::now_ns();
    let settings = Arc::new(settings);
    let metrics = Arc::new(Metrics::new()?);
    metrics.set_process(env!("CARGO_PKG_VERSION"), started_ns as f64 / 1e9);
    let health = Arc::new(Health::new(clock::now_ns));
    let store = open_store(&settings).await?;
    health.set_store(true);
    let instance = &settings.service.instance;
    let (entrance, exits) = queues(settings.zenoh.intake_messages_max);
    let link = Link::open(&settings.zenoh, instance, &entrance).await?;
    health.set_zenoh(true);
    let stop = CancellationToken::new();
    let web = open_http(&settings, &store, &metrics, &health).await?;
    let board = Arc::new(StatusBoard::new(instance));
    let endpoints = link.endpoints().await;
    let parts = Parts {
        settings: Arc::clone(&settings),
        store: Arc::clone(&store),
        metrics,
        health,
        board: Arc::clone(&board),
        observer,
        link,
        entrance,
    };
    let (the_loop, inbox) = parts.assemble(exits)?;
    let http = web.as_ref().map(|web| web.address);
    the_loop.report(&ServiceReady {
        instance: instance.clone(),
        zenoh: endpoints.clone(),
        http: http.map(|address| address.to_string()),
    });
    let ended = CancellationToken::new();
    let guard = ended.clone().drop_guard();
    let running = the_loop.run(inbox, stop.clone(), web);
    let task = tokio::spawn(async move {
        let _guard = guard;
        running.await
    });
    Ok(Daemon {
        endpoints,
        http,
        board,
        store,
        stop,
        ended,
        task,
    })
}

/// Opens the store and tells it what is true from now on: these are the sites, and no job is in
/// the hands of an earlier run of this instance any more.
async fn open_store(settings: &Arc<Settings>) -> Result<Arc<dyn Store>, DaemonError> {
    let settings = Arc::clone(settings);
    let opened = blocking(move || -> Result<Arc<dyn Store>, StoreError> {
        let store = SqliteStore::open(&settings.store_path, &settings.store)?;
        let now_ns = clock::now_ns();
        for site in &settings.sites {
            store.save_site(&site.site, now_ns)?;
        }
        store.release_leases_of(&settings.service.instance, now_ns)?;
        Ok(Arc::new(store))
    });
    Ok(opened.await??)
}

/// The HTTP server.
struct Web {
    address: SocketAddr,
    stop: CancellationToken,
    task: JoinHandle<io::Result<()>>,
}

async fn open_http(
    settings: &Settings,
    store: &Arc<dyn Store>,
    metrics: &Arc<Metrics>,
    health: &Arc<Health>,
) -> Result<Option<Web>, DaemonError> {
    let Some(address) = settings.http.listen else {
        return Ok(None);
    };
    let (listener, bound) = http::bind(address)
        .await
        .map_err(|source| DaemonError::Http { address, source })?;
    let context = Arc::new(http::Context {
        store: Arc::clone(store),
        metrics: Arc::clone(metrics),
        health: Arc::clone(health),
        rows_max: settings.http.rows_max,
    });
    let stop = CancellationToken::new();
    let task = tokio::spawn(http::serve(
        listener,
        context,
        stop.clone().cancelled_owned(),
    ));
    Ok(Some(Web {
        address: bound,
        stop,
        task,
    }))
}

/// What the loop is made from.
struct Parts {
    settings: Arc<Settings>,
    store: Arc<dyn Store>,
    metrics: Arc<Metrics>,
    health: Arc<Health>,
    board: Arc<StatusBoard>,
    observer: Observer,
    link: Link,
    entrance: Entrance,
}

/// Where the loop hears from.
struct Inbox {
    decoded: Receiver<Decoded>,
    events: UnboundedReceiver<Event>,
}

impl Parts {
    fn assemble(self, exits: Exits) -> Result<(Loop, Inbox), DaemonError> {
        let (decoded_sender, decoded) = mpsc::channel(DECODED_MAX);
        let (events_sender, events) = mpsc::unbounded_channel();
        let (steps, steps_receiver) = std::sync::mpsc::channel();
        let (publisher, publisher_receiver) = mpsc::unbounded_channel();
        let (tasks, tasks_receiver) = sync_channel(answers::TASKS_MAX);
        let waiting = Arc::new(Waiting::default());
        let keys = Keys::new(&self.settings.zenoh.prefix);

        let decoder = Decoder::new(&self.settings);
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
            events_sender.clone(),
        );
        let the_loop = Loop {
            state: State::new(self.settings.service.clone(), self.settings.sites.clone()),
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

struct Loop {
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
    async fn run(
        mut self,
        mut inbox: Inbox,
        stop: CancellationToken,
        web: Option<Web>,
    ) -> Result<(), DaemonError> {
        self.supervisor.ready("taking measurements");
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
                Some(decoded) = inbox.decoded.recv() => self.take(decoded)?,
            };
            if next == Next::End {
                return Ok(());
            }
        }
    }

    fn begin_stop(&mut self) -> Result<Next, DaemonError> {
        self.supervisor.stopping();
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

    fn take(&mut self, decoded: Decoded) -> Result<Next, DaemonError> {
        match decoded {
            Decoded::Event(event) => self.apply(event),
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
        if matches!(event, Event::SetPublished { .. }) {
            self.parts.board.update(|status| status.sets_published += 1);
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
                    self.give_task(Task::Set(question, asked));
                }
            }
            Command::Refuse { question, reason } => {
                if let Some(question) = self.outlets.waiting.take(question) {
                    self.give_task(Task::Refuse(question, reason));
                }
            }
            Command::PublishSet(_) | Command::Announce { .. } => self
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
            let _: Result<(), _> = tokio::task::spawn_blocking(move || entrance.end()).await;
        });
    }

    fn report(&self, occurrence: &dyn Occurrence) {
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
            web.stop.cancel();
            let aborter = web.task.abort_handle();
            if timeout(HTTP_CLOSE_LIMIT, web.task).await.is_err() {
                aborter.abort();
            }
        }
        if !parts.link.close().await {
            tracing::warn!("zenoh did not close in time");
        }
        tracing::info!("stopped");
    }
}

async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, DaemonError> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|_| DaemonError::PartEnded { part: "store" })
}
