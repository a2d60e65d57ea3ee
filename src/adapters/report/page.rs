//! What all reports share: the shell of the page and its smallest parts.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::{
    figure::{Figure, Ink, ReportError},
    number::significant,
};
use crate::identification::ErrorSummary;

const STYLE: &str = include_str!("report.css");
/// Nothing may be loaded from anywhere; the page needs its own style only.
const CONTENT_SECURITY_POLICY: &str =
    "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";

/// A whole page.
pub(super) fn page(title: &str, body: &Markup, software_version: &str) -> String {
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                meta http-equiv="Content-Security-Policy" content=(CONTENT_SECURITY_POLICY);
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { main {
                (body)
                footer { p { "Made by loadmodeld " (software_version) ". Load convention, positive sequence, \
                              per unit; errors as defined in the manual." } }
            } }
        }
    };
    page.into_string()
}

/// A figure in a frame that scrolls sideways on a narrow screen.
pub(super) fn drawn(figure: &Figure) -> Result<Markup, ReportError> {
    let svg = figure.markup()?;
    Ok(html! { div.scroll.plot tabindex="0" role="region" aria-label=(figure.title) { (svg) } })
}

/// A line of a legend.
pub(super) fn legend(kind: &str, ink: Ink, text: &str) -> Markup {
    html! { li { span class={ "key " (kind) } style={ "--key: " (ink.variable()) } aria-hidden="true" {} (text) } }
}

/// A number with its name above it.
pub(super) fn tile(term: &str, value: &Markup) -> Markup {
    html! { div { dt { (term) } dd { (value) } } }
}

pub(super) fn percent(summary: Option<&ErrorSummary>, of: impl Fn(&ErrorSummary) -> f64) -> Markup {
    html! { @match summary {
        Some(summary) => { (significant(of(summary), 3)) " %" }
        None => { "none" }
    } }
}

pub(super) fn to_noise(summary: Option<&ErrorSummary>) -> Markup {
    html! { @match summary {
        Some(summary) => {
            (significant(summary.error_to_noise, 3))
            small { " off edges " (significant(summary.error_to_noise_away_from_edges, 3)) }
        }
        None => { "none" }
    } }
}
