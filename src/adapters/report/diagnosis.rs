//! The report of a diagnosis: what is missing, where the model fails, who else might be meant.

use maud::{Markup, html};

use super::{
    diagnosis_tables::{self, role},
    failure_figures::{self, EVENT_SEGMENTS},
    figure::{Ink, ReportError},
    ladder_words::ladder_in_words,
    number::significant,
    page::{self, drawn, legend, percent, tile, to_noise},
};
use crate::diagnosis::{Diagnosis, EventFailure, GeneralForm, Status, misfit_root_floor};

/// The report of a diagnosis as one HTML document. The same input gives the same bytes.
///
/// # Errors
///
/// [`ReportError::Drawing`] when a figure cannot be drawn.
pub fn render_diagnosis(
    diagnosis: &Diagnosis,
    software_version: &str,
) -> Result<String, ReportError> {
    let body = html! {
        (head(diagnosis))
        (where_it_fails(diagnosis, None)?)
        (in_the_structure(diagnosis))
        (candidates(diagnosis, "Which effect is missing"))
        (unexplained(diagnosis))
        (untestable(diagnosis))
        (events(diagnosis, None)?)
    };
    let title = format!("Diagnosis of {}", diagnosis.site);
    Ok(page::page(&title, &body, software_version))
}

fn head(diagnosis: &Diagnosis) -> Markup {
    let baseline = &diagnosis.baseline;
    html! {
        header {
            p.kicker { "Diagnosis" }
            h1 { (diagnosis.site) }
            p { "Structure: " strong { (diagnosis.structure.join(" + ")) } ". " (sets(diagnosis)) }
            (verdict(diagnosis))
            dl.tiles {
                (tile("Residual over noise, fitted", &to_noise(Some(&baseline.fit))))
                (tile("Residual over noise, gate", &to_noise(baseline.gate.as_ref())))
                (tile("Residual over noise, untouched", &to_noise(baseline.untouched.as_ref())))
                (tile("ε of P, fitted", &percent(Some(&baseline.fit), |s| s.eps_p_percent)))
                (tile("ε of Q, fitted", &percent(Some(&baseline.fit), |s| s.eps_q_percent)))
                (tile("Noise floor of a perfect model", &html! { (significant(diagnosis.noise_floor, 3)) }))
            }
            (left_out(diagnosis))
        }
    }
}

/// Which events served for what.
pub(super) fn sets(diagnosis: &Diagnosis) -> String {
    let events = &diagnosis.events;
    format!(
        "{} events fitted, {} held out as a gate, {} untouched.",
        events.fit.len(),
        events.gate.len(),
        events.untouched.len()
    )
}

/// Events that were refused.
pub(super) fn left_out(diagnosis: &Diagnosis) -> Markup {
    let refused = &diagnosis.events.refused;
    html! { @if !refused.is_empty() { details {
        summary { "Events left out: " (refused.len()) }
        ul { @for (event, reason) in refused { li { strong { (event) } ": " (reason) } } }
    } } }
}

/// The answer in words, with its reasons.
pub(super) fn verdict(diagnosis: &Diagnosis) -> Markup {
    let (class, sign, words) = match diagnosis.status {
        Status::Adequate => ("pass", "✓", "Nothing is missing."),
        Status::MissingEffect => ("fail", "✗", "An effect is missing."),
        Status::InstrumentSuspect => ("fail", "✗", "The instrument is suspect."),
        Status::UnknownEffect => (
            "fail",
            "✗",
            "Something is missing that is not in the catalogue.",
        ),
        Status::CannotJudge => ("open", "?", "These events do not allow a judgement."),
    };
    html! {
        div.verdict.(class) {
            p { span aria-hidden="true" { (sign) " " } strong { (words) } " " (diagnosis.summary) }
            @if !diagnosis.reasons.is_empty() {
                ul { @for reason in &diagnosis.reasons { li { (reason) } } }
            }
        }
    }
}

