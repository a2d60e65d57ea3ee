//! What zenoh carries when nobody does anything with it.

use std::{
    sync::{
        Arc,
        atomic::{AtomicU64, Ordering},
    },
    thread,
    time::Duration,
};

use loadmodeld::adapters::zenoh::{self, Encoding, Mode, ZenohOptions};
use rustix::time::{ClockId, clock_gettime};
use tokio::runtime::Runtime;

use super::{
    clock::wall_seconds,
    source::{Payload, Source, site},
};

/// Longest measurement, seconds.
const LONGEST_S: f64 = 5.0;

pub struct Carried {
    pub messages_per_s: f64,
    /// Of the whole process: both ends.
    pub cpu_s_per_message: f64,
}

pub fn carry(payload: &Payload) -> Carried {
    let runtime = Runtime::new().unwrap();
    let message = Source::new(site("bench"), 60.0, 1_700_000_000_000_000_000).message(*payload);
    let (sent, wall_s, cpu_s) = runtime.block_on(async {
        let options = ZenohOptions {
            listen: vec!["tcp/127.0.0.1:0".to_owned()],
            ..ZenohOptions::default()
        };
        let listener = zenoh::open(&options).await.unwrap();
        let endpoint = listener.info().locators().await[0].to_string();
        let options = ZenohOptions {
            mode: Mode::Client,
            listen: Vec::new(),
            connect: vec![endpoint],
            ..ZenohOptions::default()
        };
        let sender = zenoh::open(&options).await.unwrap();
        let received = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&received);
        let subscriber = listener
            .declare_subscriber("bench/**")
            .callback(move |sample| {
                let bytes = sample.payload().to_bytes().len();
                counted.fetch_add(u64::from(bytes > 0), Ordering::Relaxed);
            });
        let _subscriber = subscriber.await.unwrap();
        let put = || zenoh::put(&sender, "bench/a/pmu", message.clone(), Encoding::default());
        // The declaration takes a moment to reach the sender.
        while received.load(Ordering::Relaxed) == 0 {
            put().await.unwrap();
            thread::sleep(Duration::from_millis(5));
        }
        let mut expected = received.load(Ordering::Relaxed);
        thread::sleep(Duration::from_millis(100));
        expected = expected.max(received.load(Ordering::Relaxed));
        let (begun, cpu) = (wall_seconds(), process_cpu_seconds());
        let mut sent = 0;
        while wall_seconds() - begun < LONGEST_S {
            for _ in 0..100 {
                put().await.unwrap();
            }
            sent += 100;
        }
        while received.load(Ordering::Relaxed) < expected + sent {
            thread::sleep(Duration::from_millis(1));
        }
        (sent, wall_seconds() - begun, process_cpu_seconds() - cpu)
    });
    runtime.shutdown_timeout(Duration::from_secs(1));
    Carried {
        messages_per_s: sent as f64 / wall_s,
        cpu_s_per_message: cpu_s / sent as f64,
    }
}

pub fn process_cpu_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}
