//! All sites: where to look first.

use std::sync::Arc;

use axum::{
    extract::{Query, State},
    http::Uri,
    response::Response,
};
use maud::{Markup, html};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{
    super::{
        desk::Desk,
        layout::{Progress, SiteHead, Tab, site_address, under_way, verdict},
        problem::Problem,
        view::{self, Page, Table, cell},
        words,
    },
    diagnosis_view::status_chip,
    structure::still_missing,
};
use crate::{
    adapters::{
        http::SiteDocument,
        report::number,
        store::{JobKind, StoredSet, WindowTally},
        wire::v1::{rfc3339, verdict_status_name},
    },
    identification::ParameterSet,
    measurement::Site,
};

/// Sites named above the table at most.
const FIRST_MAX: usize = 3;

/// What the address asks for.
#[derive(Clone, Debug, Default, Deserialize)]
pub(in super::super) struct Asked {
    /// `name`, `events`, `newest` or `noise`.
    #[serde(default)]
    sort: Order,
}

/// What the rows are sorted by.
#[derive(Clone, Copy, Debug, Default, Deserialize, PartialEq, Eq)]
#[serde(rename_all = "snake_case")]
enum Order {
    #[default]
    #[serde(alias = "")]
    Name,
    Events,
    Newest,
    Noise,
}

impl Order {
    const fn word(self) -> &'static str {
        match self {
            Self::Name => "name",
            Self::Events => "events",
            Self::Newest => "newest",
            Self::Noise => "noise",
        }
    }

    /// The most first, except for names.
    fn sort(self, rows: &mut [Row]) {
        let tally = |row: &Row, of: fn(&WindowTally) -> f64| row.tally.as_ref().map_or(-1.0, of);
        match self {
            Self::Name => {}
            Self::Events => rows.sort_by(|a, b| {
                let of = |row| tally(row, |tally| tally.windows as f64);
                of(b).total_cmp(&of(a))
            }),
            Self::Newest => rows.sort_by(|a, b| {
                let of = |row| tally(row, |tally| tally.newest_onset_ns as f64);
                of(b).total_cmp(&of(a))
            }),
            Self::Noise => {
                rows.sort_by(|a, b| b.error_to_noise().total_cmp(&a.error_to_noise()));
            }
        }
    }
}

pub(in super::super) async fn show(
    State(desk): State<Arc<Desk>>,
    Query(asked): Query<Asked>,
    uri: Uri,
) -> Response {
    view::show(desk, uri, move |desk| Sites::load(desk, asked.sort)).await
}

struct Row {
    site: Site,
    tally: Option<WindowTally>,
    in_force: Option<(StoredSet, ParameterSet)>,
    /// The newest joint fit, where nothing is in force.
    fit: Option<ParameterSet>,
    /// Status and answer set of the newest diagnosis.
    diagnosis: Option<(String, Vec<String>)>,
}

struct Sites {
    rows: Vec<Row>,
    sort: Order,
    work: Vec<Progress>,
    /// Jobs that wait for a worker.
    waiting: u64,
}

impl Sites {
    fn load(desk: &Desk, sort: Order) -> Result<Self, Problem> {
        let store = desk.store();
        let mut tallies = store.window_tallies()?;
        let mut rows = Vec::new();
        for site in store.sites()? {
            let place = tallies.iter().position(|tally| tally.site == site.name);
            let in_force = match store.set_in_force(&site.name)? {
                Some(stored) => stored.set().ok().map(|set| (stored, set)),
                None => None,
            };
            let fit = if in_force.is_none() {
                let newest = store.fits(&site.name, JobKind::IdentifySite, 1)?.pop();
                newest.and_then(|fit| fit.set().ok().flatten())
            } else {
                None
            };
            let diagnosis = store.newest_diagnosis(&site.name)?;
            rows.push(Row {
                tally: place.map(|k| tallies.swap_remove(k)),
                in_force,
                fit,
                diagnosis: diagnosis.map(|d| (d.status, d.answer_set)),
                site,
            });
        }
        sort.sort(&mut rows);
        Ok(Self {
            rows,
            sort,
            work: Progress::of(desk, None),
            waiting: store.counts(desk.context.health.now_ns())?.jobs_queued,
        })
    }
}

impl Row {
    /// The set in force, else that of the newest fit.
    fn set(&self) -> Option<&ParameterSet> {
        let in_force = self.in_force.as_ref().map(|(_, set)| set);
        in_force.or(self.fit.as_ref())
    }

