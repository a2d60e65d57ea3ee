//! What comes in, stream by stream: whether data flow, and what was wrong with them since the start.

use std::{collections::BTreeMap, sync::Arc};

use axum::{extract::State, http::Uri, response::Response};
use maud::{Markup, html};
use serde_json::{Value, json};

use super::super::{
    desk::Desk,
    layout::{SiteHead, Tab, site_address},
    problem::Problem,
    view::{self, Page, Table},
    words,
};
use crate::{adapters::report::number, telemetry::StreamState};

/// Rows shown at most; the CSV and JSON have all.
const ROWS_MAX: usize = 1000;
/// Age of the newest data from which on a stream is called silent, nanoseconds.
const SILENT_NS: i64 = 5_000_000_000;

pub(in super::super) async fn show(State(desk): State<Arc<Desk>>, uri: Uri) -> Response {
    view::show(desk, uri, |desk| Ok(Streams::load(desk))).await
}

struct Streams {
    rows: Vec<Row>,
    /// Messages of streams that are not remembered.
    beyond: u64,
}

struct Row {
    site: String,
    stream: String,
    state: StreamState,
    /// Age of the newest arrival, seconds; none for a stream of which nothing could be used.
    silent_s: Option<f64>,
}

impl Streams {
    fn load(desk: &Desk) -> Self {
        let now_ns = desk.context.health.now_ns();
        let (streams, beyond) = desk.context.metrics.streams().read();
        let row = |(site, stream, state): (String, String, StreamState)| {
            let age_ns = now_ns.saturating_sub(state.arrived_ns).max(0);
            Row {
                site,
                stream,
                silent_s: (state.batches > 0).then_some(age_ns as f64 / 1e9),
                state,
            }
        };
        Self {
            rows: streams.into_iter().map(row).collect(),
            beyond,
        }
    }
}

impl Row {
    /// Class and word of the chip.
    fn standing(&self) -> (&'static str, String) {
        match self.silent_s {
            None => ("bad", "nothing usable".to_owned()),
            Some(age_s) if age_s * 1e9 < SILENT_NS as f64 => ("good", "data".to_owned()),
            Some(age_s) => ("open", format!("silent for {age_s:.0} s")),
        }
    }

    /// Counts of samples that are not as they should be.
    fn samples(&self) -> Vec<(&'static str, u64)> {
        let expected = ["accepted"];
        let counts = self.state.samples.by_outcome().into_iter();
        let lost = ("batches lost", self.state.batches_lost);
        counts
            .filter(|(outcome, _)| !expected.contains(outcome))
            .chain([lost])
            .collect()
    }

    /// Counts of frames that were of no use.
    fn frames_not_used(&self) -> Vec<(&'static str, u64)> {
        let expected = ["sample", "configuration", "reconfiguration", "other"];
        let frames = self.state.frames.iter();
        frames
            .filter(|(outcome, _)| !expected.contains(outcome))
            .map(|(outcome, count)| (*outcome, *count))
            .collect()
    }
}

