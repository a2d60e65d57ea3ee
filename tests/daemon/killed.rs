//! kill -9 at any moment, again and again, while frames are on their way: no stored window is lost or there
//! twice, and every instant is either taken in by one of the runs or counted as passed over.
//!
//! `LOADMODELD_KILLS=200` makes it as many kills; the gate makes a few.

use std::{
    collections::BTreeSet,
    sync::{
        Arc,
        atomic::{AtomicBool, AtomicU64, Ordering},
    },
};

use loadmodeld::{
    adapters::{
        c37118::{ConfigurationKind, Played},
        store::{SqliteOptions, SqliteStore, Store, WindowQuery},
        zenoh::FramePublisher,
    },
    measurement::{Sample, Site, record::grid_offset_ns},
};

use super::*;

const SITES: [&str; 4] = ["east", "north", "south", "west"];
const KILLS: usize = 3;
pub(super) const RATE_FPS: f64 = 60.0;
pub(super) const START_NS: i64 = 1_767_225_600_000_000_000;
/// Ten times the pace of the stamps.
const FRAMES_PER_MESSAGE: u64 = 6;
const BETWEEN_MESSAGES: Duration = Duration::from_millis(10);
/// A dip every ten seconds, of a fifth of a second.
pub(super) const DIP_EVERY: u64 = 600;
const DIP_FRAMES: u64 = 12;

#[test]
fn killed_at_any_moment_no_stored_window_is_lost_or_twice_and_every_instant_is_accounted_for() {
    let kills = std::env::var("LOADMODELD_KILLS");
    let kills = kills.map_or(KILLS, |text| text.parse().expect("a number of kills"));
    let publisher = Publisher::start();
    let place = Place::killed(&publisher.endpoint);
    let mut random = 20_261_121_u64;
    let mut below = |bound: u64| {
        random = random
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (random >> 33) % bound
    };
    let mut ledger = Ledger::default();
    for kill in 0..kills {
        let delay = Duration::from_millis(below(1500));
        if kill % 3 == 2 {
            // Not even waited for: it may be opening its store.
            let mut child = place.spawn();
            thread::sleep(delay);
            child.kill().unwrap();
            child.wait().unwrap();
        } else {
            let mut daemon = place.start();
            ledger.open(&daemon, publisher.sent());
            thread::sleep(delay);
            daemon.child.kill().unwrap();
            daemon.child.wait().unwrap();
        }
        ledger.close(&place, publisher.sent());
    }
    // The last run ends as asked, with whatever was open.
    let last = place.start();
    ledger.open(&last, publisher.sent());
    wait_for("windows of the last run", || {
        (last.windows_closed() > SITES.len()).then_some(())
    });
    let (sent, unheard) = publisher.end();
    assert!(last.terminate().success());
    ledger.close(&place, sent);
    println!(
        "{kills} kills, {sent} frames of each of {} streams ({unheard} while nobody subscribed), {} windows, {} \
         instants passed over in {} runs that were looked at",
        SITES.len(),
        ledger.windows.len(),
        ledger.skipped,
        ledger.looked_at
    );
    assert!(!ledger.windows.is_empty());
    // The publisher knows of the time without a daemon, too.
    assert!((1..sent).contains(&unheard), "{unheard} of {sent}");
}

/// What has to hold between one run and the next.
#[derive(Default)]
struct Ledger {
    /// Number of the newest instant that the store knows of, by site.
    progress: [Option<u64>; SITES.len()],
    /// Windows that the store had after any of the kills.
    windows: BTreeSet<String>,
    skipped: u64,
    looked_at: usize,
}

impl Ledger {
    /// A run has begun: what it says it has not seen is what lies between the store's word and its first
    /// sample.
    fn open(&mut self, daemon: &Daemon, sent: u64) {
        for (site, progress) in SITES.iter().zip(self.progress) {
            let (first, skipped) =
                wait_for("the first samples", || first_and_skipped(daemon, site));
            assert!(first < sent + 100_000, "{first} of {sent}");
            let expected = progress.map_or(0, |newest| first - newest - 1);
            assert_eq!(skipped, expected, "{site}: {progress:?} to {first}");
            self.skipped += skipped;
        }
        self.looked_at += 1;
    }

