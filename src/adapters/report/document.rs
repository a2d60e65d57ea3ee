//! The page: head with the verdict in words, then tables, then figures.

use jiff::Timestamp;
use maud::{Markup, html};

use super::{
    event::{self, Power},
    figure::{Ink, ReportError},
    ladder_words::ladder_in_words,
    number::{fixed, short, significant},
    overview, page,
    page::{drawn, legend, percent, tile, to_noise},
    sentence, tables,
};
use crate::identification::{
    Comparison, Cost, DirectionRecord, ErrorSummary, Judgement, ParameterSet, Solution, Verdict,
    VerdictStatus,
};

/// Derived quantities so named are of interest to whoever examines the search.
const COORDINATE_PREFIX: &str = "coordinate_";
const VOLTAGE_BINS: usize = 12;

/// What a report is made of.
#[derive(Clone, Copy, Debug)]
pub struct Report<'a> {
    /// The set under examination.
    pub set: &'a ParameterSet,
    /// Its model against each event, in the order in which they shall appear.
    pub comparisons: &'a [Comparison],
    /// What the set shows on these events.
    pub judgement: &'a Judgement,
    /// The verdict that the set brings along, where it was not made of these events.
    pub published: Option<&'a Verdict>,
    /// Another set to hold against it.
    pub rival: Option<Rival<'a>>,
    /// What the search that led to the set left behind.
    pub search: Option<Search<'a>>,
    /// Events that could not be compared, with the reason.
    pub left_out: &'a [(String, String)],
}

/// Another set on the same events.
#[derive(Clone, Copy, Debug)]
pub struct Rival<'a> {
    /// What to call it in legends.
    pub label: &'a str,
    /// The set.
    pub set: &'a ParameterSet,
    /// Its model against the events; matched by event name.
    pub comparisons: &'a [Comparison],
}

/// What a global search left behind.
#[derive(Clone, Copy, Debug)]
pub struct Search<'a> {
    /// Every local solution, best first.
    pub solutions: &'a [Solution],
    /// Every direction and its outcome.
    pub directions: &'a [DirectionRecord],
    /// What it cost.
    pub cost: Cost,
}

impl<'a> Rival<'a> {
    pub(super) fn of_event(&self, event: &str) -> Option<&'a Comparison> {
        self.comparisons.iter().find(|c| c.event == event)
    }
}

/// The report as one HTML document. The same input gives the same bytes.
///
/// # Errors
///
/// [`ReportError::Drawing`] when a figure cannot be drawn.
pub fn render(report: &Report<'_>) -> Result<String, ReportError> {
    let set = report.set;
    let body = html! {
        (head(report))
        section {
            h2 { "Errors" }
            (tables::errors(report.comparisons, report.judgement, report.rival.as_ref()))
            @if !report.left_out.is_empty() {
                p { "Left out:" }
                ul { @for (event, reason) in report.left_out { li { strong { (event) } ": " (reason) } } }
            }
        }
        (parameters(report))
        (overview(report)?)
        (events(report)?)
        @if let Some(search) = &report.search { (search_section(search)) }
    };
    let title = format!(
        "Load model of {}: model against measurement",
        report.judgement.site
    );
    Ok(page::page(&title, &body, &set.software_version))
}

fn head(report: &Report<'_>) -> Markup {
    let (set, judgement) = (report.set, report.judgement);
    html! {
        header {
            p.kicker { "Model against measurement" }
            h1 { (judgement.site) }
            p { "Structure: " strong { (set.structure.join(" + ")) } ". "
                @if set.version > 0 { "Parameter set version " (set.version) ". " }
                (set.fitted_events.len()) " events fitted, " (set.held_out_events.len()) " held out." }
            @for warning in &judgement.warnings {
                p { strong { "Warning: " (warning) "." } }
            }
            (verdict(&judgement.verdict))
            @if let Some(published) = report.published { (as_published(published)) }
            dl.tiles { @for (role, summary) in roles(judgement) {
                (tile(&format!("ε of P, {role}"), &percent(summary, |s| s.eps_p_percent)))
                (tile(&format!("ε of Q, {role}"), &percent(summary, |s| s.eps_q_percent)))
                (tile(&format!("Residual over noise, {role}"), &to_noise(summary)))
            } }
            p.bases {
                "Bases " (short(set.bases.s_base_mva)) " MVA, " (short(set.bases.v_base_kv))
                " kV, " (short(set.bases.nominal_hz)) " Hz. Operating point V₀ "
                (fixed(set.operating_point.v0_pu, 4)) ", P₀ " (fixed(set.operating_point.p0_pu, 4)) ", Q₀ "
                (fixed(set.operating_point.q0_pu, 4)) " pu. Sensitivity rank " (set.rank) ", condition "
                (significant(set.condition, 3)) "."
                @if let Some(rival) = &report.rival {
                    " Held against: " strong { (rival.label) } " (" (rival.set.structure.join(" + ")) ")."
                }
            }
            @for note in &set.notes {
                p.bases { "Note: " (note) "." }
            }
        }
    }
}

