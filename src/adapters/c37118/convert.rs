//! From data frames to per-unit samples of one load.

use std::f64::consts::{FRAC_PI_6, TAU};

use thiserror::Error as ThisError;

use super::{
    channel::{PhasorChannel, PhasorQuantity},
    configuration::{Configuration, PmuConfiguration},
    data::{DataFrame, Number, PmuData},
    load_mapping::{
        AnalogPower, FloatFrequency, LoadMapping, MappingError, PhasorSet, PowerSource,
        channel_index, pmu_index,
    },
};
use crate::measurement::{
    Channel, Quality, Sample, SampleBatch, Site,
    phasor::{Complex, Connection},
    record::{NANOSECONDS_PER_SECOND, grid_offset_ns},
};

/// How far the nominal frequency of a PMU may be from the site's, Hz: the same number written twice.
const NOMINAL_TOLERANCE_HZ: f64 = 1e-6;
/// How far a stamp may be from its place in a batch, in intervals. Sources round to a microsecond
/// or so; half an interval is another place.
const GRID_TOLERANCE: f64 = 0.1;
/// A frequency further from nominal than this share is no frequency of a grid but a field filled
/// with something else.
const FREQUENCY_SHARE_MAX: f64 = 0.5;

/// Turns the data frames of one configuration into samples of one load.
#[derive(Clone, Debug)]
pub struct Converter {
    pmu: usize,
    id_code: u16,
    time_base: u32,
    nominal_hz: f64,
    rate_fps: f64,
    voltage: Set,
    connection: Connection,
    /// Volts to per unit of the site's phase-to-ground base.
    voltage_pu_per_v: f64,
    power: Power,
    float_frequency: FloatFrequency,
}

/// Phasors of one quantity by index.
#[derive(Clone, Debug)]
enum Set {
    PositiveSequence(usize, PhasorChannel),
    Phases([(usize, PhasorChannel); 3]),
}

#[derive(Clone, Debug)]
enum Power {
    Currents {
        sets: Vec<(Set, f64)>,
        /// Volts times amperes to per unit of the site's power base, with the three phases.
        pu_per_va: f64,
    },
    /// Index and per unit of the base per unit of the value, for P and Q.
    Analogs([(usize, super::channel::AnalogChannel, f64); 2]),
}

/// Why a data frame gives no sample.
#[derive(Clone, Debug, PartialEq, Eq, ThisError)]
#[non_exhaustive]
pub enum SampleRefusal {
    /// The fraction of the second is not below the time base.
    #[error("FRACSEC {fraction} is not below TIME_BASE {time_base}")]
    Fraction {
        /// As sent.
        fraction: u32,
        /// Of the configuration.
        time_base: u32,
    },
    /// The frame is from an inserted leap second, which has no UTC nanosecond of its own.
    #[error("the frame lies in an inserted leap second (SOC {seconds})")]
    LeapSecond {
        /// SOC.
        seconds: u32,
    },
    /// The frame was decoded by another configuration.
    #[error("the frame does not hold the channels of the configuration")]
    OtherConfiguration,
}

impl Converter {
    /// A converter for `site`, with every channel looked up.
    ///
    /// # Errors
    /// [`MappingError`]: the mapping names what the stream does not hold, or holds twice.
    pub fn new(
        configuration: &Configuration,
        mapping: &LoadMapping,
        site: &Site,
    ) -> Result<Self, MappingError> {
        let index = pmu_index(configuration, &mapping.pmu)?;
        let pmu = &configuration.pmus[index];
        let (pmu_hz, site_hz) = (pmu.nominal.hz(), site.nominal_hz);
        if (pmu_hz - site_hz).abs() > NOMINAL_TOLERANCE_HZ {
            return Err(MappingError::Nominal { pmu_hz, site_hz });
        }
        let rate_fps = configuration.rate.frames_per_second();
        factor("voltage ratio", mapping.voltage_ratio)?;
        factor("current ratio", mapping.current_ratio)?;
        let phase_base_v = site.v_base_kv * 1e3 / 3.0_f64.sqrt();
        Ok(Self {
            pmu: index,
            id_code: configuration.prefix.id_code,
            time_base: configuration.time_base,
            nominal_hz: pmu_hz,
            rate_fps: rate_fps.ok_or(MappingError::NoRate)?,
            voltage: Set::look_up(pmu, &mapping.voltage, PhasorQuantity::Voltage)?,
            connection: mapping.connection,
            voltage_pu_per_v: mapping.voltage_ratio / phase_base_v,
            power: Power::look_up(pmu, mapping, site)?,
            float_frequency: mapping.float_frequency,
        })
    }

