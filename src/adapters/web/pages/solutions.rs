//! What the global search found: every solution, which one led to which, every direction.

use std::sync::Arc;

use axum::{
    extract::{Path, Query, State},
    http::Uri,
    response::Response,
};
use maud::{Markup, html};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{
    super::{
        desk::Desk,
        layout::{SiteHead, Tab},
        plot::{self, Chart, Ink, Mark, Panel, Shape, padded, span_of},
        problem::Problem,
        view::{self, Page, Table, cell},
        words,
    },
    models::{self, Choice},
};
use crate::adapters::{
    report::number,
    store::{FitId, JobKind, StoredFit},
};

/// Solutions whose parameters are listed; the CSV twin has all.
const LISTED: usize = 12;
/// Solutions that one label names.
const LABELLED: usize = 2;

#[derive(Debug, Default, Deserialize)]
pub(in super::super) struct Asked {
    /// `fit-12`; the newest joint fit when left out.
    #[serde(default)]
    fit: String,
    /// The solution whose directions are drawn; the best that has any when left out.
    #[serde(default)]
    from: String,
}

pub(in super::super) async fn show(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    Query(asked): Query<Asked>,
    uri: Uri,
) -> Response {
    view::show(desk, uri, move |desk| Solutions::load(desk, &site, &asked)).await
}

/// What the page reads of a stored fit (`identify --json`).
#[derive(Debug, Deserialize)]
struct Found {
    solutions: Vec<Solution>,
    directions: Vec<Direction>,
    cost: Cost,
}

#[derive(Debug, Deserialize)]
struct Solution {
    #[serde(rename = "id")]
    number: usize,
    tier: usize,
    found_from: Option<usize>,
    direction: Option<usize>,
    objective: Option<f64>,
    parameters: serde_json::Map<String, Value>,
    at_bound: Vec<String>,
}

#[derive(Debug, Deserialize)]
struct Direction {
    from: usize,
    #[serde(rename = "direction")]
    number: usize,
    label: String,
    exit_distance: Option<f64>,
    outcome: String,
    solution: Option<usize>,
    /// Distance and objective; documents of earlier versions have none.
    #[serde(default)]
    profile: Vec<[Option<f64>; 2]>,
}

#[derive(Debug, Deserialize)]
struct Cost {
    simulations: u64,
    sensitivity_simulations: u64,
    seconds: Option<f64>,
}

struct Solutions {
    head: SiteHead,
    choices: Vec<Choice>,
    fit: Option<(StoredFit, Option<Found>)>,
    /// The solution whose directions are asked for.
    from: Option<usize>,
}

impl Solutions {
    fn load(desk: &Desk, site: &str, asked: &Asked) -> Result<Self, Problem> {
        let from = match asked.from.as_str() {
            "" => None,
            text => Some(text.parse().map_err(|_| {
                Problem::bad_request(format!("`{text}` is not the number of a solution"))
            })?),
        };
        let asked = asked.fit.as_str();
        let head = SiteHead::load(desk, site)?;
        let choices: Vec<Choice> = models::choices(desk, site, None)?
            .into_iter()
            .filter(|choice| choice.key.starts_with("fit-"))
            .collect();
        let store = desk.store();
        let fit = if asked.is_empty() {
            store.fits(site, JobKind::IdentifySite, 1)?.pop()
        } else {
            let id = asked
                .strip_prefix("fit-")
                .and_then(|number| number.parse().ok());
            let id = id.ok_or_else(|| {
                Problem::bad_request(format!("`{asked}` names no fit: it is `fit-` and a number"))
            })?;
            let found = store.fit(FitId(id))?.filter(|fit| fit.site == site);
            Some(found.ok_or_else(|| Problem::not_found(format!("`{site}` has no fit {id}")))?)
        };
        let fit = fit.map(|fit| {
            let found = fit
                .document
                .as_deref()
                .map(serde_json::from_str)
                .transpose();
            let found = found.map_err(|e| Problem::unreadable("the fit", &e))?;
            Ok::<_, Problem>((fit, found))
        });
        Ok(Self {
            head,
            choices,
            fit: fit.transpose()?,
            from,
        })
    }

    fn found(&self) -> Option<&Found> {
        self.fit.as_ref()?.1.as_ref()
    }
}

impl Page for Solutions {
    fn title(&self) -> String {
        format!("Solutions of {}", self.head.site.name)
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        Some((&self.head, Tab::Solutions))
    }

