//! From payloads to events, on threads of their own: a payload may take longer to decode than the
//! loop may take for a step.

use std::{
    collections::BTreeMap,
    sync::{
        Arc,
        mpsc::{Receiver, RecvTimeoutError},
    },
    thread::{self, JoinHandle},
    time::Duration,
};

use tokio::sync::mpsc::Sender;

use super::{
    clock,
    frames::{FrameStreams, FramesRefusal, Wanted},
    settings::Settings,
};
use crate::{
    adapters::{
        c37118::starts_as_frame,
        recordings::comtrade,
        wire::{
            Encoding,
            v1::{RecordingFiles, decode_batch, decode_recording},
        },
        zenoh::{Address, Keys, Message, Question},
    },
    measurement::{Record, Site},
    service::{DecodedRecording, Event},
    telemetry::intake::Source,
};

/// Longest time until what became of frames is reported while nothing arrives.
const REPORT_AFTER: Duration = Duration::from_millis(200);

/// Messages that are handed to the loop together at most. To wake it for each one costs more than the message:
/// chosen so that the loop is done with a group in less than its longest step.
const GROUP_MAX: usize = 32;
/// Time after which a group is handed on, however small.
const GROUP_NS: i64 = 1_000_000;

/// What the decoders hand to the loop, in the order of arrival.
#[derive(Debug)]
pub(super) enum Decoded {
    /// What a measurement message holds.
    Measured {
        /// To be applied in this order.
        events: Vec<Event>,
        /// When it came, UTC nanoseconds.
        arrived_ns: i64,
    },
    /// Something to apply.
    Event(Event),
    /// A question to be answered when everything before it has been applied.
    Barrier(Question),
    /// One of the queues has come to its end.
    End,
}

/// Decodes payloads.
#[derive(Clone, Debug)]
pub(super) struct Decoder {
    settings: Arc<Settings>,
    sites: Arc<BTreeMap<String, Site>>,
    frames: FrameStreams,
    keys: Keys,
}

struct Refusal {
    reason: &'static str,
    error: String,
}

impl Decoder {
    pub(super) fn new(settings: &Arc<Settings>, wanted: Sender<Wanted>) -> Self {
        let sites = settings.sites.iter().map(|s| &s.site);
        Self {
            sites: Arc::new(sites.map(|s| (s.name.clone(), s.clone())).collect()),
            frames: FrameStreams::new(settings, wanted),
            keys: Keys::new(&settings.zenoh.prefix),
            settings: Arc::clone(settings),
        }
    }

    /// Decodes until the queue has come to its end, or the loop is gone.
    pub(super) fn spawn(
        mut self,
        name: &str,
        messages: Receiver<Message>,
        events: Sender<Vec<Decoded>>,
    ) -> std::io::Result<JoinHandle<()>> {
        thread::Builder::new().name(name.to_owned()).spawn(move || {
            while let Some(group) = self.next_group(&messages) {
                let ends = matches!(group.last(), Some(Decoded::End));
                if !group.is_empty() && events.blocking_send(group).is_err() || ends {
                    return;
                }
            }
        })
    }

    /// What has arrived, up to a bound, after a wait for the first of it; none when nobody sends any more.
    fn next_group(&mut self, messages: &Receiver<Message>) -> Option<Vec<Decoded>> {
        let first = match messages.recv_timeout(REPORT_AFTER) {
            Ok(message) => Some(message),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => return None,
        };
        let (quiet, begun_ns) = (first.is_none(), clock::now_ns());
        let mut group = Vec::new();
        let mut next = first;
        while let Some(message) = next.take() {
            self.decode(message, &mut group);
            let ends = matches!(group.last(), Some(Decoded::End));
            if !ends && group.len() < GROUP_MAX && clock::now_ns() - begun_ns < GROUP_NS {
                next = messages.try_recv().ok();
            }
        }
        let ends = matches!(group.last(), Some(Decoded::End));
        let reports = self.frames.report(quiet || ends).into_iter();
        group.splice(..0, reports.map(Decoded::Event));
        Some(group)
    }

