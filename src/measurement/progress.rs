//! How far a site's measurements have come.

/// The newest instant of a site's measurements. Kept on durable storage, so that the next run of the
/// service knows which instants passed while there was none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Time of the newest sample, UTC nanoseconds.
    pub newest_ns: i64,
    /// Samples per second.
    pub rate_fps: f64,
}

impl Progress {
    /// Instants between the newest one and `start_ns`, both not counted; 0 when that is not later.
    #[must_use]
    pub fn instants_before(self, start_ns: i64) -> u64 {
        let gap_s = start_ns.saturating_sub(self.newest_ns) as f64 / 1e9;
        let periods = (gap_s * self.rate_fps).round();
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at least 0, and times within two centuries at 10 000 per second stay far below 2^53"
        )]
        let instants = (periods - 1.0).max(0.0) as u64;
        instants
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_between_two_samples_are_counted() {
        let progress = Progress {
            newest_ns: 1_000_000_000,
            rate_fps: 50.0,
        };
        let after = |ns: i64| progress.instants_before(1_000_000_000 + ns);
        assert_eq!(after(20_000_000), 0, "the next one");
        assert_eq!(after(1_000_000_000), 49);
        assert_eq!(after(61_000_000), 2, "stamps may be off by a little");
        assert_eq!((after(0), after(-5_000_000_000)), (0, 0));
    }
}
