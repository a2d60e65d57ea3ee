//! What is remembered of each stream: its running number and how far it has come.

use std::collections::{BTreeMap, BTreeSet};

/// Streams of one site that are remembered; beyond it the one heard of longest ago is forgotten.
const STREAMS_MAX: usize = 64;

/// Missing running numbers remembered per stream, so that a batch that arrives out of order is not
/// counted as lost for good.
const MISSING_MAX: usize = 256;

/// A running number this far behind the last one is a publisher that started anew, not a batch
/// out of order. Chosen: more batches than fit into a sensible lag time.
const BEHIND_MAX: u64 = 256;

/// The number 0 this far behind the last one is a publisher that started anew.
const ZERO_BEHIND_MAX: u64 = 16;

/// The streams of one site, by name.
#[derive(Clone, Debug, Default)]
pub(super) struct Streams(BTreeMap<String, Stream>);

#[derive(Clone, Debug, Default)]
struct Stream {
    last: Option<u64>,
    missing: BTreeSet<u64>,
    /// Newest grid point of which the stream delivered something; none on a new grid.
    newest: Option<i64>,
}

/// What a running number says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct SequenceNews {
    pub(super) lost: u64,
    pub(super) found: u64,
}

impl Streams {
    /// Takes note of a batch's running number.
    pub(super) fn number(&mut self, name: &str, sequence: Option<u64>) -> SequenceNews {
        let stream = self.stream(name);
        sequence.map_or_else(SequenceNews::default, |number| stream.number(number))
    }

    /// Takes note of a grid point; says whether the stream had been further already.
    pub(super) fn advance(&mut self, name: &str, index: i64) -> bool {
        let stream = self.stream(name);
        let behind = stream.newest.is_some_and(|newest| index < newest);
        stream.newest = stream.newest.max(Some(index));
        behind
    }

    /// Whether another stream has delivered something at or after `since`.
    pub(super) fn others_active(&self, name: &str, since: i64) -> bool {
        self.0
            .iter()
            .any(|(other, stream)| other != name && stream.newest >= Some(since))
    }

    /// Forgets how far each stream has come, but not its running number.
    pub(super) fn restart(&mut self) {
        for stream in self.0.values_mut() {
            stream.newest = None;
        }
    }

    fn stream(&mut self, name: &str) -> &mut Stream {
        if !self.0.contains_key(name) && self.0.len() >= STREAMS_MAX {
            let oldest = self.0.iter().min_by_key(|(_, stream)| stream.newest);
            if let Some(oldest) = oldest.map(|(oldest, _)| oldest.clone()) {
                self.0.remove(&oldest);
            }
        }
        self.0.entry(name.to_owned()).or_default()
    }
}

impl Stream {
    fn number(&mut self, number: u64) -> SequenceNews {
        let Some(last) = self.last else {
            self.last = Some(number);
            return SequenceNews::default();
        };
        if number <= last {
            if self.missing.remove(&number) {
                return SequenceNews { lost: 0, found: 1 };
            }
            let allowed = if number == 0 {
                ZERO_BEHIND_MAX
            } else {
                BEHIND_MAX
            };
            if last - number > allowed {
                self.missing.clear();
                self.last = Some(number);
            }
            return SequenceNews::default();
        }
        self.last = Some(number);
        for missing in (last + 1..number).rev().take(MISSING_MAX) {
            self.missing.insert(missing);
        }
        while self.missing.len() > MISSING_MAX {
            self.missing.pop_first();
        }
        SequenceNews {
            lost: number - last - 1,
            found: 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_in_the_running_number_are_counted_and_uncounted() {
        let mut streams = Streams::default();
        let lost = |lost| SequenceNews { lost, found: 0 };
        assert_eq!(streams.number("a", Some(7)), lost(0));
        assert_eq!(streams.number("a", Some(8)), lost(0));
        assert_eq!(streams.number("a", Some(12)), lost(3));
        assert_eq!(
            streams.number("a", Some(10)),
            SequenceNews { lost: 0, found: 1 }
        );
        assert_eq!(streams.number("a", Some(10)), lost(0));
        assert_eq!(streams.number("b", Some(100)), lost(0));
        assert_eq!(streams.number("a", None), lost(0));
    }

    #[test]
    fn a_publisher_that_starts_anew_has_lost_nothing() {
        let mut streams = Streams::default();
        streams.number("a", Some(500));
        assert_eq!(streams.number("a", Some(0)), SequenceNews::default());
        assert_eq!(
            streams.number("a", Some(2)),
            SequenceNews { lost: 1, found: 0 }
        );
    }

    #[test]
    fn the_memory_of_streams_is_bounded() {
        let mut streams = Streams::default();
        for k in 0..1000_i64 {
            streams.advance(&format!("stream-{k}"), k);
            streams.number(&format!("stream-{k}"), Some(u64::MAX));
        }
        assert_eq!(streams.0.len(), STREAMS_MAX);
        streams.number("x", Some(0));
        assert_eq!(streams.number("x", Some(u64::MAX)).lost, u64::MAX - 1);
    }
}
