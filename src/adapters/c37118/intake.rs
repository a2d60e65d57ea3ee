//! Frames of one stream as messages bring them: configurations are remembered, data frames become
//! samples of one load, and what became of each frame is counted.

use super::{
    assembler::ConfigurationAssembler,
    configuration::{Configuration, ConfigurationKind},
    convert::{Converter, SampleRefusal, batches},
    data::DataMessage,
    error::{Error, Reason},
    frame::{FRAME_BYTES_MAX, FRAME_BYTES_MIN, Frame, FrameKind, SYNC, decode},
    load_mapping::{LoadMapping, MappingError},
};
use crate::measurement::{Sample, SampleBatch, Site};

/// What became of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FrameOutcome {
    /// A data frame gave a sample.
    Sample,
    /// A configuration, or a part of one; the first, or the same as before.
    Configuration,
    /// A configuration that differs from the one before it.
    Reconfiguration,
    /// A header, a command or a CFG-1: nothing to do with it.
    Other,
    /// A data frame before any configuration.
    NoConfiguration,
    /// A data frame of another length or stream than the configuration says.
    NotAsConfigured,
    /// A data frame of a stream whose configuration lacks what the mapping names.
    NotMapped,
    /// A data frame without a usable time, such as in an inserted leap second.
    NoTime,
    /// The check word is wrong.
    BadChecksum,
    /// Bytes that are no frame, or a field that is wrong.
    Malformed,
}

impl FrameOutcome {
    /// Every outcome.
    pub const ALL: [Self; 10] = [
        Self::Sample,
        Self::Configuration,
        Self::Reconfiguration,
        Self::Other,
        Self::NoConfiguration,
        Self::NotAsConfigured,
        Self::NotMapped,
        Self::NoTime,
        Self::BadChecksum,
        Self::Malformed,
    ];

    /// The label.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::Configuration => "configuration",
            Self::Reconfiguration => "reconfiguration",
            Self::Other => "other",
            Self::NoConfiguration => "no_configuration",
            Self::NotAsConfigured => "not_as_configured",
            Self::NotMapped => "not_mapped",
            Self::NoTime => "no_time",
            Self::BadChecksum => "bad_checksum",
            Self::Malformed => "malformed",
        }
    }
}

/// How many frames had each outcome, in the order of [`FrameOutcome::ALL`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts([u64; FrameOutcome::ALL.len()]);

impl FrameCounts {
    /// No frame at all.
    pub const NONE: Self = Self([0; FrameOutcome::ALL.len()]);

    /// The count of one outcome.
    #[must_use]
    pub const fn of(&self, outcome: FrameOutcome) -> u64 {
        self.0[outcome as usize]
    }

    /// Adds the counts of `other`.
    pub fn add(&mut self, other: &Self) {
        for (count, more) in self.0.iter_mut().zip(other.0) {
            *count += more;
        }
    }

    const fn note(&mut self, outcome: FrameOutcome) {
        self.0[outcome as usize] += 1;
    }
}

/// What became of a message.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Taken {
    /// Samples, cut where they do not follow one another at the stream's rate.
    pub batches: Vec<SampleBatch>,
    /// What became of each frame.
    pub counts: FrameCounts,
    /// Whether the source's configuration should be asked for: there is none, it does not fit the
    /// data, or the data say that it is about to change (STAT bit 10).
    pub wants_configuration: bool,
    /// The first frame that could not be used, and why.
    pub trouble: Option<(FrameOutcome, String)>,
}

/// Turns the messages of one stream into samples of one load. Memory: one configuration, and up to
/// 1 MiB while a CFG-3 in parts is incomplete.
#[derive(Clone, Debug)]
pub struct FrameIntake {
    site: Site,
    stream: String,
    mapping: LoadMapping,
    assembler: ConfigurationAssembler,
    configured: Option<Configured>,
}

/// A configuration, and how its data become samples.
#[derive(Clone, Debug)]
struct Configured {
    configuration: Configuration,
    converter: Result<Converter, MappingError>,
}

/// Whether `payload` starts as a frame does: SYNC with a type of frame, and a FRAMESIZE that the
/// bytes can hold. The first byte alone would also start a CBOR map of ten pairs.
#[must_use]
pub fn starts_as_frame(payload: &[u8]) -> bool {
    let Some(&[sync, second, high, low]) = payload.first_chunk() else {
        return false;
    };
    let size = usize::from(u16::from_be_bytes([high, low]));
    sync == SYNC
        && FrameKind::from_code(second >> 4).is_some()
        && second & 0x0f != 0
        && (FRAME_BYTES_MIN..=payload.len().min(FRAME_BYTES_MAX)).contains(&size)
}

impl FrameIntake {
    /// An intake that has seen nothing. `stream` names the stream in the batches.
    #[must_use]
    pub fn new(site: &Site, stream: &str, mapping: &LoadMapping) -> Self {
        Self {
            site: site.clone(),
            stream: stream.to_owned(),
            mapping: mapping.clone(),
            assembler: ConfigurationAssembler::new(),
            configured: None,
        }
    }

