//! Frames out of a byte stream.

use super::{
    checksum::crc_ccitt,
    frame::{CHECK_BYTES, FRAME_BYTES_MAX, FRAME_BYTES_MIN, FrameKind, SYNC},
};

/// Bytes of SYNC and FRAMESIZE, enough to know how long a frame is.
const HEAD_BYTES: usize = 4;

/// What went through a [`StreamDecoder`]. Every byte pushed is in a frame, skipped, or still held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamCounters {
    /// Bytes received.
    pub bytes: u64,
    /// Frames given out.
    pub frames: u64,
    /// Bytes of those frames.
    pub frame_bytes: u64,
    /// Bytes that belong to no frame.
    pub skipped_bytes: u64,
    /// Runs of such bytes.
    pub resynchronisations: u64,
    /// Complete candidates whose check word was wrong.
    pub bad_checksums: u64,
}

/// Cuts frames out of a byte stream, and finds the next one after garbage.
///
/// A frame is given out when its SYNC, FRAMESIZE and CHK are right; kind, version and content are
/// [`super::decode`]'s matter. After a byte that starts no frame the decoder goes on with the next
/// one. While it is looking for a frame, a head that promises more bytes than are there does not
/// hold up a complete frame behind it.
///
/// Memory: at most the longest frame (65 535 bytes) plus what one [`StreamDecoder::push`] brings,
/// if frames are taken out after each push. Work: proportional to the bytes of a sound stream; on
/// garbage, up to the length a false head promises for each such head.
#[derive(Clone, Debug)]
pub struct StreamDecoder {
    held: Vec<u8>,
    frame_bytes_max: usize,
    /// Whether a byte that starts no frame was met since the last frame.
    lost: bool,
    /// Whether the last byte taken out was a skipped one.
    in_gap: bool,
    counters: StreamCounters,
}

/// What the bytes from some place on are.
enum Candidate {
    /// No frame starts here.
    No,
    /// Too few bytes to tell.
    Open,
    /// A frame of that length.
    Frame(usize),
    /// As long as it says, but with a wrong check word.
    BadChecksum,
}

impl Default for StreamDecoder {
    fn default() -> Self {
        Self::new()
    }
}

impl StreamDecoder {
    /// A decoder at the start of a stream, for frames of any length.
    #[must_use]
    pub fn new() -> Self {
        Self::with_limit(FRAME_BYTES_MAX)
    }

    /// A decoder that takes no head for one whose FRAMESIZE is above `frame_bytes_max`: less
    /// memory, and less work and waiting on garbage that looks like heads.
    #[must_use]
    pub fn with_limit(frame_bytes_max: usize) -> Self {
        Self {
            held: Vec::new(),
            frame_bytes_max: frame_bytes_max.clamp(FRAME_BYTES_MIN, FRAME_BYTES_MAX),
            lost: false,
            in_gap: false,
            counters: StreamCounters::default(),
        }
    }

    /// Takes bytes as they arrived.
    pub fn push(&mut self, bytes: &[u8]) {
        self.counters.bytes += bytes.len() as u64;
        self.held.extend_from_slice(bytes);
    }

    /// The next complete frame; none until more bytes arrive.
    pub fn next_frame(&mut self) -> Option<Vec<u8>> {
        let mut at = 0;
        let mut open_from = None;
        let mut bad_behind_open = 0;
        let found = loop {
            let rest = &self.held[at..];
            if rest.is_empty() {
                break None;
            }
            match candidate(rest, self.frame_bytes_max) {
                Candidate::Frame(length) => break Some(length),
                Candidate::Open if !self.lost => break None,
                Candidate::Open => {
                    open_from.get_or_insert(at);
                }
                Candidate::BadChecksum => {
                    // Behind an open head this candidate is met again unless a frame follows.
                    if open_from.is_none() {
                        self.counters.bad_checksums += 1;
                    } else {
                        bad_behind_open += 1;
                    }
                    self.lost = true;
                }
                Candidate::No => self.lost = true,
            }
            at += 1;
        };
        let Some(length) = found else {
            let keep_from = open_from.unwrap_or(at);
            self.skip(keep_from);
            return None;
        };
        self.counters.bad_checksums += bad_behind_open;
        self.skip(at);
        let rest = self.held.split_off(length);
        let frame = std::mem::replace(&mut self.held, rest);
        self.lost = false;
        self.counters.frames += 1;
        self.counters.frame_bytes += length as u64;
        self.in_gap = false;
        Some(frame)
    }

    /// What went through so far.
    #[must_use]
    pub const fn counters(&self) -> StreamCounters {
        self.counters
    }

    /// Bytes that wait for the rest of their frame.
    #[must_use]
    pub const fn held_bytes(&self) -> usize {
        self.held.len()
    }

    /// Forgets what is held, for a new connection; the bytes are counted as skipped.
    pub fn reset(&mut self) {
        let held = self.held.len();
        self.skip(held);
        self.lost = false;
        self.in_gap = false;
    }

    fn skip(&mut self, bytes: usize) {
        if bytes == 0 {
            return;
        }
        self.held.drain(..bytes);
        self.counters.skipped_bytes += bytes as u64;
        if !self.in_gap {
            self.counters.resynchronisations += 1;
            self.in_gap = true;
        }
    }
}

fn candidate(bytes: &[u8], frame_bytes_max: usize) -> Candidate {
    let starts = match bytes {
        [SYNC] => true,
        [SYNC, second, ..] => FrameKind::from_code(second >> 4).is_some() && second & 0x0f != 0,
        _ => false,
    };
    if !starts {
        return Candidate::No;
    }
    let Some(&[_, _, high, low]) = bytes.first_chunk::<HEAD_BYTES>() else {
        return Candidate::Open;
    };
    let length = usize::from(u16::from_be_bytes([high, low]));
    if !(FRAME_BYTES_MIN..=frame_bytes_max).contains(&length) {
        return Candidate::No;
    }
    let Some(frame) = bytes.get(..length) else {
        return Candidate::Open;
    };
    let (checked, check) = frame.split_at(length - CHECK_BYTES);
    if crc_ccitt(checked).to_be_bytes() == check {
        Candidate::Frame(length)
    } else {
        Candidate::BadChecksum
    }
}
