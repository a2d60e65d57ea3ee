//! The bridge against a PMU of our own, and through a proxy that cuts, holds back, swaps and damages
//! what the PMU sends. Faults are placed by the number of the data frame, so that every run meets the
//! same ones. And the parsers of everything that comes in, on mutants of the fuzzers' corpus.
#![allow(
    clippy::disallowed_methods,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test that cannot go on should fail"
)]

#[path = "../fuzz/parsers.rs"]
mod parsers;

use std::{
    fs,
    net::SocketAddr,
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, SystemTime, UNIX_EPOCH},
};

use loadmodeld::{
    adapters::{
        bridge::{Answers, Counters, Delivery, Source, Station, Totals, Transport, client, server},
        c37118::{
            Command, CommandFrame, ConfigurationKind, DialogueOptions, Frame, FrameIntake,
            HeaderFrame, LoadMapping, PhasorSet, Played, Prefix, StreamDecoder, decode,
        },
    },
    measurement::{
        Concentrator, ConcentratorOptions, Quality, Sample, SampleBatch, Site, record::Record,
    },
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream, UdpSocket},
    runtime::Runtime,
    sync::mpsc,
    task::JoinHandle,
    time::sleep,
};
use tokio_util::sync::CancellationToken;

const ID_CODE: u16 = 7;
const RATE_FPS: f64 = 50.0;
/// Longest wait for anything; generous, because a machine may be busy.
const LIMIT: Duration = Duration::from_mins(2);
const START_NS: i64 = 1_700_000_000_000_000_000;

#[test]
fn every_parser_reads_or_refuses_its_corpus_and_mutants_of_it() {
    const MUTANTS: usize = 2000;
    let mutants = std::env::var("LOADMODELD_MUTANTS");
    let mutants = mutants.map_or(MUTANTS, |text| text.parse().expect("a number of mutants"));
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    for (name, parse) in parsers::ALL {
        let folder = fs::read_dir(corpus.join(name)).unwrap();
        let mut files: Vec<PathBuf> = folder.map(|entry| entry.unwrap().path()).collect();
        files.sort();
        assert!(!files.is_empty(), "{name}");
        let mut random = Random(20_261_121);
        let originals: Vec<Vec<u8>> = files.iter().map(|f| fs::read(f).unwrap()).collect();
        for original in &originals {
            parse(original);
        }
        for original in originals.iter().cycle().take(mutants) {
            let mut mutant = random.mutant(original);
            // Half of the frames get past the check word, and a third past their length.
            if name.starts_with("c37118") && random.below(2) == 0 {
                reseal(&mut mutant, random.below(3) == 0);
            }
            parse(&mutant);
        }
        println!("{name}: {mutants} mutants of {} files", originals.len());
    }
}

#[test]
fn frames_arrive_as_they_were_measured_and_a_stop_is_clean() {
    let runtime = runtime();
    runtime.block_on(async {
        let pmu = Pmu::start(100.0).await;
        let mut bridge = Bridge::to(pmu.address);
        let sent = bridge.receive_while_sending(&pmu, 200).await;
        let end = bridge.end().await;
        assert_eq!(
            end.totals.dropped + end.totals.dialogue.not_as_configured,
            0
        );
        assert_eq!(end.totals.dialogue.data, end.numbers.len() as u64);
        // From the first frame after "data on" to the last none is missing.
        assert_eq!(end.numbers, (end.numbers[0]..sent).collect::<Vec<_>>());
        wait_for("the PMU to be told to stop", || {
            pmu.station.listeners() == 0
        })
        .await;
    });
}

#[test]
fn a_pmu_that_goes_away_and_comes_back_otherwise_is_followed() {
    let runtime = runtime();
    runtime.block_on(async {
        let pmu = Pmu::start(100.0).await;
        let mut bridge = Bridge::to(pmu.address);
        bridge.receive_while_sending(&pmu, 50).await;
        let before = bridge.counters.read();
        pmu.stop.cancel();
        wait_for("the broken connection", || {
            bridge.counters.read().broken > before.broken
        })
        .await;
        // The same port, another configuration: the base of the voltage tells them apart.
        let pmu = Pmu::start_at(pmu.address, 200.0).await;
        bridge.receive_while_sending(&pmu, 50).await;
        let totals = bridge.end().await.totals;
        assert_eq!((totals.connections, totals.broken), (2, 1), "{totals:?}");
        assert_eq!(totals.dialogue.configurations, 2);
    });
}

