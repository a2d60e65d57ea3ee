//! One event: measured, modelled, and what is left.

use std::sync::Arc;

use axum::{
    extract::{Path, Query, State},
    http::Uri,
    response::Response,
};
use serde::Deserialize;

use super::{
    super::{
        desk::Desk,
        layout::SiteHead,
        problem::Problem,
        view::{self, Form},
    },
    event_view::{Drawn, EventPage},
    models::{self, Model},
};
use crate::{adapters::store::WindowQuery, disturbance::Window};

/// Which models to draw.
#[derive(Clone, Debug, Default, Deserialize)]
pub(in super::super) struct Asked {
    /// The model; the one in force when left out.
    #[serde(default)]
    model: String,
    /// Another one beside it.
    #[serde(default)]
    with: String,
}

/// `/sites/{site}/events/{event}`, `.json`, `.csv`.
pub(in super::super) async fn show(
    State(desk): State<Arc<Desk>>,
    Path((site, event)): Path<(String, String)>,
    Query(asked): Query<Asked>,
    uri: Uri,
) -> Response {
    let event = Form::of(&event).0.to_owned();
    view::show(desk, uri, move |desk| load(desk, &site, &event, &asked)).await
}

fn load(desk: &Desk, site: &str, event: &str, asked: &Asked) -> Result<EventPage, Problem> {
    let head = SiteHead::load(desk, site)?;
    let summary = desk
        .store()
        .window_summaries(&WindowQuery {
            site: Some(site),
            id: Some(event),
            count_max: 1,
            ..WindowQuery::default()
        })?
        .pop()
        .ok_or_else(|| Problem::not_found(format!("`{site}` has no event `{event}`")))?;
    let window = desk.store().window(event)?;
    let chosen = if asked.model.is_empty() {
        models::usual(desk, &head, Some(event))?
    } else {
        Some(models::model(desk, site, &asked.model)?)
    };
    let other = match asked.with.as_str() {
        "" => None,
        key => Some(models::model(desk, site, key)?),
    };
    let choices = models::choices(desk, site, Some(event))?;
    let asked_for = !asked.model.is_empty();
    let mut page = EventPage {
        head,
        summary,
        window,
        choices,
        model: None,
        rival: None,
        note: None,
    };
    let Some(window) = page.window.clone() else {
        return Ok(page);
    };
    if let Some(model) = chosen {
        match drawn(desk, model, &window) {
            Ok(drawn) => page.model = Some(drawn),
            // The usual model may not fit this event: the measurement is shown all the same.
            Err(problem) if !asked_for => page.note = Some(problem.detail),
            Err(problem) => return Err(problem),
        }
    }
    page.rival = other.map(|model| drawn(desk, model, &window)).transpose()?;
    Ok(page)
}

fn drawn(desk: &Desk, model: Model, window: &Window) -> Result<Drawn, Problem> {
    let judged = desk.comparison(&model.set, &model.content_hash, window)?;
    Ok(Drawn { model, judged })
}