    /// A run has ended, one way or the other.
    fn close(&mut self, place: &Place, sent: u64) {
        let path = place.directory.path().join("store.sqlite");
        let store = SqliteStore::open(&path, &SqliteOptions::default()).unwrap();
        for (site, progress) in store.progress().unwrap() {
            let at = SITES.iter().position(|name| **name == *site).unwrap();
            let newest = number(progress.newest_ns);
            assert!(self.progress[at] <= Some(newest) && newest < sent, "{site}");
            self.progress[at] = Some(newest);
        }
        let query = WindowQuery {
            count_max: 1_000_000,
            ..WindowQuery::default()
        };
        let stored = store.window_summaries(&query).unwrap();
        let ids: BTreeSet<String> = stored.iter().map(|window| window.id.clone()).collect();
        let lost: Vec<_> = self.windows.difference(&ids).collect();
        assert!(lost.is_empty(), "stored before and gone: {lost:?}");
        // A dip is one window, whatever happened around it.
        let dips: BTreeSet<(&str, u64)> = stored
            .iter()
            .map(|window| (window.site.as_str(), number(window.onset_ns) / DIP_EVERY))
            .collect();
        assert_eq!(dips.len(), stored.len(), "a dip has two windows");
        self.windows = ids;
    }
}

/// Number of a run's first sample at a site, and how many instants it says were passed over before. None
/// while nothing has come, or while the metrics move between two lines.
pub(super) fn first_and_skipped(daemon: &Daemon, site: &str) -> Option<(u64, u64)> {
    let first = |metrics: &str| {
        let samples = |outcome: &str| {
            let name = format!("loadmodeld_samples_total{{outcome=\"{outcome}\",site=\"{site}\"}}");
            value(metrics, &name)
        };
        let newest = format!("loadmodeld_newest_sample_timestamp_seconds{{site=\"{site}\"}}");
        let newest_s = value(metrics, &newest)?;
        let spoilt = ["missing", "late", "duplicate", "refused"].map(samples);
        assert_eq!(spoilt, [None; 4], "{site}");
        let since_s = newest_s - START_NS as f64 / 1e9;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "whole numbers from 0 on"
        )]
        let first = ((since_s * RATE_FPS).round() - samples("accepted")? + 1.0) as u64;
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a counter"
        )]
        let skipped = samples("skipped").unwrap_or(0.0) as u64;
        Some((first, skipped))
    };
    let before = first(&daemon.get("/metrics").1)?;
    let after = first(&daemon.get("/metrics").1)?;
    (before == after).then_some(before)
}

pub(super) fn value(metrics: &str, name: &str) -> Option<f64> {
    let line = metrics.lines().find_map(|line| line.strip_prefix(name))?;
    line.trim().parse().ok()
}

pub(super) fn number(time_ns: i64) -> u64 {
    let period_ns = 1e9 / RATE_FPS;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "times from the start on"
    )]
    let number = ((time_ns - START_NS) as f64 / period_ns).round() as u64;
    number
}

impl Place {
    /// A daemon that hears the sites through a router. Its windows are screened and refused: fits are not what
    /// is tried here.
    fn killed(router: &str) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let mut text = format!(
            "[instance]\nname = \"tested\"\n\
             [zenoh]\nprefix = \"{PREFIX}\"\nmode = \"client\"\nlisten = []\nconnect = [\"{router}\"]\n\
             [store]\npath = \"{}\"\n[http]\nlisten = \"127.0.0.1:0\"\n[log]\nformat = \"json\"\n\
             [detection]\npost_trigger_s = 2\npre_trigger_s = 1\n[screening]\nactive_min_pu = 0.9\n",
            directory.path().join("store.sqlite").display(),
        );
        for name in SITES {
            let own = format!(
                "[[site]]\nname = \"{name}\"\ns_base_mva = 40\nv_base_kv = 110\nnominal_hz = 60\n\
                 [[site.c37118]]\nvoltage = [\"V1\"]\ncurrents = [\"I1\"]\n"
            );
            text.push_str(&own);
        }
        fs::write(directory.path().join("config.toml"), text).unwrap();
        Self { directory }
    }

    fn spawn(&self) -> Child {
        Command::new(PROGRAM)
            .args(["run", "--config"])
            .arg(self.directory.path().join("config.toml"))
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    }
}