#[test]
fn a_configuration_that_changes_while_running_is_asked_for_again() {
    let runtime = runtime();
    runtime.block_on(async {
        let pmu = Pmu::start(100.0).await;
        let mut bridge = Bridge::to(pmu.address);
        bridge.receive_while_sending(&pmu, 20).await;
        // Another rate and twice the PMUs, so that data frames have another length.
        pmu.reconfigure();
        bridge.receive_while_sending(&pmu, 20).await;
        let totals = bridge.end().await.totals;
        assert_eq!(totals.dialogue.reconfigurations, 1, "{totals:?}");
        assert!(totals.dialogue.not_as_configured > 0);
        assert_eq!(totals.connections, 1);
    });
}

#[test]
fn a_source_that_sends_datagrams_by_itself_is_listened_to() {
    let runtime = runtime();
    runtime.block_on(async {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let local = free_udp_address().await;
        let transport = Transport::Udp { local };
        // Its host is known, not the port that it sends from.
        let elsewhere = free_udp_address().await;
        let mut bridge = Bridge::with(elsewhere, transport, false);
        let mut played = Played::new(&site(100.0), RATE_FPS, ID_CODE).unwrap();
        let configuration = played.configuration(ConfigurationKind::Configuration2);
        let configuration = configuration.encode().unwrap().remove(0);
        let stranger = UdpSocket::bind("127.0.0.2:0").await.unwrap();
        let mut k = 0;
        while bridge.numbers().len() < 50 || bridge.counters.read().foreign == 0 {
            drop(stranger.send_to(&configuration, local).await);
            // Nobody may be listening yet: that is an error of the next call on some systems.
            drop(socket.send_to(&configuration, local).await);
            let frame = played.frame(&sample(k)).unwrap().unwrap();
            drop(socket.send_to(&frame, local).await);
            k += 1;
            sleep(Duration::from_millis(1)).await;
            bridge.drain();
        }
        let end = bridge.end().await;
        assert!(end.totals.dialogue.configurations > 0);
        assert_eq!(end.totals.dialogue.commands, 0);
        assert!(end.numbers.is_sorted_by(|a, b| a < b));
    });
}

#[test]
fn a_cut_in_the_middle_of_a_frame_costs_that_frame_and_the_pause() {
    const CUT: u64 = 40;
    let runtime = runtime();
    runtime.block_on(async {
        let pmu = Pmu::start(100.0).await;
        let proxy = Proxy::start(pmu.address, |number, frame| match number {
            CUT => Act::Cut(frame[..frame.len() / 2].to_vec()),
            _ => Act::Forward(frame),
        });
        let mut bridge = Bridge::to(proxy.await);
        bridge.receive_while_sending(&pmu, 30).await;
        wait_while_sending(&pmu, || bridge.counters.read().connections == 2).await;
        bridge.receive_while_sending(&pmu, 30).await;
        let end = bridge.end().await;
        assert_eq!((end.totals.connections, end.totals.broken), (2, 1));
        assert!(end.totals.stream.skipped_bytes > 0, "half a frame");
        assert!(end.numbers.is_sorted_by(|a, b| a < b), "none twice");
        assert_eq!(end.gaps(), 1);
    });
}

#[test]
fn damaged_frames_are_found_by_their_check_word_and_cost_only_themselves() {
    let runtime = runtime();
    runtime.block_on(async {
        let pmu = Pmu::start(100.0).await;
        // Each damage at another byte, SYNC and FRAMESIZE too.
        let damaged = |number: u64| number % 10 == 9;
        let proxy = Proxy::start(pmu.address, move |number, mut frame| {
            if damaged(number) {
                let at = usize::try_from(number / 10).unwrap() % frame.len();
                frame[at] ^= 0x40;
            }
            Act::Forward(frame)
        });
        let mut bridge = Bridge::to(proxy.await);
        bridge.receive_while_sending(&pmu, 900).await;
        let end = bridge.end().await;
        let (first, last) = (end.numbers[0], *end.numbers.last().unwrap());
        // The proxy counts from the first frame that went through it.
        let expected = (0..=last - first)
            .filter(|n| !damaged(*n))
            .map(|n| n + first);
        assert_eq!(end.numbers, expected.collect::<Vec<_>>());
        assert!(end.totals.stream.bad_checksums > 0);
        assert_eq!(end.totals.connections, 1);
    });
}

