//! Parameter sets: history, decisions, one version, the difference of two.

use std::sync::Arc;

use axum::{
    extract::{Path, Query, State},
    http::{HeaderMap, Uri},
    response::Response,
};
use maud::{Markup, html};
use serde::Deserialize;
use serde_json::{Value, json};

use super::{
    super::{
        acting,
        desk::Desk,
        layout::{SiteHead, Tab, site_address, verdict},
        problem::Problem,
        session::Access,
        view::{self, Form, Page, Table, cell},
        words,
    },
    models::{self, Choice},
    set_difference::{Difference, difference},
    set_view::OneSet,
};
use crate::{
    adapters::{
        http::{DecisionDocument, SetDocument},
        report::number,
        store::{Approval, DecisionId, DecisionRecord, RollBack, StoredSet},
    },
    identification::ParameterSet,
};

/// Versions and decisions shown at most.
const SHOWN_MAX: usize = 200;

#[derive(Debug, Default, Deserialize)]
pub(in super::super) struct Asked {
    /// `set-1` or `fit-3`: the first of a difference.
    #[serde(default)]
    from: String,
    /// The second.
    #[serde(default)]
    to: String,
}

/// `/sites/{site}/sets`.
pub(in super::super) async fn show(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    Query(asked): Query<Asked>,
    access: Access,
    uri: Uri,
) -> Response {
    view::show(desk, uri, move |desk| {
        Sets::load(desk, &site, &asked, access)
    })
    .await
}

/// A form of the page.
#[derive(Debug, Deserialize)]
pub(in super::super) struct Sent {
    csrf: String,
    #[serde(default)]
    comment: String,
    /// `approve` or `refuse`.
    #[serde(default)]
    answer: String,
}

/// `POST /sites/{site}/sets/{version}/roll-back`.
pub(in super::super) async fn roll_back(
    State(desk): State<Arc<Desk>>,
    Path((site, version)): Path<(String, u64)>,
    access: Access,
    headers: HeaderMap,
    axum::Form(sent): axum::Form<Sent>,
) -> Response {
    if let Err(problem) = access.check(&sent.csrf, &headers) {
        return problem.answer(Form::Html);
    }
    let next = site_address(&site, "sets");
    acting::act(desk, &next, move |desk, now_ns| {
        let comment = acting::comment(&sent.comment)?;
        let (site, actor) = (site.as_str(), acting::ACTOR);
        let to = RollBack {
            site,
            version,
            actor,
            comment: &comment,
        };
        let actions = &desk.context.actions;
        actions
            .roll_back(desk.store(), &to, now_ns)
            .map_err(acting::problem)?;
        Ok(())
    })
    .await
}

/// `POST /sites/{site}/decisions/{id}`: approves or refuses a set that waits.
pub(in super::super) async fn answer(
    State(desk): State<Arc<Desk>>,
    Path((site, id)): Path<(String, i64)>,
    access: Access,
    headers: HeaderMap,
    axum::Form(sent): axum::Form<Sent>,
) -> Response {
    if let Err(problem) = access.check(&sent.csrf, &headers) {
        return problem.answer(Form::Html);
    }
    let approved = match sent.answer.as_str() {
        "approve" => true,
        "refuse" => false,
        _ => return Problem::bad_request("the answer is `approve` or `refuse`").answer(Form::Html),
    };
    let next = site_address(&site, "sets");
    acting::act(desk, &next, move |desk, now_ns| {
        let decision = DecisionId(id);
        let known = desk
            .store()
            .decision(decision)?
            .filter(|record| record.site == site);
        if known.is_none() {
            return Err(Problem::not_found(format!("`{site}` has no decision {id}")));
        }
        let comment = acting::comment(&sent.comment)?;
        let approval = Approval {
            decision,
            approved,
            actor: acting::ACTOR,
            comment: &comment,
        };
        let actions = &desk.context.actions;
        let answered = actions.answer_decision(desk.store(), &site, &approval, now_ns);
        answered.map_err(acting::problem)?;
        Ok(())
    })
    .await
}

/// `/sites/{site}/sets/{version}`, `.json`, `.csv`.
pub(in super::super) async fn show_one(
    State(desk): State<Arc<Desk>>,
    Path((site, version)): Path<(String, String)>,
    uri: Uri,
) -> Response {
    let version = Form::of(&version).0.to_owned();
    view::show(desk, uri, move |desk| OneSet::load(desk, &site, &version)).await
}

