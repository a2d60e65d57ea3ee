//! Connections: how many there are at a time, and how long one may keep its place without asking for
//! anything or taking what it asked for. Whoever opens many and says nothing costs others a wait, not the
//! service its file descriptors.

use std::{
    io,
    pin::{Pin, pin},
    sync::Arc,
    task::{Context, Poll},
    time::Duration,
};

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    server::graceful::GracefulShutdown,
    service::TowerToHyperService,
};
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    net::{TcpListener, TcpStream},
    sync::{OwnedSemaphorePermit, Semaphore},
    time::{Sleep, sleep},
};

use crate::telemetry::{Metrics, Occurrence, process::ConnectionWaited};

/// Time without accepting after the system refused a connection, for example for want of file descriptors.
const RECOVERY: Duration = Duration::from_secs(1);
/// Bytes of a request's head at most, and of a body that is read ahead.
const BUFFER_BYTES_MAX: usize = 64 * 1024;

/// What bounds the connections.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Connections at one time; more wait in the system's queue.
    pub(super) connections_max: usize,
    /// Longest time from the opening of a connection, or from the end of an answer, to the end of a request's head.
    pub(super) head: Duration,
    /// Longest time in which a reader takes nothing of an answer.
    pub(super) stall: Duration,
}

impl Default for Limits {
    /// 256 connections are 40 browsers with all of theirs, and a quarter of the usual 1,024 file descriptors.
    fn default() -> Self {
        Self {
            connections_max: 256,
            head: Duration::from_secs(10),
            stall: Duration::from_secs(30),
        }
    }
}

/// Serves until `stop` is ready, and then what has been asked for by then.
pub(super) async fn serve(
    listener: TcpListener,
    router: Router,
    metrics: &Metrics,
    limits: Limits,
    stop: impl Future<Output = ()>,
) {
    let seats = Arc::new(Semaphore::new(limits.connections_max));
    let open = GracefulShutdown::new();
    let mut stop = pin!(stop);
    loop {
        let (stream, seat) = tokio::select! {
            biased;
            () = &mut stop => break,
            accepted = accept(&listener, &seats, metrics) => accepted,
        };
        let connection = http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(limits.head)
            .max_buf_size(BUFFER_BYTES_MAX)
            .serve_connection(
                TokioIo::new(Watched::new(stream, limits.stall)),
                TowerToHyperService::new(router.clone()),
            );
        let connection = open.watch(connection);
        tokio::spawn(async move {
            if let Err(error) = connection.await {
                tracing::trace!(%error, "a connection ended early");
            }
            drop(seat);
        });
    }
    drop(listener);
    open.shutdown().await;
}

/// The next connection, once there is a place for it.
async fn accept(
    listener: &TcpListener,
    seats: &Arc<Semaphore>,
    metrics: &Metrics,
) -> (TcpStream, OwnedSemaphorePermit) {
    loop {
        let full = seats.available_permits() == 0;
        let Ok(seat) = Arc::clone(seats).acquire_owned().await else {
            // Nobody closes the semaphore.
            std::future::pending::<()>().await;
            continue;
        };
        match listener.accept().await {
            Ok((stream, _)) => {
                if full {
                    ConnectionWaited.emit(metrics);
                }
                return (stream, seat);
            }
            Err(error) if of_the_peer(&error) => {}
            Err(error) => {
                tracing::warn!(%error, "no connection can be accepted");
                sleep(RECOVERY).await;
            }
        }
    }
}

/// Whether only the connection that was to be accepted is lost.
fn of_the_peer(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(
        error.kind(),
        ConnectionAborted | ConnectionRefused | ConnectionReset
    )
}

/// A connection that fails when its reader takes nothing for too long.
struct Watched {
    stream: TcpStream,
    stall: Duration,
    /// Since when writing waits.
    waiting: Option<Pin<Box<Sleep>>>,
}

impl Watched {
    const fn new(stream: TcpStream, stall: Duration) -> Self {
        Self {
            stream,
            stall,
            waiting: None,
        }
    }

