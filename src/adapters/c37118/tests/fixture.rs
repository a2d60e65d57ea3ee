//! Configurations and frames to test with.

use crate::adapters::c37118::{
    AnalogChannel, AnalogKind, AnalogScaling, Configuration, ConfigurationKind, DataFrame,
    DataRate, DigitalWord, Format, LocationAndFilter, NominalFrequencyCode, Number, Phasor,
    PhasorChannel, PhasorComponent, PhasorQuantity, PhasorScaling, PmuConfiguration, PmuData,
    Prefix, Status, TimeQuality, Timestamp, Version,
};

/// The bytes of a line of hexadecimal digits.
pub(super) fn bytes(hex: &str) -> Vec<u8> {
    let digit = |d: &u8| {
        char::from(*d)
            .to_digit(16)
            .and_then(|d| u8::try_from(d).ok())
    };
    let digits: Vec<u8> = hex.bytes().filter(u8::is_ascii_hexdigit).collect();
    let pairs = digits.chunks_exact(2);
    pairs
        .map(|pair| digit(&pair[0]).unwrap() << 4 | digit(&pair[1]).unwrap())
        .collect()
}

pub(super) fn prefix() -> Prefix {
    Prefix {
        version: Version::Y2011,
        id_code: 7734,
        time: Timestamp {
            seconds: 1_700_000_000,
            fraction: 500_000,
            quality: TimeQuality(0),
        },
    }
}

const PHASORS: [(&str, PhasorQuantity, PhasorComponent); 7] = [
    ("VA", PhasorQuantity::Voltage, PhasorComponent::PhaseA),
    ("VB", PhasorQuantity::Voltage, PhasorComponent::PhaseB),
    ("VC", PhasorQuantity::Voltage, PhasorComponent::PhaseC),
    ("IA", PhasorQuantity::Current, PhasorComponent::PhaseA),
    ("IB", PhasorQuantity::Current, PhasorComponent::PhaseB),
    ("IC", PhasorQuantity::Current, PhasorComponent::PhaseC),
    (
        "V1",
        PhasorQuantity::Voltage,
        PhasorComponent::PositiveSequence,
    ),
];

/// A PMU with three voltages, three currents, a positive-sequence voltage, two analog values and
/// a word of contacts. Volts come in steps of 2, amperes of 0.5.
pub(super) fn pmu(id_code: u16, format: Format, kind: ConfigurationKind) -> PmuConfiguration {
    let variable = kind == ConfigurationKind::Configuration3;
    let phasors = PHASORS.map(|(name, quantity, component)| {
        let volts = quantity == PhasorQuantity::Voltage;
        let scaling = if variable {
            let step = if volts { 2.0 } else { 0.5 };
            PhasorScaling::Affine {
                modification: 0x0100,
                component,
                user: 3,
                factor: if format.phasors_float() { 1.0 } else { step },
                angle_rad: 0.0,
            }
        } else {
            PhasorScaling::PerBit(if volts { 200_000 } else { 50_000 })
        };
        PhasorChannel {
            name: name.to_owned(),
            quantity,
            scaling,
        }
    });
    let analogs = ["P", "Q"].map(|name| AnalogChannel {
        name: name.to_owned(),
        scaling: if variable {
            AnalogScaling::Affine {
                factor: 0.5,
                offset: 1.0,
            }
        } else {
            AnalogScaling::User {
                kind: AnalogKind::Effective,
                factor: -5,
            }
        },
    });
    PmuConfiguration {
        station: format!("Load bus {id_code}"),
        id_code,
        format,
        phasors: phasors.to_vec(),
        analogs: analogs.to_vec(),
        digitals: vec![DigitalWord {
            names: std::array::from_fn(|bit| format!("breaker {bit}")),
            normal: 0,
            valid: 0xffff,
        }],
        nominal: NominalFrequencyCode::HZ_50,
        changes: 22,
        place: variable.then_some(LocationAndFilter {
            global_id: *b"0123456789abcdef",
            latitude_deg: 47.5,
            longitude_deg: 19.0,
            elevation_m: f32::INFINITY,
            service_class: b'P',
            window_us: 40_000,
            group_delay_us: 20_000,
        }),
    }
}

pub(super) fn configuration(kind: ConfigurationKind, formats: &[Format]) -> Configuration {
    let pmus = (1..).zip(formats);
    Configuration {
        prefix: prefix(),
        kind,
        time_base_flags: 0,
        time_base: 1_000_000,
        pmus: pmus.map(|(id, &format)| pmu(id, format, kind)).collect(),
        rate: DataRate(50),
    }
}

/// The sixteen formats.
pub(super) fn formats() -> Vec<Format> {
    (0..16).map(Format).collect()
}

/// Balanced: 20 kV to ground at 0.3 rad, 500 A at 0.1 rad; +100 mHz; -0.5 Hz/s; P and Q 100, -40.
pub(super) fn data(configuration: &Configuration) -> DataFrame {
    let one = |pmu: &PmuConfiguration| {
        let format = pmu.format;
        let phasors = PHASORS.map(|(_, quantity, component)| {
            let volts = quantity == PhasorQuantity::Voltage;
            let (magnitude, angle) = if volts { (20e3, 0.3) } else { (500.0, 0.1) };
            let turn = match component {
                PhasorComponent::PhaseB => -1.0,
                PhasorComponent::PhaseC => 1.0,
                _ => 0.0,
            } * std::f64::consts::TAU
                / 3.0;
            let step = if volts { 2.0 } else { 0.5 };
            phasor(format, magnitude, angle + turn, step)
        });
        let number = |float, integer: i16, value: f32| {
            if float {
                Number::Float(value)
            } else {
                Number::Integer(integer)
            }
        };
        PmuData {
            status: Status(0),
            phasors: phasors.to_vec(),
            frequency: number(format.frequency_float(), 100, 50.1),
            rocof: number(format.frequency_float(), -50, -0.5),
            analogs: vec![
                number(format.analogs_float(), 100, 100.0),
                number(format.analogs_float(), -40, -40.0),
            ],
            digitals: vec![0x3c12],
        }
    };
    DataFrame {
        prefix: prefix(),
        pmus: configuration.pmus.iter().map(one).collect(),
    }
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the numbers of the fixture fit"
)]
fn phasor(format: Format, magnitude: f64, angle: f64, step: f64) -> Phasor {
    let (re, im) = (magnitude * angle.cos(), magnitude * angle.sin());
    match (format.phasors_polar(), format.phasors_float()) {
        (false, false) => Phasor::RectangularInteger {
            re: (re / step).round() as i16,
            im: (im / step).round() as i16,
        },
        (true, false) => Phasor::PolarInteger {
            magnitude: (magnitude / step).round() as u16,
            angle: (angle * 1e4).round() as i16,
        },
        (false, true) => Phasor::RectangularFloat {
            re: re as f32,
            im: im as f32,
        },
        (true, true) => Phasor::PolarFloat {
            magnitude: magnitude as f32,
            angle_rad: angle as f32,
        },
    }
}