#[test]
fn frames_that_are_held_back_arrive_together_and_none_is_lost() {
    const HELD: u64 = 100;
    let runtime = runtime();
    runtime.block_on(async {
        let pmu = Pmu::start(100.0).await;
        let mut held = Vec::new();
        let proxy = Proxy::start(pmu.address, move |number, frame| {
            held.extend(frame);
            if (number + 1).is_multiple_of(HELD) {
                Act::Forward(std::mem::take(&mut held))
            } else {
                Act::Forward(Vec::new())
            }
        });
        let mut bridge = Bridge::to(proxy.await);
        bridge.receive_while_sending(&pmu, 300).await;
        let end = bridge.end().await;
        assert_eq!(end.totals.dropped, 0);
        let first = end.numbers[0];
        let count = end.numbers.len() as u64;
        assert_eq!(end.numbers, (first..first + count).collect::<Vec<_>>());
    });
}

#[test]
fn frames_out_of_order_give_the_same_samples_as_in_order() {
    let runtime = runtime();
    let released = |swap: bool| {
        runtime.block_on(async {
            let pmu = Pmu::start(100.0).await;
            let mut held = None;
            let proxy = Proxy::start(pmu.address, move |number, frame| {
                if swap && number % 5 == 3 {
                    held = Some(frame);
                    return Act::Forward(Vec::new());
                }
                let behind = held.take().unwrap_or_default();
                Act::Forward([frame, behind].concat())
            });
            let mut bridge = Bridge::to(proxy.await);
            // Both runs begin with the same frame.
            wait_for("a listener", || pmu.station.listeners() == 1).await;
            bridge.receive_while_sending(&pmu, 200).await;
            let end = bridge.end().await;
            let sorted = end.numbers.is_sorted();
            assert_eq!(sorted, !swap);
            end.released()
        })
    };
    let (in_order, swapped) = (released(false), released(true));
    let both = in_order.len().min(swapped.len()).min(190);
    assert!(both > 150);
    let by_number = |samples: &[Sample]| -> Vec<(u64, [u64; 4])> {
        let bits = |s: &Sample| {
            [s.voltage_pu, s.frequency_hz, s.active_pu, s.reactive_pu].map(f64::to_bits)
        };
        samples
            .iter()
            .map(|s| (number(s.time_ns), bits(s)))
            .collect()
    };
    let (in_order, swapped) = (by_number(&in_order), by_number(&swapped));
    let common = swapped
        .iter()
        .filter(|(k, _)| in_order.iter().any(|(other, _)| other == k));
    let mut compared = 0;
    for (k, bits) in common {
        let other = in_order.iter().find(|(other, _)| other == k).unwrap();
        assert_eq!(*bits, other.1, "sample {k}");
        compared += 1;
    }
    assert!(compared > 100, "{compared}");
}

#[test]
fn a_client_that_reads_late_still_gets_every_frame_of_a_station_that_has_ended() {
    const FRAMES: u64 = 1000;
    let runtime = runtime();
    runtime.block_on(async {
        let pmu = Pmu::start(100.0).await;
        let mut client = TcpStream::connect(pmu.address).await.unwrap();
        client.write_all(&command(Command::DataOn)).await.unwrap();
        wait_for("the subscription", || pmu.station.listeners() == 1).await;
        for _ in 0..FRAMES {
            pmu.send();
        }
        // Unread at the station when it ends: closing its side at once would reset the connection.
        client
            .write_all(&command(Command::SendHeader))
            .await
            .unwrap();
        pmu.station.end();
        wait_for("the end of taking clients", || {
            std::net::TcpStream::connect(pmu.address).is_err()
        })
        .await;
        let mut bytes = Vec::new();
        client.read_to_end(&mut bytes).await.unwrap();
        let mut decoder = StreamDecoder::new();
        decoder.push(&bytes);
        let frames = std::iter::from_fn(|| decoder.next_frame());
        let data = frames.filter(|frame| frame[1] >> 4 == 0).count();
        assert_eq!((data as u64, pmu.station.lost()), (FRAMES, 0));
    });
}

