//! The client of one PMU or concentrator.
//!
//! Connects, lets the dialogue speak, hands frames on, and connects again after a pause that grows with
//! every failure. Nothing is waited for while frames are handed on: when the outlet is full, they are
//! dropped and counted, because a source that is not read from closes the connection.

use std::{
    io,
    net::{IpAddr, SocketAddr},
    time::Duration,
};

use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpStream, UdpSocket, lookup_host},
    sync::mpsc::Sender,
    time::{MissedTickBehavior, interval, sleep, timeout},
};
use tokio_util::sync::CancellationToken;

use super::Counters;
use crate::adapters::c37118::{
    Dialogue, DialogueOptions, Step, StreamCounters, StreamDecoder, Trouble,
};

/// Bytes of one reading: more than the longest frame, so that a datagram is never cut.
const READ_BYTES: usize = 1 << 17;
/// Bytes of frames that are handed on together: whatever one reading brought, up to this.
const TOGETHER_BYTES_MAX: usize = 1 << 16;
/// Period of the dialogue's tick.
const TICK: Duration = Duration::from_millis(100);
/// Longest wait for the source to take a command.
const SEND_LIMIT: Duration = Duration::from_secs(5);

/// How the source is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// A connection to the source's port.
    Tcp,
    /// Datagrams to and from the source's port, sent from this address. A source that sends by itself, without
    /// commands, has to be told to send here, and is heard whatever port of its host it sends from.
    Udp {
        /// Own address.
        local: SocketAddr,
    },
}

/// A source and how it is treated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// HOST:PORT.
    pub address: String,
    /// How it is reached.
    pub transport: Transport,
    /// What is said to it.
    pub dialogue: DialogueOptions,
    /// Shortest and longest pause before the next attempt to connect. The pause doubles from one to
    /// the other, and begins anew after a connection that brought a configuration.
    pub pause: (Duration, Duration),
    /// Longest wait for a connection.
    pub connect_limit: Duration,
    /// At the end: the silence after which the source is taken to have heard "data off", and the longest wait
    /// for it. What it had sent before lies in the connection and would be lost uncounted.
    pub farewell: (Duration, Duration),
    /// Bytes of the longest frame: the less, the sooner a damaged length is noticed.
    pub frame_bytes_max: usize,
}

/// What is handed on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// One or several data frames, one behind the other.
    Frames {
        /// How many.
        count: u64,
        /// Their bytes.
        bytes: Vec<u8>,
    },
    /// The configuration: one frame, or the parts of a CFG-3. Comes again from time to time.
    Configuration(Vec<Vec<u8>>),
}

/// Receives until it is told to stop, or nobody takes the frames any more. `now_ns` is UTC,
/// nanoseconds since 1970, and never goes back.
pub async fn run(
    source: &Source,
    outlet: &Sender<Delivery>,
    counters: &Counters,
    now_ns: fn() -> i64,
    stop: &CancellationToken,
) {
    let mut client = Client {
        dialogue: Dialogue::new(source.dialogue),
        source,
        outlet,
        counters,
        now_ns,
        held: (0, Vec::new()),
        past: StreamCounters::default(),
    };
    let (shortest, longest) = source.pause;
    let mut pause = shortest;
    loop {
        // Not raced against the stop: a connection that stands is to be left in good order.
        let end = client.one_connection(stop).await;
        client.note(end);
        if end == End::Stopped || outlet.is_closed() {
            return;
        }
        if client.dialogue.is_running() {
            pause = shortest;
        }
        tracing::info!(
            source = source.address,
            ?end,
            ?pause,
            "connecting again after a pause"
        );
        tokio::select! {
            () = stop.cancelled() => return,
            () = sleep(pause) => {}
        }
        pause = (pause * 2).min(longest);
    }
}

struct Client<'c> {
    source: &'c Source,
    outlet: &'c Sender<Delivery>,
    counters: &'c Counters,
    now_ns: fn() -> i64,
    dialogue: Dialogue,
    /// Frames of one reading, handed on together.
    held: (u64, Vec<u8>),
    /// Counts of the connections before this one.
    past: StreamCounters,
}

