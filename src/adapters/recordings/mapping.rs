//! Which channels of a recording are a load's voltages and currents, and the record they give.

use thiserror::Error as ThisError;

use super::comtrade::{AnalogChannel, Recording};
use crate::measurement::{
    Record, Site,
    phasor::{self, Connection, Settings, Waveforms},
};

/// Three channels of one three-phase quantity.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ThreePhase {
    /// Names (or numbers) of the channels, phases a, b, c in the order of rotation.
    pub channels: [String; 3],
    /// Factor from the recorded to the primary value; none: by the file's own ratings, which it
    /// must then state.
    pub ratio: Option<f64>,
    /// Whether the recorded current is positive out of the load; ignored for voltages.
    pub reversed: bool,
}

/// Which channels of a recording are a load's voltages and currents.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingMapping {
    /// The load's voltages.
    pub voltage: ThreePhase,
    /// Connection of the voltages.
    pub connection: Connection,
    /// The feeders whose currents add up to the load's; at least one.
    pub currents: Vec<ThreePhase>,
    /// Whether each channel is shifted by the skew its line states. Default: no, see
    /// `docs/phasors.md`.
    pub apply_skew: bool,
    /// How phasors are made.
    pub phasors: Settings,
}

impl RecordingMapping {
    /// One voltage and one current, by channel names or numbers, everything else by default.
    #[must_use]
    pub fn new(voltage: [&str; 3], current: [&str; 3]) -> Self {
        let three = |channels: [&str; 3]| ThreePhase {
            channels: channels.map(str::to_owned),
            ..ThreePhase::default()
        };
        Self {
            voltage: three(voltage),
            connection: Connection::LineToGround,
            currents: vec![three(current)],
            apply_skew: false,
            phasors: Settings::default(),
        }
    }

    /// One record per contiguous piece of waveform, in order of time; see [`phasor::records`].
    ///
    /// # Errors
    /// A channel is absent or ambiguous in its scaling, or the waveform is not usable.
    pub fn records(&self, recording: &Recording, site: &Site) -> Result<Vec<Record>, Error> {
        if recording.start_ns.is_none() {
            return Err(Error::NoDate);
        }
        let waveforms = self.waveforms(recording, site.nominal_hz)?;
        Ok(phasor::records(&waveforms, site, &self.phasors)?)
    }

    /// All pieces as one record, with missing samples between them.
    ///
    /// # Errors
    /// As [`RecordingMapping::records`].
    pub fn record(&self, recording: &Recording, site: &Site) -> Result<Record, Error> {
        let records = self.records(recording, site)?;
        phasor::join(&records).ok_or(Error::NoCurrents)
    }

    /// The mapped channels in volts and amperes, primary, consumption positive; time zero is 1970
    /// for a recording without a date.
    ///
    /// # Errors
    /// A channel is absent or ambiguous in its scaling.
    pub fn waveforms(&self, recording: &Recording, nominal_hz: f64) -> Result<Waveforms, Error> {
        let shift = |channel: &AnalogChannel, values: Vec<f64>| {
            if self.apply_skew {
                shifted(&recording.time_s, &values, channel.skew_us * 1e-6)
            } else {
                values
            }
        };
        let read = |set: &ThreePhase, quantity, sign: f64| -> Result<[Vec<f64>; 3], Error> {
            let [a, b, c] = &set.channels;
            let one = |name: &String| -> Result<Vec<f64>, Error> {
                let channel = find(recording, name)?;
                let factor = sign * factor(channel, quantity, set.ratio)?;
                let values = channel.values.iter().map(|v| factor * v).collect();
                Ok(shift(channel, values))
            };
            Ok([one(a)?, one(b)?, one(c)?])
        };
        let voltage_v = read(&self.voltage, Quantity::Voltage, 1.0)?;
        let mut feeders = self.currents.iter().map(|feeder| {
            let sign = if feeder.reversed { -1.0 } else { 1.0 };
            read(feeder, Quantity::Current, sign)
        });
        let mut current_a = feeders.next().ok_or(Error::NoCurrents)??;
        for feeder in feeders {
            for (sum, values) in current_a.iter_mut().zip(feeder?) {
                for (total, value) in sum.iter_mut().zip(values) {
                    *total += value;
                }
            }
        }
        Ok(Waveforms {
            start_ns: recording.start_ns.unwrap_or(0),
            nominal_hz,
            time_s: recording.time_s.clone(),
            voltage_v,
            connection: self.connection,
            current_a,
        })
    }
}

