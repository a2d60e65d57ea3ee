//! Recordings that hold phasors instead of waveforms: an event written as COMTRADE, and read back.

use std::f64::consts::PI;

use thiserror::Error as ThisError;

use super::comtrade::{
    AnalogChannel, DataFormat, DigitalChannel, LeapSecond, Recording, Revision, Scaling, Segment,
    TimeCode,
};
use crate::measurement::{Channel, Quality, Record, Sample, Site};

/// Name and meaning of the contacts that hold the quality of each sample.
const FLAGS: [(&str, Quality); 6] = [
    ("data invalid", Quality::DATA_INVALID),
    ("clock not synchronised", Quality::NOT_SYNCHRONISED),
    ("stale", Quality::STALE),
    ("missing", Quality::MISSING),
    ("not finite", Quality::NOT_FINITE),
    ("spike", Quality::SPIKE),
];

/// The name of a channel in a recording of phasors.
#[must_use]
pub const fn channel_name(channel: Channel) -> &'static str {
    match channel {
        Channel::VoltagePu => "V1",
        Channel::AngleRad => "V1 angle",
        Channel::FrequencyHz => "f",
        Channel::ActivePu => "P",
        Channel::ReactivePu => "Q",
        Channel::NegativeSequenceRatio => "V2/V1",
    }
}

/// Why a recording is no recording of phasors of a site.
#[derive(Clone, Debug, PartialEq, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// The recording has no date.
    #[error("the recording has no date")]
    NoDate,
    /// A channel that must be there is not.
    #[error("the recording has no channel `{name}`")]
    NoChannel {
        /// Name.
        name: &'static str,
    },
    /// A unit that is none of this channel's.
    #[error("channel `{name}` is in `{unit}`, expected {expected}")]
    Unit {
        /// Channel.
        name: &'static str,
        /// Its unit.
        unit: String,
        /// Units that are read.
        expected: &'static str,
    },
    /// The recording is of another nominal frequency.
    #[error("the recording's nominal frequency is {found_hz} Hz, the site's {site_hz} Hz")]
    Nominal {
        /// The recording's, Hz.
        found_hz: f64,
        /// The site's, Hz.
        site_hz: f64,
    },
    /// More or less than one rate.
    #[error("the recording has {found} runs of constant rate, expected one without gaps")]
    Rates {
        /// How many.
        found: usize,
    },
}

/// `record` as a recording that can be written: positive-sequence V (line to line, kV) and angle
/// (deg), f (Hz), P and Q into the load (MW, Mvar), V2/V1 (%), primary values; optional channels
/// only where a sample holds them; one contact for each quality flag. Times are UTC.
#[must_use]
pub fn recording(record: &Record, site: &Site, trigger_ns: Option<i64>) -> Recording {
    let samples = &record.samples;
    let measured = |channel: &Channel| {
        !channel.optional() || samples.iter().any(|s| s.value(*channel).is_finite())
    };
    let channels = Channel::ALL.into_iter().filter(measured);
    let analog = (1..).zip(channels).map(|(number, channel)| {
        let (unit, factor) = unit_and_factor(channel, site);
        AnalogChannel {
            number,
            name: channel_name(channel).to_owned(),
            phase: String::new(),
            circuit: site.name.clone(),
            unit: unit.to_owned(),
            skew_us: 0.0,
            primary: Some(1.0),
            secondary: Some(1.0),
            scaling: Scaling::Primary,
            values: samples.iter().map(|s| factor * s.value(channel)).collect(),
        }
    });
    let digital = (1..).zip(FLAGS).map(|(number, (name, flag))| {
        let states = || samples.iter().map(|s| s.quality.contains(flag));
        let pairs = states().zip(states().skip(1)).enumerate();
        let changes = pairs.filter(|(_, (before, after))| before != after);
        DigitalChannel {
            number,
            name: name.to_owned(),
            phase: String::new(),
            circuit: site.name.clone(),
            normal: Some(false),
            initial: states().next().unwrap_or(false),
            changes: changes.map(|(index, _)| index + 1).collect(),
        }
    });
    Recording {
        station: site.name.clone(),
        recorder: "loadmodeld".to_owned(),
        revision: Revision::Y2013,
        format: DataFormat::Float32,
        code_page: "UTF-8",
        nominal_hz: Some(record.nominal_hz),
        start_ns: Some(record.start_ns),
        trigger_ns,
        time_code: Some(TimeCode {
            utc_offset_s: Some(0),
            local_offset_s: None,
            quality: None,
            leap_second: LeapSecond::Unknown,
        }),
        analog: analog.collect(),
        digital: digital.collect(),
        time_s: (0..samples.len())
            .map(|index| index as f64 / record.rate_fps)
            .collect(),
        segments: vec![Segment {
            first: 0,
            len: samples.len(),
            rate_hz: record.rate_fps,
        }],
        notes: Vec::new(),
    }
}

