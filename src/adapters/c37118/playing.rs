//! From samples of a load back to frames: the stream of a PMU that has seen them.

use std::f64::consts::{PI, TAU};

use thiserror::Error as ThisError;

use super::{
    channel::{
        AnalogChannel, AnalogKind, AnalogScaling, PhasorChannel, PhasorComponent, PhasorQuantity,
        PhasorScaling,
    },
    configuration::{
        Configuration, ConfigurationKind, DataRate, Format, LocationAndFilter,
        NominalFrequencyCode, PmuConfiguration,
    },
    data::{DataFrame, Number, Phasor, PmuData},
    error::EncodeError,
    frame::{Prefix, Version},
    status::Status,
    time::{TimeQuality, Timestamp},
};
use crate::measurement::{Quality, Sample, Site, phasor::Complex};

/// Parts of a second: microseconds.
const TIME_BASE: u32 = 1_000_000;

/// A stream that carries one load: positive-sequence voltage `V1` (to ground) and current `I1` into the
/// load as polar floating-point phasors in volts and amperes, frequency, and the analog values `P_MW`
/// and `Q_MVAR`. Values are primary.
#[derive(Clone, Debug)]
pub struct Played {
    site: Site,
    configuration: Configuration,
    /// Angle for records without one, from the frequency, radians.
    angle_rad: f64,
    last_ns: Option<i64>,
}

/// Why samples cannot be played.
#[derive(Clone, Copy, Debug, PartialEq, ThisError)]
#[non_exhaustive]
pub enum PlayingError {
    /// `DATA_RATE` holds whole numbers of frames per second, or of seconds per frame.
    #[error(
        "{rate_fps} frames/s cannot be written: neither frames per second nor seconds per frame are whole"
    )]
    Rate {
        /// The rate.
        rate_fps: f64,
    },
    /// FNOM knows two frequencies.
    #[error("a nominal frequency of {nominal_hz} Hz cannot be written: it is neither 50 nor 60 Hz")]
    Nominal {
        /// The frequency.
        nominal_hz: f64,
    },
}

impl Played {
    /// The stream of `site`, as IDCODE `id_code`.
    ///
    /// # Errors
    /// [`PlayingError`]: the rate or the nominal frequency has no code.
    pub fn new(site: &Site, rate_fps: f64, id_code: u16) -> Result<Self, PlayingError> {
        let rate = data_rate(rate_fps).ok_or(PlayingError::Rate { rate_fps })?;
        let nominal_hz = site.nominal_hz;
        let nominal = [NominalFrequencyCode::HZ_50, NominalFrequencyCode::HZ_60]
            .into_iter()
            .find(|code| (code.hz() - nominal_hz).abs() < f64::EPSILON * nominal_hz)
            .ok_or(PlayingError::Nominal { nominal_hz })?;
        let phasor = |name: &str, quantity| PhasorChannel {
            name: name.to_owned(),
            quantity,
            scaling: PhasorScaling::PerBit(1),
        };
        let analog = |name: &str| AnalogChannel {
            name: name.to_owned(),
            scaling: AnalogScaling::User {
                kind: AnalogKind::Effective,
                factor: 1,
            },
        };
        let format = [
            Format::PHASORS_FLOAT,
            Format::ANALOGS_FLOAT,
            Format::FREQUENCY_FLOAT,
        ];
        let pmu = PmuConfiguration {
            station: shortened(&site.name),
            id_code,
            format: format.into_iter().fold(Format::PHASORS_POLAR, |a, b| a | b),
            phasors: vec![
                phasor("V1", PhasorQuantity::Voltage),
                phasor("I1", PhasorQuantity::Current),
            ],
            analogs: vec![analog("P_MW"), analog("Q_MVAR")],
            digitals: Vec::new(),
            nominal,
            changes: 0,
            place: None,
        };
        let prefix = Prefix {
            version: Version::Y2011,
            id_code,
            time: Timestamp::default(),
        };
        Ok(Self {
            site: site.clone(),
            configuration: Configuration {
                prefix,
                kind: ConfigurationKind::Configuration2,
                time_base_flags: 0,
                time_base: TIME_BASE,
                pmus: vec![pmu],
                rate,
            },
            angle_rad: 0.0,
            last_ns: None,
        })
    }

    /// The stream's configuration in the layout of CFG-1, CFG-2 or CFG-3.
    #[must_use]
    pub fn configuration(&self, kind: ConfigurationKind) -> Configuration {
        let mut configuration = self.configuration.clone();
        configuration.kind = kind;
        if kind == ConfigurationKind::Configuration3 {
            for pmu in &mut configuration.pmus {
                for phasor in &mut pmu.phasors {
                    phasor.scaling = PhasorScaling::Affine {
                        modification: 0,
                        component: PhasorComponent::PositiveSequence,
                        user: 0,
                        factor: 1.0,
                        angle_rad: 0.0,
                    };
                }
                for analog in &mut pmu.analogs {
                    analog.scaling = AnalogScaling::Affine {
                        factor: 1.0,
                        offset: 0.0,
                    };
                }
                pmu.place = Some(UNKNOWN_PLACE);
            }
        }
        configuration
    }

