//! Files that mean harm, and files that accidents have gone through.

use super::{EffectFile, Problem, tests::SOUND};

fn refused(text: &str) -> Vec<Problem> {
    EffectFile::parse(text).expect_err("a hostile file was accepted")
}

fn with_power(expression: &str) -> String {
    SOUND.replace("k*(v - z)", expression)
}

#[test]
fn deep_nesting_ends_in_an_error() {
    for (open, close) in [
        ("(", ")"),
        ("-", ""),
        ("2^", ""),
        ("sin(", ")"),
        ("lag(", ", T)"),
    ] {
        for depth in [40, 200] {
            let text = with_power(&format!("{}v{}", open.repeat(depth), close.repeat(depth)));
            let told = refused(&text)[0].to_string();
            let bounded = ["nested deeper", "states", "constant", "bytes"];
            assert!(bounded.iter().any(|b| told.contains(b)), "{open}: {told}");
        }
        refused(&with_power(&open.repeat(30_000)));
    }
    // Of the TOML itself, too.
    refused(&format!(
        "{SOUND}\nx = {}1{}",
        "[".repeat(5_000),
        "]".repeat(5_000)
    ));
    refused(&format!("{SOUND}\n[{}]", vec!["a"; 5_000].join(".")));
}

#[test]
fn sizes_are_bounded() {
    let long = with_power(&vec!["v"; 3_000].join("+"));
    assert!(refused(&long)[0].message.contains("bytes"));
    let sum: Vec<String> = (0..300).map(|k| format!("v*{k}")).collect();
    assert!(
        refused(&with_power(&sum.join("+")))[0]
            .message
            .contains("operations")
    );
    assert!(refused(&"#".repeat(70_000))[0].message.contains("too long"));
    let lags: Vec<String> = (1..=9).map(|k| format!("lag(v, {k}s)")).collect();
    assert!(
        refused(&with_power(&lags.join("-")))[0]
            .message
            .contains("states")
    );
    let one = "[[states]]\nname = \"s\"\nunit = \"1\"\ninitial = \"0\"\nderivative = \"0/T\"\n";
    refused(&format!("{}{SOUND}", one.repeat(20)));
    refused(&format!("{SOUND}{}", one.repeat(20)));
    refused(&format!("{SOUND}{}", "[[parameters]]\n".repeat(2_000)));
    let many = format!("{SOUND}{}", "[[states]]\nx = 1\n".repeat(500));
    assert!(refused(&many).len() <= 50);
}

#[test]
fn numbers_without_a_value_are_refused() {
    for number in [
        "1e999",
        "inf",
        "nan",
        "0/0",
        "exp(1000)",
        "1e308*1e308",
        "ln(0)",
        "0^-1",
    ] {
        refused(&with_power(&format!("k*(v - z)*({number})")));
    }
    for number in [
        "1e999",
        "inf",
        "-inf",
        "nan",
        "0x10",
        "99999999999999999999999999e300",
    ] {
        refused(&SOUND.replace("upper = 2.0", &format!("upper = {number}")));
    }
}

#[test]
fn states_in_a_circle_are_integrated_or_refused() {
    // Derivatives may refer to each other, initial values may not.
    let circle = |initial: &str| {
        let state = |own: &str, other: &str| {
            format!(
                "[[states]]\nname = \"{own}\"\nunit = \"1\"\ninitial = \"{initial}\"\n\
                 derivative = \"({other} - {own})/T\"\n"
            )
        };
        let power = "k*(v - z) + k*(x - y)";
        format!(
            "{}{}{}",
            with_power(power),
            state("x", "y"),
            state("y", "x")
        )
    };
    assert!(EffectFile::parse(&circle("0.5")).is_ok());
    assert!(
        refused(&circle("y"))[0]
            .message
            .contains("refers to the state `y`")
    );
}

#[test]
fn states_that_explode_or_divide_by_zero_are_refused_or_end_the_simulation() {
    // Grows by e^(2000 t) from a trace.
    let text = SOUND.replace("(v - z)/T", "1000*(z - 1)/1s + (v - 1)/T");
    refused(&text);
    refused(&SOUND.replace("(v - z)/T", "(v - z)/(T - T)"));
    refused(&with_power("k*(v - z)/(z - z)"));
    refused(&with_power("k*sqrt(v - 2)"));
}

/// A small generator: the sequence is fixed, so that a failure comes again.
struct Sequence(u64);

impl Sequence {
    fn next(&mut self, below: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        let high = usize::try_from(self.0 >> 33).unwrap_or(0);
        high % below.max(1)
    }
}

#[test]
fn mutated_files_are_read_or_refused_and_never_panic() {
    const PIECES: [&str; 24] = [
        "(",
        ")",
        "^",
        "-",
        "*",
        "/",
        ",",
        "lag(",
        "latch(",
        "timer(",
        "1e308",
        "0",
        "\"",
        "\n",
        "[[states]]\n",
        "v",
        "z",
        "T",
        "\u{e9}",
        "\u{0}",
        "pow(v, z)",
        "ln(",
        "minimum_since_start(",
        "=",
    ];
    let mut sequence = Sequence(7);
    let mut accepted = 0;
    for _ in 0..2_000 {
        let mut text: Vec<char> = SOUND.chars().collect();
        for _ in 0..=sequence.next(4) {
            let at = sequence.next(text.len());
            match sequence.next(4) {
                0 => drop(text.remove(at)),
                1 => {
                    let until = (at + sequence.next(12)).min(text.len());
                    text.drain(at..until);
                }
                2 => {
                    let piece: Vec<char> = PIECES[sequence.next(PIECES.len())].chars().collect();
                    text.splice(at..at, piece);
                }
                _ => {
                    let until = (at + sequence.next(30)).min(text.len());
                    let copy: Vec<char> = text[at..until].to_vec();
                    let to = sequence.next(text.len());
                    text.splice(to..to, copy);
                }
            }
        }
        let text: String = text.into_iter().collect();
        match EffectFile::parse(&text) {
            Ok(_) => accepted += 1,
            Err(problems) => assert!(!problems.is_empty() && problems.len() <= 50),
        }
    }
    // Changes of titles and numbers leave a sound file.
    assert!(accepted > 20, "{accepted}");
}

#[test]
fn mutated_expressions_are_compiled_or_refused_and_never_panic() {
    const TOKENS: [&str; 30] = [
        "v",
        "z",
        "k",
        "T",
        "df",
        "t",
        "q0",
        "p_m",
        "q_m",
        "p_s",
        "pi",
        "1",
        "0",
        "2s",
        "(",
        ")",
        "+",
        "-",
        "*",
        "/",
        "^",
        ",",
        "lag(",
        "latch(",
        "timer(",
        "below(",
        "clip(",
        "smooth_step(",
        "exp(",
        "pow(",
    ];
    let mut sequence = Sequence(11);
    for _ in 0..4_000 {
        let tokens: Vec<&str> = (0..=sequence.next(12))
            .map(|_| TOKENS[sequence.next(TOKENS.len())])
            .collect();
        let open = tokens.iter().filter(|t| t.ends_with('(')).count();
        let closed = tokens.iter().filter(|t| **t == ")").count();
        let text = format!(
            "k*({}{})",
            tokens.join(" "),
            ")".repeat(open.saturating_sub(closed))
        );
        if let Err(problems) = EffectFile::parse(&with_power(&text)) {
            assert!(
                problems
                    .iter()
                    .all(|p| !p.message.is_empty() && p.line >= 1)
            );
        }
    }
}
