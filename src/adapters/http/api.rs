//! `/api/v1`: what the store holds. `actions` has what changes it.

use std::sync::Arc;

use axum::{
    Json, Router,
    extract::{Path, Query, State},
    http::{StatusCode, header},
    response::{IntoResponse, Response},
    routing::get,
};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{
    Context,
    documents::{
        DecisionDocument, DiagnosisDocument, EventDocument, FitDocument, SetDocument, SiteDocument,
        StructureDocument,
    },
    effects::effect_document,
};
use crate::{
    adapters::store::{FitId, JobKind, Store, StoreError, WindowQuery},
    load_model::effects as catalogue,
};

pub(super) fn routes() -> Router<Arc<Context>> {
    Router::new()
        .route("/api/v1/sites", get(sites))
        .route("/api/v1/events", get(events))
        .route("/api/v1/sites/{site}/sets", get(sets))
        .route("/api/v1/sites/{site}/sets/{version}", get(set))
        .route("/api/v1/sites/{site}/parameters", get(parameters))
        .route("/api/v1/sites/{site}/decisions", get(decisions))
        .route("/api/v1/sites/{site}/diagnoses", get(diagnoses))
        .route(
            "/api/v1/sites/{site}/diagnoses/latest",
            get(latest_diagnosis),
        )
        .route("/api/v1/sites/{site}/diagnoses/{version}", get(diagnosis))
        .route("/api/v1/sites/{site}/structure", get(structure))
        .route("/api/v1/sites/{site}/fits", get(fits))
        .route("/api/v1/sites/{site}/fits/{id}", get(fit))
        .route("/api/v1/effects", get(effects))
        .route("/api/v1/effects/{name}", get(effect))
}

#[derive(Debug, Deserialize)]
struct EventsQuery {
    site: Option<String>,
    before_ns: Option<i64>,
}

async fn sites(State(context): State<Arc<Context>>) -> Response {
    let found = ask(&context, |store, _| store.sites()).await;
    list(found, |site| json!(SiteDocument::from(site)))
}

async fn events(State(context): State<Arc<Context>>, Query(query): Query<EventsQuery>) -> Response {
    let found = ask(&context, move |store, count_max| {
        store.window_summaries(&WindowQuery {
            site: query.site.as_deref(),
            before_ns: query.before_ns,
            count_max,
            ..WindowQuery::default()
        })
    })
    .await;
    list(found, |window| json!(EventDocument::from(window)))
}

async fn sets(State(context): State<Arc<Context>>, Path(site): Path<String>) -> Response {
    let found = ask(&context, move |store, count_max| {
        store.sets(&site, count_max)
    });
    list(found.await, |set| json!(SetDocument::from(set)))
}

async fn decisions(State(context): State<Arc<Context>>, Path(site): Path<String>) -> Response {
    let found = ask(&context, move |store, count_max| {
        store.decisions(&site, count_max)
    });
    list(found.await, |record| json!(DecisionDocument::from(record)))
}

async fn set(
    State(context): State<Arc<Context>>,
    Path((site, version)): Path<(String, u64)>,
) -> Response {
    let subject = format!("version {version} of `{site}`");
    let found = ask(&context, move |store, _| store.set(&site, version)).await;
    document(found.map(|found| found.map(|set| set.document)), &subject)
}

async fn parameters(State(context): State<Arc<Context>>, Path(site): Path<String>) -> Response {
    let subject = format!("published set of `{site}`");
    let found = ask(&context, move |store, _| store.set_in_force(&site)).await;
    document(found.map(|found| found.map(|set| set.document)), &subject)
}

async fn diagnoses(State(context): State<Arc<Context>>, Path(site): Path<String>) -> Response {
    let found = ask(&context, move |store, count_max| {
        store.diagnoses(&site, count_max)
    });
    list(found.await, |stored| json!(DiagnosisDocument::from(stored)))
}

async fn latest_diagnosis(
    State(context): State<Arc<Context>>,
    Path(site): Path<String>,
) -> Response {
    let subject = format!("diagnosis of `{site}`");
    let found = ask(&context, move |store, _| store.newest_diagnosis(&site)).await;
    document(found.map(|found| found.and_then(|d| d.document)), &subject)
}

