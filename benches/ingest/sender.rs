//! The streams, in a process of their own: its time and memory are not the daemon's. Messages are prepared
//! beforehand; what is left to do for each is a stamp, a check word and the put. One thread, and each stream at
//! its own phase, so that messages are spread evenly.

use std::{
    env,
    io::{BufRead, BufReader},
    process::{Child, Command, Stdio},
    thread,
    time::Duration,
};

use ::zenoh::{Wait, pubsub::Publisher, qos::CongestionControl};
use loadmodeld::{
    adapters::zenoh::{self, Encoding, Keys, Mode, Session, ZenohOptions},
    daemon::clock,
};
use tokio::runtime::Runtime;

use super::{
    clock::wall_seconds,
    source::{Payload, STREAM, Source, Template, site},
    transport::process_cpu_seconds,
};

/// What the first argument of the process says.
pub const ARGUMENT: &str = "--send";
/// Between two looks at what is due: a sleep for each of 60,000 messages a second would cost more than they do.
const PAUSE: Duration = Duration::from_millis(1);

/// What is to be sent.
#[derive(Clone, Copy, Debug)]
pub struct Load {
    pub streams: usize,
    pub payload: Payload,
    pub rate_fps: f64,
    pub seconds: f64,
}

/// What was sent.
#[derive(Clone, Copy, Debug)]
pub struct Sent {
    pub samples: u64,
    /// Share of the messages that were put later than a period after their time.
    pub late: f64,
    pub cores: f64,
    pub wall_s: f64,
}

/// Name of a stream's site.
pub fn name(stream: usize) -> String {
    format!("site-{stream:04}")
}

/// Starts the process that sends.
pub fn start(endpoint: &str, load: &Load) -> Child {
    Command::new(env::current_exe().unwrap())
        .args([ARGUMENT, endpoint])
        .arg(load.streams.to_string())
        .arg(load.payload.code())
        .arg(load.rate_fps.to_string())
        .arg(load.seconds.to_string())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits for its end and its word.
pub fn end(mut child: Child) -> Sent {
    let lines = BufReader::new(child.stdout.take().unwrap()).lines();
    let last = lines.map_while(Result::ok).last().expect("a line");
    assert!(child.wait().unwrap().success(), "the sender failed");
    let numbers: Vec<f64> = last.split(' ').map(|n| n.parse().unwrap()).collect();
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a count"
    )]
    let samples = numbers[0] as u64;
    Sent {
        samples,
        late: numbers[1],
        cores: numbers[2],
        wall_s: numbers[3],
    }
}

/// The process itself.
pub fn run(arguments: &[String]) {
    let [endpoint, streams, payload, rate, seconds] = arguments else {
        panic!("{ARGUMENT} ENDPOINT STREAMS PAYLOAD RATE SECONDS");
    };
    let load = Load {
        streams: streams.parse().unwrap(),
        payload: Payload::of_code(payload),
        rate_fps: rate.parse().unwrap(),
        seconds: seconds.parse().unwrap(),
    };
    let runtime = Runtime::new().unwrap();
    let session = runtime.block_on(async {
        let options = ZenohOptions {
            mode: Mode::Client,
            listen: Vec::new(),
            connect: vec![endpoint.clone()],
            ..ZenohOptions::default()
        };
        zenoh::open(&options).await.unwrap()
    });
    let sent = send(&session, &load);
    println!(
        "{} {} {} {}",
        sent.samples, sent.late, sent.cores, sent.wall_s
    );
    runtime.block_on(zenoh::close(&session, Duration::from_secs(2)));
    runtime.shutdown_timeout(Duration::from_secs(1));
}

struct Stream<'s> {
    publisher: Publisher<'s>,
    template: Template,
    start_ns: i64,
}

fn send(session: &Session, load: &Load) -> Sent {
    let keys = Keys::new(&ZenohOptions::default().prefix);
    let message_ns = 1e9 * load.payload.samples() as f64 / load.rate_fps;
    let mut streams: Vec<Stream<'_>> = Vec::with_capacity(load.streams);
    for k in 0..load.streams {
        let (name, start_ns) = (name(k), 0);
        let publisher = session
            .declare_publisher(keys.measurement(&name, STREAM))
            .encoding(Encoding::default())
            .congestion_control(CongestionControl::Block)
            .wait()
            .unwrap();
        while !publisher.matching_status().wait().unwrap().matching() {
            thread::sleep(PAUSE);
        }
        let source = Source::new(site(&name), load.rate_fps, clock::now_ns());
        publisher.put(source.configuration()).wait().unwrap();
        streams.push(Stream {
            publisher,
            template: Template::new(&site(&name), load.rate_fps, load.payload),
            start_ns,
        });
    }
    let start_ns = clock::now_ns() + 200_000_000;
    for (k, stream) in streams.iter_mut().enumerate() {
        stream.start_ns = start_ns + nanoseconds(message_ns * k as f64 / load.streams as f64);
    }
    let (begun, cpu) = (wall_seconds(), process_cpu_seconds());
    // A message is put when its newest sample is measured.
    let newest_ns = nanoseconds(1e9 / load.rate_fps * (load.payload.samples() - 1) as f64);
    let rounds = (load.seconds * 1e9 / message_ns).ceil();
    let (mut round, mut messages, mut late) = (0.0, 0_u64, 0_u64);
    while round < rounds {
        for stream in &mut streams {
            let first_ns = stream.start_ns + nanoseconds(round * message_ns);
            let due_ns = first_ns + newest_ns;
            let mut now_ns = clock::now_ns();
            while now_ns < due_ns {
                thread::sleep(PAUSE.max(clock::duration(due_ns - now_ns)));
                now_ns = clock::now_ns();
            }
            late += u64::from((now_ns - due_ns) as f64 > 1e9 / load.rate_fps);
            let message = stream.template.at(first_ns).to_vec();
            stream.publisher.put(message).wait().unwrap();
            messages += 1;
        }
        round += 1.0;
    }
    let wall_s = wall_seconds() - begun;
    Sent {
        samples: messages * load.payload.samples() as u64,
        late: late as f64 / messages as f64,
        cores: (process_cpu_seconds() - cpu) / wall_s,
        wall_s,
    }
}

#[allow(clippy::cast_possible_truncation, reason = "less than a day")]
fn nanoseconds(value: f64) -> i64 {
    value.round() as i64
}
