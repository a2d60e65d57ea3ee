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

impl Problem {
    /// At a line and column.
    pub(super) fn at([line, column]: [usize; 2], message: String, cure: String) -> Self {
        Self {
            line,
            column,
            message,
            cure,
        }
    }
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
        Problem::at(place(text, self.at), self.message, self.cure)
    }
}

/// Line and column of a byte, from 1.
pub(super) fn place(text: &str, at: usize) -> [usize; 2] {
    let before = text.get(..at).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |i| i + 1);
    let line = 1 + before.matches('\n').count();
    [line, 1 + before[line_start..].chars().count()]
}

/// `did you mean ...?` when a known name is close, otherwise the list of what is known.
pub(super) fn suggestion<'a>(name: &str, known: impl Iterator<Item = &'a str> + Clone) -> String {
    match nearest(name, known.clone()) {
        Some(k) => format!("did you mean `{k}`?"),
        None => format!("known: {}", known.collect::<Vec<_>>().join(", ")),
    }
}

/// The known name that is close to another, if there is one.
pub fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let nearest = known
        .map(|k| (distance(name, k), k))
        .min_by_key(|(d, _)| *d);
    let close = |(d, _): &(usize, &str)| *d <= 1 + name.chars().count() / 4;
    nearest.filter(close).map(|(_, k)| k)
}

/// Letters changed, put in, left out or exchanged with the next one; a change of case costs nothing beyond 1 in all. Names
/// longer than 64 characters are not compared.
fn distance(one: &str, other: &str) -> usize {
    const LONGEST: usize = 64;
    if one.eq_ignore_ascii_case(other) {
        return 1;
    }
    if one.chars().count() > LONGEST || other.chars().count() > LONGEST {
        return usize::MAX;
    }
    strsim::osa_distance(one, other)
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
