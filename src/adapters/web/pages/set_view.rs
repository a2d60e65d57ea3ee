//! One version of a parameter set.

use maud::{Markup, html};
use serde_json::Value;

use super::{
    super::{
        desk::Desk,
        layout::{SiteHead, Tab, segment, verdict},
        problem::Problem,
        view::{Page, Table, cell},
        words,
    },
    set_difference::unit,
};
use crate::{
    adapters::{report::number, store::StoredSet},
    identification::{ErrorSummary, ParameterEstimate, ParameterSet},
};

/// What the page of one version is made of.
pub(super) struct OneSet {
    head: SiteHead,
    stored: StoredSet,
    set: ParameterSet,
}

impl OneSet {
    pub(super) fn load(desk: &Desk, site: &str, version: &str) -> Result<Self, Problem> {
        let head = SiteHead::load(desk, site)?;
        let number = version.parse().map_err(|_| {
            Problem::bad_request(format!("`{version}` is not the number of a version"))
        })?;
        let stored = desk.store().set(site, number)?;
        let stored = stored
            .ok_or_else(|| Problem::not_found(format!("`{site}` has no version {number}")))?;
        let set = stored
            .set()
            .map_err(|e| Problem::unreadable("the set", &e))?;
        Ok(Self { head, stored, set })
    }
}

impl Page for OneSet {
    fn title(&self) -> String {
        format!("Version {} of {}", self.stored.version, self.head.site.name)
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        Some((&self.head, Tab::Sets))
    }

    fn body(&self, _source: &str) -> Markup {
        let set = &self.set;
        html! {
            h1 { "Version " (self.stored.version) " " (verdict(set.verdict.status)) }
            p.facts {
                (words::structure(&set.structure)) " · decided " (words::utc(self.stored.committed_ns)) " UTC · "
                (number::short(set.bases.s_base_mva)) " MVA, " (number::short(set.bases.v_base_kv)) " kV, "
                (number::short(set.bases.nominal_hz)) " Hz · operating point V " (number::fixed(set.operating_point.v0_pu, 3))
                ", P " (number::fixed(set.operating_point.p0_pu, 3)) ", Q " (number::fixed(set.operating_point.q0_pu, 3)) " pu"
            }
            @if !set.verdict.reasons.is_empty() {
                ul.reasons { @for reason in &set.verdict.reasons { li { (reason) } } }
            }
            @if !set.notes.is_empty() {
                h2 { "To know" }
                ul.reasons { @for note in &set.notes { li { (note) } } }
            }
            h2 { "Parameters" }
            (estimates("Parameters", &set.parameters))
            h2 { "In other units, and what the data determine" }
            (estimates("Derived parameters", &set.derived))
            h2 { "Errors" }
            (self.errors())
            p.note { "Content hash " code { (self.stored.content_hash) } ", made by version " (set.software_version) "." }
        }
    }

    /// The document as it was published.
    fn json(&self) -> Result<Value, Problem> {
        serde_json::from_str(&self.stored.document).map_err(|e| Problem::unreadable("the set", &e))
    }

    fn table(&self) -> Table {
        let mut table = Table::new(&[
            "parameter",
            "value",
            "unit",
            "standard_error",
            "at_bound",
            "identifiable",
            "lower",
            "upper",
            "meaning",
        ]);
        table.rows = (self.set.parameters.iter().chain(&self.set.derived))
            .map(|e| {
                vec![
                    e.name.clone(),
                    cell(e.value),
                    e.unit.clone(),
                    cell(e.standard_error.unwrap_or(f64::NAN)),
                    e.at_bound.to_string(),
                    e.identifiable.to_string(),
                    cell(e.lower),
                    cell(e.upper),
                    e.meaning.clone(),
                ]
            })
            .collect();
        table
    }
}

fn estimates(label: &str, list: &[ParameterEstimate]) -> Markup {
    html! {
        div.scroll tabindex="0" role="region" aria-label=(label) {
            table.list {
                thead { tr {
                    th scope="col" { "Name" } th.num scope="col" { "Value" } th.num scope="col" { "± standard error" }
                    th scope="col" { "Unit" } th scope="col" { "Determined" } th scope="col" { "Searched" } th scope="col" { "Meaning" }
                } }
                tbody { @for e in list { tr {
                    th scope="row" { (e.name) }
                    td.num { (number::significant(e.value, 4)) }
                    td.num { (e.standard_error.map_or_else(String::new, |s| number::significant(s, 2))) }
                    td { (unit(&e.unit)) }
                    td {
                        @if e.at_bound { span.chip.open { "on its bound" } }
                        @else if e.identifiable { span.chip.good { "yes" } }
                        @else if let Some((low, high)) = e.interval { "anything from " (number::significant(low, 3)) " to " (number::significant(high, 3)) }
                        @else { span.chip.open { "no" } }
                    }
                    td { (number::significant(e.lower, 3)) " to " (number::significant(e.upper, 3)) }
                    td.dim { (e.meaning) }
                } } }
            }
        }
    }
}

impl OneSet {
    fn errors(&self) -> Markup {
        let held_out = self
            .set
            .held_out
            .iter()
            .flat_map(|s| s.events.iter().map(|e| (e, "held out")));
        let fitted = self.set.fit.events.iter().map(|e| (e, "fitted"));
        let summary = |name: &str, s: &ErrorSummary| {
            html! {
                tr.sum { th scope="row" { (name) } td {} td {}
                    td.num { (number::significant(s.eps_p_percent, 3)) } td.num { (number::significant(s.eps_q_percent, 3)) }
                    td {} td {} td.num { (number::significant(s.error_to_noise, 3)) } }
            }
        };
        html! {
            div.scroll tabindex="0" role="region" aria-label="Errors by event" {
                table.list {
                    thead { tr {
                        th scope="col" { "Event" } th scope="col" { "Use" } th.num scope="col" { "Lowest V / V0" }
                        th.num scope="col" { "Error of P, %" } th.num scope="col" { "of Q, %" }
                        th.num scope="col" { "Event error of P, %" } th.num scope="col" { "of Q, %" } th.num scope="col" { "Error / noise" }
                    } }
                    tbody {
                        (summary("all fitted", &self.set.fit))
                        @if let Some(s) = &self.set.held_out { (summary("all held out", s)) }
                        @for (e, role) in held_out.chain(fitted) { tr {
                            th scope="row" { a href=(self.head.address(&format!("events/{}?model=set-{}", segment(&e.event), self.stored.version))) { (e.event) } }
                            td { (role) }
                            td.num { (number::fixed(e.lowest_voltage, 3)) }
                            td.num { (number::significant(e.eps_p_percent, 3)) } td.num { (number::significant(e.eps_q_percent, 3)) }
                            td.num { (number::significant(e.event_eps_p_percent, 3)) } td.num { (number::significant(e.event_eps_q_percent, 3)) }
                            td.num { (number::significant(e.error_to_noise, 3)) }
                        } }
                    }
                }
            }
        }
    }
}
