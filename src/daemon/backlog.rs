//! What a service that died has left in the store.

use std::sync::Arc;

use super::structures;
use crate::{
    adapters::store::{Store, StoreError, WindowQuery},
    disturbance::Screening,
    service::{Backlog, BacklogPart, DocumentKind, PendingDocument},
};

/// Windows that are loaded at one time: each may hold megabytes.
const WINDOWS_MAX: usize = 64;
/// Summaries that are searched for usable windows, for each one wanted: most are usable.
const SEARCH_FACTOR: usize = 4;

/// Loads what waits.
pub(super) fn load(
    store: &dyn Store,
    part: BacklogPart,
    joint_events_max: usize,
) -> Result<Backlog, StoreError> {
    let mut backlog = Backlog {
        unpublished: unpublished(store)?,
        ..Backlog::default()
    };
    if part != BacklogPart::Unpublished {
        load_windows(store, &mut backlog)?;
        backlog.restructured = structures::not_fitted(store)?;
    }
    if part == BacklogPart::Everything {
        for site in store.sites()? {
            let windows = usable(store, &site.name, joint_events_max)?;
            if !windows.is_empty() {
                backlog.usable.push((site.name, windows));
            }
        }
    }
    Ok(backlog)
}

/// Identifiers of a site's newest usable windows whose waveforms are kept, oldest first.
pub(super) fn usable(
    store: &dyn Store,
    site: &str,
    count_max: usize,
) -> Result<Vec<String>, StoreError> {
    let summaries = store.window_summaries(&WindowQuery {
        site: Some(site),
        count_max: count_max.saturating_mul(SEARCH_FACTOR),
        ..WindowQuery::default()
    })?;
    let mut usable: Vec<String> = summaries
        .into_iter()
        .filter(|w| w.has_waveforms && w.screening.as_ref().is_some_and(Screening::usable))
        .map(|w| w.id)
        .take(count_max)
        .collect();
    usable.reverse();
    Ok(usable)
}

fn load_windows(store: &dyn Store, backlog: &mut Backlog) -> Result<(), StoreError> {
    let unscreened = store.window_summaries(&WindowQuery {
        unscreened: true,
        count_max: WINDOWS_MAX,
        ..WindowQuery::default()
    })?;
    let unannounced = store.window_summaries(&WindowQuery {
        unannounced: true,
        count_max: WINDOWS_MAX,
        ..WindowQuery::default()
    })?;
    backlog.more = unscreened.len().max(unannounced.len()) >= WINDOWS_MAX;
    for summary in unscreened {
        if let Some(window) = store.window(&summary.id)? {
            backlog.unscreened.push(Arc::new(window));
        }
    }
    for summary in unannounced {
        if let Some(screening) = summary.screening
            && let Some(window) = store.window(&summary.id)?
        {
            backlog.unannounced.push((Arc::new(window), screening));
        }
    }
    Ok(())
}

fn unpublished(store: &dyn Store) -> Result<Vec<PendingDocument>, StoreError> {
    let sets = store.unpublished_sets()?.into_iter();
    let mut pending: Vec<PendingDocument> = sets
        .map(|set| PendingDocument {
            kind: DocumentKind::Set,
            site: set.site,
            version: set.version,
            document: set.document,
        })
        .collect();
    for stored in store.unpublished_diagnoses()? {
        if let Some(document) = stored.document {
            pending.push(PendingDocument {
                kind: DocumentKind::Diagnosis,
                site: stored.site,
                version: stored.version,
                document,
            });
        }
    }
    Ok(pending)
}
