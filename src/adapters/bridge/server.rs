//! A small PMU: answers commands over TCP and sends data frames to whoever has asked for them.

use std::{
    io,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
    time::Duration,
};

use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    sync::broadcast::{
        self,
        error::{RecvError, TryRecvError},
    },
    time::timeout,
};
use tokio_util::{sync::CancellationToken, task::TaskTracker};

use crate::adapters::c37118::{Command, Frame, StreamDecoder, decode};

/// Longest wait for a client to take a frame; then it is disconnected.
const SEND_LIMIT: Duration = Duration::from_secs(5);
/// Commands are short.
const COMMAND_BYTES_MAX: usize = 4096;
/// Frames that wait for a client; a slower one loses the oldest.
const WAITING_MAX: usize = 1024;
/// Longest wait at the end for a client to take what still waits for it.
const REST_LIMIT: Duration = Duration::from_mins(1);
/// Longest wait after the last frame for a client to close. A connection that is closed on this side
/// while a command of the client lies unread is reset, and the client loses what it has not read.
const CLOSE_LIMIT: Duration = Duration::from_secs(10);

/// Frames with which a station answers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Answers {
    /// IDCODE that commands have to address.
    pub id_code: u16,
    /// Header frame.
    pub header: Vec<u8>,
    /// CFG-1.
    pub configuration_1: Vec<u8>,
    /// CFG-2.
    pub configuration_2: Vec<u8>,
    /// CFG-3, one frame behind the other.
    pub configuration_3: Vec<u8>,
}

/// A PMU as its clients see it.
#[derive(Debug)]
pub struct Station {
    answers: Mutex<Arc<Answers>>,
    frames: broadcast::Sender<Arc<[u8]>>,
    lost: AtomicU64,
    ended: CancellationToken,
}

impl Station {
    /// A station that has nothing to send yet.
    #[must_use]
    pub fn new(answers: Answers) -> Self {
        let (frames, _) = broadcast::channel(WAITING_MAX);
        Self {
            answers: Mutex::new(Arc::new(answers)),
            frames,
            lost: AtomicU64::new(0),
            ended: CancellationToken::new(),
        }
    }

    /// Sends a data frame to every client that has asked for data; returns how many those are.
    pub fn send(&self, frame: &[u8]) -> usize {
        self.frames.send(Arc::from(frame)).unwrap_or(0)
    }

    /// Clients that have asked for data.
    #[must_use]
    pub fn listeners(&self) -> usize {
        self.frames.receiver_count()
    }

    /// Nothing is sent any more: clients get what waits for them, then [`serve`] ends.
    pub fn end(&self) {
        self.ended.cancel();
    }

    /// Frames that clients were too slow for, or that waited for a client when its connection broke.
    #[must_use]
    pub fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    /// Answers differently from now on. Clients have to be told by STAT bit 10 or notice it.
    pub fn reconfigure(&self, answers: Answers) {
        *self.answers.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(answers);
    }

    fn answers(&self) -> Arc<Answers> {
        Arc::clone(&self.answers.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// Serves clients until it is told to stop, which breaks their connections, or until the station has
/// ended and every client has what was sent before.
pub async fn serve(station: Arc<Station>, listener: TcpListener, stop: CancellationToken) {
    let clients = TaskTracker::new();
    loop {
        let accepted = tokio::select! {
            () = stop.cancelled() => return,
            () = station.ended.cancelled() => break,
            accepted = listener.accept() => accepted,
        };
        match accepted {
            Ok((stream, address)) => {
                let (station, stop) = (Arc::clone(&station), stop.clone());
                clients.spawn(async move {
                    tracing::info!(%address, "client connected");
                    let served = tokio::select! {
                        () = stop.cancelled() => Ok(()),
                        served = attend(&station, stream) => served,
                    };
                    match served {
                        Ok(()) => tracing::info!(%address, "client gone"),
                        Err(error) => tracing::info!(%address, %error, "client lost"),
                    }
                });
            }
            Err(error) => tracing::warn!(%error, "a client could not be accepted"),
        }
    }
    clients.close();
    tokio::select! {
        () = stop.cancelled() => {}
        () = clients.wait() => {}
    }
}

type Frames = broadcast::Receiver<Arc<[u8]>>;

/// Attends to one client until it goes or everything has been sent.
async fn attend(station: &Station, mut stream: TcpStream) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let mut subscription: Option<Frames> = None;
    let talked = talk(station, &mut stream, &mut subscription).await;
    let Ok(Talk::StationEnded) = talked else {
        let waiting = subscription.map_or(0, |frames| frames.len() as u64);
        if talked.is_err() {
            station.lost.fetch_add(waiting, Ordering::Relaxed);
        }
        return talked.map(|_| ());
    };
    if let Some(mut frames) = subscription {
        let rest = timeout(REST_LIMIT, send_rest(station, &mut stream, &mut frames)).await;
        let rest = rest.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into()));
        if rest.is_err() {
            let waiting = frames.len() as u64;
            station.lost.fetch_add(waiting, Ordering::Relaxed);
            return rest;
        }
    }
    stream.shutdown().await?;
    timeout(CLOSE_LIMIT, until_closed(&mut stream)).await.ok();
    Ok(())
}

