//! What people may do: choose the model of a site, answer a decision that waits, roll back to an
//! older set. Each is written into the store with who and when, and the service is told.

use std::{fmt, sync::Arc, time::Duration};

use axum::{
    Json, Router,
    extract::{
        DefaultBodyLimit, FromRequestParts, Path, Request, State,
        rejection::{JsonRejection, PathRejection},
    },
    http::{HeaderMap, HeaderValue, StatusCode, header, request::Parts},
    middleware::{self, Next},
    response::{IntoResponse, Response},
    routing::post,
};
use serde::Deserialize;
use serde_json::json;

use super::{Context, Token, api::problem, documents::StructureDocument};
use crate::adapters::store::{
    Approval, DecisionId, NewStructure, Origin, RollBack, Saved, Store, StoreError,
    StructureChange, StructureRecord, what_follows,
};

/// Bytes of a request's body at most.
const BODY_BYTES_MAX: usize = 16 * 1024;
/// Longest time for one action, its body included.
const ACTION_LIMIT: Duration = Duration::from_secs(10);
/// Characters of a comment or of a name at most.
const TEXT_CHARACTERS_MAX: usize = 500;

/// Something that was done; the store knows already.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Change {
    /// A site is to have another model.
    Structure(StructureRecord),
    /// Another set counts, or a decision was answered.
    Sets {
        /// Site.
        site: String,
        /// `approve`, `refuse` or `roll_back`.
        action: &'static str,
        /// Version that counts now; none when it stays as it was.
        version: Option<u64>,
        /// Who.
        actor: String,
    },
}

/// Who may do what, and who is told.
pub struct Actions {
    token: Option<Token>,
    tell: Box<dyn Fn(Change) + Send + Sync>,
}

impl fmt::Debug for Actions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Actions")
            .field("token", &self.token)
            .finish_non_exhaustive()
    }
}

/// Why a request may change nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// Nobody may.
    #[error("this service is read-only: no token is configured (http.token_file)")]
    ReadOnly,
    /// The request comes from a page of somebody else.
    #[error("the request comes from another site's page")]
    OtherOrigin,
    /// The token is not there.
    #[error("the token is missing: send `Authorization: Bearer TOKEN`")]
    NoToken,
    /// The token is another one.
    #[error("the token is wrong")]
    WrongToken,
}

impl Actions {
    /// Without a token nobody may do anything. `tell` must return at once.
    pub fn new(token: Option<Token>, tell: impl Fn(Change) + Send + Sync + 'static) -> Self {
        Self {
            token,
            tell: Box::new(tell),
        }
    }

    /// Whether anybody may do anything.
    #[must_use]
    pub const fn are_possible(&self) -> bool {
        self.token.is_some()
    }

    /// A word that only who knows the token can know; none without a token.
    pub(in crate::adapters) fn derived(&self, purpose: &str) -> Option<String> {
        self.token.as_ref().map(|token| token.derived(purpose))
    }

    /// Whether a request with these headers may change something.
    ///
    /// # Errors
    ///
    /// [`Refusal`] when it may not.
    pub fn admit(&self, headers: &HeaderMap) -> Result<(), Refusal> {
        same_origin(headers)?;
        let value = headers.get(header::AUTHORIZATION);
        let bearer = value
            .and_then(|value| value.to_str().ok())
            .and_then(|text| text.split_once(' '))
            .filter(|(scheme, _)| scheme.eq_ignore_ascii_case("bearer"))
            .map(|(_, token)| token.trim());
        self.admit_token(bearer)
    }

    /// Whether whoever shows this token may change something.
    ///
    /// # Errors
    ///
    /// [`Refusal`] when not.
    pub fn admit_token(&self, presented: Option<&str>) -> Result<(), Refusal> {
        match (&self.token, presented) {
            (None, _) => Err(Refusal::ReadOnly),
            (Some(_), None) => Err(Refusal::NoToken),
            (Some(token), Some(presented)) if token.matches(presented) => Ok(()),
            (Some(_), Some(_)) => Err(Refusal::WrongToken),
        }
    }

    /// Changes the model of a site.
    ///
    /// # Errors
    ///
    /// [`StoreError`].
    pub fn change_structure(
        &self,
        store: &dyn Store,
        new: &NewStructure<'_>,
        now_ns: i64,
    ) -> Result<(StructureRecord, Saved), StoreError> {
        let (record, saved) = store.change_structure(new, now_ns)?;
        if saved == Saved::Stored {
            (self.tell)(Change::Structure(record.clone()));
        }
        Ok((record, saved))
    }

