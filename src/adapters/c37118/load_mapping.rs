//! Which channels of a stream are a load's voltage and power.

use thiserror::Error as ThisError;

use super::configuration::{Configuration, PmuConfiguration};
use crate::measurement::phasor::Connection;

/// Which PMU of a stream.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum PmuChoice {
    /// The stream's only one.
    #[default]
    Only,
    /// The one with this IDCODE.
    IdCode(u16),
    /// The one of the station with this name.
    Station(String),
}

/// The phasors of one voltage or current, by name, or `#n` for the n-th phasor from 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PhasorSet {
    /// The PMU computes the positive sequence.
    PositiveSequence(String),
    /// Phases a, b, c in the order of rotation.
    Phases([String; 3]),
}

/// One of the currents that add up to the load's.
#[derive(Clone, Debug, PartialEq)]
pub struct SignedSet {
    /// Its phasors.
    pub phasors: PhasorSet,
    /// Whether it is positive out of the load.
    pub reversed: bool,
}

/// An analog channel that holds a power.
#[derive(Clone, Debug, PartialEq)]
pub struct AnalogPower {
    /// Name, or `#n` for the n-th analog value from 1.
    pub channel: String,
    /// Megawatts (megavars) into the load per unit of the value: of the scaled one of a CFG-3, of
    /// the number as sent otherwise.
    pub mega_per_unit: f64,
}

/// Where P and Q come from.
#[derive(Clone, Debug, PartialEq)]
pub enum PowerSource {
    /// P + jQ = 3 V1 conj(I1), with the sum of these currents.
    Currents(Vec<SignedSet>),
    /// The PMU computes them.
    Analogs {
        /// Active power.
        active: AnalogPower,
        /// Reactive power.
        reactive: AnalogPower,
    },
}

/// What a floating-point FREQ holds. The editions say the frequency; the text of 2005 can be read
/// otherwise, and sources exist that send the deviation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FloatFrequency {
    /// Hertz.
    #[default]
    Hertz,
    /// Deviation from nominal, hertz.
    DeviationHertz,
    /// Deviation from nominal, millihertz.
    DeviationMillihertz,
}

/// Which channels of a stream are a load's voltage and power.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadMapping {
    /// PMU.
    pub pmu: PmuChoice,
    /// The load's voltage.
    pub voltage: PhasorSet,
    /// What the voltages (also a positive-sequence one) are measured between.
    pub connection: Connection,
    /// Primary volts per volt sent; 1 unless the PMU sends secondary values.
    pub voltage_ratio: f64,
    /// P and Q.
    pub power: PowerSource,
    /// Primary amperes per ampere sent; 1 unless the PMU sends secondary values.
    pub current_ratio: f64,
    /// What a floating-point FREQ holds.
    pub float_frequency: FloatFrequency,
}

impl LoadMapping {
    /// Voltage to ground and one current into the load, primary values, of the stream's only PMU.
    #[must_use]
    pub fn new(voltage: PhasorSet, current: PhasorSet) -> Self {
        let phasors = current;
        Self {
            pmu: PmuChoice::Only,
            voltage,
            connection: Connection::LineToGround,
            voltage_ratio: 1.0,
            power: PowerSource::Currents(vec![SignedSet {
                phasors,
                reversed: false,
            }]),
            current_ratio: 1.0,
            float_frequency: FloatFrequency::Hertz,
        }
    }
}

/// Why a mapping does not fit a stream and a site.
#[derive(Clone, Debug, PartialEq, ThisError)]
#[non_exhaustive]
pub enum MappingError {
    /// No PMU, or several, where one is asked for.
    #[error("{found} PMUs of the stream are {asked}; it holds {present}")]
    Pmu {
        /// How many there are.
        found: usize,
        /// What was asked for.
        asked: String,
        /// IDCODE and station of all.
        present: String,
    },
    /// No channel, or several, of that name.
    #[error("{found} {kind} channels of the PMU are called `{name}`; it has {present}")]
    Channel {
        /// How many there are.
        found: usize,
        /// `phasor` or `analog`.
        kind: &'static str,
        /// The name.
        name: String,
        /// All names.
        present: String,
    },
    /// A voltage where a current is due, or the reverse.
    #[error("phasor `{name}` is no {expected}")]
    Quantity {
        /// The phasor.
        name: String,
        /// `voltage` or `current`.
        expected: &'static str,
    },
    /// No currents were named.
    #[error("no current is named to compute the power from")]
    NoCurrents,
    /// A factor that is zero or not finite.
    #[error("{name} of {found} is not a finite number other than zero")]
    Factor {
        /// Which.
        name: &'static str,
        /// The number.
        found: f64,
    },
    /// The stream's nominal frequency is not the site's.
    #[error("the PMU's nominal frequency is {pmu_hz} Hz, the site's {site_hz} Hz")]
    Nominal {
        /// The PMU's, Hz.
        pmu_hz: f64,
        /// The site's, Hz.
        site_hz: f64,
    },
    /// The stream states no rate.
    #[error("the stream states a rate of zero frames")]
    NoRate,
}

/// Index of the PMU that `choice` names.
pub(super) fn pmu_index(
    configuration: &Configuration,
    choice: &PmuChoice,
) -> Result<usize, MappingError> {
    let fits = |pmu: &PmuConfiguration| match choice {
        PmuChoice::Only => true,
        PmuChoice::IdCode(id_code) => pmu.id_code == *id_code,
        PmuChoice::Station(name) => pmu.station.trim() == name.trim(),
    };
    let pmus = configuration.pmus.iter().enumerate();
    let found: Vec<usize> = pmus.filter(|(_, pmu)| fits(pmu)).map(|(i, _)| i).collect();
    let &[index] = found.as_slice() else {
        let pmus = configuration.pmus.iter();
        let present = pmus.map(|pmu| format!("{} ({})", pmu.id_code, pmu.station));
        return Err(MappingError::Pmu {
            found: found.len(),
            asked: match choice {
                PmuChoice::Only => "its only one".to_owned(),
                PmuChoice::IdCode(id_code) => format!("number {id_code}"),
                PmuChoice::Station(name) => format!("at station `{name}`"),
            },
            present: listed(present),
        });
    };
    Ok(index)
}

/// Index of the channel called `name`, or of the n-th for `#n`.
pub(super) fn channel_index<'a>(
    kind: &'static str,
    names: impl Iterator<Item = &'a str> + Clone,
    name: &str,
) -> Result<usize, MappingError> {
    let wanted = name.trim();
    let named = names.clone().enumerate();
    let named = named.filter(|(_, found)| found.trim() == wanted);
    let mut found: Vec<usize> = named.map(|(index, _)| index).collect();
    if found.is_empty() {
        let number = wanted.strip_prefix('#').and_then(|n| n.parse().ok());
        let index = number.and_then(|n: usize| n.checked_sub(1));
        found.extend(index.filter(|&index| index < names.clone().count()));
    }
    let &[index] = found.as_slice() else {
        return Err(MappingError::Channel {
            found: found.len(),
            kind,
            name: wanted.to_owned(),
            present: listed(names.map(|name| format!("`{name}`"))),
        });
    };
    Ok(index)
}

/// A list for a message, cut after twenty items.
fn listed(items: impl Iterator<Item = String>) -> String {
    const ITEMS_MAX: usize = 20;
    let mut items: Vec<String> = items.take(ITEMS_MAX + 1).collect();
    if items.len() > ITEMS_MAX {
        items.truncate(ITEMS_MAX);
        items.push("..".to_owned());
    }
    items.join(", ")
}
