//! The events of a site: filter, sort, pick two to compare.

use std::{cmp::Ordering, collections::BTreeMap, sync::Arc};

use axum::{
    extract::{Path, Query, State},
    http::Uri,
    response::Response,
};
use maud::{Markup, html};
use serde::Deserialize;
use serde_json::{Value, json};

use super::super::{
    desk::Desk,
    layout::{SiteHead, Tab, segment},
    problem::Problem,
    view::{self, Form, Page, Table, cell},
    words,
};
use crate::{
    adapters::{
        http::EventDocument,
        report::number,
        store::{JobKind, WindowQuery, WindowSummary},
    },
    identification::{EventErrors, ParameterSet},
};

/// Events of a site that are looked through at most; older ones are reached by `before_ns` of the API.
const EVENTS_MAX: usize = 20_000;
/// Rows of one page.
const ROWS: usize = 50;

/// What the address asks for; what it leaves out is as it was at first.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Eq)]
pub(in super::super) struct Asked {
    /// Column to sort by: `onset`, `depth`, `error`, `noise`, `duration`.
    #[serde(default)]
    sort: String,
    /// `up` or `down`.
    #[serde(default)]
    order: String,
    /// `usable`, `refused` or everything.
    #[serde(default)]
    screening: String,
    /// `fitted`, `held_out`, `neither` or everything.
    #[serde(default)]
    role: String,
    /// Words that have to occur in name, time, triggers or screening.
    #[serde(default)]
    search: String,
    /// Page, from 1.
    #[serde(default)]
    page: String,
}

impl Asked {
    /// The number of the page, from 1.
    fn page(&self) -> Result<usize, Problem> {
        match self.page.as_str() {
            "" => Ok(1),
            text => text.parse().ok().filter(|page| *page > 0).ok_or_else(|| {
                Problem::bad_request(format!("`page` is `{text}` and not a number from 1"))
            }),
        }
    }

    /// Whether it asks for every event in the order in which the store has them: the newest first.
    fn is_plain(&self) -> bool {
        let everything = [&self.screening, &self.role, &self.search];
        everything.iter().all(|asked| asked.is_empty())
            && ["", "onset"].contains(&self.sort.as_str())
            && ["", "down"].contains(&self.order.as_str())
    }
}

pub(in super::super) async fn show(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    Query(asked): Query<Asked>,
    uri: Uri,
) -> Response {
    // The twins hold every row.
    let all = Form::of(uri.path()).1 != Form::Html;
    view::show(desk, uri, move |desk| Events::load(desk, &site, asked, all)).await
}