#[test]
fn what_a_source_had_sent_before_it_was_told_to_stop_is_handed_on() {
    const REST: u64 = 500;
    let runtime = runtime();
    runtime.block_on(async {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        // A source that sends most when it is told to stop, as one whose frames were on their way does.
        let source = tokio::spawn(async move {
            let (mut stream, _) = listener.accept().await.unwrap();
            let mut played = Played::new(&site(100.0), RATE_FPS, ID_CODE).unwrap();
            let configuration = played.configuration(ConfigurationKind::Configuration2);
            let configuration = configuration.encode().unwrap().concat();
            let mut frames = |range: std::ops::Range<u64>| {
                let frames = range.map(|k| played.frame(&sample(k)).unwrap().unwrap());
                frames.collect::<Vec<_>>().concat()
            };
            let (mut decoder, mut bytes, mut sends) = (StreamDecoder::new(), [0; 1024], false);
            while let Ok(length @ 1..) = stream.read(&mut bytes).await {
                decoder.push(&bytes[..length]);
                while let Some(frame) = decoder.next_frame() {
                    let Ok(Frame::Command(asked)) = decode(&frame) else {
                        continue;
                    };
                    match asked.command {
                        Command::SendConfiguration2 => {
                            stream.write_all(&configuration).await.unwrap();
                        }
                        Command::DataOn => {
                            sends = true;
                            stream.write_all(&frames(0..1)).await.unwrap();
                        }
                        Command::DataOff if sends => {
                            stream.write_all(&frames(1..1 + REST)).await.unwrap();
                            return;
                        }
                        _ => {}
                    }
                }
            }
        });
        // The source's closing ends the wait, however busy the machine is.
        let mut bridge = Bridge::of(Source {
            farewell: (LIMIT, LIMIT),
            ..Bridge::source(address, Transport::Tcp, true)
        });
        let begun = SystemTime::now();
        while bridge.numbers().is_empty() {
            assert!(begun.elapsed().unwrap() < LIMIT, "no frame came");
            sleep(Duration::from_millis(5)).await;
            bridge.drain();
        }
        let end = bridge.end().await;
        source.await.unwrap();
        assert_eq!(end.numbers, (0..=REST).collect::<Vec<_>>());
        assert_eq!(end.totals.dialogue.data, 1 + REST);
    });
}

/// A command as a client sends it.
fn command(command: Command) -> Vec<u8> {
    let prefix = Prefix {
        id_code: ID_CODE,
        ..Prefix::default()
    };
    CommandFrame { prefix, command }.encode().unwrap()
}

/// A linear congruential generator (Knuth, MMIX): the mutants are the same in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(self.0 >> 33).unwrap() % bound.max(1)
    }

    /// `original` with one to four changes.
    fn mutant(&mut self, original: &[u8]) -> Vec<u8> {
        let mut bytes = original.to_vec();
        for _ in 0..=self.below(4) {
            let at = self.below(bytes.len());
            let byte = u8::try_from(self.below(256)).unwrap();
            match self.below(5) {
                0 if !bytes.is_empty() => bytes[at] = byte,
                1 if !bytes.is_empty() => bytes[at] ^= 1 << (byte % 8),
                2 => bytes.insert(at, byte),
                3 => bytes.truncate(at),
                _ => {
                    let copy = bytes[at..(at + 16).min(bytes.len())].to_vec();
                    bytes.splice(at..at, copy);
                }
            }
        }
        bytes
    }
}

/// Puts the check word of a frame right, and its length before it where asked.
fn reseal(frame: &mut [u8], length: bool) {
    let size = frame.len();
    if size < 6 {
        return;
    }
    if length && let Ok(size) = u16::try_from(size) {
        frame[2..4].copy_from_slice(&size.to_be_bytes());
    }
    let word = parsers::check_word(&frame[..size - 2]);
    frame[size - 2..].copy_from_slice(&word);
}

/// A PMU on loopback.
struct Pmu {
    station: Arc<Station>,
    address: SocketAddr,
    stop: CancellationToken,
    played: Mutex<(Played, Option<Played>)>,
    sent: AtomicU64,
    v_base_kv: f64,
}

impl Pmu {
    async fn start(v_base_kv: f64) -> Self {
        Self::start_at(SocketAddr::from(([127, 0, 0, 1], 0)), v_base_kv).await
    }

