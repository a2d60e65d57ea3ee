//! `loadmodeld bridge c37118`: what a PMU or concentrator sends onto zenoh.

use std::{io::Write, net::SocketAddr, sync::Arc, time::Duration};

use clap::{Args, Subcommand};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::{Error, connection::ConnectionArgs};
use crate::{
    adapters::{
        bridge::{Counters, Delivery, Source, Totals, Transport, client},
        c37118::{ConfigurationKind, DialogueOptions},
        zenoh::{self, FramePublisher, Keys},
    },
    daemon::{
        clock,
        logging::{self, LogFormat},
    },
};

/// Longest wait for the network to take frames; beyond it they are counted as not published.
const PUBLISH_LIMIT: Duration = Duration::from_secs(5);

/// Arguments of `bridge`.
#[derive(Debug, Args)]
pub struct BridgeArgs {
    #[command(subcommand)]
    protocol: Protocol,
}

#[derive(Debug, Subcommand)]
enum Protocol {
    /// A PMU or concentrator that speaks IEEE C37.118.2
    C37118(C37118Args),
}

/// Arguments of `bridge c37118`.
#[derive(Debug, Args)]
struct C37118Args {
    /// The source
    #[arg(value_name = "HOST:PORT")]
    source: String,
    /// Site that the frames are for; several when one stream carries several loads
    #[arg(long, required = true, value_name = "NAME")]
    site: Vec<String>,
    /// Name of the stream under which frames are published
    #[arg(long, value_name = "NAME", default_value = "pmu")]
    stream: String,
    /// IDCODE that commands address
    #[arg(long, value_name = "N", default_value_t = 1)]
    id_code: u16,
    /// Ask for the configuration as CFG-3 instead of CFG-2
    #[arg(long)]
    cfg3: bool,
    /// Talk in UDP datagrams
    #[arg(long)]
    udp: bool,
    /// Own address for UDP
    #[arg(
        long,
        value_name = "ADDRESS:PORT",
        default_value = "0.0.0.0:0",
        requires = "udp"
    )]
    listen: SocketAddr,
    /// Send no commands: the source sends by itself
    #[arg(long)]
    no_commands: bool,
    /// Silence after which the connection is made anew, seconds
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    silence_s: f64,
    /// Longest pause between two attempts to connect, seconds; the first is half a second
    #[arg(long, value_name = "S", default_value_t = 30.0)]
    pause_s: f64,
    /// Readings that wait to be published; beyond it frames are dropped and counted
    #[arg(long, value_name = "N", default_value_t = 1024)]
    queue: usize,
    /// Time between two log lines with all counts, seconds
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    report_s: f64,
    #[command(flatten)]
    connection: ConnectionArgs,
}

/// Publishes frames until SIGTERM or SIGINT, then writes the counts as one line of JSON.
///
/// # Errors
///
/// [`Error`] when it is used wrongly or zenoh cannot be reached. A source that cannot be reached is
/// tried again.
pub fn run(args: &BridgeArgs, out: &mut dyn Write) -> Result<(), Error> {
    let Protocol::C37118(args) = &args.protocol;
    let mut names = args.site.iter().chain([&args.stream]);
    if let Some(bad) = names.find(|name| !zenoh::is_chunk(name)) {
        return Err(Error::Usage(format!("`{bad}` cannot be part of a key")));
    }
    if args.queue == 0 {
        return Err(Error::Usage("the queue has to hold something".to_owned()));
    }
    let source = source(args)?;
    let report = seconds("--report-s", args.report_s)?;
    logging::set_up(LogFormat::Auto, "info,zenoh=warn")?;
    let totals = super::block_on(bridge(args, source, report))?;
    let counts = totals
        .named()
        .map(|(name, count)| (name.to_owned(), count.into()));
    let counts: serde_json::Map<String, serde_json::Value> = counts.into_iter().collect();
    writeln!(out, "{}", serde_json::Value::Object(counts))?;
    Ok(())
}