    /// Frames per second of the stream.
    #[must_use]
    pub const fn rate_fps(&self) -> f64 {
        self.rate_fps
    }

    /// The channels a sample of this converter holds.
    #[must_use]
    pub fn channels(&self) -> Vec<Channel> {
        let negative = matches!(self.voltage, Set::Phases(_));
        let holds = |channel: &Channel| negative || *channel != Channel::NegativeSequenceRatio;
        Channel::ALL.into_iter().filter(holds).collect()
    }

    /// The sample of `frame`: positive sequence, per unit of the site. A value that is absent or
    /// not finite is NaN and sets [`Quality::NOT_FINITE`].
    ///
    /// # Errors
    /// [`SampleRefusal`]: the frame has no time, or is not of this configuration.
    pub fn sample(&self, frame: &DataFrame) -> Result<Sample, SampleRefusal> {
        let time = frame.prefix.time;
        if time.in_inserted_second() {
            let seconds = time.seconds;
            return Err(SampleRefusal::LeapSecond { seconds });
        }
        let time_ns = time.utc_ns(self.time_base).ok_or(SampleRefusal::Fraction {
            fraction: time.fraction,
            time_base: self.time_base,
        })?;
        let other = SampleRefusal::OtherConfiguration;
        if frame.prefix.id_code != self.id_code {
            return Err(other);
        }
        let data = frame.pmus.get(self.pmu).ok_or(other.clone())?;
        let (v1, v2) = self.voltage.sequences(data).ok_or(other.clone())?;
        let (v1, v2) = match self.connection {
            Connection::LineToGround => (v1, v2),
            // Vab1 = sqrt(3) exp(+j 30 deg) Va1 and Vab2 = sqrt(3) exp(-j 30 deg) Va2.
            Connection::LineToLine => {
                let by = |angle| Complex::polar(1.0 / 3.0_f64.sqrt(), angle);
                (v1 * by(-FRAC_PI_6), v2.map(|v2| v2 * by(FRAC_PI_6)))
            }
        };
        let power = self.power.of(data, v1).ok_or(other)?;
        let mut sample = Sample {
            time_ns,
            voltage_pu: v1.magnitude() * self.voltage_pu_per_v,
            angle_rad: v1.angle_rad(),
            frequency_hz: self.frequency_hz(data),
            active_pu: power.re,
            reactive_pu: power.im,
            negative_sequence_ratio: v2.map_or(f64::NAN, |v2| v2.magnitude() / v1.magnitude()),
            quality: data.status.quality(time.quality),
        };
        let required = Channel::ALL.into_iter().filter(|c| !c.optional());
        if required.into_iter().any(|c| !sample.value(c).is_finite()) {
            sample.quality = sample.quality | Quality::NOT_FINITE;
        }
        Ok(sample)
    }

    /// Frequency, Hz; not a number where the field holds none.
    fn frequency_hz(&self, data: &PmuData) -> f64 {
        let hz = match (data.frequency, self.float_frequency) {
            (Number::Integer(_), _) | (_, FloatFrequency::Hertz) => {
                data.frequency_hz(self.nominal_hz)
            }
            (number, FloatFrequency::DeviationHertz) => self.nominal_hz + number.value(),
            (number, FloatFrequency::DeviationMillihertz) => {
                self.nominal_hz + 1e-3 * number.value()
            }
        };
        let believable = (hz - self.nominal_hz).abs() < FREQUENCY_SHARE_MAX * self.nominal_hz;
        if believable { hz } else { f64::NAN }
    }
}

fn factor(name: &'static str, found: f64) -> Result<(), MappingError> {
    if found.is_finite() && found != 0.0 {
        Ok(())
    } else {
        Err(MappingError::Factor { name, found })
    }
}

impl Set {
    fn look_up(
        pmu: &PmuConfiguration,
        set: &PhasorSet,
        quantity: PhasorQuantity,
    ) -> Result<Self, MappingError> {
        let one = |name: &String| {
            let names = pmu.phasors.iter().map(|channel| channel.name.as_str());
            let index = channel_index("phasor", names, name)?;
            let channel = pmu.phasors[index].clone();
            if channel.quantity == quantity {
                Ok((index, channel))
            } else {
                let expected = match quantity {
                    PhasorQuantity::Current => "current",
                    _ => "voltage",
                };
                Err(MappingError::Quantity {
                    name: channel.name,
                    expected,
                })
            }
        };
        Ok(match set {
            PhasorSet::PositiveSequence(name) => {
                let (index, channel) = one(name)?;
                Self::PositiveSequence(index, channel)
            }
            PhasorSet::Phases([a, b, c]) => Self::Phases([one(a)?, one(b)?, one(c)?]),
        })
    }

