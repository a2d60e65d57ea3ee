//! Frames written here, read by tshark, where it is installed.

use std::{fs, process::Command};

use super::{
    captures::{in_tshark_words, out_of_tshark},
    fixture::{configuration, data, formats, prefix},
};
use crate::adapters::c37118::{
    Command as Asked, CommandFrame, ConfigurationKind, Format, HeaderFrame, Status, TimeQuality,
};

/// Raw IP packets (`LINKTYPE_RAW`).
const LINK_TYPE: u32 = 101;
/// The port that tshark takes for synchrophasors.
const PORT: u16 = 4713;

/// A capture of one UDP datagram per frame; each conversation has a port of its own, because a data frame is
/// read by the configuration before it.
fn capture(conversations: &[Vec<Vec<u8>>]) -> Vec<u8> {
    let mut file = Vec::new();
    for word in [0xa1b2_c3d4, 2 | 4 << 16, 0, 0, 65_535, LINK_TYPE] {
        file.extend(u32::to_le_bytes(word));
    }
    for (client, frames) in (50_000_u16..).zip(conversations) {
        for frame in frames {
            let length = u16::try_from(frame.len()).unwrap();
            let mut packet = vec![0x45, 0];
            packet.extend((28 + length).to_be_bytes());
            packet.extend([0, 0, 0, 0, 64, 17, 0, 0, 127, 0, 0, 1, 127, 0, 0, 1]);
            for half in [PORT, client, 8 + length, 0] {
                packet.extend(half.to_be_bytes());
            }
            packet.extend(frame);
            let size = u32::from(length) + 28;
            for word in [1_700_000_000, 0, size, size] {
                file.extend(word.to_le_bytes());
            }
            file.extend(packet);
        }
    }
    file
}

/// What tshark says of it; none, and said so, where there is no tshark.
fn dissected(capture: &[u8]) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames.pcap");
    fs::write(&path, capture).unwrap();
    let tshark = Command::new("tshark")
        .args(["-n", "-V", "-O", "synphasor", "-r"])
        .arg(&path)
        .output();
    let Ok(output) = tshark else {
        println!("SKIPPED: frames in the eyes of tshark (it is not installed; Debian: tshark)");
        return None;
    };
    let words = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{words}");
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

#[test]
fn frames_written_here_have_good_check_words_and_the_same_values_for_tshark() {
    let (mut conversations, mut expected) = (Vec::new(), Vec::new());
    let two = [Format(0), Format(0b1111)];
    let one = formats().into_iter().map(|format| vec![format]);
    for formats in one.chain([two.to_vec()]) {
        for kind in [
            ConfigurationKind::Configuration2,
            ConfigurationKind::Configuration3,
        ] {
            let configuration = configuration(kind, &formats);
            let mut frame = data(&configuration);
            // A leap second is pending, the clock is within 1 us, and the second PMU's data are invalid.
            frame.prefix.time.quality = TimeQuality(0x14);
            if let Some(second) = frame.pmus.get_mut(1) {
                second.status = Status(0x8000);
            }
            let mut frames = configuration.encode().unwrap();
            frames.push(frame.encode(&configuration).unwrap());
            conversations.push(frames);
            expected.push(in_tshark_words(&configuration, &frame));
        }
    }
    let header = HeaderFrame {
        prefix: prefix(),
        text: "a header".to_owned(),
    };
    let ask = |command| CommandFrame {
        prefix: prefix(),
        command,
    };
    let commands = [
        Asked::DataOff,
        Asked::DataOn,
        Asked::SendHeader,
        Asked::SendConfiguration2,
    ];
    let mut others: Vec<_> = commands.map(|c| ask(c).encode().unwrap()).to_vec();
    others.push(header.encode().unwrap());
    conversations.push(others);

    let Some(text) = dissected(&capture(&conversations)) else {
        return;
    };
    let frames: usize = conversations.iter().map(Vec::len).sum();
    assert_eq!(
        text.matches("Checksum Status: Good").count(),
        frames,
        "{text}"
    );
    assert!(!text.contains("Malformed"), "{text}");
    let found = out_of_tshark(&text);
    assert_eq!(found.len(), expected.len(), "{text}");
    let mut compared = 0;
    for (found, expected) in found.iter().zip(&expected) {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            // Printed with three decimals or six digits.
            let tolerance = 6e-4 + 6e-6 * expected.abs();
            assert!(
                (found - expected).abs() <= tolerance,
                "{found}, not {expected}"
            );
            compared += 1;
        }
    }
    println!("{frames} frames, {compared} numbers compared");
    assert!(compared > 500, "{compared}");
}
