//! Recordings of the reader's own, held against a site's model and not kept.

use std::sync::Arc;

use axum::{
    extract::{
        Multipart, Path, Query, State,
        multipart::{MultipartError, MultipartRejection},
    },
    http::{HeaderMap, StatusCode, Uri, header},
    response::{IntoResponse, Redirect, Response},
};
use maud::{Markup, html};
use serde_json::{Value, json};

use super::{
    super::{
        desk::Desk,
        layout::{SiteHead, Tab, segment, site_address},
        problem::Problem,
        session::Access,
        uploads::{self, File, KEPT_MAX, Upload},
        view::{self, Form, Page, Table, cell},
        words,
    },
    event,
};
use crate::adapters::{http::refused, report::number, store::WindowSummary, wire::v1::rfc3339};

/// Bytes of the files together at most.
pub(in super::super) const FILES_BYTES_MAX: usize = 16 * 1024 * 1024;
/// Parts of a form looked at.
const PARTS_MAX: usize = 6;

/// `/sites/{site}/recordings`.
pub(in super::super) async fn show(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    access: Access,
    uri: Uri,
) -> Response {
    view::show(desk, uri, move |desk| Recordings::load(desk, &site, access)).await
}

/// `/sites/{site}/recordings/{id}`, `.json`, `.csv`.
pub(in super::super) async fn show_one(
    State(desk): State<Arc<Desk>>,
    Path((site, id)): Path<(String, String)>,
    Query(asked): Query<event::Asked>,
    uri: Uri,
) -> Response {
    let id = Form::of(&id).0.to_owned();
    view::show(desk, uri, move |desk| {
        let head = SiteHead::load(desk, &site)?;
        let upload = desk.uploads.get(&site, &id).ok_or_else(|| {
            Problem::not_found(format!(
                "there is no recording `{id}` any more: the newest {KEPT_MAX} are kept, until the service restarts"
            ))
        })?;
        let summary = summary(&upload, desk.context.health.now_ns());
        let window = Some(upload.window.clone());
        let page = event::assemble(desk, head, summary, window, &asked)?;
        Ok(page.of_recording(&upload.name, upload.note.as_deref()))
    })
    .await
}

fn summary(upload: &Upload, now_ns: i64) -> WindowSummary {
    let window = &upload.window;
    WindowSummary {
        id: window.id.clone(),
        site: window.site.clone(),
        onset_ns: window.onset_ns(),
        start_ns: window.record.start_ns,
        sample_count: window.record.samples.len(),
        rate_fps: window.record.rate_fps,
        lowest_voltage_pu: window.record.lowest_voltage_pu(),
        triggers: window.triggers.clone(),
        closing: window.closing,
        screening: None,
        stored_ns: now_ns,
        announced_ns: None,
        has_waveforms: true,
    }
}

/// `POST /sites/{site}/recordings`: reads what was sent and shows it.
pub(in super::super) async fn take(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    access: Access,
    headers: HeaderMap,
    form: Result<Multipart, MultipartRejection>,
) -> Response {
    // Before the files are read: they are large.
    if let Err(problem) = access.admits(&headers) {
        return problem.answer(Form::Html);
    }
    let sent = match form {
        Ok(form) => Sent::read(form).await,
        Err(rejection) => Err(Problem::bad_request(rejection.body_text())),
    };
    let admitted = sent.and_then(|sent| access.check(&sent.csrf, &headers).map(|()| sent));
    let kept = match admitted {
        Ok(sent) => keep(desk, &site, sent).await,
        Err(problem) => Err(problem),
    };
    match kept {
        Ok(id) => Redirect::to(&address_of(&site, &id)).into_response(),
        Err(problem) => problem.answer(Form::Html),
    }
}

/// `POST /api/v1/sites/{site}/recordings`: the same for a program that shows the token.
pub(in super::super) async fn take_from_program(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    headers: HeaderMap,
    form: Result<Multipart, MultipartRejection>,
) -> Response {
    if let Err(refusal) = desk.context.actions.admit(&headers) {
        return refused(refusal);
    }
    let sent = match form {
        Ok(form) => Sent::read(form).await,
        Err(rejection) => Err(Problem::bad_request(rejection.body_text())),
    };
    let kept = match sent {
        Ok(sent) => keep(desk, &site, sent).await,
        Err(problem) => Err(problem),
    };
    match kept {
        Ok(id) => {
            let address = address_of(&site, &id);
            let body = json!({ "recording": id, "comparison": format!("{address}.json") });
            let location = [(header::LOCATION, address)];
            (StatusCode::CREATED, location, axum::Json(body)).into_response()
        }
        Err(problem) => problem.answer(Form::Json),
    }
}

fn address_of(site: &str, id: &str) -> String {
    site_address(site, &format!("recordings/{}", segment(id)))
}

/// Reads what was sent on a thread that may block and keeps it; its name.
async fn keep(desk: Arc<Desk>, site: &str, sent: Sent) -> Result<String, Problem> {
    let Ok(permit) = Arc::clone(&desk.seats).acquire_owned().await else {
        return Err(Problem::unavailable("the service is stopping"));
    };
    let site = site.to_owned();
    let reading = tokio::task::spawn_blocking(move || {
        let _permit = permit;
        let upload = uploads::read(&desk.site(&site)?, &sent.files, sent.load)?;
        let id = upload.window.id.clone();
        desk.uploads.keep(upload);
        Ok(id)
    });
    reading
        .await
        .unwrap_or_else(|_| Err(Problem::unavailable("the reading was interrupted")))
}