/// Errors by event, and how the event was used.
type Errors = BTreeMap<String, (EventErrors, &'static str)>;

struct Row {
    window: WindowSummary,
    /// What the set in force or the newest fit makes of it, and how it was used.
    errors: Option<(EventErrors, &'static str)>,
}

impl Row {
    fn duration_s(&self) -> f64 {
        self.window.sample_count.saturating_sub(1) as f64 / self.window.rate_fps
    }

    fn role(&self) -> &'static str {
        self.errors.as_ref().map_or("neither", |(_, role)| role)
    }

    fn screening(&self) -> (&'static str, String) {
        match &self.window.screening {
            None => ("open", "not judged yet".to_owned()),
            Some(screening) if screening.usable() => ("good", "usable".to_owned()),
            Some(screening) => {
                let reasons: Vec<_> = screening.refusals.iter().map(ToString::to_string).collect();
                ("bad", reasons.join("; "))
            }
        }
    }

    fn has(&self, search: &str) -> bool {
        let text = format!(
            "{} {} {} {}",
            self.window.id,
            words::utc(self.window.onset_ns),
            words::triggers(&self.window.triggers),
            self.screening().1,
        );
        let text = text.to_lowercase();
        search
            .to_lowercase()
            .split_whitespace()
            .all(|word| text.contains(word))
    }
}

struct Events {
    head: SiteHead,
    /// Whose errors are listed.
    errors_of: String,
    asked: Asked,
    /// Filtered and sorted; where nothing is filtered, the newest come first and only one page is asked for,
    /// those up to the end of that page.
    rows: Vec<Row>,
    /// After the filter.
    matching: usize,
    /// Before the filter.
    count: usize,
    page: usize,
}

impl Events {
    fn load(desk: &Desk, site: &str, asked: Asked, all: bool) -> Result<Self, Problem> {
        let head = SiteHead::load(desk, site)?;
        let page = asked.page()?;
        let read = if all || !asked.is_plain() {
            EVENTS_MAX
        } else {
            page.saturating_mul(ROWS).min(EVENTS_MAX)
        };
        let windows = desk.store().window_summaries(&WindowQuery {
            site: Some(site),
            count_max: read,
            ..WindowQuery::default()
        })?;
        let count = if windows.len() < read {
            windows.len()
        } else {
            let tallies = desk.store().window_tallies()?;
            let of_site = tallies.iter().find(|tally| tally.site == site);
            let windows = of_site.and_then(|tally| usize::try_from(tally.windows).ok());
            windows.unwrap_or(read).min(EVENTS_MAX)
        };
        let (mut known, errors_of) = judged(desk, &head)?;
        let mut rows: Vec<Row> = windows
            .into_iter()
            .map(|window| Row {
                errors: known.remove(&window.id),
                window,
            })
            .filter(|row| wanted(row, &asked))
            .collect();
        sort(&mut rows, &asked)?;
        let plain = asked.is_plain();
        Ok(Self {
            head,
            errors_of,
            matching: if plain { count } else { rows.len() },
            asked,
            rows,
            count,
            page,
        })
    }

    fn pages(&self) -> usize {
        self.matching.div_ceil(ROWS).max(1)
    }

    fn shown(&self) -> &[Row] {
        let first = (self.page - 1).saturating_mul(ROWS).min(self.rows.len());
        &self.rows[first..(first + ROWS).min(self.rows.len())]
    }
}

/// Errors of the set in force, else of the newest joint fit, and whose they are.
fn judged(desk: &Desk, head: &SiteHead) -> Result<(Errors, String), Problem> {
    if let Some((stored, set)) = &head.in_force {
        return Ok((
            errors_of(set),
            format!("version {}, in force", stored.version),
        ));
    }
    let newest = desk
        .store()
        .fits(&head.site.name, JobKind::IdentifySite, 1)?
        .pop();
    let Some(fit) = newest else {
        return Ok((Errors::new(), String::new()));
    };
    let set = fit.set().map_err(|e| Problem::unreadable("a fit", &e))?;
    Ok((
        set.as_ref().map_or_else(Errors::new, errors_of),
        format!("fit {}, which is not in force", fit.id.0),
    ))
}

/// Errors of each event of a set, and how the event was used.
pub(super) fn errors_of(set: &ParameterSet) -> Errors {
    let held_out = set.held_out.iter().flat_map(|summary| &summary.events);
    let fitted = set.fit.events.iter().map(|errors| (errors, "fitted"));
    fitted
        .chain(held_out.map(|errors| (errors, "held_out")))
        .map(|(errors, role)| (errors.event.clone(), (errors.clone(), role)))
        .collect()
}

fn role_in_words(role: &str) -> &str {
    match role {
        "held_out" => "held out",
        "neither" => "not used",
        other => other,
    }
}

fn wanted(row: &Row, asked: &Asked) -> bool {
    let screened = match asked.screening.as_str() {
        "usable" => row.screening().0 == "good",
        "refused" => row.screening().0 == "bad",
        _ => true,
    };
    let used = asked.role.is_empty() || asked.role == row.role();
    screened && used && (asked.search.is_empty() || row.has(&asked.search))
}

fn sort(rows: &mut [Row], asked: &Asked) -> Result<(), Problem> {
    let error = |row: &Row, of: fn(&EventErrors) -> f64| {
        row.errors
            .as_ref()
            .map_or(f64::NAN, |(errors, _)| of(errors))
    };
    let key: Box<dyn Fn(&Row) -> f64> = match asked.sort.as_str() {
        "" | "onset" => Box::new(|row| row.window.onset_ns as f64),
        "depth" => Box::new(|row| row.window.lowest_voltage_pu),
        "duration" => Box::new(Row::duration_s),
        "error" => Box::new(move |row| error(row, |e| e.event_eps_p_percent)),
        "noise" => Box::new(move |row| error(row, |e| e.error_to_noise)),
        other => {
            return Err(Problem::bad_request(format!(
                "`sort` is `{other}`; it can be onset, depth, duration, error or noise"
            )));
        }
    };
    let up = match asked.order.as_str() {
        "up" => true,
        "" | "down" => false,
        other => {
            return Err(Problem::bad_request(format!(
                "`order` is `{other}`; it can be up or down"
            )));
        }
    };
    // What has no number comes last either way; the newest first among equals.
    rows.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        match (a.is_nan(), b.is_nan()) {
            (true, true) => Ordering::Equal,
            (true, false) => Ordering::Greater,
            (false, true) => Ordering::Less,
            (false, false) if up => a.total_cmp(&b),
            (false, false) => b.total_cmp(&a),
        }
    });
    Ok(())
}

