//! The tables of the report. Every cell that comes from data goes through maud's escaping.

use maud::{Markup, html};

use super::{
    decimate,
    document::{Rival, Search},
    event::Power,
    number::{ABSENT, fixed, short, significant},
    overview::VoltageBin,
};
use crate::identification::{
    Comparison, DirectionOutcome, ErrorSummary, EventErrors, Judgement, ParameterEstimate, Verdict,
};

/// Rows of the table behind an event's figure.
const SAMPLE_ROWS_MAX: usize = 140;

/// A table that scrolls sideways by itself on a narrow screen.
pub(super) fn scrollable(label: &str, table: &Markup) -> Markup {
    html! { div.scroll tabindex="0" role="region" aria-label=(label) { (table) } }
}

/// Parameters with standard errors, bounds and flags; beside them the rival's values.
pub(super) fn parameters(
    caption: &str,
    estimates: &[&ParameterEstimate],
    rival: Option<(&str, &[ParameterEstimate])>,
) -> Markup {
    let table = html! {
        table {
            caption { (caption) }
            thead { tr {
                th scope="col" { "Parameter" }
                th scope="col" { "Meaning" }
                th.number scope="col" { "Value" }
                th.number scope="col" { "Standard error" }
                th scope="col" { "Unit" }
                th.number scope="col" { "Bounds" }
                th.number scope="col" { "Describes the data as well" }
                th scope="col" { "Remarks" }
                @if let Some((label, _)) = rival { th.number scope="col" { (label) } }
            } }
            tbody { @for estimate in estimates { tr {
                th scope="row" { code { (estimate.name) } }
                td { (estimate.meaning) }
                td.number { strong { (significant(estimate.value, 4)) } }
                td.number { (estimate.standard_error.map_or(ABSENT.to_owned(), |e| significant(e, 2))) }
                td { (unit(&estimate.unit)) }
                td.number { (range(estimate.lower, estimate.upper)) }
                td.number { (interval(estimate.interval)) }
                td { (remarks(estimate)) }
                @if let Some((_, others)) = rival {
                    td.number { (value_of(others, &estimate.name)) }
                }
            } } }
        }
    };
    scrollable(caption, &table)
}

fn value_of(estimates: &[ParameterEstimate], name: &str) -> String {
    estimates
        .iter()
        .find(|estimate| estimate.name == name)
        .map_or(ABSENT.to_owned(), |estimate| significant(estimate.value, 4))
}

fn unit(unit: &str) -> &str {
    if unit == "1" { ABSENT } else { unit }
}

fn range(lower: f64, upper: f64) -> String {
    if lower.is_finite() || upper.is_finite() {
        format!("{} … {}", short(lower), short(upper))
    } else {
        ABSENT.to_owned()
    }
}

fn interval(interval: Option<(f64, f64)>) -> String {
    interval.map_or(ABSENT.to_owned(), |(from, to)| {
        format!("{} … {}", significant(from, 3), significant(to, 3))
    })
}

fn remarks(estimate: &ParameterEstimate) -> Markup {
    html! {
        @if estimate.at_bound { span.flag { "on a bound" } }
        @if !estimate.identifiable { span.flag { "not determined by these data" } }
    }
}

/// Errors event by event, then together by the part that the events played for the set.
pub(super) fn errors(
    comparisons: &[Comparison],
    judgement: &Judgement,
    rival: Option<&Rival<'_>>,
) -> Markup {
    let summaries = [
        ("All fitted events", &judgement.fitted),
        ("All held-out events", &judgement.held_out),
        ("All other events", &judgement.others),
    ];
    let table = html! {
        table {
            caption { "Errors of every event. Skill above 0: better than the best static ZIP, or than a \
                       constant, over the event part; 1: perfect. Residual over noise near 1: nothing left \
                       to explain." }
            thead {
                tr {
                    th scope="col" rowspan="2" { "Event" }
                    th scope="col" rowspan="2" { "Role" }
                    th.number scope="col" rowspan="2" { "Lowest V" }
                    th scope="colgroup" colspan="2" { "ε of P, %" }
                    th scope="colgroup" colspan="2" { "ε of Q, %" }
                    th.number scope="col" rowspan="2" { "Q error, % of S₀" }
                    th scope="colgroup" colspan="2" { "Skill over ZIP" }
                    th scope="colgroup" colspan="2" { "Skill over constant" }
                    th scope="colgroup" colspan="2" { "Residual over noise" }
                    @if let Some(rival) = rival {
                        th scope="colgroup" colspan="2" { (rival.label) ": residual over noise" }
                    }
                }
                tr {
                    @for head in ["window", "event", "window", "event", "P", "Q", "P", "Q", "all", "off edges"] {
                        th.number scope="col" { (head) }
                    }
                    @if rival.is_some() {
                        th.number scope="col" { "all" } th.number scope="col" { "off edges" }
                    }
                }
            }
            tbody {
                @for (index, comparison) in comparisons.iter().enumerate() { tr {
                    th scope="row" { a href={ "#e" (index + 1) } { (comparison.event) } }
                    td { (judgement.role(&comparison.event)) }
                    (error_cells(&comparison.errors))
                    @if let Some(rival) = rival {
                        (rival_cells(rival.of_event(&comparison.event).map(|c| &c.errors)))
                    }
                } }
            }
            tfoot {
                @for (label, summary) in summaries {
                    @if let Some(summary) = summary { (summary_row(label, summary, rival.is_some())) }
                }
            }
        }
    };
    scrollable("Errors of every event", &table)
}

