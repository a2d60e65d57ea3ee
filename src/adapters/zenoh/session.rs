//! One zenoh session: opened from our configuration, closed within a limit.

use std::time::Duration;

use tokio::time::timeout;
use zenoh::{
    Config, Session, bytes::Encoding, handlers::FifoChannelHandler, pubsub::Subscriber,
    qos::CongestionControl, sample::Sample,
};

use super::{Mode, ZenohOptions};

/// What went wrong with zenoh.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ZenohError {
    /// A setting that zenoh does not accept.
    #[error("zenoh refuses the setting `{key}` = {value}: {reason}")]
    Setting {
        /// Zenoh's own key.
        key: String,
        /// Value, as JSON.
        value: String,
        /// What zenoh said.
        reason: String,
    },
    /// The session could not be opened.
    #[error("cannot open the zenoh session ({endpoints}): {reason}")]
    Open {
        /// Where it was to listen and to connect.
        endpoints: String,
        /// What zenoh said.
        reason: String,
    },
    /// A subscriber, queryable or token was refused.
    #[error("cannot declare `{key}`: {reason}")]
    Declare {
        /// Key expression.
        key: String,
        /// What zenoh said.
        reason: String,
    },
    /// A publication was refused.
    #[error("cannot publish on `{key}`: {reason}")]
    Publish {
        /// Key.
        key: String,
        /// What zenoh said.
        reason: String,
    },
    /// A query could not be asked.
    #[error("cannot ask `{selector}`: {reason}")]
    Ask {
        /// Selector.
        selector: String,
        /// What zenoh said.
        reason: String,
    },
    /// Nobody answered in time.
    #[error("nobody answered `{selector}` within {seconds} s: is a loadmodeld running there?")]
    NoAnswer {
        /// Selector.
        selector: String,
        /// Limit, seconds.
        seconds: u64,
    },
    /// The session was closed by the other side.
    #[error("the connection was closed")]
    Closed,
    /// The answer was an error.
    #[error("`{selector}` was refused: {reason}")]
    Refused {
        /// Selector.
        selector: String,
        /// The answer.
        reason: String,
    },
}

/// Opens a session.
///
/// # Errors
///
/// [`ZenohError::Setting`] or [`ZenohError::Open`].
pub async fn open(options: &ZenohOptions) -> Result<Session, ZenohError> {
    let config = configuration(options)?;
    zenoh::open(config).await.map_err(|error| ZenohError::Open {
        endpoints: format!(
            "listens on [{}], connects to [{}]",
            options.listen.join(", "),
            options.connect.join(", ")
        ),
        reason: error.to_string(),
    })
}

/// Closes a session, giving up after `limit`: closing may hang for 10 s when a peer is gone.
/// Returns whether it closed in time.
pub async fn close(session: &Session, limit: Duration) -> bool {
    matches!(timeout(limit, session.close()).await, Ok(Ok(())))
}

/// Puts bytes on a key. Waits when the network is congested: what we publish is never dropped.
///
/// # Errors
///
/// [`ZenohError::Publish`].
pub async fn put(
    session: &Session,
    key: &str,
    payload: Vec<u8>,
    encoding: Encoding,
) -> Result<(), ZenohError> {
    session
        .put(key, payload)
        .encoding(encoding)
        .congestion_control(CongestionControl::Block)
        .await
        .map_err(|error| ZenohError::Publish {
            key: key.to_owned(),
            reason: error.to_string(),
        })
}

/// Documents that arrive on a key expression. Nothing is dropped: a reader that is too slow makes
/// the sender wait.
#[derive(Debug)]
pub struct Documents {
    subscriber: Subscriber<FifoChannelHandler<Sample>>,
}

/// Subscribes to documents.
///
/// # Errors
///
/// [`ZenohError::Declare`].
pub async fn documents(session: &Session, key: &str) -> Result<Documents, ZenohError> {
    let subscriber = session
        .declare_subscriber(key.to_owned())
        .await
        .map_err(|error| ZenohError::Declare {
            key: key.to_owned(),
            reason: error.to_string(),
        })?;
    Ok(Documents { subscriber })
}

impl Documents {
    /// The next document; none when the session has been closed.
    pub async fn next(&self) -> Option<String> {
        let sample = self.subscriber.recv_async().await.ok()?;
        Some(text(&sample.payload().to_bytes()))
    }
}