    fn body(&self, source: &str) -> Markup {
        html! {
            h1 { "Solutions of the global search" }
            @if let Some((fit, found)) = &self.fit {
                @let key = format!("fit-{}", fit.id.0);
                form.filter method="get" {
                    label { "Fit " (models::select("fit", &self.choices, &key, None)) }
                    button type="submit" { "Show" }
                }
                p.facts { "Fit " (fit.id.0) " of " (words::utc(fit.stored_ns)) " UTC, " (words::structure(&fit.structure)) }
                @if let Some(found) = found { (self.contents(found, &key, source)) } @else {
                    p.problem { "The details of this fit are no longer kept." }
                }
            } @else {
                p { "No joint fit has been made yet: it needs enough usable events." }
            }
        }
    }

    fn charts(&self) -> Vec<Chart> {
        let Some(found) = self.found() else {
            return Vec::new();
        };
        let along = origin(found, self.from).map(|from| along(found, from));
        [waterfall(found), tiers(found)]
            .into_iter()
            .chain(along)
            .collect()
    }

    fn json(&self) -> Result<Value, Problem> {
        let document = self
            .fit
            .as_ref()
            .and_then(|(fit, _)| fit.document.as_deref());
        let document: Option<Value> = document
            .map(serde_json::from_str)
            .transpose()
            .map_err(|e| Problem::unreadable("the fit", &e))?;
        Ok(json!({
            "site": self.head.site.name,
            "fit": self.fit.as_ref().map(|(fit, _)| fit.id.0),
            "document": document,
        }))
    }

    fn table(&self) -> Table {
        let solutions = self.found().map_or(&[][..], |found| &found.solutions);
        let names = solutions
            .first()
            .map(|s| s.parameters.keys().cloned().collect::<Vec<_>>());
        let names = names.unwrap_or_default();
        let mut table = Table::new(&["solution", "tier", "found_from", "direction", "objective"]);
        table.header.extend(names.iter().cloned());
        let optional = |value: Option<usize>| value.map_or_else(String::new, |v| v.to_string());
        table.rows = solutions
            .iter()
            .map(|solution| {
                let mut row = vec![
                    solution.number.to_string(),
                    solution.tier.to_string(),
                    optional(solution.found_from),
                    optional(solution.direction),
                    cell(solution.objective.unwrap_or(f64::NAN)),
                ];
                row.extend(names.iter().map(|name| cell(value(solution, name))));
                row
            })
            .collect();
        table
    }
}

fn value(solution: &Solution, name: &str) -> f64 {
    solution
        .parameters
        .get(name)
        .and_then(Value::as_f64)
        .unwrap_or(f64::NAN)
}

impl Solutions {
    fn contents(&self, found: &Found, key: &str, source: &str) -> Markup {
        let seconds = found.cost.seconds.unwrap_or(f64::NAN);
        html! {
            p.lead {
                (found.solutions.len()) @if found.solutions.len() == 1 { " solution" } @else { " solutions" }
                " and " (found.directions.len()) " search directions, for " (found.cost.simulations)
                " plain simulations and " (found.cost.sensitivity_simulations) " with sensitivities in "
                (number::significant(seconds, 2)) " s. The lowest objective is the fit; the others are local "
                "minima that a search from one start may end in."
            }
            div.charts {
                (plot::figure(&waterfall(found), Some(source)))
                (plot::figure(&tiers(found), Some(source)))
            }
            h2 { "Parameters of each solution" }
            (parameters(found))
            h2 { "Search directions" }
            @if let Some(from) = origin(found, self.from) {
                form.filter method="get" {
                    input type="hidden" name="fit" value=(key);
                    label { "From solution "
                        select name="from" {
                            @for other in origins(found) { option value=(other) selected[other == from] { (other) } }
                        }
                    }
                    button type="submit" { "Show" }
                }
                (plot::figure(&along(found, from), Some(source)))
            }
            (directions(found))
        }
    }
}

/// Solutions with directions whose objective is kept, best first.
fn origins(found: &Found) -> Vec<usize> {
    let kept = |from: usize| {
        let mut directions = found.directions.iter();
        directions.any(|d| d.from == from && d.profile.len() > 1)
    };
    let numbers = found.solutions.iter().map(|solution| solution.number);
    numbers.filter(|number| kept(*number)).collect()
}

fn origin(found: &Found, asked: Option<usize>) -> Option<usize> {
    let origins = origins(found);
    let asked = asked.filter(|from| origins.contains(from));
    asked.or_else(|| origins.first().copied())
}