    /// The data frame of a sample, to be called in the order of time; none for an instant at which
    /// nothing was measured. A record without angles gets the integral of its frequency.
    ///
    /// # Errors
    /// [`EncodeError`]: never, as long as the frame is that of the own configuration.
    pub fn frame(&mut self, sample: &Sample) -> Result<Option<Vec<u8>>, EncodeError> {
        let angle_rad = self.advance(sample);
        let time = Timestamp::from_utc_ns(sample.time_ns, TIME_BASE, TimeQuality(0));
        let Some(time) = time.filter(|_| !sample.quality.contains(Quality::MISSING)) else {
            return Ok(None);
        };
        let phase_v = sample.voltage_pu * self.site.v_base_kv * 1e3 / 3.0_f64.sqrt();
        let voltage = Complex::polar(phase_v, angle_rad);
        let mega = Complex::new(sample.active_pu, sample.reactive_pu).scale(self.site.s_base_mva);
        // P + jQ = 3 V1 conj(I1), so that I1 = conj(P + jQ) V1 / (3 |V1|^2); no current without voltage.
        let per_square = if phase_v > 0.0 {
            1e6 / (3.0 * phase_v * phase_v)
        } else {
            0.0
        };
        let current = (mega.conjugate() * voltage).scale(per_square);
        let data = PmuData {
            status: status(sample.quality),
            phasors: vec![phasor(voltage), phasor(current)],
            frequency: number(sample.frequency_hz),
            rocof: Number::Float(0.0),
            analogs: vec![number(mega.re), number(mega.im)],
            digitals: Vec::new(),
        };
        let quality = TimeQuality(sample.quality.time_quality_code());
        let frame = DataFrame {
            prefix: Prefix {
                time: Timestamp { quality, ..time },
                ..self.configuration.prefix
            },
            pmus: vec![data],
        };
        frame.encode(&self.configuration).map(Some)
    }

    /// The angle of the sample, and the place in time for the next.
    fn advance(&mut self, sample: &Sample) -> f64 {
        let elapsed_s = self
            .last_ns
            .map_or(0.0, |last_ns| (sample.time_ns - last_ns) as f64 / 1e9);
        let deviation_hz = sample.frequency_hz - self.site.nominal_hz;
        if deviation_hz.is_finite() {
            let turned = self.angle_rad + TAU * deviation_hz * elapsed_s;
            self.angle_rad = (turned + PI).rem_euclid(TAU) - PI;
        }
        self.last_ns = Some(sample.time_ns);
        if sample.angle_rad.is_finite() {
            self.angle_rad = sample.angle_rad;
        }
        self.angle_rad
    }
}

/// What a CFG-3 says of a place that is not known (table 11).
const UNKNOWN_PLACE: LocationAndFilter = LocationAndFilter {
    global_id: [0; 16],
    latitude_deg: f32::INFINITY,
    longitude_deg: f32::INFINITY,
    elevation_m: f32::INFINITY,
    service_class: b'M',
    window_us: 0,
    group_delay_us: 0,
};

/// STAT of a sample's quality. What intake found wrong, and what the recorder called stale, is data
/// that are invalid to whoever receives them.
fn status(quality: Quality) -> Status {
    const UNLOCKED_SHIFT: u32 = 4;
    let own = Quality(0xffff & !Quality::STALE.0 & !0x0020);
    let mut word = quality.0 & own.0 | u32::from(quality.unlocked_code()) << UNLOCKED_SHIFT;
    if !quality.usable() {
        word |= Quality::DATA_INVALID.0;
    }
    let [low, high, ..] = word.to_le_bytes();
    Status(u16::from_le_bytes([low, high]))
}

fn phasor(value: Complex) -> Phasor {
    Phasor::PolarFloat {
        magnitude: single(value.magnitude()),
        angle_rad: single(value.angle_rad()),
    }
}

fn number(value: f64) -> Number {
    Number::Float(single(value))
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "the standard's floating-point numbers have 32 bits"
)]
const fn single(value: f64) -> f32 {
    value as f32
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "only whole numbers that 16 bits hold get there"
)]
fn data_rate(rate_fps: f64) -> Option<DataRate> {
    let whole = |number: f64| {
        let rounded = number.round();
        let is_whole = (number - rounded).abs() < 1e-9 * number.abs();
        (is_whole && (1.0..=f64::from(i16::MAX)).contains(&rounded)).then_some(rounded as i16)
    };
    whole(rate_fps)
        .map(DataRate)
        .or_else(|| whole(1.0 / rate_fps).map(|seconds| DataRate(-seconds)))
}

/// The first sixteen bytes of a name, the room a CFG-2 has for it.
fn shortened(name: &str) -> String {
    const NAME_BYTES: usize = 16;
    let fits = |(at, c): &(usize, char)| at + c.len_utf8() <= NAME_BYTES;
    name.char_indices()
        .take_while(fits)
        .map(|(_, c)| c)
        .collect()
}