/// What these events show, by the part that they played for the set; others only where there are some.
fn roles(judgement: &Judgement) -> Vec<(&'static str, Option<&ErrorSummary>)> {
    let mut roles = vec![
        ("fitted", judgement.fitted.as_ref()),
        ("held out", judgement.held_out.as_ref()),
    ];
    if judgement.others.is_some() {
        roles.push(("other events", judgement.others.as_ref()));
    }
    roles
}

fn as_published(verdict: &Verdict) -> Markup {
    let words = match verdict.status {
        VerdictStatus::Pass => "pass",
        VerdictStatus::Fail => "fail",
        VerdictStatus::CannotJudge => "cannot judge",
    };
    html! { p.bases { "As published: " (words) "." } ul.bases {
        @for reason in &verdict.reasons { li { (reason) } }
    } }
}

fn verdict(verdict: &Verdict) -> Markup {
    let (class, sign, words) = match verdict.status {
        VerdictStatus::Pass => (
            "pass",
            "✓",
            "Proven: the model follows events it was not fitted on.",
        ),
        VerdictStatus::Fail => (
            "fail",
            "✗",
            "Not proven: the model does not follow the held-out events well enough.",
        ),
        VerdictStatus::CannotJudge => (
            "open",
            "?",
            "Not judged: these events cannot prove the model.",
        ),
    };
    html! {
        div.verdict.(class) {
            p { span aria-hidden="true" { (sign) " " } strong { (words) } }
            @if !verdict.reasons.is_empty() {
                ul { @for reason in &verdict.reasons { li { (reason) } } }
            }
            @if !verdict.channels.is_empty() {
                details { summary { "Errors against the limits" } (tables::verdict_channels(verdict)) }
            }
        }
    }
}

fn parameters(report: &Report<'_>) -> Markup {
    let (set, rival) = (report.set, report.rival.as_ref());
    let beside = rival.map(|rival| (rival.label, rival.set.parameters.as_slice()));
    let derived_beside = rival.map(|rival| (rival.label, rival.set.derived.as_slice()));
    let all: Vec<_> = set.parameters.iter().collect();
    let (coordinates, engineering): (Vec<_>, Vec<_>) = set
        .derived
        .iter()
        .partition(|estimate| estimate.name.starts_with(COORDINATE_PREFIX));
    html! {
        section {
            h2 { "Parameters" }
            (tables::parameters("Parameters of the model", &all, beside))
            @if !engineering.is_empty() {
                (tables::parameters("In a study engineer's units", &engineering, derived_beside))
            }
            @if !coordinates.is_empty() {
                details {
                    summary { "What the data determine" }
                    (tables::parameters("Coordinates of the search", &coordinates, derived_beside))
                }
            }
        }
    }
}

