//! `loadmodeld replay`: recordings onto zenoh, or as a PMU, with their original timing or faster.

mod plan;
mod player;
mod pmu;

use std::{io::Write, net::SocketAddr, path::PathBuf};

use clap::Args;
use tokio::net::TcpListener;

use super::{Error, connection::ConnectionArgs};
use crate::adapters::zenoh::{self, Keys};

pub(super) use plan::{Piece, Plan};
pub(super) use player::{Pace, Player};
use pmu::Programme;

/// Arguments of `replay`.
#[derive(Debug, Args)]
pub struct ReplayArgs {
    /// Site folders and COMTRADE files (.cfg, .dat or .cff)
    #[arg(required = true, value_name = "PATH")]
    paths: Vec<PathBuf>,
    /// How many times faster than the original; 0 as fast as the daemon takes it
    #[arg(long, default_value_t = 1.0, value_name = "N")]
    speed: f64,
    /// Site that COMTRADE files belong to; replaces the name in a site folder
    #[arg(long, value_name = "NAME")]
    site: Option<String>,
    /// Recorder that COMTRADE files come from [default: the file's name]
    #[arg(long, value_name = "NAME")]
    recorder: Option<String>,
    /// Name of the stream under which batches are published
    #[arg(long, value_name = "NAME", default_value = "replay")]
    stream: String,
    /// Be a PMU that measures one site folder now: serve IEEE C37.118.2 on this TCP port, from the moment
    /// a client asks for data; 0 chooses a port
    #[arg(long, value_name = "PORT", conflicts_with_all = ["recorder", "stream", "endpoint", "config"])]
    c37118: Option<u16>,
    /// Address to listen on with --c37118
    #[arg(
        long,
        value_name = "ADDRESS",
        default_value = "127.0.0.1",
        requires = "c37118"
    )]
    bind: std::net::IpAddr,
    /// IDCODE of the PMU
    #[arg(long, value_name = "N", default_value_t = 1, requires = "c37118")]
    id_code: u16,
    #[command(flatten)]
    connection: ConnectionArgs,
}

/// Publishes everything, then says how much it was.
///
/// # Errors
///
/// [`Error`] when a path cannot be read, nobody answers, or the connection breaks.
pub fn run(args: &ReplayArgs, out: &mut dyn Write) -> Result<(), Error> {
    let pace = Pace::new(args.speed)
        .ok_or_else(|| Error::Usage(format!("the speed {} is not 0 or more", args.speed)))?;
    let names = [&args.site, &args.recorder, &Some(args.stream.clone())];
    if let Some(bad) = names
        .into_iter()
        .flatten()
        .find(|name| !zenoh::is_chunk(name))
    {
        return Err(Error::Usage(format!("`{bad}` cannot be part of a key")));
    }
    let mut plan = Plan::default();
    for path in &args.paths {
        plan.add(path, args.site.as_deref(), args.recorder.as_deref())?;
    }
    for note in &plan.notes {
        say(note);
    }
    match args.c37118 {
        Some(port) => {
            if args.speed <= 0.0 {
                let told = "a PMU sends at a rate: --speed has to be above 0".to_owned();
                return Err(Error::Usage(told));
            }
            let programme = Programme::new(&plan, args.id_code)?;
            let address = SocketAddr::new(args.bind, port);
            super::block_on(be_a_pmu(programme, &plan, address, pace, out))
        }
        None => super::block_on(replay(args, &plan, pace, out)),
    }
}

async fn be_a_pmu(
    programme: Programme<'_>,
    plan: &Plan,
    address: SocketAddr,
    pace: Pace,
    out: &mut dyn Write,
) -> Result<(), Error> {
    let listener = TcpListener::bind(address).await;
    let listener = listener.map_err(|error| Error::Usage(format!("{address}: {error}")))?;
    writeln!(out, "listening on {}", listener.local_addr()?)?;
    out.flush()?;
    let bar = player::progress_bar(plan);
    let progress = |samples| bar.inc(samples);
    let played = tokio::select! {
        played = programme.play(listener, pace, &progress) => played,
        asked = super::asked_to_end() => asked.and(Err(Error::Interrupted)),
    };
    bar.finish_and_clear();
    let played = played?;
    writeln!(
        out,
        "sent {} frames, {} lost by slow clients",
        played.frames, played.lost
    )?;
    Ok(())
}

async fn replay(
    args: &ReplayArgs,
    plan: &Plan,
    pace: Pace,
    out: &mut dyn Write,
) -> Result<(), Error> {
    let options = args.connection.options()?;
    let session = zenoh::open(&options).await?;
    let player = Player::new(&session, Keys::new(&options.prefix), &args.stream, pace);
    let bar = player::progress_bar(plan);
    let progress = |samples| bar.inc(samples);
    let played = tokio::select! {
        played = player.play(plan, &progress) => played,
        asked = super::asked_to_end() => asked.and(Err(Error::Interrupted)),
    };
    bar.finish_and_clear();
    zenoh::close_within(&session, &options).await;
    let played = played?;
    writeln!(
        out,
        "published {} samples in {} batches and {} recordings",
        played.samples, played.batches, played.recordings
    )?;
    Ok(())
}

/// What was left out is said on standard error, so that the result stays clean.
fn say(note: &str) {
    writeln!(std::io::stderr(), "loadmodeld: {note}").ok();
}