    /// Answers a decision that waits; the version under which its set is published, if it is.
    ///
    /// # Errors
    ///
    /// [`StoreError`].
    pub fn answer_decision(
        &self,
        store: &dyn Store,
        site: &str,
        approval: &Approval<'_>,
        now_ns: i64,
    ) -> Result<Option<u64>, StoreError> {
        let committed = store.approve(approval, now_ns)?;
        (self.tell)(Change::Sets {
            site: site.to_owned(),
            action: if approval.approved {
                "approve"
            } else {
                "refuse"
            },
            version: committed.version,
            actor: approval.actor.to_owned(),
        });
        Ok(committed.version)
    }

    /// Makes an older version count again.
    ///
    /// # Errors
    ///
    /// [`StoreError`].
    pub fn roll_back(
        &self,
        store: &dyn Store,
        to: &RollBack<'_>,
        now_ns: i64,
    ) -> Result<Saved, StoreError> {
        let saved = store.roll_back(to, now_ns)?;
        if saved == Saved::Stored {
            (self.tell)(Change::Sets {
                site: to.site.to_owned(),
                action: "roll_back",
                version: Some(to.version),
                actor: to.actor.to_owned(),
            });
        }
        Ok(saved)
    }
}

/// A browser says where a request comes from; a page of another origin may not act for its user.
fn same_origin(headers: &HeaderMap) -> Result<(), Refusal> {
    let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
    let host = text(header::HOST);
    if let Some(origin) = headers.get(header::ORIGIN) {
        let named = origin.to_str().ok().and_then(|o| o.split_once("://"));
        if host.is_none() || named.map(|(_, host)| host) != host {
            return Err(Refusal::OtherOrigin);
        }
    }
    match headers.get("sec-fetch-site").map(HeaderValue::as_bytes) {
        None | Some(b"same-origin" | b"none") => Ok(()),
        Some(_) => Err(Refusal::OtherOrigin),
    }
}

/// Proof that a request may change something.
#[derive(Debug)]
struct Admitted;

impl FromRequestParts<Arc<Context>> for Admitted {
    type Rejection = Response;

    async fn from_request_parts(
        parts: &mut Parts,
        context: &Arc<Context>,
    ) -> Result<Self, Response> {
        context
            .actions
            .admit(&parts.headers)
            .map(|()| Self)
            .map_err(refused)
    }
}

/// The answer to a program that may not act.
pub(in crate::adapters) fn refused(refusal: Refusal) -> Response {
    let status = match refusal {
        Refusal::ReadOnly | Refusal::OtherOrigin => StatusCode::FORBIDDEN,
        Refusal::NoToken | Refusal::WrongToken => StatusCode::UNAUTHORIZED,
    };
    let mut response = problem(status, &refusal.to_string());
    if status == StatusCode::UNAUTHORIZED {
        let scheme = HeaderValue::from_static("Bearer");
        let headers = response.headers_mut();
        headers.insert(header::WWW_AUTHENTICATE, scheme);
    }
    response
}

pub(super) fn routes() -> Router<Arc<Context>> {
    Router::new()
        .route("/api/v1/sites/{site}/structure", post(change_structure))
        .route(
            "/api/v1/sites/{site}/sets/{version}/roll-back",
            post(roll_back),
        )
        .route("/api/v1/sites/{site}/decisions/{id}/approve", post(approve))
        .route("/api/v1/sites/{site}/decisions/{id}/refuse", post(refuse))
        .layer(DefaultBodyLimit::max(BODY_BYTES_MAX))
        .layer(middleware::from_fn(within_limit))
}

async fn within_limit(request: Request, next: Next) -> Response {
    let answer = tokio::time::timeout(ACTION_LIMIT, next.run(request)).await;
    answer.unwrap_or_else(|_| problem(StatusCode::REQUEST_TIMEOUT, "the request took too long"))
}

/// What the asker did wrong.
struct Wrong {
    status: StatusCode,
    error: String,
}

impl Wrong {
    fn unprocessable(error: impl Into<String>) -> Self {
        Self {
            status: StatusCode::UNPROCESSABLE_ENTITY,
            error: error.into(),
        }
    }
}

impl From<Wrong> for Response {
    fn from(wrong: Wrong) -> Self {
        problem(wrong.status, &wrong.error)
    }
}

impl From<PathRejection> for Wrong {
    fn from(rejection: PathRejection) -> Self {
        Self {
            status: rejection.status(),
            error: rejection.body_text(),
        }
    }
}