async fn diagnosis(
    State(context): State<Arc<Context>>,
    Path((site, version)): Path<(String, u64)>,
) -> Response {
    let subject = format!("diagnosis {version} of `{site}`");
    let found = ask(&context, move |store, _| store.diagnosis(&site, version)).await;
    document(found.map(|found| found.and_then(|d| d.document)), &subject)
}

/// Which model a site is to have, and what it was to have before, newest first.
async fn structure(State(context): State<Arc<Context>>, Path(site): Path<String>) -> Response {
    let found = ask(&context, move |store, count_max| {
        store.structures(&site, count_max)
    });
    list(found.await, |record| json!(StructureDocument::from(record)))
}

#[derive(Debug, Default, Deserialize)]
struct FitsQuery {
    /// `joint`, the default, or `single`: fits of one event alone.
    #[serde(default)]
    kind: FitKind,
}

#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
enum FitKind {
    #[default]
    Joint,
    Single,
}

async fn fits(
    State(context): State<Arc<Context>>,
    Path(site): Path<String>,
    Query(query): Query<FitsQuery>,
) -> Response {
    let kind = match query.kind {
        FitKind::Joint => JobKind::IdentifySite,
        FitKind::Single => JobKind::IdentifyEvent,
    };
    let found = ask(&context, move |store, count_max| {
        store.fits(&site, kind, count_max)
    });
    list(found.await, |fit| json!(FitDocument::from(fit)))
}

async fn fit(
    State(context): State<Arc<Context>>,
    Path((site, id)): Path<(String, i64)>,
) -> Response {
    let subject = format!("document of fit {id} of `{site}`");
    let found = ask(&context, move |store, _| store.fit(FitId(id))).await;
    let of_site = found.map(|found| found.filter(|fit| fit.site == site));
    document(
        of_site.map(|found| found.and_then(|fit| fit.document)),
        &subject,
    )
}

async fn effects() -> Response {
    let all: Vec<Value> = catalogue::catalogue()
        .iter()
        .map(|effect| effect_document(effect.declaration()))
        .collect();
    Json(json!({ "effects": all })).into_response()
}

async fn effect(Path(name): Path<String>) -> Response {
    catalogue::find(&name).map_or_else(
        || {
            problem(
                StatusCode::NOT_FOUND,
                &format!("there is no effect `{name}`"),
            )
        },
        |effect| Json(effect_document(effect.declaration())).into_response(),
    )
}

/// Asks the store on a thread that may block.
pub(super) async fn ask<T: Send + 'static>(
    context: &Arc<Context>,
    question: impl FnOnce(&dyn Store, usize) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, Response> {
    let (store, rows_max) = (Arc::clone(&context.store), context.rows_max);
    let answer = tokio::task::spawn_blocking(move || question(store.as_ref(), rows_max)).await;
    match answer {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => {
            tracing::warn!(%error, "a page could not be answered");
            Err(problem(
                StatusCode::SERVICE_UNAVAILABLE,
                "the store did not answer",
            ))
        }
        Err(_) => Err(problem(StatusCode::INTERNAL_SERVER_ERROR, "interrupted")),
    }
}

fn list<T>(found: Result<Vec<T>, Response>, row: impl Fn(&T) -> Value) -> Response {
    match found {
        Ok(rows) => Json(Value::Array(rows.iter().map(row).collect())).into_response(),
        Err(response) => response,
    }
}

/// The stored bytes themselves: what was published, not what this version would write.
fn document(found: Result<Option<String>, Response>, subject: &str) -> Response {
    match found {
        Ok(Some(document)) => {
            ([(header::CONTENT_TYPE, "application/json")], document).into_response()
        }
        Ok(None) => problem(StatusCode::NOT_FOUND, &format!("there is no {subject}")),
        Err(response) => response,
    }
}

pub(super) fn problem(status: StatusCode, error: &str) -> Response {
    (status, Json(json!({ "error": error }))).into_response()
}
