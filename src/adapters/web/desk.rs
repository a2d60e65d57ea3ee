//! Where pages get their contents: the store, and comparisons that were made before.

use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::Semaphore;

use super::{problem::Problem, uploads::Uploads};
use crate::{
    adapters::{http::Context, store::Store},
    diagnosis::{EventFailure, where_it_fails::failure},
    disturbance::Window,
    identification::{
        self, Comparison, FittedStructure, IdentificationError, IdentificationOptions,
        ParameterSet, evaluate::Curves, intake::prepare,
    },
    measurement::Site,
};

/// Pages made at one time. Each holds a thread; the others wait, within the request's time limit.
const SEATS: usize = 4;
/// Readers of live updates at one time.
pub(super) const LISTENERS_MAX: usize = 32;
/// Comparisons kept, newest use first: a few sites under study, some megabytes.
const COMPARISONS_MAX: usize = 64;

/// What pages are made from.
#[derive(Debug)]
pub(super) struct Desk {
    pub(super) context: Arc<Context>,
    pub(super) seats: Arc<Semaphore>,
    pub(super) listeners: Arc<Semaphore>,
    /// Recordings that readers sent.
    pub(super) uploads: Uploads,
    comparisons: Mutex<Vec<(Key, Arc<Judged>)>>,
}

/// An event with a model beside it, and where the model fails.
#[derive(Debug)]
pub(super) struct Judged {
    pub(super) comparison: Comparison,
    /// None where the event cannot be judged.
    pub(super) failure: Option<EventFailure>,
}

/// Event and model: the content hash of a set, or the name of what is none.
type Key = (String, String);

impl Desk {
    pub(super) fn new(context: Arc<Context>) -> Self {
        Self {
            context,
            seats: Arc::new(Semaphore::new(SEATS)),
            listeners: Arc::new(Semaphore::new(LISTENERS_MAX)),
            uploads: Uploads::default(),
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
    ) -> Result<Arc<Judged>, Problem> {
        self.judged(content_hash, window, &set.structure, |window, options| {
            identification::compare(set, window, options)
        })
    }

    /// A structure with values on the window; `name` tells it from every other model of the site.
    pub(super) fn comparison_of_fitted(
        &self,
        fitted: &FittedStructure,
        name: &str,
        window: &Window,
    ) -> Result<Arc<Judged>, Problem> {
        self.judged(name, window, &fitted.structure, |window, options| {
            identification::compare_fitted(fitted, window, options)
        })
    }

    fn judged(
        &self,
        model: &str,
        window: &Window,
        parts: &[String],
        compare: impl FnOnce(
            &[Window],
            &IdentificationOptions,
        ) -> Result<Vec<Comparison>, IdentificationError>,
    ) -> Result<Arc<Judged>, Problem> {
        let key = (window.id.clone(), model.to_owned());
        if let Some(known) = self.known_comparison(&key) {
            return Ok(known);
        }
        let mut options = IdentificationOptions::default();
        options.intake = options.intake.for_parts(parts);
        let comparison = compare(std::slice::from_ref(window), &options)
            .map_err(|error| Problem::bad_request(error.to_string()))?
            .pop()
            .ok_or_else(|| Problem::bad_request("the model cannot be simulated on this event"))?;
        let failure = failure_of(&comparison, window, &options);
        let judged = Arc::new(Judged {
            comparison,
            failure,
        });
        let mut kept = self
            .comparisons
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        kept.insert(0, (key, Arc::clone(&judged)));
        kept.truncate(COMPARISONS_MAX);
        Ok(judged)
    }

    fn known_comparison(&self, key: &Key) -> Option<Arc<Judged>> {
        let mut kept = self
            .comparisons
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let place = kept.iter().position(|(known, _)| known == key)?;
        let found = kept.remove(place);
        let judged = Arc::clone(&found.1);
        kept.insert(0, found);
        Some(judged)
    }
}

fn failure_of(
    comparison: &Comparison,
    window: &Window,
    options: &IdentificationOptions,
) -> Option<EventFailure> {
    let intake = options.intake.for_windows(std::slice::from_ref(window));
    let event = prepare(window, &intake).ok()?;
    let over_p0 = |curve: &[f64]| curve.iter().map(|pu| pu / event.p0_pu).collect();
    let curves = Curves {
        active: over_p0(&comparison.active_model_pu),
        reactive: over_p0(&comparison.reactive_model_pu),
    };
    Some(failure(&event, &curves))
}
