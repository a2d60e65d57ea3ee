//! Single frames: published ones, round trips in every format, and malformed ones.

use super::fixture::{bytes, configuration, data, formats, prefix};
use crate::adapters::c37118::{
    AnalogScaling, AssemblyError, Command, CommandFrame, Configuration, ConfigurationAssembler,
    ConfigurationKind, DataFrame, EncodeError, Error, Format, Frame, FrameKind, HeaderFrame,
    PhasorScaling, Reason, Version, checksum::crc_ccitt, decode,
};

/// CFG-2 of the example in annex D of IEEE C37.118.2-2011 (annex H of 2005), from its table of
/// values.
fn published_configuration() -> Vec<u8> {
    let mut frame = bytes("aa3101c61e36 44852770 56071098 000f4240 0001");
    frame[6..10].copy_from_slice(&0x4485_27f0_u32.to_be_bytes());
    let padded = |name: &str| format!("{name:<16}").into_bytes();
    frame.extend(padded("Station A"));
    frame.extend(bytes("1e36 0004 0004 0003 0001"));
    for name in ["VA", "VB", "VC", "I1", "ANALOG1", "ANALOG2", "ANALOG3"] {
        frame.extend(padded(name));
    }
    for digit in "123456789ABCDEFG".chars() {
        frame.extend(padded(&format!("BREAKER {digit} STATUS")));
    }
    frame.extend(bytes("000df847 000df847 000df847 0100b2d0"));
    frame.extend(bytes(
        "00000001 01000001 02000001 0000ffff 0000 0016 001e d5d1",
    ));
    frame
}

/// The data frame of the same example.
const PUBLISHED_DATA: &str = "aa010034 1e36 44853600 000041b1 0000 392b0000 e36ace7c e36a3183 \
    04440000 09c4 0000 42c80000 447a0000 461c4000 3c12 d43f";

fn as_configuration(frame: Frame) -> Configuration {
    match frame {
        Frame::Configuration(configuration) => configuration,
        other => panic!("{other:?}"),
    }
}