impl Page for Events {
    fn title(&self) -> String {
        format!("Events of {}", self.head.site.name)
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        Some((&self.head, Tab::Events))
    }

    fn body(&self, _source: &str) -> Markup {
        html! {
            h1 { "Events" }
            (self.filter())
            @if self.rows.is_empty() {
                p { @if self.count == 0 { "No disturbance has been recorded yet." } @else { "No event is like that." } }
            } @else {
                form action=(self.head.address("compare")) method="get" {
                    div.scroll tabindex="0" role="region" aria-label="Events" {
                        table.list.cards { (self.columns()) tbody { @for row in self.shown() { (self.line(row)) } } }
                    }
                    p.actions {
                        button type="submit" { "Compare the two ticked events" }
                        a href=(self.head.address("recordings")) { "Compare a recording of your own" }
                        (self.pager())
                    }
                }
                p.note {
                    "Lowest voltage per unit of the base. "
                    @if self.errors_of.is_empty() { "No fit of this site has been made yet. " } @else { "Errors of " (self.errors_of) "; " }
                    "“event error” is over the "
                    "part from the onset on. Error over noise is 1 where nothing but noise is left."
                }
            }
        }
    }

    fn json(&self) -> Result<Value, Problem> {
        let events: Vec<Value> = self
            .rows
            .iter()
            .map(|row| {
                json!({
                    "event": EventDocument::from(&row.window),
                    "role": row.role(),
                    "duration_s": row.duration_s(),
                    "event_eps_p_percent": row.errors.as_ref().map(|(e, _)| e.event_eps_p_percent),
                    "event_eps_q_percent": row.errors.as_ref().map(|(e, _)| e.event_eps_q_percent),
                    "error_to_noise": row.errors.as_ref().map(|(e, _)| e.error_to_noise),
                })
            })
            .collect();
        Ok(json!({ "site": self.head.site.name, "count": self.count, "events": events }))
    }

    fn table(&self) -> Table {
        let mut table = Table::new(&[
            "event",
            "onset_utc",
            "duration_s",
            "rate_fps",
            "lowest_voltage_pu",
            "triggers",
            "closing",
            "screening",
            "role",
            "event_eps_p_percent",
            "event_eps_q_percent",
            "error_to_noise",
        ]);
        table.rows = self
            .rows
            .iter()
            .map(|row| {
                let error = |of: fn(&EventErrors) -> f64| {
                    row.errors
                        .as_ref()
                        .map_or_else(String::new, |(errors, _)| cell(of(errors)))
                };
                vec![
                    row.window.id.clone(),
                    EventDocument::from(&row.window).onset_utc,
                    cell(row.duration_s()),
                    cell(row.window.rate_fps),
                    cell(row.window.lowest_voltage_pu),
                    words::triggers(&row.window.triggers),
                    words::closing(row.window.closing),
                    row.screening().1,
                    row.role().to_owned(),
                    error(|e| e.event_eps_p_percent),
                    error(|e| e.event_eps_q_percent),
                    error(|e| e.error_to_noise),
                ]
            })
            .collect();
        table
    }
}

