//! A diagnosis for reading.

use maud::{Markup, html};

use super::{
    super::{layout::segment, plot, words},
    diagnosis::DiagnosisPage,
    diagnosis_charts as charts, diagnosis_trial,
    structure::still_missing,
};
use crate::adapters::{
    report::number,
    wire::v1::{
        CandidateV1, DiagnosisV1, EffectWorthV1, GeneralFormV1, UnexplainedV1, UntestableV1,
    },
};

/// The page's content.
pub(super) fn body(page: &DiagnosisPage, source: &str) -> Markup {
    let Some(stored) = &page.stored else {
        return html! {
            h1 { "Diagnosis" }
            p.lead {
                "No diagnosis has been made yet. One is made by itself once a site has enough usable events and "
                "a joint fit, and again when new events have come."
            }
        };
    };
    html! {
        h1 { "What is the model missing? " (status_chip(&stored.status)) }
        p.verdict-sentence { (words::readable(&stored.summary)) }
        p.facts {
            "Diagnosis " (stored.version) " of " (words::utc(stored.stored_ns)) " UTC of the structure "
            (words::structure(&stored.structure)) "."
        }
        @if let Some(diagnosis) = &page.diagnosis { (details(page, diagnosis, source)) } @else {
            p.problem { "The details of this diagnosis are no longer kept." }
        }
        (history(page))
    }
}

/// A status as a chip.
pub(super) fn status_chip(status: &str) -> Markup {
    let (class, words) = match status {
        "adequate" => ("good", "nothing is missing"),
        "missing_effect" => ("bad", "an effect is missing"),
        "instrument_suspect" => ("bad", "suspect the instrument"),
        "unknown_effect" => ("bad", "something unknown is missing"),
        _ => ("open", "cannot be judged"),
    };
    html! { span class={ "chip " (class) } { (words) } }
}

fn details(page: &DiagnosisPage, diagnosis: &DiagnosisV1, source: &str) -> Markup {
    html! {
        (offer(page, diagnosis))
        @if let Some(trial) = &page.trial { (diagnosis_trial::section(page, diagnosis, trial, source)) }
        @if !diagnosis.reasons.is_empty() {
            h2 { "Why" }
            ul.reasons { @for reason in &diagnosis.reasons { li { (words::readable(reason)) } } }
        }
        @if !diagnosis.effects.is_empty() { (in_the_structure(&diagnosis.effects)) }
        @if !diagnosis.candidates.is_empty() {
            h2 { "Effects that were tried, best first" }
            @if charts::any_refitted(diagnosis) { (plot::figure(&charts::candidates(diagnosis), Some(source))) }
            (candidates(diagnosis))
        }
        (separation(diagnosis))
        div.charts {
            (plot::figure(&charts::segments(diagnosis), Some(source)))
            (plot::figure(&charts::ladder(diagnosis), Some(source)))
        }
        (events(page, diagnosis))
        @if let Some(unexplained) = &diagnosis.unexplained { (unknown(unexplained)) }
        @if !diagnosis.untestable.is_empty() { (untestable(&diagnosis.untestable)) }
    }
}

/// The way on: one click adds the effect.
fn offer(page: &DiagnosisPage, diagnosis: &DiagnosisV1) -> Markup {
    let wanted = page.wanted.as_ref().map(|record| &record.structure[..]);
    let open = still_missing(&diagnosis.answer_set, wanted.unwrap_or_default());
    let added = diagnosis.answer_set.iter().find(|_| open.is_empty());
    html! {
        @if added.is_some() {
            p.done role="status" {
                "The model has been changed since this diagnosis: its structure is now "
                (words::structure(wanted.unwrap_or_default())) ". "
                a href=(page.head.address("structure")) { "See what that did to the error" } "."
            }
        }
        @if !open.is_empty() {
            div.actions {
                @for (place, effect) in open.iter().enumerate() { (adding(page, effect, place == 0)) }
            }
        }
    }
}

