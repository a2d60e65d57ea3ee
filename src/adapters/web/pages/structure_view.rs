//! The page of a site's structure, for reading.

use maud::{Markup, html};

use super::{
    super::{
        acting,
        layout::verdict,
        plot::{self, Chart, Ink, Mark, Panel, Shape, padded, span_of},
        session::Access,
        words,
    },
    overlay::{self, Captions, Overlay},
    structure::{Stair, StructurePage},
};
use crate::{
    adapters::report::number,
    identification::ErrorSummary,
    load_model::{effect::Kind, effects},
};

/// The page's content.
pub(super) fn body(page: &StructurePage, source: &str) -> Markup {
    html! {
        h1 { "Model structure" }
        (lead(page))
        @if page.awaited() {
            p.done role="status" {
                "A fit with this structure is under way or queued; this page shows it as soon as it is there."
            }
        }
        (change(page))
        @if !page.stairs.is_empty() {
            h2 { "What each step did to the error" }
            (plot::figure(&staircase(page), Some(source)))
            (steps(page))
        }
        @if let Some(overlay) = &page.overlay {
            h2 { "Before and after, on an event " (seen(page, overlay)) }
            (plot::figure(&before_and_after(overlay), Some(source)))
        }
        @if !page.changes.is_empty() { (changes(page)) }
    }
}

/// The model that counts, and the one that was asked for where that is another.
fn lead(page: &StructurePage) -> Markup {
    let wanted = words::structure(&page.wanted);
    let Some((version, structure)) = &page.in_force else {
        return html! { p.lead { "The model is to be " strong { (wanted) } "; no set of it is published yet." } };
    };
    let decided = page.stairs.last().filter(|_| !page.awaited());
    html! {
        p.lead { "The model in force is " strong { (words::structure(structure)) } " (version " (version) ")." }
        @if *structure != page.wanted {
            p.note {
                "Asked for is " strong { (wanted) }
                @match decided.and_then(|stair| stair.decision.as_ref()) {
                    Some(record) => { ", which is not in force: " (record.decision.reason()) "." }
                    None => { ", which is not in force yet." }
                }
            }
        }
    }
}

/// What became of a step: a fit may be valid and yet be rejected for another that is better.
fn outcome(stair: &Stair) -> Markup {
    let reason = stair
        .decision
        .as_ref()
        .map(|record| record.decision.reason());
    let chip = |class: &str, word: &str| {
        html! { span class={ "chip " (class) } title=[reason] { (word) } }
    };
    html! {
        @match stair.decided() {
            Some("published") => (verdict(stair.fit.verdict)),
            Some("awaiting_approval") => (chip("open", "waits for approval")),
            Some("refused") => (chip("bad", "refused")),
            Some(_) => (chip("bad", "rejected")),
            None => (verdict(stair.fit.verdict)),
        }
        @if let Some(version) = stair.version {
            @if stair.decided() == Some("published") { " version " (version) }
            @else { " version " (version) " published before" }
        }
    }
}

/// Every chart of the page.
pub(super) fn charts(page: &StructurePage) -> Vec<Chart> {
    let staircase = (!page.stairs.is_empty()).then(|| staircase(page));
    let overlay = page.overlay.as_ref().map(before_and_after);
    staircase.into_iter().chain(overlay).collect()
}

fn seen(page: &StructurePage, overlay: &Overlay) -> &'static str {
    let event = &overlay.after.comparison.event;
    let held_out = page
        .stairs
        .last()
        .is_some_and(|s| s.set.held_out_events.contains(event));
    if held_out {
        "the fit has not seen"
    } else {
        "of the fit"
    }
}

