//! Changed files: read or refused, never a panic.

use super::*;

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
}

/// Changes one to four places: another byte, a digit, a separator, a cut, or a repetition.
fn mutate(random: &mut Random, original: &[u8]) -> Vec<u8> {
    const TELLING: &[u8] = b"0123456789,,\n/:.-+AD\xff\x00 ";
    let mut bytes = original.to_vec();
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        match random.below(6) {
            0 if !bytes.is_empty() => bytes[at] = u8::try_from(random.below(256)).unwrap(),
            1 if !bytes.is_empty() => bytes[at] = TELLING[random.below(TELLING.len())],
            2 => bytes.insert(at, TELLING[random.below(TELLING.len())]),
            3 if !bytes.is_empty() => drop(bytes.remove(at)),
            4 => bytes.truncate(at),
            _ => {
                let length = random.below(20).min(bytes.len() - at);
                let copy = bytes[at..at + length].to_vec();
                bytes.splice(at..at, copy);
            }
        }
    }
    bytes
}

/// Configuration and data of every format and way of telling time.
fn seeds() -> Vec<(String, Vec<u8>)> {
    let tail = "1\n-5h30,0\nB,3\n";
    let binary_32 = binary_data(|v| v.map_or(i32::MIN, i32::from).to_le_bytes().to_vec());
    let float_32 = binary_data(|v| v.map_or(f32::NAN, f32::from).to_le_bytes().to_vec());
    vec![
        (
            configuration(",1999", "ASCII", ONE_RATE, "1\n"),
            ascii_data().into_bytes(),
        ),
        (
            configuration("", "ASCII", "0\n0,5", ""),
            ascii_data().into_bytes(),
        ),
        (
            configuration(",1999", "BINARY", "2\n1000,3\n10,5", "1\n"),
            binary_16(),
        ),
        (
            configuration(",2013", "BINARY32", ONE_RATE, tail),
            binary_32,
        ),
        (configuration(",2013", "FLOAT32", ONE_RATE, tail), float_32),
    ]
}

/// Mutants of each seed, as two files and as a container; what is read is written and read again.
fn run(rounds: usize) {
    let options = Options {
        lenient: true,
        ..Options::default()
    };
    let seeds = seeds();
    let mut random = Random(20_260_101);
    let (mut read, mut refused) = (0_u64, 0_u64);
    let mut count = |result: Result<Recording, Error>| match result {
        Ok(recording) => {
            let samples = recording.len();
            assert!(recording.analog.iter().all(|c| c.values.len() == samples));
            if let Ok(bytes) = encode_container(&recording, DataFormat::Binary32) {
                let again = decode_container(&bytes, &Options::default()).unwrap();
                assert_eq!(again.len(), samples);
            }
            read += 1;
        }
        Err(error) => {
            assert!(!error.to_string().is_empty());
            refused += 1;
        }
    };
    for _ in 0..rounds {
        for (text, data) in &seeds {
            // One part is often left whole: otherwise few mutants get past the configuration.
            let (mut text, mut data) = (text.clone().into_bytes(), data.clone());
            let part = random.below(3);
            if part != 0 {
                text = mutate(&mut random, &text);
            }
            if part != 1 {
                data = mutate(&mut random, &data);
            }
            count(decode(&text, &data, &options));
            let mut container = b"--- file type: CFG ---\n".to_vec();
            container.extend(&text);
            container.extend(b"\n--- file type: DAT BINARY: 40 ---\n");
            container.extend(&data);
            count(decode_container(&mutate(&mut random, &container), &options));
        }
    }
    println!("{read} read, {refused} refused");
    assert!(
        read > 100 && refused > 100,
        "{read} read, {refused} refused"
    );
}

#[test]
fn mutants_are_read_or_refused_but_never_panic() {
    run(2000);
}

#[test]
#[ignore = "a million mutants: by hand, in release"]
fn a_million_mutants_are_read_or_refused_but_never_panic() {
    run(100_000);
}
