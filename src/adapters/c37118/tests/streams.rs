//! Frames out of byte streams, whole, cut and with garbage.

use super::fixture::{configuration, data, prefix};
use crate::adapters::c37118::{
    Command, CommandFrame, ConfigurationKind, Format, StreamCounters, StreamDecoder, Timestamp,
};

fn frames() -> Vec<Vec<u8>> {
    let configuration = configuration(ConfigurationKind::Configuration2, &[Format(0), Format(15)]);
    let mut frames = configuration.encode().unwrap();
    for index in 0..5 {
        let mut frame = data(&configuration);
        frame.prefix.time = Timestamp {
            fraction: 20_000 * index,
            ..prefix().time
        };
        frames.push(frame.encode(&configuration).unwrap());
    }
    let command = CommandFrame {
        prefix: prefix(),
        command: Command::DataOff,
    };
    frames.push(command.encode().unwrap());
    frames
}

/// All frames of `bytes`, pushed in pieces of `piece` bytes.
fn cut(bytes: &[u8], piece: usize) -> (Vec<Vec<u8>>, StreamDecoder) {
    let mut decoder = StreamDecoder::new();
    let mut found = Vec::new();
    for piece in bytes.chunks(piece) {
        decoder.push(piece);
        while let Some(frame) = decoder.next_frame() {
            found.push(frame);
        }
    }
    (found, decoder)
}

fn assert_all_counted(decoder: &StreamDecoder) {
    let StreamCounters {
        bytes,
        frame_bytes,
        skipped_bytes,
        ..
    } = decoder.counters();
    assert_eq!(
        bytes,
        frame_bytes + skipped_bytes + decoder.held_bytes() as u64
    );
}

#[test]
fn frames_come_out_whole_however_the_bytes_arrive() {
    let frames = frames();
    for piece in [1, 2, 3, 7, 100, 100_000] {
        let (found, decoder) = cut(&frames.concat(), piece);
        assert_eq!(found, frames);
        assert_eq!(decoder.held_bytes(), 0);
        let counters = decoder.counters();
        assert_eq!((counters.frames, counters.skipped_bytes), (7, 0));
        assert_eq!(counters.resynchronisations, 0);
    }
}

#[test]
fn garbage_between_frames_is_skipped_and_counted() {
    let frames = frames();
    let mut bytes = b"SSH-2.0\r\n".to_vec();
    bytes.extend(&frames[0]);
    bytes.extend(&frames[1][..30]);
    bytes.extend(&frames[2]);
    bytes.extend(&frames[3]);
    let mut flipped = frames[4].clone();
    flipped[20] ^= 1;
    bytes.extend(&flipped);
    bytes.extend(&frames[5]);
    for piece in [1, 5, 64, 10_000] {
        let (found, decoder) = cut(&bytes, piece);
        assert_eq!(found, [0, 2, 3, 5].map(|i| frames[i].clone()), "{piece}");
        let counters = decoder.counters();
        assert_eq!(counters.skipped_bytes, 9 + 30 + flipped.len() as u64);
        assert_eq!(counters.resynchronisations, 3);
        assert!(counters.bad_checksums >= 2, "{counters:?}");
        assert_all_counted(&decoder);
    }
}

#[test]
fn false_head_does_not_hold_up_the_frames_behind_it() {
    let frames = frames();
    // Garbage first, so that the decoder is looking; then a head that promises 64 000 bytes.
    let bytes = [&[0, 0xaa, 0x01, 0xfa, 0x00][..], &frames.concat()].concat();
    let (found, decoder) = cut(&bytes, 11);
    assert_eq!(found, frames);
    assert_eq!(decoder.counters().skipped_bytes, 5);
    let mut limited = StreamDecoder::with_limit(2000);
    limited.push(&bytes[1..]);
    assert_eq!(limited.next_frame().as_ref(), frames.first());
}

#[test]
fn rest_of_a_broken_connection_is_forgotten_and_counted() {
    let frames = frames();
    let mut decoder = StreamDecoder::new();
    decoder.push(&frames[0][..50]);
    assert_eq!(decoder.next_frame(), None);
    decoder.reset();
    decoder.push(&frames[1]);
    assert_eq!(decoder.next_frame().as_ref(), frames.get(1));
    assert_eq!(decoder.counters().skipped_bytes, 50);
    assert_all_counted(&decoder);
}