/// Why a mapping does not fit a recording.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// No channel has this name or number.
    #[error("no channel is called or numbered '{channel}'")]
    NoChannel {
        /// What the mapping asks for.
        channel: String,
    },
    /// More than one channel has this name.
    #[error("{count} channels are called '{channel}': use their numbers")]
    Ambiguous {
        /// What the mapping asks for.
        channel: String,
        /// How many have the name.
        count: usize,
    },
    /// The channel's unit is not one of the quantity.
    #[error("channel '{channel}' is in '{unit}', expected {expected}")]
    Unit {
        /// The channel.
        channel: String,
        /// Its unit.
        unit: String,
        /// Units of the quantity.
        expected: &'static str,
    },
    /// The file does not say how the recorded value relates to the primary one.
    #[error("channel '{channel}' does not say if it is primary or secondary: give its ratio")]
    NoRatio {
        /// The channel.
        channel: String,
    },
    /// The mapping names no currents.
    #[error("the mapping names no currents")]
    NoCurrents,
    /// The recorder had no clock.
    #[error("the recording has no date")]
    NoDate,
    /// The waveforms are not usable.
    #[error(transparent)]
    Phasor(#[from] phasor::Error),
}

/// A measured quantity of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Voltage.
    Voltage,
    /// Current.
    Current,
}

impl Quantity {
    /// Quantity and factor to volts or amperes of a unit as recorders write it: an optional k, M
    /// or m and then V, volt, A, amp or ampere; Cyrillic letters that look or stand for the same.
    #[must_use]
    pub fn of_unit(unit: &str) -> Option<(Self, f64)> {
        let plain: String = unit.trim().chars().map(latin).collect();
        let (factor, base) = match plain.chars().next()? {
            'k' | 'K' => (1e3, &plain[1..]),
            'M' => (1e6, &plain[1..]),
            'm' => (1e-3, &plain[1..]),
            _ => (1.0, plain.as_str()),
        };
        let quantity = match base.to_ascii_lowercase().as_str() {
            "v" | "volt" | "volts" => Self::Voltage,
            "a" | "amp" | "amps" | "ampere" | "amperes" => Self::Current,
            _ => return None,
        };
        Some((quantity, factor))
    }
}

/// Latin letters for the Cyrillic ones of kV and kA: ve stands for V, ka and a look like k and A.
fn latin(c: char) -> char {
    match c {
        '\u{412}' | '\u{432}' => 'V',
        '\u{410}' | '\u{430}' => 'A',
        '\u{41a}' | '\u{43a}' => 'k',
        '\u{41c}' => 'M',
        '\u{43c}' => 'm',
        other if other.is_ascii() => other,
        _ => '?',
    }
}

fn find<'a>(recording: &'a Recording, name: &str) -> Result<&'a AnalogChannel, Error> {
    let same_name = |c: &&AnalogChannel| c.name == name.trim();
    let count = recording.analog.iter().filter(same_name).count();
    if count > 1 {
        let channel = name.to_owned();
        return Err(Error::Ambiguous { channel, count });
    }
    recording.channel(name).ok_or_else(|| Error::NoChannel {
        channel: name.to_owned(),
    })
}

/// Factor from the recorded value to primary volts or amperes.
fn factor(channel: &AnalogChannel, quantity: Quantity, ratio: Option<f64>) -> Result<f64, Error> {
    let to_si = match Quantity::of_unit(&channel.unit) {
        Some((found, factor)) if found == quantity => factor,
        // Recorders leave the unit away; then the values are taken as volts and amperes.
        None if channel.unit.is_empty() => 1.0,
        _ => {
            return Err(Error::Unit {
                channel: channel.name.clone(),
                unit: channel.unit.clone(),
                expected: match quantity {
                    Quantity::Voltage => "V or kV",
                    Quantity::Current => "A or kA",
                },
            });
        }
    };
    let to_primary = ratio.or_else(|| channel.to_primary());
    let to_primary = to_primary.ok_or_else(|| Error::NoRatio {
        channel: channel.name.clone(),
    })?;
    Ok(to_si * to_primary)
}

/// The values at the common sample times of a channel that was sampled `skew_s` later, by the
/// cubic through the two samples on either side (at 24 samples per cycle within 0.01 % of a sine);
/// NaN within two samples of an end or a break, where there is no such cubic.
fn shifted(time_s: &[f64], values: &[f64], skew_s: f64) -> Vec<f64> {
    time_s
        .iter()
        .map(|&wanted_s| {
            let after = time_s.partition_point(|&t| t + skew_s <= wanted_s);
            let from = after.checked_sub(2)?;
            let times = time_s.get(from..from + 4)?;
            let (shortest, longest) = times
                .windows(2)
                .map(|pair| pair[1] - pair[0])
                .fold((f64::INFINITY, 0.0_f64), |(low, high), dt| {
                    (low.min(dt), high.max(dt))
                });
            let contiguous = longest <= 1.5 * shortest;
            contiguous.then(|| cubic(times, &values[from..from + 4], wanted_s - skew_s))
        })
        .map(|value| value.unwrap_or(f64::NAN))
        .collect()
}

/// Lagrange's polynomial through the given points.
fn cubic(times: &[f64], values: &[f64], at: f64) -> f64 {
    let basis = |k: usize| -> f64 {
        let others = (0..times.len()).filter(|&l| l != k);
        others
            .map(|l| (at - times[l]) / (times[k] - times[l]))
            .product()
    };
    values.iter().enumerate().map(|(k, v)| v * basis(k)).sum()
}

#[cfg(test)]
mod tests;
