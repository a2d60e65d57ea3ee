//! The time grid: which instants there are, and which of them a sample belongs to.

const SECOND_NS: i64 = 1_000_000_000;

/// Distance from a fraction of the whole UTC second up to which a grid is laid on it exactly: C37.118
/// streams sample there, and their time stamps are rounded to a microsecond or so. Chosen; far
/// above rounding, far below any sampling period.
const SNAP_NS: i64 = 10_000;

/// Relative difference up to which two rates are the same: a period written in nanoseconds or
/// microseconds gives 59.9988 to 60.0012 for 60.
const RATE_TOLERANCE: f64 = 3e-5;

/// Equidistant instants. At a whole number of samples per second the grid repeats every UTC second,
/// so that its times do not depend on when it was started.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    rate_fps: f64,
    /// The rate when it is a whole number.
    per_second: Option<i64>,
    /// Time of index 0: within the first second of 1970 at a whole rate, else of the first sample.
    origin_ns: i64,
}

impl Grid {
    /// The grid on which `first_ns` lies.
    pub(super) fn through(first_ns: i64, rate_fps: f64) -> Self {
        let rate_fps = whole_if_close(rate_fps);
        let per_second = whole(rate_fps);
        let origin_ns = if per_second.is_none() {
            first_ns
        } else {
            let at_second = Self {
                rate_fps,
                per_second,
                origin_ns: 0,
            };
            let phase_ns = first_ns - at_second.time_ns(at_second.nearest(first_ns));
            if phase_ns.abs() <= SNAP_NS {
                0
            } else {
                phase_ns
            }
        };
        Self {
            rate_fps,
            per_second,
            origin_ns,
        }
    }

    pub(super) const fn rate_fps(&self) -> f64 {
        self.rate_fps
    }

    pub(super) fn has_rate(&self, rate_fps: f64) -> bool {
        (rate_fps / self.rate_fps - 1.0).abs() <= RATE_TOLERANCE
    }

    /// Time of a grid point, UTC nanoseconds.
    pub(super) fn time_ns(&self, index: i64) -> i64 {
        match self.per_second {
            Some(n) => {
                let within = (index.rem_euclid(n) * SECOND_NS + n / 2) / n;
                self.origin_ns + index.div_euclid(n) * SECOND_NS + within
            }
            None => self.origin_ns + round(index as f64 / self.rate_fps * 1e9),
        }
    }

    /// The grid point nearest to a time.
    pub(super) fn nearest(&self, time_ns: i64) -> i64 {
        let since_ns = time_ns - self.origin_ns;
        match self.per_second {
            Some(n) => {
                let within = since_ns.rem_euclid(SECOND_NS);
                since_ns.div_euclid(SECOND_NS) * n + (within * n + SECOND_NS / 2) / SECOND_NS
            }
            None => round(since_ns as f64 / 1e9 * self.rate_fps),
        }
    }

    /// The grid point of a sample, if one is within `tolerance_share` of a sampling period.
    pub(super) fn index_of(&self, time_ns: i64, tolerance_share: f64) -> Option<i64> {
        let index = self.nearest(time_ns);
        let distance_ns = (time_ns - self.time_ns(index)).abs();
        // Grid points are rounded to whole nanoseconds.
        let rounding_ns = 1.0;
        let within_ns = tolerance_share / self.rate_fps * 1e9 + rounding_ns;
        (distance_ns as f64 <= within_ns).then_some(index)
    }

    /// Whole sampling periods in a duration.
    pub(super) fn periods_in(&self, seconds: f64) -> i64 {
        // A duration of exactly k periods must not become k - 1 by rounding.
        round((seconds * self.rate_fps + 1e-6).floor())
    }
}

fn whole_if_close(rate_fps: f64) -> f64 {
    let nearest = rate_fps.round();
    if nearest >= 1.0 && (rate_fps / nearest - 1.0).abs() <= RATE_TOLERANCE {
        nearest
    } else {
        rate_fps
    }
}

fn whole(rate_fps: f64) -> Option<i64> {
    ((rate_fps - rate_fps.round()).abs() < f64::EPSILON).then(|| round(rate_fps))
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "times between 1970 and 2200 and indices at 10 kHz at most are inside the range of i64"
)]
fn round(value: f64) -> i64 {
    value.round() as i64
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOON_NS: i64 = 1_770_000_000 * SECOND_NS;

    #[test]
    fn a_grid_at_a_whole_rate_does_not_depend_on_where_it_starts() {
        let early = Grid::through(NOON_NS, 60.0);
        let late = Grid::through(NOON_NS + 16_666_000, 60.000_000_2);
        assert_eq!(early, late);
        let index = early.nearest(NOON_NS + 983_333_333);
        assert_eq!(early.time_ns(index), NOON_NS + 983_333_333);
        assert_eq!(early.time_ns(index + 1), NOON_NS + SECOND_NS);
    }

    #[test]
    fn a_recorder_that_samples_beside_the_second_keeps_its_own_times() {
        let first_ns = NOON_NS + 3_010_208;
        let grid = Grid::through(first_ns, 200.0);
        let index = grid.nearest(first_ns);
        assert_eq!(grid.time_ns(index), first_ns);
        assert_eq!(grid.time_ns(index + 1), first_ns + 5_000_000);
    }

    #[test]
    fn a_sample_between_two_grid_points_has_none() {
        let grid = Grid::through(NOON_NS, 50.0);
        assert!(grid.index_of(NOON_NS + 4_900_000, 0.25).is_some());
        assert!(grid.index_of(NOON_NS + 5_100_000, 0.25).is_none());
        assert!(grid.index_of(NOON_NS - 5_100_000, 0.25).is_none());
    }

    #[test]
    fn a_broken_rate_counts_from_its_first_sample() {
        let grid = Grid::through(NOON_NS, 59.94);
        assert_eq!(grid.nearest(NOON_NS), 0);
        assert_eq!(grid.time_ns(5994), NOON_NS + 100 * SECOND_NS);
        assert!(!grid.has_rate(60.0));
    }
}
