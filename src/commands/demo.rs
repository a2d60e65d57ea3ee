//! `loadmodeld demo`: daemon, recordings, zenoh and store on this machine, in accelerated time.

mod scene;
mod stage;

use std::{
    io::{self, Write},
    net::SocketAddr,
    path::PathBuf,
    sync::Arc,
    time::Duration,
};

use clap::Args;
use tokio::{
    sync::mpsc::{UnboundedReceiver, unbounded_channel},
    time::{Instant, sleep, timeout},
};

use super::{
    Error,
    connection::client,
    replay::{Pace, Plan, Player},
    subscribe::in_words,
};
use crate::{
    adapters::zenoh::{self, Documents, Keys, Session, ZenohError, ZenohOptions},
    daemon::{
        self, Daemon, Observer,
        logging::{self, LogFormat},
    },
};
use scene::Scene;
use stage::Stage;

/// Arguments of `demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// End when everything has been replayed, decided on and published
    #[arg(long)]
    until_done: bool,
    /// Print exactly one line of JSON per published set on standard output
    #[arg(long)]
    json: bool,
    /// Replay these site folders (or folders of them) instead of the bundled ones
    #[arg(long, value_name = "DIR")]
    data_dir: Vec<PathBuf>,
    /// Keep the store here, so that the next run goes on where this one ended
    #[arg(long, value_name = "DIR")]
    state: Option<PathBuf>,
    /// How many times faster than the original; 0 as fast as the daemon takes it
    #[arg(long, default_value_t = 0.0, value_name = "N")]
    speed: f64,
    /// Address of the page; a free port is taken when this one is not free
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:9464")]
    http: SocketAddr,
    /// Log filter
    #[arg(long, value_name = "FILTER", default_value = "error")]
    log: String,
}

/// Time between two looks whether everything is done.
const LOOK_PERIOD: Duration = Duration::from_millis(200);
/// Longest wait for a published set to arrive at the subscriber.
const ARRIVAL_LIMIT: Duration = Duration::from_secs(10);

/// Runs the demonstration.
///
/// # Errors
///
/// [`Error`] when recordings cannot be read, the daemon does not start or does not end well.
pub fn run(args: &DemoArgs, out: &mut dyn Write) -> Result<(), Error> {
    let pace = Pace::new(args.speed)
        .ok_or_else(|| Error::Usage(format!("the speed {} is not 0 or more", args.speed)))?;
    logging::set_up(LogFormat::Text, &args.log)?;
    let scene = Scene::set(&args.data_dir, args.state.as_deref())?;
    super::block_on(async {
        let mut stage = Stage::new(args.json, out);
        perform(args, &scene, pace, &mut stage).await
    })
}

async fn perform(
    args: &DemoArgs,
    scene: &Scene,
    pace: Pace,
    stage: &mut Stage<'_>,
) -> Result<(), Error> {
    let (said, mut words) = unbounded_channel();
    let observer: Observer = Arc::new(move |occurrence| {
        if let Some(sentence) = occurrence.sentence() {
            said.send(sentence).ok();
        }
    });
    let daemon = daemon::start(scene.settings(args.http), observer).await?;
    let options = client(
        daemon.endpoints().to_vec(),
        ZenohOptions::default().prefix,
        Vec::new(),
    );
    let session = zenoh::open(&options).await?;
    let sets = zenoh::documents(&session, &Keys::new(&options.prefix).parameters("*")).await?;
    stage.welcome(&daemon, scene)?;
    let show = Show {
        daemon: &daemon,
        session: &session,
        sets: &sets,
        options: &options,
    };
    let ended = show
        .run(args.until_done, &scene.plan, pace, &mut words, stage)
        .await;
    zenoh::close_within(&session, &options).await;
    daemon.stop();
    daemon.join().await?;
    ended
}

/// What is going on.
struct Show<'d> {
    daemon: &'d Daemon,
    session: &'d Session,
    sets: &'d Documents,
    options: &'d ZenohOptions,
}

/// Why the show ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum End {
    Done,
    Interrupted,
}

impl Show<'_> {
    async fn run(
        &self,
        until_done: bool,
        plan: &Plan,
        pace: Pace,
        words: &mut UnboundedReceiver<String>,
        stage: &mut Stage<'_>,
    ) -> Result<(), Error> {
        let script = async {
            let keys = Keys::new(&self.options.prefix);
            let player = Player::new(self.session, keys, "pmu", pace);
            player.play(plan, &|_| {}).await?;
            self.wait_until_settled().await
        };
        let asked = super::asked_to_end();
        tokio::pin!(script, asked);
        let mut playing = true;
        let end = loop {
            tokio::select! {
                biased;
                asked = &mut asked => {
                    asked?;
                    break End::Interrupted;
                }
                Some(sentence) = words.recv() => stage.say(&sentence)?,
                document = self.sets.next() => match document {
                    Some(document) => stage.set(&document)?,
                    None => return Err(ZenohError::Closed.into()),
                },
                played = &mut script, if playing => {
                    played?;
                    playing = false;
                    if until_done {
                        break End::Done;
                    }
                    stage.say("everything has been replayed and decided on; Ctrl-C ends")?;
                }
            }
        };
        if end == End::Interrupted {
            return if until_done {
                Err(Error::Interrupted)
            } else {
                Ok(())
            };
        }
        self.finish(words, stage).await
    }

    /// Waits until the daemon has nothing left to do. The first look comes after a tick that began
    /// after the last batch was taken in.
    async fn wait_until_settled(&self) -> Result<(), Error> {
        let ticks = self.daemon.status().ticks;
        loop {
            sleep(LOOK_PERIOD).await;
            if self.daemon.has_ended() {
                return Err(ZenohError::Closed.into());
            }
            if self.daemon.status().ticks > ticks + 1 && self.daemon.settled().await? {
                return Ok(());
            }
        }
    }

    /// Shows what is still on its way from the daemon to us.
    async fn finish(
        &self,
        words: &mut UnboundedReceiver<String>,
        stage: &mut Stage<'_>,
    ) -> Result<(), Error> {
        while let Ok(sentence) = words.try_recv() {
            stage.say(&sentence)?;
        }
        let deadline = Instant::now() + ARRIVAL_LIMIT;
        let published = self.daemon.status().sets_published;
        while stage.sets_shown() < published {
            let left = deadline.saturating_duration_since(Instant::now());
            let Ok(Some(document)) = timeout(left, self.sets.next()).await else {
                let missing = published - stage.sets_shown();
                let lost = io::Error::other(format!("{missing} published sets did not arrive"));
                return Err(Error::other(lost));
            };
            stage.set(&document)?;
        }
        stage.farewell(self.daemon)
    }
}

/// One set for people.
fn set_in_words(document: &str) -> String {
    in_words(document)
}
