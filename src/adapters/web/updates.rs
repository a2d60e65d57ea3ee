//! Live updates: a page learns that something about its site has changed, and how far the jobs are.

use std::{sync::Arc, time::Duration};

use axum::{
    body::Body,
    extract::{Path, State},
    http::header,
    response::{IntoResponse, Response},
};
use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt, DuplexStream, duplex};
use tokio_util::io::ReaderStream;

use super::{desk::Desk, layout::Progress, problem::Problem, view::Form};
use crate::adapters::store::{JobKind, WindowQuery};

/// Time between two looks at the store.
const LOOK_PERIOD: Duration = Duration::from_secs(1);
/// Looks without news after which a line keeps the connection open.
const QUIET_LOOKS_MAX: u32 = 15;
/// Bytes that wait for a slow reader; beyond them the sender waits, and nothing else does.
const BUFFER_BYTES: usize = 4096;

/// `/sites/{site}/updates`: server-sent events. Each `change` carries what is newest, each `work` the
/// jobs under way, as JSON.
pub(super) async fn stream(State(desk): State<Arc<Desk>>, Path(site): Path<String>) -> Response {
    start(desk, Some(site)).await
}

/// `/updates`: the same over all sites.
pub(super) async fn stream_of_all(State(desk): State<Arc<Desk>>) -> Response {
    start(desk, None).await
}

async fn start(desk: Arc<Desk>, site: Option<String>) -> Response {
    let Ok(permit) = Arc::clone(&desk.listeners).try_acquire_owned() else {
        return Problem::unavailable("too many readers of live updates").answer(Form::Json);
    };
    if let Err(problem) = look(&desk, site.as_deref()).await {
        return problem.answer(Form::Json);
    }
    let (writer, reader) = duplex(BUFFER_BYTES);
    tokio::spawn(async move {
        tell(&desk, site.as_deref(), writer).await;
        drop(permit);
    });
    let headers = [
        (header::CONTENT_TYPE, "text/event-stream"),
        (header::CACHE_CONTROL, "no-store"),
    ];
    (headers, Body::from_stream(ReaderStream::new(reader))).into_response()
}

/// Ends when the reader has gone, at once: a reader who walks from page to page leaves a stream behind at
/// each, and they count against `LISTENERS_MAX`.
async fn tell(desk: &Arc<Desk>, site: Option<&str>, mut writer: DuplexStream) {
    let (mut told, mut told_work, mut quiet) = (String::new(), String::new(), 0);
    while !desk.context.health.report().stopping {
        let news = look(desk, site).await.unwrap_or_default();
        let work = work(desk, site);
        let mut words = String::new();
        if work != told_work {
            words.push_str(&event("work", &work));
            told_work = work;
        }
        if news != told && !news.is_empty() {
            words.push_str(&event("change", &news));
            told.clone_from(&news);
        }
        if !words.is_empty() {
            quiet = 0;
        } else if quiet >= QUIET_LOOKS_MAX {
            quiet = 0;
            ": nothing new\n\n".clone_into(&mut words);
        } else {
            quiet += 1;
        }
        if writer.write_all(words.as_bytes()).await.is_err() {
            return;
        }
        // The other end never writes; reading from it ends when it is dropped.
        let gone = writer.read_u8();
        if tokio::time::timeout(LOOK_PERIOD, gone).await.is_ok() {
            return;
        }
    }
}

/// A server-sent event; `data` is one line.
fn event(name: &str, data: &str) -> String {
    format!("event: {name}\ndata: {data}\n\n")
}

/// What is being computed for a site or all and how far it is, as one line of JSON.
fn work(desk: &Desk, site: Option<&str>) -> String {
    json!(Progress::of(desk, site)).to_string()
}

/// What is newest of a site or of all, as one line of JSON.
async fn look(desk: &Arc<Desk>, site: Option<&str>) -> Result<String, Problem> {
    let (desk, name) = (Arc::clone(desk), site.map(str::to_owned));
    let looked = tokio::task::spawn_blocking(move || {
        name.map_or_else(|| newest_of_all(&desk), |name| newest(&desk, &name))
    });
    looked
        .await
        .unwrap_or_else(|_| Err(Problem::unavailable("interrupted")))
}

fn newest(desk: &Desk, name: &str) -> Result<String, Problem> {
    let site = desk.site(name)?;
    let store = desk.store();
    let newest = store.window_summaries(&WindowQuery {
        site: Some(&site.name),
        count_max: 1,
        ..WindowQuery::default()
    })?;
    let fits = store.fits(&site.name, JobKind::IdentifySite, 1)?;
    let decisions = store.decisions(&site.name, 1)?;
    let set = store.newest_set(&site.name)?;
    Ok(json!({
        "event": newest.first().map(|window| &window.id),
        "screened": newest.first().map(|window| window.screening.is_some()),
        "fit": fits.first().map(|fit| fit.id.0),
        "decision": decisions.first().map(|decision| decision.id.0),
        "awaiting_approval": decisions.first().map(|decision| decision.awaiting_approval),
        "set": set.map(|set| set.version),
        "diagnosis": store.newest_diagnosis(name)?.map(|diagnosis| diagnosis.version),
        "structure": store.structure(name, None)?.map(|record| record.structure),
    })
    .to_string())
}

/// Counts that change with whatever a list of sites shows.
fn newest_of_all(desk: &Desk) -> Result<String, Problem> {
    let store = desk.store();
    let tallies = store.window_tallies()?;
    let windows = tallies
        .iter()
        .map(|t| (&t.site, t.windows, t.usable, t.newest_onset_ns));
    let counts = store.counts(desk.context.health.now_ns())?;
    Ok(json!({
        "windows": windows.collect::<Vec<_>>(),
        "sets": counts.sets,
        "jobs": counts.jobs_queued + counts.jobs_claimed,
    })
    .to_string())
}