/// A form that adds an effect; a way to it for those who may not act yet.
fn adding(page: &DiagnosisPage, effect: &str, first: bool) -> Markup {
    let address = page.head.address("structure");
    let (before, after) = if first {
        ("Add ", " to the model")
    } else {
        ("or add ", "")
    };
    html! {
        @if page.access.may_write {
            form method="post" action=(address) {
                input type="hidden" name="csrf" value=(page.access.csrf);
                input type="hidden" name="add" value=(effect);
                button.main[first] type="submit" { (before) (words::effect(effect)) (after) }
            }
        } @else {
            a.button[first] href={ (address) "?add=" (segment(effect)) } { (before) (words::effect(effect)) (after) }
        }
    }
}

/// Those that were refitted in full, the others folded: they were seen too little of.
fn candidates(diagnosis: &DiagnosisV1) -> Markup {
    let (refitted, screened): (Vec<_>, Vec<_>) = diagnosis
        .candidates
        .iter()
        .partition(|candidate| candidate.delta_bic.is_some());
    html! {
        @if !refitted.is_empty() {
            div.scroll tabindex="0" role="region" aria-label="Effects tried" {
                table.list.cards.tight {
                    thead { tr {
                        th scope="col" { "Effect" } th scope="col" { "Verdict" }
                        th.num scope="col" { "Held-out error, × noise" } th.num scope="col" { "Share of best gain" }
                        th.num scope="col" { "Change of BIC" } th.num scope="col" { "Explains of the residual" }
                        th.num scope="col" { "Visible in these events" } th scope="col" { "Parameters" }
                    } }
                    tbody { @for candidate in refitted { (refitted_line(diagnosis, candidate)) } }
                }
            }
            p.note {
                "“Explains” is how much of what the model leaves a first, linear look finds in the effect; “visible” "
                "how much of the effect could not be imitated by the parameters of the present model."
            }
        }
        @if !screened.is_empty() { (screened_out(diagnosis, &screened)) }
    }
}

fn percent(share: f64) -> String {
    if share.is_finite() {
        format!("{} %", number::fixed(100.0 * share, 0))
    } else {
        String::new()
    }
}

fn named(candidate: &CandidateV1) -> Markup {
    html! {
        (words::effect(&candidate.effect))
        @if candidate.kind == "instrument" { " " span.chip.open { "instrument" } }
    }
}

fn refitted_line(diagnosis: &DiagnosisV1, candidate: &CandidateV1) -> Markup {
    let error = |value: Option<f64>| value.map(|v| number::significant(v, 3));
    let errors = error(candidate.held_out_error_before).zip(error(candidate.held_out_error_after));
    let bic = candidate
        .delta_bic
        .map_or_else(String::new, |v| number::significant(v, 3));
    html! {
        tr {
            th scope="row" {
                (named(candidate))
                @if candidate.model.is_some() {
                    " " a.quiet href={ "?with=" (segment(&candidate.effect)) "#what-it-does" } aria-label={ "Draw " (words::effect(&candidate.effect)) } { "draw" }
                }
            }
            td.verdict data-label="Verdict" { (standing(diagnosis, candidate)) }
            td.num.time data-label="Held-out error, × noise" {
                @if let Some((before, after)) = errors { (before) " → " strong { (after) } }
            }
            td.num data-label="Share of best gain" { (candidate.share_of_best_gain.map_or_else(String::new, percent)) }
            td.num data-label="Change of BIC" { (bic) }
            td.num data-label="Explains of the residual" { (percent(candidate.score_share)) }
            td.num data-label="Visible in these events" { (percent(candidate.visibility)) }
            td.values data-label="Parameters" { @for (name, p) in &candidate.parameters {
                span.value { (words::parameter(name, &p.unit)) " " (number::significant(p.value, 3))
                    @if p.unit != "1" { " " (p.unit) } } " "
            } }
        }
    }
}

