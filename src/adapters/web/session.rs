//! Who may change something by a page: whoever has shown the token once, from this site's own pages.
//!
//! The token is exchanged for a cookie that scripts cannot read and other sites cannot send
//! (`HttpOnly`, `SameSite=Strict`). A form carries a word that only our pages know, and a request
//! that says it comes from another origin is refused whatever else it carries.

use std::sync::Arc;

use axum::{
    Form,
    extract::{FromRequestParts, Query, State},
    http::{HeaderMap, StatusCode, Uri, header, request::Parts},
    response::{Html, IntoResponse, Redirect, Response},
};
use maud::html;
use serde::Deserialize;

use super::{desk::Desk, layout, problem::Problem, view};
use crate::adapters::http::{Actions, Context};

const COOKIE: &str = "loadmodeld_session";
/// Purposes of words derived from the token.
const SESSION: &str = "session of pages";
const CSRF: &str = "forms of pages";
/// How long a browser keeps the cookie, seconds: one shift.
const COOKIE_SECONDS: u32 = 8 * 3600;

/// What the reader of a page may do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Access {
    /// Whether forms are offered and accepted.
    pub(super) may_write: bool,
    /// The word that a form has to carry.
    pub(super) csrf: String,
}

impl FromRequestParts<Arc<Desk>> for Access {
    type Rejection = std::convert::Infallible;

    async fn from_request_parts(
        parts: &mut Parts,
        desk: &Arc<Desk>,
    ) -> Result<Self, Self::Rejection> {
        Ok(access(&desk.context, &parts.headers))
    }
}

fn access(context: &Context, headers: &HeaderMap) -> Access {
    access_by(&context.actions, context.open_pages, headers)
}

fn access_by(actions: &Actions, open_pages: bool, headers: &HeaderMap) -> Access {
    let known = actions.derived(SESSION);
    let shown = cookie(headers);
    let may_write =
        known.is_some() && (known.as_deref() == shown || (open_pages && host_is_loopback(headers)));
    let csrf = actions.derived(CSRF).filter(|_| may_write);
    Access {
        may_write,
        csrf: csrf.unwrap_or_default(),
    }
}

impl Access {
    /// Whether a form that carries `csrf` may be acted on.
    ///
    /// # Errors
    ///
    /// The refusal, for the reader.
    pub(super) fn check(&self, csrf: &str, headers: &HeaderMap) -> Result<(), Problem> {
        self.admits(headers)?;
        if csrf != self.csrf {
            return Err(Problem {
                status: StatusCode::FORBIDDEN,
                detail: "the form is out of date: load the page again".to_owned(),
            });
        }
        Ok(())
    }

    /// Whether the reader may send a form at all; its word is still to be looked at.
    ///
    /// # Errors
    ///
    /// The refusal, for the reader.
    pub(super) fn admits(&self, headers: &HeaderMap) -> Result<(), Problem> {
        let refused = |detail: &str| {
            Err(Problem {
                status: StatusCode::FORBIDDEN,
                detail: detail.to_owned(),
            })
        };
        if !same_origin(headers) {
            return refused("the request comes from another site");
        }
        if !self.may_write {
            return refused("this needs the write token of the service");
        }
        Ok(())
    }
}

fn cookie(headers: &HeaderMap) -> Option<&str> {
    let cookies = headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|value| value.to_str().ok());
    cookies
        .flat_map(|line| line.split(';'))
        .filter_map(|pair| pair.trim().split_once('='))
        .find_map(|(name, value)| (name == COOKIE).then_some(value))
}

fn host(headers: &HeaderMap) -> Option<&str> {
    headers.get(header::HOST)?.to_str().ok()
}

/// Whether the page was asked for by an address of this machine: a name that somebody else made
/// point here is none.
fn host_is_loopback(headers: &HeaderMap) -> bool {
    host(headers).is_some_and(|host| {
        let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
        ["127.0.0.1", "localhost", "[::1]"].contains(&name)
    })
}

