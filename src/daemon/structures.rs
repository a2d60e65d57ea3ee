//! Which model each site is fitted with: what was said last, by the configuration or by somebody.

use super::settings::Settings;
use crate::{
    adapters::store::{
        JobKind, NewStructure, Origin, Standing, Store, StoreError, StoredFit, StructureChange,
    },
    load_model::Structure,
};

/// The model that a site is to have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Wanted {
    /// Its parts.
    pub(super) structure: Vec<String>,
    /// Which time it is that the site takes this structure up, from 0: part of what a joint fit and
    /// a diagnosis are asked with, so that who comes back to a structure has it decided on again,
    /// once.
    pub(super) turn: usize,
}

/// The model that a site is to have.
pub(super) fn in_force(
    store: &dyn Store,
    settings: &Settings,
    site: &str,
) -> Result<Wanted, StoreError> {
    let mut records = store.structures(site, usize::MAX)?;
    let turn = Standing::of(&records).unwrap_or_default().times_before;
    let structure = if records.is_empty() {
        settings.structure(site)
    } else {
        records.swap_remove(0).structure
    };
    Ok(Wanted { structure, turn })
}

/// Notes what the configuration says of each site, where it says something else than at the start
/// before: then it is the last word, until somebody says otherwise.
pub(super) fn take_up_configured(
    store: &dyn Store,
    settings: &Settings,
    now_ns: i64,
) -> Result<(), StoreError> {
    for site in &settings.sites {
        let name = &site.site.name;
        let before = store.structure(name, Some(Origin::Configuration))?;
        if before.is_some_and(|record| record.structure == site.structure) {
            continue;
        }
        let new = NewStructure {
            site: name,
            change: &StructureChange::Set(site.structure.clone()),
            origin: Origin::Configuration,
            actor: &settings.service.instance,
            comment: "",
        };
        store.change_structure(&new, now_ns)?;
    }
    Ok(())
}

/// Sites whose newest joint fit is one of another structure than they are to have, or older than
/// their coming back to it: a change that nobody has told this service of.
pub(super) fn not_fitted(store: &dyn Store) -> Result<Vec<String>, StoreError> {
    let mut sites = Vec::new();
    for site in store.sites()? {
        let records = store.structures(&site.name, usize::MAX)?;
        let (Some(record), Some(standing)) = (records.first(), Standing::of(&records)) else {
            continue;
        };
        let newest = store.fits(&site.name, JobKind::IdentifySite, 1)?;
        let came_back =
            |fit: &StoredFit| standing.times_before > 0 && fit.stored_ns < standing.since_ns;
        if newest
            .first()
            .is_some_and(|fit| fit.structure != record.structure || came_back(fit))
        {
            sites.push(site.name);
        }
    }
    Ok(sites)
}

/// Names and versions of the parts, for a hash of what a fit depends on; the names alone where a
/// part is not known to this program, which the fit itself will say.
pub(super) fn versioned(structure: &[String]) -> Vec<String> {
    let Ok(parsed) = Structure::parse(structure) else {
        return structure.to_vec();
    };
    let versions = parsed.versions().into_iter();
    let parts = parsed.names().into_iter().zip(versions);
    parts
        .map(|(name, version)| format!("{name} {version}"))
        .collect()
}
