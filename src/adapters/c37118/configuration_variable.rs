//! The layout of CFG-3 (6.4, tables 10 to 12): names of any length, scale factors, place, and
//! parts of one configuration in several frames.

use super::{
    bytes::{Reader, count},
    channel::{
        AnalogChannel, AnalogScaling, DigitalWord, PhasorChannel, PhasorComponent, PhasorQuantity,
        PhasorScaling,
    },
    configuration::{
        self, Configuration, ConfigurationKind, DataRate, Format, LocationAndFilter,
        NominalFrequencyCode, PmuConfiguration,
    },
    error::{EncodeError, Error},
    frame::{self, CHECK_BYTES, FRAME_BYTES_MAX, FrameKind, PREFIX_BYTES, Prefix},
    name,
};

/// Bit of the third byte of PHSCALE that says "current".
const CURRENT: u8 = 0x08;
/// Bytes of `CONT_IDX`.
const INDEX_BYTES: usize = 2;
/// `CONT_IDX` of the only frame.
pub(super) const INDEX_ONLY: u16 = 0;
/// `CONT_IDX` of the first of several frames.
pub(super) const INDEX_FIRST: u16 = 1;
/// `CONT_IDX` of the last of several frames.
pub(super) const INDEX_LAST: u16 = u16::MAX;

/// One frame of a CFG-3.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ConfigurationPart {
    /// What the frame says about itself.
    pub prefix: Prefix,
    /// `CONT_IDX`: 0 for an only frame, else 1, 2 and so on, 65535 for the last.
    pub index: u16,
    /// The bytes after `CONT_IDX`.
    pub bytes: Vec<u8>,
}

impl ConfigurationPart {
    /// Whether the frame is the first or only one of its configuration.
    #[must_use]
    pub const fn is_first(&self) -> bool {
        self.index == INDEX_ONLY || self.index == INDEX_FIRST
    }

    pub(super) fn read(prefix: Prefix, reader: &mut Reader<'_>) -> Result<Self, Error> {
        Ok(Self {
            prefix,
            index: reader.u16("CONT_IDX")?,
            bytes: reader.rest().to_vec(),
        })
    }
}

/// Reads the joined bytes of all parts.
pub(super) fn read(prefix: Prefix, bytes: &[u8]) -> Result<Configuration, Error> {
    let mut reader = Reader::new(bytes, 0, Some(FrameKind::Configuration3));
    let (time_base_flags, time_base) = configuration::time_base(&mut reader)?;
    let mut pmus = Vec::new();
    for _ in 0..configuration::pmu_count(&mut reader)? {
        pmus.push(read_pmu(&mut reader)?);
    }
    let rate = DataRate(reader.i16("DATA_RATE")?);
    reader.end("DATA_RATE")?;
    Ok(Configuration {
        prefix,
        kind: ConfigurationKind::Configuration3,
        time_base_flags,
        time_base,
        pmus,
        rate,
    })
}

fn read_pmu(reader: &mut Reader<'_>) -> Result<PmuConfiguration, Error> {
    let station = name::read_variable(reader, "STN")?;
    let id_code = reader.u16("IDCODE")?;
    let global_id = reader.bytes("G_PMU_ID")?;
    let format = Format(reader.u16("FORMAT")?);
    let [phasors, analogs, digitals] = configuration::channel_counts(reader)?;
    let mut names = |count| -> Result<Vec<String>, Error> {
        (0..count)
            .map(|_| name::read_variable(reader, "CHNAM"))
            .collect()
    };
    let phasor_names = names(phasors)?;
    let analog_names = names(analogs)?;
    let mut bit_names = Vec::new();
    for _ in 0..digitals {
        let mut word: [String; 16] = std::array::from_fn(|_| String::new());
        for name in &mut word {
            *name = name::read_variable(reader, "CHNAM")?;
        }
        bit_names.push(word);
    }
    let mut phasors = Vec::new();
    for name in phasor_names {
        phasors.push(read_phasor(reader, name)?);
    }
    let mut analogs = Vec::new();
    for name in analog_names {
        let factor = reader.f32("ANSCALE")?;
        let offset = reader.f32("ANSCALE")?;
        let scaling = AnalogScaling::Affine { factor, offset };
        analogs.push(AnalogChannel { name, scaling });
    }
    let mut digitals = Vec::new();
    for names in bit_names {
        digitals.push(DigitalWord {
            names,
            normal: reader.u16("DIGUNIT")?,
            valid: reader.u16("DIGUNIT")?,
        });
    }
    let place = LocationAndFilter {
        global_id,
        latitude_deg: reader.f32("PMU_LAT")?,
        longitude_deg: reader.f32("PMU_LON")?,
        elevation_m: reader.f32("PMU_ELEV")?,
        service_class: reader.u8("SVC_CLASS")?,
        window_us: reader.i32("WINDOW")?,
        group_delay_us: reader.i32("GRP_DLY")?,
    };
    Ok(PmuConfiguration {
        station,
        id_code,
        format,
        phasors,
        analogs,
        digitals,
        nominal: NominalFrequencyCode(reader.u16("FNOM")?),
        changes: reader.u16("CFGCNT")?,
        place: Some(place),
    })
}

