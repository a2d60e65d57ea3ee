//! Who may change something over HTTP: nobody, unless the service was given a token.

use std::fmt;

use sha2::{Digest, Sha256};

type Hash = [u8; 32];

/// Who may change something over HTTP. Keeps hashes, never the token itself.
#[derive(Clone, Copy, Default)]
pub struct WriteAccess {
    token: Option<Hash>,
    open_pages: bool,
}

/// Says whether there is a token, and nothing of it.
impl fmt::Debug for WriteAccess {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("WriteAccess")
            .field("has_token", &self.token.is_some())
            .field("open_pages", &self.open_pages)
            .finish()
    }
}

impl WriteAccess {
    /// Nobody.
    #[must_use]
    pub const fn read_only() -> Self {
        Self {
            token: None,
            open_pages: false,
        }
    }

    /// Whoever knows the token.
    #[must_use]
    pub fn by_token(token: &str) -> Self {
        Self {
            token: Some(hash(&[token.as_bytes()])),
            open_pages: false,
        }
    }

    /// The pages are open to whoever reaches them on this machine: for demonstrations.
    #[must_use]
    pub const fn with_open_pages(self) -> Self {
        Self {
            open_pages: true,
            ..self
        }
    }

    /// Whether a token was given.
    #[must_use]
    pub const fn is_possible(&self) -> bool {
        self.token.is_some()
    }

    /// Whether pages on this machine need no token.
    #[must_use]
    pub const fn has_open_pages(&self) -> bool {
        self.open_pages && self.token.is_some()
    }

    /// Whether this is the token.
    #[must_use]
    pub fn is_token(&self, said: &str) -> bool {
        self.token
            .is_some_and(|token| same(&token, &hash(&[said.as_bytes()])))
    }

    /// A word that only a holder of the token can know, different for each purpose; none without
    /// a token.
    #[must_use]
    pub fn derived(&self, purpose: &str) -> Option<String> {
        let derived = hash(&[&self.token?, purpose.as_bytes()]);
        Some(derived.iter().map(|byte| format!("{byte:02x}")).collect())
    }
}

fn hash(parts: &[&[u8]]) -> Hash {
    let mut hasher = Sha256::new();
    for part in parts {
        hasher.update(part);
    }
    hasher.finalize().into()
}

/// Compares without telling by its time where the first difference lies.
fn same(a: &Hash, b: &Hash) -> bool {
    let difference = a.iter().zip(b).fold(0, |sum, (a, b)| sum | (a ^ b));
    std::hint::black_box(difference) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_token_opens_and_nothing_opens_without_one() {
        let access = WriteAccess::by_token("secret");
        assert!(access.is_token("secret") && !access.is_token("Secret") && !access.is_token(""));
        let closed = WriteAccess::read_only().with_open_pages();
        assert!(!closed.is_token("") && !closed.has_open_pages());
        assert_eq!(closed.derived("page"), None);
    }

    #[test]
    fn what_is_shown_does_not_hold_the_token() {
        let access = WriteAccess::by_token("secret");
        assert!(!format!("{access:?}").contains("secret"));
        assert_ne!(access.derived("a"), access.derived("b"));
    }
}
