//! Frames out of a byte stream.

use super::{
    checksum::{StretchCrcs, crc_ccitt},
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

impl StreamCounters {
    /// Adds the counts of another stream.
    pub const fn add(&mut self, other: &Self) {
        self.bytes += other.bytes;
        self.frames += other.frames;
        self.frame_bytes += other.frame_bytes;
        self.skipped_bytes += other.skipped_bytes;
        self.resynchronisations += other.resynchronisations;
        self.bad_checksums += other.bad_checksums;
    }
}

/// Cuts frames out of a byte stream, and finds the next one after garbage.
///
/// A frame is given out when its SYNC, FRAMESIZE and CHK are right; kind, version and content are
/// [`super::decode`]'s matter. After a byte that starts no frame the decoder looks at every byte
/// behind it for a head; a head that promises more bytes than are there does not hold up a
/// complete frame behind it.
///
/// Work: proportional to the bytes, also on garbage. Memory, if frames are taken out after each
/// push: the longest frame (65 535 bytes) plus what one [`StreamDecoder::push`] brings, and while
/// it is looking up to seven times that.
#[derive(Clone, Debug)]
pub struct StreamDecoder {
    held: Vec<u8>,
    frame_bytes_max: usize,
    /// Present while no frame is known to start at the first byte held.
    search: Option<Search>,
    /// Whether the last byte taken out was a skipped one.
    in_gap: bool,
    counters: StreamCounters,
}

/// What is known about the bytes held while a frame is looked for.
#[derive(Clone, Debug)]
struct Search {
    crcs: StretchCrcs,
    /// Bytes that were looked at as the first of a head.
    looked_at: usize,
    /// Heads whose frame is not complete, in order.
    heads: Vec<Head>,
    /// Least end of them.
    first_end: usize,
}

/// Where a frame starts and ends if its head is one.
#[derive(Clone, Copy, Debug)]
struct Head {
    start: u32,
    end: u32,
}

/// What some bytes are the start of.
enum Start {
    /// No frame.
    No,
    /// Too few bytes to tell.
    Open,
    /// A frame of that length, if its check word is right.
    Frame(usize),
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
    /// memory, and less waiting for the end of what only looks like a frame.
    #[must_use]
    pub fn with_limit(frame_bytes_max: usize) -> Self {
        Self {
            held: Vec::new(),
            frame_bytes_max: frame_bytes_max.clamp(FRAME_BYTES_MIN, FRAME_BYTES_MAX),
            search: None,
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
        if self.search.is_none() {
            match start(&self.held, self.frame_bytes_max) {
                Start::Open => return None,
                Start::Frame(length) => {
                    let frame = self.held.get(..length)?;
                    let (checked, check) = frame.split_at(length - CHECK_BYTES);
                    if crc_ccitt(checked).to_be_bytes() == check {
                        return Some(self.take(length));
                    }
                    self.counters.bad_checksums += 1;
                }
                Start::No => {}
            }
            self.search = Some(Search {
                crcs: StretchCrcs::new(),
                looked_at: 1,
                heads: Vec::new(),
                first_end: usize::MAX,
            });
        }
        let search = self.search.as_mut()?;
        let bad = &mut self.counters.bad_checksums;
        if let Some((start, end)) = search.look(&self.held, self.frame_bytes_max, bad) {
            self.skip(start);
            self.search = None;
            return Some(self.take(end - start));
        }
        let settled = search.settled();
        self.skip(settled);
        None
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
        self.search = None;
        self.skip(self.held.len());
        self.in_gap = false;
    }

    fn take(&mut self, length: usize) -> Vec<u8> {
        let rest = self.held.split_off(length);
        self.counters.frames += 1;
        self.counters.frame_bytes += length as u64;
        self.in_gap = false;
        std::mem::replace(&mut self.held, rest)
    }

    fn skip(&mut self, bytes: usize) {
        if bytes == 0 {
            return;
        }
        self.held.drain(..bytes);
        if let Some(search) = &mut self.search {
            search.drop_front(bytes);
        }
        self.counters.skipped_bytes += bytes as u64;
        if !self.in_gap {
            self.counters.resynchronisations += 1;
            self.in_gap = true;
        }
    }
}

impl Search {
    /// Looks at what arrived: where the first good frame starts and ends. Counts the complete
    /// candidates that are none.
    fn look(
        &mut self,
        held: &[u8],
        frame_bytes_max: usize,
        bad_checksums: &mut u64,
    ) -> Option<(usize, usize)> {
        self.crcs.cover(held);
        while self.looked_at < held.len() {
            let at = self.looked_at;
            match start(&held[at..], frame_bytes_max) {
                Start::Open => break,
                Start::No => {}
                Start::Frame(length) => {
                    let end = at + length;
                    if let (Ok(start), Ok(end_32)) = (u32::try_from(at), u32::try_from(end)) {
                        let end = end_32;
                        self.heads.push(Head { start, end });
                    }
                    self.first_end = self.first_end.min(end);
                }
            }
            self.looked_at += 1;
        }
        if held.len() < self.first_end {
            return None;
        }
        let crcs = &self.crcs;
        let mut found = None;
        self.heads.retain(|head| {
            let (start, end) = (head.start as usize, head.end as usize);
            if end > held.len() || found.is_some() {
                return true;
            }
            let checked = end - CHECK_BYTES;
            if crcs.of(start, checked).to_be_bytes() == held[checked..end] {
                found = Some((start, end));
            } else {
                *bad_checksums += 1;
            }
            false
        });
        let ends = self.heads.iter().map(|head| head.end as usize);
        self.first_end = ends.min().unwrap_or(usize::MAX);
        found
    }

    /// How many bytes at the front can be in no frame.
    fn settled(&self) -> usize {
        let first = self.heads.first().map(|head| head.start as usize);
        first.unwrap_or(self.looked_at)
    }

    /// Takes settled bytes off the front.
    fn drop_front(&mut self, bytes: usize) {
        self.crcs.drop_front(bytes);
        self.looked_at = self.looked_at.saturating_sub(bytes);
        let dropped = u32::try_from(bytes).unwrap_or(u32::MAX);
        for head in &mut self.heads {
            head.start = head.start.saturating_sub(dropped);
            head.end = head.end.saturating_sub(dropped);
        }
        let ends = self.heads.iter().map(|head| head.end as usize);
        self.first_end = ends.min().unwrap_or(usize::MAX);
    }
}

/// What `bytes` are the start of.
fn start(bytes: &[u8], frame_bytes_max: usize) -> Start {
    let possible = match bytes {
        [] => return Start::Open,
        [SYNC] => true,
        [SYNC, second, ..] => FrameKind::from_code(second >> 4).is_some() && second & 0x0f != 0,
        _ => false,
    };
    if !possible {
        return Start::No;
    }
    let Some(&[_, _, high, low]) = bytes.first_chunk::<HEAD_BYTES>() else {
        return Start::Open;
    };
    let length = usize::from(u16::from_be_bytes([high, low]));
    if (FRAME_BYTES_MIN..=frame_bytes_max).contains(&length) {
        Start::Frame(length)
    } else {
        Start::No
    }
}
