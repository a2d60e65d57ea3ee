//! Talking to systemd: ready, stopping, alive. Without systemd nothing happens.

use std::time::{Duration, Instant};

use sd_notify::NotifyState;

use super::clock;

/// Tells systemd how the service is doing.
#[derive(Debug)]
pub(super) struct Supervisor {
    watchdog: Option<Watchdog>,
}

#[derive(Debug)]
struct Watchdog {
    period: Duration,
    fed: Instant,
}

impl Supervisor {
    /// Looks whether systemd waits for signs of life.
    pub(super) fn new() -> Self {
        let mut usec = 0;
        let enabled = sd_notify::watchdog_enabled(false, &mut usec);
        let watchdog = enabled.then(|| Watchdog {
            period: Duration::from_micros(usec / 3),
            fed: clock::instant(),
        });
        Self { watchdog }
    }

    /// The loop has made progress: feeds the watchdog three times per period.
    pub(super) fn alive(&mut self) {
        let Some(watchdog) = &mut self.watchdog else {
            return;
        };
        if watchdog.fed.elapsed() >= watchdog.period {
            watchdog.fed = clock::instant();
            notify(&[NotifyState::Watchdog]);
        }
    }
}

/// The service is ready.
pub(super) fn ready(status: &str) {
    notify(&[NotifyState::Ready, NotifyState::Status(status)]);
}

/// The service is stopping.
pub(super) fn stopping() {
    notify(&[NotifyState::Stopping]);
}

fn notify(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(false, states) {
        tracing::debug!(%error, "systemd was not told");
    }
}
