//! Questions from the network: kept until the core has said what to do, answered on a thread of
//! their own so that a slow asker holds up nobody else.

use std::{
    collections::BTreeMap,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicU64, Ordering},
        mpsc::{Receiver, SyncSender},
    },
    thread::{self, JoinHandle},
};

use tokio::sync::mpsc::UnboundedSender;

use super::status::StatusBoard;
use crate::{
    adapters::{
        store::{Store, StoreError, StoredDiagnosis, StoredSet},
        zenoh::{Keys, Question},
    },
    service::{AskedDocument, DocumentKind, Event},
    telemetry::sets::QueryOutcome,
};

/// Questions that wait for the core. The core bounds how many it lets be answered at one time; the
/// queue from zenoh bounds how many come.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    next: AtomicU64,
    questions: Mutex<BTreeMap<u64, Question>>,
}

/// What the answering thread is to do.
#[derive(Debug)]
pub(super) enum Task {
    /// Answer with a set or a diagnosis.
    Document(Question, AskedDocument),
    /// Answer with an error.
    Refuse(Question, String),
    /// Answer with the status.
    Status(Question),
}

/// Tasks that wait for the answering thread.
pub(super) const TASKS_MAX: usize = 1024;

impl Waiting {
    fn keep(&self, question: Question) -> u64 {
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        self.lock().insert(number, question);
        number
    }

    pub(super) fn take(&self, number: u64) -> Option<Question> {
        self.lock().remove(&number)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, BTreeMap<u64, Question>> {
        self.questions
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
    }
}

/// Sorts questions: those for the status are answered as they are, those for parameter sets and
/// diagnoses go to the core. Ends when the entrance of the queue is dropped.
pub(super) fn spawn_sorter(
    keys: Keys,
    waiting: Arc<Waiting>,
    questions: Receiver<Question>,
    events: UnboundedSender<Event>,
    tasks: SyncSender<Task>,
) -> std::io::Result<JoinHandle<()>> {
    thread::Builder::new()
        .name("questions".to_owned())
        .spawn(move || {
            for question in questions {
                let Some((kind, site)) = addressed(&keys, question.key()) else {
                    if tasks.send(Task::Status(question)).is_err() {
                        return;
                    }
                    continue;
                };
                let asked = asked(kind, site, question.parameter("version"));
                let selector = question.selector();
                let event = Event::DocumentAsked {
                    question: waiting.keep(question),
                    selector,
                    asked,
                };
                if events.send(event).is_err() {
                    return;
                }
            }
        })
}

/// Answers until all senders are dropped.
pub(super) fn spawn_answerer(
    store: Arc<dyn Store>,
    keys: Keys,
    board: Arc<StatusBoard>,
    tasks: Receiver<Task>,
    events: UnboundedSender<Event>,
) -> std::io::Result<JoinHandle<()>> {
    thread::Builder::new()
        .name("answers".to_owned())
        .spawn(move || {
            for task in tasks {
                match task {
                    Task::Refuse(question, reason) => question.refuse(&reason),
                    Task::Status(question) => {
                        let document = board.document();
                        question.answer(&keys.status(board.instance()), &document);
                    }
                    Task::Document(question, asked) => {
                        let outcome = answer(store.as_ref(), &keys, &question, &asked);
                        let selector = question.selector();
                        events
                            .send(Event::QuestionAnswered { selector, outcome })
                            .ok();
                    }
                }
            }
        })
}

/// Whether a key is that of parameter sets or of diagnoses, and its site.
fn addressed<'k>(keys: &Keys, key: &'k str) -> Option<(DocumentKind, &'k str)> {
    let set = keys.site_of_parameters(key);
    let diagnosis = || keys.site_of_diagnosis(key);
    set.map(|site| (DocumentKind::Set, site))
        .or_else(|| diagnosis().map(|site| (DocumentKind::Diagnosis, site)))
}

fn asked(kind: DocumentKind, site: &str, version: Option<&str>) -> Result<AskedDocument, String> {
    let version = version
        .map(|text| {
            text.parse::<u64>()
                .map_err(|_| format!("the version `{text}` is not a number"))
        })
        .transpose()?;
    if site.contains('*') || site.contains('$') {
        return Err(format!("`{site}` names no single site"));
    }
    Ok(AskedDocument {
        kind,
        site: site.to_owned(),
        version,
    })
}

fn answer(
    store: &dyn Store,
    keys: &Keys,
    question: &Question,
    asked: &AskedDocument,
) -> QueryOutcome {
    match found(store, asked) {
        Ok(Some(document)) => {
            let key = match asked.kind {
                DocumentKind::Set => keys.parameters(&asked.site),
                DocumentKind::Diagnosis => keys.diagnosis(&asked.site),
            };
            question.answer(&key, &document);
            QueryOutcome::Answered
        }
        Ok(None) => {
            question.refuse(&not_found(store, asked));
            QueryOutcome::NotFound
        }
        Err(error) => {
            tracing::warn!(%error, "a question could not be answered");
            question.refuse("the store did not answer");
            QueryOutcome::Failed
        }
    }
}

/// What was asked for. The newest is on its key or about to be: whoever has just received it is told
/// nothing older, although the store may not know yet that it is there.
fn found(store: &dyn Store, asked: &AskedDocument) -> Result<Option<String>, StoreError> {
    let site = &asked.site;
    let set = |found: Option<StoredSet>| found.map(|set| set.document);
    let diagnosis = |found: Option<StoredDiagnosis>| found.and_then(|found| found.document);
    match (asked.kind, asked.version) {
        (DocumentKind::Set, Some(version)) => store.set(site, version).map(set),
        (DocumentKind::Set, None) => store.newest_set(site).map(set),
        (DocumentKind::Diagnosis, Some(version)) => store.diagnosis(site, version).map(diagnosis),
        (DocumentKind::Diagnosis, None) => store.newest_diagnosis(site).map(diagnosis),
    }
}

fn not_found(store: &dyn Store, asked: &AskedDocument) -> String {
    let site = &asked.site;
    let known = store
        .sites()
        .is_ok_and(|sites| sites.iter().any(|s| s.name == *site));
    match asked.version {
        _ if !known => format!("there is no site `{site}`"),
        Some(version) => match asked.kind {
            DocumentKind::Set => format!("there is no version {version} of `{site}`"),
            DocumentKind::Diagnosis => format!("there is no diagnosis {version} of `{site}`"),
        },
        None => match asked.kind {
            DocumentKind::Set => format!("no set of `{site}` has been published yet"),
            DocumentKind::Diagnosis => format!("`{site}` has not been diagnosed yet"),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_question_names_one_site_and_perhaps_a_version() {
        assert_eq!(
            asked(DocumentKind::Set, "north", Some("3")),
            Ok(AskedDocument {
                kind: DocumentKind::Set,
                site: "north".to_owned(),
                version: Some(3)
            })
        );
        assert!(asked(DocumentKind::Set, "north", Some("three")).is_err());
        assert!(asked(DocumentKind::Diagnosis, "*", None).is_err());
    }
}