    /// What the newest diagnosis names and the model has not.
    fn missing(&self) -> Vec<String> {
        let structure = self.set().map_or(&[][..], |set| &set.structure);
        let answers = self.diagnosis.as_ref().map(|(_, answers)| &answers[..]);
        still_missing(answers.unwrap_or_default(), structure)
    }

    /// Of the errors quoted; below any other where there are none.
    fn error_to_noise(&self) -> f64 {
        self.quoted()
            .map_or(-1.0, |(errors, _)| errors.error_to_noise)
    }

    /// The errors to quote and whether they are of held-out events.
    fn quoted(&self) -> Option<(&crate::identification::ErrorSummary, bool)> {
        let set = self.set()?;
        Some(
            set.held_out
                .as_ref()
                .map_or((&set.fit, false), |held_out| (held_out, true)),
        )
    }
}

impl Page for Sites {
    fn title(&self) -> String {
        "Sites".to_owned()
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        None
    }

    fn live(&self) -> Option<String> {
        Some("/updates".to_owned())
    }

    fn body(&self, _source: &str) -> Markup {
        html! {
            h1 { "Sites" }
            @if self.rows.is_empty() {
                p { "No site has sent anything yet. A site appears with its first disturbance." }
            } @else {
                p.lead {
                    "Each site is a load seen by a PMU or a disturbance recorder. Open one to see its "
                    "disturbances, how well its model follows them, and what the model is missing."
                }
                (self.first())
                div.scroll tabindex="0" role="region" aria-label="Sites" {
                    table.list.cards {
                        thead { tr {
                            (self.sortable(Order::Name, "Site", false))
                            (self.sortable(Order::Events, "Events", false))
                            (self.sortable(Order::Newest, "Newest, UTC", false))
                            th scope="col" { "In force" }
                            th scope="col" { "Model" }
                            th scope="col" { "Missing" }
                            th.num scope="col" { "Error of P, %" }
                            th.num scope="col" { "Error of Q, %" }
                            (self.sortable(Order::Noise, "Error / noise", true))
                        } }
                        tbody { @for row in &self.rows { (line(row)) } }
                    }
                }
                (under_way(&self.work))
                @if self.waiting > 0 {
                    p.note { (self.waiting) @if self.waiting == 1 { " more fit or diagnosis waits." } @else { " more fits and diagnoses wait." } }
                }
                p.note {
                    "Errors are those on events the model has not seen, of the set in force or else of the newest fit. Error over noise is 1 where a model "
                    "follows the measurement as closely as the noise allows."
                }
            }
        }
    }

    fn json(&self) -> Result<Value, Problem> {
        Ok(json!({ "sites": self.rows.iter().map(document).collect::<Vec<_>>() }))
    }

    fn table(&self) -> Table {
        let mut table = Table::new(&[
            "site",
            "s_base_mva",
            "v_base_kv",
            "nominal_hz",
            "events",
            "usable_events",
            "newest_onset_utc",
            "version_in_force",
            "verdict",
            "structure",
            "eps_p_percent",
            "eps_q_percent",
            "error_to_noise",
            "errors_on",
            "diagnosis",
        ]);
        table.rows = self.rows.iter().map(cells).collect();
        table
    }
}

impl Sites {
    /// Where the model fails most and it is known what it lacks.
    fn first(&self) -> Markup {
        let mut rows: Vec<(&Row, Vec<String>)> = self
            .rows
            .iter()
            .map(|row| (row, row.missing()))
            .filter(|(_, missing)| !missing.is_empty())
            .collect();
        rows.sort_by(|(a, _), (b, _)| b.error_to_noise().total_cmp(&a.error_to_noise()));
        rows.truncate(FIRST_MAX);
        html! {
            @if !rows.is_empty() {
                p.lead {
                    strong { "Where to look first: " }
                    @for (place, (row, missing)) in rows.iter().enumerate() {
                        @if place > 0 { "; " }
                        a href=(site_address(&row.site.name, "diagnosis")) { (row.site.name) " lacks " (words::effect(&missing[0])) }
                        @if let Some((errors, _)) = row.quoted() { ", " (number::significant(errors.error_to_noise, 3)) " × noise" }
                    }
                    "."
                }
            }
        }
    }

    fn sortable(&self, order: Order, name: &str, numeric: bool) -> Markup {
        let chosen = self.sort == order;
        let (direction, arrow) = if order == Order::Name {
            ("ascending", " ▲")
        } else {
            ("descending", " ▼")
        };
        html! {
            th.num[numeric] scope="col" aria-sort=[chosen.then_some(direction)] {
                a href={ "/sites?sort=" (order.word()) } { (name) @if chosen { (arrow) } }
            }
        }
    }
}

