//! A query from the network that waits for its answer.

use zenoh::{Wait, bytes::Encoding, query::Query};

/// A query that waits for its answer. Dropped without one, the asker sees that nobody answered.
#[derive(Debug)]
pub struct Question {
    query: Query,
}

impl Question {
    pub(super) const fn new(query: Query) -> Self {
        Self { query }
    }

    /// The key expression that was asked for.
    #[must_use]
    pub fn key(&self) -> &str {
        self.query.key_expr().as_str()
    }

    /// The whole selector, for messages.
    #[must_use]
    pub fn selector(&self) -> String {
        self.query.selector().to_string()
    }

    /// The value of a parameter (`?name=value`).
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<&str> {
        self.query.parameters().get(name)
    }

    /// Answers with a JSON document under `key`. The asker may be gone: then nothing happens.
    pub fn answer(&self, key: &str, document: &str) {
        let reply = self
            .query
            .reply(key, document.to_owned())
            .encoding(Encoding::APPLICATION_JSON);
        if let Err(error) = reply.wait() {
            tracing::debug!(key, %error, "answer not delivered");
        }
    }

    /// Answers with an error, in words.
    pub fn refuse(&self, reason: &str) {
        if let Err(error) = self.query.reply_err(reason.to_owned()).wait() {
            tracing::debug!(reason, %error, "refusal not delivered");
        }
    }
}
