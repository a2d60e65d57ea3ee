//! A daemon with many streams of frames, one site each. Every frame carries the time at which it is put, so
//! that the lag the daemon shows is the time from the put to behind the detector: zenoh included.

use std::{
    collections::BTreeMap,
    fmt,
    fmt::Write as _,
    io::{Read, Write},
    net::{SocketAddr, TcpStream},
    sync::Arc,
    thread,
    time::Duration,
};

use loadmodeld::{
    adapters::zenoh::{self, Encoding, Keys, Mode, ZenohOptions},
    config::Config,
    daemon::{self, Settings, clock},
};
use tokio::runtime::Runtime;

use super::{
    clock::wall_seconds,
    source::{Payload, STREAM, Source, site},
    transport::process_cpu_seconds,
};

/// Time between two looks at the lags, seconds.
const LOOK_S: f64 = 1.0;
/// Seconds before lags count: the first lag time of every grid.
const WARM_UP_S: f64 = 3.0;
const QUEUE: usize = 100_000;

pub struct Outcome {
    sent: u64,
    accepted: u64,
    dropped: u64,
    missing: u64,
    late_puts: f64,
    lags_ms: Vec<f64>,
    cores: f64,
    resident_mb: f64,
    grown_kb_per_stream: f64,
}

pub fn run(streams: usize, per_message: usize, rate_fps: f64, seconds: f64) -> Outcome {
    let directory = tempfile::tempdir().unwrap();
    let config = config(
        streams,
        &directory.path().join("store.sqlite").display().to_string(),
    );
    let config = Config::parse(&config, "bench").unwrap();
    let settings = Settings::from_config(&config).unwrap();
    let runtime = Runtime::new().unwrap();
    let before_kb = resident_kb();
    let outcome = runtime.block_on(async {
        let daemon = daemon::start(settings, Arc::new(|_| {})).await.unwrap();
        let options = ZenohOptions {
            mode: Mode::Client,
            listen: Vec::new(),
            connect: vec![daemon.endpoints()[0].clone()],
            ..ZenohOptions::default()
        };
        let session = zenoh::open(&options).await.unwrap();
        let http = daemon.http_address().unwrap();
        let looking = thread::spawn(move || look(http, seconds));
        let cpu = process_cpu_seconds();
        let (sent, late_puts, wall_s) =
            send(&session, streams, per_message, rate_fps, seconds).await;
        let cores = (process_cpu_seconds() - cpu) / wall_s;
        tokio::time::sleep(Duration::from_secs(2)).await;
        let lags_ms = looking.join().unwrap();
        let metrics = metrics(http);
        let resident = resident_kb();
        drop(session);
        daemon.stop();
        daemon.join().await.unwrap();
        let samples = |outcome: &str| {
            let label = format!("outcome=\"{outcome}\"");
            sum(&metrics, "loadmodeld_samples_total", &label)
        };
        Outcome {
            sent,
            accepted: samples("accepted"),
            missing: samples("missing"),
            dropped: sum(&metrics, "loadmodeld_messages_dropped_total", "measurement"),
            late_puts,
            lags_ms,
            cores,
            resident_mb: resident / 1024.0,
            grown_kb_per_stream: (resident - before_kb) / streams as f64,
        }
    });
    runtime.shutdown_timeout(Duration::from_secs(1));
    outcome
}

