//! What a page answers when it cannot be shown.

use axum::{
    Json,
    http::StatusCode,
    response::{Html, IntoResponse, Response},
};
use maud::html;
use serde_json::json;

use super::{layout, view::Form};
use crate::adapters::store::StoreError;

/// Why a page cannot be shown, for the reader.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Problem {
    /// Status of the answer.
    pub(super) status: StatusCode,
    /// What is wrong, in a sentence.
    pub(super) detail: String,
}

impl Problem {
    pub(super) fn not_found(detail: impl Into<String>) -> Self {
        Self {
            status: StatusCode::NOT_FOUND,
            detail: detail.into(),
        }
    }

    pub(super) fn bad_request(detail: impl Into<String>) -> Self {
        Self {
            status: StatusCode::BAD_REQUEST,
            detail: detail.into(),
        }
    }

    pub(super) fn unavailable(detail: impl Into<String>) -> Self {
        Self {
            status: StatusCode::SERVICE_UNAVAILABLE,
            detail: detail.into(),
        }
    }

    /// A document in the store that cannot be read: damage, or a newer version's.
    pub(super) fn unreadable(what: &str, error: &dyn std::fmt::Display) -> Self {
        tracing::warn!(%error, what, "a stored document cannot be read");
        Self {
            status: StatusCode::INTERNAL_SERVER_ERROR,
            detail: format!("{what} is in the store but cannot be read: {error}"),
        }
    }

    /// The answer in the form that was asked for; CSV has no way to say it but the status.
    pub(super) fn answer(&self, form: Form) -> Response {
        let reason = self.status.canonical_reason().unwrap_or("refused");
        if form != Form::Html {
            return (self.status, Json(json!({ "error": self.detail }))).into_response();
        }
        let body = html! {
            h1 { (reason) }
            p.problem { @for (place, part) in self.detail.split('`').enumerate() {
                @if place % 2 == 1 { code { (part) } } @else { (part) }
            } }
            p { a href="/" { "All sites" } }
        };
        let page = layout::plain(reason, &body);
        (self.status, Html(page.into_string())).into_response()
    }
}

impl From<StoreError> for Problem {
    fn from(error: StoreError) -> Self {
        tracing::warn!(%error, "a page could not be answered");
        Self::unavailable("the store did not answer; the log says why")
    }
}