fn overview(report: &Report<'_>) -> Result<Markup, ReportError> {
    let comparisons: Vec<_> = report.comparisons.iter().collect();
    let ladder = overview::severity_ladder(report.judgement, report.comparisons);
    let rungs: Vec<_> = (report.comparisons.iter())
        .map(|c| &c.errors)
        .map(|e| {
            (
                e.event.as_str(),
                e.lowest_voltage,
                e.error_to_noise_away_from_edges,
            )
        })
        .collect();
    let scatter = overview::residual_against_voltage("against-voltage", &comparisons);
    let bins = overview::voltage_bins(&comparisons, VOLTAGE_BINS);
    Ok(html! {
        section {
            h2 { "All events" }
            div.pair {
                figure {
                    figcaption {
                        h3 { "Severity ladder" }
                        p { (ladder_in_words(&rungs)) " Filled: away from voltage edges; ring: all samples." }
                        ul.legend {
                            (legend("dot", Ink::Measured, "fitted"))
                            (legend("triangle", Ink::Model, "held out"))
                            (legend("line", Ink::Onset, "noise alone"))
                        }
                    }
                    (drawn(&ladder)?)
                    p.note { "The numbers are in the table of errors above." }
                }
                figure {
                    figcaption {
                        h3 { "Residual against voltage" }
                        p { "Measured minus modelled, away from voltage edges. A bend or a step along the voltage \
                             names a threshold." }
                        ul.legend { (legend("dot", Ink::Model, "residual")) }
                    }
                    (drawn(&scatter)?)
                    details { summary { "Data" } (tables::voltage_bins(&bins)) }
                }
            }
        }
    })
}

fn events(report: &Report<'_>) -> Result<Markup, ReportError> {
    let mut sections = Vec::with_capacity(report.comparisons.len());
    for (index, comparison) in report.comparisons.iter().enumerate() {
        sections.push(event_section(report, index + 1, comparison)?);
    }
    Ok(html! { @for section in &sections { (section) } })
}

fn event_section(
    report: &Report<'_>,
    number: usize,
    comparison: &Comparison,
) -> Result<Markup, ReportError> {
    let id = format!("e{number}");
    let rival = report.rival.as_ref();
    let figures = event::figures(
        &id,
        comparison,
        rival.and_then(|r| r.of_event(&comparison.event)),
    );
    let mut plots = Vec::with_capacity(figures.len());
    for figure in &figures {
        plots.push(drawn(figure)?);
    }
    let against_voltage =
        overview::residual_against_voltage(&format!("{id}-voltage"), &[comparison]);
    Ok(html! {
        section.event id=(id) {
            h2 { "Event " (comparison.event) }
            p { (role_in_words(report.judgement.role(&comparison.event))) " Onset " (utc(comparison.onset_ns))
                ", lowest voltage " (fixed(comparison.errors.lowest_voltage, 3)) " of the voltage before." }
            ul { @for power in Power::BOTH { li { (sentence::sentence(power, comparison)) } } }
            figure {
                figcaption { ul.legend {
                    (legend("line", Ink::Measured, "measured"))
                    (legend("line", Ink::Model, "model, and its residual (measured minus model)"))
                    @if let Some(rival) = rival { (legend("line", Ink::Rival, rival.label)) }
                    (legend("area", Ink::Noise, "noise, ±2 σ"))
                    (legend("area", Ink::Edge, "near a voltage edge"))
                    (legend("line", Ink::Onset, "onset"))
                    (legend("cross", Ink::Unused, "not used"))
                } }
                div.pair { @for plot in &plots { (plot) } }
                details { summary { "Data" } (tables::samples(comparison)) }
                details { summary { "Residual against voltage" } (drawn(&against_voltage)?) }
            }
        }
    })
}

fn role_in_words(role: &str) -> &'static str {
    match role {
        "fitted" => "The model was fitted on this event.",
        "held out" => "This event was held out: the model has not seen it.",
        _ => "This event was neither fitted nor held out.",
    }
}

fn utc(time_ns: i64) -> String {
    Timestamp::from_nanosecond(i128::from(time_ns)).map_or_else(
        |_| format!("{time_ns} ns after 1970"),
        |time| time.strftime("%Y-%m-%d %H:%M:%S%.3f UTC").to_string(),
    )
}

