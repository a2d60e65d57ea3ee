//! Where pages get their contents: the store, and comparisons that were made before.

use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::Semaphore;

use super::problem::Problem;
use crate::{
    adapters::{http::Context, store::Store},
    disturbance::Window,
    identification::{self, Comparison, IdentificationOptions, ParameterSet},
    measurement::Site,
};

/// Pages made at one time. Each holds a thread; the others wait, within the request's time limit.
const SEATS: usize = 4;
/// Readers of live updates at one time.
const LISTENERS_MAX: usize = 32;
/// Comparisons kept, newest use first: a few sites under study, some megabytes.
const COMPARISONS_MAX: usize = 64;

/// What pages are made from.
#[derive(Debug)]
pub(super) struct Desk {
    pub(super) context: Arc<Context>,
    pub(super) seats: Semaphore,
    pub(super) listeners: Arc<Semaphore>,
    comparisons: Mutex<Vec<(Key, Arc<Comparison>)>>,
}

/// Event and content hash of the set.
type Key = (String, String);

impl Desk {
    pub(super) fn new(context: Arc<Context>) -> Self {
        Self {
            context,
            seats: Semaphore::new(SEATS),
            listeners: Arc::new(Semaphore::new(LISTENERS_MAX)),
            comparisons: Mutex::new(Vec::new()),
        }
    }

    pub(super) fn store(&self) -> &dyn Store {
        self.context.store.as_ref()
    }

    /// A site by its name.
    pub(super) fn site(&self, name: &str) -> Result<Site, Problem> {
        let sites = self.store().sites()?;
        sites
            .into_iter()
            .find(|site| site.name == name)
            .ok_or_else(|| Problem::not_found(format!("there is no site `{name}`")))
    }

    /// The set on the window; computed once for the same event and the same content.
    pub(super) fn comparison(
        &self,
        set: &ParameterSet,
        content_hash: &str,
        window: &Window,
    ) -> Result<Arc<Comparison>, Problem> {
        let key = (window.id.clone(), content_hash.to_owned());
        if let Some(known) = self.known_comparison(&key) {
            return Ok(known);
        }
        let options = IdentificationOptions::default();
        let made = identification::compare(set, std::slice::from_ref(window), &options);
        let comparison = made
            .map_err(|error| Problem::bad_request(error.to_string()))?
            .pop()
            .ok_or_else(|| Problem::bad_request("the model cannot be simulated on this event"))?;
        let comparison = Arc::new(comparison);
        let mut kept = self
            .comparisons
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        kept.insert(0, (key, Arc::clone(&comparison)));
        kept.truncate(COMPARISONS_MAX);
        Ok(comparison)
    }

    fn known_comparison(&self, key: &Key) -> Option<Arc<Comparison>> {
        let mut kept = self
            .comparisons
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let place = kept.iter().position(|(known, _)| known == key)?;
        let found = kept.remove(place);
        let comparison = Arc::clone(&found.1);
        kept.insert(0, found);
        Some(comparison)
    }
}
