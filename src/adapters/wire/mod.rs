//! Bytes and documents that leave or enter the service. Domain types know nothing of them: each
//! version of the wire has its own counterparts here, with conversions, and can go on being read
//! when the domain has moved on. `docs/wire-format.md` is the description for others.

mod canonical;
mod errors;
pub mod v1;

use std::fmt;

pub use canonical::{canonical_json, content_hash};
pub use errors::DocumentError;

/// How a payload is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// CBOR (RFC 8949).
    Cbor,
    /// JSON (RFC 8259).
    Json,
    /// Nobody said: the first byte tells.
    Unknown,
}

impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Cbor => "CBOR",
            Self::Json => "JSON",
            Self::Unknown => "CBOR or JSON",
        })
    }
}

impl Encoding {
    /// The encoding itself or, where unknown, what the first byte says: `{` opens a JSON object, a
    /// byte of major type 5 a CBOR map, `d9 d9 f7` is CBOR's own mark (RFC 8949, 3.4.6).
    #[must_use]
    pub fn or_sniffed(self, payload: &[u8]) -> Option<Self> {
        match self {
            Self::Cbor | Self::Json => Some(self),
            Self::Unknown => match payload {
                [0xa0..=0xbf, ..] | [0xd9, 0xd9, 0xf7, ..] => Some(Self::Cbor),
                _ => (payload.trim_ascii_start().first() == Some(&b'{')).then_some(Self::Json),
            },
        }
    }
}