struct Sets {
    head: SiteHead,
    versions: Vec<(StoredSet, ParameterSet)>,
    decisions: Vec<DecisionRecord>,
    choices: Vec<Choice>,
    asked: (String, String),
    difference: Option<Difference>,
    access: Access,
}

impl Sets {
    fn load(desk: &Desk, site: &str, asked: &Asked, access: Access) -> Result<Self, Problem> {
        let head = SiteHead::load(desk, site)?;
        let versions = desk
            .store()
            .sets(site, SHOWN_MAX)?
            .into_iter()
            .map(|stored| {
                let set = stored.set().map_err(|e| Problem::unreadable("a set", &e))?;
                Ok((stored, set))
            })
            .collect::<Result<Vec<_>, Problem>>()?;
        let choices = models::choices(desk, site, None)?;
        let newest = |place: usize| choices.get(place).map(|choice| choice.key.clone());
        let or = |asked: &str, place| {
            if asked.is_empty() {
                newest(place)
            } else {
                Some(asked.to_owned())
            }
        };
        let ends = or(&asked.from, 1).zip(or(&asked.to, 0));
        let difference = ends
            .as_ref()
            .map(|(from, to)| {
                let (from, to) = (
                    models::model(desk, site, from)?,
                    models::model(desk, site, to)?,
                );
                Ok::<_, Problem>(difference(&from, &to))
            })
            .transpose()?;
        let decisions = desk.store().decisions(site, SHOWN_MAX)?;
        Ok(Self {
            head,
            versions,
            decisions,
            choices,
            asked: ends.unwrap_or_default(),
            difference,
            access,
        })
    }

    fn in_force(&self) -> Option<u64> {
        self.head
            .in_force
            .as_ref()
            .map(|(stored, _)| stored.version)
    }
}

impl Page for Sets {
    fn title(&self) -> String {
        format!("Parameter sets of {}", self.head.site.name)
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        Some((&self.head, Tab::Sets))
    }

    fn body(&self, _source: &str) -> Markup {
        html! {
            h1 { "Parameter sets" }
            @if self.versions.is_empty() { p { "No set has been published yet." } } @else { (self.history()) }
            @if let Some(difference) = &self.difference {
                h2 { "What changed" }
                form.filter method="get" {
                    label { "From " (models::select("from", &self.choices, &self.asked.0, None)) }
                    label { "to " (models::select("to", &self.choices, &self.asked.1, None)) }
                    button type="submit" { "Compare" }
                }
                (difference.markup())
            }
            h2 { "Decisions" }
            @if self.decisions.is_empty() { p { "Nothing has been decided yet." } } @else { (self.decided()) }
        }
    }

    fn json(&self) -> Result<Value, Problem> {
        Ok(json!({
            "site": self.head.site.name,
            "in_force": self.in_force(),
            "sets": self.versions.iter().map(|(stored, _)| SetDocument::from(stored)).collect::<Vec<_>>(),
            "decisions": self.decisions.iter().map(DecisionDocument::from).collect::<Vec<_>>(),
            "difference": self.difference.as_ref().map(Difference::json),
        }))
    }

    fn table(&self) -> Table {
        let mut table = Table::new(&[
            "version",
            "committed_utc",
            "published_utc",
            "verdict",
            "structure",
            "eps_p_percent",
            "eps_q_percent",
            "error_to_noise",
            "content_hash",
        ]);
        table.rows = self
            .versions
            .iter()
            .map(|(stored, set)| {
                let document = SetDocument::from(stored);
                let errors = set.held_out.as_ref().unwrap_or(&set.fit);
                vec![
                    stored.version.to_string(),
                    document.committed_utc,
                    document.published_utc.unwrap_or_default(),
                    crate::adapters::wire::v1::verdict_status_name(set.verdict.status).to_owned(),
                    set.structure.join("+"),
                    cell(errors.eps_p_percent),
                    cell(errors.eps_q_percent),
                    cell(errors.error_to_noise),
                    stored.content_hash.clone(),
                ]
            })
            .collect();
        table
    }
}

