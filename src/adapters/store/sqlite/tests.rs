//! The suite on SQLite, and what only a file can do: be missing, damaged, full, foreign, killed.

use std::{fs, path::Path, time::Duration};

use rusqlite::Connection;
use tempfile::TempDir;

use super::{SqliteOptions, SqliteStore};
use crate::{
    adapters::{
        store::{
            ClaimRequest, JobKind, Keep, NewDecision, NewFit, NewJob, Operation, Saved, Store,
            StoreError, WindowQuery, conformance,
        },
        wire::v1::examples,
    },
    identification::Decision,
};

fn open(path: &Path) -> Result<SqliteStore, StoreError> {
    SqliteStore::open(path, &SqliteOptions::default())
}

/// A store in a new directory, with the example's site.
fn fresh(options: &SqliteOptions) -> (TempDir, SqliteStore) {
    let directory = TempDir::new().unwrap();
    let store = SqliteStore::open(&directory.path().join("store.sqlite"), options).unwrap();
    store.save_site(&examples::site(), 1).unwrap();
    (directory, store)
}

fn save_windows(store: &SqliteStore, names: std::ops::Range<usize>) -> Result<(), StoreError> {
    for name in names {
        store.save_window(&examples::window(&format!("window {name}")), 5)?;
    }
    Ok(())
}

fn window_ids(store: &SqliteStore) -> Vec<String> {
    let query = WindowQuery {
        count_max: 10_000,
        ..WindowQuery::default()
    };
    let summaries = store.window_summaries(&query).unwrap();
    summaries.into_iter().map(|summary| summary.id).collect()
}

#[test]
fn sqlite_conforms() {
    let directory = TempDir::new().unwrap();
    let mut count = 0;
    conformance::run(|| {
        count += 1;
        let path = directory.path().join(format!("{count}.sqlite"));
        Box::new(open(&path).unwrap())
    });
}

#[test]
fn the_space_left_is_that_of_the_disk_that_holds_the_file() {
    let (directory, store) = fresh(&SqliteOptions::default());
    assert!(store.disk_free_bytes().is_some_and(|free| free > 0));
    fs::remove_file(directory.path().join("store.sqlite")).unwrap();
    assert_eq!(store.disk_free_bytes(), None);
}

#[test]
fn what_was_answered_survives_a_holder_that_never_closed() {
    let (directory, store) = fresh(&SqliteOptions::default());
    save_windows(&store, 0..3).unwrap();
    let job = NewJob {
        kind: JobKind::IdentifyEvent,
        site: "site-01",
        subject: "window 0",
        inputs_hash: "1",
        due_ns: 0,
    };
    store.enqueue(&job, 1).unwrap();
    let request = ClaimRequest {
        worker: "instance",
        kinds: &JobKind::ALL,
        now_ns: 1,
        lease_until_ns: i64::MAX,
        interruptions_max: 3,
    };
    store.claim(&request).unwrap().unwrap();
    let identification = examples::identification();
    let fit = NewFit {
        kind: JobKind::IdentifySite,
        site: "site-01",
        subject: "site-01",
        inputs_hash: "1",
        identification: &identification,
    };
    let (fit, _) = store.save_fit(&fit, 2).unwrap();
    let decision = NewDecision {
        fit,
        decision: &Decision::Publish {
            reason: String::new(),
        },
        in_force: None,
        actor: "instance",
    };
    store.commit_decision(&decision, 3).unwrap();
    // Neither closed nor checkpointed, as after kill -9.
    std::mem::forget(store);

    let store = open(&directory.path().join("store.sqlite")).unwrap();
    assert_eq!(window_ids(&store).len(), 3);
    assert!(store.claim(&request).unwrap().is_none(), "still leased");
    assert_eq!(store.release_leases_of("instance", 4).unwrap(), 1);
    let job = store.claim(&ClaimRequest {
        now_ns: 4,
        ..request
    });
    assert_eq!(job.unwrap().unwrap().subject, "window 0");
    let unpublished = store.unpublished_sets().unwrap();
    assert_eq!((unpublished.len(), unpublished[0].version), (1, 1));
    assert_eq!(
        store.commit_decision(&decision, 5).unwrap().saved,
        Saved::AlreadyStored
    );
    assert_eq!(store.sets("site-01", 9).unwrap().len(), 1);
}

