//! Diagnoses, and whether they have been published.

use rusqlite::{Connection, OptionalExtension, Params, Row, Transaction, named_params, params};
use serde_json::json;

use super::{
    decisions::AuditEntry,
    failure::Trouble,
    sets::version_number,
    structures::{names, names_of},
    windows::{count, site_is_known},
};
use crate::adapters::{
    store::{NewDiagnosis, Saved, StoredDiagnosis},
    wire::v1::DiagnosisV1,
};

const SELECT: &str = "SELECT site, version, inputs_hash, structure, status, summary, answer_set, \
                      error_to_noise, stored_ns, published_ns, document FROM diagnoses";

pub(super) fn save(
    transaction: &Transaction<'_>,
    new: &NewDiagnosis<'_>,
    now_ns: i64,
) -> Result<(u64, Saved), Trouble> {
    site_is_known(transaction, new.site)?;
    if let Some(known) = by_inputs(transaction, new.site, new.inputs_hash)? {
        return Ok((known.version, Saved::AlreadyStored));
    }
    let version = next_version(transaction, new.site)?;
    let document = DiagnosisV1::new(new.diagnosis, version);
    insert(transaction, new.inputs_hash, &document, now_ns)?;
    Ok((version, Saved::Stored))
}

/// Copies a diagnosis under the next number, so that the newest one is that of the structure that
/// somebody came back to.
pub(super) fn repeat(
    transaction: &Transaction<'_>,
    site: &str,
    version: u64,
    inputs_hash: &str,
    now_ns: i64,
) -> Result<(u64, Saved), Trouble> {
    if let Some(known) = by_inputs(transaction, site, inputs_hash)? {
        return Ok((known.version, Saved::AlreadyStored));
    }
    let stored = by_version(transaction, site, version)?;
    let kept = stored.map(|stored| stored.diagnosis()).transpose()?;
    let mut document = kept
        .flatten()
        .ok_or_else(|| Trouble::unknown("diagnosis", format!("{site} version {version}")))?;
    document.version = next_version(transaction, site)?;
    insert(transaction, inputs_hash, &document, now_ns)?;
    Ok((document.version, Saved::Stored))
}

fn next_version(transaction: &Transaction<'_>, site: &str) -> Result<u64, Trouble> {
    let newest: i64 = transaction
        .prepare_cached("SELECT coalesce(max(version), 0) FROM diagnoses WHERE site = ?1")?
        .query_row([site], |row| row.get(0))?;
    Ok(newest.unsigned_abs() + 1)
}

fn insert(
    transaction: &Transaction<'_>,
    inputs_hash: &str,
    document: &DiagnosisV1,
    now_ns: i64,
) -> Result<(), Trouble> {
    transaction.execute(
        "INSERT INTO diagnoses (site, version, inputs_hash, structure, status, summary,
             answer_set, error_to_noise, stored_ns, document)
         VALUES (:site, :version, :inputs_hash, :structure, :status, :summary,
             :answer_set, :error_to_noise, :stored_ns, :document)",
        named_params! {
            ":site": document.site,
            ":version": version_number(document.version),
            ":inputs_hash": inputs_hash,
            ":structure": names(&document.structure),
            ":status": document.status,
            ":summary": document.summary,
            ":answer_set": names(&document.answer_set),
            // A NaN is stored as null by SQLite itself.
            ":error_to_noise": document.error_to_noise,
            ":stored_ns": now_ns,
            ":document": document.to_json()?,
        },
    )?;
    Ok(())
}

pub(super) fn mark_published(
    transaction: &Transaction<'_>,
    site: &str,
    version: u64,
    now_ns: i64,
) -> Result<Saved, Trouble> {
    let changed = transaction.execute(
        "UPDATE diagnoses SET published_ns = ?3
         WHERE site = ?1 AND version = ?2 AND published_ns IS NULL",
        params![site, version_number(version), now_ns],
    )?;
    if changed > 0 {
        let entry = AuditEntry {
            site,
            actor: "service",
            action: "publish_diagnosis",
            detail: json!({"version": version}),
        };
        entry.write(transaction, now_ns)?;
        return Ok(Saved::Stored);
    }
    match by_version(transaction, site, version)? {
        Some(_) => Ok(Saved::AlreadyStored),
        None => Err(Trouble::unknown(
            "diagnosis",
            format!("{site} version {version}"),
        )),
    }
}

pub(super) fn unpublished(connection: &Connection) -> Result<Vec<StoredDiagnosis>, Trouble> {
    list(
        connection,
        &format!(
            "{SELECT} WHERE published_ns IS NULL AND document IS NOT NULL
             ORDER BY stored_ns, site, version"
        ),
        [],
    )
}

pub(super) fn by_version(
    connection: &Connection,
    site: &str,
    version: u64,
) -> Result<Option<StoredDiagnosis>, Trouble> {
    first(
        connection,
        &format!("{SELECT} WHERE site = ?1 AND version = ?2"),
        params![site, version_number(version)],
    )
}

pub(super) fn by_inputs(
    connection: &Connection,
    site: &str,
    inputs_hash: &str,
) -> Result<Option<StoredDiagnosis>, Trouble> {
    first(
        connection,
        &format!("{SELECT} WHERE site = ?1 AND inputs_hash = ?2"),
        params![site, inputs_hash],
    )
}

pub(super) fn newest(
    connection: &Connection,
    site: &str,
) -> Result<Option<StoredDiagnosis>, Trouble> {
    first(
        connection,
        &format!("{SELECT} WHERE site = ?1 ORDER BY version DESC LIMIT 1"),
        [site],
    )
}

pub(super) fn of_site(
    connection: &Connection,
    site: &str,
    count_max: usize,
) -> Result<Vec<StoredDiagnosis>, Trouble> {
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
) -> Result<Option<StoredDiagnosis>, Trouble> {
    let found = connection
        .prepare_cached(sql)?
        .query_row(parameters, raw)
        .optional()?;
    found.map(understood).transpose()
}

fn list(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
) -> Result<Vec<StoredDiagnosis>, Trouble> {
    let mut statement = connection.prepare_cached(sql)?;
    let rows = statement.query_map(parameters, raw)?;
    rows.map(|row| row.map_err(Trouble::from).and_then(understood))
        .collect()
}

/// A diagnosis whose lists of names have not been read yet.
type Raw = (StoredDiagnosis, String, String);

fn raw(row: &Row<'_>) -> rusqlite::Result<Raw> {
    let stored = StoredDiagnosis {
        site: row.get(0)?,
        version: row.get::<_, i64>(1)?.unsigned_abs(),
        inputs_hash: row.get(2)?,
        structure: Vec::new(),
        status: row.get(4)?,
        summary: row.get(5)?,
        answer_set: Vec::new(),
        error_to_noise: row.get::<_, Option<f64>>(7)?.unwrap_or(f64::NAN),
        stored_ns: row.get(8)?,
        published_ns: row.get(9)?,
        document: row.get(10)?,
    };
    Ok((stored, row.get(3)?, row.get(6)?))
}

fn understood((stored, structure, answer_set): Raw) -> Result<StoredDiagnosis, Trouble> {
    Ok(StoredDiagnosis {
        structure: names_of(&structure)?,
        answer_set: names_of(&answer_set)?,
        ..stored
    })
}
