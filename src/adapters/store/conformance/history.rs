//! Checks of diagnoses, structures, and versions that are rolled back to.

use super::{Check, commit_set, decide, identification, publish, save_fit};
use crate::{
    adapters::{
        store::{
            FitId, JobKind, NewDiagnosis, NewStructure, Origin, RollBack, Saved, Standing, Store,
            StoreError, StoredSet, StructureChange, StructureRecord, what_follows,
        },
        wire::v1::examples,
    },
    diagnosis::Diagnosis,
};

pub(super) const CHECKS: &[Check] = &[
    ("a diagnosis comes back", diagnosis_comes_back),
    ("the same inputs make one diagnosis", one_diagnosis),
    ("a diagnosis waits to be published", diagnosis_outbox),
    ("a structure changes step by step", structure_changes),
    ("a change that makes no model is refused", no_structure),
    ("the newest word counts, whoever said it", newest_word),
    ("an older version is rolled back to", rolled_back),
    ("old content that is decided on again counts", decided_again),
    ("a fit is kept and decided on once more", repeated_fit),
    ("a diagnosis is kept once more", repeated_diagnosis),
    ("a structure that is come back to is told", came_back),
];

fn save(store: &dyn Store, inputs_hash: &str, diagnosis: &Diagnosis) -> (u64, Saved) {
    let new = NewDiagnosis {
        site: "site-01",
        inputs_hash,
        diagnosis,
    };
    store.save_diagnosis(&new, 30).unwrap()
}

fn diagnosis_comes_back(store: &dyn Store) {
    assert!(store.newest_diagnosis("site-01").unwrap().is_none());
    let diagnosis = examples::diagnosis();
    assert_eq!(save(store, "a", &diagnosis), (1, Saved::Stored));
    let stored = store.diagnosis("site-01", 1).unwrap().unwrap();
    assert_eq!(stored.structure, diagnosis.structure);
    assert_eq!(stored.status, "missing_effect");
    assert_eq!(stored.answer_set, diagnosis.answer_set);
    assert!((stored.error_to_noise - 1.25).abs() < f64::EPSILON);
    assert_eq!((stored.stored_ns, stored.published_ns), (30, None));
    let document = stored.diagnosis().unwrap().unwrap();
    assert_eq!((document.version, document.v), (1, 1));
    assert_eq!(document.candidates[0].effect, "stator_resistance");
    assert!(store.diagnosis("site-01", 2).unwrap().is_none());
}

fn one_diagnosis(store: &dyn Store) {
    let diagnosis = examples::diagnosis();
    assert_eq!(save(store, "a", &diagnosis), (1, Saved::Stored));
    assert_eq!(save(store, "b", &diagnosis), (2, Saved::Stored));
    assert_eq!(save(store, "a", &diagnosis), (1, Saved::AlreadyStored));
    let find = |inputs| store.diagnosis_of("site-01", inputs).unwrap();
    assert_eq!(find("b").unwrap().version, 2);
    assert!(find("c").is_none());
    let newest = store.newest_diagnosis("site-01").unwrap().unwrap();
    assert_eq!(newest.version, 2);
    let listed = store.diagnoses("site-01", 9).unwrap();
    let versions: Vec<u64> = listed.iter().map(|d| d.version).collect();
    assert_eq!(versions, [2, 1]);
    let new = NewDiagnosis {
        site: "nowhere",
        inputs_hash: "a",
        diagnosis: &diagnosis,
    };
    let refused = store.save_diagnosis(&new, 30);
    assert!(matches!(
        refused,
        Err(StoreError::Unknown { what: "site", .. })
    ));
}

fn diagnosis_outbox(store: &dyn Store) {
    save(store, "a", &examples::diagnosis());
    assert_eq!(store.unpublished_diagnoses().unwrap().len(), 1);
    let mark = || store.mark_diagnosis_published("site-01", 1, 40).unwrap();
    assert_eq!((mark(), mark()), (Saved::Stored, Saved::AlreadyStored));
    assert!(store.unpublished_diagnoses().unwrap().is_empty());
    let stored = store.diagnosis("site-01", 1).unwrap().unwrap();
    assert_eq!(stored.published_ns, Some(40));
    assert!(store.mark_diagnosis_published("site-01", 9, 40).is_err());
}

fn change(
    store: &dyn Store,
    change: &StructureChange,
    origin: Origin,
) -> Result<(StructureRecord, Saved), StoreError> {
    let new = NewStructure {
        site: "site-01",
        change,
        origin,
        actor: "engineer",
        comment: "the diagnosis says so",
    };
    store.change_structure(&new, 50)
}

