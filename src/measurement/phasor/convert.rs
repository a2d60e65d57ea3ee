//! Waveforms -> per-unit records on a uniform grid.

use std::f64::consts::{PI, TAU};

use thiserror::Error as ThisError;

use super::{
    filter::off_nominal_gain,
    sequence::{self, SequencePhasors, Waveforms},
};
use crate::measurement::{Quality, Record, Sample, Site, record::grid_offset_ns};

/// Longest record, grid points: an hour and a half at 200 phasors per second.
const GRID_POINTS_MAX: f64 = 1_000_000.0;
/// A sampling interval this much longer than the one before it ends a piece. Frequency-tracking
/// recorders change by a few percent from one interval to the next.
const BREAK_FACTOR: f64 = 1.5;
/// Below this voltage the angle is noise and no frequency is given. Chosen: a tenth of the lowest
/// voltage at which a load still tells something.
const FREQUENCY_VOLTAGE_MIN_PU: f64 = 0.005;
/// Largest deviation from nominal that the gain correction follows, Hz. Beyond it the angle's rate
/// is a fault edge, not a frequency.
const CORRECTED_DEVIATION_MAX_HZ: f64 = 5.0;

/// How records are made from waveforms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Phasors per nominal cycle. Default 4; admissible 0.1 to 100.
    pub phasors_per_cycle: f64,
    /// Pieces sampled more slowly than this many samples per nominal cycle are no waveforms
    /// (recorders decimate or store effective values between triggers). Default 8; at least 4.
    pub samples_per_cycle_min: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            phasors_per_cycle: 4.0,
            samples_per_cycle_min: 8.0,
        }
    }
}

/// Why waveforms cannot become records.
#[derive(Clone, Debug, PartialEq, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// A setting or base is out of range.
    #[error("{what} is {value}, must be {range}")]
    OutOfRange {
        /// The quantity.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The admissible range.
        range: &'static str,
    },
    /// Channels and times differ in length.
    #[error("{channel} has {found} samples, the time axis {expected}")]
    Length {
        /// The channel.
        channel: &'static str,
        /// Its length.
        found: usize,
        /// The length of the time axis.
        expected: usize,
    },
    /// No piece is sampled fast and long enough.
    #[error(
        "no piece of one cycle or more is sampled at {required} samples per cycle or faster; the \
         fastest has {fastest:.1}"
    )]
    NoWaveform {
        /// Least samples per cycle.
        required: f64,
        /// Samples per cycle of the fastest interval.
        fastest: f64,
    },
    /// The recording spans more grid points than a record may have.
    #[error("the recording spans {points:.0} phasors, more than {limit:.0}")]
    TooLong {
        /// Grid points.
        points: f64,
        /// Most accepted.
        limit: f64,
    },
}

/// One record per contiguous piece of usable waveform, in order of time. All lie on the one grid
/// `start_ns + k / rate`, `rate` = nominal frequency times phasors per cycle.
///
/// Frequency is the central difference of the positive-sequence angle over one cycle (one-sided
/// over half a cycle at the ends of a piece); magnitudes are divided by the filter's gain at that
/// frequency. Angles are continuous within a piece. A window over a missing sample gives a sample
/// marked `NOT_FINITE`.
///
/// # Errors
/// A setting is out of range, lengths differ, nothing is sampled fast enough, or the span is
/// absurd: see [`Error`].
pub fn records(
    waveforms: &Waveforms,
    site: &Site,
    settings: &Settings,
) -> Result<Vec<Record>, Error> {
    check(waveforms, site, settings)?;
    let rate_fps = waveforms.nominal_hz * settings.phasors_per_cycle;
    let span_s = waveforms.time_s.last().copied().unwrap_or(0.0);
    let points = span_s * rate_fps;
    if points > GRID_POINTS_MAX {
        return Err(Error::TooLong {
            points,
            limit: GRID_POINTS_MAX,
        });
    }
    let pieces = pieces(&waveforms.time_s, waveforms.nominal_hz, settings);
    let records: Vec<Record> = pieces
        .iter()
        .filter_map(|&(first, end)| piece_record(waveforms, site, rate_fps, first, end))
        .collect();
    if records.is_empty() {
        return Err(no_waveform(waveforms, settings));
    }
    Ok(records)
}

