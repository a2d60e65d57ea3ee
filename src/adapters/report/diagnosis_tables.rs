//! Tables of a diagnosis: events, segments, rivals, effects that cannot be tested, terms, steps.

use maud::{Markup, html};

use super::{
    number::{ABSENT, fixed, significant},
    staircase::step_in_words,
    tables::scrollable,
};
use crate::{
    diagnosis::{
        Candidate, Diagnosis, EventFailure, EventSets, GeneralForm, Improvement, ImprovementStep,
        SegmentResidual, Unexplained, Untestable, misfit_root_floor,
    },
    identification::ErrorSummary,
    load_model::effect::Kind,
};

/// What an event served for, in a word.
pub(super) fn role(events: &EventSets, event: &str) -> &'static str {
    let among = |list: &[String]| list.iter().any(|name| name == event);
    if among(&events.fit) {
        "fitted"
    } else if among(&events.gate) {
        "gate"
    } else if among(&events.untouched) {
        "untouched"
    } else {
        "not used"
    }
}

/// Every event with its error and its failure in a sentence.
pub(super) fn failures(diagnosis: &Diagnosis, before: Option<&[EventFailure]>) -> Markup {
    let earlier = |event: &str| {
        let found = before?.iter().find(|failure| failure.event == event);
        found.map(|failure| failure.error_to_noise)
    };
    let table = html! {
        table {
            caption { "Misfit is the root mean square of the residual of the event part over the deviation that \
                       each sample has in the fit, which is more than its noise where the voltage moves: a \
                       perfect model leaves about " (fixed(misfit_root_floor(), 2)) "." }
            thead { tr {
                th scope="col" { "Event" }
                th scope="col" { "Role" }
                th.number scope="col" { "Lowest V" }
                th.number scope="col" { "Largest Δf, %" }
                @if before.is_some() { th.number scope="col" { "Root of misfit before" } }
                th.number scope="col" { "Root of misfit" }
                th scope="col" { "Where the model fails" }
            } }
            tbody { @for (index, failure) in diagnosis.failures.iter().enumerate() { tr {
                th scope="row" { a href={ "#e" (index + 1) } { (failure.event) } }
                td { (role(&diagnosis.events, &failure.event)) }
                td.number { (fixed(failure.lowest_voltage, 3)) }
                td.number { (fixed(100.0 * failure.frequency_deviation, 2)) }
                @if before.is_some() {
                    td.number { (earlier(&failure.event).map_or(ABSENT.to_owned(), |e| significant(e, 3))) }
                }
                td.number { (significant(failure.error_to_noise, 3)) }
                td.words { (failure.sentence) }
            } } }
        }
    };
    scrollable("Events and where the model fails", &table)
}

/// Residuals by segment and channel.
pub(super) fn segments(caption: &str, segments: &[SegmentResidual]) -> Markup {
    let table = html! {
        table {
            caption { (caption) }
            thead { tr {
                th scope="col" { "Segment" }
                th scope="col" { "Channel" }
                @for head in ["From, s", "To, s", "Samples", "Mean, % of P₀", "Rms, % of P₀", "Over noise"] {
                    th.number scope="col" { (head) }
                }
            } }
            tbody { @for residual in segments { tr {
                th scope="row" { (residual.segment.name().replace('_', " ")) }
                td { (residual.channel.name()) }
                td.number { (fixed(residual.begin_s, 2)) }
                td.number { (fixed(residual.end_s, 2)) }
                td.number { (residual.samples) }
                td.number { (fixed(100.0 * residual.mean_pu, 3)) }
                td.number { (fixed(100.0 * residual.rms_pu, 3)) }
                td.number.bad[residual.to_noise > 2.0] { (significant(residual.to_noise, 3)) }
            } } }
        }
    };
    scrollable(caption, &table)
}

/// What the residuals of an event depend on, strongest first.
pub(super) fn dependences(failure: &EventFailure) -> Markup {
    let table = html! {
        table {
            caption { "What the residual depends on: share of its variance that its means in bins explain" }
            thead { tr {
                th scope="col" { "Channel" } th scope="col" { "Quantity" }
                th.number scope="col" { "Explained, %" }
                th scope="col" { "Mean residual, % of P₀, in bins of rising quantity" }
            } }
            tbody { @for found in &failure.dependences { tr {
                th scope="row" { (found.channel.name()) }
                td { (found.quantity.name().replace('_', " ")) }
                td.number { (fixed(100.0 * found.explained, 0)) }
                td.words {
                    @for (index, bin) in found.bins.iter().enumerate() {
                        @if index > 0 { ", " }
                        (fixed(100.0 * bin.1, 2))
                    }
                }
            } } }
        }
    };
    scrollable("What the residual depends on", &table)
}

