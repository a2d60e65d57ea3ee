//! What all pages share: head, navigation, the line that says how a site stands.

use axum::http::Uri;
use maud::{DOCTYPE, Markup, html};
use serde::Serialize;

use super::{
    assets,
    desk::Desk,
    plot,
    problem::Problem,
    view::{Form, Page},
    words,
};
use crate::{
    adapters::{report::number, store::StoredSet},
    identification::{ParameterSet, VerdictStatus},
    measurement::Site,
};

/// The pages of a site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tab {
    Events,
    Diagnosis,
    Structure,
    Solutions,
    Sets,
}

impl Tab {
    const ALL: [(Self, &'static str, &'static str); 5] = [
        (Self::Events, "events", "Events"),
        (Self::Diagnosis, "diagnosis", "Diagnosis"),
        (Self::Structure, "structure", "Model structure"),
        (Self::Solutions, "solutions", "Solutions"),
        (Self::Sets, "sets", "Parameter sets"),
    ];
}

/// How a site stands.
#[derive(Clone, Debug)]
pub(super) struct SiteHead {
    pub(super) site: Site,
    pub(super) in_force: Option<(StoredSet, ParameterSet)>,
    /// What is being computed for it.
    pub(super) work: Vec<Progress>,
}

/// A job under way, for reading.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Progress {
    /// What it is at.
    pub(super) text: String,
    /// Share of its present round that is done, where that is known.
    pub(super) share: Option<f64>,
}

impl Progress {
    /// The jobs of a site, or all.
    pub(super) fn of(desk: &Desk, site: Option<&str>) -> Vec<Self> {
        let health = &desk.context.health;
        let now_ns = health.now_ns();
        let jobs = health.work().ongoing(site);
        let progress = jobs.iter().map(|job| Self {
            text: words::ongoing(job, now_ns),
            share: job
                .stage
                .as_ref()
                .filter(|stage| stage.of > 1)
                .map(|stage| stage.done as f64 / stage.of as f64),
        });
        progress.collect()
    }
}

impl SiteHead {
    pub(super) fn load(desk: &Desk, name: &str) -> Result<Self, Problem> {
        let site = desk.site(name)?;
        let in_force = match desk.store().set_in_force(name)? {
            Some(stored) => {
                let set = stored
                    .set()
                    .map_err(|e| Problem::unreadable("the set in force", &e))?;
                Some((stored, set))
            }
            None => None,
        };
        Ok(Self {
            work: Progress::of(desk, Some(name)),
            site,
            in_force,
        })
    }

    /// Address of one of the site's pages.
    pub(super) fn address(&self, rest: &str) -> String {
        site_address(&self.site.name, rest)
    }
}

/// Address below a site, with its name made fit for a path.
pub(super) fn site_address(site: &str, rest: &str) -> String {
    let name = segment(site);
    if rest.is_empty() {
        format!("/sites/{name}")
    } else {
        format!("/sites/{name}/{rest}")
    }
}

/// A text as one segment of a path: every byte but unreserved ones (RFC 3986) as `%XX`.
pub(super) fn segment(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for byte in text.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            out.push(char::from(byte));
        } else {
            out.push('%');
            for half in [byte >> 4, byte & 15] {
                out.extend(char::from_digit(u32::from(half), 16).map(|c| c.to_ascii_uppercase()));
            }
        }
    }
    out
}

/// A whole page.
pub(super) fn page<P: Page>(page: &P, uri: &Uri) -> Markup {
    let (path, _) = Form::of(uri.path());
    let query = uri
        .query()
        .map_or_else(String::new, |query| format!("?{query}"));
    let path = if path == "/" { "/sites" } else { path };
    let twins = html! {
        "This page as "
        a href={ (path) ".json" (query) } { "JSON" } " or "
        a href={ (path) ".csv" (query) } { "CSV" } ". "
    };
    let numbers = format!("{path}.charts.json{query}");
    let body = html! {
        @if let Some((head, tab)) = page.place() { (site_head(head, tab)) }
        (page.body(&numbers))
    };
    let links = Links {
        live: page.live(),
        numbers: plot::has_figure(&body).then_some(numbers),
    };
    document(&page.title(), &links, &body, &twins)
}