/// [`close`] within the limit of the options.
pub async fn close_within(session: &Session, options: &ZenohOptions) -> bool {
    close(session, Duration::from_millis(options.close_timeout_ms)).await
}

/// Asks one question and waits for the first answer, which is text.
///
/// # Errors
///
/// [`ZenohError::Ask`], [`ZenohError::NoAnswer`] or [`ZenohError::Refused`].
pub async fn ask(session: &Session, selector: &str, limit: Duration) -> Result<String, ZenohError> {
    Ok(text(&ask_bytes(session, selector, limit).await?))
}

/// Asks one question and waits for the first answer.
///
/// # Errors
///
/// [`ZenohError::Ask`], [`ZenohError::NoAnswer`] or [`ZenohError::Refused`].
pub async fn ask_bytes(
    session: &Session,
    selector: &str,
    limit: Duration,
) -> Result<Vec<u8>, ZenohError> {
    let replies = session
        .get(selector)
        .congestion_control(CongestionControl::Block)
        .timeout(limit)
        .await
        .map_err(|error| ZenohError::Ask {
            selector: selector.to_owned(),
            reason: error.to_string(),
        })?;
    let no_answer = || ZenohError::NoAnswer {
        selector: selector.to_owned(),
        seconds: limit.as_secs(),
    };
    let reply = timeout(limit, replies.recv_async())
        .await
        .map_err(|_| no_answer())?
        .map_err(|_| no_answer())?;
    match reply.into_result() {
        Ok(sample) => Ok(sample.payload().to_bytes().into_owned()),
        // Zenoh reports an expired query as an error reply of its own.
        Err(error) if text(&error.payload().to_bytes()).eq_ignore_ascii_case("timeout") => {
            Err(no_answer())
        }
        Err(error) => Err(ZenohError::Refused {
            selector: selector.to_owned(),
            reason: text(&error.payload().to_bytes()),
        }),
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Zenoh's configuration from ours. Nothing is reached that is not named: no multicast, no
/// connections by hearsay unless asked for, and every endpoint is explicit.
fn configuration(options: &ZenohOptions) -> Result<Config, ZenohError> {
    let mut config = Config::default();
    let listen = if options.mode == Mode::Client {
        Vec::new()
    } else {
        options.listen.clone()
    };
    // What others tell of others is not connected to either, unless one may look around anyway.
    let autoconnect = if options.multicast {
        r#"{"router":[],"peer":["router","peer"],"client":["router","peer"]}"#.to_owned()
    } else {
        r#"{"router":[],"peer":[],"client":[]}"#.to_owned()
    };
    let own = [
        ("mode", json(options.mode.name())),
        ("scouting/multicast/enabled", json(options.multicast)),
        ("scouting/gossip/autoconnect", autoconnect),
        ("listen/endpoints", json(listen)),
        ("connect/endpoints", json(options.connect.clone())),
    ];
    let own = own.map(|(key, value)| (key.to_owned(), value));
    for (key, value) in own.iter().chain(&options.settings) {
        config
            .insert_json5(key, value)
            .map_err(|error| ZenohError::Setting {
                key: key.clone(),
                value: value.clone(),
                reason: error.to_string(),
            })?;
    }
    Ok(config)
}

fn json(value: impl Into<serde_json::Value>) -> String {
    value.into().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_setting_that_zenoh_does_not_know_is_named() {
        let options = ZenohOptions {
            settings: vec![("no/such/key".to_owned(), "1".to_owned())],
            ..ZenohOptions::default()
        };
        let error = configuration(&options).unwrap_err();
        assert!(error.to_string().contains("no/such/key"), "{error}");
    }

    #[test]
    fn by_default_nobody_is_looked_for() {
        let config = configuration(&ZenohOptions::default()).unwrap();
        let multicast = config.get_json("scouting/multicast/enabled").unwrap();
        assert_eq!(multicast, "false");
        let hearsay = config.get_json("scouting/gossip/autoconnect").unwrap();
        assert!(!hearsay.contains("\"peer\":[\""), "{hearsay}");
        let listen = config.get_json("listen/endpoints").unwrap();
        assert!(
            listen.contains("127.0.0.1") && !listen.contains("[::]"),
            "{listen}"
        );
    }
}