fn screened_out(diagnosis: &DiagnosisV1, candidates: &[&CandidateV1]) -> Markup {
    html! {
        details {
            summary { (candidates.len()) " effects were not refitted" }
            div.scroll tabindex="0" role="region" aria-label="Effects not refitted" {
                table.list.cards.tight {
                    thead { tr {
                        th scope="col" { "Effect" } th.num scope="col" { "Explains of the residual" }
                        th.num scope="col" { "Visible in these events" } th scope="col" { "Why not" }
                    } }
                    tbody { @for candidate in candidates { tr {
                        th scope="row" { (named(candidate)) }
                        td.num data-label="Explains of the residual" { (percent(candidate.score_share)) }
                        td.num data-label="Visible in these events" { (percent(candidate.visibility)) }
                        td data-label="Why not" { (standing(diagnosis, candidate)) }
                    } } }
                }
            }
        }
    }
}

fn standing(diagnosis: &DiagnosisV1, candidate: &CandidateV1) -> Markup {
    let in_set = diagnosis.answer_set.contains(&candidate.effect);
    html! {
        @if candidate.declared { span.chip.bad { "missing" } }
        @else if in_set { span.chip.open { "as good an answer" } }
        @else if let Some(reason) = candidate.refused.first() { span.dim { (words::readable(reason)) } }
        @else { span.dim { "no" } }
    }
}

fn separation(diagnosis: &DiagnosisV1) -> Markup {
    let groups = diagnosis
        .candidates
        .iter()
        .filter(|c| c.group.len() > 1 && !c.would_separate.is_empty());
    let groups: Vec<&CandidateV1> = groups
        .filter(|c| diagnosis.answer_set.contains(&c.effect))
        .take(3)
        .collect();
    html! {
        @if diagnosis.answer_set.len() > 1 {
            h2 { "What these events cannot tell apart" }
            p { (diagnosis.answer_set.iter().map(|e| words::effect(e)).collect::<Vec<_>>().join(", ")) " describe these events equally well." }
        }
        @if let Some(candidate) = groups.first() {
            p { strong { "What would separate them: " } (candidate.would_separate) }
        }
    }
}

fn events(page: &DiagnosisPage, diagnosis: &DiagnosisV1) -> Markup {
    let role = |event: &String| {
        if diagnosis.events.fit.contains(event) {
            "fitted"
        } else if diagnosis.events.gate.contains(event) {
            "gate"
        } else if diagnosis.events.untouched.contains(event) {
            "untouched"
        } else {
            ""
        }
    };
    html! {
        h2 { "Where it fails, event by event" }
        div.scroll tabindex="0" role="region" aria-label="Failures by event" {
            table.list.cards {
                thead { tr { th scope="col" { "Event" } th scope="col" { "Use" } th.num scope="col" { "Lowest V / V0" }
                    th.num scope="col" { "Root of misfit" } th scope="col" { "In a sentence" } } }
                tbody { @for failure in &diagnosis.failures { tr {
                    th scope="row" { a href=(page.head.address(&format!("events/{}", segment(&failure.event)))) { (failure.event) } }
                    td data-label="Use" { (role(&failure.event)) }
                    td.num data-label="Lowest V / V0" { (number::fixed(failure.lowest_voltage, 3)) }
                    td.num data-label="Root of misfit" { (number::significant(failure.error_to_noise, 3)) }
                    td { (failure.sentence) }
                } } }
            }
        }
        p.note {
            "Fitted events carried the fits, gate events decided whether an effect may be declared, and errors are "
            "quoted from untouched events, which served neither."
        }
        @for refused in &diagnosis.events.refused { p.note { "Left out: " (refused.event) ": " (refused.reason) } }
    }
}

fn unknown(unexplained: &UnexplainedV1) -> Markup {
    html! {
        h2 { "What no effect of the catalogue explains" }
        p { (unexplained.signature) }
        @if let Some(form) = &unexplained.general_form { (general_form(form)) }
        @if !unexplained.terms.is_empty() {
            div.scroll tabindex="0" role="region" aria-label="Terms" {
                table.list {
                    thead { tr { th scope="col" { "Term" } th scope="col" { "In" } th.num scope="col" { "Coefficient, of P0" } th.num scope="col" { "Explains" } } }
                    tbody { @for term in &unexplained.terms { tr {
                        td { code { (term.formula) } } td { (term.channel) }
                        td.num { (number::significant(term.coefficient, 3)) } td.num { (number::fixed(100.0 * term.share, 0)) " %" }
                    } } }
                }
            }
        }
        @if let Some(file) = &unexplained.effect_file {
            details {
                summary { "A file that adds these terms to the model (--effect-file)" }
                pre tabindex="0" { (file) }
            }
        }
    }
}

