//! Tokens of an expression.

use super::problem::Fault;
use super::unit::Unit;

/// A token.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token {
    /// A number with `s` or `ms` directly behind it, or without a unit.
    Number(f64, Unit),
    Name(String),
    /// One of `+ - * / ^ ( ) ,`.
    Sign(char),
    End,
}

/// A token and the byte of the expression where it begins.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Placed {
    pub(super) token: Token,
    pub(super) at: usize,
}

/// Longest name.
pub(super) const NAME_LENGTH_MAX: usize = 40;

/// All tokens, the last one being [`Token::End`]; positions count from the start of the text.
pub(super) fn tokens(text: &str) -> Result<Vec<Placed>, Fault> {
    let mut found = Vec::new();
    let mut rest = text;
    loop {
        rest = rest.trim_start();
        let at = text.len() - rest.len();
        let Some(first) = rest.chars().next() else {
            let token = Token::End;
            found.push(Placed { token, at });
            return Ok(found);
        };
        let (token, length) = match first {
            '0'..='9' | '.' => number(rest, at)?,
            'a'..='z' | 'A'..='Z' | '_' => name(rest, at)?,
            '+' | '-' | '*' | '/' | '^' | '(' | ')' | ',' => {
                if rest.starts_with("**") {
                    return Err(Fault::new(at, "unknown operator `**`", "write `^`"));
                }
                (Token::Sign(first), 1)
            }
            other => return Err(unknown(other, at)),
        };
        found.push(Placed { token, at });
        rest = &rest[length..];
    }
}

fn unknown(character: char, at: usize) -> Fault {
    let cure = match character {
        '<' | '>' | '=' | '!' | '?' | '&' | '|' => {
            "there are no conditions; use `below`, `above`, `smooth_step`, `min`, `max` or `clip`"
        }
        '%' => "give a share, 0.05 for 5 %",
        '\u{b7}' | '\u{d7}' => "write `*` for a product",
        '\u{2212}' | '\u{2013}' => "write the minus of the keyboard, `-`",
        _ => "an expression holds numbers, names, `+ - * / ^`, brackets and commas",
    };
    Fault::new(at, format!("unexpected character {character:?}"), cure)
}

fn run_of(text: &str, belongs: impl Fn(char) -> bool) -> usize {
    text.find(|c| !belongs(c)).unwrap_or(text.len())
}

fn name(rest: &str, at: usize) -> Result<(Token, usize), Fault> {
    let length = run_of(rest, |c| c.is_ascii_alphanumeric() || c == '_');
    if length > NAME_LENGTH_MAX {
        let message = format!("a name of {length} characters");
        let cure = format!("at most {NAME_LENGTH_MAX}");
        return Err(Fault::new(at, message, cure));
    }
    Ok((Token::Name(rest[..length].to_owned()), length))
}

fn number(rest: &str, at: usize) -> Result<(Token, usize), Fault> {
    let digits = |t: &str| run_of(t, |c| c.is_ascii_digit());
    let mut length = digits(rest);
    if rest[length..].starts_with('.') {
        length += 1;
        length += digits(&rest[length..]);
    }
    if rest[length..].starts_with(['e', 'E']) {
        let sign = usize::from(rest[length + 1..].starts_with(['+', '-']));
        let exponent = digits(&rest[length + 1 + sign..]);
        if exponent > 0 {
            length += 1 + sign + exponent;
        }
    }
    let value: f64 = rest[..length].parse().unwrap_or(f64::NAN);
    if !value.is_finite() {
        let message = format!("`{:.40}` is not a finite number", &rest[..length]);
        return Err(Fault::new(at, message, "give a number within +-1e308"));
    }
    let suffix = run_of(&rest[length..], |c| c.is_ascii_alphanumeric() || c == '_');
    let (divisor, unit) = match &rest[length..length + suffix] {
        "" => (1.0, Unit::ONE),
        "s" => (1.0, Unit::SECOND),
        "ms" => (1000.0, Unit::SECOND),
        other => {
            let message = format!("unknown unit `{other:.20}` behind a number");
            let cure =
                "`s` and `ms` are known; everything else is per unit; write `*` for a product";
            return Err(Fault::new(at + length, message, cure));
        }
    };
    Ok((Token::Number(value / divisor, unit), length + suffix))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_may_carry_seconds() {
        let read = |text: &str| tokens(text).unwrap()[0].token.clone();
        assert_eq!(read("1.5e-1"), Token::Number(0.15, Unit::ONE));
        assert_eq!(read(".5s"), Token::Number(0.5, Unit::SECOND));
        assert_eq!(read("20ms"), Token::Number(0.02, Unit::SECOND));
        for text in ["1x", "1e999", ".", "2v"] {
            assert!(tokens(text).is_err(), "{text}");
        }
    }

    #[test]
    fn every_fault_has_a_place_and_a_cure() {
        let fault = tokens("v + (v < 0.7)").unwrap_err();
        assert_eq!(fault.at, 7);
        assert!(fault.cure.contains("below"));
        assert!(tokens("v ** 2").unwrap_err().cure.contains('^'));
        assert!(tokens("\u{221a}v").is_err());
    }
}
