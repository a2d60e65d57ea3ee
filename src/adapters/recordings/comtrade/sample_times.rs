//! Rows as read from the data part, and when each sample was taken.

use super::{
    configuration::{Configuration, Rate},
    error::Error,
    recording::{Note, Segment},
};

/// How far the median stamp interval may be from the declared one before the stamps are not
/// believed. Recorders drift by 0.05 %; those that stamp in another unit are off by factors.
const STAMP_RATIO_TOLERANCE: f64 = 0.05;
/// An interval this much longer than declared is a gap.
const GAP_FACTOR: f64 = 1.5;
/// How far a stamp interval across a change of rate may be from the declared one before the stamp
/// is taken instead. Editions and recorders disagree on which rate that one interval has.
const BOUNDARY_TOLERANCE: f64 = 0.1;
/// Binary stamps are 32-bit counters; nanosecond stamps wrap every 4.3 s.
const STAMP_WRAP: f64 = 4_294_967_296.0;

/// Sample number and time stamp as read.
#[derive(Clone, Copy, Debug)]
pub(super) struct RawTime {
    pub(super) number: i64,
    /// In units of [`Configuration::stamp_unit_s`].
    pub(super) stamp: Option<f64>,
}

/// State of one contact over the rows.
#[derive(Clone, Debug, Default)]
pub(super) struct Track {
    pub(super) initial: bool,
    pub(super) changes: Vec<usize>,
    last: Option<bool>,
}

impl Track {
    pub(super) fn push(&mut self, index: usize, state: bool) {
        match self.last {
            None => self.initial = state,
            Some(last) if last != state => self.changes.push(index),
            Some(_) => {}
        }
        self.last = Some(state);
    }
}

/// The data part, column by column.
#[derive(Clone, Debug)]
pub(super) struct Rows {
    pub(super) times: Vec<RawTime>,
    pub(super) analog: Vec<Vec<f64>>,
    pub(super) digital: Vec<Track>,
    /// Digital values that are neither 0 nor 1.
    pub(super) odd_states: usize,
    pub(super) more_than_declared: bool,
    /// Blank lines between samples that were skipped.
    pub(super) blank_lines: usize,
}

impl Rows {
    pub(super) fn new(configuration: &Configuration, rows: usize) -> Self {
        Self {
            times: Vec::with_capacity(rows),
            analog: vec![Vec::with_capacity(rows); configuration.analog.len()],
            digital: vec![Track::default(); configuration.digital.len()],
            odd_states: 0,
            more_than_declared: false,
            blank_lines: 0,
        }
    }

    /// Undoes the wrap-around of 32-bit stamps: a fall by more than half the range.
    pub(super) fn unwrap_stamps(&mut self) {
        let (mut previous, mut wraps) = (0.0, 0.0);
        for stamp in self.times.iter_mut().filter_map(|time| time.stamp.as_mut()) {
            let raw = *stamp;
            if previous - raw > 0.5 * STAMP_WRAP {
                wraps += STAMP_WRAP;
            }
            previous = raw;
            *stamp = raw + wraps;
        }
    }
}

/// Time of each sample after the first, seconds, and the runs of constant rate.
pub(super) fn sample_times(
    configuration: &Configuration,
    times: &[RawTime],
    notes: &mut Vec<Note>,
) -> Result<(Vec<f64>, Vec<Segment>), Error> {
    let unit_s = configuration.stamp_unit_s();
    let stamped = configuration.rates.iter().any(|rate| rate.rate_hz <= 0.0);
    let time_s = if stamped {
        by_stamps(times, unit_s)?
    } else {
        by_rates(&configuration.rates, times, unit_s, notes)
    };
    let segments = segments(&configuration.rates, &time_s);
    Ok((time_s, segments))
}

/// No declared rate: the stamps are the times.
fn by_stamps(times: &[RawTime], unit_s: f64) -> Result<Vec<f64>, Error> {
    let mut time_s: Vec<f64> = Vec::with_capacity(times.len());
    let mut origin = 0.0;
    for (index, time) in times.iter().enumerate() {
        let row = index + 1;
        let stamp = time.stamp.ok_or(Error::NoTime { row })?;
        if index == 0 {
            origin = stamp;
        }
        let seconds = (stamp - origin) * unit_s;
        if time_s.last().is_some_and(|&previous| seconds <= previous) {
            return Err(Error::TimeNotIncreasing { row });
        }
        time_s.push(seconds);
    }
    Ok(time_s)
}