    /// The configuration in force.
    #[must_use]
    pub fn configuration(&self) -> Option<&Configuration> {
        self.configured.as_ref().map(|c| &c.configuration)
    }

    /// Takes a message of one or several whole frames. Behind bytes that are no frame nothing of the
    /// message is read, because there is no telling where the next frame starts.
    pub fn take(&mut self, payload: &[u8]) -> Taken {
        let (mut taken, mut samples) = (Taken::default(), Vec::new());
        let mut rest = payload;
        while !rest.is_empty() {
            if !starts_as_frame(rest) {
                let bytes = rest.len();
                let trouble = format!("the last {bytes} bytes of the message are no whole frame");
                taken.refuse(FrameOutcome::Malformed, || trouble);
                break;
            }
            let size = usize::from(u16::from_be_bytes([rest[2], rest[3]]));
            let (frame, behind) = rest.split_at(size);
            rest = behind;
            match decode(frame) {
                Ok(Frame::Data(message)) => self.data(&message, &mut samples, &mut taken),
                Ok(frame) => {
                    // Samples before a configuration are of the stream as it was.
                    self.hand_over(&mut samples, &mut taken);
                    self.not_data(frame, &mut taken);
                }
                Err(error) => taken.refuse(outcome_of(&error), || error.to_string()),
            }
        }
        self.hand_over(&mut samples, &mut taken);
        taken
    }

    fn data(&self, message: &DataMessage, samples: &mut Vec<Sample>, taken: &mut Taken) {
        let Some(configured) = &self.configured else {
            taken.wants_configuration = true;
            taken.refuse(FrameOutcome::NoConfiguration, || {
                "a data frame arrived before any configuration".to_owned()
            });
            return;
        };
        let frame = match message.decode(&configured.configuration) {
            Ok(frame) => frame,
            Err(error) => {
                taken.wants_configuration = true;
                taken.refuse(outcome_of(&error), || error.to_string());
                return;
            }
        };
        taken.wants_configuration |= frame.pmus.iter().any(|p| p.status.configuration_changes());
        let converter = match &configured.converter {
            Ok(converter) => converter,
            Err(error) => {
                taken.refuse(FrameOutcome::NotMapped, || error.to_string());
                return;
            }
        };
        match converter.sample(&frame) {
            Ok(sample) => {
                samples.push(sample);
                taken.counts.note(FrameOutcome::Sample);
            }
            Err(refusal) => taken.refuse(outcome_of_refusal(&refusal), || refusal.to_string()),
        }
    }

    fn not_data(&mut self, frame: Frame, taken: &mut Taken) {
        let configuration = match frame {
            Frame::Configuration(configuration)
                if configuration.kind == ConfigurationKind::Configuration2 =>
            {
                configuration
            }
            Frame::ConfigurationPart(part) => match self.assembler.push(part) {
                Ok(Some(configuration)) => configuration,
                Ok(None) => return taken.counts.note(FrameOutcome::Configuration),
                Err(error) => {
                    return taken.refuse(FrameOutcome::Malformed, || error.to_string());
                }
            },
            _ => return taken.counts.note(FrameOutcome::Other),
        };
        taken.counts.note(self.configure(configuration));
    }

    fn configure(&mut self, configuration: Configuration) -> FrameOutcome {
        let before = self.configured.as_ref().map(|c| &c.configuration);
        if before.is_some_and(|before| before.says_the_same_as(&configuration)) {
            return FrameOutcome::Configuration;
        }
        let outcome = match before {
            None => FrameOutcome::Configuration,
            Some(_) => FrameOutcome::Reconfiguration,
        };
        self.configured = Some(Configured {
            converter: Converter::new(&configuration, &self.mapping, &self.site),
            configuration,
        });
        outcome
    }

    fn hand_over(&self, samples: &mut Vec<Sample>, taken: &mut Taken) {
        let converter = self.configured.as_ref().map(|c| &c.converter);
        if let Some(Ok(converter)) = converter
            && !samples.is_empty()
        {
            let cut = batches(converter, samples, &self.site, &self.stream);
            taken.batches.extend(cut);
            samples.clear();
        }
    }
}

impl Taken {
    /// Counts a frame that could not be used; the first one is kept in words.
    fn refuse(&mut self, outcome: FrameOutcome, words: impl FnOnce() -> String) {
        self.counts.note(outcome);
        if self.trouble.is_none() {
            self.trouble = Some((outcome, words()));
        }
    }
}

const fn outcome_of(error: &Error) -> FrameOutcome {
    match error.reason {
        Reason::Checksum { .. } => FrameOutcome::BadChecksum,
        Reason::OtherStream { .. } | Reason::NotAsConfigured { .. } => {
            FrameOutcome::NotAsConfigured
        }
        _ => FrameOutcome::Malformed,
    }
}

const fn outcome_of_refusal(refusal: &SampleRefusal) -> FrameOutcome {
    match refusal {
        SampleRefusal::Fraction { .. } | SampleRefusal::LeapSecond { .. } => FrameOutcome::NoTime,
        SampleRefusal::OtherConfiguration => FrameOutcome::NotAsConfigured,
    }
}
