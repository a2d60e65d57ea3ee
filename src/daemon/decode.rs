//! From payloads to events, on threads of their own: a payload may take longer to decode than the
//! loop may take for a step.

use std::{
    collections::BTreeMap,
    sync::{Arc, mpsc::Receiver},
    thread::{self, JoinHandle},
};

use tokio::sync::mpsc::Sender;

use super::settings::Settings;
use crate::{
    adapters::{
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
}

struct Refusal {
    reason: &'static str,
    error: String,
}

impl Decoder {
    pub(super) fn new(settings: &Arc<Settings>) -> Self {
        let sites = settings.sites.iter().map(|s| &s.site);
        Self {
            sites: Arc::new(sites.map(|s| (s.name.clone(), s.clone())).collect()),
            settings: Arc::clone(settings),
        }
    }

    /// Decodes until the queue is closed at the other end, or the loop is gone. The thread ends
    /// when both entrances of the queue are dropped.
    pub(super) fn spawn(
        self,
        name: &str,
        messages: Receiver<Message>,
        events: Sender<Decoded>,
    ) -> std::io::Result<JoinHandle<()>> {
        thread::Builder::new().name(name.to_owned()).spawn(move || {
            for message in messages {
                for decoded in self.decode(message) {
                    if events.blocking_send(decoded).is_err() {
                        return;
                    }
                }
            }
        })
    }

    pub(super) fn decode(&self, message: Message) -> Vec<Decoded> {
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
            } => vec![
                self.batch(&site, stream, &encoding, &payload)
                    .unwrap_or_else(|refusal| refusal.event(Source::Measurement, key)),
            ],
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

    fn batch(
        &self,
        site: &str,
        stream: String,
        encoding: &str,
        payload: &[u8],
    ) -> Result<Event, Refusal> {
        let site = self.site(site)?;
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
        let site = self.site(site)?;
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

    fn site(&self, name: &str) -> Result<&Site, Refusal> {
        self.sites.get(name).ok_or_else(|| Refusal {
            reason: "unknown_site",
            error: format!("the site `{name}` is not configured"),
        })
    }
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