/// The image a power cut would leave: the log ends anywhere.
#[test]
fn a_log_cut_anywhere_leaves_a_prefix_of_the_commits() {
    let (directory, store) = fresh(&SqliteOptions::default());
    save_windows(&store, 0..12).unwrap();
    let source = directory.path().join("store.sqlite");
    let log = fs::read(directory.path().join("store.sqlite-wal")).unwrap();
    let mut counts = Vec::new();
    for at in 0..=24 {
        let image = TempDir::new().unwrap();
        let path = image.path().join("store.sqlite");
        fs::copy(&source, &path).unwrap();
        let length = log.len() * at / 24;
        fs::write(image.path().join("store.sqlite-wal"), &log[..length]).unwrap();
        let cut = open(&path).unwrap();
        let ids = window_ids(&cut);
        for id in &ids {
            assert!(cut.window(id).unwrap().is_some(), "{id} has no waveforms");
        }
        let first: Vec<_> = (0..ids.len())
            .map(|name| format!("window {name}"))
            .collect();
        assert!(first.iter().all(|name| ids.contains(name)), "{ids:?}");
        counts.push(ids.len());
    }
    assert!(counts.is_sorted(), "{counts:?}");
    assert_eq!(counts.last(), Some(&12));
}

#[test]
fn an_unfinished_transaction_leaves_nothing() {
    let (directory, store) = fresh(&SqliteOptions::default());
    save_windows(&store, 0..1).unwrap();
    let path = directory.path().join("store.sqlite");
    let image = TempDir::new().unwrap();
    let writer = Connection::open(&path).unwrap();
    writer
        .execute_batch(
            "PRAGMA cache_size = 1; BEGIN IMMEDIATE; DELETE FROM waveforms; DELETE FROM windows;",
        )
        .unwrap();
    for name in ["store.sqlite", "store.sqlite-wal"] {
        fs::copy(directory.path().join(name), image.path().join(name)).unwrap();
    }
    let store = open(&image.path().join("store.sqlite")).unwrap();
    assert_eq!(window_ids(&store), ["window 0"]);
}

#[test]
fn a_full_store_refuses_writes_reads_on_and_recovers() {
    let options = SqliteOptions {
        size_bytes_max: Some(400 << 10),
        ..SqliteOptions::default()
    };
    let (_directory, store) = fresh(&options);
    let error = save_windows(&store, 0..10_000).unwrap_err();
    assert!(matches!(error, StoreError::Full { .. }), "{error:?}");
    assert!(error.passing());
    assert_eq!(
        error.to_string(),
        "no space left for the store while it was to save a window"
    );
    let kept = window_ids(&store);
    assert!(kept.len() > 10, "{}", kept.len());
    assert!(kept.iter().all(|id| store.window(id).unwrap().is_some()));
    let keep = Keep {
        waveforms_ns: 0,
        windows_ns: 0,
        fits_ns: 0,
        jobs_ns: 0,
        rows_max: 40,
    };
    // Pruning itself needs a little room for its log, not in the file.
    while store.prune(&keep, i64::MAX).unwrap().more {}
    assert!(window_ids(&store).is_empty());
    save_windows(&store, 0..10).unwrap();
    assert!(store.counts(0).unwrap().bytes <= 400 << 10);
}

#[test]
fn a_store_held_by_another_process_is_busy() {
    let options = SqliteOptions {
        busy_timeout: Duration::ZERO,
        ..SqliteOptions::default()
    };
    let (directory, store) = fresh(&options);
    let other = Connection::open(directory.path().join("store.sqlite")).unwrap();
    other.execute_batch("BEGIN IMMEDIATE").unwrap();
    let error = store.save_site(&examples::site(), 2).unwrap_err();
    assert_eq!(error.label(), "busy");
    assert_eq!(store.sites().unwrap().len(), 1, "readers go on");
    other.execute_batch("ROLLBACK").unwrap();
    store.save_site(&examples::site(), 2).unwrap();
}

#[test]
fn a_store_that_may_not_be_written_says_so() {
    let (_directory, store) = fresh(&SqliteOptions::default());
    let forbid =
        |connection: &Connection| Ok(connection.pragma_update(None, "query_only", true)?);
    store.maintain(Operation("forbid writing"), forbid).unwrap();
    let error = store.save_site(&examples::site(), 2).unwrap_err();
    assert_eq!(error.label(), "read_only");
    assert_eq!(store.sites().unwrap().len(), 1);
}

#[test]
fn a_place_where_no_store_can_be_is_named() {
    let directory = TempDir::new().unwrap();
    let message = |path: &Path| {
        let error = open(path).unwrap_err();
        assert_eq!(error.label(), "cannot_open");
        error.to_string()
    };
    assert!(message(directory.path()).ends_with("it is a directory"));
    let missing = message(&directory.path().join("no/store.sqlite"));
    assert!(missing.contains("No such file or directory"), "{missing}");
    fs::write(directory.path().join("file"), "x").unwrap();
    let file = message(&directory.path().join("file/store.sqlite"));
    assert!(file.contains("ot a directory"), "{file}");
}

#[test]
fn a_newer_schema_is_refused_and_left_alone() {
    let (directory, store) = fresh(&SqliteOptions::default());
    drop(store);
    let path = directory.path().join("store.sqlite");
    let newer = Connection::open(&path).unwrap();
    newer.pragma_update(None, "user_version", 99).unwrap();
    drop(newer);
    let error = open(&path).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the store has schema 99, this program knows schemas up to 3: use the newer program"
    );
}