impl From<JsonRejection> for Wrong {
    fn from(rejection: JsonRejection) -> Self {
        Self {
            status: rejection.status(),
            error: rejection.body_text(),
        }
    }
}

/// Exactly one of `add`, `remove`, `set`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct StructureBody {
    add: Option<String>,
    remove: Option<String>,
    set: Option<Vec<String>>,
    #[serde(default)]
    actor: String,
    #[serde(default)]
    comment: String,
}

/// Who acts and why, as they say themselves.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Who {
    #[serde(default)]
    actor: String,
    #[serde(default)]
    comment: String,
}

impl Who {
    /// The token is all that is known for sure; the name is what its holder says.
    fn known(self) -> Result<Self, Wrong> {
        for (field, text) in [("actor", &self.actor), ("comment", &self.comment)] {
            let long = text.chars().count() > TEXT_CHARACTERS_MAX;
            if long || text.chars().any(char::is_control) {
                return Err(Wrong::unprocessable(format!(
                    "`{field}`: at most {TEXT_CHARACTERS_MAX} characters on one line"
                )));
            }
        }
        let actor = if self.actor.is_empty() {
            "http".to_owned()
        } else {
            format!("http: {}", self.actor)
        };
        Ok(Self { actor, ..self })
    }
}

impl StructureBody {
    fn who(&self) -> Result<Who, Wrong> {
        Who {
            actor: self.actor.clone(),
            comment: self.comment.clone(),
        }
        .known()
    }

    fn change(&self) -> Result<StructureChange, Wrong> {
        match (&self.add, &self.remove, &self.set) {
            (Some(effect), None, None) => Ok(StructureChange::Add(effect.clone())),
            (None, Some(effect), None) => Ok(StructureChange::Remove(effect.clone())),
            (None, None, Some(parts)) => Ok(StructureChange::Set(parts.clone())),
            _ => Err(Wrong::unprocessable(
                "exactly one of `add`, `remove`, `set` is needed",
            )),
        }
    }
}

async fn change_structure(
    _admitted: Admitted,
    State(context): State<Arc<Context>>,
    path: Result<Path<String>, PathRejection>,
    body: Result<Json<StructureBody>, JsonRejection>,
) -> Result<Response, Response> {
    let Path(site) = path.map_err(Wrong::from)?;
    let Json(body) = body.map_err(Wrong::from)?;
    let (Who { actor, comment }, change) = (body.who()?, body.change()?);
    let (record, saved, note) = act(&context, move |context, now_ns| {
        let new = NewStructure {
            site: &site,
            change: &change,
            origin: Origin::Http,
            actor: &actor,
            comment: &comment,
        };
        let store = context.store.as_ref();
        let (record, saved) = context.actions.change_structure(store, &new, now_ns)?;
        let note = what_follows(store, &record, saved)?;
        Ok((record, saved, note))
    })
    .await?;
    let status = match saved {
        Saved::Stored => StatusCode::ACCEPTED,
        Saved::AlreadyStored => StatusCode::OK,
    };
    let mut document = json!(StructureDocument::from(&record));
    document["changed"] = json!(saved == Saved::Stored);
    document["note"] = json!(note);
    Ok((status, Json(document)).into_response())
}

async fn roll_back(
    _admitted: Admitted,
    State(context): State<Arc<Context>>,
    path: Result<Path<(String, u64)>, PathRejection>,
    body: Option<Json<Who>>,
) -> Result<Response, Response> {
    let Path((site, version)) = path.map_err(Wrong::from)?;
    let Who { actor, comment } = who(body)?;
    let saved = act(&context, move |context, now_ns| {
        let to = RollBack {
            site: &site,
            version,
            actor: &actor,
            comment: &comment,
        };
        let store = context.store.as_ref();
        context.actions.roll_back(store, &to, now_ns)
    })
    .await?;
    let changed = saved == Saved::Stored;
    Ok(Json(json!({"version": version, "changed": changed})).into_response())
}

async fn approve(
    admitted: Admitted,
    context: State<Arc<Context>>,
    path: Result<Path<(String, i64)>, PathRejection>,
    body: Option<Json<Who>>,
) -> Result<Response, Response> {
    answer(admitted, context, path, body, true).await
}

async fn refuse(
    admitted: Admitted,
    context: State<Arc<Context>>,
    path: Result<Path<(String, i64)>, PathRejection>,
    body: Option<Json<Who>>,
) -> Result<Response, Response> {
    answer(admitted, context, path, body, false).await
}

