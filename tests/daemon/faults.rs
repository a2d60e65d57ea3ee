//! What is between a PMU and the store fails for a while: the network before zenoh, by a proxy of our own that
//! cuts, holds back, swaps and damages, and the store, by somebody who holds it. Faults begin and end by what has
//! been seen, not by the clock.

use std::{
    collections::BTreeSet,
    sync::{
        Arc, Mutex,
        atomic::{AtomicU64, Ordering},
    },
};

use loadmodeld::adapters::store::{SqliteOptions, SqliteStore, Store, WindowQuery};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, tcp::OwnedReadHalf, tcp::OwnedWriteHalf},
};

use super::{
    killed::{DIP_EVERY, Publisher, RATE_FPS, START_NS, first_and_skipped, number, value},
    *,
};

/// Samples that have to come through before the next fault.
const BETWEEN: u64 = 300;

#[test]
#[allow(clippy::too_many_lines, reason = "one history from start to end")]
fn faults_of_the_network_before_zenoh_cost_what_they_hit_and_it_is_counted() {
    let place = Place::listening();
    let daemon = place.start();
    let runtime = runtime();
    let proxy = runtime.block_on(Proxy::start(&daemon.endpoint));
    let through = ZenohOptions {
        mode: Mode::Client,
        listen: Vec::new(),
        connect: vec![proxy.endpoint.clone()],
        ..ZenohOptions::default()
    };
    let publisher = Publisher::with(through, vec![SITE.to_owned()]);
    let (first, _) = wait_for("the first samples", || first_and_skipped(&daemon, SITE));
    let counted = |name: &str| {
        let metrics = daemon.get("/metrics").1;
        whole(value(&metrics, name).unwrap_or(0.0))
    };
    let samples = |outcome: &str| {
        counted(&format!(
            "loadmodeld_samples_total{{outcome=\"{outcome}\",site=\"{SITE}\"}}"
        ))
    };
    let lost = || samples("missing") + samples("skipped");
    let more_samples = || {
        let before = samples("accepted");
        wait_for("more samples", || {
            (samples("accepted") >= before + BETWEEN).then_some(())
        });
    };

    // Held back: late, and nothing is lost.
    proxy.set(Fault::Hold);
    proxy.until("messages held back", |seen| seen.held >= 30);
    proxy.set(Fault::None);
    more_samples();
    assert_eq!(lost(), 0);

    // A damaged frame costs itself, by its check word.
    proxy.set(Fault::DamageFrame);
    proxy.until("a damaged frame", |seen| seen.damaged_frames == 1);
    let bad =
        format!("loadmodeld_frames_total{{outcome=\"bad_checksum\",site=\"{SITE}\",stream=\"*\"}}");
    wait_for("its check word", || (counted(&bad) == 1).then_some(()));
    more_samples();
    assert_eq!(lost(), 1);

    // Messages that change places: zenoh leaves out what comes behind its number.
    proxy.set(Fault::Swap);
    proxy.until("messages swapped", |seen| seen.swapped == 1);
    more_samples();
    let swapped = lost() - 1 + samples("out_of_order");
    assert!(swapped > 0, "neither lost nor out of order");

    // A connection that is cut, and one whose bytes make no sense to zenoh: both come back.
    for fault in [Fault::Cut, Fault::DamageHead] {
        let before = (proxy.connections(), lost());
        proxy.set(fault);
        wait_for("a new connection", || {
            (proxy.connections() > before.0).then_some(())
        });
        more_samples();
        assert!(lost() > before.1, "{fault:?}");
    }

    let (sent, _) = publisher.end();
    // What was sent last has come: nothing is on its way.
    let newest = format!("loadmodeld_newest_sample_timestamp_seconds{{site=\"{SITE}\"}}");
    wait_for("the last frame", || {
        let newest_s = value(&daemon.get("/metrics").1, &newest)?;
        let at = ((newest_s - START_NS as f64 / 1e9) * RATE_FPS).round();
        (whole(at) + 1 == sent).then_some(())
    });
    let end = format!("loadmodeld_silences_total{{site=\"{SITE}\"}}");
    wait_for("the silence", || (counted(&end) > 0).then_some(()));
    // Every instant from the first sample on was taken in or is known to be missing.
    assert_eq!(samples("accepted") + lost(), sent - first);
    assert_eq!(samples("duplicate") + samples("refused"), 0);
    println!(
        "{sent} frames, {} accepted, {} missing, {} skipped, {} out of order, {} late, over {} connections",
        samples("accepted"),
        samples("missing"),
        samples("skipped"),
        samples("out_of_order"),
        samples("late"),
        proxy.connections()
    );
    assert!(daemon.terminate().success());
    let dips = place.dips();
    let different: BTreeSet<&u64> = dips.iter().collect();
    assert!(!dips.is_empty());
    assert_eq!(
        different.len(),
        dips.len(),
        "a dip is stored twice: {dips:?}"
    );
}

