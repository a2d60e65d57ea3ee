//! Which address leads to which page.

use std::{sync::Arc, time::Duration};

use axum::{
    Router,
    extract::{DefaultBodyLimit, Request, State},
    http::{StatusCode, Uri, header},
    middleware::{self, Next},
    response::{IntoResponse, Redirect, Response},
    routing::{MethodRouter, get, post},
};

use super::{
    assets,
    desk::Desk,
    openapi,
    pages::{
        compare, diagnosis, event, events, health, recordings, sets, sites, solutions, streams,
        structure,
    },
    problem::Problem,
    session, updates,
    view::Form,
};
use crate::adapters::http::Context;

/// Longest time to make one page. Live updates are not bound by it.
const PAGE_LIMIT: Duration = Duration::from_secs(30);
/// Bytes of a request's body at most.
const BODY_BYTES_MAX: usize = 64 * 1024;

/// Bytes of a refusal of the framework looked at.
const REFUSAL_BYTES_MAX: usize = 4096;

pub(super) type Pages = Router<Arc<Desk>>;

/// Every page.
pub(in crate::adapters) fn router(context: Arc<Context>) -> Router {
    let desk = Arc::new(Desk::new(context));
    pages()
        .route("/session", get(session::ask).post(session::open))
        .layer(middleware::from_fn(within_limit))
        .route("/sites/{site}/updates", get(updates::stream))
        .route("/updates", get(updates::stream_of_all))
        .route("/api/v1/openapi.json", get(openapi::document))
        .route("/static/{mark}/{name}", get(assets::serve))
        .fallback(unknown)
        .layer(DefaultBodyLimit::max(BODY_BYTES_MAX))
        .with_state(desk)
}

fn pages() -> Pages {
    let mut router = Router::new()
        .route("/", get(sites::show))
        .route("/sites/{site}", get(site))
        .route("/sites/{site}/events/{event}", get(event::show))
        .route(
            "/sites/{site}/diagnoses/{version}",
            get(diagnosis::show_one),
        )
        .route("/sites/{site}/sets/{version}", get(sets::show_one))
        .route("/sites/{site}/recordings/{id}", get(recordings::show_one))
        .route(
            "/sites/{site}/recordings",
            post(recordings::take).layer(DefaultBodyLimit::max(recordings::FILES_BYTES_MAX)),
        )
        .route(
            "/api/v1/sites/{site}/recordings",
            post(recordings::take_from_program)
                .layer(DefaultBodyLimit::max(recordings::FILES_BYTES_MAX)),
        )
        .route("/sites/{site}/structure", post(structure::change))
        .route(
            "/sites/{site}/sets/{version}/roll-back",
            post(sets::roll_back),
        )
        .route("/sites/{site}/decisions/{id}", post(sets::answer));
    for (path, page) in [
        ("/sites", get(sites::show)),
        ("/sites/{site}/events", get(events::show)),
        ("/sites/{site}/compare", get(compare::show)),
        ("/sites/{site}/diagnosis", get(diagnosis::show)),
        ("/sites/{site}/structure", get(structure::show)),
        ("/sites/{site}/solutions", get(solutions::show)),
        ("/sites/{site}/recordings", get(recordings::show)),
        ("/sites/{site}/sets", get(sets::show)),
        ("/streams", get(streams::show)),
        ("/health", get(health::show)),
    ] {
        router = twins(router, path, &page);
    }
    router
}

/// A page and its twins.
fn twins(router: Pages, path: &str, page: &MethodRouter<Arc<Desk>>) -> Pages {
    ["", ".json", ".csv", ".charts.json"]
        .iter()
        .fold(router, |router, ending| {
            router.route(&format!("{path}{ending}"), page.clone())
        })
}

/// A site's first page is its events.
async fn site(
    State(desk): State<Arc<Desk>>,
    axum::extract::Path(site): axum::extract::Path<String>,
) -> Response {
    let looked_up = {
        let (desk, site) = (Arc::clone(&desk), site.clone());
        tokio::task::spawn_blocking(move || desk.site(&site)).await
    };
    match looked_up {
        Ok(Ok(found)) => {
            let address = super::layout::site_address(&found.name, "events");
            Redirect::to(&address).into_response()
        }
        Ok(Err(problem)) => problem.answer(Form::Html),
        Err(_) => Problem::unavailable("the page was interrupted").answer(Form::Html),
    }
}

async fn unknown(uri: Uri) -> Response {
    let (_, form) = Form::of(uri.path());
    Problem::not_found(format!("there is nothing at {}", uri.path())).answer(form)
}

/// A refusal that the framework words by itself becomes a page, or JSON where that was asked for.
pub(in crate::adapters) async fn in_words(request: Request, next: Next) -> Response {
    let (_, form) = Form::of(request.uri().path());
    let method = request.method().clone();
    let response = next.run(request).await;
    let status = response.status();
    let content_type = response.headers().get(header::CONTENT_TYPE);
    let is_page = content_type.is_some_and(|kind| !kind.as_bytes().starts_with(b"text/plain"));
    if is_page || !(status.is_client_error() || status.is_server_error()) {
        return response;
    }
    let allow = response.headers().get(header::ALLOW).cloned();
    let words = axum::body::to_bytes(response.into_body(), REFUSAL_BYTES_MAX).await;
    let words = words.unwrap_or_default();
    let detail = match status {
        StatusCode::PAYLOAD_TOO_LARGE => "what was sent is larger than this form may be".to_owned(),
        StatusCode::METHOD_NOT_ALLOWED => format!("nothing can be done here with {method}"),
        _ => String::from_utf8_lossy(&words).into_owned(),
    };
    let mut answer = Problem { status, detail }.answer(form);
    if let Some(allow) = allow {
        answer.headers_mut().insert(header::ALLOW, allow);
    }
    answer
}

async fn within_limit(request: Request, next: Next) -> Response {
    let (_, form) = Form::of(request.uri().path());
    tokio::time::timeout(PAGE_LIMIT, next.run(request))
        .await
        .unwrap_or_else(|_| {
            let problem = Problem {
                status: StatusCode::GATEWAY_TIMEOUT,
                detail: format!(
                    "this took longer than {} s and was given up",
                    PAGE_LIMIT.as_secs()
                ),
            };
            problem.answer(form)
        })
}