/// All events together: sentences, ladder, segments, residual against voltage.
pub(super) fn where_it_fails(
    diagnosis: &Diagnosis,
    before: Option<&[EventFailure]>,
) -> Result<Markup, ReportError> {
    let untouched = |event: &str| role(&diagnosis.events, event) == "untouched";
    let all: Vec<&EventFailure> = diagnosis.failures.iter().collect();
    let rungs: Vec<_> = (diagnosis.failures.iter())
        .map(|f| (f.event.as_str(), f.lowest_voltage, f.error_to_noise))
        .collect();
    let ladder =
        failure_figures::ladder(&diagnosis.failures, before, &untouched, misfit_root_floor());
    let scatter = failure_figures::against_voltage("against-voltage", &all);
    Ok(html! {
        section {
            h2 { "Where the model fails" }
            p { "The model of this section and of the events below is fitted to all events but the untouched; the \
                 errors of the gate above come from a fit without it." }
            (diagnosis_tables::failures(diagnosis, before))
            div.pair {
                figure {
                    figcaption {
                        h3 { "Severity ladder" }
                        p { (ladder_in_words(&rungs)) }
                        ul.legend {
                            (legend("dot", Ink::Measured, "fitted or gate"))
                            (legend("triangle", Ink::Model, "untouched"))
                            @if before.is_some() { (legend("ring", Ink::Rival, "before")) }
                            (legend("line", Ink::Onset, "noise floor"))
                        }
                    }
                    (drawn(&ladder)?)
                }
                figure {
                    figcaption {
                        h3 { "Residual against voltage" }
                        p { "Measured minus modelled, away from voltage edges. A bend or a step along the voltage \
                             names a threshold; a loop between the colours names a lag." }
                        ul.legend { @for (_, ink, _, key, words) in EVENT_SEGMENTS { (legend(key, ink, words)) } }
                    }
                    (drawn(&scatter)?)
                }
            }
            details {
                summary { "Residuals by segment" }
                (diagnosis_tables::segments("Residuals of all events together, by segment", &diagnosis.segments))
            }
        }
    })
}

/// The rivals and what would separate them.
pub(super) fn candidates(diagnosis: &Diagnosis, title: &str) -> Markup {
    let separate: Vec<&str> = (diagnosis.candidates.iter())
        .filter(|c| diagnosis.answer_set.contains(&c.effect) && !c.would_separate.is_empty())
        .map(|c| c.would_separate.as_str())
        .take(1)
        .collect();
    html! {
        section {
            h2 { (title) }
            @match diagnosis.answer_set.as_slice() {
                [] => p { "No effect of the catalogue is declared." },
                [one] => p { "Declared: " strong { code { (one) } } "." },
                several => p { "These events do not separate " @for (index, effect) in several.iter().enumerate() {
                    @if index > 0 { ", " } strong { code { (effect) } }
                } "." },
            }
            @for words in &separate { p { "What would separate them: " (words) } }
            @if !diagnosis.candidates.is_empty() { (diagnosis_tables::rivals(diagnosis)) }
        }
    }
}

/// What no effect of the catalogue explains.
pub(super) fn unexplained(diagnosis: &Diagnosis) -> Markup {
    html! { @if let Some(unexplained) = &diagnosis.unexplained {
        section {
            h2 { "Not in the catalogue" }
            p { (unexplained.signature) }
            @if let Some(form) = &unexplained.general_form { (general_form(form)) }
            @if !unexplained.terms.is_empty() { (diagnosis_tables::terms(unexplained)) }
            @if let Some(file) = &unexplained.effect_file {
                details {
                    summary { "The same as a file for --effect-file" }
                    pre { (file) }
                }
            }
        }
    } }
}

/// The general form that explains most of it, as fitted.
fn general_form(form: &GeneralForm) -> Markup {
    html! {
        p {
            strong { (form.title) } " (" code { (form.name) } "): with this general form, which is no effect of the catalogue, the \
             misfit falls from " (significant(form.misfit_before, 3)) " to " (significant(form.misfit_after, 3)) " per sample"
            @if let (Some(before), Some(after)) = (form.held_out_error_before, form.held_out_error_after) {
                ", its root on held-out events from " (significant(before, 3)) " to " (significant(after, 3))
            } "."
        }
        (diagnosis_tables::of_form(form))
        details {
            summary { "It as fitted, as a file for --effect-file" }
            pre { (form.effect_file) }
        }
    }
}

/// What the effects that the structure has already are worth.
pub(super) fn in_the_structure(diagnosis: &Diagnosis) -> Markup {
    html! { @if !diagnosis.effects.is_empty() {
        section {
            h2 { "What the effects of the structure are worth" }
            (diagnosis_tables::worth(diagnosis))
        }
    } }
}

/// Effects on which the events are silent.
pub(super) fn untestable(diagnosis: &Diagnosis) -> Markup {
    html! { @if !diagnosis.untestable.is_empty() {
        section {
            h2 { "Not testable with these events" }
            (diagnosis_tables::untestable(&diagnosis.untestable))
        }
    } }
}