impl Sets {
    fn history(&self) -> Markup {
        html! {
            div.scroll tabindex="0" role="region" aria-label="Versions" {
                table.list.cards {
                    thead { tr {
                        th scope="col" { "Version" } th scope="col" { "Since, UTC" } th scope="col" { "Verdict" }
                        th scope="col" { "Structure" }
                        th.num scope="col" { "Held-out error of P, %" } th.num scope="col" { "of Q, %" }
                        th.num scope="col" { "Error / noise" } th scope="col" { "Files" } th scope="col" { span.hidden { "Actions" } }
                    } }
                    tbody { @for (stored, set) in &self.versions {
                        @let page = self.head.address(&format!("sets/{}", stored.version));
                        tr {
                            th scope="row" { a href=(page) { "version " (stored.version) }
                                @if self.in_force() == Some(stored.version) { " " span.chip.good { "in force" } }
                                @else if stored.published_ns.is_none() { " " span.chip.open { "being published" } } }
                            td.time data-label="Since, UTC" { (words::utc(stored.committed_ns)) }
                            td data-label="Verdict" { (verdict(set.verdict.status)) }
                            td data-label="Structure" { (words::structure(&set.structure)) }
                            @if let Some(errors) = &set.held_out {
                                td.num data-label="Held-out error of P, %" { (number::significant(errors.eps_p_percent, 3)) }
                                td.num data-label="of Q, %" { (number::significant(errors.eps_q_percent, 3)) }
                                td.num data-label="Error / noise" { (number::significant(errors.error_to_noise, 3)) }
                            } @else { td {} td {} td {} }
                            td data-label="Files" { a href={ (page) ".json" } { "JSON" } " " a href={ (page) ".csv" } { "CSV" } }
                            td {
                                @if self.access.may_write && self.in_force() != Some(stored.version) && stored.published_ns.is_some() {
                                    form method="post" action={ (page) "/roll-back" } {
                                        input type="hidden" name="csrf" value=(self.access.csrf);
                                        button type="submit" { "Put in force again" }
                                    }
                                }
                            }
                        }
                    } }
                }
            }
        }
    }

    fn answers(&self, decision: i64) -> Markup {
        html! {
            @if self.access.may_write {
                form method="post" action=(self.head.address(&format!("decisions/{decision}"))) {
                    input type="hidden" name="csrf" value=(self.access.csrf);
                    input type="text" name="comment" maxlength="500" aria-label="Comment" placeholder="comment";
                    button type="submit" name="answer" value="approve" { "Approve" }
                    button type="submit" name="answer" value="refuse" { "Refuse" }
                }
            } @else {
                " " a href={ "/session?next=" (self.head.address("sets")) } { "unlock to answer" }
            }
        }
    }

    fn decided(&self) -> Markup {
        html! {
            div.scroll tabindex="0" role="region" aria-label="Decisions" {
                table.list.cards {
                    thead { tr { th scope="col" { "When, UTC" } th scope="col" { "Decision" } th scope="col" { "Why" } th scope="col" { "By" } } }
                    tbody { @for record in &self.decisions {
                        @let document = DecisionDocument::from(record);
                        tr {
                            th.time scope="row" { (words::utc(record.decided_ns)) }
                            td data-label="Decision" {
                                @let (class, name) = standing(&document);
                                span class={ "chip " (class) } { (name) }
                                @if let Some(version) = document.version { " version " (version) }
                                @if document.awaiting_approval { " " (self.answers(document.id)) } }
                            td data-label="Why" { (document.reason) }
                            td data-label="By" {
                                (words::actor(&document.actor))
                                @if let Some(answer) = &document.answer {
                                    "; " (if answer.approved { "approved" } else { "refused" }) " by " (words::actor(&answer.actor))
                                    @if !answer.comment.is_empty() { ": " (answer.comment) }
                                }
                            }
                        }
                    } }
                }
            }
        }
    }
}

/// What has become of a decision: class of its chip, and words.
fn standing(decision: &DecisionDocument) -> (&'static str, String) {
    match (&decision.answer, decision.decision) {
        (Some(answer), _) if answer.approved => ("good", "approved".to_owned()),
        (Some(_), _) => ("bad", "refused".to_owned()),
        (None, _) if decision.awaiting_approval => ("open", "awaits approval".to_owned()),
        (None, "publish") => ("good", "publish".to_owned()),
        (None, "reject") => ("bad", "reject".to_owned()),
        (None, other) => ("open", other.replace('_', " ")),
    }
}
