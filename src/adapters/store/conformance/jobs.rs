//! Checks of the queue.

use std::{collections::BTreeMap, sync::Mutex, thread};

use super::{Check, seconds_ns};
use crate::adapters::store::{
    ClaimRequest, Enqueued, Job, JobFailure, JobKind, JobState, LeaseAnswer, NewJob, Store,
    StoreError,
};

pub(super) const CHECKS: &[Check] = &[
    ("the same job is queued once", queued_once),
    ("a newer job supersedes the older", newer_supersedes),
    ("a job of an unknown site is refused", unknown_site),
    ("jobs are handed out in order", in_order),
    ("fits come before diagnoses", fits_first),
    ("a job in hands is not handed out", not_twice),
    ("an expired lease is claimed again", expired_again),
    ("a heartbeat keeps the lease", heartbeat_keeps),
    (
        "a failing job is tried again, then parked",
        failing_is_parked,
    ),
    (
        "a job that loses its holders is parked",
        interrupted_is_parked,
    ),
    ("a released job counts as untouched", released),
    ("a dead worker's jobs are due at once", dead_worker),
    ("no job is in two hands", never_in_two_hands),
];

fn new_job<'a>(subject: &'a str, inputs_hash: &'a str) -> NewJob<'a> {
    NewJob {
        kind: JobKind::IdentifyEvent,
        site: "site-01",
        subject,
        inputs_hash,
        due_ns: 0,
    }
}

fn queue(store: &dyn Store, subject: &str, inputs_hash: &str) -> Enqueued {
    store.enqueue(&new_job(subject, inputs_hash), 1).unwrap()
}

/// Claims at `now_s` seconds, with a lease of ten seconds.
fn claim(store: &dyn Store, worker: &str, now_s: f64) -> Option<Job> {
    let request = ClaimRequest {
        worker,
        kinds: &JobKind::ALL,
        now_ns: seconds_ns(now_s),
        lease_until_ns: seconds_ns(now_s + 10.0),
        interruptions_max: 3,
    };
    store.claim(&request).unwrap()
}

fn fits_first(store: &dyn Store) {
    let diagnosis = NewJob {
        kind: JobKind::DiagnoseSite,
        ..new_job("site-01", "1")
    };
    store.enqueue(&diagnosis, 1).unwrap();
    queue(store, "a", "1");
    let kinds = [0.0, 1.0].map(|now_s| claim(store, "w", now_s).unwrap().kind);
    assert_eq!(kinds, [JobKind::IdentifyEvent, JobKind::DiagnoseSite]);
}

fn queued_once(store: &dyn Store) {
    let Enqueued::Added(id) = queue(store, "a", "1") else {
        panic!("it was not there");
    };
    let state = |known| match known {
        Enqueued::Known(same, state) if same == id => state,
        other => panic!("{other:?}"),
    };
    assert_eq!(state(queue(store, "a", "1")), JobState::Queued);
    let job = claim(store, "w", 1.0).unwrap();
    assert_eq!((job.lease.job, job.subject.as_str()), (id, "a"));
    assert_eq!(state(queue(store, "a", "1")), JobState::Claimed);
    store.complete(&job.lease, "fit 1", 2).unwrap();
    assert_eq!(state(queue(store, "a", "1")), JobState::Done);
    assert!(claim(store, "w", 100.0).is_none());
}

fn newer_supersedes(store: &dyn Store) {
    queue(store, "a", "1");
    queue(store, "b", "1");
    queue(store, "a", "2");
    let subjects: Vec<_> = std::iter::from_fn(|| claim(store, "w", 1.0))
        .map(|job| (job.subject, job.inputs_hash))
        .collect();
    let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
    assert_eq!(subjects, [pair("b", "1"), pair("a", "2")]);
    // The claimed one goes on; the superseded one comes back when its inputs do.
    let again = queue(store, "a", "1");
    assert!(matches!(again, Enqueued::Known(_, JobState::Queued)));
    assert_eq!(claim(store, "w", 1.0).unwrap().inputs_hash, "1");
}

fn unknown_site(store: &dyn Store) {
    let job = NewJob {
        site: "nowhere",
        ..new_job("a", "1")
    };
    assert!(matches!(
        store.enqueue(&job, 1),
        Err(StoreError::Unknown { what: "site", .. })
    ));
}

fn in_order(store: &dyn Store) {
    for subject in ["a", "b", "c"] {
        queue(store, subject, "1");
    }
    let later = NewJob {
        due_ns: seconds_ns(50.0),
        kind: JobKind::IdentifySite,
        ..new_job("later", "1")
    };
    store.enqueue(&later, 1).unwrap();
    let subjects: Vec<_> = std::iter::from_fn(|| claim(store, "w", 1.0))
        .map(|job| job.subject)
        .collect();
    assert_eq!(subjects, ["a", "b", "c"]);
    let request = ClaimRequest {
        worker: "w",
        kinds: &[JobKind::IdentifySite],
        now_ns: seconds_ns(60.0),
        lease_until_ns: seconds_ns(70.0),
        interruptions_max: 3,
    };
    assert_eq!(store.claim(&request).unwrap().unwrap().subject, "later");
    let none = ClaimRequest {
        kinds: &[],
        ..request
    };
    assert!(store.claim(&none).unwrap().is_none());
}

fn not_twice(store: &dyn Store) {
    queue(store, "a", "1");
    assert!(claim(store, "one", 1.0).is_some());
    assert!(claim(store, "other", 10.9).is_none());
}

