//! The numbers behind a chart, for reading.

use maud::{Markup, html};

use super::{Chart, Mark};
use crate::adapters::report::{decimate::thinned, number};

/// Rows of one table at most; the CSV twin of the page has all.
const ROWS_MAX: usize = 120;

/// One table per set of marks with the same horizontal values.
pub(super) fn tables(chart: &Chart) -> Markup {
    let shared: Vec<(String, &[f64])> = columns(chart, |own| own.is_none());
    html! {
        @if !shared.is_empty() { (table(chart, &chart.x, &shared)) }
        @for panel in &chart.panels {
            @for mark in &panel.marks {
                @if let Some((name, x, y)) = own_values(mark) {
                    (table(chart, x, &[(label(&panel.title, name), y)]))
                }
            }
        }
        ul.levels {
            @for panel in &chart.panels {
                @for mark in &panel.marks {
                    @if let Mark::Level { name, at, .. } = mark {
                        @if !name.is_empty() {
                            li { (panel.title) ": " (name) " " (shown(panel.logarithmic, *at)) }
                        }
                    }
                }
            }
        }
    }
}

fn columns(chart: &Chart, wanted: impl Fn(Option<&Vec<f64>>) -> bool) -> Vec<(String, &[f64])> {
    let mut columns = Vec::new();
    for panel in &chart.panels {
        for mark in &panel.marks {
            match mark {
                Mark::Line { name, x, y, .. } | Mark::Points { name, x, y, .. }
                    if wanted(x.as_ref()) =>
                {
                    columns.push((label(&panel.title, name), y.as_slice()));
                }
                Mark::Band { name, x, high, .. } if wanted(x.as_ref()) => {
                    columns.push((label(&panel.title, name), high.as_slice()));
                }
                _ => {}
            }
        }
    }
    columns
}

fn own_values(mark: &Mark) -> Option<(&str, &[f64], &[f64])> {
    match mark {
        Mark::Line {
            name,
            x: Some(x),
            y,
            ..
        }
        | Mark::Points {
            name,
            x: Some(x),
            y,
            ..
        }
        | Mark::Bars { name, x, y, .. }
            if !name.is_empty() =>
        {
            Some((name, x, y))
        }
        Mark::Band {
            name,
            x: Some(x),
            high,
            ..
        } if !name.is_empty() => Some((name, x, high)),
        _ => None,
    }
}

fn label(panel: &str, name: &str) -> String {
    if name.is_empty() {
        panel.to_owned()
    } else {
        format!("{panel}, {name}")
    }
}

fn shown(logarithmic: bool, value: f64) -> String {
    number::significant(
        if logarithmic {
            10_f64.powf(value)
        } else {
            value
        },
        4,
    )
}

fn table(chart: &Chart, x: &[f64], columns: &[(String, &[f64])]) -> Markup {
    let rows = thinned(&(0..x.len()).collect::<Vec<_>>(), ROWS_MAX);
    html! {
        div.scroll tabindex="0" role="region" aria-label={ "Numbers of " (chart.title) } {
            table.numbers {
                thead {
                    tr {
                        th scope="col" { (chart.horizontal_title) }
                        @for (name, _) in columns { th scope="col" { (name) } }
                    }
                }
                tbody {
                    @for &row in &rows {
                        tr {
                            th scope="row" { (place(chart, x[row])) }
                            @for (_, values) in columns {
                                td { (values.get(row).map_or_else(String::new, |v| number::significant(*v, 4))) }
                            }
                        }
                    }
                }
            }
        }
        @if rows.len() < x.len() {
            p.note { "Every " (x.len().div_ceil(ROWS_MAX)) "th of " (x.len()) " rows; the CSV twin of this page has all." }
        }
    }
}

fn place(chart: &Chart, x: f64) -> String {
    let named = (0..chart.names.len()).find(|&k| (k as f64 - x).abs() < 0.5);
    named.map_or_else(|| number::fixed(x, 4), |k| chart.names[k].clone())
}
