//! What pages change: each form's action is kept with who and when, and the reader is sent on.

use std::sync::Arc;

use axum::{
    http::StatusCode,
    response::{IntoResponse, Redirect, Response},
};

use super::{desk::Desk, problem::Problem, view::Form};
use crate::adapters::store::StoreError;

/// Who acts by a page: its form is all that is known of the reader.
pub(super) const ACTOR: &str = "http: page";
/// Characters of a comment at most.
const COMMENT_CHARACTERS_MAX: usize = 500;

/// A comment fit to be kept.
///
/// # Errors
///
/// The refusal, for the reader.
pub(super) fn comment(text: &str) -> Result<String, Problem> {
    let text = text.trim();
    let long = text.chars().count() > COMMENT_CHARACTERS_MAX;
    if long || text.chars().any(char::is_control) {
        let detail =
            format!("a comment has at most {COMMENT_CHARACTERS_MAX} characters on one line");
        return Err(Problem::bad_request(detail));
    }
    Ok(text.to_owned())
}

/// What the reader did wrong is told in words; what the store cannot do is told in the log.
pub(super) fn problem(error: StoreError) -> Problem {
    match error {
        StoreError::Unknown { .. } => Problem::not_found(error.to_string()),
        StoreError::Structure { .. } => Problem {
            status: StatusCode::UNPROCESSABLE_ENTITY,
            detail: error.to_string(),
        },
        other => other.into(),
    }
}

/// Does it on a thread that may block, and sends the reader to `next`.
pub(super) async fn act(
    desk: Arc<Desk>,
    next: &str,
    action: impl FnOnce(&Desk, i64) -> Result<(), Problem> + Send + 'static,
) -> Response {
    let now_ns = desk.context.health.now_ns();
    let done = tokio::task::spawn_blocking(move || action(&desk, now_ns)).await;
    match done {
        Ok(Ok(())) => Redirect::to(next).into_response(),
        Ok(Err(problem)) => problem.answer(Form::Html),
        Err(_) => Problem::unavailable("the action was interrupted").answer(Form::Html),
    }
}
