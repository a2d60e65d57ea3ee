//! What is being computed now and how far it is: told by the workers, shown by the pages.

use std::{
    collections::BTreeMap,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

use crate::adapters::store::JobKind;

/// The jobs under way, by number. As many as there are workers.
#[derive(Debug, Default)]
pub struct WorkBoard(Mutex<BTreeMap<i64, Entry>>);

/// A job under way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ongoing {
    /// What it computes.
    pub kind: JobKind,
    /// Site.
    pub site: String,
    /// Window identifier or site, according to the kind.
    pub subject: String,
    /// The structure that is fitted or judged.
    pub structure: Vec<String>,
    /// When it began, UTC nanoseconds.
    pub since_ns: i64,
    /// How often it has simulated events so far.
    pub simulations: u64,
    /// What it is at, where it says so.
    pub stage: Option<Stage>,
}

/// A step of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Stage {
    /// In words.
    pub what: String,
    /// Steps of its kind done.
    pub done: usize,
    /// Steps of its kind, as far as they are known.
    pub of: usize,
}

#[derive(Debug)]
struct Entry {
    begun: Ongoing,
    simulations: Arc<AtomicU64>,
}

/// With whom a job tells how far it is; the job is off the board when this is dropped.
#[derive(Debug)]
pub struct Reporter {
    board: Arc<WorkBoard>,
    job: i64,
    simulations: Arc<AtomicU64>,
}

impl WorkBoard {
    /// Puts a job on the board.
    pub fn begin(self: &Arc<Self>, job: i64, begun: Ongoing) -> Reporter {
        let simulations = Arc::new(AtomicU64::new(begun.simulations));
        let entry = Entry {
            begun,
            simulations: Arc::clone(&simulations),
        };
        self.entries().insert(job, entry);
        Reporter {
            board: Arc::clone(self),
            job,
            simulations,
        }
    }

    /// The jobs of a site, or all.
    #[must_use]
    pub fn ongoing(&self, site: Option<&str>) -> Vec<Ongoing> {
        let entries = self.entries();
        let of_site = |entry: &&Entry| site.is_none_or(|site| entry.begun.site == site);
        let now = entries.values().filter(of_site).map(|entry| Ongoing {
            simulations: entry.simulations.load(Ordering::Relaxed),
            ..entry.begun.clone()
        });
        now.collect()
    }

    fn entries(&self) -> MutexGuard<'_, BTreeMap<i64, Entry>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Reporter {
    /// One simulation more.
    pub fn simulated(&self) {
        self.simulations.fetch_add(1, Ordering::Relaxed);
    }

    /// The job is at another step.
    pub fn stage(&self, stage: Stage) {
        if let Some(entry) = self.board.entries().get_mut(&self.job) {
            entry.begun.stage = Some(stage);
        }
    }
}

impl Drop for Reporter {
    fn drop(&mut self) {
        self.board.entries().remove(&self.job);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_is_on_the_board_until_its_reporter_is_dropped() {
        let board = Arc::new(WorkBoard::default());
        let begun = Ongoing {
            kind: JobKind::DiagnoseSite,
            site: "a".to_owned(),
            subject: "a".to_owned(),
            structure: vec!["zip".to_owned()],
            since_ns: 5,
            simulations: 0,
            stage: None,
        };
        let reporter = board.begin(7, begun);
        reporter.simulated();
        let stage = Stage {
            what: "looking".to_owned(),
            done: 1,
            of: 3,
        };
        reporter.stage(stage.clone());
        let found = board.ongoing(Some("a"));
        assert_eq!(found[0].simulations, 1);
        assert_eq!(found[0].stage, Some(stage));
        assert!(board.ongoing(Some("b")).is_empty());
        drop(reporter);
        assert!(board.ongoing(None).is_empty());
    }
}