fn line(row: &Row) -> Markup {
    let name = &row.site.name;
    html! {
        tr {
            th scope="row" { a href=(site_address(name, "events")) { (name) } }
            @if let Some(tally) = &row.tally {
                td.time data-label="Events" { (tally.windows) span.dim { ", " (tally.usable) " usable" } }
                td.time data-label="Newest, UTC" { (words::utc(tally.newest_onset_ns)) }
            } @else {
                td data-label="Events" { "none yet" } td {}
            }
            @if let Some((stored, set)) = &row.in_force {
                td data-label="In force" {
                    a href=(site_address(name, &format!("sets/{}", stored.version))) { "version " (stored.version) }
                    " " (verdict(set.verdict.status))
                }
                td data-label="Model" { (words::structure(&set.structure)) }
            } @else if let Some(set) = &row.fit {
                td data-label="In force" { span.chip.open { "none yet" } }
                td data-label="Model" { (words::structure(&set.structure)) " " (verdict(set.verdict.status)) }
            } @else {
                td data-label="In force" { span.chip.open { "none yet" } } td {}
            }
            td data-label="Missing" {
                @if let Some((status, answers)) = &row.diagnosis {
                    @if answers.is_empty() || !row.missing().is_empty() {
                        a href=(site_address(name, "diagnosis")) { (status_chip(status)) }
                        @if let Some(first) = answers.first() { " " (words::effect(first)) }
                    } @else {
                        span.dim { "added since; the next diagnosis tells" }
                    }
                }
            }
            @if let Some((errors, _)) = row.quoted() {
                td.num data-label="Error of P, %" { (number::significant(errors.eps_p_percent, 3)) }
                td.num data-label="Error of Q, %" { (number::significant(errors.eps_q_percent, 3)) }
                td.num data-label="Error / noise" { (number::significant(errors.error_to_noise, 3)) }
            } @else {
                td {} td {} td {}
            }
        }
    }
}

fn document(row: &Row) -> Value {
    let quoted = row.quoted();
    json!({
        "site": SiteDocument::from(&row.site),
        "events": row.tally.as_ref().map_or(0, |tally| tally.windows),
        "usable_events": row.tally.as_ref().map_or(0, |tally| tally.usable),
        "newest_onset_utc": row.tally.as_ref().map(|tally| rfc3339(tally.newest_onset_ns)),
        "version_in_force": row.in_force.as_ref().map(|(stored, _)| stored.version),
        "verdict": row.in_force.as_ref().map(|(_, set)| verdict_status_name(set.verdict.status)),
        "structure": row.in_force.as_ref().map(|(_, set)| &set.structure),
        "eps_p_percent": quoted.map(|(errors, _)| errors.eps_p_percent),
        "eps_q_percent": quoted.map(|(errors, _)| errors.eps_q_percent),
        "diagnosis": row.diagnosis.as_ref().map(|(status, _)| status),
        "missing": row.diagnosis.as_ref().map(|(_, answers)| answers),
        "error_to_noise": quoted.map(|(errors, _)| errors.error_to_noise),
        "errors_on": quoted.map(|(_, held_out)| if held_out { "held_out" } else { "fit" }),
    })
}

fn cells(row: &Row) -> Vec<String> {
    let quoted = row.quoted();
    let error = |of: fn(&crate::identification::ErrorSummary) -> f64| {
        quoted.map_or_else(String::new, |(errors, _)| cell(of(errors)))
    };
    let set = row.in_force.as_ref();
    vec![
        row.site.name.clone(),
        cell(row.site.s_base_mva),
        cell(row.site.v_base_kv),
        cell(row.site.nominal_hz),
        row.tally
            .as_ref()
            .map_or(0, |tally| tally.windows)
            .to_string(),
        row.tally
            .as_ref()
            .map_or(0, |tally| tally.usable)
            .to_string(),
        row.tally
            .as_ref()
            .map_or_else(String::new, |tally| rfc3339(tally.newest_onset_ns)),
        set.map_or_else(String::new, |(stored, _)| stored.version.to_string()),
        set.map_or_else(String::new, |(_, set)| {
            verdict_status_name(set.verdict.status).to_owned()
        }),
        set.map_or_else(String::new, |(_, set)| set.structure.join("+")),
        error(|errors| errors.eps_p_percent),
        error(|errors| errors.eps_q_percent),
        error(|errors| errors.error_to_noise),
        quoted
            .map_or(
                "",
                |(_, held_out)| if held_out { "held_out" } else { "fit" },
            )
            .to_owned(),
        row.diagnosis
            .as_ref()
            .map_or_else(String::new, |(status, _)| status.clone()),
    ]
}
