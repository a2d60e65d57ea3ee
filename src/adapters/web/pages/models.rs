//! Which models can be held against an event, and the choice among them.

use maud::{Markup, html};

use super::super::{desk::Desk, layout::SiteHead, problem::Problem, words};
use crate::{
    adapters::store::{FitId, JobKind, StoredFit},
    identification::ParameterSet,
};

/// Choices of one kind offered at most.
const OFFERED_MAX: usize = 30;

/// A model that a page can draw.
#[derive(Clone, Debug)]
pub(super) struct Model {
    /// As an address names it: `set-3`, `fit-12`.
    pub(super) key: String,
    /// As a reader sees it.
    pub(super) label: String,
    pub(super) set: ParameterSet,
    pub(super) content_hash: String,
}

/// A model that may be chosen.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Choice {
    pub(super) key: String,
    pub(super) label: String,
}

/// Every published version, the site's newest fits, and the fit of the event alone.
pub(super) fn choices(
    desk: &Desk,
    site: &str,
    event: Option<&str>,
) -> Result<Vec<Choice>, Problem> {
    let store = desk.store();
    let mut choices: Vec<Choice> = store
        .sets(site, OFFERED_MAX)?
        .iter()
        .map(|set| Choice {
            key: format!("set-{}", set.version),
            label: format!(
                "version {} of {}",
                set.version,
                words::utc(set.committed_ns)
            ),
        })
        .collect();
    let mut fits = store.fits(site, JobKind::IdentifySite, OFFERED_MAX)?;
    if let Some(event) = event {
        let alone = store.fits(site, JobKind::IdentifyEvent, OFFERED_MAX)?;
        fits.extend(alone.into_iter().filter(|fit| fit.subject == event));
    }
    choices.extend(
        fits.iter()
            .filter(|fit| fit.set_document.is_some())
            .map(|fit| Choice {
                key: format!("fit-{}", fit.id.0),
                label: fit_label(fit),
            }),
    );
    Ok(choices)
}

fn fit_label(fit: &StoredFit) -> String {
    let of = match fit.kind {
        JobKind::IdentifySite => "joint fit",
        JobKind::IdentifyEvent => "fit of one event alone",
        JobKind::DiagnoseSite => "diagnosis",
    };
    format!("{of} {}: {}", fit.id.0, words::structure(&fit.structure))
}

/// The model of that name.
pub(super) fn model(desk: &Desk, site: &str, key: &str) -> Result<Model, Problem> {
    let unknown = || Problem::not_found(format!("`{site}` has no model `{key}`"));
    let malformed = || {
        Problem::bad_request(format!(
            "`{key}` names no model: it is `set-` or `fit-` and a number"
        ))
    };
    let (kind, number) = key.split_once('-').ok_or_else(malformed)?;
    match kind {
        "set" => {
            let version = number.parse().map_err(|_| malformed())?;
            let stored = desk.store().set(site, version)?.ok_or_else(unknown)?;
            let set = stored
                .set()
                .map_err(|e| Problem::unreadable("the set", &e))?;
            Ok(Model {
                key: key.to_owned(),
                label: format!("version {version}"),
                content_hash: stored.content_hash,
                set,
            })
        }
        "fit" => {
            let id = number.parse().map_err(|_| malformed())?;
            let fit = desk.store().fit(FitId(id))?.filter(|fit| fit.site == site);
            let fit = fit.ok_or_else(unknown)?;
            let set = fit.set().map_err(|e| Problem::unreadable("the fit", &e))?;
            let label = format!("fit {id}");
            let set = set.ok_or_else(unknown)?;
            Ok(Model {
                key: key.to_owned(),
                label,
                content_hash: fit.content_hash,
                set,
            })
        }
        _ => Err(malformed()),
    }
}

/// The model to draw when none is asked for: the set in force, else the newest joint fit, else the
/// event's own.
pub(super) fn usual(
    desk: &Desk,
    head: &SiteHead,
    event: Option<&str>,
) -> Result<Option<Model>, Problem> {
    if let Some((stored, set)) = &head.in_force {
        return Ok(Some(Model {
            key: format!("set-{}", stored.version),
            label: format!("version {}, in force", stored.version),
            set: set.clone(),
            content_hash: stored.content_hash.clone(),
        }));
    }
    let site = &head.site.name;
    let offered = choices(desk, site, event)?;
    offered
        .first()
        .map(|choice| model(desk, site, &choice.key))
        .transpose()
}

/// A selection of models.
pub(super) fn select(name: &str, choices: &[Choice], chosen: &str, none: Option<&str>) -> Markup {
    html! {
        select name=(name) {
            @if let Some(none) = none { option value="" selected[chosen.is_empty()] { (none) } }
            @for choice in choices {
                option value=(choice.key) selected[choice.key == chosen] { (choice.label) }
            }
        }
    }
}