    /// Positive and, from three phases, negative sequence; none when the data lack a phasor.
    fn sequences(&self, data: &PmuData) -> Option<(Complex, Option<Complex>)> {
        let value = |(index, channel): &(usize, PhasorChannel)| {
            data.phasors.get(*index).map(|p| channel.value(*p))
        };
        match self {
            Self::PositiveSequence(index, channel) => {
                let phasor = data.phasors.get(*index)?;
                Some((channel.value(*phasor), None))
            }
            Self::Phases([a, b, c]) => {
                let (a, b, c) = (value(a)?, value(b)?, value(c)?);
                let turn = Complex::polar(1.0, TAU / 3.0);
                let back = turn.conjugate();
                let third = |x: Complex| x.scale(1.0 / 3.0);
                let positive = third(a + turn * b + back * c);
                let negative = third(a + back * b + turn * c);
                Some((positive, Some(negative)))
            }
        }
    }
}

impl Power {
    fn look_up(
        pmu: &PmuConfiguration,
        mapping: &LoadMapping,
        site: &Site,
    ) -> Result<Self, MappingError> {
        match &mapping.power {
            PowerSource::Currents(sets) if sets.is_empty() => Err(MappingError::NoCurrents),
            PowerSource::Currents(sets) => {
                let sets = sets.iter().map(|set| {
                    let sign = if set.reversed { -1.0 } else { 1.0 };
                    let quantity = PhasorQuantity::Current;
                    Ok((Set::look_up(pmu, &set.phasors, quantity)?, sign))
                });
                let ratio = mapping.voltage_ratio * mapping.current_ratio;
                Ok(Self::Currents {
                    sets: sets.collect::<Result<_, MappingError>>()?,
                    pu_per_va: 3.0 * ratio / (site.s_base_mva * 1e6),
                })
            }
            PowerSource::Analogs { active, reactive } => {
                let one = |power: &AnalogPower| {
                    factor("power per unit of an analog value", power.mega_per_unit)?;
                    let names = pmu.analogs.iter().map(|channel| channel.name.as_str());
                    let index = channel_index("analog", names, &power.channel)?;
                    let scale = power.mega_per_unit / site.s_base_mva;
                    Ok((index, pmu.analogs[index].clone(), scale))
                };
                Ok(Self::Analogs([one(active)?, one(reactive)?]))
            }
        }
    }

    /// P + jQ, per unit; `v1` is the positive-sequence voltage to ground as sent. None when the
    /// data lack a channel.
    fn of(&self, data: &PmuData, v1: Complex) -> Option<Complex> {
        match self {
            Self::Currents { sets, pu_per_va } => {
                let mut current = Complex::new(0.0, 0.0);
                for (set, sign) in sets {
                    current = current + set.sequences(data)?.0.scale(*sign);
                }
                Some((v1 * current.conjugate()).scale(*pu_per_va))
            }
            Self::Analogs([active, reactive]) => {
                let value = |(index, channel, scale): &(usize, super::AnalogChannel, f64)| {
                    data.analogs.get(*index).map(|n| scale * channel.value(*n))
                };
                Some(Complex::new(value(active)?, value(reactive)?))
            }
        }
    }
}

/// Batches of samples that follow one another at `converter`'s rate: a sample that is off the grid
/// of the ones before it begins another batch. No running number is given: the concentrator knows
/// gaps by their times.
#[must_use]
pub fn batches(
    converter: &Converter,
    samples: &[Sample],
    site: &Site,
    stream: &str,
) -> Vec<SampleBatch> {
    let rate_fps = converter.rate_fps;
    let tolerance_ns = GRID_TOLERANCE / rate_fps * NANOSECONDS_PER_SECOND;
    let mut runs: Vec<&[Sample]> = Vec::new();
    let mut first = 0;
    for index in 1..=samples.len() {
        let ends = samples.get(index).is_none_or(|sample| {
            let due = samples[first].time_ns + grid_offset_ns((index - first) as f64, rate_fps);
            (sample.time_ns - due).abs() as f64 > tolerance_ns
        });
        if ends {
            runs.push(&samples[first..index]);
            first = index;
        }
    }
    let channels = converter.channels();
    let batch = |run: &[Sample]| SampleBatch {
        site: site.name.clone(),
        stream: stream.to_owned(),
        sequence: None,
        start_ns: run[0].time_ns,
        rate_fps,
        channels: channels
            .iter()
            .map(|&channel| (channel, run.iter().map(|s| s.value(channel)).collect()))
            .collect(),
        quality: run.iter().map(|sample| sample.quality).collect(),
    };
    runs.into_iter().map(batch).collect()
}