fn expired_again(store: &dyn Store) {
    queue(store, "a", "1");
    let old = claim(store, "one", 1.0).unwrap();
    let new = claim(store, "other", 11.0).unwrap();
    assert_eq!((new.lease.job, new.interruptions), (old.lease.job, 1));
    let at = seconds_ns(12.0);
    let failure = JobFailure {
        error: "x",
        retry_at_ns: 0,
        failures_max: 1,
    };
    for answer in [
        store.heartbeat(&old.lease, seconds_ns(99.0)),
        store.complete(&old.lease, "late", at),
        store.fail(&old.lease, &failure, at),
        store.release(&old.lease, at),
    ] {
        assert_eq!(answer.unwrap(), LeaseAnswer::Lost);
    }
    let done = store.complete(&new.lease, "fit 1", at).unwrap();
    assert_eq!(done, LeaseAnswer::Held);
    let again = store.complete(&new.lease, "fit 1", at).unwrap();
    assert_eq!(again, LeaseAnswer::Lost, "it is over");
}

fn heartbeat_keeps(store: &dyn Store) {
    queue(store, "a", "1");
    let job = claim(store, "one", 1.0).unwrap();
    let answer = store.heartbeat(&job.lease, seconds_ns(30.0)).unwrap();
    assert_eq!(answer, LeaseAnswer::Held);
    assert!(claim(store, "other", 29.0).is_none());
    assert!(claim(store, "other", 30.0).is_some());
}

fn failing_is_parked(store: &dyn Store) {
    queue(store, "a", "1");
    let failure = JobFailure {
        error: "no feasible parameters were found from any start",
        retry_at_ns: seconds_ns(20.0),
        failures_max: 2,
    };
    let job = claim(store, "w", 1.0).unwrap();
    let answer = store.fail(&job.lease, &failure, 2).unwrap();
    assert_eq!(answer, LeaseAnswer::Held);
    assert!(claim(store, "w", 19.0).is_none(), "not due yet");
    let job = claim(store, "w", 20.0).unwrap();
    assert_eq!((job.failures, job.interruptions), (1, 0));
    assert_eq!(job.last_error.as_deref(), Some(failure.error));
    let answer = store.fail(&job.lease, &failure, 3).unwrap();
    assert_eq!(answer, LeaseAnswer::Parked);
    assert!(claim(store, "w", 1e6).is_none());
    let parked = store.parked_jobs(9).unwrap().remove(0);
    assert_eq!((parked.failures, parked.state), (2, JobState::Parked));
    let again = queue(store, "a", "1");
    assert!(matches!(again, Enqueued::Known(_, JobState::Parked)));
}

fn interrupted_is_parked(store: &dyn Store) {
    queue(store, "a", "1");
    for now_s in [0.0, 10.0, 20.0] {
        assert!(claim(store, "w", now_s).is_some());
    }
    assert!(claim(store, "w", 30.0).is_none());
    let parked = store.parked_jobs(9).unwrap().remove(0);
    assert_eq!((parked.failures, parked.interruptions), (0, 3));
    let error = parked.last_error.as_deref();
    assert_eq!(error, Some("its holder disappeared 3 times"));
}

fn released(store: &dyn Store) {
    queue(store, "a", "1");
    for _ in 0..10 {
        let job = claim(store, "w", 1.0).unwrap();
        assert_eq!((job.failures, job.interruptions), (0, 0));
        let answer = store.release(&job.lease, seconds_ns(1.0)).unwrap();
        assert_eq!(answer, LeaseAnswer::Held);
    }
}

fn dead_worker(store: &dyn Store) {
    for subject in ["a", "b", "c"] {
        queue(store, subject, "1");
    }
    let lost = claim(store, "dead", 1.0).unwrap();
    claim(store, "dead", 1.0).unwrap();
    claim(store, "alive", 1.0).unwrap();
    let released = store.release_leases_of("dead", seconds_ns(2.0)).unwrap();
    assert_eq!(released, 2);
    let answer = store.complete(&lost.lease, "late", 3).unwrap();
    assert_eq!(answer, LeaseAnswer::Lost);
    let again = claim(store, "dead", 2.0).unwrap();
    assert_eq!((again.subject.as_str(), again.interruptions), ("a", 1));
    // Whoever dies of a job at every start does not die for ever.
    for _ in 0..3 {
        store.release_leases_of("dead", seconds_ns(2.0)).unwrap();
        while claim(store, "dead", 2.0).is_some() {}
    }
    assert_eq!(store.parked_jobs(9).unwrap().len(), 2);
}

fn never_in_two_hands(store: &dyn Store) {
    const JOBS: usize = 60;
    for at in 0..JOBS {
        queue(store, &format!("window {at}"), "1");
    }
    let hands = Mutex::new(BTreeMap::<String, Vec<usize>>::new());
    thread::scope(|scope| {
        for worker in 0..8 {
            let hands = &hands;
            scope.spawn(move || {
                while let Some(job) = claim(store, &format!("w{worker}"), 1.0) {
                    let mut hands = hands.lock().unwrap();
                    hands.entry(job.subject).or_default().push(worker);
                }
            });
        }
    });
    let hands = hands.into_inner().unwrap();
    assert_eq!(hands.len(), JOBS);
    assert!(
        hands.values().all(|workers| workers.len() == 1),
        "{hands:?}"
    );
}