fn change(page: &StructurePage) -> Markup {
    let Access { csrf, may_write } = &page.access;
    let address = page.head.address("structure");
    let parts = page.wanted.iter().skip(2);
    html! {
        section aria-label="Change the structure" {
            @if let Some(effect) = page.missing.first() {
                p { "The " a href=(page.head.address("diagnosis")) { "diagnosis" } " names " strong { (words::effect(effect)) } "." }
            }
            @if *may_write {
                form.filter method="post" action=(address) {
                    input type="hidden" name="csrf" value=(csrf);
                    label { "Add "
                        select name="add" required {
                            @if page.proposed().is_empty() { option value="" { "choose an effect" } }
                            @for (name, title, instrument) in catalogue(&page.wanted) {
                                option value=(name) selected[page.proposed() == name] { (title) @if instrument { " (instrument)" } }
                            }
                        }
                    }
                    label.wide { "because " input type="text" name="comment" maxlength="500" placeholder="for the record; may be empty"; }
                    button.main type="submit" { "Add and refit" }
                }
                @for effect in parts {
                    form.filter method="post" action=(address) {
                        input type="hidden" name="csrf" value=(csrf);
                        input type="hidden" name="remove" value=(effect);
                        button type="submit" { "Remove " (words::effect(effect)) }
                    }
                }
                p.note { "The change is kept with name and time. A fit follows, is validated on events it has not seen, and is published only if it is not worse." }
            } @else {
                p.note {
                    "This page is read-only here. " a href={ "/session?next=" (address) } { "Unlock it with the write token" }
                    " of the service to add or remove effects."
                }
            }
        }
    }
}

/// Effects that are not in the structure: name, title, whether it is the instrument's.
fn catalogue(wanted: &[String]) -> Vec<(&'static str, &'static str, bool)> {
    effects::catalogue()
        .iter()
        .map(|effect| effect.declaration())
        .filter(|declaration| !wanted.iter().any(|part| part == declaration.name))
        .map(|d| (d.name, d.title, d.kind == Kind::Instrument))
        .collect()
}

fn step_name(stairs: &[Stair], place: usize) -> String {
    let now = &stairs[place].fit.structure;
    let Some(before) = place.checked_sub(1).map(|k| &stairs[k].fit.structure) else {
        return words::structure(now);
    };
    let added = now
        .iter()
        .filter(|part| !before.contains(part))
        .map(|p| format!("+ {}", words::effect(p)));
    let removed = before
        .iter()
        .filter(|part| !now.contains(part))
        .map(|p| format!("\u{2212} {}", words::effect(p)));
    added.chain(removed).collect::<Vec<_>>().join(" ")
}

#[allow(
    clippy::too_many_lines,
    reason = "one chart described from top to bottom"
)]
fn staircase(page: &StructurePage) -> Chart {
    let stairs = &page.stairs;
    let log = |value: f64| value.max(1e-3).log10();
    // What validation judges and the floor is of: two cycles around an edge the filter of the instrument speaks.
    let judged = |errors: &ErrorSummary| log(errors.error_to_noise_away_from_edges);
    let fitted: Vec<f64> = stairs.iter().map(|s| judged(&s.set.fit)).collect();
    let held_out: Vec<f64> = stairs
        .iter()
        .map(|s| s.held_out().map_or(f64::NAN, judged))
        .collect();
    let floor = log(page.floor);
    let all: Vec<f64> = fitted
        .iter()
        .chain(&held_out)
        .copied()
        .chain([floor])
        .collect();
    // A tread per step and a riser to the next.
    let tread = |y: &[f64]| -> (Vec<f64>, Vec<f64>) {
        let corners = y.iter().enumerate().flat_map(|(k, &y)| {
            let at = k as f64;
            [(at - 0.5, y), (at + 0.5, y)]
        });
        corners.unzip()
    };
    let line = |name: &str, ink, y: &[f64], dashed| {
        let (x, y) = tread(y);
        Mark::Line {
            name: name.to_owned(),
            ink,
            x: Some(x),
            y,
            dashed,
        }
    };
    let points = |ink, shape, y: Vec<f64>| Mark::Points {
        name: String::new(),
        ink,
        shape,
        x: None,
        y,
        shade: None,
    };
    Chart {
        id: "staircase".to_owned(),
        title: "Error against structure".to_owned(),
        description:
            "Error over noise away from voltage edges of each structure in turn, on the fitted and on \
                      the held-out events, and the error of a perfect model as the floor."
                .to_owned(),
        horizontal_title: "structure".to_owned(),
        horizontal: (-0.6, stairs.len() as f64 - 0.4),
        names: (0..stairs.len()).map(|k| step_name(stairs, k)).collect(),
        x: (0..stairs.len()).map(|k| k as f64).collect(),
        linked: None,
        panels: vec![Panel {
            title: "error over noise, away from voltage edges".to_owned(),
            height: 220,
            vertical: padded(span_of(&all), 0.2),
            logarithmic: true,
            marks: vec![
                Mark::Level {
                    name: "noise floor".to_owned(),
                    ink: Ink::Mark,
                    at: floor,
                },
                line("fitted events", Ink::Measured, &fitted, true),
                line("held-out events", Ink::Model, &held_out, false),
                points(Ink::Measured, Shape::Ring, fitted),
                points(Ink::Model, Shape::Dot, held_out),
            ],
        }],
    }
}