/// How a connection ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Refused,
    Broken,
    GivenUp(Trouble),
    Stopped,
}

impl Client<'_> {
    async fn one_connection(&mut self, stop: &CancellationToken) -> End {
        let opening = timeout(self.source.connect_limit, Link::open(self.source));
        let opened = tokio::select! {
            () = stop.cancelled() => return End::Stopped,
            opened = opening => opened,
        };
        let mut link = match opened {
            Ok(Ok(link)) => link,
            Ok(Err(error)) => {
                tracing::warn!(source = self.source.address, %error, "cannot connect");
                return End::Refused;
            }
            Err(_) => {
                tracing::warn!(source = self.source.address, "cannot connect in time");
                return End::Refused;
            }
        };
        self.counters.update(|totals| totals.connections += 1);
        tracing::info!(source = self.source.address, "connected");
        let mut decoder = StreamDecoder::with_limit(self.source.frame_bytes_max);
        let end = match self.talk(&mut link, &mut decoder, stop).await {
            Ok(end) => end,
            Err(error) => {
                tracing::warn!(source = self.source.address, %error, "connection broken");
                End::Broken
            }
        };
        decoder.reset();
        self.publish_counts(&decoder);
        self.past.add(&decoder.counters());
        end
    }

    async fn talk(
        &mut self,
        link: &mut Link,
        decoder: &mut StreamDecoder,
        stop: &CancellationToken,
    ) -> io::Result<End> {
        let mut tick = interval(TICK);
        tick.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut bytes = vec![0; READ_BYTES];
        let mut steps = self.dialogue.connected(self.now_ms());
        loop {
            if let Some(trouble) = self.carry_out(link, steps).await? {
                return Ok(End::GivenUp(trouble));
            }
            steps = tokio::select! {
                () = stop.cancelled() => {
                    let farewell = self.dialogue.farewell(self.now_ms());
                    self.carry_out(link, farewell.into_iter().collect()).await?;
                    let limit = self.source.farewell.1;
                    let rest = self.take_rest(link, decoder, &mut bytes);
                    timeout(limit, rest).await.ok();
                    return Ok(End::Stopped);
                }
                read = link.read(&mut bytes, self.counters) => {
                    let count = read?;
                    if count == 0 && !link.is_datagrams() {
                        return Ok(End::Broken);
                    }
                    self.frames(decoder, &bytes[..count], link.is_datagrams())
                }
                _ = tick.tick() => self.dialogue.tick(self.now_ms()),
            };
            self.publish_counts(decoder);
        }
    }

    /// Hands on what is on its way from a source that has been told to stop.
    async fn take_rest(&mut self, link: &mut Link, decoder: &mut StreamDecoder, bytes: &mut [u8]) {
        // A source that is not commanded never ceases: only what is there already is taken.
        let silence = if self.source.dialogue.commanded {
            self.source.farewell.0
        } else {
            Duration::ZERO
        };
        while let Ok(Ok(count @ 1..)) = timeout(silence, link.read(bytes, self.counters)).await {
            let steps = self.frames(decoder, &bytes[..count], link.is_datagrams());
            // Nothing more is said to the source.
            let steps = steps.into_iter().filter(|s| !matches!(s, Step::Send(_)));
            if self.carry_out(link, steps.collect()).await.is_err() {
                return;
            }
        }
    }

    /// What the dialogue makes of the frames in `bytes`. A datagram begins with a frame.
    fn frames(&mut self, decoder: &mut StreamDecoder, bytes: &[u8], datagram: bool) -> Vec<Step> {
        if datagram {
            decoder.reset();
        }
        decoder.push(bytes);
        let mut steps = Vec::new();
        while let Some(frame) = decoder.next_frame() {
            steps.extend(self.dialogue.frame(frame, self.now_ms()));
        }
        steps
    }

    /// Returns why the connection is to be given up, if it is.
    async fn carry_out(
        &mut self,
        link: &mut Link,
        steps: Vec<Step>,
    ) -> io::Result<Option<Trouble>> {
        for step in steps {
            match step {
                Step::Send(bytes) => match timeout(SEND_LIMIT, link.write(&bytes)).await {
                    Ok(written) => written?,
                    Err(_) => return Err(io::ErrorKind::TimedOut.into()),
                },
                Step::Pass(frame) => {
                    if self.held.1.len() + frame.len() > TOGETHER_BYTES_MAX {
                        self.hand_over();
                    }
                    self.held.0 += 1;
                    self.held.1.extend(frame);
                }
                Step::Configured(frames) => {
                    self.hand_over();
                    let count = frames.len() as u64;
                    self.deliver(count, Delivery::Configuration(frames));
                }
                Step::GiveUp(trouble) => {
                    self.hand_over();
                    return Ok(Some(trouble));
                }
            }
        }
        self.hand_over();
        Ok(None)
    }

    fn hand_over(&mut self) {
        let (count, bytes) = std::mem::take(&mut self.held);
        if count > 0 {
            self.deliver(count, Delivery::Frames { count, bytes });
        }
    }

    fn deliver(&self, count: u64, delivery: Delivery) {
        let taken = self.outlet.try_send(delivery).is_ok();
        self.counters.update(|totals| {
            if taken {
                totals.delivered += count;
            } else {
                totals.dropped += count;
            }
        });
    }

    fn publish_counts(&self, decoder: &StreamDecoder) {
        let (mut stream, dialogue) = (self.past, self.dialogue.counts());
        stream.add(&decoder.counters());
        self.counters.update(|totals| {
            totals.stream = stream;
            totals.dialogue = dialogue;
        });
    }

    fn note(&self, end: End) {
        self.counters.update(|totals| match end {
            End::Refused => totals.refused += 1,
            End::Broken => totals.broken += 1,
            End::GivenUp(Trouble::Silent) => totals.silent += 1,
            End::GivenUp(Trouble::NoConfiguration) => totals.unanswered += 1,
            End::Stopped => {}
        });
    }

    fn now_ms(&self) -> i64 {
        const NANOSECONDS_PER_MS: i64 = 1_000_000;
        (self.now_ns)() / NANOSECONDS_PER_MS
    }
}