/// The record in a recording of phasors: channels are found by [`channel_name`], in the units
/// kV or V, deg or rad, Hz, MW, kW or W (Mvar, kvar, var), % or none, primary values. Contacts
/// with the names that [`recording`] writes set the quality; a sample without a finite V, f, P or
/// Q is marked.
///
/// # Errors
/// A channel, the date or the rate is missing, or a unit is unknown: see [`Error`].
pub fn record(recording: &Recording, site: &Site) -> Result<Record, Error> {
    const NOMINAL_TOLERANCE_HZ: f64 = 1e-6;
    let start_ns = recording.start_ns.ok_or(Error::NoDate)?;
    if let Some(found_hz) = recording.nominal_hz
        && (found_hz - site.nominal_hz).abs() > NOMINAL_TOLERANCE_HZ
    {
        let site_hz = site.nominal_hz;
        return Err(Error::Nominal { found_hz, site_hz });
    }
    let rate_fps = constant_rate(recording)?;
    let mut samples: Vec<Sample> = (0..recording.len())
        .map(|_| Sample {
            quality: Quality::GOOD,
            ..Sample::missing(0)
        })
        .collect();
    for channel in Channel::ALL {
        let name = channel_name(channel);
        let Some(found) = recording.analog.iter().find(|c| c.name == name) else {
            if channel.optional() {
                continue;
            }
            return Err(Error::NoChannel { name });
        };
        let factor = factor_from(channel, &found.unit, site)?;
        for (sample, value) in samples.iter_mut().zip(&found.values) {
            sample.set(channel, factor * value);
        }
    }
    let mut record = Record {
        start_ns,
        rate_fps,
        nominal_hz: site.nominal_hz,
        samples: Vec::new(),
    };
    for (index, sample) in samples.iter_mut().enumerate() {
        sample.time_ns = record.time_ns(index);
        for (name, flag) in FLAGS {
            let contact = recording.digital.iter().find(|c| c.name == name);
            if contact.is_some_and(|contact| contact.state(index)) {
                sample.quality = sample.quality | flag;
            }
        }
        if sample.quality.usable() && !sample.usable() {
            sample.quality = sample.quality | Quality::NOT_FINITE;
        }
    }
    record.samples = samples;
    Ok(record)
}

/// The one rate of all samples, per second.
fn constant_rate(recording: &Recording) -> Result<f64, Error> {
    /// How far a sample may be from its place, in intervals: stamps are rounded to microseconds.
    const GRID_TOLERANCE: f64 = 0.1;
    let [segment] = recording.segments.as_slice() else {
        let found = recording.segments.len();
        return Err(Error::Rates { found });
    };
    let rate_fps = segment.rate_hz;
    let mut places = recording.time_s.iter().enumerate();
    let on_grid = places.all(|(index, t)| (t * rate_fps - index as f64).abs() < GRID_TOLERANCE);
    if rate_fps > 0.0 && on_grid {
        Ok(rate_fps)
    } else {
        Err(Error::Rates { found: 0 })
    }
}

/// Unit in a recording, and what a value of the domain is multiplied by to be in it.
fn unit_and_factor(channel: Channel, site: &Site) -> (&'static str, f64) {
    match channel {
        Channel::VoltagePu => ("kV", site.v_base_kv),
        Channel::AngleRad => ("deg", 180.0 / PI),
        Channel::FrequencyHz => ("Hz", 1.0),
        Channel::ActivePu => ("MW", site.s_base_mva),
        Channel::ReactivePu => ("Mvar", site.s_base_mva),
        Channel::NegativeSequenceRatio => ("%", 100.0),
    }
}

