//! Whether the service works, what waits, what failed.

use std::sync::Arc;

use axum::{extract::State, http::Uri, response::Response};
use maud::{Markup, html};
use serde_json::{Value, json};

use super::super::{
    desk::Desk,
    layout::{Progress, SiteHead, Tab, site_address, under_way},
    problem::Problem,
    view::{self, Page, Table},
    words,
};
use crate::adapters::{
    http::HealthReport,
    store::{Job, StoreCounts},
};

/// Failed jobs shown at most.
const PARKED_MAX: usize = 50;

pub(in super::super) async fn show(State(desk): State<Arc<Desk>>, uri: Uri) -> Response {
    view::show(desk, uri, HealthPage::load).await
}

struct HealthPage {
    report: HealthReport,
    /// What is being computed.
    work: Vec<Progress>,
    /// None when the store does not answer: the page is needed most then.
    store: Option<(StoreCounts, Vec<Job>)>,
}

impl HealthPage {
    #[allow(clippy::unnecessary_wraps, reason = "every page is loaded in this way")]
    fn load(desk: &Desk) -> Result<Self, Problem> {
        let report = desk.context.health.report();
        let counts = desk.store().counts(desk.context.health.now_ns());
        let parked = desk.store().parked_jobs(PARKED_MAX);
        Ok(Self {
            report,
            work: Progress::of(desk, None),
            store: counts.ok().zip(parked.ok()),
        })
    }

    fn checks(&self) -> [(&'static str, bool, String); 5] {
        let report = &self.report;
        [
            (
                "Measurements are processed",
                report.live,
                format!("last step {:.1} s ago", report.loop_idle_seconds.max(0.0)),
            ),
            (
                "The store answers and has space",
                report.store && self.store.is_some(),
                String::new(),
            ),
            ("Zenoh is connected", report.zenoh, String::new()),
            (
                "The service is not stopping",
                !report.stopping,
                String::new(),
            ),
            ("Ready", report.ready, String::new()),
        ]
    }

    fn numbers(&self) -> Vec<(&'static str, String)> {
        let Some((counts, _)) = &self.store else {
            return Vec::new();
        };
        let age_s = counts.oldest_due_job_age_ns as f64 / 1e9;
        vec![
            ("events kept", counts.windows.to_string()),
            ("parameter sets", counts.sets.to_string()),
            (
                "sets waiting to be published",
                counts.sets_unpublished.to_string(),
            ),
            ("fits waiting", counts.jobs_queued.to_string()),
            ("fits under way", counts.jobs_claimed.to_string()),
            ("fits that failed too often", counts.jobs_parked.to_string()),
            ("age of the oldest due fit, s", format!("{age_s:.0}")),
            (
                "size of the store, MB",
                format!("{:.1}", counts.bytes as f64 / 1e6),
            ),
        ]
    }
}

impl Page for HealthPage {
    fn title(&self) -> String {
        "Health".to_owned()
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        None
    }

    fn body(&self, _source: &str) -> Markup {
        html! {
            h1 { "Health" }
            ul.checks {
                @for (what, good, detail) in self.checks() {
                    li { span class={ "chip " (if good { "good" } else { "bad" }) } { (if good { "yes" } else { "no" }) }
                        " " (what) @if !detail.is_empty() { span.dim { ", " (detail) } } }
                }
            }
            h2 { "Store and work" }
            @if self.store.is_none() { p.problem { "The store does not answer; the log says why." } }
            table.list.narrow { tbody {
                @for (what, value) in self.numbers() { tr { th scope="row" { (what) } td.num { (value) } } }
            } }
            (under_way(&self.work))
            @if let Some((_, parked)) = &self.store {
                @if !parked.is_empty() {
                    h2 { "Fits that failed too often" }
                    div.scroll tabindex="0" role="region" aria-label="Failed fits" {
                        table.list {
                            thead { tr { th scope="col" { "Site" } th scope="col" { "Subject" } th scope="col" { "Queued, UTC" } th scope="col" { "Last error" } } }
                            tbody { @for job in parked { tr {
                                th scope="row" { a href=(site_address(&job.site, "events")) { (job.site) } }
                                td { (job.subject) } td.time { (words::utc(job.enqueued_ns)) }
                                td { (job.last_error.as_deref().unwrap_or("its worker disappeared")) }
                            } } }
                        }
                    }
                }
            }
            p.note {
                "For programs: " a href="/healthz" { "/healthz" } ", " a href="/livez" { "/livez" } ", "
                a href="/metrics" { "/metrics" } ", " a href="/api/v1/openapi.json" { "the HTTP API" } "."
            }
        }
    }

    fn json(&self) -> Result<Value, Problem> {
        let numbers = self
            .numbers()
            .into_iter()
            .map(|(what, value)| (what.to_owned(), json!(value)));
        Ok(json!({
            "health": self.report,
            "store": numbers.collect::<serde_json::Map<_, _>>(),
            "under_way": self.work,
            "failed_fits": self.store.iter().flat_map(|(_, parked)| parked).map(|job| json!({
                "site": job.site, "subject": job.subject, "kind": job.kind.name(), "last_error": job.last_error,
            })).collect::<Vec<_>>(),
        }))
    }

    fn table(&self) -> Table {
        let mut table = Table::new(&["what", "value"]);
        let checks = self
            .checks()
            .into_iter()
            .map(|(what, good, _)| (what, good.to_string()));
        let rows = checks
            .chain(self.numbers())
            .map(|(what, value)| vec![what.to_owned(), value]);
        table.rows = rows.collect();
        table
    }
}