/// The objective along every direction from a solution, as far as its exit point was looked for.
#[allow(
    clippy::too_many_lines,
    reason = "one chart described from top to bottom"
)]
fn along(found: &Found, from: usize) -> Chart {
    let looks = [
        ("new_solution", "led to a new solution", Ink::Model),
        ("known_solution", "led to a known one", Ink::Measured),
        ("", "found no exit", Ink::Unused),
    ];
    let mut named = [false; 3];
    let (mut marks, mut ends, mut all) = (
        Vec::new(),
        (Vec::new(), Vec::new()),
        (Vec::new(), Vec::new()),
    );
    let kept = found.directions.iter().filter(|d| d.from == from);
    for direction in kept.filter(|d| d.profile.len() > 1) {
        let place = looks.iter().position(|look| look.0 == direction.outcome);
        let place = place.unwrap_or(2);
        let (_, name, ink) = looks[place];
        let first = !std::mem::replace(&mut named[place], true);
        let x = direction
            .profile
            .iter()
            .map(|point| point[0].unwrap_or(f64::NAN));
        let x: Vec<f64> = x.collect();
        let y: Vec<f64> = direction
            .profile
            .iter()
            .map(|point| logarithm(point[1]))
            .collect();
        if let (true, Some(x), Some(y)) = (direction.exit_distance.is_some(), x.last(), y.last()) {
            ends.0.push(*x);
            ends.1.push(*y);
        }
        all.0.extend(&x);
        all.1.extend(&y);
        marks.push(Mark::Line {
            name: if first {
                name.to_owned()
            } else {
                String::new()
            },
            ink,
            x: Some(x),
            y,
            dashed: place == 1,
        });
    }
    marks.push(Mark::Points {
        name: "exit point".to_owned(),
        ink: Ink::Mark,
        shape: Shape::Ring,
        x: Some(ends.0),
        y: ends.1,
        shade: None,
    });
    Chart {
        id: "along".to_owned(),
        title: format!("Objective along the directions from solution {from}"),
        description:
            "The objective along every search direction from this solution: it rises, and where it \
                      falls again lies the exit point, beyond which another solution is looked for."
                .to_owned(),
        horizontal_title: "distance from the solution, widths of the search box".to_owned(),
        horizontal: span_of(&all.0)
            .filter(|(low, high)| low < high)
            .unwrap_or((0.0, 1.0)),
        names: Vec::new(),
        x: Vec::new(),
        linked: None,
        panels: vec![Panel {
            title: "objective, half the weighted sum of squares".to_owned(),
            height: 240,
            vertical: padded(span_of(&all.1), 0.2),
            logarithmic: true,
            marks,
        }],
    }
}

fn logarithm(objective: Option<f64>) -> f64 {
    // An objective of 0 has no logarithm; nothing measured has one of 1e-12.
    objective.map_or(f64::NAN, |value| value.max(1e-12).log10())
}

fn waterfall(found: &Found) -> Chart {
    let y: Vec<f64> = found
        .solutions
        .iter()
        .map(|s| logarithm(s.objective))
        .collect();
    let count = y.len() as f64;
    Chart {
        id: "waterfall".to_owned(),
        title: "Every solution, best first".to_owned(),
        description: "The objective of every local solution in ascending order.".to_owned(),
        horizontal_title: "solution".to_owned(),
        horizontal: (-0.5, count - 0.5),
        names: found
            .solutions
            .iter()
            .map(|s| s.number.to_string())
            .collect(),
        x: (0..y.len()).map(|k| k as f64).collect(),
        linked: None,
        panels: vec![Panel {
            title: "objective, half the weighted sum of squares".to_owned(),
            height: 180,
            vertical: padded(span_of(&y), 0.2),
            logarithmic: true,
            marks: vec![Mark::Points {
                name: String::new(),
                ink: Ink::Model,
                shape: Shape::Dot,
                x: None,
                y,
                shade: None,
            }],
        }],
    }
}