/// Effects of the structure, and what is lost without each.
pub(super) fn worth(diagnosis: &Diagnosis) -> Markup {
    let untouched = diagnosis.baseline.untouched.as_ref();
    let with = untouched.map(|of| significant(of.error_to_noise, 3));
    let table = html! {
        table {
            caption { "Each effect taken out by itself, everything else fitted again. ΔBIC: change of the information \
                       criterion over all events, positive is worse."
                      @if let Some(with) = &with { " With all of them the untouched events are left at " (with) " times the noise." } }
            thead { tr {
                th scope="col" { "Without" }
                th.number scope="col" { "ΔBIC" }
                th.number scope="col" { "Untouched, over noise" }
                th scope="col" { "Needed" }
            } }
            tbody { @for worth in &diagnosis.effects { tr {
                th scope="row" { code { (worth.effect) } }
                td.number { (fixed(worth.delta_bic_without, 0)) }
                td.number { (worth.untouched_without.map_or(ABSENT.to_owned(), |error| significant(error, 3))) }
                td { @if worth.is_superfluous { span.flag { "no" } } @else { "yes" } }
            } } }
        }
    };
    scrollable("What the effects of the structure are worth", &table)
}

/// Candidates, best first, with what speaks for and against each.
pub(super) fn rivals(diagnosis: &Diagnosis) -> Markup {
    let table = html! {
        table {
            caption { "Effects tried on top of the structure, best first. Share: what the linear screen explains of \
                       the residual. ΔBIC: change of the information criterion over all events, negative is \
                       better. Before and after: root of the misfit per sample on the gate's events; a perfect model \
                       leaves about " (fixed(misfit_root_floor(), 2)) "." }
            thead { tr {
                th scope="col" { "Effect" }
                th scope="col" { "Kind" }
                @for head in ["Share, %", "Visible, %", "ΔBIC", "Misfit before", "Misfit after", "Of the best gain, %"] {
                    th.number scope="col" { (head) }
                }
                th scope="col" { "Parameters" }
                th scope="col" { "Answer" }
            } }
            tbody { @for candidate in &diagnosis.candidates {
                (rival(candidate, diagnosis.answer_set.contains(&candidate.effect)))
            } }
        }
    };
    scrollable("Rivals", &table)
}

fn rival(candidate: &Candidate, in_answer: bool) -> Markup {
    let optional = |value: Option<f64>, digits| {
        value.map_or(ABSENT.to_owned(), |value| significant(value, digits))
    };
    let kind = match candidate.kind {
        Kind::Physics => "physics",
        Kind::Instrument => "instrument",
    };
    html! { tr.chosen[in_answer] {
        th scope="row" { code { (candidate.effect) } }
        td { (kind) }
        td.number { (fixed(100.0 * candidate.score_share, 0)) }
        td.number { (fixed(100.0 * candidate.visibility, 0)) }
        td.number { (candidate.delta_bic.map_or(ABSENT.to_owned(), |value| fixed(value, 0))) }
        td.number { (optional(candidate.held_out_error_before, 3)) }
        td.number { (optional(candidate.held_out_error_after, 3)) }
        td.number { (candidate.share_of_best_gain.map_or(ABSENT.to_owned(), |s| fixed(100.0 * s, 0))) }
        td.parameters { @for (index, parameter) in candidate.parameters.iter().enumerate() {
            @if index > 0 { br; }
            code { (own_name(&parameter.name)) } " " (significant(parameter.value, 3))
            @if parameter.unit != "1" { " " (parameter.unit) }
            @if let Some(error) = parameter.standard_error { " ± " (significant(error, 2)) }
            @if parameter.at_bound { " " span.flag { "on a bound" } }
        } }
        td.words {
            @if candidate.declared { strong { "declared" } }
            @for (index, reason) in candidate.refused.iter().enumerate() {
                @if index > 0 || candidate.declared { "; " } (reason)
            }
        }
    } }
}

/// The name of a parameter within its effect.
fn own_name(name: &str) -> &str {
    name.rsplit('.').next().unwrap_or(name)
}