/// One record over all pieces, with missing samples between them. The pieces must come from one
/// call of [`records`]; none for none.
#[must_use]
pub fn join(records: &[Record]) -> Option<Record> {
    let mut joined = records.first()?.clone();
    for record in &records[1..] {
        let end_ns = |joined: &Record| joined.time_ns(joined.samples.len());
        let half_ns = grid_offset_ns(0.5, joined.rate_fps);
        while end_ns(&joined) + half_ns < record.start_ns {
            let time_ns = end_ns(&joined);
            joined.samples.push(Sample::missing(time_ns));
        }
        joined.samples.extend(&record.samples);
    }
    for index in 0..joined.samples.len() {
        joined.samples[index].time_ns = joined.time_ns(index);
    }
    Some(joined)
}

/// The phasors at the given times (seconds), frequency-corrected as in [`records`], with the
/// frequency in Hz; none where no contiguous piece covers the window.
#[must_use]
pub fn sequences_at(
    waveforms: &Waveforms,
    settings: &Settings,
    times_s: &[f64],
) -> Vec<Option<(SequencePhasors, f64)>> {
    let pieces = pieces(&waveforms.time_s, waveforms.nominal_hz, settings);
    times_s
        .iter()
        .map(|&time_s| {
            pieces
                .iter()
                .find_map(|&(first, end)| corrected(waveforms, first, end, time_s))
        })
        .collect()
}

fn check(waveforms: &Waveforms, site: &Site, settings: &Settings) -> Result<(), Error> {
    let range = |what, value: f64, low: f64, high: f64, range| {
        if value >= low && value <= high {
            return Ok(());
        }
        Err(Error::OutOfRange { what, value, range })
    };
    let nominal_hz = waveforms.nominal_hz;
    range("nominal frequency", nominal_hz, 10.0, 100.0, "10 to 100 Hz")?;
    let per_cycle = settings.phasors_per_cycle;
    range("phasors per cycle", per_cycle, 0.1, 100.0, "0.1 to 100")?;
    let least = settings.samples_per_cycle_min;
    range("samples per cycle", least, 4.0, 1e6, "4 or more")?;
    range("power base", site.s_base_mva, 1e-9, 1e9, "positive")?;
    range("voltage base", site.v_base_kv, 1e-9, 1e9, "positive")?;
    let expected = waveforms.time_s.len();
    let voltages = waveforms.voltage_v.iter().map(|v| ("a voltage", v));
    let currents = waveforms.current_a.iter().map(|i| ("a current", i));
    for (channel, values) in voltages.chain(currents) {
        if values.len() != expected {
            let found = values.len();
            return Err(Error::Length {
                channel,
                found,
                expected,
            });
        }
    }
    Ok(())
}

fn no_waveform(waveforms: &Waveforms, settings: &Settings) -> Error {
    let intervals = waveforms.time_s.windows(2).map(|pair| pair[1] - pair[0]);
    let shortest_s = intervals.fold(f64::INFINITY, f64::min);
    Error::NoWaveform {
        required: settings.samples_per_cycle_min,
        fastest: 1.0 / (waveforms.nominal_hz * shortest_s),
    }
}

/// Runs of samples without a break and fast enough, as `(first, end)`.
fn pieces(time_s: &[f64], nominal_hz: f64, settings: &Settings) -> Vec<(usize, usize)> {
    let slowest_s = (1.0 + 1e-6) / (nominal_hz * settings.samples_per_cycle_min);
    let mut pieces = Vec::new();
    let (mut first, mut previous_s) = (0, f64::INFINITY);
    for index in 1..=time_s.len() {
        let interval_s = time_s.get(index).map(|now| now - time_s[index - 1]);
        let goes_on =
            interval_s.is_some_and(|s| s > 0.0 && s <= slowest_s && s <= BREAK_FACTOR * previous_s);
        if goes_on {
            previous_s = interval_s.unwrap_or(previous_s);
            continue;
        }
        if (time_s[index - 1] - time_s[first]) * nominal_hz > 0.5 {
            pieces.push((first, index));
        }
        first = index;
        previous_s = f64::INFINITY;
    }
    pieces
}

