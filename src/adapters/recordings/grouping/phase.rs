//! Phases in channel lines: the phase field, and the phase letter within a name.

use super::super::comtrade::AnalogChannel;

/// A place in a channel's name that may be its phase.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// 0, 1 or 2.
    pub(super) phase: usize,
    /// The name with `*` for the phase.
    pub(super) stem: String,
    /// The place names two phases: a voltage between them.
    pub(super) between: bool,
    /// The phase is a digit: weaker evidence than a letter.
    pub(super) digit: bool,
}

/// The letters of phases: Latin, Cyrillic that look like them, R S T, and the Russian colours.
const LETTERS: [[char; 3]; 6] = [
    ['A', 'B', 'C'],
    ['a', 'b', 'c'],
    ['\u{410}', '\u{412}', '\u{421}'],
    ['\u{430}', '\u{432}', '\u{441}'],
    ['R', 'S', 'T'],
    ['\u{416}', '\u{417}', '\u{41a}'],
];
const DIGITS: [char; 3] = ['1', '2', '3'];
/// Pairs of phases in the order ab, bc, ca.
const PAIRS: [(usize, usize); 3] = [(0, 1), (1, 2), (2, 0)];

/// The phase the channel's phase field states: A, B, C in any script, R, S, T, L1 to L3, 1 to 3.
pub(super) fn stated_phase(channel: &AnalogChannel) -> Option<usize> {
    let field = channel.phase.trim().trim_end_matches('\u{76f8}');
    let mut letters = field.chars();
    let first = letters.next()?;
    match (first, letters.next(), letters.next()) {
        (c, None, _) => letter(c).or_else(|| digit(c)),
        ('L' | 'l' | 'I' | 'i' | 'V' | 'v' | 'U' | 'u', Some(c), None) => {
            digit(c).or_else(|| letter(c))
        }
        _ => None,
    }
}

/// Whether the channel is a residual (neutral, zero sequence, open delta) quantity.
pub(super) fn is_residual(channel: &AnalogChannel) -> bool {
    let phase = channel.phase.trim();
    let name: String = channel
        .name
        .chars()
        .filter(|c| !c.is_whitespace())
        .collect();
    let marks = [
        "3I0", "3U0", "3V0", "3Io", "3Uo", "3IO", "3UO", "IN", "UN", "VN",
    ];
    matches!(phase, "N" | "n" | "\u{41d}" | "G")
        || marks.iter().any(|mark| match name.find(mark) {
            Some(at) => {
                let after = name[at + mark.len()..].chars().next();
                let before = name[..at].chars().next_back();
                !after.is_some_and(char::is_alphabetic) && !before.is_some_and(char::is_alphabetic)
            }
            None => false,
        })
}

/// Every place in the channel's name that may be its phase and does not contradict its phase field.
pub(super) fn places(channel: &AnalogChannel) -> Vec<Place> {
    let name: Vec<char> = channel.name.chars().collect();
    // Some recorders write the same digit, or a running number, into every phase field.
    let field = channel.phase.trim();
    let numbered = !field.is_empty() && field.chars().all(|c| c.is_ascii_digit());
    let stated = stated_phase(channel).filter(|_| !numbered);
    let mut places = Vec::new();
    for at in 0..name.len() {
        if let Some((phase, between, digit)) = place(&name, at) {
            let length = if between { 2 } else { 1 };
            let contradicted = !between && stated.is_some_and(|stated| stated != phase);
            if !contradicted {
                let head = name[..at].iter();
                let tail = name[at + length..].iter();
                places.push(Place {
                    phase,
                    stem: head.chain(&['*']).chain(tail).collect(),
                    between,
                    digit,
                });
            }
        }
    }
    places
}

/// `(phase, between two phases, a digit)` of the place at `at`, if it can be one: after the symbol
/// of a quantity or a separator, and not the beginning of a longer word.
fn place(name: &[char], at: usize) -> Option<(usize, bool, bool)> {
    let before = at.checked_sub(1).map(|i| name[i]);
    let after = |offset: usize| name.get(at + offset).copied();
    let ends = |next: Option<char>| next.is_none_or(|c| !in_word(c));
    let quantity = before.is_some_and(|c| "IUVLiuv".contains(c));
    let separated = before.is_none_or(|c| "_- .:/".contains(c));
    if !quantity && !separated {
        return None;
    }
    if let Some(first) = letter(name[at]) {
        if ends(after(1)) || after(1).is_some_and(|c| c.is_ascii_digit()) {
            return Some((first, false, false));
        }
        let second = after(1).and_then(letter)?;
        let pair = PAIRS.iter().position(|&pair| pair == (first, second))?;
        return ends(after(2)).then_some((pair, true, false));
    }
    let first = digit(name[at])?;
    let alone = after(1).is_none_or(|c| !c.is_alphanumeric());
    (quantity && alone).then_some((first, false, true))
}

fn letter(c: char) -> Option<usize> {
    LETTERS
        .iter()
        .find_map(|set| set.iter().position(|l| *l == c))
}

fn digit(c: char) -> Option<usize> {
    DIGITS.iter().position(|d| *d == c)
}

/// Letters that would make the place part of a longer word. Chinese characters would not: they
/// follow the phase without a separator.
fn in_word(c: char) -> bool {
    c.is_ascii_alphabetic() || ('\u{400}'..='\u{4ff}').contains(&c)
}