/// What the form holds.
#[derive(Debug, Default)]
struct Sent {
    csrf: String,
    files: Vec<File>,
    load: Option<usize>,
}

impl Sent {
    async fn read(mut form: Multipart) -> Result<Self, Problem> {
        let unfit = |error: MultipartError| Problem {
            status: error.status(),
            detail: match error.status() {
                StatusCode::PAYLOAD_TOO_LARGE => format!(
                    "the files are too large: together they may have {} MiB",
                    FILES_BYTES_MAX / (1024 * 1024)
                ),
                _ => format!("the form cannot be read: {}", error.body_text()),
            },
        };
        let mut sent = Self::default();
        let mut parts = 0;
        while let Some(field) = form.next_field().await.map_err(unfit)? {
            parts += 1;
            if parts > PARTS_MAX {
                return Err(Problem::bad_request("the form has too many parts"));
            }
            match field.name() {
                Some("csrf") => sent.csrf = field.text().await.map_err(unfit)?,
                Some("load") => {
                    let text = field.text().await.map_err(unfit)?;
                    sent.load = match text.trim() {
                        "" => None,
                        text => Some(text.parse().map_err(|_| {
                            Problem::bad_request(format!("`{text}` is not the number of a load"))
                        })?),
                    };
                }
                Some("files") => {
                    let name = field.file_name().unwrap_or("").to_owned();
                    let bytes = field.bytes().await.map_err(unfit)?.to_vec();
                    // A browser sends an empty part where no file was chosen.
                    if !name.is_empty() {
                        sent.files.push(File { name, bytes });
                    }
                }
                _ => {
                    return Err(Problem::bad_request(
                        "the form has a part that is not known",
                    ));
                }
            }
        }
        Ok(sent)
    }
}

struct Recordings {
    head: SiteHead,
    kept: Vec<Arc<Upload>>,
    access: Access,
}

impl Recordings {
    fn load(desk: &Desk, site: &str, access: Access) -> Result<Self, Problem> {
        Ok(Self {
            head: SiteHead::load(desk, site)?,
            kept: desk.uploads.of(site),
            access,
        })
    }

    fn form(&self) -> Markup {
        let address = self.head.address("recordings");
        html! {
            @if self.access.may_write {
                form.filter method="post" action=(address) enctype="multipart/form-data" {
                    input type="hidden" name="csrf" value=(self.access.csrf);
                    label { "Recording " input type="file" name="files" multiple required accept=".csv,.cff,.cfg,.dat" data-bytes-max=(FILES_BYTES_MAX); }
                    label { "Load no. " input type="number" name="load" min="1" max="99" placeholder="if several"; }
                    button.main type="submit" { "Compare with the model" }
                }
            } @else {
                p.note { a href={ "/session?next=" (address) } { "Unlock with the write token" } " of the service to send a recording." }
            }
        }
    }
}

impl Page for Recordings {
    fn title(&self) -> String {
        format!("Recordings against the model of {}", self.head.site.name)
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        Some((&self.head, Tab::Events))
    }

    fn body(&self, _source: &str) -> Markup {
        html! {
            h1 { "Compare a recording of your own" }
            p.lead {
                "A CSV file (columns time_s, v_pu, freq_hz, p_pu, q_pu, on the bases of this site), or COMTRADE: one .cff, or "
                "a .cfg with its .dat; at most " (FILES_BYTES_MAX / (1024 * 1024)) " MiB. It is held against this site's model and drawn like an event. "
                "It is not stored and no fit uses it: the newest " (KEPT_MAX) " stay in memory until the service restarts."
            }
            (self.form())
            @if !self.kept.is_empty() {
                h2 { "Still in memory" }
                div.scroll tabindex="0" role="region" aria-label="Recordings" {
                    table.list.cards {
                        thead { tr { th scope="col" { "File" } th scope="col" { "Onset, UTC" } th.num scope="col" { "Lowest V, pu" } th.num scope="col" { "Samples" } } }
                        tbody { @for upload in &self.kept {
                            @let window = &upload.window;
                            tr {
                                th scope="row" { a href=(self.head.address(&format!("recordings/{}", segment(&window.id)))) { (upload.name) } }
                                td.time data-label="Onset, UTC" { (words::utc(window.onset_ns())) }
                                td.num data-label="Lowest V, pu" { (number::fixed(window.record.lowest_voltage_pu(), 3)) }
                                td.num data-label="Samples" { (window.record.samples.len()) }
                            }
                        } }
                    }
                }
            }
        }
    }

    fn json(&self) -> Result<Value, Problem> {
        let kept = self.kept.iter().map(|upload| {
            json!({
                "recording": upload.window.id,
                "file": upload.name,
                "onset_utc": rfc3339(upload.window.onset_ns()),
                "lowest_voltage_pu": upload.window.record.lowest_voltage_pu(),
                "samples": upload.window.record.samples.len(),
            })
        });
        Ok(json!({ "site": self.head.site.name, "recordings": kept.collect::<Vec<_>>() }))
    }

    fn table(&self) -> Table {
        let mut table = Table::new(&[
            "recording",
            "file",
            "onset_utc",
            "lowest_voltage_pu",
            "samples",
        ]);
        let rows = self.kept.iter().map(|upload| {
            let window = &upload.window;
            vec![
                window.id.clone(),
                upload.name.clone(),
                rfc3339(window.onset_ns()),
                cell(window.record.lowest_voltage_pu()),
                window.record.samples.len().to_string(),
            ]
        });
        table.rows = rows.collect();
        table
    }
}