fn source(args: &C37118Args) -> Result<Source, Error> {
    const SHORTEST_PAUSE: Duration = Duration::from_millis(500);
    const CONNECT_LIMIT: Duration = Duration::from_secs(10);
    const FAREWELL: (Duration, Duration) = (Duration::from_millis(500), Duration::from_secs(3));
    const FRAME_BYTES_MAX: usize = 65_535;
    let port = args.source.rsplit_once(':');
    let port = port.and_then(|(_, port)| port.parse::<u16>().ok());
    if port.is_none_or(|port| port == 0) {
        let source = &args.source;
        return Err(Error::Usage(format!("`{source}` is not HOST:PORT")));
    }
    let silence = seconds("--silence-s", args.silence_s)?;
    Ok(Source {
        address: args.source.clone(),
        transport: if args.udp {
            Transport::Udp { local: args.listen }
        } else {
            Transport::Tcp
        },
        dialogue: DialogueOptions {
            id_code: args.id_code,
            configuration: if args.cfg3 {
                ConfigurationKind::Configuration3
            } else {
                ConfigurationKind::Configuration2
            },
            commanded: !args.no_commands,
            silence_ms: i64::try_from(silence.as_millis()).unwrap_or(i64::MAX),
            ..DialogueOptions::default()
        },
        pause: (
            SHORTEST_PAUSE,
            seconds("--pause-s", args.pause_s)?.max(SHORTEST_PAUSE),
        ),
        connect_limit: CONNECT_LIMIT,
        farewell: FAREWELL,
        frame_bytes_max: FRAME_BYTES_MAX,
    })
}

fn seconds(option: &str, seconds: f64) -> Result<Duration, Error> {
    Duration::try_from_secs_f64(seconds)
        .ok()
        .filter(|duration| !duration.is_zero())
        .ok_or_else(|| {
            Error::Usage(format!(
                "{option} {seconds} is not a number of seconds above 0"
            ))
        })
}

async fn bridge(args: &C37118Args, source: Source, report: Duration) -> Result<Totals, Error> {
    let options = args.connection.options()?;
    let session = zenoh::open(&options).await?;
    let keys = Keys::new(&options.prefix);
    let publisher = FramePublisher::new(&session, &keys, &args.site, &args.stream).await?;
    let (outlet, deliveries) = mpsc::channel(args.queue);
    let (counters, stop) = (Arc::new(Counters::default()), CancellationToken::new());
    let (counted, stopped) = (Arc::clone(&counters), stop.clone());
    let client = tokio::spawn(async move {
        client::run(&source, &outlet, &counted, clock::now_ns, &stopped).await;
    });
    let counted = Arc::clone(&counters);
    let publishing = tokio::spawn(async move {
        publish(&publisher, deliveries, &counted).await;
    });
    tokio::select! {
        asked = super::asked_to_end() => asked?,
        () = log_counts(&counters, report) => {}
    }
    stop.cancel();
    // The client says good-bye to the source; what it has handed on is still published.
    client.await.map_err(Error::other)?;
    publishing.await.map_err(Error::other)?;
    if !zenoh::close_within(&session, &options).await {
        tracing::warn!("zenoh did not close in time: the last frames may not have gone out");
    }
    Ok(counters.read())
}

/// Publishes until nothing more comes.
async fn publish(
    publisher: &FramePublisher,
    mut deliveries: mpsc::Receiver<Delivery>,
    counters: &Counters,
) {
    while let Some(delivery) = deliveries.recv().await {
        let (count, put) = match delivery {
            Delivery::Frames { count, bytes } => {
                (count, publisher.put(&bytes, PUBLISH_LIMIT).await)
            }
            Delivery::Configuration(frames) => {
                let (count, bytes) = (frames.len() as u64, frames.concat());
                (
                    count,
                    publisher.put_configuration(bytes, PUBLISH_LIMIT).await,
                )
            }
        };
        match put {
            Ok(true) => {}
            Ok(false) => counters.update(|totals| totals.unheard += count),
            Err(error) => {
                counters.update(|totals| totals.unpublished += count);
                tracing::warn!(%error, frames = count, "frames not published");
            }
        }
    }
}

/// Never ends.
async fn log_counts(counters: &Counters, period: Duration) {
    loop {
        tokio::time::sleep(period).await;
        let counts = counters.read().named();
        let moved: Vec<String> = counts
            .into_iter()
            .filter(|(_, count)| *count > 0)
            .map(|(name, count)| format!("{name} {count}"))
            .collect();
        tracing::info!(counts = moved.join(", "), "bridging");
    }
}
