//! Time stamps and rates of a recording that is written.

use super::{recording::Recording, write::WriteError};

/// Stamps are unsigned 32-bit counters whose last value stands for "none".
const STAMP_MAX: f64 = 4_294_967_294.0;
/// Longest multiplier tried, microseconds per tick: recordings of 136 years.
const MULTIPLIER_MAX: f64 = 1e6;
const MICROSECOND_S: f64 = 1e-6;
/// How far a sample may be from its place by the declared rate, in sampling intervals, for the
/// rate to be declared. Rounding of the times in a recording is far below.
const RATE_TOLERANCE: f64 = 1e-3;

/// When each sample was taken, as COMTRADE writes it.
#[derive(Clone, Debug)]
pub(super) struct Ticks {
    /// `timemult`: microseconds per tick.
    pub(super) multiplier: f64,
    /// Ticks after the first sample.
    pub(super) stamps: Vec<u32>,
    /// `nrates`: 0 when only the stamps tell.
    pub(super) declared_rates: usize,
    /// `samp,endsamp`.
    pub(super) rates: Vec<(f64, usize)>,
}

/// The finest ticks that can hold the recording's length, and its rates if they explain all times.
pub(super) fn ticks(recording: &Recording) -> Result<Ticks, WriteError> {
    let duration_s = recording.duration_s();
    let mut multiplier = 1e-3;
    while duration_s / (multiplier * MICROSECOND_S) > STAMP_MAX && multiplier < MULTIPLIER_MAX {
        multiplier *= 10.0;
    }
    let tick_s = multiplier * MICROSECOND_S;
    let mut stamps: Vec<u32> = Vec::with_capacity(recording.len());
    for (index, &seconds) in recording.time_s.iter().enumerate() {
        let late = || WriteError::Time {
            sample: index + 1,
            seconds,
        };
        let tick = (seconds / tick_s).round();
        if !(0.0..=STAMP_MAX).contains(&tick) {
            return Err(late());
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the range was checked"
        )]
        let tick = tick as u32;
        if stamps.last().is_some_and(|&previous| tick <= previous) {
            return Err(late());
        }
        stamps.push(tick);
    }
    let rates: Vec<(f64, usize)> = recording
        .segments
        .iter()
        .map(|segment| (segment.rate_hz, segment.first + segment.len))
        .collect();
    let explained = rates_explain(&rates, &recording.time_s);
    Ok(Ticks {
        multiplier,
        stamps,
        declared_rates: if explained { rates.len() } else { 0 },
        rates: if explained {
            rates
        } else {
            vec![(0.0, recording.len())]
        },
    })
}

/// Whether every sample follows the one before it by one over the rate of the latter.
fn rates_explain(rates: &[(f64, usize)], time_s: &[f64]) -> bool {
    let complete = rates.last().is_some_and(|&(_, last)| last == time_s.len());
    let mut rates = rates.iter();
    let mut current = rates.next().copied();
    let follows = time_s.windows(2).enumerate().all(|(index, pair)| {
        while current.is_some_and(|(_, last)| index + 1 > last) {
            current = rates.next().copied();
        }
        current.is_some_and(|(rate_hz, _)| {
            rate_hz > 0.0 && ((pair[1] - pair[0]) * rate_hz - 1.0).abs() < RATE_TOLERANCE
        })
    });
    complete && follows
}
