//! C37.118 frames on measurement keys: what each stream's configuration is, what became of its frames,
//! and whose configuration has to be asked for.

use std::{collections::BTreeMap, sync::Arc, time::Duration};

use tokio::sync::{Semaphore, mpsc};

use super::{clock, settings::Settings};
use crate::{
    adapters::{
        c37118::{FrameCounts, FrameIntake, FrameOutcome, Taken},
        zenoh::{Entrance, LinkPublisher},
    },
    measurement::Site,
    service::Event,
    telemetry::intake::FramesTaken,
};

/// Streams whose configuration is remembered. A site's `*` takes any name, and names come from the
/// network: without a bound memory would have none. Chosen: four times the largest installation tried.
const STREAMS_MAX: usize = 4096;
/// Time between two reports on the streams.
const REPORT_NS: i64 = 1_000_000_000;
/// Time between two questions for the configuration of one stream.
const ASK_NS: i64 = 5_000_000_000;
/// Questions that wait to be asked, and are under way.
const ASKED_MAX: usize = 64;
/// Longest wait for an answer.
const ANSWER_LIMIT: Duration = Duration::from_secs(2);

/// Whose configuration is to be asked for.
#[derive(Debug)]
pub(super) struct Wanted {
    site: String,
    stream: String,
}

/// Why a message of frames is refused as a whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum FramesRefusal {
    /// No mapping is configured for the stream.
    NotConfigured,
    /// Too many streams.
    TooManyStreams,
}

/// The streams of frames that one decoder has seen.
#[derive(Clone, Debug)]
pub(super) struct FrameStreams {
    settings: Arc<Settings>,
    wanted: mpsc::Sender<Wanted>,
    /// By site and stream.
    streams: BTreeMap<String, BTreeMap<String, FrameStream>>,
    count: usize,
    reported_ns: i64,
}

#[derive(Clone, Debug)]
struct FrameStream {
    intake: FrameIntake,
    /// Its name in the configuration.
    configured: String,
    unreported: FrameCounts,
    trouble: Option<(FrameOutcome, String)>,
    /// Reports that held trouble of each kind: a flood of them is not a flood of log lines.
    told: BTreeMap<FrameOutcome, u64>,
    asked_ns: Option<i64>,
}

impl FrameStreams {
    pub(super) fn new(settings: &Arc<Settings>, wanted: mpsc::Sender<Wanted>) -> Self {
        Self {
            settings: Arc::clone(settings),
            wanted,
            streams: BTreeMap::new(),
            count: 0,
            reported_ns: 0,
        }
    }

    /// Takes a message of frames.
    pub(super) fn take(
        &mut self,
        site: &Site,
        stream: &str,
        payload: &[u8],
    ) -> Result<Vec<Event>, FramesRefusal> {
        let of_site = self.streams.get(&site.name);
        if of_site.is_none_or(|streams| !streams.contains_key(stream)) {
            self.add(site, stream)?;
        }
        let of_site = self.streams.get_mut(&site.name);
        let Some(known) = of_site.and_then(|streams| streams.get_mut(stream)) else {
            return Ok(Vec::new());
        };
        let taken = known.intake.take(payload);
        known.note(&taken);
        if taken.wants_configuration && known.may_ask() {
            let (site, stream) = (site.name.clone(), stream.to_owned());
            // A full queue of questions: the next frame asks again.
            self.wanted.try_send(Wanted { site, stream }).ok();
        }
        Ok(taken.batches.into_iter().map(Event::BatchDecoded).collect())
    }

    fn add(&mut self, site: &Site, stream: &str) -> Result<(), FramesRefusal> {
        let known = self.settings.stream(&site.name, stream);
        let (configured, mapping) = known.ok_or(FramesRefusal::NotConfigured)?;
        if self.count >= STREAMS_MAX {
            return Err(FramesRefusal::TooManyStreams);
        }
        self.count += 1;
        let intake = FrameIntake::new(site, stream, mapping);
        let new = FrameStream::new(intake, configured.to_owned());
        let of_site = self.streams.entry(site.name.clone()).or_default();
        of_site.insert(stream.to_owned(), new);
        Ok(())
    }