fn as_data(frame: Frame, configuration: &Configuration) -> DataFrame {
    match frame {
        Frame::Data(message) => message.decode(configuration).unwrap(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn published_frames_decode_to_the_printed_values_and_encode_to_the_printed_bytes() {
    let configuration = as_configuration(decode(&published_configuration()).unwrap());
    assert_eq!(configuration.encode().unwrap(), [published_configuration()]);
    let pmu = &configuration.pmus[0];
    assert_eq!(configuration.prefix.version, Version::Y2005);
    assert_eq!(configuration.rate.frames_per_second(), Some(30.0));
    assert_eq!((pmu.station.as_str(), pmu.id_code), ("Station A", 7734));
    assert_eq!(pmu.phasors[3].scaling, PhasorScaling::PerBit(45_776));
    assert_eq!(pmu.digitals[0].names[15], "BREAKER G STATUS");
    assert_eq!((pmu.nominal.hz(), pmu.changes), (60.0, 22));

    let frame = bytes(PUBLISHED_DATA);
    let data = as_data(decode(&frame).unwrap(), &configuration);
    assert_eq!(data.encode(&configuration).unwrap(), frame);
    let [measured] = data.pmus.as_slice() else {
        panic!("one PMU")
    };
    // 14635 steps of 9.15527 V are 133.987 kV; 1092 of 0.45776 A are 499.874 A; 60 Hz + 2500 mHz.
    let expected = [
        (133_987.4, 0.0),
        (134_002.0, -120.0),
        (134_002.0, 120.0),
        (499.874, 0.0),
    ];
    for ((channel, phasor), (magnitude, angle_deg)) in
        pmu.phasors.iter().zip(&measured.phasors).zip(expected)
    {
        let value = channel.value(*phasor);
        assert!(
            (value.magnitude() / magnitude - 1.0).abs() < 1e-4,
            "{value:?}"
        );
        assert!(
            (value.angle_rad().to_degrees() - angle_deg).abs() < 5e-3,
            "{value:?}"
        );
    }
    assert!((measured.frequency_hz(60.0) - 62.5).abs() < 1e-12);
    assert!(measured.rocof_hz_per_s().abs() < 1e-12);
    let analogs: Vec<f64> = measured.analogs.iter().map(|n| n.value()).collect();
    assert_eq!(analogs, [100.0, 1000.0, 10_000.0]);
    assert_eq!(measured.digitals, [0x3c12]);
    assert_eq!(
        data.prefix.time.utc_ns(configuration.time_base),
        Some(1_149_580_800_016_817_000)
    );
}

#[test]
fn every_format_and_kind_comes_back_as_it_was_written() {
    for kind in [
        ConfigurationKind::Configuration1,
        ConfigurationKind::Configuration2,
    ] {
        let written = configuration(kind, &formats());
        let frames = written.encode().unwrap();
        assert_eq!(as_configuration(decode(&frames[0]).unwrap()), written);
        let measured = data(&written);
        let frame = measured.encode(&written).unwrap();
        assert_eq!(frame.len(), 16 + written.data_bytes());
        assert_eq!(as_data(decode(&frame).unwrap(), &written), measured);
    }
    let written = configuration(ConfigurationKind::Configuration3, &formats());
    let frames = written.encode().unwrap();
    assert_eq!(assemble(&frames).unwrap(), Some(written));
}

fn assemble(frames: &[Vec<u8>]) -> Result<Option<Configuration>, AssemblyError> {
    let mut assembler = ConfigurationAssembler::new();
    let mut last = None;
    for frame in frames {
        let Frame::ConfigurationPart(part) = decode(frame)? else {
            panic!("no CFG-3")
        };
        last = assembler.push(part)?;
    }
    Ok(last)
}

#[test]
fn long_configuration_is_sent_in_parts_that_only_fit_in_order() {
    let mut written = configuration(ConfigurationKind::Configuration3, &[Format(0); 120]);
    for pmu in &mut written.pmus {
        for channel in &mut pmu.phasors {
            channel.name = "\u{6bcd}\u{7ebf}".repeat(42);
        }
    }
    let frames = written.encode().unwrap();
    assert_eq!(frames.len(), 4);
    let read = assemble(&frames).unwrap().unwrap();
    assert_eq!(read.pmus, written.pmus);
    let error = assemble(&[frames[0].clone(), frames[2].clone()]).unwrap_err();
    assert_eq!(
        error.to_string(),
        "part 3 of a CFG-3 arrived where part 2 was due"
    );
    assert!(assemble(&frames[1..2]).is_err());
    let cut = assemble(&[frames[0].clone(), frames[3].clone()]).unwrap_err();
    assert!(matches!(cut, AssemblyError::Malformed(_)), "{cut}");
}

#[test]
fn header_and_commands_come_back_as_they_were_written() {
    let header = HeaderFrame {
        prefix: prefix(),
        text: "station K\u{f6}ln, 110 kV".to_owned(),
    };
    assert_eq!(decode(&header.encode().unwrap()), Ok(Frame::Header(header)));
    let commands = [
        Command::DataOff,
        Command::DataOn,
        Command::SendHeader,
        Command::SendConfiguration1,
        Command::SendConfiguration2,
        Command::SendConfiguration3,
        Command::Extended(vec![1, 2, 3, 4]),
        Command::Other(0x0100),
    ];
    for command in commands {
        let prefix = prefix();
        let frame = CommandFrame { prefix, command };
        assert_eq!(decode(&frame.encode().unwrap()), Ok(Frame::Command(frame)));
    }
}

/// The frame with `change` made and its length and check word put right.
fn resealed(frame: &[u8], change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut changed = frame[..frame.len() - 2].to_vec();
    change(&mut changed);
    let length = u16::try_from(changed.len() + 2).unwrap();
    changed[2..4].copy_from_slice(&length.to_be_bytes());
    let check = crc_ccitt(&changed);
    changed.extend(check.to_be_bytes());
    changed
}

#[test]
fn malformed_frames_are_refused_with_byte_and_field() {
    let good = published_configuration();
    let check = |frame: &[u8], expected: &str| {
        let error = decode(frame).unwrap_err();
        assert_eq!(error.to_string(), expected);
    };
    check(&[], "frame, byte 0, SYNC: needs 1 bytes, 0 are left");
    check(&good[1..], "frame, byte 0, SYNC: 49 is not 0xAA");
    check(
        &good[..100],
        "CFG-2 frame, byte 2, FRAMESIZE: says 454 bytes, 100 were received",
    );
    let mut flipped = good.clone();
    flipped[200] ^= 4;
    assert!(matches!(
        decode(&flipped).unwrap_err().reason,
        Reason::Checksum { .. }
    ));
    check(
        &resealed(&good, |f| f[1] = 0x33),
        "frame, byte 1, SYNC: 51 is not version 1 (2005) or 2 (2011) (bits 3 to 0)",
    );
    check(
        &resealed(&good, |f| f[1] = 0x61),
        "frame, byte 1, SYNC: 97 is not a frame type of 0 to 5 (bits 6 to 4) below a zero bit 7",
    );
    check(
        &resealed(&good, |f| f[14..18].fill(0)),
        "CFG-2 frame, byte 14, TIME_BASE: 0 is not a number of parts of a second",
    );
    check(
        &resealed(&good, |f| f[19] = 0),
        "CFG-2 frame, byte 18, NUM_PMU: 0 is not at least one PMU",
    );
    check(
        &resealed(&good, |f| f[40] = 0xff),
        "CFG-2 frame, byte 46, CHNAM: needs 1044848 bytes, 406 are left",
    );
    check(
        &resealed(&good, |f| f[41] = 3),
        "CFG-2 frame, byte 432, CHK: the last field is followed by 20 bytes that nothing describes",
    );
    check(
        &resealed(&good, |f| f.extend([0; 6])),
        "CFG-2 frame, byte 452, CHK: the last field is followed by 6 bytes that nothing describes",
    );
    let command = CommandFrame {
        prefix: prefix(),
        command: Command::DataOn,
    };
    check(
        &resealed(&command.encode().unwrap(), |f| f.push(0)),
        "command frame, byte 16, CHK: the last field is followed by 1 bytes that nothing describes",
    );
}

#[test]
fn data_that_do_not_fit_the_configuration_are_refused() {
    let configuration = as_configuration(decode(&published_configuration()).unwrap());
    let refusal = |frame: &[u8]| -> Error {
        let Frame::Data(message) = decode(frame).unwrap() else {
            panic!("no data")
        };
        message.decode(&configuration).unwrap_err()
    };
    let data = bytes(PUBLISHED_DATA);
    assert_eq!(
        refusal(&resealed(&data, |f| f.extend([0; 4]))).to_string(),
        "data frame, byte 14, data: has 40 bytes of data, the configuration describes 36"
    );
    assert_eq!(
        refusal(&resealed(&data, |f| f[5] = 1)).to_string(),
        "data frame, byte 4, IDCODE: is of stream 7681, the configuration is of stream 7734"
    );
}

#[test]
fn names_in_another_code_page_and_padded_with_zeros_are_read() {
    let frame = resealed(&published_configuration(), |f| {
        f[20..36].copy_from_slice(b"K\xf6ln\0\0\0\0\0\0\0\0\0\0\0\0");
    });
    let configuration = as_configuration(decode(&frame).unwrap());
    assert_eq!(configuration.pmus[0].station, "K\u{f6}ln");
}

#[test]
fn what_does_not_fit_the_layout_is_not_written() {
    let mut long = configuration(ConfigurationKind::Configuration2, &[Format(0)]);
    long.pmus[0].station = "a name of 20 letters".to_owned();
    let error = long.encode().unwrap_err();
    assert_eq!(
        error.to_string(),
        "STN `a name of 20 letters` has 20 bytes, the field has room for 16"
    );
    let mut mixed = configuration(ConfigurationKind::Configuration3, &[Format(0)]);
    mixed.kind = ConfigurationKind::Configuration2;
    assert!(matches!(
        mixed.encode(),
        Err(EncodeError::WrongKind {
            kind: FrameKind::Configuration2,
            ..
        })
    ));
    let mut factor = configuration(ConfigurationKind::Configuration2, &[Format(0)]);
    factor.pmus[0].phasors[0].scaling = PhasorScaling::PerBit(1 << 24);
    assert!(factor.encode().is_err());
    if let AnalogScaling::User { factor, .. } = &mut long.pmus[0].analogs[0].scaling {
        *factor = 1 << 23;
    }
    long.pmus[0].station.clear();
    assert!(long.encode().is_err());
    let empty = configuration(ConfigurationKind::Configuration2, &[]);
    assert!(empty.encode().is_err());
    let two = configuration(ConfigurationKind::Configuration2, &[Format(0), Format(15)]);
    let one = configuration(ConfigurationKind::Configuration2, &[Format(15), Format(15)]);
    let error = data(&two).encode(&one).unwrap_err();
    assert_eq!(
        error.to_string(),
        "PMU 1 of the data: PHASORS is not as configured"
    );
}
