//! What a concentrator says of the batches it was given and of the samples it hands out.

use std::{fmt, ops::AddAssign};

use crate::measurement::Sample;

/// What became of one batch; added up, of many.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PushReport {
    /// Instants in the batch.
    pub received: u64,
    /// Instants of which at least one channel was put in place.
    pub accepted: u64,
    /// Instants that had been released or given up before they arrived.
    pub late: u64,
    /// Instants all of whose channels were there already.
    pub duplicate: u64,
    /// Accepted instants that were older than what the same stream had delivered before.
    pub out_of_order: u64,
    /// Accepted instants whose flags or values forbid their use; they are kept, with their flags.
    pub bad_quality: u64,
    /// Instants that lie between grid points, at another rate, or far away in time while other
    /// streams go on.
    pub off_grid: u64,
    /// Instants refused because too many samples wait to be fetched.
    pub overflow: u64,
    /// Batches that the stream's running number says are missing.
    pub lost_batches: u64,
    /// Batches counted as lost before that arrived after all.
    pub found_batches: u64,
    /// How often the grid started anew, the first start not counted.
    pub restarts: u64,
    /// How the grid started with the (last) batch, if it did.
    pub restart: Option<Restart>,
    /// Batches refused as a whole.
    pub refused_batches: u64,
    /// Why the (last) batch was refused, if it was.
    pub refusal: Option<BatchRefusal>,
}

impl AddAssign for PushReport {
    fn add_assign(&mut self, other: Self) {
        self.received += other.received;
        self.accepted += other.accepted;
        self.late += other.late;
        self.duplicate += other.duplicate;
        self.out_of_order += other.out_of_order;
        self.bad_quality += other.bad_quality;
        self.off_grid += other.off_grid;
        self.overflow += other.overflow;
        self.lost_batches += other.lost_batches;
        self.found_batches += other.found_batches;
        self.restarts += other.restarts;
        self.restart = other.restart.or(self.restart);
        self.refused_batches += other.refused_batches;
        self.refusal = other.refusal.or(self.refusal);
    }
}

/// How a time grid came to start.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Restart {
    /// The first batch arrived.
    First,
    /// The stream went on after a gap too long to fill.
    Forward {
        /// From the newest sample to the new first one, seconds.
        gap_s: f64,
    },
    /// The stream went back in time: another recording.
    Backward {
        /// From the new first sample to the newest one before, seconds.
        gap_s: f64,
    },
    /// The samples no longer lay on the grid: another rate, or a clock that drifted.
    OffGrid {
        /// Samples per second of the new grid.
        rate_fps: f64,
    },
}

impl fmt::Display for Restart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::First => f.write_str("first batch"),
            Self::Forward { gap_s } => write!(f, "gap of {gap_s:.3} s"),
            Self::Backward { gap_s } => write!(f, "{gap_s:.3} s back in time"),
            Self::OffGrid { rate_fps } => write!(f, "new grid at {rate_fps} samples per second"),
        }
    }
}

/// Why a batch was refused as a whole.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum BatchRefusal {
    /// It belongs to another site.
    OtherSite,
    /// It holds no instant or no channel.
    Empty,
    /// Its channels and its quality differ in length.
    LengthMismatch,
    /// Its rate is outside what a grid can have.
    BadRate {
        /// Samples per second as given.
        rate_fps: f64,
    },
    /// Its time lies before 1970 or after 2200.
    BadTime,
}

impl BatchRefusal {
    /// Short name from a closed set, for a metric's label.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::OtherSite => "other_site",
            Self::Empty => "empty",
            Self::LengthMismatch => "length_mismatch",
            Self::BadRate { .. } => "bad_rate",
            Self::BadTime => "bad_time",
        }
    }
}

impl fmt::Display for BatchRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OtherSite => f.write_str("the batch belongs to another site"),
            Self::Empty => f.write_str("the batch is empty"),
            Self::LengthMismatch => f.write_str("channels and quality differ in length"),
            Self::BadRate { rate_fps } => {
                write!(f, "{rate_fps} samples per second are not admissible")
            }
            Self::BadTime => f.write_str("the time lies before 1970 or after 2200"),
        }
    }
}

/// Consecutive samples on one grid, as released by a concentrator.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// Whether these are the first samples of a new grid, not a continuation of the run before.
    pub restarted: bool,
    /// Samples per second.
    pub rate_fps: f64,
    /// The samples, one per grid point.
    pub samples: Vec<Sample>,
    /// Samples for which nothing was received.
    pub missing: usize,
    /// Samples for which voltage, frequency, P or Q was not received, but something was.
    pub incomplete: usize,
}
