//! Changed frames and streams: read or refused, never a panic, never a wrong check word accepted.

use super::fixture::{configuration, data, formats, prefix};
use crate::adapters::c37118::{
    Command, CommandFrame, Configuration, ConfigurationAssembler, ConfigurationKind, Converter,
    Dialogue, DialogueOptions, Frame, FrameIntake, FrameOutcome, HeaderFrame, LoadMapping,
    PhasorSet, StreamDecoder, checksum::crc_ccitt, decode,
};
use crate::measurement::{SampleBatch, Site};

/// A linear congruential generator (Knuth, MMIX): the mutants are the same in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(self.0 >> 33).unwrap() % bound.max(1)
    }

    fn byte(&mut self) -> u8 {
        u8::try_from(self.below(256)).unwrap()
    }
}

/// Changes one to four places: another byte, a flipped bit, a telling value, an insertion, a
/// deletion, a cut or a repetition.
fn mutate(random: &mut Random, original: &[u8]) -> Vec<u8> {
    const TELLING: [u8; 6] = [0x00, 0xff, 0xaa, 0x01, 0x80, 0x7f];
    let mut bytes = original.to_vec();
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        match random.below(7) {
            0 if !bytes.is_empty() => bytes[at] = random.byte(),
            1 if !bytes.is_empty() => bytes[at] ^= 1 << random.below(8),
            2 if !bytes.is_empty() => bytes[at] = TELLING[random.below(TELLING.len())],
            3 => bytes.insert(at, random.byte()),
            4 if !bytes.is_empty() => drop(bytes.remove(at)),
            5 => bytes.truncate(at),
            _ => {
                let length = random.below(40).min(bytes.len() - at);
                let copy = bytes[at..at + length].to_vec();
                bytes.splice(at..at, copy);
            }
        }
    }
    bytes
}

/// Puts length and check word right, so that the mutant gets past them.
fn reseal(bytes: &mut [u8]) {
    if let (Ok(length), true) = (u16::try_from(bytes.len()), bytes.len() > 16) {
        bytes[2..4].copy_from_slice(&length.to_be_bytes());
        let (checked, check) = bytes.split_at_mut(usize::from(length) - 2);
        check.copy_from_slice(&crc_ccitt(checked).to_be_bytes());
    }
}

struct Bench {
    seeds: Vec<Vec<u8>>,
    configurations: Vec<Configuration>,
    site: Site,
    mapping: LoadMapping,
    intake: FrameIntake,
    dialogue: Dialogue,
    accepted: u64,
    refused: u64,
}

impl Bench {
    fn new() -> Self {
        let all = &formats()[..];
        let configurations = vec![
            configuration(ConfigurationKind::Configuration2, &all[..2]),
            configuration(ConfigurationKind::Configuration2, &all[15..]),
            configuration(ConfigurationKind::Configuration3, &all[6..9]),
        ];
        let mut seeds: Vec<Vec<u8>> = Vec::new();
        for configuration in &configurations {
            seeds.extend(configuration.encode().unwrap());
            seeds.push(data(configuration).encode(configuration).unwrap());
        }
        let text = "header of a station".to_owned();
        let prefix = prefix();
        seeds.push(HeaderFrame { prefix, text }.encode().unwrap());
        for command in [Command::DataOn, Command::Extended(vec![1, 2, 3, 4])] {
            seeds.push(CommandFrame { prefix, command }.encode().unwrap());
        }
        let set = |name: &str| PhasorSet::PositiveSequence(name.to_owned());
        let site = Site {
            name: "north".to_owned(),
            s_base_mva: 100.0,
            v_base_kv: 110.0,
            nominal_hz: 50.0,
        };
        let mapping = LoadMapping::new(set("V1"), set("IA"));
        Self {
            seeds,
            configurations,
            intake: FrameIntake::new(&site, "pmu", &mapping),
            dialogue: Dialogue::new(DialogueOptions::default()),
            site,
            mapping,
            accepted: 0,
            refused: 0,
        }
    }