fn set(names: &[&str]) -> StructureChange {
    StructureChange::Set(names.iter().map(|&name| name.to_owned()).collect())
}

fn structure_changes(store: &dyn Store) {
    assert!(store.structure("site-01", None).unwrap().is_none());
    let base = set(&["zip", "induction_motor"]);
    change(store, &base, Origin::Configuration).unwrap();
    let add = StructureChange::Add("stator_resistance".to_owned());
    let (record, saved) = change(store, &add, Origin::Http).unwrap();
    assert_eq!(saved, Saved::Stored);
    assert_eq!(
        record.structure,
        ["zip", "induction_motor", "stator_resistance"]
    );
    assert_eq!(store.structure("site-01", None).unwrap().unwrap(), record);
    assert!(change(store, &add, Origin::Http).is_err(), "it is there");
    let remove = StructureChange::Remove("stator_resistance".to_owned());
    let (record, _) = change(store, &remove, Origin::CommandLine).unwrap();
    assert_eq!(record.structure, ["zip", "induction_motor"]);
    let (_, saved) = change(store, &base, Origin::Http).unwrap();
    assert_eq!(saved, Saved::AlreadyStored);
    let history = store.structures("site-01", 9).unwrap();
    let origins: Vec<Origin> = history.iter().map(|r| r.origin).collect();
    assert_eq!(
        origins,
        [Origin::CommandLine, Origin::Http, Origin::Configuration]
    );
    assert_eq!(history[1].actor, "engineer");
    assert_eq!(history[1].changed_ns, 50);
}