#[test]
fn a_store_that_does_not_answer_holds_up_windows_and_not_the_intake() {
    const WINDOWS: usize = 5;
    let place = Place::listening();
    let daemon = place.start();
    let options = ZenohOptions {
        mode: Mode::Client,
        listen: Vec::new(),
        connect: vec![daemon.endpoint.clone()],
        ..ZenohOptions::default()
    };
    let metric = |name: &str| {
        let metrics = daemon.get("/metrics").1;
        whole(value(&metrics, name).unwrap_or(0.0))
    };
    let accepted = format!("loadmodeld_samples_total{{outcome=\"accepted\",site=\"{SITE}\"}}");
    // Somebody writes and does not end.
    let holder = rusqlite::Connection::open(place.store()).unwrap();
    holder.busy_timeout(Duration::from_mins(1)).unwrap();
    holder.execute_batch("BEGIN IMMEDIATE").unwrap();
    let publisher = Publisher::with(options, vec![SITE.to_owned()]);
    wait_for("windows that wait", || {
        (metric("loadmodeld_windows_spooled") >= WINDOWS as u64).then_some(())
    });
    wait_for("a refusal of the store", || {
        (metric("loadmodeld_store_errors_total{reason=\"busy\"}") > 0).then_some(())
    });
    let before = metric(&accepted);
    wait_for("more samples meanwhile", || {
        (metric(&accepted) >= before + 600).then_some(())
    });
    assert_eq!(daemon.windows_stored(), 0);
    holder.execute_batch("ROLLBACK").unwrap();

    wait_for("the windows", || {
        (daemon.windows_stored() >= WINDOWS as u64).then_some(())
    });
    let (sent, _) = publisher.end();
    wait_for("the last frame", || {
        let dropped = metric("loadmodeld_messages_dropped_total{source=\"measurement\"}");
        assert_eq!(dropped, 0);
        (metric("loadmodeld_windows_spooled") == 0).then_some(())
    });
    for name in ["missing", "late", "refused"] {
        let name = format!("loadmodeld_samples_total{{outcome=\"{name}\",site=\"{SITE}\"}}");
        assert_eq!(metric(&name), 0, "{name}");
    }
    assert_eq!(metric("loadmodeld_windows_dropped_total"), 0);
    assert!(daemon.terminate().success());
    let dips = place.dips();
    // Every dip between the first window and the last is there, once.
    let expected: Vec<u64> = (dips[0]..dips[0] + dips.len() as u64).collect();
    assert_eq!(dips, expected, "of {} dips", sent / DIP_EVERY);
}

/// A counter.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "whole numbers from 0 on"
)]
fn whole(value: f64) -> u64 {
    value as u64
}

impl Place {
    /// A daemon that listens for one site's frames. Its windows are screened and refused: fits are not what is
    /// tried here.
    fn listening() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let text = format!(
            "[instance]\nname = \"tested\"\n\
             [zenoh]\nprefix = \"{PREFIX}\"\nlisten = [\"tcp/127.0.0.1:0\"]\n\
             [store]\npath = \"{}\"\n[http]\nlisten = \"127.0.0.1:0\"\n[log]\nformat = \"json\"\n\
             [detection]\npost_trigger_s = 2\npre_trigger_s = 1\n[screening]\nactive_min_pu = 0.9\n\
             [[site]]\nname = \"{SITE}\"\ns_base_mva = 40\nv_base_kv = 110\nnominal_hz = 60\n\
             [[site.c37118]]\nvoltage = [\"V1\"]\ncurrents = [\"I1\"]\n",
            directory.path().join("store.sqlite").display(),
        );
        fs::write(directory.path().join("config.toml"), text).unwrap();
        Self { directory }
    }

    fn store(&self) -> PathBuf {
        self.directory.path().join("store.sqlite")
    }

    /// Numbers of the dips that were stored, in order, one per window.
    fn dips(&self) -> Vec<u64> {
        let store = SqliteStore::open(&self.store(), &SqliteOptions::default()).unwrap();
        let query = WindowQuery {
            count_max: 1_000_000,
            ..WindowQuery::default()
        };
        let windows = store.window_summaries(&query).unwrap();
        let dip = |onset_ns| number(onset_ns) / DIP_EVERY;
        let mut dips: Vec<u64> = windows.iter().map(|w| dip(w.onset_ns)).collect();
        dips.sort_unstable();
        dips
    }
}

impl Daemon {
    fn windows_stored(&self) -> u64 {
        let name = format!("loadmodeld_windows_total{{site=\"{SITE}\"}}");
        whole(value(&self.get("/metrics").1, &name).unwrap_or(0.0))
    }
}

