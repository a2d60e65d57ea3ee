//! What a fuzzer does with each parser: every input is read or refused, and what was read holds together.
//! The fuzz targets call these functions, and so does a test with mutants of the corpus.
#![allow(
    dead_code,
    unreachable_pub,
    clippy::panic,
    reason = "each target uses one of them, and a violation has to end the fuzzer"
)]

use loadmodeld::{
    adapters::{
        c37118::{Frame, FrameIntake, FrameOutcome, LoadMapping, PhasorSet, StreamDecoder, decode},
        recordings::comtrade,
        wire::{
            Encoding,
            v1::{BatchLimits, RecordingLimits, decode_batch, decode_recording},
        },
    },
    config::Config,
    load_model::user_effects::EffectFile,
    measurement::{SampleBatch, Site},
};

/// A function that tries one input.
pub type Parser = fn(&[u8]);

/// Every parser by the name of its target and of its folder of the corpus.
pub const ALL: [(&str, Parser); 8] = [
    ("c37118_frame", c37118_frame),
    ("c37118_stream", c37118_stream),
    ("c37118_messages", c37118_messages),
    ("comtrade", comtrade),
    ("sample_batch", sample_batch),
    ("recording", recording),
    ("configuration", configuration),
    ("effect_file", effect_file),
];

/// One frame. What is read has a right check word, and a command is written back byte for byte.
pub fn c37118_frame(bytes: &[u8]) {
    let decoded = decode(bytes);
    if decoded.is_ok() {
        let (checked, word) = bytes.split_at(bytes.len() - 2);
        assert_eq!(
            check_word(checked),
            word,
            "a frame with a wrong check word was read"
        );
    }
    let written = match decoded {
        Ok(Frame::Command(command)) => command.encode(),
        Ok(Frame::Configuration(configuration)) => {
            // A reserved code may have no place in what is written.
            configuration.encode().ok();
            return;
        }
        Ok(_) | Err(_) => return,
    };
    assert_eq!(written.as_deref(), Ok(bytes));
}

/// CRC-CCITT, bit by bit (annex B), by other means than the parser's.
pub fn check_word(bytes: &[u8]) -> [u8; 2] {
    let bit = |crc: u16| {
        let carry = crc & 0x8000 != 0;
        (crc << 1) ^ if carry { 0x1021 } else { 0 }
    };
    let crc = bytes.iter().fold(0xffff_u16, |crc, byte| {
        (0..8).fold(crc ^ (u16::from(*byte) << 8), |crc, _| bit(crc))
    });
    crc.to_be_bytes()
}

/// Bytes of a connection, in pieces as long as the first byte says. Every byte is accounted for.
pub fn c37118_stream(bytes: &[u8]) {
    let Some((&length, rest)) = bytes.split_first() else {
        return;
    };
    let mut decoder = StreamDecoder::new();
    for piece in rest.chunks(usize::from(length) + 1) {
        decoder.push(piece);
        while let Some(frame) = decoder.next_frame() {
            c37118_frame(&frame);
        }
    }
    let counters = decoder.counters();
    let seen = counters.frame_bytes + counters.skipped_bytes + decoder.held_bytes() as u64;
    assert_eq!(counters.bytes, seen);
}

/// Messages of one stream, cut in the middle. Every sample is counted.
pub fn c37118_messages(bytes: &[u8]) {
    let set = |name: &str| PhasorSet::PositiveSequence(name.to_owned());
    let mapping = LoadMapping::new(set("V1"), set("I1"));
    let mut intake = FrameIntake::new(&site(), "pmu", &mapping);
    for message in [&bytes[..bytes.len() / 2], &bytes[bytes.len() / 2..], bytes] {
        let taken = intake.take(message);
        let samples: usize = taken.batches.iter().map(SampleBatch::len).sum();
        assert_eq!(samples as u64, taken.counts.of(FrameOutcome::Sample));
    }
}

/// A COMTRADE file in one piece, or configuration and data parted by a zero byte.
pub fn comtrade(bytes: &[u8]) {
    let options = comtrade::Options::default();
    comtrade::decode_container(bytes, &options).ok();
    if let Some(at) = bytes.iter().position(|byte| *byte == 0) {
        comtrade::decode(&bytes[..at], &bytes[at + 1..], &options).ok();
    }
}

/// A sample batch. What was taken has as many values in every channel.
pub fn sample_batch(bytes: &[u8]) {
    let limits = BatchLimits::default();
    if let Ok(batch) = decode_batch(bytes, Encoding::Unknown, &site(), &limits) {
        let length = batch.len();
        assert!(length > 0 && batch.channels.iter().all(|(_, v)| v.len() == length));
    }
}

/// A recording as it comes over zenoh.
pub fn recording(bytes: &[u8]) {
    decode_recording(bytes, &RecordingLimits::default()).ok();
}

/// A configuration file.
pub fn configuration(bytes: &[u8]) {
    if let Ok(text) = std::str::from_utf8(bytes) {
        Config::parse(text, "fuzz.toml").ok();
    }
}

/// An effect file. What is told of it lies in the text.
pub fn effect_file(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return;
    };
    let lines = 1 + text.matches('\n').count();
    let told = match EffectFile::parse(text) {
        Ok(file) => file.warnings().to_vec(),
        Err(problems) => {
            assert!(!problems.is_empty(), "a file was refused without a reason");
            problems
        }
    };
    assert!(
        told.iter()
            .all(|p| (1..=lines).contains(&p.line) && p.column > 0)
    );
}

fn site() -> Site {
    Site {
        name: "site-01".to_owned(),
        s_base_mva: 40.0,
        v_base_kv: 110.0,
        nominal_hz: 60.0,
    }
}