    /// What writing came to, unless it has waited for too long.
    fn judged<T>(
        &mut self,
        context: &mut Context<'_>,
        written: Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.waiting = None;
            return written;
        }
        let stall = self.stall;
        let waiting = self.waiting.get_or_insert_with(|| Box::pin(sleep(stall)));
        waiting
            .as_mut()
            .poll(context)
            .map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for Watched {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Watched {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.judged(context, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        pieces: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write_vectored(context, pieces);
        self.judged(context, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(context)
    }
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;

    use axum::{body::Body, routing::get};
    use tokio::{
        io::{AsyncReadExt, AsyncWriteExt, duplex},
        sync::oneshot,
        time::timeout,
    };
    use tokio_util::io::ReaderStream;

    use super::*;
    use crate::telemetry::catalogue::HTTP_CONNECTIONS_DELAYED;

    /// Far beyond what anything here takes: a wait that lasts so long has failed.
    const FAILED: Duration = Duration::from_mins(1);
    const NEVER: Duration = Duration::from_hours(1);

    struct Host {
        address: SocketAddr,
        metrics: Arc<Metrics>,
        stop: Option<oneshot::Sender<()>>,
        task: tokio::task::JoinHandle<()>,
    }

    impl Host {
        async fn start(router: Router, limits: Limits) -> Self {
            let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
            let address = listener.local_addr().unwrap();
            let metrics = Arc::new(Metrics::new().unwrap());
            let (stop, stopped) = oneshot::channel::<()>();
            let counted = Arc::clone(&metrics);
            let task = tokio::spawn(async move {
                let stopped = async {
                    stopped.await.ok();
                };
                serve(listener, router, &counted, limits, stopped).await;
            });
            Self {
                address,
                metrics,
                stop: Some(stop),
                task,
            }
        }

        async fn connect(&self, words: &str) -> TcpStream {
            let mut stream = TcpStream::connect(self.address).await.unwrap();
            stream.write_all(words.as_bytes()).await.unwrap();
            stream
        }
    }

    fn hello() -> Router {
        Router::new().route("/", get(async || "hello"))
    }

    async fn to_the_end(mut stream: TcpStream) -> String {
        let mut bytes = Vec::new();
        let read = timeout(FAILED, stream.read_to_end(&mut bytes)).await;
        read.expect("the connection ends").ok();
        String::from_utf8(bytes).unwrap()
    }

    #[tokio::test]
    async fn who_says_nothing_or_half_is_closed() {
        let limits = Limits {
            head: Duration::from_secs(2),
            ..Limits::default()
        };
        let host = Host::start(hello(), limits).await;
        for words in ["", "GET / HTTP/1.1\r\nHost: a\r\nX-Slow"] {
            let answer = to_the_end(host.connect(words).await).await;
            assert!(!answer.contains("hello"), "{words:?}: {answer}");
        }
        // Whoever asks and then says nothing more is answered and closed.
        let answered = to_the_end(host.connect("GET / HTTP/1.1\r\nHost: a\r\n\r\n").await).await;
        assert!(answered.contains("hello"), "{answered}");
    }

    #[tokio::test]
    async fn beyond_the_bound_a_connection_waits_for_a_place_and_is_counted() {
        let limits = Limits {
            connections_max: 2,
            head: NEVER,
            stall: NEVER,
        };
        let host = Host::start(hello(), limits).await;
        let asked = "GET / HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n";
        let (first, second) = (host.connect("GET").await, host.connect("GET").await);
        let mut third = host.connect(asked).await;
        let mut byte = [0];
        let early = timeout(Duration::from_millis(200), third.read(&mut byte)).await;
        assert!(early.is_err(), "answered although both places are taken");
        drop(first);
        assert!(to_the_end(third).await.ends_with("hello"));
        assert!(host.metrics.value(&HTTP_CONNECTIONS_DELAYED, &[]) >= 1.0);
        drop(second);
    }

    #[tokio::test]
    async fn who_takes_nothing_of_an_answer_is_closed() {
        let (mut writer, reader) = duplex(1024);
        let body = Arc::new(std::sync::Mutex::new(Some(reader)));
        let endless = async move || {
            let reader = body.lock().unwrap().take().unwrap();
            Body::from_stream(ReaderStream::new(reader))
        };
        let limits = Limits {
            stall: Duration::from_millis(100),
            ..Limits::default()
        };
        let router = Router::new().route("/", get(endless));
        let host = Host::start(router, limits).await;
        let _reader = host.connect("GET / HTTP/1.1\r\nHost: a\r\n\r\n").await;
        let filled = async { while writer.write_all(&[0; 4096]).await.is_ok() {} };
        timeout(FAILED, filled).await.expect("the answer ends");
    }

    #[tokio::test]
    async fn the_end_waits_for_no_one_who_asks_nothing() {
        let mut host = Host::start(hello(), Limits::default()).await;
        let mut idle = host.connect("GET / HTTP/1.1\r\nHost: a\r\n\r\n").await;
        let mut read = [0; 16];
        idle.read_exact(&mut read).await.unwrap();
        host.stop.take().unwrap().send(()).unwrap();
        timeout(FAILED, host.task).await.unwrap().unwrap();
    }
}