fn read_phasor(reader: &mut Reader<'_>, name: String) -> Result<PhasorChannel, Error> {
    const FIELD: &str = "PHSCALE";
    let modification = reader.u16(FIELD)?;
    let kind = reader.u8(FIELD)?;
    let user = reader.u8(FIELD)?;
    let factor = reader.f32(FIELD)?;
    let angle_rad = reader.f32(FIELD)?;
    Ok(PhasorChannel {
        name,
        quantity: if kind & CURRENT == 0 {
            PhasorQuantity::Voltage
        } else {
            PhasorQuantity::Current
        },
        scaling: PhasorScaling::Affine {
            modification,
            component: PhasorComponent::from_code(kind),
            user,
            factor,
            angle_rad,
        },
    })
}

/// One frame, or as many as it takes.
pub(super) fn write(configuration: &Configuration) -> Result<Vec<Vec<u8>>, EncodeError> {
    const PART_BYTES_MAX: usize = FRAME_BYTES_MAX - PREFIX_BYTES - INDEX_BYTES - CHECK_BYTES;
    let mut bytes = Vec::new();
    configuration.write_time_base(&mut bytes);
    bytes.extend(count("NUM_PMU", configuration.pmus.len())?);
    for pmu in &configuration.pmus {
        write_pmu(pmu, &mut bytes)?;
    }
    bytes.extend(configuration.rate.0.to_be_bytes());
    let parts = bytes.chunks(PART_BYTES_MAX);
    let last = parts.len() - 1;
    let mut frames = Vec::with_capacity(parts.len());
    for (number, part) in parts.enumerate() {
        let index = match number {
            _ if last == 0 => INDEX_ONLY,
            _ if number == last => INDEX_LAST,
            _ => u16::from_be_bytes(count("CONT_IDX", number + usize::from(INDEX_FIRST))?),
        };
        let message = [&index.to_be_bytes(), part].concat();
        let kind = FrameKind::Configuration3;
        frames.push(frame::seal(kind, configuration.prefix, &message)?);
    }
    Ok(frames)
}

fn write_pmu(pmu: &PmuConfiguration, out: &mut Vec<u8>) -> Result<(), EncodeError> {
    let wrong = |field| EncodeError::WrongKind {
        id_code: pmu.id_code,
        field,
        kind: FrameKind::Configuration3,
    };
    let place = pmu.place.ok_or(wrong("an absent place of the PMU"))?;
    name::write_variable(out, &pmu.station, "STN")?;
    out.extend(pmu.id_code.to_be_bytes());
    out.extend(place.global_id);
    out.extend(pmu.format.0.to_be_bytes());
    out.extend(count("PHNMR", pmu.phasors.len())?);
    out.extend(count("ANNMR", pmu.analogs.len())?);
    out.extend(count("DGNMR", pmu.digitals.len())?);
    let phasor_names = pmu.phasors.iter().map(|channel| &channel.name);
    let analog_names = pmu.analogs.iter().map(|channel| &channel.name);
    let bit_names = pmu.digitals.iter().flat_map(|word| &word.names);
    for name in phasor_names.chain(analog_names).chain(bit_names) {
        name::write_variable(out, name, "CHNAM")?;
    }
    for channel in &pmu.phasors {
        write_phasor(channel, out).ok_or(wrong("PHUNIT"))?;
    }
    for channel in &pmu.analogs {
        let AnalogScaling::Affine { factor, offset } = channel.scaling else {
            return Err(wrong("ANUNIT"));
        };
        out.extend(factor.to_be_bytes());
        out.extend(offset.to_be_bytes());
    }
    for word in &pmu.digitals {
        out.extend(word.normal.to_be_bytes());
        out.extend(word.valid.to_be_bytes());
    }
    out.extend(place.latitude_deg.to_be_bytes());
    out.extend(place.longitude_deg.to_be_bytes());
    out.extend(place.elevation_m.to_be_bytes());
    out.push(place.service_class);
    out.extend(place.window_us.to_be_bytes());
    out.extend(place.group_delay_us.to_be_bytes());
    out.extend(pmu.nominal.0.to_be_bytes());
    out.extend(pmu.changes.to_be_bytes());
    Ok(())
}

/// None when the channel has no scaling of CFG-3.
fn write_phasor(channel: &PhasorChannel, out: &mut Vec<u8>) -> Option<()> {
    let PhasorScaling::Affine {
        modification,
        component,
        user,
        factor,
        angle_rad,
    } = channel.scaling
    else {
        return None;
    };
    let current = match channel.quantity {
        PhasorQuantity::Voltage => 0,
        PhasorQuantity::Current => CURRENT,
        PhasorQuantity::Reserved(_) => return None,
    };
    out.extend(modification.to_be_bytes());
    out.extend([current | component.code(), user]);
    out.extend(factor.to_be_bytes());
    out.extend(angle_rad.to_be_bytes());
    Some(())
}