    async fn start_at(address: SocketAddr, v_base_kv: f64) -> Self {
        // The port of the one before may take a moment to be free.
        let begun = SystemTime::now();
        let listener = loop {
            match TcpListener::bind(address).await {
                Ok(listener) => break listener,
                Err(error) => assert!(begun.elapsed().unwrap() < LIMIT, "{error}"),
            }
            sleep(Duration::from_millis(20)).await;
        };
        let address = listener.local_addr().unwrap();
        let played = Played::new(&site(v_base_kv), RATE_FPS, ID_CODE).unwrap();
        let station = Arc::new(Station::new(answers(&played, false)));
        let stop = CancellationToken::new();
        tokio::spawn(server::serve(Arc::clone(&station), listener, stop.clone()));
        Self {
            station,
            address,
            stop,
            played: Mutex::new((played, None)),
            sent: AtomicU64::new(0),
            v_base_kv,
        }
    }

    /// From now on every frame carries a second PMU.
    fn reconfigure(&self) {
        let mut played = self.played.lock().unwrap();
        let second = Played::new(&site(self.v_base_kv), RATE_FPS, ID_CODE).unwrap();
        self.station.reconfigure(answers(&second, true));
        played.1 = Some(second);
    }

    /// Sends the next frame; its number is its time.
    fn send(&self) {
        let k = self.sent.fetch_add(1, Ordering::Relaxed);
        let mut played = self.played.lock().unwrap();
        let frame = match &mut played.1 {
            None => played.0.frame(&sample(k)).unwrap().unwrap(),
            Some(second) => doubled(&second.frame(&sample(k)).unwrap().unwrap()),
        };
        self.station.send(&frame);
    }
}

/// What a station answers with; `double` for a stream of two PMUs.
fn answers(played: &Played, double: bool) -> Answers {
    let frame = |kind| {
        let mut configuration = played.configuration(kind);
        if double {
            let mut second = configuration.pmus[0].clone();
            second.id_code += 1;
            configuration.pmus.push(second);
        }
        configuration.encode().unwrap().concat()
    };
    let header = HeaderFrame {
        prefix: Prefix {
            id_code: ID_CODE,
            ..Prefix::default()
        },
        text: "a PMU of the tests".to_owned(),
    };
    Answers {
        id_code: ID_CODE,
        header: header.encode().unwrap(),
        configuration_1: frame(ConfigurationKind::Configuration1),
        configuration_2: frame(ConfigurationKind::Configuration2),
        configuration_3: frame(ConfigurationKind::Configuration3),
    }
}

/// A data frame with the data of its PMU twice, put together by hand.
fn doubled(frame: &[u8]) -> Vec<u8> {
    let (head, data) = (&frame[..14], &frame[14..frame.len() - 2]);
    let mut doubled = [head, data, data].concat();
    let size = u16::try_from(doubled.len() + 2).unwrap();
    doubled[2..4].copy_from_slice(&size.to_be_bytes());
    let check = parsers::check_word(&doubled);
    doubled.extend(check);
    doubled
}

/// A bridge whose frames are looked at instead of published.
struct Bridge {
    counters: Arc<Counters>,
    deliveries: mpsc::Receiver<Delivery>,
    stop: CancellationToken,
    task: JoinHandle<()>,
    intake: FrameIntake,
    batches: Vec<SampleBatch>,
}

/// What a bridge has received when it has ended.
struct Received {
    totals: Totals,
    numbers: Vec<u64>,
    batches: Vec<SampleBatch>,
}

impl Bridge {
    fn to(address: SocketAddr) -> Self {
        Self::with(address, Transport::Tcp, true)
    }

    fn with(address: SocketAddr, transport: Transport, commanded: bool) -> Self {
        Self::of(Self::source(address, transport, commanded))
    }

    fn source(address: SocketAddr, transport: Transport, commanded: bool) -> Source {
        Source {
            address: address.to_string(),
            transport,
            dialogue: DialogueOptions {
                id_code: ID_CODE,
                commanded,
                answer_ms: 200,
                requests_max: 1000,
                silence_ms: i64::try_from(LIMIT.as_millis()).unwrap(),
                ..DialogueOptions::default()
            },
            pause: (Duration::from_millis(10), Duration::from_millis(100)),
            connect_limit: LIMIT,
            farewell: (Duration::from_millis(20), LIMIT),
            frame_bytes_max: 2048,
        }
    }

