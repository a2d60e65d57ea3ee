//! Checks of fits, decisions, versions.

use std::thread;

use super::{Check, commit_set, decide, identification, publish, save_fit};
use crate::{
    adapters::{
        store::{Approval, FitId, JobKind, NewDecision, NewFit, Saved, Store, StoreError},
        wire::v1::{decode_parameter_set, examples},
    },
    identification::{Decision, InForce, VerdictStatus},
};

pub(super) const CHECKS: &[Check] = &[
    ("a fit comes back with everything", fit_comes_back),
    ("the same inputs make one fit", one_fit),
    ("a decision is made once", decided_once),
    ("the same content has one version", content_has_one_version),
    ("a crash before publishing repeats the version", outbox),
    ("a rejected set has no version", rejected),
    ("approval publishes, refusal does not", approval),
    ("a decision keeps its evidence", evidence),
    ("a decision on no fit is refused", decision_on_nothing),
    ("versions have no gap and no double", versions_from_threads),
];

fn fit_comes_back(store: &dyn Store) {
    let identification = examples::identification();
    let (id, saved) = save_fit(store, "inputs", &identification);
    assert_eq!(saved, Saved::Stored);
    let fit = store.fit(id).unwrap().unwrap();
    assert_eq!(fit.set().unwrap().unwrap(), identification.set);
    assert_eq!(fit.structure, identification.set.structure);
    assert_eq!(fit.verdict, VerdictStatus::Pass);
    let document: serde_json::Value = serde_json::from_str(&fit.document.unwrap()).unwrap();
    assert_eq!(document["solutions"][0]["found_from"], 1);
    assert_eq!(document["directions"].as_array().unwrap().len(), 4);
    assert_eq!(document["content_hash"], fit.content_hash.as_str());
    let listed = store.fits("site-01", JobKind::IdentifySite, 9).unwrap();
    assert_eq!(listed.len(), 1);
    let single = store.fits("site-01", JobKind::IdentifyEvent, 9).unwrap();
    assert!(single.is_empty());
}

fn one_fit(store: &dyn Store) {
    let (first, _) = save_fit(store, "inputs", &identification(5));
    let (second, saved) = save_fit(store, "inputs", &identification(6));
    assert_eq!((second, saved), (first, Saved::AlreadyStored));
    let find = |inputs| store.fit_of(JobKind::IdentifySite, "site-01", inputs);
    assert_eq!(find("inputs").unwrap().unwrap().id, first);
    assert!(find("others").unwrap().is_none());
    let set = store.fit(first).unwrap().unwrap().set().unwrap().unwrap();
    assert_eq!(set.rank, 5, "the first one stays");
}

fn decided_once(store: &dyn Store) {
    let (fit, _) = save_fit(store, "inputs", &identification(5));
    let first = decide(store, fit, &publish()).unwrap();
    assert_eq!((first.version, first.saved), (Some(1), Saved::Stored));
    let reject = Decision::Reject {
        reason: "changed my mind".to_owned(),
    };
    let second = decide(store, fit, &reject).unwrap();
    assert_eq!((second.id, second.version), (first.id, Some(1)));
    assert_eq!(second.saved, Saved::AlreadyStored);
    assert_eq!(store.decisions("site-01", 9).unwrap().len(), 1);
    assert_eq!(store.sets("site-01", 9).unwrap().len(), 1);
}

fn content_has_one_version(store: &dyn Store) {
    let first = commit_set(store, 5);
    let (again, _) = save_fit(store, "other inputs", &identification(5));
    let decision = decide(store, again, &publish()).unwrap();
    assert_eq!(decision.version, Some(first.version));
    assert_eq!(commit_set(store, 6).version, 2);
    assert_eq!(store.sets("site-01", 9).unwrap().len(), 2);
}

fn outbox(store: &dyn Store) {
    let set = commit_set(store, 5);
    let versions = |sets: Vec<crate::adapters::store::StoredSet>| -> Vec<u64> {
        sets.into_iter().map(|set| set.version).collect()
    };
    assert_eq!(versions(store.unpublished_sets().unwrap()), [1]);
    assert!(store.set_in_force("site-01").unwrap().is_none());
    assert_eq!(store.newest_set("site-01").unwrap().unwrap(), set);
    let mark = || store.mark_published("site-01", 1, 30).unwrap();
    assert_eq!((mark(), mark()), (Saved::Stored, Saved::AlreadyStored));
    assert!(store.unpublished_sets().unwrap().is_empty());
    let in_force = store.set_in_force("site-01").unwrap().unwrap();
    assert_eq!(in_force.published_ns, Some(30));
    assert_eq!(in_force.document, set.document, "the same bytes");
    commit_set(store, 6);
    let current = store.set_in_force("site-01").unwrap().unwrap();
    assert_eq!(current.version, 1, "2 is not out yet");
    assert_eq!(store.newest_set("site-01").unwrap().unwrap().version, 2);
    assert_eq!(versions(store.sets("site-01", 9).unwrap()), [2, 1]);
    assert!(store.mark_published("site-01", 9, 30).is_err());
    let decoded = decode_parameter_set(&set.document).unwrap();
    assert_eq!((decoded.version, decoded.rank), (1, 5));
}