fn search_section(search: &Search<'_>) -> Markup {
    html! {
        section {
            h2 { "Search" }
            p { (search.solutions.len()) " solutions, " (search.directions.len()) " directions; "
                (search.cost.simulations) " simulations and " (search.cost.sensitivity_simulations)
                " with sensitivities"
                @if search.cost.seconds > 0.0 { " in " (significant(search.cost.seconds, 3)) " s" } "." }
            details { summary { "Solutions and directions" } (tables::search(search)) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{super::fixture, *};

    fn comparisons() -> Vec<Comparison> {
        vec![
            fixture::comparison("event_01", 0.9),
            fixture::comparison("<img src=x onerror=alert(1)>", 0.7),
            fixture::comparison("event_03", 0.5),
        ]
    }

    fn page() -> String {
        render(&Report {
            set: &fixture::parameter_set(),
            comparisons: &comparisons(),
            judgement: &fixture::judgement(),
            published: None,
            rival: None,
            search: None,
            left_out: &[],
        })
        .unwrap()
    }

    #[test]
    fn the_page_names_no_other_host_and_runs_no_script() {
        let page = page();
        for forbidden in ["http://", "https://", "<script", "url(", "@import", " src="] {
            let at = page.find(forbidden);
            let near = at.map(|at| &page[at..page.len().min(at + 80)]);
            assert!(
                near.is_none_or(|text| text.starts_with(" src=x onerror=alert(1)&gt;")),
                "{forbidden}: {near:?}"
            );
        }
    }

    #[test]
    fn whatever_comes_from_data_is_escaped() {
        let page = page();
        assert!(!page.contains("<img"));
        assert!(page.contains("site-&lt;02&gt;") && page.contains("&lt;img src=x"));
    }

    #[test]
    fn every_event_has_its_figures_with_title_and_description() {
        let page = page();
        for id in ["e1", "e2", "e3"] {
            for part in ["whole", "close", "voltage"] {
                assert!(
                    page.contains(&format!("id=\"{id}-{part}-title\"")),
                    "{id}-{part}"
                );
                assert!(
                    page.contains(&format!("id=\"{id}-{part}-desc\"")),
                    "{id}-{part}"
                );
            }
        }
        assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
        assert_eq!(page.matches("<svg").count(), 2 + 3 * 3);
    }

    #[test]
    fn identifiers_in_the_page_are_unique() {
        let page = page();
        let mut ids: Vec<_> = page
            .split(" id=\"")
            .skip(1)
            .filter_map(|rest| rest.split('"').next())
            .collect();
        ids.sort_unstable();
        let count = ids.len();
        ids.dedup();
        assert_eq!(ids.len(), count);
    }

    #[test]
    fn roles_verdict_and_flags_are_said_in_words() {
        let page = page();
        assert!(page.contains("Proven: the model follows events it was not fitted on."));
        assert!(page.contains("not determined by these data") && page.contains("on a bound"));
        assert!(page.contains("This event was held out: the model has not seen it."));
        assert!(page.contains("2026-04-10 05:11:01.500 UTC"));
    }

    #[test]
    fn what_is_shown_here_is_told_from_what_was_published() {
        let set = fixture::parameter_set();
        let judgement = Judgement {
            site: "site-09".to_owned(),
            fitted: None,
            held_out: None,
            others: Some(ErrorSummary {
                error_to_noise: 8.25,
                ..ErrorSummary::default()
            }),
            verdict: Verdict {
                status: VerdictStatus::Fail,
                reasons: vec!["far off".to_owned()],
                channels: Vec::new(),
            },
            warnings: vec!["the set is one of another site".to_owned()],
        };
        let page = render(&Report {
            set: &set,
            comparisons: &comparisons(),
            judgement: &judgement,
            published: Some(&set.verdict),
            rival: None,
            search: None,
            left_out: &[],
        })
        .unwrap();
        assert!(page.contains("Not proven") && !page.contains("Proven: the model"));
        assert!(page.contains("As published: pass.") && page.contains("held-out error 1.04"));
        assert!(page.contains("Warning: the set is one of another site."));
        assert!(page.contains("All other events") && page.contains("8.25"));
        assert!(page.contains("<h1>site-09</h1>"));
    }

    #[test]
    fn a_rival_appears_in_every_table_and_every_event_it_knows() {
        let set = fixture::parameter_set();
        let comparisons = comparisons();
        let page = render(&Report {
            set: &set,
            comparisons: &comparisons,
            judgement: &fixture::judgement(),
            published: None,
            rival: Some(Rival {
                label: "before",
                set: &set,
                comparisons: &comparisons[..1],
            }),
            search: None,
            left_out: &[],
        })
        .unwrap();
        assert!(page.contains("before: residual over noise"));
        assert_eq!(page.matches("stroke=\"var(--rival)\"").count(), 2 * 4);
    }

    #[test]
    fn the_same_input_gives_the_same_bytes() {
        assert_eq!(page(), page());
    }
}
