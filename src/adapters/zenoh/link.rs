//! The daemon's own session: what it subscribes to, answers and publishes.

use std::time::Duration;

use zenoh::{
    Session,
    bytes::Encoding,
    liveliness::LivelinessToken,
    pubsub::Subscriber,
    query::{Query, Queryable},
    sample::{Sample, SampleKind},
};

use super::{Address, Entrance, Keys, Message, Question, ZenohError, ZenohOptions, session};

/// The daemon's connection to the network. Dropped, it closes by itself but without its limit:
/// call [`Link::close`].
#[derive(Debug)]
pub struct Link {
    session: Session,
    keys: Keys,
    close_limit: Duration,
    subscribers: Vec<Subscriber<()>>,
    queryables: Vec<Queryable<()>>,
    token: Option<LivelinessToken>,
}

impl Link {
    /// Opens the session and declares everything. `status` and barrier questions go the way of the
    /// messages: see [`Message::Barrier`].
    ///
    /// # Errors
    ///
    /// [`ZenohError`] when the session cannot be opened or a declaration is refused.
    pub async fn open(
        options: &ZenohOptions,
        instance: &str,
        entrance: &Entrance,
    ) -> Result<Self, ZenohError> {
        let mut link = Self {
            session: session::open(options).await?,
            keys: Keys::new(&options.prefix),
            close_limit: Duration::from_millis(options.close_timeout_ms),
            subscribers: Vec::new(),
            queryables: Vec::new(),
            token: None,
        };
        link.subscribe("measurement", entrance).await?;
        link.subscribe("recording", entrance).await?;
        let parameters = link.keys.parameters("*");
        link.answer(&parameters, entrance).await?;
        let diagnoses = link.keys.diagnosis("*");
        link.answer(&diagnoses, entrance).await?;
        let status = link.keys.status(instance);
        link.answer(&status, entrance).await?;
        link.token = Some(
            link.session
                .liveliness()
                .declare_token(status.clone())
                .await
                .map_err(|error| declare_error(&status, &error))?,
        );
        Ok(link)
    }

    /// A second handle for publishing.
    #[must_use]
    pub fn publisher(&self) -> LinkPublisher {
        LinkPublisher {
            session: self.session.clone(),
            keys: self.keys.clone(),
        }
    }

    /// The endpoints that the session really listens on (a port 0 has become a number).
    pub async fn endpoints(&self) -> Vec<String> {
        let locators = self.session.info().locators().await;
        locators.iter().map(ToString::to_string).collect()
    }

    /// Takes nothing in any more once the future has ended; questions are still answered.
    pub fn stop_intake(&mut self) -> impl Future<Output = ()> + Send + 'static {
        let subscribers = std::mem::take(&mut self.subscribers);
        async move {
            for subscriber in subscribers {
                if let Err(error) = subscriber.undeclare().await {
                    tracing::debug!(%error, "subscriber not undeclared");
                }
            }
        }
    }

    /// Whether the session is open.
    #[must_use]
    pub fn is_open(&self) -> bool {
        !self.session.is_closed()
    }

    /// Closes the session within its limit; returns whether it was kept.
    pub async fn close(mut self) -> bool {
        self.queryables.clear();
        self.token = None;
        session::close(&self.session, self.close_limit).await
    }

    async fn subscribe(&mut self, kind: &str, entrance: &Entrance) -> Result<(), ZenohError> {
        let (key, keys, entrance) = (self.keys.all(kind), self.keys.clone(), entrance.clone());
        let recordings = kind == "recording";
        let subscriber = self
            .session
            .declare_subscriber(key.clone())
            .callback(move |sample| {
                let Some(message) = message(&keys, &sample, (entrance.now_ns)()) else {
                    return;
                };
                if recordings {
                    entrance.recording(message);
                } else {
                    entrance.measurement(message);
                }
            })
            .await
            .map_err(|error| declare_error(&key, &error))?;
        self.subscribers.push(subscriber);
        Ok(())
    }

    async fn answer(&mut self, key: &str, entrance: &Entrance) -> Result<(), ZenohError> {
        let entrance = entrance.clone();
        let queryable = self
            .session
            .declare_queryable(key.to_owned())
            .callback(move |query| sort_question(&entrance, query))
            .await
            .map_err(|error| declare_error(key, &error))?;
        self.queryables.push(queryable);
        Ok(())
    }
}

/// Publishes what the daemon produces.
#[derive(Clone, Debug)]
pub struct LinkPublisher {
    session: Session,
    keys: Keys,
}

impl LinkPublisher {
    /// Puts a parameter set (JSON) on its key.
    ///
    /// # Errors
    ///
    /// [`ZenohError::Publish`].
    pub async fn put_set(&self, site: &str, document: String) -> Result<(), ZenohError> {
        self.put(&self.keys.parameters(site), document).await
    }

    /// Puts a diagnosis (JSON) on its key.
    ///
    /// # Errors
    ///
    /// [`ZenohError::Publish`].
    pub async fn put_diagnosis(&self, site: &str, document: String) -> Result<(), ZenohError> {
        self.put(&self.keys.diagnosis(site), document).await
    }

    /// Puts an event summary (JSON) on its key.
    ///
    /// # Errors
    ///
    /// [`ZenohError::Publish`].
    pub async fn put_event(&self, site: &str, document: String) -> Result<(), ZenohError> {
        self.put(&self.keys.event(site), document).await
    }

    /// Asks for the configuration of a stream of C37.118 frames and puts the answer into the queue as
    /// if it had come on the stream's key. Returns whether anybody answered.
    pub async fn fetch_configuration(
        &self,
        site: &str,
        stream: &str,
        entrance: &Entrance,
        limit: Duration,
    ) -> bool {
        let selector = self.keys.configuration(site, stream);
        let Ok(payload) = session::ask_bytes(&self.session, &selector, limit).await else {
            return false;
        };
        entrance.measurement(Message::Payload {
            address: Address::Measurement {
                site: site.to_owned(),
                stream: stream.to_owned(),
            },
            encoding: "".into(),
            payload,
            arrived_ns: (entrance.now_ns)(),
            held: None,
        });
        true
    }

    /// The keys.
    #[must_use]
    pub const fn keys(&self) -> &Keys {
        &self.keys
    }

    async fn put(&self, key: &str, document: String) -> Result<(), ZenohError> {
        let encoding = Encoding::APPLICATION_JSON;
        session::put(&self.session, key, document.into_bytes(), encoding).await
    }
}

fn message(keys: &Keys, sample: &Sample, arrived_ns: i64) -> Option<Message> {
    if sample.kind() == SampleKind::Delete {
        return None;
    }
    let key = sample.key_expr().as_str();
    Some(match keys.address(key) {
        None => Message::Stray {
            key: key.to_owned(),
        },
        Some(address) => Message::Payload {
            address,
            // Without a copy where it is one that everybody knows.
            encoding: sample.encoding().clone().into(),
            payload: sample.payload().to_bytes().into_owned(),
            arrived_ns,
            held: None,
        },
    })
}

/// A question with `?after=measurement` or `?after=recording` waits its turn behind the messages
/// that came before it; all others are answered at once.
fn sort_question(entrance: &Entrance, query: Query) {
    let question = Question::new(query);
    match question.parameter("after") {
        Some("measurement") => entrance.measurement(Message::Barrier(question)),
        Some("recording") => entrance.recording(Message::Barrier(question)),
        _ => entrance.question(question),
    }
}

fn declare_error(key: &str, error: &zenoh::Error) -> ZenohError {
    ZenohError::Declare {
        key: key.to_owned(),
        reason: error.to_string(),
    }
}