fn error_cells(errors: &EventErrors) -> Markup {
    html! {
        td.number { (fixed(errors.lowest_voltage, 3)) }
        td.number { (significant(errors.eps_p_percent, 3)) }
        td.number { (significant(errors.event_eps_p_percent, 3)) }
        td.number { (significant(errors.eps_q_percent, 3)) }
        td.number { (significant(errors.event_eps_q_percent, 3)) }
        td.number { (significant(errors.event_q_to_s0_percent, 3)) }
        @for skill in [errors.skill_p, errors.skill_q, errors.skill_over_constant_p, errors.skill_over_constant_q] {
            td.number.bad[skill < 0.0] { (fixed(skill, 3)) }
        }
        td.number { (significant(errors.error_to_noise, 3)) }
        td.number { (significant(errors.error_to_noise_away_from_edges, 3)) }
    }
}

fn rival_cells(errors: Option<&EventErrors>) -> Markup {
    let cell = |value: Option<f64>| value.map_or(ABSENT.to_owned(), |v| significant(v, 3));
    html! {
        td.number { (cell(errors.map(|e| e.error_to_noise))) }
        td.number { (cell(errors.map(|e| e.error_to_noise_away_from_edges))) }
    }
}

fn summary_row(label: &str, summary: &ErrorSummary, with_rival: bool) -> Markup {
    html! { tr {
        th scope="row" colspan="3" { (label) }
        td.number { (significant(summary.eps_p_percent, 3)) }
        td {}
        td.number { (significant(summary.eps_q_percent, 3)) }
        td colspan="6" {}
        td.number { (significant(summary.error_to_noise, 3)) }
        td.number { (significant(summary.error_to_noise_away_from_edges, 3)) }
        @if with_rival { td colspan="2" {} }
    } }
}

/// Validation's numbers: largest, mean and mean absolute error by segment.
pub(super) fn verdict_channels(verdict: &Verdict) -> Markup {
    let table = html! {
        table {
            caption { "Held-out errors by segment, pu of P before the event" }
            thead { tr {
                @for head in ["Event", "Channel", "Segment"] { th scope="col" { (head) } }
                @for head in ["Largest", "Mean", "Mean absolute"] { th.number scope="col" { (head) } }
                th scope="col" { "Within limits" }
            } }
            tbody { @for channel in &verdict.channels { tr {
                th scope="row" { (channel.event) }
                td { (channel.channel) }
                td { (channel.segment) }
                td.number { (significant(channel.mxe_pu, 3)) }
                td.number { (significant(channel.me_pu, 3)) }
                td.number { (significant(channel.mae_pu, 3)) }
                td.bad[!channel.within_limits] { @if channel.within_limits { "yes" } @else { "no" } }
            } } }
        }
    };
    scrollable("Held-out errors by segment", &table)
}

