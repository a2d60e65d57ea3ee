//! The layout of CFG-1 and CFG-2 (6.4, tables 8 and 9): names of sixteen bytes.

use super::{
    bytes::{Reader, count},
    channel::{
        AnalogChannel, AnalogKind, AnalogScaling, DigitalWord, PhasorChannel, PhasorQuantity,
        PhasorScaling,
    },
    configuration::{
        self, Configuration, ConfigurationKind, DataRate, Format, NominalFrequencyCode,
        PmuConfiguration,
    },
    error::{EncodeError, Error},
    frame::{self, Prefix},
    name,
};

/// Names in a digital status word.
const BITS: usize = 16;
/// Largest conversion factor: 24 bits.
const FACTOR_MAX: u32 = 0x00ff_ffff;

pub(super) fn read(
    prefix: Prefix,
    kind: ConfigurationKind,
    reader: &mut Reader<'_>,
) -> Result<Configuration, Error> {
    let (time_base_flags, time_base) = configuration::time_base(reader)?;
    let mut pmus = Vec::new();
    for _ in 0..configuration::pmu_count(reader)? {
        pmus.push(read_pmu(reader)?);
    }
    let rate = DataRate(reader.i16("DATA_RATE")?);
    Ok(Configuration {
        prefix,
        kind,
        time_base_flags,
        time_base,
        pmus,
        rate,
    })
}

fn read_pmu(reader: &mut Reader<'_>) -> Result<PmuConfiguration, Error> {
    let station = name::read_fixed(reader, "STN")?;
    let id_code = reader.u16("IDCODE")?;
    let format = Format(reader.u16("FORMAT")?);
    let [phasors, analogs, digitals] = configuration::channel_counts(reader)?;
    let names = names(reader, phasors + analogs + BITS * digitals)?;
    let mut names = names.into_iter();
    let mut next = || names.next().unwrap_or_default();
    let phasor_names: Vec<String> = (0..phasors).map(|_| next()).collect();
    let analog_names: Vec<String> = (0..analogs).map(|_| next()).collect();
    let bit_names: Vec<[String; BITS]> = (0..digitals)
        .map(|_| std::array::from_fn(|_| next()))
        .collect();
    let phasors = phasor_names.into_iter().map(|name| {
        let word = reader.u32("PHUNIT")?;
        Ok(PhasorChannel {
            name,
            quantity: match word.to_be_bytes()[0] {
                0 => PhasorQuantity::Voltage,
                1 => PhasorQuantity::Current,
                code => PhasorQuantity::Reserved(code),
            },
            scaling: PhasorScaling::PerBit(word & FACTOR_MAX),
        })
    });
    let phasors = phasors.collect::<Result<_, Error>>()?;
    let analogs = analog_names.into_iter().map(|name| {
        let word = reader.u32("ANUNIT")?;
        let kind = analog_kind(word.to_be_bytes()[0]);
        // The sign of the 24-bit factor is brought to the top and back.
        let factor = (word << 8).cast_signed() >> 8;
        let scaling = AnalogScaling::User { kind, factor };
        Ok(AnalogChannel { name, scaling })
    });
    let analogs = analogs.collect::<Result<_, Error>>()?;
    let digitals = bit_names.into_iter().map(|names| {
        Ok(DigitalWord {
            names,
            normal: reader.u16("DIGUNIT")?,
            valid: reader.u16("DIGUNIT")?,
        })
    });
    let digitals = digitals.collect::<Result<_, Error>>()?;
    Ok(PmuConfiguration {
        station,
        id_code,
        format,
        phasors,
        analogs,
        digitals,
        nominal: NominalFrequencyCode(reader.u16("FNOM")?),
        changes: reader.u16("CFGCNT")?,
        place: None,
    })
}

/// All names of a PMU, after a look whether there is room for them.
fn names(reader: &mut Reader<'_>, count: usize) -> Result<Vec<String>, Error> {
    const FIELD: &str = "CHNAM";
    let offset = reader.offset();
    let needed = name::FIXED_BYTES * count;
    reader.clone().slice(needed, FIELD).map_err(|mut error| {
        error.offset = offset;
        error
    })?;
    (0..count)
        .map(|_| name::read_fixed(reader, FIELD))
        .collect()
}

