//! The structure of a site's model: what it is, what each addition did to the error, change it.

use std::sync::Arc;

use axum::{
    Form,
    extract::{Path, Query, State},
    http::{HeaderMap, Uri},
    response::Response,
};
use maud::Markup;
use serde::Deserialize;
use serde_json::{Value, json};

use super::{
    super::{
        acting,
        desk::Desk,
        layout::{SiteHead, Tab, site_address},
        plot::Chart,
        problem::Problem,
        session::Access,
        view::{self, Page, Table, cell},
    },
    overlay::Overlay,
    structure_view,
};
use crate::{
    adapters::store::{
        DecisionRecord, JobKind, NewStructure, Origin, StoredFit, StructureChange, StructureRecord,
    },
    identification::{Decision, ErrorSummary, ParameterSet},
};

/// Joint fits and changes looked through at most.
const LOOKED_AT_MAX: usize = 200;

#[derive(Clone, Debug, Default, Deserialize)]
pub(in super::super) struct Asked {
    /// The effect that the form begins with.
    #[serde(default)]
    pub(in super::super) add: String,
}

/// `/sites/{site}/structure`.
pub(in super::super) async fn show(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    Query(asked): Query<Asked>,
    access: Access,
    uri: Uri,
) -> Response {
    view::show(desk, uri, move |desk| {
        StructurePage::load(desk, &site, asked, access)
    })
    .await
}

/// A form of the page.
#[derive(Debug, Deserialize)]
pub(in super::super) struct Sent {
    csrf: String,
    add: Option<String>,
    remove: Option<String>,
    #[serde(default)]
    comment: String,
}

/// `POST /sites/{site}/structure`: adds or removes an effect.
pub(in super::super) async fn change(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    access: Access,
    headers: HeaderMap,
    Form(sent): Form<Sent>,
) -> Response {
    if let Err(problem) = access.check(&sent.csrf, &headers) {
        return problem.answer(view::Form::Html);
    }
    let change = match (sent.add, sent.remove) {
        (Some(effect), None) => StructureChange::Add(effect),
        (None, Some(effect)) => StructureChange::Remove(effect),
        _ => {
            let problem = Problem::bad_request("the form has to add or to remove one effect");
            return problem.answer(view::Form::Html);
        }
    };
    let next = site_address(&site, "structure");
    acting::act(desk, &next, move |desk, now_ns| {
        let new = NewStructure {
            site: &site,
            change: &change,
            origin: Origin::Http,
            actor: acting::ACTOR,
            comment: &acting::comment(&sent.comment)?,
        };
        let actions = &desk.context.actions;
        actions
            .change_structure(desk.store(), &new, now_ns)
            .map_err(acting::problem)?;
        Ok(())
    })
    .await
}

/// One step of the staircase: the last joint fit of a run of fits with one structure.
pub(super) struct Stair {
    pub(super) fit: StoredFit,
    pub(super) set: ParameterSet,
    /// What was decided on it; none where nothing has been yet.
    pub(super) decision: Option<DecisionRecord>,
    /// Version of the newest set of the run that was published.
    pub(super) version: Option<u64>,
}

impl Stair {
    pub(super) fn held_out(&self) -> Option<&ErrorSummary> {
        self.set.held_out.as_ref()
    }

    /// What became of it, from a closed list; none where nothing has been decided yet.
    pub(super) fn decided(&self) -> Option<&'static str> {
        let record = self.decision.as_ref()?;
        Some(match (&record.decision, record.version) {
            (_, Some(_)) => "published",
            _ if record.awaiting_approval => "awaiting_approval",
            (Decision::AwaitApproval { .. }, None) => "refused",
            _ => "rejected",
        })
    }
}

/// What the page is made of.
pub(super) struct StructurePage {
    pub(super) head: SiteHead,
    pub(super) asked: Asked,
    pub(super) access: Access,
    /// Oldest first.
    pub(super) stairs: Vec<Stair>,
    /// Newest first.
    pub(super) changes: Vec<StructureRecord>,
    /// The structure that is to be fitted.
    pub(super) wanted: Vec<String>,
    /// Version and structure of the set in force.
    pub(super) in_force: Option<(u64, Vec<String>)>,
    /// Error over noise of a perfect model, where a diagnosis says it.
    pub(super) floor: f64,
    pub(super) overlay: Option<Overlay>,
    /// What the newest diagnosis names and the structure has not.
    pub(super) missing: Vec<String>,
}

