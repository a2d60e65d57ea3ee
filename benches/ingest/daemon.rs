//! A daemon with many streams, one site each, and their sender in a process of its own. The newest sample of a
//! message carries the time at which the message is due, so that the lag the daemon shows is the time from the
//! put to the detector, zenoh and the sender's own lateness included; the daemon's histogram has the time from
//! arrival to behind the detector, of every message.

use std::{
    collections::BTreeMap,
    fmt,
    fmt::Write as _,
    io::{Read, Write},
    net::{SocketAddr, TcpStream},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    thread,
    time::Duration,
};

use loadmodeld::{
    config::Config,
    daemon::{self, Settings},
};
use tokio::runtime::Runtime;

use super::{
    clock::wall_seconds,
    sender::{self, Load, Sent, name},
    transport::process_cpu_seconds,
};

/// Time between two looks at the lags, seconds: as often as a Prometheus may look.
const LOOK_S: f64 = 5.0;
/// Longest wait for what is on its way when the sender has ended, seconds.
const REST_S: f64 = 30.0;
/// What may become of a sample.
const ENDS: [&str; 4] = ["accepted", "late", "duplicate", "refused"];

pub struct Outcome {
    sent: Sent,
    /// Samples by what became of them.
    ends: [u64; ENDS.len()],
    missing: u64,
    dropped: u64,
    samples_per_message: u64,
    lags_ms: Vec<f64>,
    /// Upper bounds in milliseconds, and messages that took no longer.
    through: Vec<(f64, u64)>,
    cores: f64,
    resident_mb: f64,
    grown_kb_per_stream: f64,
}

pub fn run(load: &Load) -> Outcome {
    let directory = tempfile::tempdir().unwrap();
    let store = directory.path().join("store.sqlite");
    let config = config(load.streams, &store.display().to_string());
    let config = Config::parse(&config, "bench").unwrap();
    let settings = Settings::from_config(&config).unwrap();
    let runtime = Runtime::new().unwrap();
    let before_kb = resident_kb();
    let outcome = runtime.block_on(async {
        let daemon = daemon::start(settings, Arc::new(|_| {})).await.unwrap();
        let http = daemon.http_address().unwrap();
        let sending = sender::start(&daemon.endpoints()[0], load);
        let done = Arc::new(AtomicBool::new(false));
        let looking = thread::spawn({
            let done = Arc::clone(&done);
            move || look(http, &done)
        });
        let cpu = process_cpu_seconds();
        let sent = tokio::task::spawn_blocking(move || sender::end(sending))
            .await
            .unwrap();
        let cores = (process_cpu_seconds() - cpu) / sent.wall_s;
        done.store(true, Ordering::Relaxed);
        let lags_ms = looking.join().unwrap();
        let metrics = metrics_when_quiet(http, sent.samples);
        let resident = resident_kb();
        daemon.stop();
        daemon.join().await.unwrap();
        Outcome {
            ends: ENDS.map(|outcome| samples(&metrics, outcome)),
            missing: samples(&metrics, "missing") + samples(&metrics, "skipped"),
            dropped: sum(&metrics, "loadmodeld_messages_dropped_total", "measurement"),
            samples_per_message: load.payload.samples() as u64,
            through: through(&metrics),
            sent,
            lags_ms,
            cores,
            resident_mb: resident / 1024.0,
            grown_kb_per_stream: (resident - before_kb) / load.streams as f64,
        }
    });
    runtime.shutdown_timeout(Duration::from_secs(1));
    outcome
}

fn samples(metrics: &str, outcome: &str) -> u64 {
    let label = format!("outcome=\"{outcome}\"");
    sum(metrics, "loadmodeld_samples_total", &label)
}

/// The metrics once every sample has come to one end or another, or nothing comes any more.
fn metrics_when_quiet(http: SocketAddr, sent: u64) -> String {
    let begun = wall_seconds();
    loop {
        let text = metrics(http);
        let ended: u64 = ENDS.iter().map(|outcome| samples(&text, outcome)).sum();
        if ended >= sent || wall_seconds() - begun > REST_S {
            return text;
        }
        thread::sleep(Duration::from_millis(100));
    }
}