    fn of(source: Source) -> Self {
        let (outlet, deliveries) = mpsc::channel(100_000);
        let (counters, stop) = (Arc::new(Counters::default()), CancellationToken::new());
        let (counted, stopped) = (Arc::clone(&counters), stop.clone());
        let task = tokio::spawn(async move {
            client::run(&source, &outlet, &counted, now_ns, &stopped).await;
        });
        Self {
            counters,
            deliveries,
            stop,
            task,
            intake: FrameIntake::new(&site(100.0), "pmu", &mapping()),
            batches: Vec::new(),
        }
    }

    /// Lets the PMU send until so many more samples have arrived; returns how many it has sent.
    async fn receive_while_sending(&mut self, pmu: &Pmu, count: usize) -> u64 {
        let wanted = self.numbers().len() + count;
        let begun = SystemTime::now();
        while self.numbers().len() < wanted {
            pmu.send();
            sleep(Duration::from_millis(1)).await;
            self.drain();
            let totals = self.counters.read();
            assert!(begun.elapsed().unwrap() < LIMIT, "{totals:?}");
        }
        pmu.sent.load(Ordering::Relaxed)
    }

    fn drain(&mut self) {
        while let Ok(delivery) = self.deliveries.try_recv() {
            let bytes = match delivery {
                Delivery::Frames { bytes, .. } => bytes,
                Delivery::Configuration(frames) => frames.concat(),
            };
            let taken = self.intake.take(&bytes);
            // A stream of two PMUs is not what the mapping expects, and a source that sends by itself
            // may do so before its configuration is known; the frames are counted.
            let counted = ["not_mapped", "no_configuration"];
            let trouble = taken.trouble.iter().map(|(outcome, _)| outcome.label());
            assert!(
                trouble.clone().all(|label| counted.contains(&label)),
                "{:?}",
                trouble.collect::<Vec<_>>()
            );
            self.batches.extend(taken.batches);
        }
    }

    fn numbers(&self) -> Vec<u64> {
        numbers(&self.batches)
    }

    /// Stops the bridge and takes what is on its way.
    async fn end(mut self) -> Received {
        self.stop.cancel();
        self.task.await.unwrap();
        let Self {
            counters,
            ref mut deliveries,
            ref mut intake,
            ref mut batches,
            ..
        } = self;
        while let Ok(delivery) = deliveries.try_recv() {
            if let Delivery::Frames { bytes, .. } = delivery {
                batches.extend(intake.take(&bytes).batches);
            }
        }
        Received {
            totals: counters.read(),
            numbers: numbers(batches),
            batches: std::mem::take(batches),
        }
    }
}

impl Received {
    /// Places where numbers are missing.
    fn gaps(&self) -> usize {
        let pairs = self.numbers.windows(2);
        pairs.filter(|pair| pair[1] != pair[0] + 1).count()
    }

    /// What the concentrator makes of it.
    fn released(&self) -> Vec<Sample> {
        let mut concentrator = Concentrator::new(&site(100.0), ConcentratorOptions::default());
        let mut samples = Vec::new();
        for batch in &self.batches {
            concentrator.push(batch);
            let runs = concentrator.drain();
            samples.extend(runs.into_iter().flat_map(|run| run.samples));
        }
        let runs = concentrator.flush();
        samples.extend(runs.into_iter().flat_map(|run| run.samples));
        samples
    }
}

fn numbers(batches: &[SampleBatch]) -> Vec<u64> {
    let of = |batch: &SampleBatch| {
        let first = number(batch.start_ns);
        first..first + batch.len() as u64
    };
    batches.iter().flat_map(of).collect()
}

/// What becomes of a data frame at the proxy.
enum Act {
    /// These bytes go on.
    Forward(Vec<u8>),
    /// These bytes go on, then the connection is closed.
    Cut(Vec<u8>),
}

type Fault = Arc<Mutex<dyn FnMut(u64, Vec<u8>) -> Act + Send>>;

/// A TCP proxy that knows where frames begin.
struct Proxy;

