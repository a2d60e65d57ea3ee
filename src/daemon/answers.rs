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
        store::Store,
        zenoh::{Keys, Question},
    },
    service::{AskedSet, Event},
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
    /// Answer with a set.
    Set(Question, AskedSet),
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

/// Sorts questions: those for the status are answered as they are, those for parameter sets go to
/// the core. Ends when the entrance of the queue is dropped.
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
                let Some(site) = keys.site_of_parameters(question.key()) else {
                    if tasks.send(Task::Status(question)).is_err() {
                        return;
                    }
                    continue;
                };
                let asked = asked(site, question.parameter("version"));
                let selector = question.selector();
                let event = Event::ParametersAsked {
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
                    Task::Set(question, asked) => {
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

fn asked(site: &str, version: Option<&str>) -> Result<AskedSet, String> {
    let version = version
        .map(|text| {
            text.parse::<u64>()
                .map_err(|_| format!("the version `{text}` is not a number"))
        })
        .transpose()?;
    if site.contains('*') || site.contains('$') {
        return Err(format!("`{site}` names no single site"));
    }
    Ok(AskedSet {
        site: site.to_owned(),
        version,
    })
}

fn answer(store: &dyn Store, keys: &Keys, question: &Question, asked: &AskedSet) -> QueryOutcome {
    // The newest set is on its key or about to be: whoever has just received it is told nothing
    // older, although the store may not know yet that it is there.
    let found = match asked.version {
        Some(version) => store.set(&asked.site, version),
        None => store.newest_set(&asked.site),
    };
    match found {
        Ok(Some(set)) => {
            question.answer(&keys.parameters(&asked.site), &set.document);
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

fn not_found(store: &dyn Store, asked: &AskedSet) -> String {
    let site = &asked.site;
    let known = store
        .sites()
        .is_ok_and(|sites| sites.iter().any(|s| s.name == *site));
    match asked.version {
        _ if !known => format!("there is no site `{site}`"),
        Some(version) => format!("there is no version {version} of `{site}`"),
        None => format!("no set of `{site}` has been published yet"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_question_names_one_site_and_perhaps_a_version() {
        assert_eq!(
            asked("north", Some("3")),
            Ok(AskedSet {
                site: "north".to_owned(),
                version: Some(3)
            })
        );
        assert!(asked("north", Some("three")).is_err());
        assert!(asked("*", None).is_err());
    }
}