/// Sends in turn, each stream at its own phase, so that messages are spread evenly. Returns frames sent,
/// the share of messages put later than a period after their time, and the seconds it took.
async fn send(
    session: &zenoh::Session,
    streams: usize,
    per_message: usize,
    rate_fps: f64,
    seconds: f64,
) -> (u64, f64, f64) {
    let keys = Keys::new(&ZenohOptions::default().prefix);
    let message_ns = 1e9 * per_message as f64 / rate_fps;
    let start_ns = clock::now_ns() + 500_000_000;
    #[allow(
        clippy::cast_possible_truncation,
        reason = "a phase within one message"
    )]
    let phase_ns = |k: usize| (message_ns * k as f64 / streams as f64) as i64;
    let mut sources: Vec<(String, Source)> = (0..streams)
        .map(|k| {
            let name = name(k);
            let key = keys.measurement(&name, STREAM);
            (
                key,
                Source::new(site(&name), rate_fps, start_ns + phase_ns(k)),
            )
        })
        .collect();
    for (key, source) in &sources {
        let put = zenoh::put(session, key, source.configuration(), Encoding::default());
        put.await.unwrap();
    }
    let begun = wall_seconds();
    let (mut sent, mut messages, mut late) = (0, 0_u64, 0_u64);
    let payload = Payload::frames(per_message);
    while wall_seconds() - begun < seconds {
        for (key, source) in &mut sources {
            let message = source.message(payload);
            // A message is put when its last sample is measured, which is just before the next one.
            let period_ns = message_ns / per_message as f64;
            #[allow(clippy::cast_possible_truncation, reason = "some milliseconds")]
            let due_ns = source.next_ns() - period_ns as i64;
            let now_ns = clock::now_ns();
            if now_ns < due_ns {
                thread::sleep(clock::duration(due_ns - now_ns));
            }
            late += u64::from((now_ns - due_ns) as f64 > period_ns);
            zenoh::put(session, key, message, Encoding::default())
                .await
                .unwrap();
            sent += per_message as u64;
            messages += 1;
        }
    }
    (sent, late as f64 / messages as f64, wall_seconds() - begun)
}

/// The lag of every site's newest message, once a second.
fn look(http: SocketAddr, seconds: f64) -> Vec<f64> {
    let begun = wall_seconds();
    let mut lags_ms = Vec::new();
    while wall_seconds() - begun < seconds {
        thread::sleep(Duration::from_secs_f64(LOOK_S));
        if wall_seconds() - begun < WARM_UP_S {
            continue;
        }
        for line in metrics(http).lines() {
            if line.starts_with("loadmodeld_sample_lag_seconds{") {
                lags_ms.push(1e3 * value(line));
            }
        }
    }
    lags_ms.sort_by(f64::total_cmp);
    lags_ms
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let quantile = |share: f64| {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a place in the list"
            )]
            let at = (share * self.lags_ms.len() as f64) as usize;
            self.lags_ms.get(at).copied().unwrap_or(f64::NAN)
        };
        write!(
            f,
            "{} frames sent ({:.2} % of the messages late), {} accepted, {} messages dropped, {} instants \
             missing; lag p50 {:.1} ms, p99 {:.1} ms of {} looks; {:.2} cores with the sender; {:.0} MB \
             resident, {:.1} kB grown per stream",
            self.sent,
            100.0 * self.late_puts,
            self.accepted,
            self.dropped,
            self.missing,
            quantile(0.5),
            quantile(0.99),
            self.lags_ms.len(),
            self.cores,
            self.resident_mb,
            self.grown_kb_per_stream
        )
    }
}

fn config(streams: usize, store: &str) -> String {
    let mut text = format!(
        "[zenoh]\nlisten = [\"tcp/127.0.0.1:0\"]\nintake_messages_max = {QUEUE}\n\
         [store]\npath = \"{store}\"\n[http]\nlisten = \"127.0.0.1:0\"\n"
    );
    for k in 0..streams {
        writeln!(
            text,
            "[[site]]\nname = \"{}\"\ns_base_mva = 40\nv_base_kv = 110\nnominal_hz = 60\n\
             [[site.c37118]]\nvoltage = [\"V1\"]\ncurrents = [\"I1\"]",
            name(k)
        )
        .unwrap();
    }
    text
}

fn name(stream: usize) -> String {
    format!("site-{stream:04}")
}

fn metrics(http: SocketAddr) -> String {
    let mut stream = TcpStream::connect(http).unwrap();
    write!(stream, "GET /metrics HTTP/1.0\r\nHost: localhost\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "counters are whole"
)]
fn sum(metrics: &str, name: &str, label: &str) -> u64 {
    let series: BTreeMap<&str, f64> = metrics
        .lines()
        .filter(|line| line.starts_with(name) && line.contains(label))
        .map(|line| (line, value(line)))
        .collect();
    series.values().sum::<f64>() as u64
}

fn value(line: &str) -> f64 {
    line.rsplit(' ').next().unwrap().parse().unwrap()
}

/// Resident memory of the process, kB.
fn resident_kb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status
        .lines()
        .find(|line| line.starts_with("VmRSS:"))
        .unwrap();
    line.split_whitespace().nth(1).unwrap().parse().unwrap()
}