const fn analog_kind(code: u8) -> AnalogKind {
    match code {
        0 => AnalogKind::PointOnWave,
        1 => AnalogKind::Effective,
        2 => AnalogKind::Peak,
        code => AnalogKind::Other(code),
    }
}

const fn analog_code(kind: AnalogKind) -> u8 {
    match kind {
        AnalogKind::PointOnWave => 0,
        AnalogKind::Effective => 1,
        AnalogKind::Peak => 2,
        AnalogKind::Other(code) => code,
    }
}

pub(super) fn write(configuration: &Configuration) -> Result<Vec<u8>, EncodeError> {
    let kind = configuration.kind.frame_kind();
    let mut out = Vec::new();
    configuration.write_time_base(&mut out);
    out.extend(count("NUM_PMU", configuration.pmus.len())?);
    for pmu in &configuration.pmus {
        write_pmu(pmu, configuration.kind, &mut out)?;
    }
    out.extend(configuration.rate.0.to_be_bytes());
    frame::seal(kind, configuration.prefix, &out)
}

fn write_pmu(
    pmu: &PmuConfiguration,
    kind: ConfigurationKind,
    out: &mut Vec<u8>,
) -> Result<(), EncodeError> {
    let wrong = |field| EncodeError::WrongKind {
        id_code: pmu.id_code,
        field,
        kind: kind.frame_kind(),
    };
    if pmu.place.is_some() {
        return Err(wrong("the place of the PMU"));
    }
    name::write_fixed(out, &pmu.station, "STN")?;
    out.extend(pmu.id_code.to_be_bytes());
    out.extend(pmu.format.0.to_be_bytes());
    out.extend(count("PHNMR", pmu.phasors.len())?);
    out.extend(count("ANNMR", pmu.analogs.len())?);
    out.extend(count("DGNMR", pmu.digitals.len())?);
    let phasor_names = pmu.phasors.iter().map(|channel| &channel.name);
    let analog_names = pmu.analogs.iter().map(|channel| &channel.name);
    let bit_names = pmu.digitals.iter().flat_map(|word| &word.names);
    for name in phasor_names.chain(analog_names).chain(bit_names) {
        name::write_fixed(out, name, "CHNAM")?;
    }
    for channel in &pmu.phasors {
        let PhasorScaling::PerBit(units) = channel.scaling else {
            return Err(wrong("PHSCALE"));
        };
        check_factor("PHUNIT", i64::from(units), 0, i64::from(FACTOR_MAX))?;
        let code = match channel.quantity {
            PhasorQuantity::Voltage => 0,
            PhasorQuantity::Current => 1,
            PhasorQuantity::Reserved(code) => u32::from(code),
        };
        out.extend((code << 24 | units).to_be_bytes());
    }
    for channel in &pmu.analogs {
        let AnalogScaling::User { kind, factor } = channel.scaling else {
            return Err(wrong("ANSCALE"));
        };
        check_factor("ANUNIT", i64::from(factor), -0x80_0000, 0x7f_ffff)?;
        let code = u32::from(analog_code(kind)) << 24;
        out.extend((code | factor.cast_unsigned() & FACTOR_MAX).to_be_bytes());
    }
    for word in &pmu.digitals {
        out.extend(word.normal.to_be_bytes());
        out.extend(word.valid.to_be_bytes());
    }
    out.extend(pmu.nominal.0.to_be_bytes());
    out.extend(pmu.changes.to_be_bytes());
    Ok(())
}

fn check_factor(field: &'static str, found: i64, low: i64, high: i64) -> Result<(), EncodeError> {
    if (low..=high).contains(&found) {
        Ok(())
    } else {
        let expected = "a number of 24 bits";
        Err(EncodeError::Value {
            field,
            found,
            expected,
        })
    }
}
