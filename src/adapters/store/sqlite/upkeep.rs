//! Retention, and numbers for metrics.

use rusqlite::{Connection, Transaction, params};

use super::{connection::pragma, failure::Trouble, windows::count};
use crate::adapters::store::{Keep, Pruned, StoreCounts};

/// Waveforms that neither the fit behind a site's newest set nor an open job needs.
const OLD_WAVEFORMS: &str = "DELETE FROM waveforms WHERE window_id IN (
    SELECT w.id FROM windows w JOIN waveforms f ON f.window_id = w.id
    WHERE w.onset_ns < ?1
      AND NOT EXISTS (
          SELECT 1 FROM fit_events e JOIN parameter_sets p ON p.fit_id = e.fit_id
          WHERE e.window_id = w.id
            AND p.turn = (SELECT max(n.turn) FROM parameter_sets n WHERE n.site = p.site))
      AND NOT EXISTS (
          SELECT 1 FROM jobs j WHERE j.subject = w.id AND j.state IN ('queued', 'claimed'))
    ORDER BY w.onset_ns LIMIT ?2)";

/// Windows whose waveforms are gone.
const OLD_WINDOWS: &str = "DELETE FROM windows WHERE id IN (
    SELECT w.id FROM windows w
    WHERE w.onset_ns < ?1
      AND NOT EXISTS (SELECT 1 FROM waveforms f WHERE f.window_id = w.id)
    ORDER BY w.onset_ns LIMIT ?2)";

/// Fits on which nobody has decided.
const OLD_UNDECIDED_FITS: &str = "DELETE FROM fits WHERE id IN (
    SELECT f.id FROM fits f
    WHERE f.stored_ns < ?1
      AND NOT EXISTS (SELECT 1 FROM decisions d WHERE d.fit_id = f.id)
    ORDER BY f.id LIMIT ?2)";

/// Documents of fits that were decided on, but for those that wait for a person and those behind a
/// site's newest set. Their rows stay with the decisions.
const OLD_DOCUMENTS: &str = "UPDATE fits SET set_document = NULL, document = NULL WHERE id IN (
    SELECT f.id FROM fits f JOIN decisions d ON d.fit_id = f.id
    WHERE f.stored_ns < ?1 AND f.document IS NOT NULL AND d.awaiting = 0
      AND NOT EXISTS (
          SELECT 1 FROM parameter_sets p
          WHERE p.fit_id = f.id
            AND p.turn = (SELECT max(n.turn) FROM parameter_sets n WHERE n.site = p.site))
    ORDER BY f.id LIMIT ?2)";

/// Documents of diagnoses that are published, but for a site's newest.
const OLD_DIAGNOSES: &str = "UPDATE diagnoses SET document = NULL WHERE rowid IN (
    SELECT d.rowid FROM diagnoses d
    WHERE d.stored_ns < ?1 AND d.document IS NOT NULL AND d.published_ns IS NOT NULL
      AND d.version < (SELECT max(n.version) FROM diagnoses n WHERE n.site = d.site)
    ORDER BY d.stored_ns LIMIT ?2)";

const OLD_JOBS: &str = "DELETE FROM jobs WHERE id IN (
    SELECT id FROM jobs WHERE state IN ('done', 'superseded') AND ended_ns < ?1
    ORDER BY id LIMIT ?2)";

pub(super) fn prune(
    transaction: &Transaction<'_>,
    keep: &Keep,
    now_ns: i64,
) -> Result<Pruned, Trouble> {
    let mut left = keep.rows_max;
    let mut delete = |sql: &str, age_ns: i64| -> Result<usize, Trouble> {
        let before_ns = now_ns.saturating_sub(age_ns);
        let rows = transaction
            .prepare_cached(sql)?
            .execute(params![before_ns, count(left)])?;
        left = left.saturating_sub(rows);
        Ok(rows)
    };
    let waveforms = delete(OLD_WAVEFORMS, keep.waveforms_ns)?;
    let windows = delete(OLD_WINDOWS, keep.windows_ns.max(keep.waveforms_ns))?;
    let undecided = delete(OLD_UNDECIDED_FITS, keep.fits_ns)?;
    let documents = delete(OLD_DOCUMENTS, keep.fits_ns)?;
    let diagnoses = delete(OLD_DIAGNOSES, keep.fits_ns)?;
    let jobs = delete(OLD_JOBS, keep.jobs_ns)?;
    Ok(Pruned {
        waveforms,
        windows,
        fits: undecided + documents + diagnoses,
        jobs,
        more: left == 0,
    })
}

/// Gives pages that pruning has freed back to the disk, at most so many.
pub(super) fn shrink(connection: &Connection, pages_max: usize) -> Result<(), Trouble> {
    let mut statement =
        connection.prepare(&format!("PRAGMA incremental_vacuum({})", count(pages_max)))?;
    let mut rows = statement.query([])?;
    // One row per page.
    while rows.next()?.is_some() {}
    Ok(())
}

pub(super) fn counts(connection: &Connection, now_ns: i64) -> Result<StoreCounts, Trouble> {
    let pages: i64 = pragma(connection, "page_count")?;
    let page_bytes: i64 = pragma(connection, "page_size")?;
    let counts = connection
        .prepare_cached(
            "SELECT
                 (SELECT count(*) FROM jobs WHERE state = 'queued'),
                 (SELECT count(*) FROM jobs WHERE state = 'claimed'),
                 (SELECT count(*) FROM jobs WHERE state = 'parked'),
                 (SELECT min(max(due_ns, enqueued_ns)) FROM jobs
                      WHERE state = 'queued' AND due_ns <= ?1),
                 (SELECT count(*) FROM windows),
                 (SELECT count(*) FROM parameter_sets),
                 (SELECT count(*) FROM parameter_sets WHERE published_ns IS NULL),
                 (SELECT count(*) FROM diagnoses WHERE published_ns IS NULL)",
        )?
        .query_row([now_ns], |row| {
            let number = |at| row.get::<_, i64>(at).map(i64::unsigned_abs);
            let due_ns: Option<i64> = row.get(3)?;
            Ok(StoreCounts {
                jobs_queued: number(0)?,
                jobs_claimed: number(1)?,
                jobs_parked: number(2)?,
                oldest_due_job_age_ns: due_ns.map_or(0, |due| now_ns.saturating_sub(due).max(0)),
                windows: number(4)?,
                sets: number(5)?,
                sets_unpublished: number(6)?,
                diagnoses_unpublished: number(7)?,
                bytes: pages.unsigned_abs() * page_bytes.unsigned_abs(),
            })
        })?;
    Ok(counts)
}

/// Reads the schema and one row: enough to see that the file is there and is what it was.
pub(super) fn check(connection: &Connection) -> Result<(), Trouble> {
    connection
        .prepare("SELECT name FROM sites LIMIT 1")?
        .exists([])?;
    Ok(())
}
