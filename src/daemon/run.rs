//! Start and end.

use std::{env, fmt, fs, io, net::SocketAddr, path::PathBuf, sync::Arc, time::Duration};

use tokio::{
    sync::mpsc::{UnboundedSender, unbounded_channel},
    task::JoinHandle,
    time::timeout,
};
use tokio_util::sync::CancellationToken;

use super::{
    clock,
    event_loop::Parts,
    settings::Settings,
    status::{Status, StatusBoard},
    structures,
};
use crate::{
    adapters::{
        http::{self, Actions, Change, Health, Token, TokenError, TokenSource},
        store::{SqliteStore, Store, StoreError},
        zenoh::{Link, ZenohError, queues},
    },
    measurement::Progress,
    service::Event,
    telemetry::{Metrics, MetricsError, Occurrence, process::ServiceReady},
};

/// Name of systemd's credential that holds the token.
const CREDENTIAL: &str = "http-token";
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
    /// The file of the token cannot be read.
    #[error("{}: {source}", .path.display())]
    TokenFile {
        /// File.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The file of the token holds none.
    #[error("{}: {source}", .path.display())]
    Token {
        /// File.
        path: PathBuf,
        /// What it should hold.
        source: TokenError,
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
        Ok(counts.jobs_queued
            + counts.jobs_claimed
            + counts.sets_unpublished
            + counts.diagnoses_unpublished
            == 0)
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
    let (store, progress) = open_store(&settings).await?;
    health.set_store(true);
    let instance = &settings.service.instance;
    let (entrance, exits) = queues(settings.zenoh.intake_messages_max, clock::now_ns);
    let link = Link::open(&settings.zenoh, instance, &entrance).await?;
    health.set_zenoh(true);
    let stop = CancellationToken::new();
    let (events_sender, events) = unbounded_channel();
    let actions = Actions::new(token(&settings.http.token)?, teller(events_sender.clone()));
    let web = open_http(&settings, &store, &metrics, &health, actions).await?;
    let board = Arc::new(StatusBoard::new(instance));
    let endpoints = link.endpoints().await;
    let parts = Parts {
        settings: Arc::clone(&settings),
        store: Arc::clone(&store),
        progress,
        metrics,
        health,
        board: Arc::clone(&board),
        observer,
        link,
        entrance,
    };
    let (the_loop, inbox) = parts.assemble(exits, (events_sender, events))?;
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
/// the hands of an earlier run of this instance any more. Also returns how far that run had come.
async fn open_store(
    settings: &Arc<Settings>,
) -> Result<(Arc<dyn Store>, Vec<(String, Progress)>), DaemonError> {
    let settings = Arc::clone(settings);
    let opened = blocking(move || -> Result<(Arc<dyn Store>, _), StoreError> {
        let store = SqliteStore::open(&settings.store_path, &settings.store)?;
        let now_ns = clock::now_ns();
        for site in &settings.sites {
            store.save_site(&site.site, now_ns)?;
        }
        structures::take_up_configured(&store, &settings, now_ns)?;
        store.release_leases_of(&settings.service.instance, now_ns)?;
        let progress = store.progress()?;
        Ok((Arc::new(store), progress))
    });
    Ok(opened.await??)
}

/// The HTTP server.
pub(super) struct Web {
    address: SocketAddr,
    stop: CancellationToken,
    task: JoinHandle<()>,
}

impl Web {
    /// Lets open answers end, within a limit.
    pub(super) async fn close(self) {
        self.stop.cancel();
        let aborter = self.task.abort_handle();
        if timeout(HTTP_CLOSE_LIMIT, self.task).await.is_err() {
            aborter.abort();
        }
    }
}

async fn open_http(
    settings: &Settings,
    store: &Arc<dyn Store>,
    metrics: &Arc<Metrics>,
    health: &Arc<Health>,
    actions: Actions,
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
        actions,
        open_pages: settings.http.open_pages,
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

/// What was done over HTTP becomes an event.
fn teller(events: UnboundedSender<Event>) -> impl Fn(Change) + Send + Sync + 'static {
    move |change| {
        let event = match change {
            Change::Structure(record) => Event::StructureChanged {
                site: record.site,
                structure: record.structure,
                origin: record.origin.name(),
                actor: record.actor,
            },
            Change::Sets {
                site,
                action,
                version,
                actor,
            } => Event::SetsChanged {
                site,
                action,
                version,
                actor,
            },
        };
        // Without a loop the service is ending; the next start finds the change in the store.
        events.send(event).ok();
    }
}

/// The token that opens the way to changes; none where there is none.
fn token(source: &TokenSource) -> Result<Option<Token>, DaemonError> {
    let path = match source {
        TokenSource::Given(token) => return Ok(Some(token.clone())),
        TokenSource::File(path) => path.clone(),
        TokenSource::Credential => {
            let directory = env::var_os("CREDENTIALS_DIRECTORY").map(PathBuf::from);
            match directory.map(|directory| directory.join(CREDENTIAL)) {
                Some(path) if path.exists() => path,
                _ => return Ok(None),
            }
        }
    };
    let text = fs::read_to_string(&path).map_err(|source| DaemonError::TokenFile {
        path: path.clone(),
        source,
    })?;
    Token::new(text.lines().next().unwrap_or_default())
        .map(Some)
        .map_err(|source| DaemonError::Token { path, source })
}

async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<T, DaemonError> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(|_| DaemonError::PartEnded { part: "store" })
}
