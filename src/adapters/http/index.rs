//! The start page: sites, newest events and sets, and where everything else is.

use std::sync::Arc;

use axum::{
    extract::State,
    response::{Html, IntoResponse, Response},
};
use maud::{DOCTYPE, Markup, html};

use super::{Context, api::ask, documents::EventDocument};
use crate::{
    adapters::{
        store::{Store, StoreError, StoredSet, WindowQuery, WindowSummary},
        wire::v1::rfc3339,
    },
    measurement::Site,
};

/// Newest events that the page shows.
const EVENTS_MAX: usize = 50;

struct Contents {
    sites: Vec<(Site, Option<StoredSet>)>,
    events: Vec<WindowSummary>,
}

pub(super) async fn index(State(context): State<Arc<Context>>) -> Response {
    match ask(&context, |store, _| load(store)).await {
        Ok(contents) => Html(page(&contents).into_string()).into_response(),
        Err(response) => response,
    }
}

fn load(store: &dyn Store) -> Result<Contents, StoreError> {
    let sites = store
        .sites()?
        .into_iter()
        .map(|site| {
            let set = store.set_in_force(&site.name)?;
            Ok((site, set))
        })
        .collect::<Result<_, StoreError>>()?;
    let events = store.window_summaries(&WindowQuery {
        count_max: EVENTS_MAX,
        ..WindowQuery::default()
    })?;
    Ok(Contents { sites, events })
}

fn page(contents: &Contents) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "loadmodeld" }
                style { (STYLE) }
            }
            body {
                h1 { "loadmodeld " (env!("CARGO_PKG_VERSION")) }
                nav {
                    a href="/metrics" { "metrics" } " "
                    a href="/healthz" { "health" } " "
                    a href="/api/v1/sites" { "sites.json" } " "
                    a href="/api/v1/events" { "events.json" }
                }
                h2 { "Sites" }
                (sites(&contents.sites))
                h2 { "Newest events" }
                (events(&contents.events))
            }
        }
    }
}

fn sites(sites: &[(Site, Option<StoredSet>)]) -> Markup {
    html! {
        table {
            tr { th { "site" } th { "base" } th { "set in force" } th { "published" } th { "more" } }
            @for (site, set) in sites {
                tr {
                    td { (site.name) }
                    td { (site.s_base_mva) " MVA, " (site.v_base_kv) " kV, " (site.nominal_hz) " Hz" }
                    @if let Some(set) = set {
                        td {
                            a href={ "/api/v1/sites/" (site.name) "/parameters" } {
                                "version " (set.version)
                            }
                        }
                        td { (set.published_ns.map(rfc3339).unwrap_or_default()) }
                    } @else {
                        td { "none yet" }
                        td {}
                    }
                    td {
                        a href={ "/api/v1/sites/" (site.name) "/sets" } { "sets" } " "
                        a href={ "/api/v1/sites/" (site.name) "/decisions" } { "decisions" } " "
                        a href={ "/api/v1/events?site=" (site.name) } { "events" }
                    }
                }
            }
        }
    }
}

fn events(events: &[WindowSummary]) -> Markup {
    html! {
        table {
            tr {
                th { "event" } th { "onset" } th { "lowest voltage" } th { "triggers" } th { "screening" }
            }
            @for event in events {
                @let document = EventDocument::from(event);
                tr {
                    td { (document.event) }
                    td { (document.onset_utc) }
                    td {
                        @if let Some(voltage) = document.lowest_voltage_pu {
                            (format!("{voltage:.3} pu"))
                        }
                    }
                    td { (document.triggers.join(", ")) }
                    td { (screening(event)) }
                }
            }
        }
    }
}

fn screening(event: &WindowSummary) -> String {
    match &event.screening {
        None => "not judged yet".to_owned(),
        Some(screening) if screening.usable() => "usable".to_owned(),
        Some(screening) => {
            let reasons = screening.refusals.iter().map(ToString::to_string);
            reasons.collect::<Vec<_>>().join("; ")
        }
    }
}

const STYLE: &str = "body{font:16px/1.5 sans-serif;margin:2rem;max-width:80rem}\
table{border-collapse:collapse}th,td{text-align:left;padding:.25rem 1rem .25rem 0;\
border-bottom:1px solid #ccc;vertical-align:top}";