/// Effects on which the events are silent.
pub(super) fn untestable(effects: &[Untestable]) -> Markup {
    let table = html! {
        table {
            caption { "Nothing can be said of these effects: what they would leave at a meaningful size is below \
                       what these events show" }
            thead { tr {
                th scope="col" { "Effect" }
                th scope="col" { "Amplitude" }
                th.number scope="col" { "Smallest that shows" }
                th.number scope="col" { "Smallest that matters" }
                th scope="col" { "What would test it" }
            } }
            tbody { @for effect in effects { tr {
                th scope="row" { code { (effect.effect) } }
                td { code { (effect.amplitude) } @if effect.unit != "1" { ", " (effect.unit) } }
                td.number {
                    @if effect.smallest_detectable_amplitude.is_finite() {
                        (significant(effect.smallest_detectable_amplitude, 2))
                    } @else { "none" }
                }
                td.number { (significant(effect.meaningful_amplitude, 2)) }
                td.words { (effect.needs) }
            } } }
        }
    };
    scrollable("Effects that cannot be tested", &table)
}

/// Parameters of a general form.
pub(super) fn of_form(form: &GeneralForm) -> Markup {
    let table = html! {
        table {
            caption { "The form as fitted" }
            thead { tr {
                th scope="col" { "Parameter" }
                th.number scope="col" { "Value" }
                th.number scope="col" { "Standard error" }
                th scope="col" { "Unit" }
            } }
            tbody { @for parameter in &form.parameters { tr {
                th scope="row" { code { (parameter.name) } }
                td.number { (significant(parameter.value, 4)) }
                td.number { (parameter.standard_error.map_or(ABSENT.to_owned(), |error| significant(error, 2))) }
                td { (parameter.unit) }
            } } }
        }
    };
    scrollable("General form", &table)
}

/// Terms of what no effect of the catalogue explains.
pub(super) fn terms(unexplained: &Unexplained) -> Markup {
    let table = html! {
        table {
            caption { "A sparse description, most important term first" }
            thead { tr {
                th scope="col" { "Term" } th scope="col" { "Channel" }
                th.number scope="col" { "Coefficient, % of P₀" }
                th.number scope="col" { "Explains, %" }
            } }
            tbody { @for term in &unexplained.terms { tr {
                th scope="row" { code.formula { (term.formula) } }
                td { (term.channel) }
                td.number { (significant(100.0 * term.coefficient, 3)) }
                td.number { (fixed(100.0 * term.share, 0)) }
            } } }
        }
    };
    scrollable("Terms", &table)
}

/// Why a step was taken; of two steps that one answer led to it is said once.
fn why(steps: &[ImprovementStep], index: usize) -> &str {
    let reason = &steps[index].reason;
    let before = index.checked_sub(1).map(|before| &steps[before].reason);
    if !reason.is_empty() && before == Some(reason) {
        "As the step before: one answer led to both."
    } else {
        reason
    }
}

/// The steps of an improvement.
pub(super) fn steps(improvement: &Improvement) -> Markup {
    let cell = |summary: Option<&ErrorSummary>, of: fn(&ErrorSummary) -> f64| {
        summary.map_or(ABSENT.to_owned(), |summary| significant(of(summary), 3))
    };
    let table = html! {
        table.tight {
            caption { "Structure after structure. Errors over noise and of P and Q in percent, on fitted events, on \
                       those of the gate, and on those that neither the fit nor the gate has seen." }
            thead {
                tr {
                    th.number scope="col" rowspan="2" { "Step" }
                    th scope="col" rowspan="2" { "Change" }
                    th scope="colgroup" colspan="3" { "Error over noise" }
                    th scope="colgroup" colspan="3" { "ε of P, %" }
                    th scope="colgroup" colspan="3" { "ε of Q, %" }
                    th.number scope="col" rowspan="2" { "Parameters" }
                    th.number scope="col" rowspan="2" { "ΔBIC" }
                    th scope="col" rowspan="2" { "Why" }
                }
                tr { @for _ in 0..3 {
                    @for head in ["fit", "gate", "untouched"] { th.number scope="col" { (head) } }
                } }
            }
            tbody { @for (index, step) in improvement.steps.iter().enumerate() { tr {
                th.number scope="row" { (index) }
                td { (step_in_words(step, index == 0)) }
                @for of in [
                    (|s: &ErrorSummary| s.error_to_noise) as fn(&ErrorSummary) -> f64,
                    |s| s.eps_p_percent,
                    |s| s.eps_q_percent,
                ] {
                    td.number { (cell(Some(&step.errors.fit), of)) }
                    td.number { (cell(step.errors.gate.as_ref(), of)) }
                    td.number { (cell(step.errors.untouched.as_ref(), of)) }
                }
                td.number { (step.parameter_count) }
                td.number { (fixed(step.delta_bic, 0)) }
                td.words { (why(&improvement.steps, index)) }
            } } }
        }
    };
    scrollable("Steps", &table)
}
