//! Versions of parameter sets, and whether they have been published.

use rusqlite::{Connection, OptionalExtension, Params, Row, Transaction, params};
use serde_json::json;

use super::{
    decisions::{AuditEntry, CandidateSet},
    failure::Trouble,
    windows::count,
};
use crate::{
    adapters::{
        store::{FitId, RollBack, Saved, StoredSet},
        wire::v1::{decode_parameter_set, encode_parameter_set},
    },
    identification::ParameterSet,
};

const SELECT: &str = "SELECT site, version, content_hash, document, fit_id, committed_ns, \
                      published_ns FROM parameter_sets";

/// Gives a candidate its site's next version, or finds the one its content has already and lets it
/// count again.
pub(super) fn assign_version(
    transaction: &Transaction<'_>,
    candidate: &CandidateSet,
    now_ns: i64,
) -> Result<u64, Trouble> {
    let known: Option<i64> = transaction
        .prepare_cached("SELECT version FROM parameter_sets WHERE site = ?1 AND content_hash = ?2")?
        .query_row(params![candidate.site, candidate.content_hash], |row| {
            row.get(0)
        })
        .optional()?;
    if let Some(version) = known {
        let version = version.unsigned_abs();
        take_turn(transaction, &candidate.site, version)?;
        return Ok(version);
    }
    let newest: i64 = transaction
        .prepare_cached("SELECT coalesce(max(version), 0) FROM parameter_sets WHERE site = ?1")?
        .query_row([&candidate.site], |row| row.get(0))?;
    let version = newest.unsigned_abs() + 1;
    let set = ParameterSet {
        version,
        ..decode_parameter_set(&candidate.document)?
    };
    transaction.execute(
        "INSERT INTO parameter_sets
             (site, version, content_hash, document, fit_id, committed_ns, turn)
         SELECT ?1, ?2, ?3, ?4, ?5, ?6, coalesce(max(turn), 0) + 1
         FROM parameter_sets WHERE site = ?1",
        params![
            candidate.site,
            version_number(version),
            candidate.content_hash,
            encode_parameter_set(&set)?,
            candidate.fit.0,
            now_ns
        ],
    )?;
    Ok(version)
}

/// Makes a version the one that counts, to be published again. Returns whether another one did.
fn take_turn(transaction: &Transaction<'_>, site: &str, version: u64) -> Result<bool, Trouble> {
    let changed = transaction.execute(
        "UPDATE parameter_sets SET published_ns = NULL,
             turn = (SELECT max(n.turn) + 1 FROM parameter_sets n WHERE n.site = ?1)
         WHERE site = ?1 AND version = ?2
           AND turn < (SELECT max(n.turn) FROM parameter_sets n WHERE n.site = ?1)",
        params![site, version_number(version)],
    )?;
    Ok(changed > 0)
}

pub(super) fn roll_back(
    transaction: &Transaction<'_>,
    to: &RollBack<'_>,
    now_ns: i64,
) -> Result<Saved, Trouble> {
    if by_version(transaction, to.site, to.version)?.is_none() {
        return Err(Trouble::unknown(
            "parameter set",
            format!("{} version {}", to.site, to.version),
        ));
    }
    if !take_turn(transaction, to.site, to.version)? {
        return Ok(Saved::AlreadyStored);
    }
    let entry = AuditEntry {
        site: to.site,
        actor: to.actor,
        action: "roll_back",
        detail: json!({"version": to.version, "comment": to.comment}),
    };
    entry.write(transaction, now_ns)?;
    Ok(Saved::Stored)
}

/// A version as SQLite takes it. One beyond its integers was never assigned, and matches nothing.
pub(super) fn version_number(version: u64) -> i64 {
    i64::try_from(version).unwrap_or(-1)
}

pub(super) fn mark_published(
    transaction: &Transaction<'_>,
    site: &str,
    version: u64,
    now_ns: i64,
) -> Result<Saved, Trouble> {
    let changed = transaction.execute(
        "UPDATE parameter_sets SET published_ns = ?3
         WHERE site = ?1 AND version = ?2 AND published_ns IS NULL",
        params![site, version_number(version), now_ns],
    )?;
    if changed > 0 {
        let entry = AuditEntry {
            site,
            actor: "service",
            action: "publish",
            detail: json!({"version": version}),
        };
        entry.write(transaction, now_ns)?;
        return Ok(Saved::Stored);
    }
    match by_version(transaction, site, version)? {
        Some(_) => Ok(Saved::AlreadyStored),
        None => Err(Trouble::unknown(
            "parameter set",
            format!("{site} version {version}"),
        )),
    }
}

pub(super) fn unpublished(connection: &Connection) -> Result<Vec<StoredSet>, Trouble> {
    list(
        connection,
        &format!("{SELECT} WHERE published_ns IS NULL ORDER BY committed_ns, site, version"),
        [],
    )
}

pub(super) fn in_force(connection: &Connection, site: &str) -> Result<Option<StoredSet>, Trouble> {
    first(
        connection,
        &format!(
            "{SELECT} WHERE site = ?1 AND published_ns IS NOT NULL ORDER BY turn DESC LIMIT 1"
        ),
        [site],
    )
}

pub(super) fn newest(connection: &Connection, site: &str) -> Result<Option<StoredSet>, Trouble> {
    first(
        connection,
        &format!("{SELECT} WHERE site = ?1 ORDER BY turn DESC LIMIT 1"),
        [site],
    )
}

pub(super) fn by_version(
    connection: &Connection,
    site: &str,
    version: u64,
) -> Result<Option<StoredSet>, Trouble> {
    first(
        connection,
        &format!("{SELECT} WHERE site = ?1 AND version = ?2"),
        params![site, version_number(version)],
    )
}

pub(super) fn of_site(
    connection: &Connection,
    site: &str,
    count_max: usize,
) -> Result<Vec<StoredSet>, Trouble> {
    list(
        connection,
        &format!("{SELECT} WHERE site = ?1 ORDER BY version DESC LIMIT ?2"),
        params![site, count(count_max)],
    )
}

fn first(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
) -> Result<Option<StoredSet>, Trouble> {
    Ok(connection
        .prepare_cached(sql)?
        .query_row(parameters, stored_set)
        .optional()?)
}

fn list(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
) -> Result<Vec<StoredSet>, Trouble> {
    let mut statement = connection.prepare_cached(sql)?;
    let rows = statement.query_map(parameters, stored_set)?;
    Ok(rows.collect::<Result<_, _>>()?)
}

fn stored_set(row: &Row<'_>) -> rusqlite::Result<StoredSet> {
    Ok(StoredSet {
        site: row.get(0)?,
        version: row.get::<_, i64>(1)?.unsigned_abs(),
        content_hash: row.get(2)?,
        document: row.get(3)?,
        fit: FitId(row.get(4)?),
        committed_ns: row.get(5)?,
        published_ns: row.get(6)?,
    })
}