/// Why a conversation is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Talk {
    ClientGone,
    StationEnded,
}

async fn talk(
    station: &Station,
    stream: &mut TcpStream,
    subscription: &mut Option<Frames>,
) -> io::Result<Talk> {
    let mut decoder = StreamDecoder::with_limit(COMMAND_BYTES_MAX);
    let mut bytes = [0; COMMAND_BYTES_MAX];
    loop {
        tokio::select! {
            () = station.ended.cancelled() => return Ok(Talk::StationEnded),
            read = stream.read(&mut bytes) => {
                let count = read?;
                if count == 0 {
                    return Ok(Talk::ClientGone);
                }
                decoder.push(&bytes[..count]);
                while let Some(frame) = decoder.next_frame() {
                    let answer = answer(station, &frame, subscription);
                    write(stream, &answer).await?;
                }
            }
            frame = next_frame(station, subscription) => send(station, stream, &frame).await?,
        }
    }
}

/// Sends what waited for the client when the station ended.
async fn send_rest(
    station: &Station,
    stream: &mut TcpStream,
    frames: &mut Frames,
) -> io::Result<()> {
    loop {
        match frames.try_recv() {
            Ok(frame) => send(station, stream, &frame).await?,
            Err(TryRecvError::Lagged(count)) => {
                station.lost.fetch_add(count, Ordering::Relaxed);
            }
            Err(TryRecvError::Empty | TryRecvError::Closed) => return Ok(()),
        }
    }
}

async fn until_closed(stream: &mut TcpStream) {
    let mut bytes = [0; COMMAND_BYTES_MAX];
    while let Ok(1..) = stream.read(&mut bytes).await {}
}

/// Bytes to answer a command with; data frames begin or cease with the subscription.
fn answer(station: &Station, frame: &[u8], subscription: &mut Option<Frames>) -> Vec<u8> {
    let answers = station.answers();
    let Ok(Frame::Command(command)) = decode(frame) else {
        return Vec::new();
    };
    if command.prefix.id_code != answers.id_code {
        return Vec::new();
    }
    match command.command {
        Command::DataOff => *subscription = None,
        Command::DataOn => {
            subscription.get_or_insert_with(|| station.frames.subscribe());
        }
        Command::SendHeader => return answers.header.clone(),
        Command::SendConfiguration1 => return answers.configuration_1.clone(),
        Command::SendConfiguration2 => return answers.configuration_2.clone(),
        Command::SendConfiguration3 => return answers.configuration_3.clone(),
        Command::Extended(_) | Command::Other(_) => {}
    }
    Vec::new()
}

/// The next data frame; never ready for a client that has not asked for data.
async fn next_frame(station: &Station, subscription: &mut Option<Frames>) -> Arc<[u8]> {
    loop {
        let Some(frames) = subscription else {
            return std::future::pending().await;
        };
        match frames.recv().await {
            Ok(frame) => return frame,
            Err(RecvError::Lagged(count)) => {
                station.lost.fetch_add(count, Ordering::Relaxed);
            }
            Err(RecvError::Closed) => *subscription = None,
        }
    }
}

/// Sends a data frame; one that the client does not take is lost.
async fn send(station: &Station, stream: &mut TcpStream, frame: &[u8]) -> io::Result<()> {
    let written = write(stream, frame).await;
    if written.is_err() {
        station.lost.fetch_add(1, Ordering::Relaxed);
    }
    written
}

async fn write(stream: &mut TcpStream, bytes: &[u8]) -> io::Result<()> {
    match timeout(SEND_LIMIT, stream.write_all(bytes)).await {
        Ok(written) => written,
        Err(_) => Err(io::ErrorKind::TimedOut.into()),
    }
}