impl Events {
    fn filter(&self) -> Markup {
        let asked = &self.asked;
        html! {
            form.filter method="get" role="search" {
                label { "Search " input type="search" name="search" value=(asked.search) placeholder="name, date, trigger, reason"; }
                label { "Screening "
                    select name="screening" {
                        @for (value, name) in [("", "all"), ("usable", "usable"), ("refused", "refused")] {
                            option value=(value) selected[asked.screening == value] { (name) }
                        }
                    }
                }
                label { "Use in the set "
                    select name="role" {
                        @for (value, name) in [("", "all"), ("fitted", "fitted"), ("held_out", "held out"), ("neither", "not used")] {
                            option value=(value) selected[asked.role == value] { (name) }
                        }
                    }
                }
                input type="hidden" name="sort" value=(asked.sort);
                input type="hidden" name="order" value=(asked.order);
                button type="submit" { "Filter" }
                span.dim { (self.matching) " of " (self.count) " events" }
            }
        }
    }

    fn columns(&self) -> Markup {
        let sortable = |key: &str, name: &str, numeric: bool| {
            let current = if self.asked.sort.is_empty() {
                "onset"
            } else {
                &self.asked.sort
            };
            let chosen = current == key;
            let up = chosen && self.asked.order == "up";
            let next = if chosen && !up { "up" } else { "down" };
            let sorted = chosen.then_some(if up { "ascending" } else { "descending" });
            html! {
                th.num[numeric] scope="col" aria-sort=[sorted] {
                    a href=(self.link(key, next, 1)) { (name) @if chosen { (if up { " ▲" } else { " ▼" }) } }
                }
            }
        };
        html! {
            thead { tr {
                th scope="col" { span.hidden { "Tick to compare" } }
                (sortable("onset", "Onset, UTC", false))
                (sortable("depth", "Lowest V, pu", true))
                (sortable("duration", "Length, s", true))
                th scope="col" { "Triggers" }
                th scope="col" { "Screening" }
                th scope="col" { "Use" }
                (sortable("error", "Event error of P, %", true))
                th.num scope="col" { "of Q, %" }
                (sortable("noise", "Error / noise", true))
            } }
        }
    }

    fn line(&self, row: &Row) -> Markup {
        let (class, words) = row.screening();
        let window = &row.window;
        html! {
            tr {
                td.tick { input type="checkbox" name="event" value=(window.id) aria-label={ "Compare " (window.id) }; }
                th scope="row" {
                    a href=(self.head.address(&format!("events/{}", segment(&window.id)))) { (words::utc(window.onset_ns)) }
                }
                td.num data-label="Lowest V, pu" { (number::fixed(window.lowest_voltage_pu, 3)) }
                td.num data-label="Length, s" { (number::fixed(row.duration_s(), 1)) }
                td data-label="Triggers" { (words::triggers(&window.triggers)) }
                td data-label="Screening" { span class={ "chip " (class) } { (if class == "bad" { "refused" } else { &words }) }
                    @if class == "bad" { " " span.dim { (words) } } }
                td.time data-label="Use" { (role_in_words(row.role())) }
                @if let Some((errors, _)) = &row.errors {
                    td.num data-label="Event error of P, %" { (number::significant(errors.event_eps_p_percent, 3)) }
                    td.num data-label="of Q, %" { (number::significant(errors.event_eps_q_percent, 3)) }
                    td.num data-label="Error / noise" { (number::significant(errors.error_to_noise, 3)) }
                } @else {
                    td {} td {} td {}
                }
            }
        }
    }

    fn pager(&self) -> Markup {
        let (sort, order) = (&self.asked.sort, &self.asked.order);
        html! {
            @if self.pages() > 1 {
                span.pager {
                    @if self.page > 1 { a href=(self.link(sort, order, self.page - 1)) { "‹ earlier rows" } " " }
                    "page " (self.page) " of " (self.pages())
                    @if self.page < self.pages() { " " a href=(self.link(sort, order, self.page + 1)) { "more rows ›" } }
                }
            }
        }
    }

    fn link(&self, sort: &str, order: &str, page: usize) -> String {
        let asked = &self.asked;
        let parts = [
            ("search", asked.search.as_str()),
            ("screening", &asked.screening),
            ("role", &asked.role),
            ("sort", sort),
            ("order", order),
            ("page", if page > 1 { &page.to_string() } else { "" }),
        ];
        let query: Vec<_> = parts
            .into_iter()
            .filter(|(_, value)| !value.is_empty())
            .map(|(name, value)| format!("{name}={}", segment(value)))
            .collect();
        format!("{}?{}", self.head.address("events"), query.join("&"))
    }
}
