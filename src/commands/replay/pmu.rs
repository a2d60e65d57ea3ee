//! A recording as the stream of a PMU that measures it now: `replay --c37118 PORT`.

use std::{sync::Arc, time::Duration};

use tokio::{
    net::TcpListener,
    time::{Instant, sleep, sleep_until},
};
use tokio_util::sync::CancellationToken;

use super::{Pace, Piece, Plan};
use crate::{
    adapters::{
        bridge::{Answers, Station, server},
        c37118::{ConfigurationKind, EncodeError, HeaderFrame, Played},
    },
    commands::Error,
    measurement::{Record, Site},
};

/// Time between two events, seconds of the original: their real distance may be months.
const BETWEEN_EVENTS_S: f64 = 2.0;
/// Period of looking whether somebody listens.
const LISTENING_PERIOD: Duration = Duration::from_millis(20);

/// What was played.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PlayedFrames {
    pub(super) frames: u64,
    /// Frames that a client was too slow for.
    pub(super) lost: u64,
}

/// Events of one load at one rate, ready to be played.
#[derive(Debug)]
pub(super) struct Programme<'p> {
    events: Vec<&'p Record>,
    played: Played,
    answers: Answers,
}

impl<'p> Programme<'p> {
    /// What a plan holds, as IDCODE `id_code`.
    pub(super) fn new(plan: &'p Plan, id_code: u16) -> Result<Self, Error> {
        let [site] = plan.sites.as_slice() else {
            return Err(usage("one site folder", "a PMU measures one load"));
        };
        let events = plan.pieces.iter().map(|piece| match piece {
            Piece::Event { record, .. } => Ok(record),
            Piece::Recording { .. } => {
                Err(usage("a site folder", "a COMTRADE file holds waveforms"))
            }
        });
        let events = events.collect::<Result<Vec<_>, _>>()?;
        let Some(first) = events.first() else {
            return Err(usage("events", "the site folder has none"));
        };
        let rate_fps = first.rate_fps;
        if events.iter().any(|e| (e.rate_fps - rate_fps).abs() > 0.0) {
            return Err(usage("events of one rate", "a stream has one"));
        }
        let played = Played::new(site, rate_fps, id_code).map_err(Error::other)?;
        let answers = answers(&played, site, id_code).map_err(Error::other)?;
        Ok(Self {
            events,
            played,
            answers,
        })
    }

    /// Serves the programme once, from the moment somebody asks for data.
    pub(super) async fn play(
        mut self,
        listener: TcpListener,
        pace: Pace,
        progress: &(dyn Fn(u64) + Sync),
    ) -> Result<PlayedFrames, Error> {
        let station = Arc::new(Station::new(self.answers.clone()));
        let stop = CancellationToken::new();
        let _stopped = stop.clone().drop_guard();
        let served = server::serve(Arc::clone(&station), listener, stop);
        let served = tokio::spawn(served);
        while station.listeners() == 0 {
            sleep(LISTENING_PERIOD).await;
        }
        let mut frames = 0;
        for event in std::mem::take(&mut self.events) {
            let started = Instant::now();
            for (k, sample) in event.samples.iter().enumerate() {
                sleep_until(started + pace.of(k as f64 / event.rate_fps)).await;
                if let Some(frame) = self.played.frame(sample).map_err(Error::other)? {
                    station.send(&frame);
                    frames += 1;
                }
                progress(1);
            }
            sleep(pace.of(BETWEEN_EVENTS_S)).await;
        }
        station.end();
        served.await.map_err(Error::other)?;
        Ok(PlayedFrames {
            frames,
            lost: station.lost(),
        })
    }
}

fn answers(played: &Played, site: &Site, id_code: u16) -> Result<Answers, EncodeError> {
    let configuration = |kind| {
        let frames = played.configuration(kind).encode();
        frames.map(|frames| frames.concat())
    };
    let header = HeaderFrame {
        prefix: played
            .configuration(ConfigurationKind::Configuration2)
            .prefix,
        text: format!("loadmodeld replays {}", site.name),
    };
    Ok(Answers {
        id_code,
        header: header.encode()?,
        configuration_1: configuration(ConfigurationKind::Configuration1)?,
        configuration_2: configuration(ConfigurationKind::Configuration2)?,
        configuration_3: configuration(ConfigurationKind::Configuration3)?,
    })
}

fn usage(wanted: &str, because: &str) -> Error {
    Error::Usage(format!("--c37118 plays {wanted}: {because}"))
}