fn general_form(form: &GeneralFormV1) -> Markup {
    html! {
        p {
            strong { (form.title) } " (" code { (form.name) } "): with this general form, which is no effect of the catalogue, the "
            "misfit falls from " (number::significant(form.misfit_before, 3)) " to " (number::significant(form.misfit_after, 3)) " per sample"
            @if let (Some(before), Some(after)) = (form.held_out_error_before, form.held_out_error_after) {
                ", its root on held-out events from " (number::significant(before, 3)) " to " (number::significant(after, 3))
            } "."
        }
        details {
            summary { "It as fitted (--effect-file)" }
            pre tabindex="0" { (form.effect_file) }
        }
    }
}

fn in_the_structure(effects: &[EffectWorthV1]) -> Markup {
    html! {
        h2 { "What the effects of the structure are worth" }
        div.scroll tabindex="0" role="region" aria-label="Effects of the structure" {
            table.list.cards {
                thead { tr { th scope="col" { "Without" } th.num scope="col" { "ΔBIC" }
                    th.num scope="col" { "Untouched, error / noise" } th scope="col" { "Needed" } } }
                tbody { @for worth in effects { tr {
                    th scope="row" { (words::effect(&worth.effect)) }
                    td.num data-label="ΔBIC" { (number::fixed(worth.delta_bic_without, 0)) }
                    td.num data-label="Untouched, error / noise" {
                        (worth.untouched_without.map_or_else(|| "-".to_owned(), |error| number::significant(error, 3)))
                    }
                    td data-label="Needed" { @if worth.needed { "yes" } @else { "no: the events are described as well without it" } }
                } } }
            }
        }
    }
}

fn untestable(list: &[UntestableV1]) -> Markup {
    html! {
        h2 { "Effects on which these events are silent" }
        div.scroll tabindex="0" role="region" aria-label="Effects that cannot be tested" {
            table.list.cards {
                thead { tr { th scope="col" { "Effect" } th scope="col" { "Would have shown from" } th scope="col" { "Matters from" } th scope="col" { "Needs" } } }
                tbody { @for effect in list {
                    @let unit = if effect.unit == "1" { "" } else { &effect.unit };
                    tr {
                        th scope="row" { (words::effect(&effect.effect)) }
                        td data-label="Would have shown from" { @if effect.smallest_detectable_amplitude.is_finite() {
                            (words::parameter(&effect.amplitude, &effect.unit)) " " (number::significant(effect.smallest_detectable_amplitude, 2)) " " (unit)
                        } @else { "nothing would have shown" } }
                        td data-label="Matters from" { (number::significant(effect.meaningful_amplitude, 2)) " " (unit) }
                        td data-label="Needs" { (effect.needs) }
                    }
                } }
            }
        }
    }
}

fn history(page: &DiagnosisPage) -> Markup {
    html! {
        @if page.history.len() > 1 {
            h2 { "Diagnoses" }
            div.scroll tabindex="0" role="region" aria-label="Diagnoses" {
                table.list {
                    thead { tr { th scope="col" { "No." } th scope="col" { "When, UTC" } th scope="col" { "Structure" } th scope="col" { "Answer" } th.num scope="col" { "Error / noise" } } }
                    tbody { @for stored in &page.history { tr {
                        th scope="row" { a href=(page.head.address(&format!("diagnoses/{}", stored.version))) { (stored.version) } }
                        td.time { (words::utc(stored.stored_ns)) }
                        td { (words::structure(&stored.structure)) }
                        td { (status_chip(&stored.status)) " " (stored.answer_set.iter().map(|e| words::effect(e)).collect::<Vec<_>>().join(", ")) }
                        td.num { (number::significant(stored.error_to_noise, 3)) }
                    } } }
                }
            }
        }
    }
}