fn no_structure(store: &dyn Store) {
    change(
        store,
        &set(&["zip", "induction_motor"]),
        Origin::Configuration,
    )
    .unwrap();
    for (wrong, words) in [
        (
            StructureChange::Add("magic".to_owned()),
            "unknown model part `magic`",
        ),
        (StructureChange::Add("zip".to_owned()), "appears twice"),
        (StructureChange::Remove("zip".to_owned()), "needs `zip`"),
        (
            StructureChange::Remove("saturation".to_owned()),
            "is not part of",
        ),
        (set(&[]), "needs `zip`"),
    ] {
        let error = change(store, &wrong, Origin::Http).unwrap_err();
        assert!(matches!(error, StoreError::Structure { .. }), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    }
    assert_eq!(store.structures("site-01", 9).unwrap().len(), 1);
}

fn newest_word(store: &dyn Store) {
    let (base, more) = (
        set(&["zip", "induction_motor"]),
        set(&["zip", "induction_motor", "saturation"]),
    );
    change(store, &base, Origin::Configuration).unwrap();
    change(store, &more, Origin::CommandLine).unwrap();
    // The configuration follows later: noted, so that the next start finds nothing new in it.
    let (_, saved) = change(store, &more, Origin::Configuration).unwrap();
    assert_eq!(saved, Saved::Stored);
    let (_, saved) = change(store, &more, Origin::Configuration).unwrap();
    assert_eq!(saved, Saved::AlreadyStored);
    let configured = store.structure("site-01", Some(Origin::Configuration));
    assert_eq!(configured.unwrap().unwrap().structure.len(), 3);
    let http = store.structure("site-01", Some(Origin::Http)).unwrap();
    assert!(http.is_none());
}

fn versions(sets: &[StoredSet]) -> Vec<u64> {
    sets.iter().map(|set| set.version).collect()
}

fn in_force(store: &dyn Store) -> u64 {
    store.set_in_force("site-01").unwrap().unwrap().version
}

fn rolled_back(store: &dyn Store) {
    for rank in [5, 6] {
        let set = commit_set(store, rank);
        store.mark_published("site-01", set.version, 30).unwrap();
    }
    assert_eq!(in_force(store), 2);
    let back_to = |version| {
        let roll_back = RollBack {
            site: "site-01",
            version,
            actor: "engineer",
            comment: "2 makes the study unstable",
        };
        store.roll_back(&roll_back, 60)
    };
    assert_eq!(back_to(1).unwrap(), Saved::Stored);
    assert_eq!(back_to(1).unwrap(), Saved::AlreadyStored);
    let newest = store.newest_set("site-01").unwrap().unwrap();
    assert_eq!(newest.version, 1, "what a candidate is compared with");
    assert_eq!(in_force(store), 2, "1 is not out again yet");
    assert_eq!(versions(&store.unpublished_sets().unwrap()), [1]);
    store.mark_published("site-01", 1, 70).unwrap();
    assert_eq!(in_force(store), 1);
    assert_eq!(versions(&store.sets("site-01", 9).unwrap()), [2, 1]);
    assert_eq!(commit_set(store, 7).version, 3, "numbers go on");
    assert_eq!(store.newest_set("site-01").unwrap().unwrap().version, 3);
    assert!(matches!(back_to(9), Err(StoreError::Unknown { .. })));
}

fn decided_again(store: &dyn Store) {
    for rank in [5, 6] {
        let set = commit_set(store, rank);
        store.mark_published("site-01", set.version, 30).unwrap();
    }
    let (fit, _) = save_fit(store, "other inputs", &identification(5));
    let decision = decide(store, fit, &publish()).unwrap();
    assert_eq!(decision.version, Some(1));
    assert_eq!(store.newest_set("site-01").unwrap().unwrap().version, 1);
    assert_eq!(versions(&store.unpublished_sets().unwrap()), [1]);
}

fn repeated_fit(store: &dyn Store) {
    for rank in [5, 6] {
        let set = commit_set(store, rank);
        store.mark_published("site-01", set.version, 30).unwrap();
    }
    let old = store.fit_of(JobKind::IdentifySite, "site-01", "inputs 5");
    let old = old.unwrap().unwrap();
    let repeat = |fit, inputs| store.repeat_fit(fit, inputs, 40);
    let (copy, saved) = repeat(old.id, "inputs 5 again").unwrap();
    assert_eq!(saved, Saved::Stored);
    let known = repeat(old.id, "inputs 5 again").unwrap();
    assert_eq!(known, (copy, Saved::AlreadyStored));
    let fit = store.fit(copy).unwrap().unwrap();
    assert_eq!((&fit.document, fit.stored_ns), (&old.document, 40));
    assert_eq!(fit.verdict, old.verdict);
    let newest = store.fits("site-01", JobKind::IdentifySite, 1).unwrap();
    assert_eq!(newest[0].id, copy);
    let decision = decide(store, copy, &publish()).unwrap();
    assert_eq!((decision.version, decision.saved), (Some(1), Saved::Stored));
    assert_eq!(store.newest_set("site-01").unwrap().unwrap().version, 1);
    assert_eq!(versions(&store.unpublished_sets().unwrap()), [1]);
    assert_eq!(store.decisions("site-01", 9).unwrap().len(), 3);
    let nothing = repeat(FitId(99), "x");
    assert!(matches!(nothing, Err(StoreError::Unknown { .. })));
}

fn repeated_diagnosis(store: &dyn Store) {
    let diagnosis = examples::diagnosis();
    for inputs in ["a", "b"] {
        save(store, inputs, &diagnosis);
    }
    let repeat = |version| store.repeat_diagnosis("site-01", version, "a again", 40);
    assert_eq!(repeat(1).unwrap(), (3, Saved::Stored));
    assert_eq!(repeat(1).unwrap(), (3, Saved::AlreadyStored));
    let newest = store.newest_diagnosis("site-01").unwrap().unwrap();
    assert_eq!((newest.version, newest.stored_ns), (3, 40));
    let document = newest.diagnosis().unwrap().unwrap();
    assert_eq!(document.version, 3);
    let unpublished = store.unpublished_diagnoses().unwrap();
    assert!(unpublished.iter().any(|d| d.version == 3));
    let nothing = store.repeat_diagnosis("site-01", 9, "x", 40);
    assert!(matches!(nothing, Err(StoreError::Unknown { .. })));
}

fn came_back(store: &dyn Store) {
    let (base, more) = (
        set(&["zip", "induction_motor"]),
        set(&["zip", "induction_motor", "saturation"]),
    );
    let times = || {
        let records = store.structures("site-01", usize::MAX).unwrap();
        Standing::of(&records).map(|standing| standing.times_before)
    };
    assert_eq!(times(), None);
    for (structure, origin, expected) in [
        (&base, Origin::Configuration, 0),
        (&more, Origin::Http, 0),
        (&more, Origin::Configuration, 0),
        (&base, Origin::CommandLine, 1),
        (&more, Origin::Http, 1),
        (&base, Origin::Http, 2),
    ] {
        let (record, saved) = change(store, structure, origin).unwrap();
        assert_eq!(times(), Some(expected), "{structure:?} by {origin}");
        let note = what_follows(store, &record, saved).unwrap();
        assert_eq!(note.contains("before"), expected > 0, "{note}");
    }
    let (record, saved) = change(store, &base, Origin::Http).unwrap();
    let note = what_follows(store, &record, saved).unwrap();
    assert!(note.starts_with("nothing changes"), "{note}");
}