    /// What became of the frames since the last report; nothing when that was a moment ago, unless
    /// there will be no other.
    pub(super) fn report(&mut self, last: bool) -> Vec<Event> {
        let now_ns = clock::now_ns();
        if !last && now_ns - self.reported_ns < REPORT_NS {
            return Vec::new();
        }
        self.reported_ns = now_ns;
        let streams = self.streams.iter_mut().flat_map(|(site, streams)| {
            let streams = streams.iter_mut();
            streams.map(move |(stream, known)| (site, stream, known))
        });
        let reports = streams.filter_map(|(site, stream, known)| known.report(site, stream));
        reports.map(Event::FramesDecoded).collect()
    }
}

impl FrameStream {
    const fn new(intake: FrameIntake, configured: String) -> Self {
        Self {
            intake,
            configured,
            unreported: FrameCounts::NONE,
            trouble: None,
            told: BTreeMap::new(),
            asked_ns: None,
        }
    }

    fn note(&mut self, taken: &Taken) {
        self.unreported.add(&taken.counts);
        if let Some((outcome, words)) = &taken.trouble
            && self.trouble.is_none()
        {
            self.trouble = Some((*outcome, words.clone()));
        }
    }

    fn may_ask(&mut self) -> bool {
        let now_ns = clock::now_ns();
        let may = self.asked_ns.is_none_or(|asked| now_ns - asked >= ASK_NS);
        if may {
            self.asked_ns = Some(now_ns);
        }
        may
    }

    /// None when nothing came. Trouble is told in the first report it shows in, then in the second,
    /// the fourth, the eighth and so on.
    fn report(&mut self, site: &str, stream: &str) -> Option<FramesTaken> {
        let counts = std::mem::take(&mut self.unreported);
        let trouble = self.trouble.take();
        if counts == FrameCounts::NONE {
            return None;
        }
        let outcomes = FrameOutcome::ALL.map(|outcome| (outcome.label(), counts.of(outcome)));
        let trouble = trouble.filter(|(outcome, _)| {
            let reports = self.told.entry(*outcome).or_insert(0);
            *reports += 1;
            reports.is_power_of_two()
        });
        Some(FramesTaken {
            site: site.to_owned(),
            stream: stream.to_owned(),
            configured: self.configured.clone(),
            outcomes: outcomes.into_iter().filter(|(_, n)| *n > 0).collect(),
            trouble: trouble.map(|(outcome, words)| (outcome.label(), words)),
        })
    }
}

impl FramesRefusal {
    /// Word for the metric, and words for people.
    pub(super) fn words(self, site: &str, stream: &str) -> (&'static str, String) {
        match self {
            Self::NotConfigured => (
                "unknown_stream",
                format!(
                    "frames of C37.118 arrived, and no [[site.c37118]] of the site `{site}` is for the \
                     stream `{stream}`"
                ),
            ),
            Self::TooManyStreams => (
                "too_many_streams",
                format!("more than {STREAMS_MAX} streams send frames"),
            ),
        }
    }
}

/// The way to ask for configurations.
pub(super) fn questions() -> (mpsc::Sender<Wanted>, mpsc::Receiver<Wanted>) {
    mpsc::channel(ASKED_MAX)
}

/// Asks for configurations until no decoder wants any more. An answer goes the way of the frames.
pub(super) fn spawn_asker(
    link: LinkPublisher,
    entrance: Entrance,
    mut wanted: mpsc::Receiver<Wanted>,
) {
    tokio::spawn(async move {
        let places = Arc::new(Semaphore::new(ASKED_MAX));
        while let Some(Wanted { site, stream }) = wanted.recv().await {
            let Ok(place) = Arc::clone(&places).acquire_owned().await else {
                return;
            };
            let (link, entrance) = (link.clone(), entrance.clone());
            tokio::spawn(async move {
                let asked = link.fetch_configuration(&site, &stream, &entrance, ANSWER_LIMIT);
                if !asked.await {
                    tracing::debug!(site, stream, "nobody knows the stream's configuration");
                }
                drop(place);
            });
        }
    });
}
