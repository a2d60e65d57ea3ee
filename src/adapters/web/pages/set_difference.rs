//! The difference of two parameter sets.

use maud::{Markup, html};
use serde_json::{Value, json};

use super::{super::words, models::Model};
use crate::{adapters::report::number, identification::ParameterEstimate};

/// One parameter in both sets.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    name: String,
    meaning: String,
    unit: String,
    from: Option<f64>,
    to: Option<f64>,
    /// Difference over its standard error; none where one of the two is not determined.
    in_errors: Option<f64>,
}

/// Two sets side by side.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Difference {
    labels: (String, String),
    structures: (Vec<String>, Vec<String>),
    /// P, Q and over noise of the errors each quotes.
    errors: [(String, f64, f64); 3],
    rows: Vec<Row>,
}

/// Parameters of both, those of `to` first, then what only `from` has.
pub(super) fn difference(from: &Model, to: &Model) -> Difference {
    let find = |list: &[ParameterEstimate], name: &str| {
        list.iter().find(|estimate| estimate.name == name).cloned()
    };
    let mut rows: Vec<Row> = to
        .set
        .parameters
        .iter()
        .map(|new| row(find(&from.set.parameters, &new.name).as_ref(), Some(new)))
        .collect();
    let gone = from
        .set
        .parameters
        .iter()
        .filter(|old| find(&to.set.parameters, &old.name).is_none());
    rows.extend(gone.map(|old| row(Some(old), None)));
    let quoted = |model: &Model| {
        model
            .set
            .held_out
            .clone()
            .unwrap_or_else(|| model.set.fit.clone())
    };
    let (a, b) = (quoted(from), quoted(to));
    Difference {
        labels: (from.label.clone(), to.label.clone()),
        structures: (from.set.structure.clone(), to.set.structure.clone()),
        errors: [
            ("error of P, %".to_owned(), a.eps_p_percent, b.eps_p_percent),
            ("error of Q, %".to_owned(), a.eps_q_percent, b.eps_q_percent),
            (
                "error over noise".to_owned(),
                a.error_to_noise,
                b.error_to_noise,
            ),
        ],
        rows,
    }
}

fn row(from: Option<&ParameterEstimate>, to: Option<&ParameterEstimate>) -> Row {
    let any = to.or(from);
    let in_errors = from.zip(to).and_then(|(a, b)| {
        let error = a.standard_error?.hypot(b.standard_error?);
        (error > 0.0).then_some((b.value - a.value) / error)
    });
    Row {
        name: any.map_or_else(String::new, |e| e.name.clone()),
        meaning: any.map_or_else(String::new, |e| e.meaning.clone()),
        unit: any.map_or_else(String::new, |e| e.unit.clone()),
        from: from.map(|e| e.value),
        to: to.map(|e| e.value),
        in_errors,
    }
}

impl Difference {
    pub(super) fn markup(&self) -> Markup {
        let shown = |value: Option<f64>| {
            value.map_or_else(|| "–".to_owned(), |v| number::significant(v, 4))
        };
        html! {
            div.scroll tabindex="0" role="region" aria-label="Difference of two sets" {
                table.list.cards {
                    thead { tr {
                        th scope="col" { "What" } th scope="col" { "Unit" }
                        th.num scope="col" { (self.labels.0) } th.num scope="col" { (self.labels.1) }
                        th.num scope="col" { "Change" } th.num scope="col" { "in standard errors" } th scope="col" { "Meaning" }
                    } }
                    tbody {
                        tr { th scope="row" { "structure" } td {} td data-label=(self.labels.0) { (words::structure(&self.structures.0)) }
                            td data-label=(self.labels.1) { (words::structure(&self.structures.1)) } td {} td {} td {} }
                        @for (name, a, b) in &self.errors {
                            tr { th scope="row" { (name) } td {} td.num data-label=(self.labels.0) { (number::significant(*a, 3)) } td.num data-label=(self.labels.1) { (number::significant(*b, 3)) }
                                td.num data-label="Change" { (number::significant(b - a, 2)) } td {} td.dim { "held-out events where there are any" } }
                        }
                        @for row in &self.rows {
                            @let change = row.from.zip(row.to).map(|(a, b)| b - a);
                            tr {
                                th scope="row" { (row.name) } td data-label="Unit" { (unit(&row.unit)) }
                                td.num data-label=(self.labels.0) { (shown(row.from)) } td.num data-label=(self.labels.1) { (shown(row.to)) }
                                td.num data-label="Change" { (change.map_or_else(String::new, |c| number::significant(c, 2))) }
                                td.num data-label="in standard errors" { (row.in_errors.map_or_else(String::new, |c| number::fixed(c, 1))) }
                                td.dim { (row.meaning) }
                            }
                        }
                    }
                }
            }
        }
    }

    pub(super) fn json(&self) -> Value {
        json!({
            "from": self.labels.0, "to": self.labels.1,
            "structure_from": self.structures.0, "structure_to": self.structures.1,
            "parameters": self.rows.iter().map(|row| json!({
                "parameter": row.name, "unit": row.unit, "from": row.from, "to": row.to,
                "change_in_standard_errors": row.in_errors,
            })).collect::<Vec<_>>(),
        })
    }
}

/// A unit for reading: nothing for a number without one.
pub(super) fn unit(unit: &str) -> &str {
    if unit == "1" { "" } else { unit }
}