#[test]
fn a_store_of_the_first_schema_is_brought_up_to_date_with_all_it_holds() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("store.sqlite");
    let old = Connection::open(&path).unwrap();
    old.execute_batch(include_str!("migrations/0001_initial.sql"))
        .unwrap();
    old.pragma_update(None, "application_id", 0x4c4d_4431)
        .unwrap();
    old.pragma_update(None, "user_version", 1).unwrap();
    old.execute_batch(
        "PRAGMA foreign_keys = OFF;
         INSERT INTO sites VALUES ('north', 40, 110, 50, 1);
         INSERT INTO parameter_sets VALUES ('north', 1, 'a', '{}', 1, 10, 11);
         INSERT INTO parameter_sets VALUES ('north', 2, 'b', '{}', 2, 20, 21);",
    )
    .unwrap();
    drop(old);
    let store = open(&path).unwrap();
    assert_eq!(store.newest_set("north").unwrap().unwrap().version, 2);
    assert_eq!(store.set_in_force("north").unwrap().unwrap().version, 2);
    assert!(store.newest_diagnosis("north").unwrap().is_none());
    assert!(store.structure("north", None).unwrap().is_none());
}

#[test]
fn a_database_of_another_program_is_refused_and_left_alone() {
    let directory = TempDir::new().unwrap();
    for (name, sql) in [
        ("marked", "PRAGMA application_id = 7"),
        ("unmarked", "CREATE TABLE t (x)"),
    ] {
        let path = directory.path().join(name);
        let other = Connection::open(&path).unwrap();
        other.execute_batch(sql).unwrap();
        drop(other);
        let before = fs::read(&path).unwrap();
        assert_eq!(open(&path).unwrap_err().label(), "not_ours", "{name}");
        assert_eq!(fs::read(&path).unwrap(), before);
    }
}

#[test]
fn a_damaged_file_is_called_damaged() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("noise");
    fs::write(&path, vec![0x55; 8192]).unwrap();
    assert_eq!(open(&path).unwrap_err().label(), "corrupt");

    let (directory, store) = fresh(&SqliteOptions::default());
    save_windows(&store, 0..50).unwrap();
    drop(store);
    let path = directory.path().join("store.sqlite");
    let mut bytes = fs::read(&path).unwrap();
    // Everything but the first page, which holds the header and the schema.
    bytes[4096..].fill(0xff);
    fs::write(&path, bytes).unwrap();
    let error = match open(&path) {
        Ok(store) => store.usable_windows("site-01", 9).unwrap_err(),
        Err(error) => error,
    };
    assert_eq!(error.label(), "corrupt", "{error}");
}

#[test]
fn damaged_waveforms_are_told_from_good_ones() {
    let (directory, store) = fresh(&SqliteOptions::default());
    save_windows(&store, 0..2).unwrap();
    let other = Connection::open(directory.path().join("store.sqlite")).unwrap();
    other
        .execute(
            "UPDATE waveforms SET data = substr(data, 1, 50) WHERE window_id = 'window 0'",
            [],
        )
        .unwrap();
    let error = store.window("window 0").unwrap_err();
    assert_eq!(error.label(), "document");
    assert!(store.window("window 1").unwrap().is_some());
}

#[test]
fn the_audit_trail_can_only_grow() {
    let (directory, store) = fresh(&SqliteOptions::default());
    let identification = examples::identification();
    let fit = NewFit {
        kind: JobKind::IdentifySite,
        site: "site-01",
        subject: "site-01",
        inputs_hash: "1",
        identification: &identification,
    };
    let decision = NewDecision {
        fit: store.save_fit(&fit, 2).unwrap().0,
        decision: &Decision::Publish {
            reason: "passed".to_owned(),
        },
        in_force: None,
        actor: "instance",
    };
    store.commit_decision(&decision, 3).unwrap();
    store.mark_published("site-01", 1, 4).unwrap();
    let other = Connection::open(directory.path().join("store.sqlite")).unwrap();
    let actions: String = other
        .query_row("SELECT group_concat(action) FROM audit", [], |row| {
            row.get(0)
        })
        .unwrap();
    assert_eq!(actions, "decide,publish");
    assert!(other.execute("DELETE FROM audit", []).is_err());
    assert!(other.execute("UPDATE audit SET actor = 'x'", []).is_err());
}

#[test]
fn many_may_open_an_empty_place_at_once() {
    let directory = TempDir::new().unwrap();
    let path = directory.path().join("store.sqlite");
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..6)
            .map(|_| scope.spawn(|| open(&path).map(drop)))
            .collect();
        for thread in threads {
            thread.join().unwrap().unwrap();
        }
    });
    let mode: String = Connection::open(&path)
        .unwrap()
        .pragma_query_value(None, "journal_mode", |row| row.get(0))
        .unwrap();
    assert_eq!(mode, "wal");
}
