//! What every store has to do, whatever is behind it. Each check gets a store of its own, with
//! [`examples::site`] saved and nothing else in it.

mod history;
mod jobs;
mod sets;
mod upkeep;
mod windows;

use super::{
    CommittedDecision, FitId, JobKind, NewDecision, NewFit, Saved, Store, StoreError, StoredSet,
};
use crate::{
    adapters::wire::v1::examples,
    disturbance::{Screening, Window},
    identification::{Decision, Identification},
    measurement::record::NANOSECONDS_PER_SECOND,
};

/// A check and the fact it proves.
pub(super) type Check = (&'static str, fn(&dyn Store));

/// The whole suite.
pub(super) fn suite() -> Vec<Check> {
    [
        windows::CHECKS,
        jobs::CHECKS,
        sets::CHECKS,
        history::CHECKS,
        upkeep::CHECKS,
    ]
    .concat()
}

/// Runs the suite, each check on a fresh store.
pub(super) fn run(mut fresh: impl FnMut() -> Box<dyn Store>) {
    for (fact, check) in suite() {
        println!("{fact}");
        let store = fresh();
        store.save_site(&examples::site(), 1).unwrap();
        check(&*store);
    }
}

/// The example's window, moved by `second` seconds and named after them.
fn window_at(second: u32) -> Window {
    let mut window = examples::window(&window_id(second));
    let shift_ns = i64::from(second) * 1_000_000_000;
    window.record.start_ns += shift_ns;
    for sample in &mut window.record.samples {
        sample.time_ns += shift_ns;
    }
    window
}

fn window_id(second: u32) -> String {
    format!("site-01 +{second} s")
}

fn save_usable(store: &dyn Store, second: u32) {
    store.save_window(&window_at(second), 5).unwrap();
    store
        .save_screening(&window_id(second), &Screening::default(), 6)
        .unwrap();
}

/// The example's identification, told apart by its rank.
fn identification(rank: usize) -> Identification {
    let mut identification = examples::identification();
    identification.set.rank = rank;
    identification
}

/// A joint fit whose inputs hash is `inputs`.
fn save_fit(store: &dyn Store, inputs: &str, identification: &Identification) -> (FitId, Saved) {
    let fit = NewFit {
        kind: JobKind::IdentifySite,
        site: "site-01",
        subject: "site-01",
        inputs_hash: inputs,
        identification,
    };
    store.save_fit(&fit, 10).unwrap()
}

fn decide(
    store: &dyn Store,
    fit: FitId,
    decision: &Decision,
) -> Result<CommittedDecision, StoreError> {
    let new = NewDecision {
        fit,
        decision,
        in_force: None,
        actor: "instance",
    };
    store.commit_decision(&new, 20)
}

fn publish() -> Decision {
    Decision::Publish {
        reason: "passed".to_owned(),
    }
}

/// A committed set with content told apart by `rank`.
fn commit_set(store: &dyn Store, rank: usize) -> StoredSet {
    let (fit, _) = save_fit(store, &format!("inputs {rank}"), &identification(rank));
    let version = decide(store, fit, &publish()).unwrap().version.unwrap();
    store.set("site-01", version).unwrap().unwrap()
}

fn seconds_ns(seconds: f64) -> i64 {
    #[allow(
        clippy::cast_possible_truncation,
        reason = "a few seconds, in tests only"
    )]
    let ns = (seconds * NANOSECONDS_PER_SECOND) as i64;
    ns
}