/// What the scripts of a page will ask for.
#[derive(Debug, Default)]
struct Links {
    /// Live updates.
    live: Option<String>,
    /// The numbers of its charts.
    numbers: Option<String>,
}

/// A page without twins: an error.
pub(super) fn plain(title: &str, body: &Markup) -> Markup {
    document(title, &Links::default(), body, &html! {})
}

fn document(title: &str, links: &Links, body: &Markup, twins: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (title) " · loadmodeld" }
                link rel="icon" href=(assets::address("icon.svg")) type="image/svg+xml";
                link rel="stylesheet" href=(assets::address("app.css"));
                script src=(assets::address("theme.js")) {}
                script type="module" src=(assets::address("app.js")) {}
                // Asked for at once and not one after the other, each when the one before it has been read.
                @for module in ["chart.js", "draw.js"] { link rel="modulepreload" href=(assets::address(module)); }
                @if let Some(numbers) = &links.numbers { link rel="preload" as="fetch" crossorigin="anonymous" href=(numbers); }
            }
            body data-live=[&links.live] {
                a.skip href="#content" { "Skip to the content" }
                header.top {
                    a.brand href="/" { "loadmodeld" }
                    nav aria-label="Main" {
                        a href="/sites" { "Sites" }
                        a href="/streams" { "Streams" }
                        a href="/health" { "Health" }
                    }
                    span.spring {}
                    span #live .live role="status" hidden { "live" }
                    button #theme type="button" hidden { "Dark / light" }
                }
                main #content { (body) }
                footer { (twins) "loadmodeld " (env!("CARGO_PKG_VERSION")) }
            }
        }
    }
}

fn site_head(head: &SiteHead, tab: Tab) -> Markup {
    let site = &head.site;
    html! {
        div.site {
            nav.crumbs aria-label="You are here" { a href="/sites" { "Sites" } " / " strong { (site.name) } }
            p.facts {
                (number::short(site.s_base_mva)) " MVA · " (number::short(site.v_base_kv)) " kV · "
                (number::short(site.nominal_hz)) " Hz"
            }
            (in_force(head))
            (under_way(&head.work))
            nav.tabs aria-label="Pages of this site" {
                @for (which, path, name) in Tab::ALL {
                    a href=(head.address(path)) aria-current=[(which == tab).then_some("page")] { (name) }
                }
            }
        }
    }
}

/// What is being computed; scripts keep it up to date.
pub(super) fn under_way(jobs: &[Progress]) -> Markup {
    html! {
        div #work .work {
            @for job in jobs { p { progress aria-label="Under way" value=[job.share] {} " " (job.text) } }
        }
    }
}

fn in_force(head: &SiteHead) -> Markup {
    html! {
        p.standing {
            @if let Some((stored, set)) = &head.in_force {
                "In force: "
                a href=(head.address(&format!("sets/{}", stored.version))) { "version " (stored.version) }
                " " (verdict(set.verdict.status)) " "
                span.structure { (words::structure(&set.structure)) }
                @let quoted = set.held_out.as_ref().unwrap_or(&set.fit);
                @let which = if set.held_out.is_some() { "held-out" } else { "fitted" };
                span.measure {
                    "error on " (which) " events: P " strong { (number::significant(quoted.eps_p_percent, 3)) " %" }
                    ", Q " strong { (number::significant(quoted.eps_q_percent, 3)) " %" }
                    ", " strong { (number::significant(quoted.error_to_noise, 3)) " × noise" }
                }
            } @else {
                "No parameter set is in force yet: a site needs enough usable events, and a fit that passes on events it has not seen."
            }
        }
    }
}

/// A verdict as a chip.
pub(super) fn verdict(status: VerdictStatus) -> Markup {
    let (class, word) = match status {
        VerdictStatus::Pass => ("good", "validated"),
        VerdictStatus::Fail => ("bad", "failed validation"),
        VerdictStatus::CannotJudge => ("open", "not validated"),
    };
    html! { span class={ "chip " (class) } { (word) } }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_cannot_leave_its_segment_of_a_path() {
        assert_eq!(site_address("a/b?c", "events"), "/sites/a%2Fb%3Fc/events");
        assert_eq!(segment("site-02_x.y~"), "site-02_x.y~");
        assert_eq!(segment("ü"), "%C3%BC");
    }
}
