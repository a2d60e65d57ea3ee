//! What a site's model is missing: answer, evidence, what would tell more.

use std::sync::Arc;

use axum::{
    extract::{Path, Query, State},
    http::Uri,
    response::Response,
};
use maud::Markup;
use serde_json::{Value, json};

use super::{
    super::{
        desk::Desk,
        layout::{SiteHead, Tab},
        plot::Chart,
        problem::Problem,
        session::Access,
        view::{self, Form, Page, Table, cell},
    },
    diagnosis_charts,
    diagnosis_trial::{self, Trial},
    diagnosis_view,
};
use crate::adapters::{
    store::{StoredDiagnosis, StructureRecord},
    wire::v1::DiagnosisV1,
};

/// Older diagnoses listed at most.
const LISTED_MAX: usize = 50;

/// `/sites/{site}/diagnosis`: the newest.
pub(in super::super) async fn show(
    State(desk): State<Arc<Desk>>,
    Path(site): Path<String>,
    Query(asked): Query<diagnosis_trial::Asked>,
    access: Access,
    uri: Uri,
) -> Response {
    view::show(desk, uri, move |desk| {
        DiagnosisPage::load(desk, &site, None, &asked, access)
    })
    .await
}

/// `/sites/{site}/diagnoses/{version}`, `.json`, `.csv`: one of them, for good.
pub(in super::super) async fn show_one(
    State(desk): State<Arc<Desk>>,
    Path((site, version)): Path<(String, String)>,
    Query(asked): Query<diagnosis_trial::Asked>,
    access: Access,
    uri: Uri,
) -> Response {
    let version = Form::of(&version).0.to_owned();
    view::show(desk, uri, move |desk| {
        DiagnosisPage::load(desk, &site, Some(&version), &asked, access)
    })
    .await
}

/// What the page is made of.
pub(super) struct DiagnosisPage {
    pub(super) head: SiteHead,
    pub(super) stored: Option<StoredDiagnosis>,
    pub(super) diagnosis: Option<DiagnosisV1>,
    /// Every diagnosis, newest first.
    pub(super) history: Vec<StoredDiagnosis>,
    /// The structure that is to be fitted now.
    pub(super) wanted: Option<StructureRecord>,
    /// A candidate drawn before it is added.
    pub(super) trial: Option<Trial>,
    pub(super) access: Access,
}

impl DiagnosisPage {
    fn load(
        desk: &Desk,
        site: &str,
        version: Option<&str>,
        asked: &diagnosis_trial::Asked,
        access: Access,
    ) -> Result<Self, Problem> {
        let head = SiteHead::load(desk, site)?;
        let store = desk.store();
        let stored = match version {
            None => store.newest_diagnosis(site)?,
            Some(text) => {
                let version = text.parse().map_err(|_| {
                    Problem::bad_request(format!("`{text}` is not the number of a diagnosis"))
                })?;
                let found = store.diagnosis(site, version)?;
                Some(found.ok_or_else(|| {
                    Problem::not_found(format!("`{site}` has no diagnosis {version}"))
                })?)
            }
        };
        let diagnosis = match &stored {
            Some(stored) => stored
                .diagnosis()
                .map_err(|e| Problem::unreadable("the diagnosis", &e))?,
            None => None,
        };
        let trial = match &diagnosis {
            Some(diagnosis) => diagnosis_trial::load(desk, diagnosis, asked)?,
            None => None,
        };
        Ok(Self {
            history: store.diagnoses(site, LISTED_MAX)?,
            wanted: store.structure(site, None)?,
            head,
            stored,
            diagnosis,
            trial,
            access,
        })
    }
}

impl Page for DiagnosisPage {
    fn title(&self) -> String {
        format!("Diagnosis of {}", self.head.site.name)
    }

    fn place(&self) -> Option<(&SiteHead, Tab)> {
        Some((&self.head, Tab::Diagnosis))
    }

    fn body(&self, source: &str) -> Markup {
        diagnosis_view::body(self, source)
    }

    fn charts(&self) -> Vec<Chart> {
        let of_diagnosis = self.diagnosis.as_ref().map(diagnosis_charts::all);
        let trial = self.trial.as_ref().map(Trial::chart);
        trial
            .into_iter()
            .chain(of_diagnosis.into_iter().flatten())
            .collect()
    }

    /// The document as it was published, and which others there are.
    fn json(&self) -> Result<Value, Problem> {
        let document = self
            .stored
            .as_ref()
            .and_then(|stored| stored.document.as_deref());
        let document: Option<Value> = document
            .map(serde_json::from_str)
            .transpose()
            .map_err(|e| Problem::unreadable("the diagnosis", &e))?;
        Ok(json!({
            "site": self.head.site.name,
            "diagnosis": document,
            "drawn": self.trial.as_ref().map(Trial::json),
            "versions": self.history.iter().map(|stored| stored.version).collect::<Vec<_>>(),
        }))
    }

    /// The candidates.
    fn table(&self) -> Table {
        let mut table = Table::new(&[
            "effect",
            "kind",
            "score_share",
            "visibility",
            "delta_bic",
            "held_out_error_before",
            "held_out_error_after",
            "share_of_best_gain",
            "declared",
            "in_answer_set",
            "group",
            "would_separate",
            "refused",
        ]);
        let Some(diagnosis) = &self.diagnosis else {
            return table;
        };
        let optional = |value: Option<f64>| cell(value.unwrap_or(f64::NAN));
        table.rows = diagnosis
            .candidates
            .iter()
            .map(|candidate| {
                vec![
                    candidate.effect.clone(),
                    candidate.kind.clone(),
                    cell(candidate.score_share),
                    cell(candidate.visibility),
                    optional(candidate.delta_bic),
                    optional(candidate.held_out_error_before),
                    optional(candidate.held_out_error_after),
                    optional(candidate.share_of_best_gain),
                    candidate.declared.to_string(),
                    diagnosis.answer_set.contains(&candidate.effect).to_string(),
                    candidate.group.join("+"),
                    candidate.would_separate.clone(),
                    candidate.refused.join("; "),
                ]
            })
            .collect();
        table
    }
}