/// The counts above 0, in words.
fn counted(counts: &[(&'static str, u64)]) -> String {
    let some = counts.iter().filter(|(_, count)| *count > 0);
    let words = some.map(|(what, count)| format!("{count} {}", what.replace('_', " ")));
    words.collect::<Vec<_>>().join(", ")
}

/// Message time quality in words (C37.118.2, table 4).
fn time_quality(code: u8) -> &'static str {
    match code {
        0 => "locked or unknown",
        1 => "within 1 ns",
        2 => "within 10 ns",
        3 => "within 100 ns",
        4 => "within 1 µs",
        5 => "within 10 µs",
        6 => "within 100 µs",
        7 => "within 1 ms",
        8 => "within 10 ms",
        9 => "within 100 ms",
        10 => "within 1 s",
        11 => "within 10 s",
        15 => "clock failed",
        _ => "reserved code",
    }
}

fn steps(state: &StreamState) -> String {
    let kinds: Vec<_> = state.steps.iter().map(|(k, n)| (*k, *n)).collect();
    match &state.last_step {
        Some(words) => format!("{}; last: {words}", counted(&kinds)),
        None => String::new(),
    }
}

impl Page for Streams {
    fn title(&self) -> String {
        "Streams".to_owned()
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        None
    }

    fn body(&self, _source: &str) -> Markup {
        let silent = self.rows.iter().filter(|row| row.standing().0 != "good");
        html! {
            h1 { "Streams" }
            p { "What has come in since the start, stream by stream. Words on each count are in "
                code { "docs/metrics.md" } "." }
            @if self.rows.is_empty() {
                p { "Nothing has come in yet." }
            } @else {
                p { (self.rows.len()) @if self.rows.len() == 1 { " stream, " } @else { " streams, " } (silent.count()) " of them without data now." }
                div.scroll tabindex="0" role="region" aria-label="Streams" {
                    table.list {
                        thead { tr {
                            th scope="col" { "Site" } th scope="col" { "Stream" } th scope="col" { "Now" }
                            th.num scope="col" { "Rate, 1/s" } th scope="col" { "Newest sample, UTC" }
                            th scope="col" { "Clock" } th.num scope="col" { "Samples" }
                            th scope="col" { "Of them, or besides" } th scope="col" { "Frames not used" }
                            th scope="col" { "Steps of time" } th.num scope="col" { "Silences" }
                        } }
                        tbody { @for row in self.rows.iter().take(ROWS_MAX) { (html_row(row)) } }
                    }
                }
                @if self.rows.len() > ROWS_MAX {
                    p.note { "The first " (ROWS_MAX) " are shown; the CSV has all." }
                }
            }
            @if self.beyond > 0 {
                p.problem { (self.beyond) " messages came from further streams, whose counts are not kept one by one." }
            }
        }
    }

    fn json(&self) -> Result<Value, Problem> {
        let streams = self.rows.iter().map(|row| {
            let state = &row.state;
            let samples: BTreeMap<_, _> = state.samples.by_outcome().into_iter().collect();
            json!({
                "site": row.site, "stream": row.stream, "silent_s": row.silent_s,
                "rate_fps": state.rate_fps, "newest_utc": words::utc(state.newest_ns),
                "time_quality_code": state.time_quality_code,
                "batches": state.batches, "batches_lost": state.batches_lost,
                "samples": samples, "frames": state.frames, "time_steps": state.steps,
                "last_time_step": state.last_step, "silences": state.silences,
            })
        });
        Ok(
            json!({ "streams": streams.collect::<Vec<_>>(), "messages_of_further_streams": self.beyond }),
        )
    }

    fn table(&self) -> Table {
        let mut table = Table::new(&["site", "stream", "silent_s", "rate_fps", "newest_utc"]);
        let Some(first) = self.rows.first() else {
            return table;
        };
        let outcomes = first.state.samples.by_outcome();
        let names = outcomes.iter().map(|(name, _)| (*name).to_owned());
        table.header.extend(names);
        let rest = [
            "batches_lost",
            "time_quality_code",
            "silences",
            "time_steps",
            "frames_not_used",
        ];
        table.header.extend(rest.map(str::to_owned));
        let row = |row: &Row| {
            let state = &row.state;
            let mut cells = vec![
                row.site.clone(),
                row.stream.clone(),
                row.silent_s.map_or_else(String::new, view::cell),
                view::cell(state.rate_fps),
                words::utc(state.newest_ns),
            ];
            let counts = state.samples.by_outcome().into_iter();
            cells.extend(counts.map(|(_, count)| count.to_string()));
            cells.extend([
                state.batches_lost.to_string(),
                state.time_quality_code.to_string(),
                state.silences.to_string(),
                steps(state),
                counted(&row.frames_not_used()),
            ]);
            cells
        };
        table.rows = self.rows.iter().map(row).collect();
        table
    }
}

fn html_row(row: &Row) -> Markup {
    let (class, word) = row.standing();
    let state = &row.state;
    let heard = state.batches > 0;
    html! { tr {
        th scope="row" { a href=(site_address(&row.site, "events")) { (row.site) } }
        td { (row.stream) }
        td { span class={ "chip " (class) } { (word) } }
        td.num { @if heard { (number::short(state.rate_fps)) } }
        td.time { @if heard { (words::utc(state.newest_ns)) } }
        td { @if heard { (time_quality(state.time_quality_code)) } }
        td.num { (state.samples.accepted) }
        td { (counted(&row.samples())) }
        td { (counted(&row.frames_not_used())) }
        td { (steps(state)) }
        td.num { (state.silences) }
    } }
}
