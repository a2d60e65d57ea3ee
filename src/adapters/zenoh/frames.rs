//! C37.118 frames onto zenoh: raw bytes on measurement keys, and the configuration for who asks.

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use zenoh::{
    Session, Wait,
    bytes::Encoding,
    query::{Query, Queryable},
};

use super::{Keys, ZenohError, session};

/// Puts the frames of one source on the measurement keys of one or several sites.
#[derive(Debug)]
pub struct FramePublisher {
    session: Session,
    keys: Vec<String>,
    configuration: Arc<Mutex<Vec<u8>>>,
    /// Answers while it lives.
    _queryables: Vec<Queryable<()>>,
}

impl FramePublisher {
    /// Declares the configuration of `stream` at each of `sites` as something that can be asked for.
    ///
    /// # Errors
    ///
    /// [`ZenohError::Declare`].
    pub async fn new(
        session: &Session,
        keys: &Keys,
        sites: &[String],
        stream: &str,
    ) -> Result<Self, ZenohError> {
        let configuration = Arc::new(Mutex::new(Vec::new()));
        let mut queryables = Vec::with_capacity(sites.len());
        for site in sites {
            let key = keys.configuration(site, stream);
            let known = Arc::clone(&configuration);
            let queryable = session
                .declare_queryable(key.clone())
                .callback(move |query| answer(&query, &known))
                .await
                .map_err(|error| ZenohError::Declare {
                    key,
                    reason: error.to_string(),
                })?;
            queryables.push(queryable);
        }
        let measurement = |site: &String| keys.measurement(site, stream);
        Ok(Self {
            session: session.clone(),
            keys: sites.iter().map(measurement).collect(),
            configuration,
            _queryables: queryables,
        })
    }

    /// Puts whole frames, one behind the other, on every key. Waits while the network is congested, but
    /// not longer than `limit`.
    ///
    /// # Errors
    ///
    /// [`ZenohError::Publish`].
    pub async fn put(&self, frames: &[u8], limit: Duration) -> Result<(), ZenohError> {
        for key in &self.keys {
            let put = session::put(&self.session, key, frames.to_vec(), Encoding::default());
            let late = |_| ZenohError::Publish {
                key: key.clone(),
                reason: format!("the network did not take it within {} s", limit.as_secs()),
            };
            tokio::time::timeout(limit, put).await.map_err(late)??;
        }
        Ok(())
    }

    /// Remembers a configuration, one or several whole frames, for who asks, and puts it on every key.
    ///
    /// # Errors
    ///
    /// [`ZenohError::Publish`].
    pub async fn put_configuration(
        &self,
        frames: Vec<u8>,
        limit: Duration,
    ) -> Result<(), ZenohError> {
        frames.clone_into(
            &mut self
                .configuration
                .lock()
                .unwrap_or_else(PoisonError::into_inner),
        );
        self.put(&frames, limit).await
    }
}

/// Nobody is answered before there is a configuration.
fn answer(query: &Query, known: &Mutex<Vec<u8>>) {
    let frames = known.lock().unwrap_or_else(PoisonError::into_inner).clone();
    if frames.is_empty() {
        return;
    }
    let key = query.key_expr().clone();
    if let Err(error) = query.reply(key, frames).wait() {
        tracing::debug!(%error, "configuration not delivered");
    }
}
