//! Checks of retention and numbers.

use super::{
    Check, commit_set, decide, identification, save_fit, save_usable, seconds_ns, window_at,
    window_id,
};
use crate::{
    adapters::store::{
        ClaimRequest, JobKind, Keep, NewJob, Pruned, Saved, Store, StoreCounts, WindowQuery,
    },
    identification::Decision,
};

pub(super) const CHECKS: &[Check] = &[
    ("old windows go, needed ones stay", windows_are_pruned),
    ("pruning is bounded and says so", pruning_is_bounded),
    ("old fits and jobs go, decisions stay", fits_are_pruned),
    ("a pruned fit can be made again", pruned_fit_is_refilled),
    ("the numbers are right", numbers),
];

/// Keeps nothing that is a second old or older.
const KEEP_NOTHING: Keep = Keep {
    waveforms_ns: 1_000_000_000,
    windows_ns: 1_000_000_000,
    fits_ns: 1_000_000_000,
    jobs_ns: 1_000_000_000,
    rows_max: 1_000,
};

/// A time long after the windows of this suite.
fn later() -> i64 {
    window_at(100_000).onset_ns()
}

fn waveforms(store: &dyn Store) -> Vec<String> {
    let query = WindowQuery {
        count_max: 100,
        ..WindowQuery::default()
    };
    let summaries = store.window_summaries(&query).unwrap();
    summaries
        .into_iter()
        .filter(|summary| summary.has_waveforms)
        .map(|summary| summary.id)
        .collect()
}

fn windows_are_pruned(store: &dyn Store) {
    for second in [1, 2, 3] {
        save_usable(store, second);
    }
    // Needed by the newest set.
    let mut fit = identification(5);
    fit.set.fitted_events = vec![window_id(2)];
    let (id, _) = save_fit(store, "inputs", &fit);
    let publish = super::publish();
    decide(store, id, &publish).unwrap();
    // Needed by an open job.
    let job = NewJob {
        kind: JobKind::IdentifyEvent,
        site: "site-01",
        subject: &window_id(3),
        inputs_hash: "1",
        due_ns: 0,
    };
    store.enqueue(&job, 1).unwrap();
    let early = store.prune(&KEEP_NOTHING, window_at(1).onset_ns()).unwrap();
    assert_eq!((early.waveforms, early.windows), (0, 0));
    let pruned = store.prune(&KEEP_NOTHING, later()).unwrap();
    assert_eq!((pruned.waveforms, pruned.windows), (1, 1));
    assert_eq!(waveforms(store), [3, 2].map(window_id));
    assert!(store.window(&window_id(1)).unwrap().is_none());
}

fn pruning_is_bounded(store: &dyn Store) {
    for second in 0..10 {
        save_usable(store, second);
    }
    let keep = Keep {
        windows_ns: i64::MAX,
        rows_max: 4,
        ..KEEP_NOTHING
    };
    let pruned: Vec<_> = (0..3)
        .map(|_| store.prune(&keep, later()).unwrap())
        .map(|pruned| (pruned.waveforms, pruned.more))
        .collect();
    assert_eq!(pruned, [(4, true), (4, true), (2, false)]);
    let query = WindowQuery {
        count_max: 100,
        ..WindowQuery::default()
    };
    let left = store.window_summaries(&query).unwrap();
    assert_eq!(left.len(), 10, "summaries are kept longer");
}

fn fits_are_pruned(store: &dyn Store) {
    commit_set(store, 5);
    let newest = commit_set(store, 6);
    let (undecided, _) = save_fit(store, "undecided", &identification(7));
    let job = NewJob {
        kind: JobKind::IdentifySite,
        site: "site-01",
        subject: "site-01",
        inputs_hash: "1",
        due_ns: 0,
    };
    store.enqueue(&job, 1).unwrap();
    let request = ClaimRequest {
        worker: "w",
        kinds: &JobKind::ALL,
        now_ns: 1,
        lease_until_ns: 2,
        interruptions_max: 3,
    };
    let claimed = store.claim(&request).unwrap().unwrap();
    store.complete(&claimed.lease, "fit 1", 1).unwrap();
    let pruned = store.prune(&KEEP_NOTHING, later()).unwrap();
    assert_eq!((pruned.fits, pruned.jobs), (2, 1));
    assert!(store.fit(undecided).unwrap().is_none());
    let behind_newest = store.fit(newest.fit).unwrap().unwrap();
    assert!(behind_newest.document.is_some());
    assert_eq!(store.decisions("site-01", 9).unwrap().len(), 2);
    assert_eq!(store.sets("site-01", 9).unwrap().len(), 2);
    let nothing_left = store.prune(&KEEP_NOTHING, later()).unwrap();
    assert_eq!(nothing_left, Pruned::default());
}

fn pruned_fit_is_refilled(store: &dyn Store) {
    let (fit, _) = save_fit(store, "inputs", &identification(5));
    let reject = Decision::Reject {
        reason: String::new(),
    };
    decide(store, fit, &reject).unwrap();
    store.prune(&KEEP_NOTHING, later()).unwrap();
    let pruned = store.fit(fit).unwrap().unwrap();
    assert_eq!(pruned.set().unwrap(), None);
    let (again, saved) = save_fit(store, "inputs", &identification(5));
    assert_eq!((again, saved), (fit, Saved::Stored));
    assert!(store.fit(fit).unwrap().unwrap().document.is_some());
}

fn numbers(store: &dyn Store) {
    let empty = store.counts(1).unwrap();
    let bytes = empty.bytes;
    assert!(bytes > 0);
    assert_eq!(
        empty,
        StoreCounts {
            bytes,
            ..StoreCounts::default()
        }
    );
    save_usable(store, 1);
    commit_set(store, 5);
    for (subject, due_s) in [("a", 5.0), ("b", 7.0), ("c", 50.0)] {
        let job = NewJob {
            kind: JobKind::IdentifyEvent,
            site: "site-01",
            subject,
            inputs_hash: "1",
            due_ns: seconds_ns(due_s),
        };
        store.enqueue(&job, 0).unwrap();
    }
    let counts = store.counts(seconds_ns(9.0)).unwrap();
    assert_eq!((counts.jobs_queued, counts.jobs_claimed), (3, 0));
    assert_eq!(counts.oldest_due_job_age_ns, seconds_ns(4.0));
    assert_eq!((counts.windows, counts.sets), (1, 1));
    assert_eq!(counts.sets_unpublished, 1);
    store.check().unwrap();
}