impl StructurePage {
    fn load(desk: &Desk, site: &str, asked: Asked, access: Access) -> Result<Self, Problem> {
        let head = SiteHead::load(desk, site)?;
        let store = desk.store();
        let decisions = store.decisions(site, LOOKED_AT_MAX)?;
        let fits = store.fits(site, JobKind::IdentifySite, LOOKED_AT_MAX)?;
        let stairs = stairs(fits, &decisions)?;
        let in_force = match store.set_in_force(site)? {
            None => None,
            Some(stored) => {
                let set = stored.set();
                let set = set.map_err(|e| Problem::unreadable("a parameter set", &e))?;
                Some((stored.version, set.structure))
            }
        };
        let changes = store.structures(site, LOOKED_AT_MAX)?;
        let newest = store.structure(site, None)?.map(|record| record.structure);
        let fitted = stairs.last().map(|stair| stair.fit.structure.clone());
        let plain = || vec!["zip".to_owned(), "induction_motor".to_owned()];
        let wanted = newest.or(fitted).unwrap_or_else(plain);
        let diagnosis = store.newest_diagnosis(site)?;
        let named = diagnosis.as_ref().map(|stored| &stored.answer_set[..]);
        let missing = still_missing(named.unwrap_or_default(), &wanted);
        let floor = diagnosis
            .and_then(|stored| stored.diagnosis().ok().flatten())
            .map_or(1.0, |diagnosis| diagnosis.noise_floor);
        let overlay = overlay(desk, &stairs);
        Ok(Self {
            head,
            asked,
            access,
            stairs,
            changes,
            wanted,
            in_force,
            floor,
            overlay,
            missing,
        })
    }

    /// The effect that the form begins with: the one asked for, else the one the diagnosis names.
    pub(super) fn proposed(&self) -> &str {
        match self.asked.add.as_str() {
            "" => self.missing.first().map_or("", String::as_str),
            asked => asked,
        }
    }

    /// Whether a fit of the wanted structure is still to come.
    pub(super) fn awaited(&self) -> bool {
        self.stairs
            .last()
            .is_none_or(|stair| stair.fit.structure != self.wanted)
    }
}

/// What is left of an answer of the diagnosis: its effects describe the events equally well, so that one of
/// them in the structure answers it.
pub(super) fn still_missing(answers: &[String], structure: &[String]) -> Vec<String> {
    if answers.iter().any(|effect| structure.contains(effect)) {
        return Vec::new();
    }
    answers.to_vec()
}

/// The newest fit of each run of fits with one structure.
fn stairs(
    newest_first: Vec<StoredFit>,
    decisions: &[DecisionRecord],
) -> Result<Vec<Stair>, Problem> {
    let mut stairs: Vec<Stair> = Vec::new();
    for fit in newest_first {
        let decision = decisions.iter().find(|decision| decision.fit == fit.id);
        let version = decision.and_then(|decision| decision.version);
        if let Some(later) = (stairs.last_mut()).filter(|s| s.fit.structure == fit.structure) {
            later.version = later.version.or(version);
            continue;
        }
        let set = fit.set().map_err(|e| Problem::unreadable("a fit", &e))?;
        if let Some(set) = set {
            stairs.push(Stair {
                fit,
                set,
                decision: decision.cloned(),
                version,
            });
        }
    }
    stairs.reverse();
    Ok(stairs)
}