/// A PMU per site that publishes without a pause: as a router of its own, or through a session.
pub(super) struct Publisher {
    endpoint: String,
    sent: Arc<AtomicU64>,
    stop: Arc<AtomicBool>,
    thread: thread::JoinHandle<u64>,
}

impl Publisher {
    fn start() -> Self {
        let router = ZenohOptions {
            mode: Mode::Router,
            listen: vec!["tcp/127.0.0.1:0".to_owned()],
            ..ZenohOptions::default()
        };
        Self::with(router, SITES.map(str::to_owned).to_vec())
    }

    /// For these sites, by a session of its own.
    pub(super) fn with(options: ZenohOptions, sites: Vec<String>) -> Self {
        let (sent, stop) = (
            Arc::new(AtomicU64::new(0)),
            Arc::new(AtomicBool::new(false)),
        );
        let (counted, stopped) = (Arc::clone(&sent), Arc::clone(&stop));
        let (endpoint_sender, endpoint) = channel();
        let thread = thread::spawn(move || {
            runtime().block_on(async {
                let session = zenoh::open(&options).await.unwrap();
                let endpoints = session.info().locators().await;
                let endpoint = endpoints.first().map(ToString::to_string);
                endpoint_sender.send(endpoint.unwrap_or_default()).unwrap();
                let keys = Keys::new(PREFIX);
                let publisher = FramePublisher::new(&session, &keys, &sites, "pmu");
                let publisher = publisher.await.unwrap();
                let mut played = Played::new(&site(), RATE_FPS, 7).unwrap();
                let configuration = played.configuration(ConfigurationKind::Configuration2);
                let configuration = configuration.encode().unwrap().concat();
                publisher
                    .put_configuration(configuration, LIMIT)
                    .await
                    .unwrap();
                let mut unheard = 0;
                while !stopped.load(Ordering::Relaxed) {
                    let first = counted.load(Ordering::Relaxed);
                    let numbers = first..first + FRAMES_PER_MESSAGE;
                    let frames = numbers.map(|k| played.frame(&sample(k)).unwrap().unwrap());
                    let frames = frames.collect::<Vec<_>>().concat();
                    counted.store(first + FRAMES_PER_MESSAGE, Ordering::Relaxed);
                    if !publisher.put(&frames, LIMIT).await.unwrap() {
                        unheard += FRAMES_PER_MESSAGE;
                    }
                    tokio::time::sleep(BETWEEN_MESSAGES).await;
                }
                unheard
            })
        });
        Self {
            endpoint: endpoint.recv_timeout(LIMIT).unwrap(),
            sent,
            stop,
            thread,
        }
    }

    /// Frames of each stream that may have gone out.
    pub(super) fn sent(&self) -> u64 {
        self.sent.load(Ordering::Relaxed)
    }

    /// Frames of each stream that have gone out, and those of them that nobody had subscribed to.
    pub(super) fn end(self) -> (u64, u64) {
        self.stop.store(true, Ordering::Relaxed);
        let unheard = self.thread.join().unwrap();
        (self.sent.load(Ordering::Relaxed), unheard)
    }
}

fn site() -> Site {
    Site {
        name: "north".to_owned(),
        s_base_mva: 40.0,
        v_base_kv: 110.0,
        nominal_hz: 60.0,
    }
}

fn sample(k: u64) -> Sample {
    let since = k % DIP_EVERY;
    let dips = (DIP_EVERY / 2..DIP_EVERY / 2 + DIP_FRAMES).contains(&since);
    let voltage_pu = if dips { 0.8 } else { 1.0 };
    Sample {
        time_ns: START_NS + grid_offset_ns(k as f64, RATE_FPS),
        voltage_pu,
        angle_rad: 0.0,
        frequency_hz: 60.0,
        active_pu: 0.6 * voltage_pu,
        reactive_pu: 0.2 * voltage_pu,
        negative_sequence_ratio: f64::NAN,
        quality: Quality::GOOD,
    }
}