/// Declared rates: a sample follows the one before it by one over the rate of the latter. Stamps
/// that agree with the rates tell of gaps; without them, jumps of the sample number do.
fn by_rates(rates: &[Rate], times: &[RawTime], unit_s: f64, notes: &mut Vec<Note>) -> Vec<f64> {
    let intervals = declared_intervals(rates, times.len());
    let stamps = believed_stamps(&intervals, times, unit_s, notes);
    let numbers = if stamps.is_none() {
        increasing_numbers(times)
    } else {
        None
    };
    let times_unit = if stamps.is_some() {
        stamp_step(times) * unit_s
    } else {
        0.0
    };
    let mut now_s = 0.0;
    let mut time_s = vec![0.0; times.len()];
    for index in 1..times.len() {
        let declared = intervals[index - 1];
        let at_boundary = index > 1 && intervals[index - 2].to_bits() != declared.to_bits()
            || rates.binary_search_by_key(&index, |rate| rate.last).is_ok();
        let measured = match (&stamps, &numbers) {
            (Some(stamps), _) => stamps[index] - stamps[index - 1],
            (None, Some(numbers)) => (numbers[index] - numbers[index - 1]) * declared,
            (None, None) => declared,
        };
        let differs = (measured - declared).abs() > BOUNDARY_TOLERANCE * declared;
        let gap = measured > GAP_FACTOR * declared + resolution_s(times_unit, declared);
        if gap {
            notes.push(Note::Gap {
                sample: index,
                seconds: measured - declared,
            });
        }
        let take = measured > 0.0 && (gap || (at_boundary && differs && stamps.is_some()));
        now_s += if take { measured } else { declared };
        time_s[index] = now_s;
    }
    time_s
}

/// Interval after each sample, seconds.
fn declared_intervals(rates: &[Rate], samples: usize) -> Vec<f64> {
    let mut segment = 0;
    (1..=samples)
        .map(|number| {
            while segment + 1 < rates.len() && number > rates[segment].last {
                segment += 1;
            }
            1.0 / rates[segment].rate_hz
        })
        .collect()
}

/// The stamps in seconds, if all are there and most of their intervals are as declared.
fn believed_stamps(
    intervals: &[f64],
    times: &[RawTime],
    unit_s: f64,
    notes: &mut Vec<Note>,
) -> Option<Vec<f64>> {
    let stamps: Option<Vec<f64>> = times.iter().map(|t| Some(t.stamp? * unit_s)).collect();
    let stamps = stamps?;
    let mut ratios: Vec<f64> = stamps
        .windows(2)
        .zip(intervals)
        .map(|(pair, interval)| (pair[1] - pair[0]) / interval)
        .collect();
    if ratios.is_empty() {
        return None;
    }
    let middle = ratios.len() / 2;
    let (_, ratio, _) = ratios.select_nth_unstable_by(middle, f64::total_cmp);
    let ratio = *ratio;
    if (ratio - 1.0).abs() <= STAMP_RATIO_TOLERANCE {
        return Some(stamps);
    }
    notes.push(Note::StampsDisagree { ratio });
    None
}

/// Largest power of ten that divides every stamp: recorders write milliseconds as microseconds.
fn stamp_step(times: &[RawTime]) -> f64 {
    const STEP_MAX: f64 = 1e7;
    let divides = |step: f64| {
        let mut stamps = times.iter().filter_map(|time| time.stamp);
        stamps.all(|stamp| (stamp / step).fract().abs() < f64::EPSILON)
    };
    let mut step = 1.0;
    while step < STEP_MAX && divides(10.0 * step) {
        step *= 10.0;
    }
    step
}

/// By how much stamps in steps of `step_s` may differ from an interval without a gap: nothing when
/// the interval is a whole number of steps, else one step.
fn resolution_s(step_s: f64, interval_s: f64) -> f64 {
    let steps = interval_s / step_s;
    let whole = step_s <= 0.0 || (steps - steps.round()).abs() < 1e-6 * steps;
    if whole { 0.0 } else { step_s }
}

/// The sample numbers, if they increase from row to row.
fn increasing_numbers(times: &[RawTime]) -> Option<Vec<f64>> {
    let increasing = times.windows(2).all(|pair| pair[1].number > pair[0].number);
    increasing.then(|| times.iter().map(|time| time.number as f64).collect())
}

/// The declared runs, cut to the samples that are there and without the empty ones.
fn segments(rates: &[Rate], time_s: &[f64]) -> Vec<Segment> {
    let mut first = 0;
    let mut segments = Vec::new();
    for rate in rates {
        let end = rate.last.min(time_s.len());
        if end <= first {
            continue;
        }
        let seconds = time_s[end - 1] - time_s[first];
        let mean_hz = (end - first - 1) as f64 / seconds;
        let rate_hz = if rate.rate_hz > 0.0 {
            rate.rate_hz
        } else {
            mean_hz
        };
        segments.push(Segment {
            first,
            len: end - first,
            rate_hz: if rate_hz.is_finite() { rate_hz } else { 0.0 },
        });
        first = end;
    }
    segments
}