fn steps(page: &StructurePage) -> Markup {
    html! {
        div.scroll tabindex="0" role="region" aria-label="Steps" {
            table.list.cards.tight {
                thead { tr {
                    th scope="col" { "Step" } th scope="col" { "Fitted, UTC" } th scope="col" { "Verdict" }
                    th.num scope="col" { "Error / noise, fitted" } th.num scope="col" { "held out" }
                    th.num scope="col" { "held out, off edges" }
                    th.num scope="col" { "Held-out error of P, %" } th.num scope="col" { "of Q, %" }
                } }
                tbody { @for (place, stair) in page.stairs.iter().enumerate() { tr {
                    th scope="row" { a href=(page.head.address(&format!("solutions?fit=fit-{}", stair.fit.id.0))) { (step_name(&page.stairs, place)) } }
                    td.time data-label="Fitted, UTC" { (words::utc(stair.fit.stored_ns)) }
                    td data-label="Verdict" { (outcome(stair)) }
                    td.num data-label="Error / noise, fitted" { (number::significant(stair.set.fit.error_to_noise, 3)) }
                    @if let Some(errors) = stair.held_out() {
                        td.num data-label="held out" { (number::significant(errors.error_to_noise, 3)) }
                        td.num data-label="held out, off edges" { (number::significant(errors.error_to_noise_away_from_edges, 3)) }
                        td.num data-label="Held-out error of P, %" { (number::significant(errors.eps_p_percent, 3)) }
                        td.num data-label="of Q, %" { (number::significant(errors.eps_q_percent, 3)) }
                    } @else { td {} td {} td {} td {} }
                } } }
            }
        }
    }
}

fn before_and_after(overlay: &Overlay) -> Chart {
    let captions = Captions {
        title: "Measurement, the model before and the model after",
        description: format!(
            "Active and reactive power of event {}: measured, and as modelled before and after the last change.",
            overlay.after.comparison.event
        ),
        before: "before",
        after: "after",
    };
    overlay::chart(overlay, &captions)
}

fn changes(page: &StructurePage) -> Markup {
    html! {
        h2 { "Changes" }
        div.scroll tabindex="0" role="region" aria-label="Changes" {
            table.list.cards {
                thead { tr { th scope="col" { "When, UTC" } th scope="col" { "Structure" } th scope="col" { "By" } th scope="col" { "Why" } } }
                tbody { @for change in &page.changes { tr {
                    th.time scope="row" { (words::utc(change.changed_ns)) } td data-label="Structure" { (words::structure(&change.structure)) }
                    td data-label="By" { (words::actor(&change.actor))
                        @if change.actor != acting::ACTOR { span.dim { ", " (change.origin.name().replace('_', " ")) } } } td data-label="Why" { (change.comment) }
                } } }
            }
        }
    }
}
