//! C37.118 frames onto zenoh: raw bytes on measurement keys, and the configuration for who asks.

use std::{
    sync::{Arc, Mutex, PoisonError},
    time::Duration,
};

use zenoh::{
    Session, Wait,
    bytes::Encoding,
    pubsub::Publisher,
    qos::CongestionControl,
    query::{Query, Queryable},
};

use super::{Keys, ZenohError};

/// Puts the frames of one source on the measurement keys of one or several sites.
#[derive(Debug)]
pub struct FramePublisher {
    /// One per site.
    publishers: Vec<Publisher<'static>>,
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
        let mut publishers = Vec::with_capacity(sites.len());
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
            let key = keys.measurement(site, stream);
            let publisher = session
                .declare_publisher(key.clone())
                .encoding(Encoding::default())
                .congestion_control(CongestionControl::Block)
                .await
                .map_err(|error| ZenohError::Declare {
                    key,
                    reason: error.to_string(),
                })?;
            publishers.push(publisher);
        }
        Ok(Self {
            publishers,
            configuration,
            _queryables: queryables,
        })
    }

    /// Puts whole frames, one behind the other, on every key. Waits while the network is congested, but
    /// not longer than `limit`. Returns whether every key has a subscriber, as far as is known here: what is
    /// put where nobody subscribes is gone.
    ///
    /// # Errors
    ///
    /// [`ZenohError::Publish`].
    pub async fn put(&self, frames: &[u8], limit: Duration) -> Result<bool, ZenohError> {
        let mut heard = true;
        for publisher in &self.publishers {
            let failed = |reason| ZenohError::Publish {
                key: publisher.key_expr().to_string(),
                reason,
            };
            let late = |_| {
                failed(format!(
                    "the network did not take it within {} s",
                    limit.as_secs()
                ))
            };
            let put = async { publisher.put(frames.to_vec()).await };
            let put = tokio::time::timeout(limit, put).await.map_err(late)?;
            put.map_err(|error| failed(error.to_string()))?;
            let status = publisher.matching_status().await;
            heard &= status.is_ok_and(|status| status.matching());
        }
        Ok(heard)
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
    ) -> Result<bool, ZenohError> {
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
