//! COMTRADE, the exchange format of disturbance recorders (IEEE C37.111-1991, -1999, -2013, IEC
//! 60255-24): configuration and data files, ASCII, BINARY, BINARY32 and FLOAT32, or one `.cff`.
//!
//! [`read`] takes a path, [`decode`] the bytes; both give a [`Recording`] or an [`Error`] that
//! names the file part, the line and the field. What a recorder does oddly but unmistakably (a
//! two-digit year, a month and day swapped, more samples than declared) is read and noted in
//! [`Recording::notes`]; what can be read in two ways is refused.
//!
//! [`write()`] and [`encode`] write a [`Recording`] in the edition of 2013.
//!
//! Memory is bounded by the size of the files, never by a number written in them.

mod ascii;
mod binary;
mod code_page;
mod configuration;
mod container;
mod error;
mod files;
mod recording;
mod sample_ticks;
mod sample_times;
#[cfg(test)]
mod tests;
mod text;
mod timestamp;
mod write;

pub use error::{Error, Part};
pub use files::{FILE_BYTES_MAX, Options, decode, decode_container, read};
pub use recording::{
    AnalogChannel, DataFormat, DigitalChannel, LeapSecond, Note, Recording, Revision, Scaling,
    Segment, TimeCode,
};
pub use write::{Encoded, WriteError, encode, encode_container, write};
