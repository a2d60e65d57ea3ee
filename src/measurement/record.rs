//! A run of samples on one time grid.

use super::{Quality, Sample};

/// Nanoseconds in a second.
pub const NANOSECONDS_PER_SECOND: f64 = 1e9;

/// Samples on a uniform time grid; an instant without data holds [`Sample::missing`].
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// Time of the first sample, UTC nanoseconds.
    pub start_ns: i64,
    /// Samples per second.
    pub rate_fps: f64,
    /// Nominal frequency, Hz.
    pub nominal_hz: f64,
    /// The samples, `start_ns + k / rate_fps`.
    pub samples: Vec<Sample>,
}

impl Record {
    /// Time of grid point `index`, UTC nanoseconds, rounded to the nearest.
    #[must_use]
    pub fn time_ns(&self, index: usize) -> i64 {
        self.start_ns + grid_offset_ns(index as f64, self.rate_fps)
    }

    /// Seconds from the first sample to the last.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.samples.len().saturating_sub(1) as f64 / self.rate_fps
    }

    /// Whether every usable sample carries a voltage angle.
    #[must_use]
    pub fn has_angle(&self) -> bool {
        self.samples
            .iter()
            .filter(|s| s.usable())
            .all(|s| s.angle_rad.is_finite())
    }

    /// Share of grid points whose sample may be used, 0 to 1.
    #[must_use]
    pub fn usable_share(&self) -> f64 {
        if self.samples.is_empty() {
            return 0.0;
        }
        let usable = self.samples.iter().filter(|s| s.usable()).count();
        usable as f64 / self.samples.len() as f64
    }

    /// Lowest usable voltage, pu; NaN when no sample is usable.
    #[must_use]
    pub fn lowest_voltage_pu(&self) -> f64 {
        self.samples
            .iter()
            .filter(|s| s.usable())
            .map(|s| s.voltage_pu)
            .fold(f64::NAN, f64::min)
    }

    /// How many samples carry all flags of `flag`.
    #[must_use]
    pub fn count_flagged(&self, flag: Quality) -> usize {
        self.samples
            .iter()
            .filter(|s| s.quality.contains(flag))
            .count()
    }
}

/// Nanoseconds from a grid's origin to point `index`, rounded to the nearest.
#[must_use]
#[allow(
    clippy::cast_possible_truncation,
    reason = "a record spans seconds to hours, far inside the range of i64 nanoseconds"
)]
pub fn grid_offset_ns(index: f64, rate_fps: f64) -> i64 {
    (index / rate_fps * NANOSECONDS_PER_SECOND).round() as i64
}