impl Proxy {
    /// A proxy before `upstream`; `fault` is given every data frame with its number, counted over all
    /// connections. Returns its address.
    async fn start(
        upstream: SocketAddr,
        fault: impl FnMut(u64, Vec<u8>) -> Act + Send + 'static,
    ) -> SocketAddr {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let (fault, count): (Fault, _) = (Arc::new(Mutex::new(fault)), Arc::new(AtomicU64::new(0)));
        tokio::spawn(async move {
            while let Ok((client, _)) = listener.accept().await {
                let server = TcpStream::connect(upstream).await.unwrap();
                tokio::spawn(pass(client, server, Arc::clone(&fault), Arc::clone(&count)));
            }
        });
        address
    }
}

async fn pass(mut client: TcpStream, mut server: TcpStream, fault: Fault, count: Arc<AtomicU64>) {
    let (mut from_client, mut from_server) = ([0; 4096], [0; 4096]);
    let mut held: Vec<u8> = Vec::new();
    loop {
        tokio::select! {
            read = client.read(&mut from_client) => match read {
                Ok(length @ 1..) => server.write_all(&from_client[..length]).await.unwrap(),
                _ => return,
            },
            read = server.read(&mut from_server) => {
                let Ok(length @ 1..) = read else {
                    return;
                };
                held.extend(&from_server[..length]);
            }
        }
        while let Some(size) = held
            .get(2..4)
            .map(|b| usize::from(b[0]) << 8 | usize::from(b[1]))
        {
            if held.len() < size {
                break;
            }
            let frame: Vec<u8> = held.drain(..size).collect();
            let is_data = frame[1] >> 4 == 0;
            let act = if is_data {
                let number = count.fetch_add(1, Ordering::Relaxed);
                fault.lock().unwrap()(number, frame)
            } else {
                Act::Forward(frame)
            };
            let (bytes, cut) = match act {
                Act::Forward(bytes) => (bytes, false),
                Act::Cut(bytes) => (bytes, true),
            };
            // The bridge may have gone.
            if client.write_all(&bytes).await.is_err() || cut {
                return;
            }
        }
    }
}

async fn wait_while_sending(pmu: &Pmu, done: impl Fn() -> bool) {
    wait_for("it", || {
        pmu.send();
        done()
    })
    .await;
}

async fn wait_for(what: &str, done: impl Fn() -> bool) {
    let begun = SystemTime::now();
    while !done() {
        assert!(
            begun.elapsed().unwrap() < LIMIT,
            "waited in vain for {what}"
        );
        sleep(Duration::from_millis(5)).await;
    }
}

async fn free_udp_address() -> SocketAddr {
    let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    socket.local_addr().unwrap()
}

fn site(v_base_kv: f64) -> Site {
    Site {
        name: "north".to_owned(),
        s_base_mva: 40.0,
        v_base_kv,
        nominal_hz: 50.0,
    }
}

/// The first PMU of the stream, by its number.
fn mapping() -> LoadMapping {
    let set = |name: &str| PhasorSet::PositiveSequence(name.to_owned());
    LoadMapping {
        pmu: loadmodeld::adapters::c37118::PmuChoice::IdCode(ID_CODE),
        ..LoadMapping::new(set("V1"), set("I1"))
    }
}

/// Sample number `k`: its time is its number, and its values are told apart.
fn sample(k: u64) -> Sample {
    let x = (k % 1000) as f64 * 1e-4;
    let record = Record {
        start_ns: START_NS,
        rate_fps: RATE_FPS,
        nominal_hz: 50.0,
        samples: Vec::new(),
    };
    Sample {
        time_ns: record.time_ns(usize::try_from(k).unwrap()),
        voltage_pu: 1.0 - x,
        angle_rad: x,
        frequency_hz: 50.0 + x,
        active_pu: 0.8 + x,
        reactive_pu: 0.2 - x,
        negative_sequence_ratio: f64::NAN,
        quality: Quality::GOOD,
    }
}

fn number(time_ns: i64) -> u64 {
    let period_ns = 20_000_000;
    u64::try_from((time_ns - START_NS + period_ns / 2) / period_ns).unwrap()
}

fn now_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    i64::try_from(since.as_nanos()).unwrap()
}

fn runtime() -> Runtime {
    tokio::runtime::Builder::new_multi_thread()
        .worker_threads(2)
        .enable_all()
        .build()
        .unwrap()
}