/// The samples behind an event's figure, thinned.
pub(super) fn samples(comparison: &Comparison) -> Markup {
    let busy: Vec<_> = (0..comparison.time_s.len())
        .map(|k| comparison.near_edge[k] || (0.0..1.0).contains(&comparison.time_s[k]))
        .collect();
    let kept = decimate::rows(&busy, SAMPLE_ROWS_MAX);
    let residuals = Power::BOTH.map(|power| power.residual(comparison));
    let caption = format!(
        "{} of {} samples, denser within the first second",
        kept.len(),
        comparison.time_s.len()
    );
    let table = html! {
        table.samples {
            caption { (caption) }
            thead { tr {
                @for head in [
                    "Time, s", "V, pu", "f, Hz", "P measured, pu", "P model", "P residual", "P noise σ",
                    "Q measured, pu", "Q model", "Q residual", "Q noise σ",
                ] { th.number scope="col" { (head) } }
                th scope="col" { "Remarks" }
            } }
            tbody { @for k in kept { tr {
                th.number scope="row" { (fixed(comparison.time_s[k], 3)) }
                td.number { (fixed(comparison.voltage_pu[k], 4)) }
                td.number { (fixed(comparison.frequency_hz[k], 3)) }
                @for (power, residual) in Power::BOTH.into_iter().zip(&residuals) {
                    td.number { (fixed(power.measured(comparison)[k], 4)) }
                    td.number { (fixed(power.model(comparison)[k], 4)) }
                    td.number { (fixed(residual[k], 5)) }
                    td.number { (fixed(power.noise(comparison)[k], 5)) }
                }
                td {
                    @if comparison.near_edge[k] { span.flag { "edge" } }
                    @if !comparison.used[k] { span.flag { "not used" } }
                }
            } } }
        }
    };
    scrollable(&caption, &table)
}

/// Means of the residuals by voltage.
pub(super) fn voltage_bins(bins: &[VoltageBin]) -> Markup {
    let table = html! {
        table {
            caption { "Residuals by voltage, event parts, away from edges" }
            thead { tr {
                @for head in ["V, pu", "Samples", "P mean, pu", "P rms, pu", "Q mean, pu", "Q rms, pu"] {
                    th.number scope="col" { (head) }
                }
            } }
            tbody { @for bin in bins { tr {
                th.number scope="row" { (fixed(bin.from_pu, 3)) " … " (fixed(bin.to_pu, 3)) }
                td.number { (bin.samples) }
                @for channel in 0..2 {
                    td.number { (fixed(bin.mean_pu[channel], 5)) }
                    td.number { (fixed(bin.rms_pu[channel], 5)) }
                }
            } } }
        }
    };
    scrollable("Residuals by voltage", &table)
}

/// Every solution of the search and every direction's outcome.
pub(super) fn search(search: &Search<'_>) -> Markup {
    let names: Vec<_> = search
        .solutions
        .first()
        .map(|best| {
            best.parameters
                .iter()
                .map(|(name, _)| name.as_str())
                .collect()
        })
        .unwrap_or_default();
    let solutions = html! {
        table {
            caption { "Solutions, best first" }
            thead { tr {
                th.number scope="col" { "No." }
                th.number scope="col" { "Tier" }
                th scope="col" { "Found from" }
                th.number scope="col" { "Objective" }
                @for name in &names { th.number scope="col" { code { (name) } } }
            } }
            tbody { @for solution in search.solutions { tr {
                th.number scope="row" { (solution.id) }
                td.number { (solution.tier) }
                td { @if let Some(from) = solution.found_from { "no. " (from) }
                     @if let Some(direction) = solution.direction { ", direction " (direction) } }
                td.number { (significant(solution.objective, 5)) }
                @for (name, value) in &solution.parameters {
                    td.number.bound[solution.at_bound.contains(name)] { (significant(*value, 3)) }
                }
            } } }
        }
    };
    let directions = html! {
        table {
            caption { "Directions searched" }
            thead { tr {
                @for head in ["From", "Direction", "Kind", "Exit point at", "Outcome"] { th scope="col" { (head) } }
            } }
            tbody { @for record in search.directions { tr {
                th scope="row" { "no. " (record.from) }
                td { (record.direction) }
                td { (record.label) }
                td.number { (record.exit_distance.map_or(ABSENT.to_owned(), |d| significant(d, 3))) }
                td { (outcome(record.outcome)) }
            } } }
        }
    };
    html! { (scrollable("Solutions", &solutions)) (scrollable("Directions", &directions)) }
}

fn outcome(outcome: DirectionOutcome) -> String {
    match outcome {
        DirectionOutcome::NewSolution(id) => format!("new solution no. {id}"),
        DirectionOutcome::KnownSolution(id) => format!("known solution no. {id}"),
        DirectionOutcome::NoExitPoint {
            at_distance,
            diverged,
        } => {
            let why = if diverged {
                "the objective became infinite"
            } else {
                "the objective kept rising"
            };
            format!("no exit point: {why} at {}", significant(at_distance, 3))
        }
        DirectionOutcome::LocalSolverInfeasible => {
            "the local solver left the feasible set".to_owned()
        }
    }
}