/// What a proxy does to the messages that a publisher sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// Passes them on.
    None,
    /// Keeps them until told otherwise.
    Hold,
    /// Damages one frame, once.
    DamageFrame,
    /// Lets a message pass the one before it, once.
    Swap,
    /// Makes a message unreadable for zenoh, once.
    DamageHead,
    /// Closes the connection, once.
    Cut,
}

/// What a proxy has done.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    held: u64,
    damaged_frames: u64,
    swapped: u64,
}

#[derive(Debug)]
struct Control {
    fault: Mutex<Fault>,
    seen: Mutex<Seen>,
    connections: AtomicU64,
}

/// A TCP proxy that knows where zenoh's messages begin: each has its length before it, in two bytes.
struct Proxy {
    endpoint: String,
    control: Arc<Control>,
}

impl Proxy {
    async fn start(upstream: &str) -> Self {
        let upstream = upstream.strip_prefix("tcp/").unwrap().to_owned();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let endpoint = format!("tcp/{}", listener.local_addr().unwrap());
        let control = Arc::new(Control {
            fault: Mutex::new(Fault::None),
            seen: Mutex::new(Seen::default()),
            connections: AtomicU64::new(0),
        });
        let controlled = Arc::clone(&control);
        tokio::spawn(async move {
            while let Ok((client, _)) = listener.accept().await {
                let Ok(server) = tokio::net::TcpStream::connect(&upstream).await else {
                    continue;
                };
                controlled.connections.fetch_add(1, Ordering::Relaxed);
                let (mut from_server, to_server) = server.into_split();
                let (from_client, mut to_client) = client.into_split();
                let back = tokio::spawn(async move {
                    // Either side may have gone.
                    drop(tokio::io::copy(&mut from_server, &mut to_client).await);
                });
                let control = Arc::clone(&controlled);
                tokio::spawn(async move {
                    pass(from_client, to_server, &control).await;
                    back.abort();
                });
            }
        });
        Self { endpoint, control }
    }

    fn set(&self, fault: Fault) {
        *self.control.fault.lock().unwrap() = fault;
    }

    fn until(&self, what: &str, seen: impl Fn(Seen) -> bool) {
        wait_for(what, || {
            seen(*self.control.seen.lock().unwrap()).then_some(())
        });
    }

    fn connections(&self) -> u64 {
        self.control.connections.load(Ordering::Relaxed)
    }
}

/// Passes messages on until either side has gone or a fault ends it.
async fn pass(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, control: &Control) {
    let mut held: Vec<Vec<u8>> = Vec::new();
    loop {
        let mut length = [0; 2];
        if from.read_exact(&mut length).await.is_err() {
            return;
        }
        let mut message = vec![0; usize::from(u16::from_le_bytes(length))];
        if from.read_exact(&mut message).await.is_err() {
            return;
        }
        let fault = *control.fault.lock().unwrap();
        let frame = frame_in(&message);
        // Faults hit messages with frames: what keeps the connection alive goes its way.
        match (fault, frame) {
            (Fault::Hold, _) => {
                control.seen.lock().unwrap().held += u64::from(frame.is_some());
                held.push(message);
                continue;
            }
            (Fault::Swap, Some(_)) if held.is_empty() => {
                held.push(message);
                continue;
            }
            (Fault::Swap, Some(_)) => {
                held.insert(0, message);
                control.end_fault(|seen| seen.swapped += 1);
            }
            (Fault::DamageFrame, Some(at)) => {
                // Behind its head: the frame's length stays what it was.
                message[at + 20] ^= 0x40;
                held.push(message);
                control.end_fault(|seen| seen.damaged_frames += 1);
            }
            (Fault::DamageHead, Some(_)) => {
                message.fill(0xff);
                held.push(message);
                control.end_fault(|_| ());
            }
            (Fault::Cut, Some(_)) => {
                control.end_fault(|_| ());
                return;
            }
            _ => held.push(message),
        }
        for message in held.drain(..) {
            let length = u16::try_from(message.len()).unwrap().to_le_bytes();
            let bytes = [&length[..], &message].concat();
            if to.write_all(&bytes).await.is_err() {
                return;
            }
        }
    }
}

impl Control {
    fn end_fault(&self, note: impl FnOnce(&mut Seen)) {
        *self.fault.lock().unwrap() = Fault::None;
        note(&mut self.seen.lock().unwrap());
    }
}

/// Where the first data frame of C37.118 begins in a message: SYNC, version 2, and the publisher's IDCODE.
fn frame_in(message: &[u8]) -> Option<usize> {
    let is_frame = |bytes: &[u8]| bytes[..2] == [0xaa, 0x02] && bytes[4..6] == [0, 7];
    message.windows(24).position(is_frame)
}