    /// One mutant of each seed, every other one with its check word put right.
    fn round(&mut self, random: &mut Random) {
        for index in 0..self.seeds.len() {
            let mut mutant = mutate(random, &self.seeds[index]);
            if random.below(2) == 0 {
                reseal(&mut mutant);
            }
            self.try_one(&mutant);
            self.converse(mutant);
        }
    }

    /// A message and a frame of a connection: both ends keep what configurations say.
    fn converse(&mut self, mutant: Vec<u8>) {
        const NOW_MS: i64 = 1_700_000_000_000;
        let taken = self.intake.take(&mutant);
        let outcomes = FrameOutcome::ALL.map(|outcome| taken.counts.of(outcome));
        let frames: u64 = outcomes.iter().sum();
        assert!(frames > 0 || mutant.is_empty(), "{mutant:x?}");
        let samples: usize = taken.batches.iter().map(SampleBatch::len).sum();
        let counted = taken.counts.of(FrameOutcome::Sample);
        assert_eq!(samples as u64, counted);
        self.dialogue.frame(mutant, NOW_MS);
    }

    fn try_one(&mut self, mutant: &[u8]) {
        match decode(mutant) {
            Ok(frame) => {
                let (checked, check) = mutant.split_at(mutant.len() - 2);
                assert_eq!(crc_ccitt(checked).to_be_bytes(), check);
                self.accepted += 1;
                self.use_frame(frame);
            }
            Err(error) => {
                assert!(error.offset <= mutant.len(), "{error}");
                self.refused += 1;
            }
        }
    }

    /// Everything that is done with a frame.
    fn use_frame(&self, frame: Frame) {
        let configured = |configuration: &Configuration| {
            // A configuration that was read can be written, unless two names of it cannot.
            drop(configuration.encode());
            drop(Converter::new(configuration, &self.mapping, &self.site));
        };
        match frame {
            Frame::Data(message) => {
                for configuration in &self.configurations {
                    let Ok(data) = message.decode(configuration) else {
                        continue;
                    };
                    if let Ok(converter) = Converter::new(configuration, &self.mapping, &self.site)
                    {
                        drop(converter.sample(&data));
                    }
                }
            }
            Frame::Configuration(configuration) => configured(&configuration),
            Frame::ConfigurationPart(part) => {
                if let Ok(Some(read)) = ConfigurationAssembler::new().push(part) {
                    configured(&read);
                }
            }
            Frame::Header(header) => assert!(!header.encode().unwrap().is_empty()),
            Frame::Command(command) => assert!(!command.encode().unwrap().is_empty()),
        }
    }

    fn streams(&self, random: &mut Random) {
        let mut bytes = Vec::new();
        for _ in 0..4 {
            let seed = &self.seeds[random.below(self.seeds.len())];
            match random.below(3) {
                0 => bytes.extend(mutate(random, seed)),
                _ => bytes.extend(seed),
            }
        }
        let mut decoder = StreamDecoder::new();
        let piece = 1 + random.below(700);
        for piece in bytes.chunks(piece) {
            decoder.push(piece);
            while let Some(frame) = decoder.next_frame() {
                let (checked, check) = frame.split_at(frame.len() - 2);
                assert_eq!(crc_ccitt(checked).to_be_bytes(), check);
            }
        }
        let counters = decoder.counters();
        let seen = counters.frame_bytes + counters.skipped_bytes + decoder.held_bytes() as u64;
        assert_eq!(counters.bytes, seen);
    }
}

fn run(rounds: usize) {
    let mut bench = Bench::new();
    let mut random = Random(20_260_118);
    for _ in 0..rounds {
        bench.round(&mut random);
        bench.streams(&mut random);
    }
    println!("{} accepted, {} refused", bench.accepted, bench.refused);
    assert!(bench.accepted > 100 && bench.refused > 100);
}

#[test]
fn mutants_are_read_or_refused_but_never_panic() {
    run(1000);
}

#[test]
#[ignore = "a million mutated frames and a hundred thousand streams: by hand, in release"]
fn a_million_mutants_are_read_or_refused_but_never_panic() {
    run(111_112);
}
