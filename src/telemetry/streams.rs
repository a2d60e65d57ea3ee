//! What came in since the start, stream by stream. Names of streams come from the network: they are shown to
//! people, who see at once what is odd, and never become labels.

use std::{
    collections::BTreeMap,
    sync::{Mutex, MutexGuard, PoisonError},
};

use super::intake::{BatchTaken, FramesTaken, SampleCounts, StreamEnded};

/// Streams that are remembered. Chosen: four times the largest installation tried; some hundred bytes each.
const STREAMS_MAX: usize = 4096;

/// One stream of a site since the start.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StreamState {
    /// Batches taken in; for frames, the runs of samples that messages gave.
    pub batches: u64,
    /// Batches that have not arrived, by the stream's running number; those that came out of order are taken off.
    pub batches_lost: u64,
    /// Its samples.
    pub samples: SampleCounts,
    /// C37.118 frames by what became of them; empty for other streams.
    pub frames: BTreeMap<&'static str, u64>,
    /// Steps of its time, by kind.
    pub steps: BTreeMap<&'static str, u64>,
    /// The last of them, in words.
    pub last_step: Option<String>,
    /// Times it was the last of its site to fall silent.
    pub silences: u64,
    /// Samples per second.
    pub rate_fps: f64,
    /// Time of the newest sample, UTC nanoseconds.
    pub newest_ns: i64,
    /// When it arrived, UTC nanoseconds; 0 for a stream of which nothing could be used.
    pub arrived_ns: i64,
    /// Worst message time quality of the last batch (C37.118.2, table 4).
    pub time_quality_code: u8,
}

/// All streams.
#[derive(Debug, Default)]
pub struct StreamTable(Mutex<Streams>);

#[derive(Debug, Default)]
struct Streams {
    sites: BTreeMap<String, BTreeMap<String, StreamState>>,
    count: usize,
    /// Messages of streams beyond the bound.
    beyond: u64,
}

impl StreamTable {
    /// Every stream by site and name, and the messages of further ones that are not remembered.
    #[must_use]
    pub fn read(&self) -> (Vec<(String, String, StreamState)>, u64) {
        let table = self.lock();
        let of_site = |(site, streams): (&String, &BTreeMap<String, StreamState>)| {
            let streams = streams.iter();
            let named = streams.map(|(name, state)| (site.clone(), name.clone(), state.clone()));
            named.collect::<Vec<_>>()
        };
        (table.sites.iter().flat_map(of_site).collect(), table.beyond)
    }

    pub(super) fn batch(&self, taken: &BatchTaken) {
        self.update(&taken.site, &taken.stream, |state| {
            state.batches += 1;
            let lost = state.batches_lost + taken.lost_before;
            state.batches_lost = lost.saturating_sub(taken.found);
            state.samples += taken.samples;
            state.rate_fps = taken.rate_fps;
            state.newest_ns = taken.newest_ns;
            state.arrived_ns = taken.newest_ns.saturating_add(taken.lag_ns);
            state.time_quality_code = taken.time_quality_code;
            if let Some(step) = &taken.step {
                *state.steps.entry(step.kind).or_insert(0) += 1;
                state.last_step = Some(step.words.clone());
            }
        });
    }

    pub(super) fn frames(&self, taken: &FramesTaken) {
        self.update(&taken.site, &taken.stream, |state| {
            for &(outcome, count) in &taken.outcomes {
                *state.frames.entry(outcome).or_insert(0) += count;
            }
        });
    }

    pub(super) fn ended(&self, ended: &StreamEnded) {
        self.update(&ended.site, &ended.stream, |state| {
            state.samples.missing += ended.missing;
            state.silences += u64::from(ended.silent);
        });
    }

    fn update(&self, site: &str, stream: &str, change: impl FnOnce(&mut StreamState)) {
        let mut table = self.lock();
        let known = table.sites.get_mut(site).and_then(|s| s.get_mut(stream));
        if let Some(state) = known {
            change(state);
        } else if table.count < STREAMS_MAX {
            table.count += 1;
            let streams = table.sites.entry(site.to_owned()).or_default();
            change(streams.entry(stream.to_owned()).or_default());
        } else {
            table.beyond += 1;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Streams> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_memory_of_streams_is_bounded_and_what_is_beyond_is_counted() {
        let table = StreamTable::default();
        let of_stream = |k: usize| FramesTaken {
            site: "north".to_owned(),
            stream: format!("stream-{k}"),
            configured: "*".to_owned(),
            outcomes: vec![("sample", 2)],
            trouble: None,
        };
        for k in 0..STREAMS_MAX + 3 {
            table.frames(&of_stream(k));
        }
        table.frames(&of_stream(7));
        let (streams, beyond) = table.read();
        assert_eq!((streams.len(), beyond), (STREAMS_MAX, 3));
        let (_, _, seventh) = streams.iter().find(|(_, s, _)| s == "stream-7").unwrap();
        assert_eq!(seventh.frames["sample"], 4);
    }
}