/// Whether the request says that it comes from our own pages, by `Origin` or `Sec-Fetch-Site`.
fn same_origin(headers: &HeaderMap) -> bool {
    let fetched_from = headers
        .get("sec-fetch-site")
        .map(header::HeaderValue::as_bytes);
    if fetched_from.is_some_and(|site| site != b"same-origin") {
        return false;
    }
    let origin = headers
        .get(header::ORIGIN)
        .map(|value| value.to_str().unwrap_or(""));
    origin.is_some_and(|origin| {
        let place = origin.split_once("://").map(|(_, place)| place);
        place.is_some() && place == host(headers)
    })
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct Asked {
    /// Where to go then; a path of ours.
    #[serde(default)]
    next: String,
}

#[derive(Deserialize)]
pub(super) struct Shown {
    token: String,
    #[serde(default)]
    next: String,
}

/// `GET /session`: asks for the token.
pub(super) async fn ask(State(desk): State<Arc<Desk>>, Query(asked): Query<Asked>) -> Response {
    Html(form(&desk.context.actions, &asked.next, None)).into_response()
}

fn form(actions: &Actions, next: &str, problem: Option<&str>) -> String {
    let body = html! {
        h1 { "Unlock changes" }
        @if let Some(problem) = problem { p.problem role="alert" { (problem) } }
        @if actions.are_possible() {
            form.filter method="post" action="/session" {
                input type="hidden" name="next" value=(next);
                label { "Write token " input type="password" name="token" required autocomplete="current-password"; }
                button.main type="submit" { "Unlock" }
            }
            p.note { "The token is in the file that the configuration of the service names. It unlocks this browser for eight hours." }
        } @else {
            p { "This service is read-only: its configuration names no file with a write token." }
        }
    };
    layout::plain("Unlock changes", &body).into_string()
}

/// `POST /session`: exchanges the token for a cookie.
pub(super) async fn open(
    State(desk): State<Arc<Desk>>,
    headers: HeaderMap,
    Form(shown): Form<Shown>,
) -> Response {
    let actions = &desk.context.actions;
    let next = own_path(&shown.next);
    if !same_origin(&headers) {
        let detail = "the request comes from another site".to_owned();
        return Problem {
            status: StatusCode::FORBIDDEN,
            detail,
        }
        .answer(view::Form::Html);
    }
    let admitted = actions.admit_token(Some(shown.token.trim())).is_ok();
    let session = actions.derived(SESSION).filter(|_| admitted);
    let Some(session) = session else {
        let page = form(actions, next, Some("That is not the token."));
        return (StatusCode::FORBIDDEN, Html(page)).into_response();
    };
    let cookie =
        format!("{COOKIE}={session}; Path=/; HttpOnly; SameSite=Strict; Max-Age={COOKIE_SECONDS}");
    ([(header::SET_COOKIE, cookie)], Redirect::to(next)).into_response()
}

/// The path, if it is one of ours: never another host.
fn own_path(next: &str) -> &str {
    let ours = next.starts_with('/') && !next.starts_with("//") && !next.contains('\\');
    if ours && next.parse::<Uri>().is_ok() {
        next
    } else {
        "/"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adapters::http::Token;

    fn headers(pairs: &[(&'static str, &str)]) -> HeaderMap {
        let pairs = pairs.iter().map(|(name, value)| {
            (
                header::HeaderName::from_static(name),
                value.parse().unwrap(),
            )
        });
        pairs.collect()
    }

    #[test]
    fn only_pages_of_this_origin_may_post() {
        let here = ("host", "127.0.0.1:9464");
        assert!(same_origin(&headers(&[
            here,
            ("origin", "http://127.0.0.1:9464")
        ])));
        assert!(!same_origin(&headers(&[
            here,
            ("origin", "http://evil.example")
        ])));
        assert!(!same_origin(&headers(&[here, ("origin", "null")])));
        assert!(!same_origin(&headers(&[here])));
        let fetched = ("sec-fetch-site", "cross-site");
        assert!(!same_origin(&headers(&[
            here,
            fetched,
            ("origin", "http://127.0.0.1:9464")
        ])));
    }

    fn actions(token: Option<&str>) -> Actions {
        Actions::new(token.map(|text| Token::new(text).unwrap()), |_| {})
    }

    #[test]
    fn a_reader_may_write_with_the_cookie_or_on_open_pages_of_this_machine() {
        let guarded = actions(Some("0123456789abcdef"));
        let closed = |pairs: &[(&'static str, &str)]| access_by(&guarded, false, &headers(pairs));
        assert!(!closed(&[("host", "localhost")]).may_write);
        let session = format!("a=b; {COOKIE}={}", guarded.derived(SESSION).unwrap());
        assert!(closed(&[("cookie", &session)]).may_write);
        let open = |host| access_by(&guarded, true, &headers(&[("host", host)]));
        assert!(open("localhost:9464").may_write);
        assert!(!open("rebound.example").may_write);
        let read_only = access_by(&actions(None), true, &headers(&[("host", "localhost")]));
        assert!(!read_only.may_write);
    }

    #[test]
    fn a_form_without_the_word_of_our_pages_is_refused() {
        let sent = headers(&[("host", "localhost"), ("origin", "http://localhost")]);
        let access = access_by(&actions(Some("0123456789abcdef")), true, &sent);
        assert!(access.check(&access.csrf, &sent).is_ok());
        assert!(access.check("", &sent).is_err());
    }

    #[test]
    fn the_way_on_stays_here() {
        assert_eq!(own_path("/sites/a?b=c"), "/sites/a?b=c");
        for other in [
            "//evil.example",
            "http://evil.example",
            "/\\evil.example",
            "",
        ] {
            assert_eq!(own_path(other), "/");
        }
    }
}