fn tiers(found: &Found) -> Chart {
    let place = |id: usize| {
        let solution = found
            .solutions
            .iter()
            .find(|solution| solution.number == id)?;
        Some((solution.tier as f64, logarithm(solution.objective)))
    };
    let mut marks = Vec::new();
    let mut named = [false, false];
    for direction in &found.directions {
        let new = direction.outcome == "new_solution";
        let ends = direction
            .solution
            .and_then(place)
            .zip(place(direction.from));
        let Some((to, from)) = ends.filter(|_| new || direction.outcome == "known_solution") else {
            continue;
        };
        let name = if new {
            "led to a new solution"
        } else {
            "led to a known one"
        };
        let first = !std::mem::replace(&mut named[usize::from(new)], true);
        marks.push(Mark::Line {
            name: if first {
                name.to_owned()
            } else {
                String::new()
            },
            ink: if new { Ink::Model } else { Ink::Noise },
            x: Some(vec![from.0, to.0]),
            y: vec![from.1, to.1],
            dashed: !new,
        });
    }
    let y: Vec<f64> = found
        .solutions
        .iter()
        .map(|s| logarithm(s.objective))
        .collect();
    marks.push(Mark::Points {
        name: "solution".to_owned(),
        ink: Ink::Measured,
        shape: Shape::Dot,
        x: Some(found.solutions.iter().map(|s| s.tier as f64).collect()),
        y: y.clone(),
        shade: None,
    });
    marks.extend(labels(found, &y));
    let last = found.solutions.iter().map(|s| s.tier).max().unwrap_or(0);
    Chart {
        id: "tiers".to_owned(),
        title: "Which solution led to which".to_owned(),
        description:
            "Every solution at its tier and objective, joined to the one whose direction led to it."
                .to_owned(),
        horizontal_title: "tier".to_owned(),
        horizontal: (-0.4, last as f64 + 0.6),
        names: (0..=last).map(|tier| tier.to_string()).collect(),
        x: Vec::new(),
        linked: None,
        panels: vec![Panel {
            title: "objective, half the weighted sum of squares".to_owned(),
            height: 260,
            vertical: padded(span_of(&y), 0.2),
            logarithmic: true,
            marks,
        }],
    }
}

/// A number beside each solution; those that lie on each other share one label.
fn labels(found: &Found, y: &[f64]) -> Vec<Mark> {
    let span = span_of(y).map_or(1.0, |(low, high)| (high - low).max(f64::MIN_POSITIVE));
    let mut labels: Vec<(f64, f64, Vec<usize>)> = Vec::new();
    for (solution, &y) in found.solutions.iter().zip(y) {
        let x = solution.tier as f64;
        let near = |label: &&mut (f64, f64, Vec<usize>)| {
            (label.0 - x).abs() < 0.5 && (label.1 - y).abs() < 0.06 * span
        };
        match labels.iter_mut().find(near) {
            Some(label) => label.2.push(solution.number),
            None => labels.push((x, y, vec![solution.number])),
        }
    }
    let marks = labels.into_iter().map(|(x, y, numbers)| {
        let first: Vec<_> = numbers
            .iter()
            .take(LABELLED)
            .map(usize::to_string)
            .collect();
        let text = match numbers.len().saturating_sub(LABELLED) {
            0 => first.join(", "),
            more => format!("{} and {more} more", first.join(", ")),
        };
        Mark::Label { x, y, text }
    });
    marks.collect()
}

fn parameters(found: &Found) -> Markup {
    let listed = &found.solutions[..found.solutions.len().min(LISTED)];
    html! {
        @if listed.len() < found.solutions.len() { p.note { "The best " (LISTED) "; the CSV twin of this page has all." } }
        div.scroll tabindex="0" role="region" aria-label="Parameters of each solution" {
            table.list {
                thead { tr {
                    th scope="col" { "Parameter" }
                    @for solution in listed { th.num scope="col" { "solution " (solution.number) } }
                } }
                tbody {
                    tr { th scope="row" { "objective" }
                        @for solution in listed { td.num { (number::significant(solution.objective.unwrap_or(f64::NAN), 5)) } } }
                    tr { th scope="row" { "tier" }
                        @for solution in listed { td.num { (solution.tier) } } }
                    tr { th scope="row" { "found from" }
                        @for solution in listed { td.num {
                            @if let (Some(from), Some(direction)) = (solution.found_from, solution.direction) { (from) ", direction " (direction) } @else { "start" }
                        } } }
                    @if let Some(first) = found.solutions.first() {
                        @for name in first.parameters.keys() {
                            tr { th scope="row" { (name) }
                                @for solution in listed { td.num {
                                    (number::significant(value(solution, name), 4))
                                    @if solution.at_bound.contains(name) { span.dim { " at bound" } }
                                } } }
                        }
                    }
                }
            }
        }
    }
}

fn directions(found: &Found) -> Markup {
    html! {
        div.scroll.tall tabindex="0" role="region" aria-label="Search directions" {
            table.list {
                thead { tr {
                    th.num scope="col" { "From" } th.num scope="col" { "No." } th scope="col" { "Direction" }
                    th.num scope="col" { "Exit at" } th scope="col" { "Outcome" } th.num scope="col" { "Solution" }
                } }
                tbody { @for direction in &found.directions { tr {
                    td.num { (direction.from) } td.num { (direction.number) } td { (direction.label) }
                    td.num { (direction.exit_distance.map_or_else(String::new, |d| number::significant(d, 3))) }
                    td { (direction.outcome.replace('_', " ")) }
                    td.num { @if let Some(solution) = direction.solution { (solution) } }
                } } }
            }
        }
    }
}
