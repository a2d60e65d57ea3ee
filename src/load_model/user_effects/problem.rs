//! A fault of an effect file: where it is, what it is, what would cure it.

use std::fmt::{self, Display, Formatter};

/// A fault of an effect file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Problem {
    /// Line, from 1.
    pub line: usize,
    /// Column in characters, from 1.
    pub column: usize,
    /// What is wrong; lower case, no full stop.
    pub message: String,
    /// What to do about it; empty when the message says it.
    pub cure: String,
}

impl Display for Problem {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.line, self.column, self.message)?;
        if self.cure.is_empty() {
            return Ok(());
        }
        write!(f, "; {}", self.cure)
    }
}

/// A fault at a byte of the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Fault {
    pub(super) at: usize,
    pub(super) message: String,
    pub(super) cure: String,
}

impl Fault {
    pub(super) fn new(at: usize, message: impl Into<String>, cure: impl Into<String>) -> Self {
        Self {
            at,
            message: message.into(),
            cure: cure.into(),
        }
    }

    /// With line and column in the text.
    pub(super) fn place(self, text: &str) -> Problem {
        let before = text.get(..self.at).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |i| i + 1);
        Problem {
            line: 1 + before.matches('\n').count(),
            column: 1 + before[line_start..].chars().count(),
            message: self.message,
            cure: self.cure,
        }
    }
}

/// `did you mean ...?` when a known name is close, otherwise the list of what is known.
pub(super) fn suggestion<'a>(name: &str, known: impl Iterator<Item = &'a str> + Clone) -> String {
    let nearest = known
        .clone()
        .map(|k| (distance(name, k), k))
        .min_by_key(|(d, _)| *d);
    match nearest {
        Some((d, k)) if d <= 1 + name.chars().count() / 4 => format!("did you mean `{k}`?"),
        _ => format!("known: {}", known.collect::<Vec<_>>().join(", ")),
    }
}

/// Edit distance, where a change of case costs nothing beyond 1 in all. Names longer than 64
/// characters are not compared.
fn distance(one: &str, other: &str) -> usize {
    const LONGEST: usize = 64;
    if one.eq_ignore_ascii_case(other) {
        return 1;
    }
    let (one, other): (Vec<char>, Vec<char>) = (one.chars().collect(), other.chars().collect());
    if one.len() > LONGEST || other.len() > LONGEST {
        return usize::MAX;
    }
    let mut row: Vec<usize> = (0..=other.len()).collect();
    for (i, a) in one.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, b) in other.iter().enumerate() {
            let replaced = diagonal + usize::from(a != b);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[other.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_count_characters_and_lines() {
        let text = "a\nb\u{e9}c = 1\n";
        let at = text.find('c').unwrap();
        let problem = Fault::new(at, "x", "y").place(text);
        assert_eq!((problem.line, problem.column), (2, 3));
        assert_eq!(problem.to_string(), "2:3: x; y");
    }

    #[test]
    fn near_names_are_suggested_and_far_ones_are_not() {
        let known = ["v", "df", "smooth_step"];
        assert_eq!(suggestion("V", known.into_iter()), "did you mean `v`?");
        assert_eq!(
            suggestion("smothstep", known.into_iter()),
            "did you mean `smooth_step`?"
        );
        assert_eq!(
            suggestion("voltage", known.into_iter()),
            "known: v, df, smooth_step"
        );
    }
}