fn piece_record(
    waveforms: &Waveforms,
    site: &Site,
    rate_fps: f64,
    first: usize,
    end: usize,
) -> Option<Record> {
    let grid = grid_indices(waveforms.time_s[first], waveforms.time_s[end - 1], rate_fps);
    let mut samples: Vec<Sample> = Vec::new();
    let mut start_ns = 0;
    for index in grid {
        let Some((phasors, frequency_hz)) = corrected(waveforms, first, end, index / rate_fps)
        else {
            if samples.is_empty() {
                continue;
            }
            break;
        };
        let time_ns = waveforms.start_ns + grid_offset_ns(index, rate_fps);
        if samples.is_empty() {
            start_ns = time_ns;
        }
        let previous = samples.last().map(|s: &Sample| s.angle_rad);
        let sample = per_unit(&phasors, frequency_hz, site, time_ns, previous);
        samples.push(sample);
    }
    (!samples.is_empty()).then_some(Record {
        start_ns,
        rate_fps,
        nominal_hz: waveforms.nominal_hz,
        samples,
    })
}

/// Grid indices from just before the first time to just after the last.
fn grid_indices(first_s: f64, last_s: f64, rate_fps: f64) -> impl Iterator<Item = f64> {
    let (from, to) = ((first_s * rate_fps).floor(), (last_s * rate_fps).ceil());
    std::iter::successors(Some(from), |k| Some(k + 1.0)).take_while(move |&k| k <= to)
}

/// Phasors and frequency at `time_s`, corrected for the filter's gain off nominal frequency.
fn corrected(
    waveforms: &Waveforms,
    first: usize,
    end: usize,
    time_s: f64,
) -> Option<(SequencePhasors, f64)> {
    let at = |time_s| sequence::at(waveforms, first, end, time_s);
    let here = at(time_s)?;
    let half_s = 0.5 / waveforms.nominal_hz;
    let before = at(time_s - half_s).unwrap_or(here);
    let after = at(time_s + half_s).unwrap_or(here);
    let turned = (after.v1 * before.v1.conjugate()).angle_rad();
    let deviation_hz = turned / TAU / (after.time_s - before.time_s);
    let gain = if deviation_hz.abs() <= CORRECTED_DEVIATION_MAX_HZ {
        off_nominal_gain(deviation_hz, waveforms.nominal_hz)
    } else {
        1.0
    };
    let frequency_hz = waveforms.nominal_hz + deviation_hz;
    Some((here.scaled(1.0 / gain), frequency_hz))
}

fn per_unit(
    phasors: &SequencePhasors,
    frequency_hz: f64,
    site: &Site,
    time_ns: i64,
    previous_angle_rad: Option<f64>,
) -> Sample {
    let phase_base_v = site.v_base_kv * 1e3 / 3.0_f64.sqrt();
    let power = phasors.power_va().scale(1e-6 / site.s_base_mva);
    let voltage_pu = phasors.v1.magnitude() / phase_base_v;
    let known = voltage_pu >= FREQUENCY_VOLTAGE_MIN_PU;
    let angle_rad = phasors.v1.angle_rad();
    let mut sample = Sample {
        time_ns,
        voltage_pu,
        angle_rad: continued(angle_rad, previous_angle_rad),
        frequency_hz: if known { frequency_hz } else { f64::NAN },
        active_pu: power.re,
        reactive_pu: power.im,
        negative_sequence_ratio: phasors.v2.magnitude() / phasors.v1.magnitude(),
        quality: Quality::GOOD,
    };
    if !sample.usable() {
        sample.quality = Quality::NOT_FINITE;
    }
    sample
}

/// `angle_rad` plus the number of turns that brings it nearest to the angle before it.
fn continued(angle_rad: f64, previous_rad: Option<f64>) -> f64 {
    match previous_rad {
        Some(previous) if previous.is_finite() => {
            let turns = ((previous - angle_rad + PI) / TAU).floor();
            angle_rad + turns * TAU
        }
        _ => angle_rad,
    }
}

#[cfg(test)]
mod tests;
