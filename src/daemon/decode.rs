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
        zenoh::{Address, Message, Question},
    },
    measurement::{Record, Site},
    service::{DecodedRecording, Event},
    telemetry::intake::Source,
};

/// Longest time until what became of frames is reported while nothing arrives.
const REPORT_AFTER: Duration = Duration::from_millis(200);

/// What the decoders hand to the loop, in the order of arrival.
#[derive(Debug)]
pub(super) enum Decoded {
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
            settings: Arc::clone(settings),
        }
    }

    /// Decodes until the queue has come to its end, or the loop is gone.
    pub(super) fn spawn(
        mut self,
        name: &str,
        messages: Receiver<Message>,
        events: Sender<Decoded>,
    ) -> std::io::Result<JoinHandle<()>> {
        thread::Builder::new().name(name.to_owned()).spawn(move || {
            loop {
                let (mut decoded, quiet) = match messages.recv_timeout(REPORT_AFTER) {
                    Ok(message) => (self.decode(message), false),
                    Err(RecvTimeoutError::Timeout) => (Vec::new(), true),
                    Err(RecvTimeoutError::Disconnected) => return,
                };
                let ends = matches!(decoded[..], [Decoded::End]);
                let reports = self.frames.report(quiet || ends).into_iter();
                decoded.splice(..0, reports.map(Decoded::Event));
                for decoded in decoded {
                    if events.blocking_send(decoded).is_err() {
                        return;
                    }
                }
                if ends {
                    return;
                }
            }
        })
    }

    fn decode(&mut self, message: Message) -> Vec<Decoded> {
        let events = match message {
            Message::Barrier(question) => return vec![Decoded::Barrier(question)],
            Message::End => return vec![Decoded::End],
            Message::Stray { key } => vec![Event::PayloadRefused {
                source: Source::Measurement,
                error: "the key is not of the form <prefix>/<kind>/<site>/<source>".to_owned(),
                reason: "stray_key",
                key,
            }],
            Message::Payload {
                key,
                address: Address::Measurement { site, stream },
                encoding,
                payload,
            } => self
                .measurement(&site, stream, &encoding, &payload)
                .unwrap_or_else(|refusal| vec![refusal.event(Source::Measurement, key)]),
            Message::Payload {
                key,
                address: Address::Recording { site, recorder },
                payload,
                ..
            } => match self.recording(&site, &recorder, &payload) {
                Ok(records) => records
                    .into_iter()
                    .map(|record| recorded(&site, &recorder, record))
                    .collect(),
                Err(refusal) => vec![refusal.event(Source::Recording, key)],
            },
        };
        events.into_iter().map(Decoded::Event).collect()
    }

    /// A batch, or frames: those have no encoding of their own, so that one that is declared rules
    /// them out.
    fn measurement(
        &mut self,
        site: &str,
        stream: String,
        encoding: &str,
        payload: &[u8],
    ) -> Result<Vec<Event>, Refusal> {
        let limit = self.settings.batch_limits.payload_bytes_max;
        let undeclared = encoding_of(encoding) == Encoding::Unknown;
        if !undeclared || payload.len() > limit || !starts_as_frame(payload) {
            return Ok(vec![self.batch(site, stream, encoding, payload)?]);
        }
        let site = site_called(&self.sites, site)?;
        let taken = self.frames.take(site, &stream, payload);
        taken.map_err(|refusal: FramesRefusal| {
            let (reason, error) = refusal.words(&site.name, &stream);
            Refusal { reason, error }
        })
    }

    fn batch(
        &self,
        site: &str,
        stream: String,
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
        batch.stream = stream;
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
