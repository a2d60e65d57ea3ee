//! Time of the benches.

use rustix::time::{ClockId, Timespec, clock_gettime};

/// Seconds this thread has spent on a core: what a busy machine does not distort.
pub fn cpu_seconds() -> f64 {
    seconds(clock_gettime(ClockId::ThreadCPUTime))
}

/// Seconds since some instant.
#[allow(dead_code, reason = "not every bench has threads to compare")]
pub fn wall_seconds() -> f64 {
    seconds(clock_gettime(ClockId::Monotonic))
}

fn seconds(time: Timespec) -> f64 {
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}
