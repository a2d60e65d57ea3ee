//! Who may change things: whoever shows the token.

use std::fmt;

use sha2::{Digest, Sha256};

/// Characters that a token has at least.
const CHARACTERS_MIN: usize = 16;

/// A secret that opens the door. Only its hash is kept, so that it can be neither logged nor
/// compared character by character.
#[derive(Clone, PartialEq, Eq)]
pub struct Token {
    digest: [u8; 32],
}

/// A token that is none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("a token is one line of at least {CHARACTERS_MIN} visible ASCII characters without spaces")]
pub struct TokenError;

impl Token {
    /// The token that `text` holds; white space around it is not part of it.
    ///
    /// # Errors
    ///
    /// [`TokenError`] when it is too short or cannot travel in a header.
    pub fn new(text: &str) -> Result<Self, TokenError> {
        let text = text.trim();
        if text.len() < CHARACTERS_MIN || !text.bytes().all(|byte| byte.is_ascii_graphic()) {
            return Err(TokenError);
        }
        Ok(Self {
            digest: digest(text),
        })
    }

    /// Whether this is the token. Takes as long for every answer.
    #[must_use]
    pub fn matches(&self, presented: &str) -> bool {
        let presented = digest(presented);
        let pairs = self.digest.iter().zip(presented);
        let difference = pairs.fold(0, |sum, (ours, theirs)| sum | (ours ^ theirs));
        difference == 0
    }

    /// A word that only who knows the token can know, another one for each purpose.
    #[must_use]
    pub fn derived(&self, purpose: &str) -> String {
        let mut hash = Sha256::new();
        hash.update(self.digest);
        hash.update(purpose);
        let word = hash.finalize();
        hexadecimal(&word)
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token")
    }
}

pub(in crate::adapters) fn hexadecimal(bytes: &[u8]) -> String {
    let halves = bytes.iter().flat_map(|byte| [byte >> 4, byte & 15]);
    halves
        .filter_map(|half| char::from_digit(half.into(), 16))
        .collect()
}

fn digest(text: &str) -> [u8; 32] {
    Sha256::digest(text.as_bytes()).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_token_itself_matches_and_it_is_never_shown() {
        let token = Token::new(" 0123456789abcdef\n").unwrap();
        assert!(token.matches("0123456789abcdef"));
        for wrong in [
            "",
            "0123456789abcdeF",
            "0123456789abcdef0",
            "0123456789abcde",
        ] {
            assert!(!token.matches(wrong), "{wrong}");
        }
        assert_eq!(format!("{token:?}"), "Token");
    }

    #[test]
    fn a_short_or_broken_token_is_refused() {
        for text in ["", "short", "0123456789 abcdef", "0123456789abcde\u{e4}"] {
            assert_eq!(Token::new(text), Err(TokenError), "{text}");
        }
    }
}