fn rejected(store: &dyn Store) {
    let (fit, _) = save_fit(store, "inputs", &identification(5));
    let reject = Decision::Reject {
        reason: "held-out error 2.1 x training error".to_owned(),
    };
    assert_eq!(decide(store, fit, &reject).unwrap().version, None);
    assert!(store.newest_set("site-01").unwrap().is_none());
    let record = store.decisions("site-01", 9).unwrap().remove(0);
    assert_eq!((record.decision, record.fit), (reject, fit));
    assert!(!record.awaiting_approval);
}

fn approval(store: &dyn Store) {
    let wait = Decision::AwaitApproval {
        reason: "passed".to_owned(),
    };
    let waiting = |rank: usize| {
        let (fit, _) = save_fit(store, &rank.to_string(), &identification(rank));
        decide(store, fit, &wait).unwrap().id
    };
    let (good, bad) = (waiting(5), waiting(6));
    let open = store.decisions_awaiting_approval(9).unwrap();
    let ids: Vec<_> = open.iter().map(|record| record.id).collect();
    assert_eq!(ids, [good, bad]);
    let answer = |decision, approved| {
        let approval = Approval {
            decision,
            approved,
            actor: "engineer",
            comment: "plausible",
        };
        store.approve(&approval, 25)
    };
    assert_eq!(answer(good, true).unwrap().version, Some(1));
    let again = answer(good, true).unwrap();
    assert_eq!(
        (again.version, again.saved),
        (Some(1), Saved::AlreadyStored)
    );
    assert_eq!(answer(bad, false).unwrap().version, None);
    assert!(matches!(answer(bad, true), Err(StoreError::Unknown { .. })));
    assert!(store.decisions_awaiting_approval(9).unwrap().is_empty());
    assert_eq!(store.unpublished_sets().unwrap().len(), 1);
    assert_eq!(store.decision(good).unwrap().unwrap().version, Some(1));
}

fn evidence(store: &dyn Store) {
    let published = commit_set(store, 5);
    let in_force = InForce {
        set: published.set().unwrap(),
        on_candidates_held_out: examples::parameter_set().held_out,
    };
    let (fit, _) = save_fit(store, "new", &identification(6));
    let new = NewDecision {
        fit,
        decision: &publish(),
        in_force: Some(&in_force),
        actor: "instance",
    };
    let committed = store.commit_decision(&new, 20).unwrap();
    let record = store.decision(committed.id).unwrap().unwrap();
    let evidence: serde_json::Value = serde_json::from_str(&record.evidence).unwrap();
    assert_eq!(evidence["in_force"], 1);
    assert_eq!(evidence["verdict"]["status"], "pass");
    assert!(evidence["in_force_on_held_out"]["eps_p_percent"].is_number());
    let hash = store.fit(fit).unwrap().unwrap().content_hash;
    assert_eq!(evidence["candidate"], hash.as_str());
    assert_eq!((record.actor.as_str(), record.decided_ns), ("instance", 20));
}

fn decision_on_nothing(store: &dyn Store) {
    let error = decide(store, FitId(77), &publish()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "cannot commit a decision: there is no fit `77`"
    );
    let identification = examples::identification();
    let fit = NewFit {
        kind: JobKind::IdentifySite,
        site: "nowhere",
        subject: "nowhere",
        inputs_hash: "",
        identification: &identification,
    };
    assert!(matches!(
        store.save_fit(&fit, 1),
        Err(StoreError::Unknown { what: "site", .. })
    ));
}

fn versions_from_threads(store: &dyn Store) {
    let mut versions = thread::scope(|scope| {
        let threads: Vec<_> = (0..12)
            .map(|rank| scope.spawn(move || commit_set(store, rank).version))
            .collect();
        let versions = threads.into_iter().map(|thread| thread.join().unwrap());
        versions.collect::<Vec<_>>()
    });
    versions.sort_unstable();
    assert_eq!(versions, (1..=12).collect::<Vec<_>>());
}
