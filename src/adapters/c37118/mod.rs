//! IEEE C37.118.2 synchrophasor messages (editions 2005 and 2011): bytes to types and back, and
//! types to the service's samples. No sockets, no clock.
//!
//! [`StreamDecoder`] cuts frames out of a byte stream, [`decode`] reads one frame, [`DataMessage`]
//! is a data frame that waits for its [`Configuration`], [`ConfigurationAssembler`] joins the parts
//! of a CFG-3, [`Converter`] turns data frames into per-unit samples of one load. [`FrameIntake`] does
//! all of that for the messages of one stream; [`Dialogue`] decides what a client says to a source, and
//! [`Played`] makes frames of samples.
//! `docs/c37118.md` says what is supported, by table of the standard.
//!
//! Every length is checked against the bytes that are there before anything is reserved: memory is
//! bounded by the input, never by a count written in it.

mod assembler;
mod bytes;
mod channel;
mod checksum;
mod configuration;
mod configuration_fixed;
mod configuration_variable;
mod convert;
mod data;
mod dialogue;
mod error;
mod frame;
mod intake;
mod load_mapping;
mod name;
mod playing;
mod proposal;
mod status;
mod stream;
#[cfg(test)]
mod tests;
mod time;

pub use assembler::{AssemblyError, ConfigurationAssembler};
pub use channel::{
    AnalogChannel, AnalogKind, AnalogScaling, DigitalWord, PhasorChannel, PhasorComponent,
    PhasorQuantity, PhasorScaling,
};
pub use configuration::{
    Configuration, ConfigurationKind, DataRate, Format, LocationAndFilter, NominalFrequencyCode,
    PmuConfiguration,
};
pub use configuration_variable::ConfigurationPart;
pub use convert::{Converter, SampleRefusal, batches};
pub use data::{DataFrame, DataMessage, Number, Phasor, PmuData};
pub use dialogue::{Dialogue, DialogueCounts, DialogueOptions, Step, Trouble};
pub use error::{EncodeError, Error, Reason};
pub use frame::{Command, CommandFrame, Frame, FrameKind, HeaderFrame, Prefix, Version, decode};
pub use intake::{FrameCounts, FrameIntake, FrameOutcome, Taken, starts_as_frame};
pub use load_mapping::{
    AnalogPower, FloatFrequency, LoadMapping, MappingError, PhasorSet, PmuChoice, PowerSource,
    SignedSet,
};
pub use playing::{Played, PlayingError};
pub use proposal::propose;
pub use status::Status;
pub use stream::{StreamCounters, StreamDecoder};
pub use time::{TimeQuality, Timestamp};