/// The lag of every site's newest message, now and then.
fn look(http: SocketAddr, done: &AtomicBool) -> Vec<f64> {
    let mut lags_ms = Vec::new();
    let mut next = wall_seconds() + LOOK_S;
    while !done.load(Ordering::Relaxed) {
        thread::sleep(Duration::from_millis(50));
        if wall_seconds() < next {
            continue;
        }
        next += LOOK_S;
        for line in metrics(http).lines() {
            if line.starts_with("loadmodeld_sample_lag_seconds{") {
                lags_ms.push(1e3 * value(line));
            }
        }
    }
    lags_ms.sort_by(f64::total_cmp);
    lags_ms
}

/// The histogram of the time from arrival to behind the detector.
fn through(metrics: &str) -> Vec<(f64, u64)> {
    let bucket = |line: &str| {
        let (bound, count) = line
            .strip_prefix("loadmodeld_intake_seconds_bucket{le=\"")?
            .split_once("\"} ")?;
        let bound_s: f64 = bound.replace("+Inf", "inf").parse().ok()?;
        Some((1e3 * bound_s, count.parse().ok()?))
    };
    metrics.lines().filter_map(bucket).collect()
}

impl Outcome {
    /// Samples that came to no end that is counted.
    fn unexplained(&self) -> i64 {
        let count = |n: u64| i64::try_from(n).expect("a count");
        let ended: i64 = self.ends.iter().map(|n| count(*n)).sum();
        count(self.sent.samples) - ended - count(self.dropped * self.samples_per_message)
    }

    /// Upper bound of the bucket that holds a share of the messages, milliseconds.
    fn through_ms(&self, share: f64) -> f64 {
        let all = self.through.last().map_or(0, |(_, count)| *count);
        let wanted = share * all as f64;
        let holds = self
            .through
            .iter()
            .find(|(_, count)| *count as f64 >= wanted);
        holds.map_or(f64::NAN, |(bound_ms, _)| *bound_ms)
    }
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
        let [accepted, late, duplicate, refused] = self.ends;
        let longest = self.through_ms(1.0);
        writeln!(
            f,
            "  sent {} samples in {:.1} s ({:.2} % of the messages late, {:.2} cores)",
            self.sent.samples,
            self.sent.wall_s,
            100.0 * self.sent.late,
            self.sent.cores
        )?;
        writeln!(
            f,
            "  accepted {accepted}, late {late}, duplicate {duplicate}, refused {refused}, unexplained {}; \
             {} messages dropped, {} instants missing",
            self.unexplained(),
            self.dropped,
            self.missing
        )?;
        writeln!(
            f,
            "  arrival to behind the detector: 50 % <= {} ms, 99 % <= {} ms, 99.9 % <= {} ms, all <= {longest} ms; \
             buckets {:?}",
            self.through_ms(0.5),
            self.through_ms(0.99),
            self.through_ms(0.999),
            self.through
        )?;
        writeln!(
            f,
            "  put to detector, {} looks: p50 {:.1} ms, p99 {:.1} ms, worst {:.1} ms",
            self.lags_ms.len(),
            quantile(0.5),
            quantile(0.99),
            self.lags_ms.last().copied().unwrap_or(f64::NAN)
        )?;
        write!(
            f,
            "  daemon: {:.2} cores, {:.2} us of CPU per sample, {:.0} MB resident, {:.1} kB grown per stream",
            self.cores,
            1e6 * self.cores * self.sent.wall_s / self.sent.samples as f64,
            self.resident_mb,
            self.grown_kb_per_stream
        )
    }
}

fn config(streams: usize, store: &str) -> String {
    let mut text = format!(
        "[zenoh]\nlisten = [\"tcp/127.0.0.1:0\"]\n\
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