enum Link {
    Tcp(TcpStream),
    Udp(UdpSocket),
    /// A source that sends by itself: its datagrams come from a port that nobody chose.
    Heard(UdpSocket, IpAddr),
}

impl Link {
    async fn open(source: &Source) -> io::Result<Self> {
        match source.transport {
            Transport::Tcp => {
                let stream = TcpStream::connect(&source.address).await?;
                stream.set_nodelay(true)?;
                Ok(Self::Tcp(stream))
            }
            Transport::Udp { local } => {
                let socket = UdpSocket::bind(local).await?;
                if !source.dialogue.commanded {
                    let mut hosts = lookup_host(&source.address).await?;
                    let host = hosts.find(|host| host.is_ipv4() == local.is_ipv4());
                    let host = host.ok_or(io::ErrorKind::AddrNotAvailable)?;
                    return Ok(Self::Heard(socket, host.ip()));
                }
                socket.connect(&source.address).await?;
                Ok(Self::Udp(socket))
            }
        }
    }

    const fn is_datagrams(&self) -> bool {
        matches!(self, Self::Udp(_) | Self::Heard(..))
    }

    async fn read(&mut self, bytes: &mut [u8], counters: &Counters) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(bytes).await,
            Self::Udp(socket) => socket.recv(bytes).await,
            Self::Heard(socket, host) => loop {
                let (count, from) = socket.recv_from(bytes).await?;
                if from.ip() == *host {
                    return Ok(count);
                }
                counters.update(|totals| totals.foreign += 1);
            },
        }
    }

    async fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.write_all(bytes).await,
            Self::Udp(socket) => socket.send(bytes).await.map(|_| ()),
            Self::Heard(..) => Ok(()),
        }
    }
}