    fn decode(&mut self, message: Message, group: &mut Vec<Decoded>) {
        match message {
            Message::Barrier(question) => group.push(Decoded::Barrier(question)),
            Message::End => group.push(Decoded::End),
            Message::Stray { key } => group.push(Decoded::Event(Event::PayloadRefused {
                source: Source::Measurement,
                error: "the key is not of the form <prefix>/<kind>/<site>/<source>".to_owned(),
                reason: "stray_key",
                key,
            })),
            Message::Payload {
                address: Address::Measurement { site, stream },
                encoding,
                payload,
                arrived_ns,
                held: _held,
            } => {
                let events = self
                    .measurement(&site, &stream, &encoding, &payload)
                    .unwrap_or_else(|refusal| {
                        let key = self.keys.measurement(&site, &stream);
                        vec![refusal.event(Source::Measurement, key)]
                    });
                group.push(Decoded::Measured { events, arrived_ns });
            }
            Message::Payload {
                address: Address::Recording { site, recorder },
                payload,
                ..
            } => match self.recording(&site, &recorder, &payload) {
                Ok(records) => group.extend(
                    records
                        .into_iter()
                        .map(|record| Decoded::Event(recorded(&site, &recorder, record))),
                ),
                Err(refusal) => {
                    let key = self.keys.recording(&site, &recorder);
                    group.push(Decoded::Event(refusal.event(Source::Recording, key)));
                }
            },
        }
    }

    /// A batch, or frames: those have no encoding of their own, so that one that is declared rules
    /// them out.
    fn measurement(
        &mut self,
        site: &str,
        stream: &str,
        encoding: &str,
        payload: &[u8],
    ) -> Result<Vec<Event>, Refusal> {
        let limit = self.settings.batch_limits.payload_bytes_max;
        let undeclared = encoding_of(encoding) == Encoding::Unknown;
        if !undeclared || payload.len() > limit || !starts_as_frame(payload) {
            return Ok(vec![self.batch(site, stream, encoding, payload)?]);
        }
        let site = site_called(&self.sites, site)?;
        let taken = self.frames.take(site, stream, payload);
        taken.map_err(|refusal: FramesRefusal| {
            let (reason, error) = refusal.words(&site.name, stream);
            Refusal { reason, error }
        })
    }

    fn batch(
        &self,
        site: &str,
        stream: &str,
        encoding: &str,
        payload: &[u8],
    ) -> Result<Event, Refusal> {
        let site = site_called(&self.sites, site)?;
        let limits = &self.settings.batch_limits;
        let mut batch =
            decode_batch(payload, encoding_of(encoding), site, limits).map_err(|e| Refusal {
                reason: e.label(),
                error: e.to_string(),
            })?;
        // The key is what routers' access control has seen.
        stream.clone_into(&mut batch.stream);
        Ok(Event::BatchDecoded(batch))
    }

    fn recording(
        &self,
        site: &str,
        recorder: &str,
        payload: &[u8],
    ) -> Result<Vec<Record>, Refusal> {
        let site = site_called(&self.sites, site)?;
        let known = self.settings.recorder(&site.name, recorder);
        let known = known.ok_or_else(|| Refusal {
            reason: "unknown_recorder",
            error: format!(
                "no recorder `{recorder}` is configured for the site `{}`",
                site.name
            ),
        })?;
        let files =
            decode_recording(payload, &self.settings.recording_limits).map_err(|e| Refusal {
                reason: e.label(),
                error: e.to_string(),
            })?;
        let recording = match &files {
            RecordingFiles::CfgDat { cfg, dat, .. } => comtrade::decode(cfg, dat, &known.options),
            RecordingFiles::Cff(bytes) => comtrade::decode_container(bytes, &known.options),
        };
        let recording = recording.map_err(|e| Refusal {
            reason: "malformed_comtrade",
            error: e.to_string(),
        })?;
        known
            .mapping
            .records(&recording, site)
            .map_err(|e| Refusal {
                reason: "unusable_channels",
                error: e.to_string(),
            })
    }
}

fn site_called<'s>(sites: &'s BTreeMap<String, Site>, name: &str) -> Result<&'s Site, Refusal> {
    sites.get(name).ok_or_else(|| Refusal {
        reason: "unknown_site",
        error: format!("the site `{name}` is not configured"),
    })
}

impl Refusal {
    fn event(self, source: Source, key: String) -> Event {
        Event::PayloadRefused {
            source,
            key,
            reason: self.reason,
            error: self.error,
        }
    }
}

fn recorded(site: &str, recorder: &str, record: Record) -> Event {
    Event::RecordingDecoded(DecodedRecording {
        site: site.to_owned(),
        recorder: recorder.to_owned(),
        record,
    })
}

/// What zenoh says of a payload's encoding; anything else is left to the first byte.
fn encoding_of(zenoh: &str) -> Encoding {
    match zenoh.split(';').next().unwrap_or_default() {
        "application/cbor" => Encoding::Cbor,
        "application/json" | "text/json" => Encoding::Json,
        _ => Encoding::Unknown,
    }
}