async fn answer(
    _admitted: Admitted,
    State(context): State<Arc<Context>>,
    path: Result<Path<(String, i64)>, PathRejection>,
    body: Option<Json<Who>>,
    approved: bool,
) -> Result<Response, Response> {
    let Path((site, id)) = path.map_err(Wrong::from)?;
    let Who { actor, comment } = who(body)?;
    let decision = DecisionId(id);
    let version = act(&context, move |context, now_ns| {
        let store = context.store.as_ref();
        let known = store.decision(decision)?;
        if known.is_none_or(|known| known.site != site) {
            return Err(StoreError::Unknown {
                operation: crate::adapters::store::Operation("answer a decision"),
                what: "decision of that site",
                id: id.to_string(),
            });
        }
        let approval = Approval {
            decision,
            approved,
            actor: &actor,
            comment: &comment,
        };
        let actions = &context.actions;
        actions.answer_decision(store, &site, &approval, now_ns)
    })
    .await?;
    Ok(Json(json!({"decision": id, "approved": approved, "version": version})).into_response())
}

fn who(body: Option<Json<Who>>) -> Result<Who, Wrong> {
    body.map(|Json(body)| body).unwrap_or_default().known()
}

/// Acts on a thread that may block.
async fn act<T: Send + 'static>(
    context: &Arc<Context>,
    action: impl FnOnce(&Context, i64) -> Result<T, StoreError> + Send + 'static,
) -> Result<T, Response> {
    let context = Arc::clone(context);
    let now_ns = context.health.now_ns();
    let done = tokio::task::spawn_blocking(move || action(&context, now_ns)).await;
    match done {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(of_store(&error)),
        Err(_) => Err(problem(StatusCode::INTERNAL_SERVER_ERROR, "interrupted")),
    }
}

/// What the asker did wrong is told in words; what the store cannot do is told in the log.
fn of_store(error: &StoreError) -> Response {
    match error {
        StoreError::Unknown { .. } => problem(StatusCode::NOT_FOUND, &error.to_string()),
        StoreError::Structure { .. } => {
            problem(StatusCode::UNPROCESSABLE_ENTITY, &error.to_string())
        }
        _ => {
            tracing::warn!(%error, "an action could not be kept");
            problem(
                StatusCode::SERVICE_UNAVAILABLE,
                "the store did not keep the change",
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "0123456789abcdef";

    fn actions(token: Option<&str>) -> Actions {
        Actions::new(token.map(|text| Token::new(text).unwrap()), |_| {})
    }

    fn headers(pairs: &[(&'static str, &'static str)]) -> HeaderMap {
        let pairs = pairs.iter();
        pairs
            .map(|(name, value)| {
                let name = header::HeaderName::from_static(name);
                (name, HeaderValue::from_static(value))
            })
            .collect()
    }

    #[test]
    fn only_the_token_admits() {
        let right = ("authorization", "Bearer 0123456789abcdef");
        let guarded = actions(Some(TOKEN));
        assert_eq!(guarded.admit(&headers(&[right])), Ok(()));
        assert_eq!(guarded.admit(&headers(&[])), Err(Refusal::NoToken));
        let wrong = headers(&[("authorization", "Bearer 0123456789abcdeX")]);
        assert_eq!(guarded.admit(&wrong), Err(Refusal::WrongToken));
        let other_scheme = headers(&[("authorization", "Basic 0123456789abcdef")]);
        assert_eq!(guarded.admit(&other_scheme), Err(Refusal::NoToken));
        let open = actions(None);
        assert_eq!(open.admit(&headers(&[right])), Err(Refusal::ReadOnly));
    }

    #[test]
    fn a_page_of_another_origin_is_refused_even_with_the_token() {
        let (right, host) = (
            ("authorization", "Bearer 0123456789abcdef"),
            ("host", "127.0.0.1:9464"),
        );
        let guarded = actions(Some(TOKEN));
        let own = headers(&[right, host, ("origin", "http://127.0.0.1:9464")]);
        assert_eq!(guarded.admit(&own), Ok(()));
        for origin in ["http://evil.example", "null", "http://127.0.0.1:9465"] {
            let other = headers(&[right, host, ("origin", origin)]);
            assert_eq!(guarded.admit(&other), Err(Refusal::OtherOrigin), "{origin}");
        }
        let cross = headers(&[right, host, ("sec-fetch-site", "cross-site")]);
        assert_eq!(guarded.admit(&cross), Err(Refusal::OtherOrigin));
    }
}
