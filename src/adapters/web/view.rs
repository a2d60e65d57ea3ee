//! One page in three forms: HTML, JSON, CSV.

use std::sync::Arc;

use axum::{
    http::{Uri, header},
    response::{Html, IntoResponse, Response},
};
use maud::Markup;
use serde_json::Value;

use super::{
    desk::Desk,
    layout::{self, SiteHead},
    plot::{Chart, charts_json},
    problem::Problem,
};

/// The form a page is asked for in: the end of its path says it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    Html,
    Json,
    Csv,
    /// What the script draws.
    Charts,
}

impl Form {
    /// A path without its ending, and the form that the ending says.
    pub(super) fn of(path: &str) -> (&str, Self) {
        if path.starts_with("/api/") {
            (path, Self::Json)
        } else if let Some(path) = path.strip_suffix(".charts.json") {
            (path, Self::Charts)
        } else if let Some(path) = path.strip_suffix(".json") {
            (path, Self::Json)
        } else if let Some(path) = path.strip_suffix(".csv") {
            (path, Self::Csv)
        } else {
            (path, Self::Html)
        }
    }
}

/// A table of words, as CSV.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Table {
    /// Names of the columns, units last.
    pub(super) header: Vec<String>,
    /// The rows.
    pub(super) rows: Vec<Vec<String>>,
}

impl Table {
    pub(super) fn new(header: &[&str]) -> Self {
        Self {
            header: header.iter().map(|&name| name.to_owned()).collect(),
            rows: Vec::new(),
        }
    }

    fn csv(&self) -> Result<Vec<u8>, Problem> {
        let failed = |error: &dyn std::fmt::Display| Problem::unreadable("the table", error);
        let mut writer = csv::WriterBuilder::new()
            .flexible(true)
            .from_writer(Vec::new());
        writer.write_record(&self.header).map_err(|e| failed(&e))?;
        for row in &self.rows {
            writer.write_record(row).map_err(|e| failed(&e))?;
        }
        writer.into_inner().map_err(|e| failed(&e))
    }
}

/// A number for CSV: all digits, empty when there is none.
pub(super) fn cell(value: f64) -> String {
    if value.is_finite() {
        value.to_string()
    } else {
        String::new()
    }
}

/// What every page can do.
pub(super) trait Page {
    /// Title of the window.
    fn title(&self) -> String;
    /// The site it belongs to and which of its pages it is.
    fn place(&self) -> Option<(&SiteHead, layout::Tab)>;
    /// Where its live updates come from; none where it has none.
    fn live(&self) -> Option<String> {
        self.place().map(|(head, _)| head.address("updates"))
    }
    /// What it shows; `source` is the address of its charts' numbers.
    fn body(&self, source: &str) -> Markup;
    /// Its charts.
    fn charts(&self) -> Vec<Chart> {
        Vec::new()
    }
    /// The same for programs.
    fn json(&self) -> Result<Value, Problem>;
    /// The same as a table.
    fn table(&self) -> Table;
}

/// Loads a page on a thread that may block and answers it in the form its address asks for.
pub(super) async fn show<P: Page>(
    desk: Arc<Desk>,
    uri: Uri,
    load: impl FnOnce(&Desk) -> Result<P, Problem> + Send + 'static,
) -> Response {
    let (_, form) = Form::of(uri.path());
    let Ok(permit) = Arc::clone(&desk.seats).acquire_owned().await else {
        return Problem::unavailable("the service is stopping").answer(form);
    };
    let work = {
        let desk = Arc::clone(&desk);
        // The work goes on when nobody waits for it any more, and keeps its seat.
        move || {
            let _permit = permit;
            load(&desk).and_then(|page| render(&page, &uri, form))
        }
    };
    match tokio::task::spawn_blocking(work).await {
        Ok(Ok(response)) => response,
        Ok(Err(problem)) => problem.answer(form),
        Err(_) => Problem::unavailable("the page was interrupted").answer(form),
    }
}

fn render<P: Page>(page: &P, uri: &Uri, form: Form) -> Result<Response, Problem> {
    Ok(match form {
        Form::Html => Html(layout::page(page, uri).into_string()).into_response(),
        Form::Json => axum::Json(page.json()?).into_response(),
        Form::Charts => axum::Json(charts_json(&page.charts())).into_response(),
        Form::Csv => {
            let content_type = [(
                header::CONTENT_TYPE,
                "text/csv; charset=utf-8; header=present",
            )];
            (content_type, page.table().csv()?).into_response()
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_a_path_says_the_form() {
        assert_eq!(
            Form::of("/sites/a/events.csv"),
            ("/sites/a/events", Form::Csv)
        );
        assert_eq!(Form::of("/sites/a.b"), ("/sites/a.b", Form::Html));
        let path = "/api/v1/sites/a.csv";
        assert_eq!(Form::of(path), (path, Form::Json));
    }
}
