//! The server: routes, headers that browsers are to obey, start and stop.

use std::{io, net::SocketAddr, sync::Arc};

use axum::{
    Json, Router,
    extract::{Request, State},
    http::{HeaderValue, StatusCode, header},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::get,
};
use tokio::net::TcpListener;

use super::{
    Actions, Health, actions, api,
    connections::{self, Limits},
    draining::drained,
};
use crate::{
    adapters::{prometheus, store::Store, web},
    telemetry::Metrics,
};

/// What the pages are made from.
#[derive(Debug)]
pub struct Context {
    /// The store.
    pub store: Arc<dyn Store>,
    /// The metrics.
    pub metrics: Arc<Metrics>,
    /// Health.
    pub health: Arc<Health>,
    /// What people may do.
    pub actions: Actions,
    /// Whether the pages act without asking for the token when reached by an address of this machine:
    /// for demonstrations.
    pub open_pages: bool,
    /// Rows of one answer at most.
    pub rows_max: usize,
}

/// Takes the address; the port is known from here on.
///
/// # Errors
///
/// When the address cannot be taken.
pub async fn bind(address: SocketAddr) -> io::Result<(TcpListener, SocketAddr)> {
    let listener = TcpListener::bind(address).await?;
    let bound = listener.local_addr()?;
    Ok((listener, bound))
}

/// Serves until `stop` is ready.
pub async fn serve(
    listener: TcpListener,
    context: Arc<Context>,
    stop: impl Future<Output = ()> + Send + 'static,
) {
    let metrics = Arc::clone(&context.metrics);
    connections::serve(listener, router(context), &metrics, Limits::default(), stop).await;
}

fn router(context: Arc<Context>) -> Router {
    Router::new()
        .route("/metrics", get(metrics))
        .route("/healthz", get(health))
        .route("/livez", get(live))
        .merge(api::routes())
        .merge(actions::routes())
        .with_state(Arc::clone(&context))
        .merge(web::router(context))
        .layer(middleware::from_fn(web::in_words))
        .layer(middleware::from_fn(drained))
        .layer(middleware::from_fn(with_headers))
}

async fn metrics(State(context): State<Arc<Context>>) -> Response {
    match prometheus::render(&context.metrics) {
        Ok(text) => ([(header::CONTENT_TYPE, prometheus::CONTENT_TYPE)], text).into_response(),
        Err(error) => {
            tracing::error!(%error, "metrics cannot be rendered");
            StatusCode::INTERNAL_SERVER_ERROR.into_response()
        }
    }
}

/// 200 when alive and ready, 503 otherwise.
async fn health(State(context): State<Arc<Context>>) -> Response {
    let report = context.health.report();
    (status(report.live && report.ready), Json(report)).into_response()
}

/// 200 when alive, ready or not.
async fn live(State(context): State<Arc<Context>>) -> Response {
    let report = context.health.report();
    (status(report.live), Json(report)).into_response()
}

const fn status(good: bool) -> StatusCode {
    if good {
        StatusCode::OK
    } else {
        StatusCode::SERVICE_UNAVAILABLE
    }
}

/// Nothing is loaded from elsewhere, nothing is framed, nothing is guessed.
async fn with_headers(request: Request, next: Next) -> Response {
    let mut response = next.run(request).await;
    let headers = response.headers_mut();
    for (name, value) in [
        (
            header::CONTENT_SECURITY_POLICY,
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; \
             connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
        ),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "same-origin"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    // What is addressed by its content says itself how long it may be kept.
    headers
        .entry(header::CACHE_CONTROL)
        .or_insert(HeaderValue::from_static("no-store"));
    response
}
