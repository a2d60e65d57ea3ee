//! The instants that wait for more data.

use std::collections::VecDeque;

use super::bit;
use crate::measurement::{Channel, Quality, Sample, SampleBatch};

/// Channels that every instant waits for.
const REQUIRED: u8 = bit(Channel::VoltagePu)
    | bit(Channel::FrequencyHz)
    | bit(Channel::ActivePu)
    | bit(Channel::ReactivePu);

/// Instants in order, from the oldest that is not released to the newest of which anything came.
#[derive(Clone, Debug)]
pub(super) struct Pending {
    /// Index of the oldest instant that is not released.
    head: i64,
    /// Highest index of which anything came.
    newest: i64,
    /// The instants from `head` on; never more than up to `newest`.
    slots: VecDeque<Slot>,
    /// Which channels the last released instants had, newest last: tells duplicate from late.
    released: VecDeque<u8>,
    /// Nothing is released before `newest` has reached this.
    learnt_at: i64,
    lag: i64,
    forget_after: i64,
    /// Optional channels that are always waited for.
    expected: u8,
    /// Index of the newest value of each optional channel.
    last_seen: [Option<i64>; Channel::ALL.len()],
}

/// What came of one instant.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Slot {
    filled: u8,
    values: [f64; Channel::ALL.len()],
    qualities: [Quality; Channel::ALL.len()],
}

/// Where a sample went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Placement {
    Accepted { usable: bool },
    Duplicate,
    Late,
}

impl Pending {
    pub(super) fn starting_at(
        index: i64,
        lag: i64,
        forget_after: i64,
        expected: &[Channel],
    ) -> Self {
        Self {
            head: index,
            newest: index,
            slots: VecDeque::new(),
            released: VecDeque::new(),
            learnt_at: index + lag,
            lag,
            forget_after,
            expected: expected
                .iter()
                .fold(0, |mask, channel| mask | bit(*channel)),
            last_seen: [None; Channel::ALL.len()],
        }
    }

    pub(super) const fn newest(&self) -> i64 {
        self.newest
    }

    pub(super) fn len(&self) -> usize {
        self.slots.len()
    }

    /// Number of instants that would wait if one at `index` came.
    pub(super) fn len_reaching(&self, index: i64) -> usize {
        let reach = usize::try_from(index.saturating_sub(self.head) + 1).unwrap_or(0);
        self.len().max(reach)
    }

    /// Puts sample `k` of a batch at `index`.
    pub(super) fn place(&mut self, index: i64, batch: &SampleBatch, k: usize) -> Placement {
        if index < self.head && !self.make_room_before(index) {
            return self.late_or_duplicate(index, batch);
        }
        let at = usize::try_from(index - self.head).unwrap_or(0);
        if at >= self.slots.len() {
            self.slots.resize(at + 1, Slot::default());
        }
        self.newest = self.newest.max(index);
        let placement = self.slots[at].fill(batch, k);
        for (channel, _) in batch.channels.iter().filter(|(c, _)| c.optional()) {
            let last_seen = &mut self.last_seen[*channel as usize];
            *last_seen = (*last_seen).max(Some(index));
        }
        placement
    }

    /// The next instant that may go, with its index.
    pub(super) fn release(&mut self, everything: bool) -> Option<(i64, Slot)> {
        let slot = *self.slots.front()?;
        let overdue = self.newest - self.head > self.lag;
        let complete = self.newest >= self.learnt_at && slot.holds(self.awaited());
        if !(everything || overdue || complete) {
            return None;
        }
        self.slots.pop_front();
        self.released.push_back(slot.filled);
        if self.released.len() > usize::try_from(self.lag).unwrap_or(0) + 1 {
            self.released.pop_front();
        }
        self.head += 1;
        Some((self.head - 1, slot))
    }

    /// Before anything was released the first instants may still be preceded by older ones.
    fn make_room_before(&mut self, index: i64) -> bool {
        if !self.released.is_empty() || self.newest - index > self.lag {
            return false;
        }
        while self.head > index {
            self.slots.push_front(Slot::default());
            self.head -= 1;
        }
        true
    }

    fn late_or_duplicate(&self, index: i64, batch: &SampleBatch) -> Placement {
        let back = usize::try_from(self.head - index).unwrap_or(usize::MAX);
        let had = self
            .released
            .len()
            .checked_sub(back)
            .and_then(|at| self.released.get(at))
            .copied()
            .unwrap_or(0);
        let brings = batch.channels.iter().fold(0, |mask, (c, _)| mask | bit(*c));
        if brings & !had == 0 {
            Placement::Duplicate
        } else {
            Placement::Late
        }
    }

    /// Channels that an instant waits for at present.
    fn awaited(&self) -> u8 {
        let alive = self.newest - self.forget_after;
        Channel::ALL
            .iter()
            .filter(|channel| self.last_seen[**channel as usize] >= Some(alive))
            .fold(REQUIRED | self.expected, |mask, channel| {
                mask | bit(*channel)
            })
    }
}

impl Slot {
    pub(super) const fn is_empty(&self) -> bool {
        self.filled == 0
    }

    pub(super) const fn holds_required(&self) -> bool {
        self.holds(REQUIRED)
    }

    const fn holds(&self, channels: u8) -> bool {
        self.filled & channels == channels
    }

    /// Takes what is new of a sample: channels not there yet, and usable values for unusable ones.
    fn fill(&mut self, batch: &SampleBatch, k: usize) -> Placement {
        let (mut accepted, mut usable) = (false, true);
        for (channel, values) in &batch.channels {
            let (value, quality) = judged(*channel, values[k], batch.quality[k]);
            let at = *channel as usize;
            let there = self.filled & bit(*channel) != 0;
            if there && (self.qualities[at].usable() || !quality.usable()) {
                continue;
            }
            self.filled |= bit(*channel);
            self.values[at] = value;
            self.qualities[at] = quality;
            accepted = true;
            usable &= quality.usable();
        }
        if accepted {
            Placement::Accepted { usable }
        } else {
            Placement::Duplicate
        }
    }

    pub(super) fn into_sample(self, time_ns: i64) -> Sample {
        let mut sample = Sample::missing(time_ns);
        if self.is_empty() {
            return sample;
        }
        sample.quality = Quality::GOOD;
        for channel in Channel::ALL {
            if self.filled & bit(channel) != 0 {
                sample.set(channel, self.values[channel as usize]);
                sample.quality = sample.quality | self.qualities[channel as usize];
            }
        }
        sample
    }
}

/// A value as it is kept: infinities become NaN, and a required value that is not a number is
/// flagged.
fn judged(channel: Channel, value: f64, quality: Quality) -> (f64, Quality) {
    if value.is_finite() {
        (value, quality)
    } else if channel.optional() {
        (f64::NAN, quality)
    } else {
        (f64::NAN, quality | Quality::NOT_FINITE)
    }
}
