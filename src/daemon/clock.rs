//! The real clock: the only place that reads it.

use std::{
    sync::OnceLock,
    time::{Duration, Instant, SystemTime, UNIX_EPOCH},
};

struct Anchor {
    utc_ns: i64,
    at: Instant,
}

static ANCHOR: OnceLock<Anchor> = OnceLock::new();

/// UTC, nanoseconds since 1970: the system's time when the process started plus what has passed
/// since on the monotonic clock. It never goes back, and a step of the system clock neither
/// cancels a fit nor ends a stream.
#[must_use]
pub fn now_ns() -> i64 {
    let anchor = ANCHOR.get_or_init(Anchor::now);
    anchor
        .utc_ns
        .saturating_add(nanoseconds(anchor.at.elapsed()))
}

/// A point on the monotonic clock, for measuring how long something takes.
#[must_use]
#[allow(
    clippy::disallowed_methods,
    reason = "the one place that may read the clock"
)]
pub fn instant() -> Instant {
    Instant::now()
}

/// A duration in nanoseconds; the longest one for more than 292 years.
#[must_use]
pub fn nanoseconds(duration: Duration) -> i64 {
    i64::try_from(duration.as_nanos()).unwrap_or(i64::MAX)
}

/// Nanoseconds as a duration; zero for a negative number.
#[must_use]
pub fn duration(nanoseconds: i64) -> Duration {
    Duration::from_nanos(u64::try_from(nanoseconds).unwrap_or(0))
}

impl Anchor {
    #[allow(
        clippy::disallowed_methods,
        reason = "the one place that may read the clock"
    )]
    fn now() -> Self {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        Self {
            utc_ns: since_1970.map_or(0, nanoseconds),
            at: Instant::now(),
        }
    }
}