/// What a value of a recording in `unit` is multiplied by to be in the domain's unit.
fn factor_from(channel: Channel, unit: &str, site: &Site) -> Result<f64, Error> {
    let lower = unit.trim().to_lowercase();
    let (factor, expected) = match channel {
        Channel::VoltagePu => match lower.as_str() {
            "kv" => (Some(1.0 / site.v_base_kv), ""),
            "v" => (Some(1e-3 / site.v_base_kv), ""),
            _ => (None, "V or kV"),
        },
        Channel::AngleRad => match lower.as_str() {
            "deg" | "\u{b0}" => (Some(PI / 180.0), ""),
            "rad" => (Some(1.0), ""),
            _ => (None, "deg or rad"),
        },
        Channel::FrequencyHz => ((lower == "hz").then_some(1.0), "Hz"),
        Channel::ActivePu => (power(&lower, "w", site), "W, kW or MW"),
        Channel::ReactivePu => (power(&lower, "var", site), "var, kvar or Mvar"),
        Channel::NegativeSequenceRatio => match lower.as_str() {
            "%" => (Some(0.01), ""),
            "" | "1" => (Some(1.0), ""),
            _ => (None, "% or no unit"),
        },
    };
    factor.ok_or_else(|| Error::Unit {
        name: channel_name(channel),
        unit: unit.to_owned(),
        expected,
    })
}

/// Per unit of the power base per `unit`, a prefix before `base`; none for another unit. Case does
/// not matter: no load has milliwatts.
fn power(unit: &str, base: &str, site: &Site) -> Option<f64> {
    let mega = match unit.strip_suffix(base)? {
        "" => 1e-6,
        "k" => 1e-3,
        "m" => 1.0,
        _ => return None,
    };
    Some(mega / site.s_base_mva)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::recordings::comtrade::{Options, decode_container, encode_container};

    fn site() -> Site {
        Site {
            name: "north".to_owned(),
            s_base_mva: 200.0,
            v_base_kv: 23.0,
            nominal_hz: 60.0,
        }
    }

    fn event() -> Record {
        let start_ns = 1_577_923_201_250_000_000;
        let mut record = Record {
            start_ns,
            rate_fps: 60.0,
            nominal_hz: 60.0,
            samples: Vec::new(),
        };
        for index in 0..180 {
            let dip = if (60..66).contains(&index) { 0.6 } else { 1.0 };
            record.samples.push(Sample {
                time_ns: record.time_ns(index),
                voltage_pu: dip,
                angle_rad: -0.4 + 0.01 * index as f64,
                frequency_hz: 59.98,
                active_pu: 0.8 * dip,
                reactive_pu: 0.2 * dip * dip,
                negative_sequence_ratio: f64::NAN,
                quality: if index > 100 {
                    Quality::NOT_SYNCHRONISED
                } else {
                    Quality::GOOD
                },
            });
        }
        record.samples[20] = Sample::missing(record.time_ns(20));
        record
    }

    #[test]
    fn event_is_the_same_after_writing_and_reading() {
        let event = event();
        let trigger_ns = event.time_ns(60);
        let written = recording(&event, &site(), Some(trigger_ns));
        assert_eq!(written.analog.len(), 5, "no V2/V1 was measured");
        for (format, tolerance) in [
            (DataFormat::Ascii, 2e-6),
            (DataFormat::Binary, 1e-4),
            (DataFormat::Float32, 2e-6),
        ] {
            let bytes = encode_container(&written, format).unwrap();
            let read = decode_container(&bytes, &Options::default()).unwrap();
            assert_eq!(read.trigger_ns, Some(trigger_ns));
            let found = record(&read, &site()).unwrap();
            assert_eq!(found.samples.len(), event.samples.len());
            assert_eq!(found.start_ns, event.start_ns);
            for (found, expected) in found.samples.iter().zip(&event.samples) {
                assert_eq!(
                    (found.time_ns, found.quality),
                    (expected.time_ns, expected.quality)
                );
                for channel in Channel::ALL {
                    let (x, y) = (found.value(channel), expected.value(channel));
                    assert!(
                        x.is_nan() && y.is_nan() || (x - y).abs() < tolerance,
                        "{format:?} {channel:?} {x} {y}"
                    );
                }
            }
        }
    }

    #[test]
    fn what_a_recording_of_phasors_lacks_is_named() {
        let good = recording(&event(), &site(), None);
        let message = |change: fn(&mut Recording)| {
            let mut broken = good.clone();
            change(&mut broken);
            record(&broken, &site()).unwrap_err().to_string()
        };
        assert_eq!(
            message(|r| r.analog[3].name.clear()),
            "the recording has no channel `P`"
        );
        assert_eq!(
            message(|r| r.analog[0].unit = "A".to_owned()),
            "channel `V1` is in `A`, expected V or kV"
        );
        assert_eq!(message(|r| r.start_ns = None), "the recording has no date");
        assert!(message(|r| r.nominal_hz = Some(50.0)).contains("50 Hz"));
        assert!(message(|r| r.time_s[50] += 1.0).contains("without gaps"));
    }
}
