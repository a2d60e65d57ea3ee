//! Where the disturbance of a recording begins.

use crate::{
    disturbance::{Closing, Trigger, Window},
    measurement::{Record, Sample, Site},
};

/// Length of the part at the beginning that shows the undisturbed state, seconds. Recordings have
/// at least 1 s before the disturbance; half of it leaves room for late clocks.
const REFERENCE_S: f64 = 0.5;
/// Least and largest part of a record that may serve for it.
const REFERENCE_SAMPLES_MIN: usize = 8;
const REFERENCE_SHARE_MAX: f64 = 0.3;
/// Half-width of the pre-event band in standard deviations of the reference part.
const BAND_SIGMAS: f64 = 5.0;
/// Half-width of the band at least: instrument resolution and the load's own flicker.
const VOLTAGE_BAND_MIN_PU: f64 = 0.002;
const FREQUENCY_BAND_MIN_HZ: f64 = 0.01;
/// A slow departure is sought in the mean over this time, with a band this much narrower.
const SLOW_MEAN_S: f64 = 0.1;
const SLOW_BAND_SHARE: f64 = 0.5;
/// Going back from the crossing, samples belong to the departure while they are this much of the
/// band away from the centre.
const DEPARTURE_SHARE: f64 = 0.5;

/// The whole record as one window: trigger `Recording`, onset by [`onset`], or the sample furthest
/// from the median where nothing departs.
#[must_use]
pub fn window(site: &Site, record: &Record) -> Window {
    let onset = onset(record).unwrap_or_else(|| furthest(record));
    Window {
        id: format!("{}-{}", site.name, record.time_ns(onset)),
        site: site.name.clone(),
        record: record.clone(),
        onset,
        triggers: vec![Trigger::Recording],
        closing: Closing::RecordingEnded,
    }
}

/// Index of the first sample that leaves the pre-event band of voltage or frequency, by an edge
/// (two samples in a row outside, so that a lone spike is none) or slowly (the mean over 0.1 s);
/// none when nothing leaves it.
///
/// The band is the median of the first half second plus or minus five robust standard deviations,
/// at least 0.002 pu and 0.01 Hz. From the crossing the search goes back while samples are on the
/// same side by half the band, so the flank of a filtered edge belongs to the disturbance.
#[must_use]
pub fn onset(record: &Record) -> Option<usize> {
    let voltage = departure(record, |s| s.voltage_pu, VOLTAGE_BAND_MIN_PU);
    let frequency = departure(record, |s| s.frequency_hz, FREQUENCY_BAND_MIN_HZ);
    match (voltage, frequency) {
        (Some(voltage), Some(frequency)) => Some(voltage.min(frequency)),
        (one, other) => one.or(other),
    }
}

fn departure(record: &Record, value: impl Fn(&Sample) -> f64, least: f64) -> Option<usize> {
    let usable: Vec<(usize, f64)> = record
        .samples
        .iter()
        .enumerate()
        .filter(|(_, sample)| sample.usable())
        .map(|(index, sample)| (index, value(sample)))
        .collect();
    let reference = reference_length(usable.len(), record.rate_fps);
    let (centre, sigma) = robust(usable.get(..reference)?)?;
    let band = least.max(BAND_SIGMAS * sigma);
    let off: Vec<f64> = usable.iter().map(|(_, value)| value - centre).collect();
    let outside = |k: usize| off.get(k).is_some_and(|d| d.abs() > band);
    let edge = (0..off.len()).find(|&k| outside(k) && outside(k + 1));
    let slow = slow_departure(&off, record.rate_fps, band);
    let crossing = match (edge, slow) {
        (Some(edge), Some(slow)) => edge.min(slow),
        (one, other) => one.or(other)?,
    };
    let side = off[crossing].signum();
    let first = (0..crossing)
        .rev()
        .take_while(|&k| off[k] * side > DEPARTURE_SHARE * band)
        .last()
        .unwrap_or(crossing);
    Some(usable[first].0)
}

/// Number of samples at the beginning that serve as the undisturbed state.
fn reference_length(usable: usize, rate_fps: f64) -> usize {
    let wanted = count(REFERENCE_S * rate_fps);
    let most = count(REFERENCE_SHARE_MAX * usable as f64);
    wanted.min(most).max(REFERENCE_SAMPLES_MIN)
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "sample counts: not negative, far below the range of usize"
)]
fn count(samples: f64) -> usize {
    samples.round() as usize
}

/// Median and standard deviation (from the median absolute deviation).
fn robust(values: &[(usize, f64)]) -> Option<(f64, f64)> {
    /// Ratio of standard deviation to median absolute deviation of a normal distribution.
    const MAD_TO_SIGMA: f64 = 1.4826;
    let mut sorted: Vec<f64> = values.iter().map(|(_, value)| *value).collect();
    let centre = median(&mut sorted)?;
    let mut deviations: Vec<f64> = sorted.iter().map(|value| (value - centre).abs()).collect();
    Some((centre, MAD_TO_SIGMA * median(&mut deviations)?))
}

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// First sample at which the mean over the last 0.1 s is outside the narrower band.
fn slow_departure(off: &[f64], rate_fps: f64, band: f64) -> Option<usize> {
    let length = count(SLOW_MEAN_S * rate_fps).max(3);
    let mut sum = 0.0;
    let mut run = 0;
    for (k, value) in off.iter().enumerate() {
        // A lone spike must not move the mean by more than its share of the band.
        let limited = |value: f64| value.clamp(-2.0 * band, 2.0 * band);
        sum += limited(*value);
        if k >= length {
            sum -= limited(off[k - length]);
        }
        let mean = sum / length.min(k + 1) as f64;
        run = if k + 1 >= length && mean.abs() > SLOW_BAND_SHARE * band {
            run + 1
        } else {
            0
        };
        if run >= length.div_ceil(2) {
            return Some(k + 1 - run);
        }
    }
    None
}

/// The usable sample whose voltage is furthest from the median; 0 when none is usable.
fn furthest(record: &Record) -> usize {
    let usable = || {
        record
            .samples
            .iter()
            .enumerate()
            .filter(|(_, s)| s.usable())
    };
    let mut voltages: Vec<f64> = usable().map(|(_, s)| s.voltage_pu).collect();
    let centre = median(&mut voltages).unwrap_or(0.0);
    usable()
        .map(|(index, s)| (index, (s.voltage_pu - centre).abs()))
        .max_by(|x, y| x.1.total_cmp(&y.1).then(y.0.cmp(&x.0)))
        .map_or(0, |(index, _)| index)
}