/// The last two steps on the event, held out from both if there is one, where the first fails most.
fn overlay(desk: &Desk, stairs: &[Stair]) -> Option<Overlay> {
    let [.., before, after] = stairs else {
        return None;
    };
    let held_out_of_both = |event: &str| {
        let held_out = |stair: &Stair| stair.set.held_out_events.iter().any(|e| e == event);
        held_out(before) && held_out(after)
    };
    let errors = before
        .set
        .held_out
        .iter()
        .chain([&before.set.fit])
        .flat_map(|s| &s.events);
    let worst = errors.max_by(|a, b| {
        let key =
            |e: &crate::identification::EventErrors| (held_out_of_both(&e.event), e.error_to_noise);
        let ((a_out, a_error), (b_out, b_error)) = (key(a), key(b));
        a_out.cmp(&b_out).then(a_error.total_cmp(&b_error))
    })?;
    let window = desk.store().window(&worst.event).ok()??;
    let judged = |stair: &Stair| {
        desk.comparison(&stair.set, &stair.fit.content_hash, &window)
            .ok()
    };
    Some(Overlay {
        before: judged(before)?,
        after: judged(after)?,
    })
}

impl Page for StructurePage {
    fn title(&self) -> String {
        format!("Model structure of {}", self.head.site.name)
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        Some((&self.head, Tab::Structure))
    }

    fn body(&self, source: &str) -> Markup {
        structure_view::body(self, source)
    }

    fn charts(&self) -> Vec<Chart> {
        structure_view::charts(self)
    }

    fn json(&self) -> Result<Value, Problem> {
        let steps = self.stairs.iter().map(|stair| {
            json!({
                "fit": stair.fit.id.0,
                "structure": stair.fit.structure,
                "error_to_noise": stair.set.fit.error_to_noise,
                "held_out_error_to_noise": stair.held_out().map(|e| e.error_to_noise),
                "held_out_error_to_noise_away_from_edges": stair.held_out().map(|e| e.error_to_noise_away_from_edges),
                "held_out_eps_p_percent": stair.held_out().map(|e| e.eps_p_percent),
                "held_out_eps_q_percent": stair.held_out().map(|e| e.eps_q_percent),
                "decision": stair.decided(),
                "decision_reason": stair.decision.as_ref().map(|record| record.decision.reason()),
                "version": stair.version,
            })
        });
        Ok(json!({
            "site": self.head.site.name,
            "structure": self.wanted,
            "in_force": self.in_force.as_ref().map(|(version, structure)| json!({
                "version": version, "structure": structure,
            })),
            "fit_awaited": self.awaited(),
            "noise_floor": self.floor,
            "steps": steps.collect::<Vec<_>>(),
            "changes": self.changes.iter().map(|change| json!({
                "structure": change.structure, "origin": change.origin.name(),
                "actor": change.actor, "comment": change.comment,
                "changed_utc": crate::adapters::wire::v1::rfc3339(change.changed_ns),
            })).collect::<Vec<_>>(),
        }))
    }

    fn table(&self) -> Table {
        let mut table = Table::new(&[
            "fit",
            "structure",
            "error_to_noise",
            "held_out_error_to_noise",
            "held_out_error_to_noise_away_from_edges",
            "held_out_eps_p_percent",
            "held_out_eps_q_percent",
            "decision",
            "version",
        ]);
        table.rows = self
            .stairs
            .iter()
            .map(|stair| {
                let held_out = |of: fn(&ErrorSummary) -> f64| stair.held_out().map_or(f64::NAN, of);
                vec![
                    stair.fit.id.0.to_string(),
                    stair.fit.structure.join("+"),
                    cell(stair.set.fit.error_to_noise),
                    cell(held_out(|e| e.error_to_noise)),
                    cell(held_out(|e| e.error_to_noise_away_from_edges)),
                    cell(held_out(|e| e.eps_p_percent)),
                    cell(held_out(|e| e.eps_q_percent)),
                    stair.decided().unwrap_or_default().to_owned(),
                    stair
                        .version
                        .map_or_else(String::new, |version| version.to_string()),
                ]
            })
            .collect();
        table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_alternative_of_what_was_added_is_not_missing() {
        let names = |list: &[&str]| list.iter().map(|&s| s.to_owned()).collect::<Vec<_>>();
        let answers = names(&["electronic_load_dropout", "discharge_lighting"]);
        let plain = names(&["zip", "induction_motor"]);
        assert_eq!(still_missing(&answers, &plain), answers);
        let added = names(&["zip", "induction_motor", "discharge_lighting"]);
        assert!(still_missing(&answers, &added).is_empty());
    }
}
