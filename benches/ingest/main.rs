//! What intake costs: from payload to detector on one core, against what zenoh itself carries in the same
//! run, and a whole daemon with many streams.
//!
//!     cargo bench --bench ingest -- [--streams 100,1000] [--seconds 30] [--rate 60] [--per-message 1,6] \
//!         [--forms c37118,cbor] [--only daemon]
//!
//! `--forms` are those that the daemon is sent, `--only daemon` leaves out the costs on one core.
//!
//! Costs are CPU times of the thread that works, so that other work on the machine counts little; the
//! lag is by the clock.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stdout,
    missing_docs,
    unreachable_pub,
    reason = "a bench that cannot go on should say why"
)]

#[path = "../clock.rs"]
mod clock;
mod daemon;
mod path;
mod sender;
mod source;
mod transport;

use sender::Load;
use source::Payload;

/// What is asked for.
#[derive(Clone, Debug)]
struct Plan {
    streams: Vec<usize>,
    per_message: Vec<usize>,
    forms: Vec<String>,
    only_daemon: bool,
    seconds: f64,
    rate_fps: f64,
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if let Some((sender::ARGUMENT, rest)) = arguments.split_first().map(|(a, r)| (a.as_str(), r)) {
        return sender::run(rest);
    }
    let plan = plan(arguments);
    if !plan.only_daemon {
        costs(&plan);
    }
    println!(
        "\na daemon, {} frames/s per stream, {} s each:",
        plan.rate_fps, plan.seconds
    );
    for form in &plan.forms {
        for per_message in &plan.per_message {
            for &streams in &plan.streams {
                let payload = Payload::of_code(&format!("{form}:{per_message}"));
                let load = Load {
                    streams,
                    payload,
                    rate_fps: plan.rate_fps,
                    seconds: plan.seconds,
                };
                let outcome = daemon::run(&load);
                println!("{streams} streams, {}:\n{outcome}", payload.name());
            }
        }
    }
}

fn costs(plan: &Plan) {
    println!("payload to detector, one core:");
    println!(
        "{:<28} {:>8} {:>12} {:>12}",
        "payload", "bytes", "us/sample", "samples/s"
    );
    for payload in Payload::all(&plan.per_message) {
        let cost = path::cost(&payload);
        println!(
            "{:<28} {:>8} {:>12.2} {:>12.0}",
            payload.name(),
            cost.message_bytes,
            1e6 * cost.cpu_s_per_sample,
            1.0 / cost.cpu_s_per_sample
        );
    }
    println!("\nzenoh alone, one publisher and one subscriber over TCP on loopback:");
    println!(
        "{:<28} {:>12} {:>14} {:>12}",
        "payload", "messages/s", "CPU us/message", "samples/s"
    );
    for payload in Payload::all(&plan.per_message) {
        let carried = transport::carry(&payload);
        println!(
            "{:<28} {:>12.0} {:>14.1} {:>12.0}",
            payload.name(),
            carried.messages_per_s,
            1e6 * carried.cpu_s_per_message,
            carried.messages_per_s * payload.samples() as f64
        );
    }
}

fn plan(arguments: Vec<String>) -> Plan {
    let mut plan = Plan {
        streams: vec![100, 1000],
        per_message: vec![1, 6],
        forms: vec!["c37118".to_owned(), "cbor".to_owned()],
        only_daemon: false,
        seconds: 30.0,
        rate_fps: 60.0,
    };
    let mut arguments = arguments.into_iter().filter(|a| a != "--bench");
    while let Some(name) = arguments.next() {
        let value = arguments.next().expect("a value behind each option");
        let counts = || {
            value
                .split(',')
                .map(|n| n.parse().expect("a number"))
                .collect()
        };
        match name.as_str() {
            "--streams" => plan.streams = counts(),
            "--per-message" => plan.per_message = counts(),
            "--forms" => plan.forms = value.split(',').map(str::to_owned).collect(),
            "--only" => plan.only_daemon = value == "daemon",
            "--seconds" => plan.seconds = value.parse().expect("a number"),
            "--rate" => plan.rate_fps = value.parse().expect("a number"),
            _ => panic!("unknown option {name}"),
        }
    }
    plan
}