/// One section per event; with the model of `before` beside.
pub(super) fn events(
    diagnosis: &Diagnosis,
    before: Option<&[EventFailure]>,
) -> Result<Markup, ReportError> {
    let mut sections = Vec::with_capacity(diagnosis.failures.len());
    for (index, failure) in diagnosis.failures.iter().enumerate() {
        let same = |other: &&EventFailure| other.event == failure.event;
        let earlier = before.and_then(|before| before.iter().find(same));
        let id = format!("e{}", index + 1);
        sections.push(event(&id, diagnosis, failure, earlier)?);
    }
    Ok(html! { @for section in &sections { (section) } })
}

fn event(
    id: &str,
    diagnosis: &Diagnosis,
    failure: &EventFailure,
    before: Option<&EventFailure>,
) -> Result<Markup, ReportError> {
    let mut plots = Vec::new();
    for figure in failure_figures::event_figures(id, failure, before) {
        plots.push(drawn(&figure)?);
    }
    let against_voltage = failure_figures::against_voltage(&format!("{id}-voltage"), &[failure]);
    let correlation = failure_figures::correlation(&format!("{id}-correlation"), failure);
    let correlation = correlation.as_ref().map(drawn).transpose()?;
    Ok(html! {
        section.event id=(id) {
            h2 { "Event " (failure.event) }
            p { strong { (failure.sentence) } }
            p { "Role: " (role(&diagnosis.events, &failure.event)) ". Root of misfit per sample "
                @if let Some(before) = before { (significant(before.error_to_noise, 3)) " before, " }
                (significant(failure.error_to_noise, 3)) "." }
            figure {
                figcaption { ul.legend {
                    (legend("line", Ink::Measured, "measured"))
                    (legend("line", Ink::Model, "model, and its residual (measured minus model)"))
                    @if before.is_some() { (legend("line", Ink::Rival, "model before")) }
                    (legend("area", Ink::Noise, "noise, ±2 σ of the fit"))
                    (legend("line", Ink::Onset, "onset"))
                    @for (_, ink, _, _, words) in EVENT_SEGMENTS { (legend("faint", ink, words)) }
                } }
                div.pair { @for plot in &plots { (plot) } }
                details {
                    summary { "Residual against voltage, and their correlation" }
                    div.pair {
                        div {
                            ul.legend {
                                @for (_, ink, _, key, words) in EVENT_SEGMENTS { (legend(key, ink, words)) }
                                (legend("line", Ink::Model, "mean by voltage"))
                            }
                            (drawn(&against_voltage)?)
                        }
                        @if let Some(correlation) = &correlation {
                            div {
                                ul.legend { (legend("area", Ink::Noise, "95 of 100 values of unrelated series")) }
                                (correlation)
                            }
                        }
                    }
                }
                details {
                    summary { "Residuals by segment, and what they depend on" }
                    (diagnosis_tables::segments("Residuals by segment", &failure.segments))
                    @if !failure.dependences.is_empty() { (diagnosis_tables::dependences(failure)) }
                }
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::{super::diagnosis_fixture as fixture, *};

    fn page() -> String {
        render_diagnosis(&fixture::diagnosis(), "0.1.0").unwrap()
    }

    #[test]
    fn the_page_names_no_other_host_runs_no_script_and_escapes_data() {
        let page = page();
        for forbidden in ["http://", "https://", "<script", "url(", "@import", "<img"] {
            assert!(!page.contains(forbidden), "{forbidden}");
        }
        assert!(page.contains("site-&lt;02&gt;"));
    }

    #[test]
    fn answer_rivals_and_silence_are_said_in_words() {
        let page = page();
        for words in [
            "An effect is missing.",
            "These events do not separate",
            "What would separate them: deeper dips",
            "held-out error falls by 1 % only",
            "Not testable with these events",
            "Not in the catalogue",
            "dp = &quot;a*v&quot;",
            "s after the clearing P is",
        ] {
            assert!(page.contains(words), "{words}");
        }
    }

    #[test]
    fn identifiers_in_the_page_are_unique() {
        let page = page();
        let ids = || {
            page.split(" id=\"")
                .skip(1)
                .filter_map(|rest| rest.split('"').next())
        };
        let mut all: Vec<_> = ids().collect();
        all.sort_unstable();
        let count = all.len();
        all.dedup();
        assert_eq!(all.len(), count);
        assert!(count > 12, "{count}");
    }

    #[test]
    fn a_diagnosis_without_events_is_still_a_page() {
        let mut diagnosis = fixture::diagnosis();
        diagnosis.failures.clear();
        diagnosis.candidates.clear();
        diagnosis.answer_set.clear();
        diagnosis.status = Status::CannotJudge;
        let page = render_diagnosis(&diagnosis, "0.1.0").unwrap();
        assert!(page.contains("do not allow a judgement"));
        assert_eq!(page, render_diagnosis(&diagnosis, "0.1.0").unwrap());
    }
}
