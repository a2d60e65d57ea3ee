//! One event: measured, modelled, and what is left.

use std::sync::Arc;

use axum::{
    extract::{Path, Query, State},
    http::{Uri, header},
    response::{IntoResponse, Response},
};
use serde::Deserialize;

use super::{
    super::{
        desk::Desk,
        layout::{SiteHead, segment},
        problem::Problem,
        view::{self, Form},
    },
    event_view::{Drawn, EventPage},
    models::{self, Model},
};
use crate::{
    adapters::{
        recordings::{
            comtrade::{DataFormat, encode_container},
            phasor_channels,
        },
        store::{WindowQuery, WindowSummary},
    },
    disturbance::Window,
};

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
    if let Some(event) = event.strip_suffix(".cff") {
        return export(desk, site, event.to_owned()).await;
    }
    let event = Form::of(&event).0.to_owned();
    view::show(desk, uri, move |desk| load(desk, &site, &event, &asked)).await
}

/// `/sites/{site}/events/{event}.cff`: the measurement as COMTRADE.
async fn export(desk: Arc<Desk>, site: String, event: String) -> Response {
    let name = format!("{event}.cff");
    let made = tokio::task::spawn_blocking(move || {
        let site = desk.site(&site)?;
        let window = desk.store().window(&event)?;
        let window = window.filter(|window| window.site == site.name);
        let window = window.ok_or_else(|| {
            Problem::not_found(format!(
                "`{}` has no event `{event}` with waveforms",
                site.name
            ))
        })?;
        let recording = phasor_channels::recording(&window.record, &site, Some(window.onset_ns()));
        encode_container(&recording, DataFormat::Float32)
            .map_err(|e| Problem::unreadable("the event", &e))
    })
    .await;
    match made {
        Ok(Ok(bytes)) => {
            let headers = [
                (header::CONTENT_TYPE, "application/octet-stream".to_owned()),
                (
                    header::CONTENT_DISPOSITION,
                    format!("attachment; filename=\"{}\"", segment(&name)),
                ),
            ];
            (headers, bytes).into_response()
        }
        Ok(Err(problem)) => problem.answer(Form::Html),
        Err(_) => Problem::unavailable("the export was interrupted").answer(Form::Html),
    }
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
    assemble(desk, head, summary, window, asked)
}

/// The page of a window, with the models that are asked for.
pub(super) fn assemble(
    desk: &Desk,
    head: SiteHead,
    summary: WindowSummary,
    window: Option<Window>,
    asked: &Asked,
) -> Result<EventPage, Problem> {
    let (site, event) = (head.site.name.as_str(), summary.id.as_str());
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
        recording: None,
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
