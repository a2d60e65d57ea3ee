//! A batch of samples as it arrives from one stream.

use super::{Channel, Quality};

/// Consecutive samples of some channels of one site, as one stream delivered them.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleBatch {
    /// Site the load belongs to.
    pub site: String,
    /// Stream within the site; several streams may each carry some of the channels.
    pub stream: String,
    /// The stream's own running number, from which lost batches are counted.
    pub sequence: Option<u64>,
    /// Time of the first sample, UTC nanoseconds.
    pub start_ns: i64,
    /// Samples per second.
    pub rate_fps: f64,
    /// Channel values, all of the same length, at least one.
    pub channels: Vec<(Channel, Vec<f64>)>,
    /// Quality of each sample; the same length as the channels.
    pub quality: Vec<Quality>,
}

impl SampleBatch {
    /// Number of instants in the batch.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.quality.len()
    }

    /// Whether the batch holds no instant.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.quality.is_empty()
    }
}
