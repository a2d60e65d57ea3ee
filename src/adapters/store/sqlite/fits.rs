//! Fits with all their solutions and directions, and their validations.

use rusqlite::{Connection, OptionalExtension, Params, Row, Transaction, named_params, params};

use super::{
    failure::Trouble,
    jobs::kind_named,
    windows::{count, site_is_known},
};
use crate::{
    adapters::{
        store::{FitId, JobKind, NewFit, Saved, StoredFit},
        wire::{
            DocumentError,
            v1::{IdentificationV1, VerdictV1, encode_parameter_set, verdict_status_named},
        },
    },
    identification::ParameterSet,
};

const SELECT: &str = "SELECT f.id, f.kind, f.site, f.subject, f.inputs_hash, f.structure, \
                      f.content_hash, v.status, f.stored_ns, f.set_document, f.document \
                      FROM fits f JOIN validations v ON v.fit_id = f.id";

/// The documents of a fit, written before the transaction is held any longer than it must be.
struct Documents {
    structure: String,
    content_hash: String,
    set: String,
    verdict: String,
    whole: String,
}

impl Documents {
    fn new(fit: &NewFit<'_>) -> Result<Self, DocumentError> {
        // Versions are given to what is published; a fit has none.
        let set = ParameterSet {
            version: 0,
            ..fit.identification.set.clone()
        };
        let whole = IdentificationV1::new(fit.identification)?;
        let malformed = |source| DocumentError::Malformed {
            document: "fit",
            source,
        };
        Ok(Self {
            structure: serde_json::to_string(&set.structure).map_err(malformed)?,
            content_hash: whole.set.content_hash.clone(),
            set: encode_parameter_set(&set)?,
            verdict: serde_json::to_string(&VerdictV1::from(&set.verdict)).map_err(malformed)?,
            whole: whole.to_json()?,
        })
    }
}

pub(super) fn save(
    transaction: &Transaction<'_>,
    fit: &NewFit<'_>,
    now_ns: i64,
) -> Result<(FitId, Saved), Trouble> {
    site_is_known(transaction, fit.site)?;
    let known = transaction
        .prepare_cached(
            "SELECT id, document IS NULL FROM fits
             WHERE kind = ?1 AND subject = ?2 AND inputs_hash = ?3",
        )?
        .query_row(
            params![fit.kind.name(), fit.subject, fit.inputs_hash],
            |row| Ok((row.get::<_, i64>(0)?, row.get::<_, bool>(1)?)),
        )
        .optional()?;
    match known {
        Some((id, false)) => Ok((FitId(id), Saved::AlreadyStored)),
        Some((id, true)) => {
            let documents = Documents::new(fit)?;
            refill(transaction, id, &documents)?;
            Ok((FitId(id), Saved::Stored))
        }
        None => {
            let documents = Documents::new(fit)?;
            let id = insert(transaction, fit, &documents, now_ns)?;
            insert_events(transaction, id, &fit.identification.set)?;
            Ok((FitId(id), Saved::Stored))
        }
    }
}

fn insert(
    transaction: &Transaction<'_>,
    fit: &NewFit<'_>,
    documents: &Documents,
    now_ns: i64,
) -> Result<i64, Trouble> {
    let set = &fit.identification.set;
    transaction.execute(
        "INSERT INTO fits (kind, site, subject, inputs_hash, structure, content_hash,
             eps_p_percent, eps_q_percent, error_to_noise, solution_count, stored_ns,
             set_document, document)
         VALUES (:kind, :site, :subject, :inputs_hash, :structure, :content_hash,
             :eps_p_percent, :eps_q_percent, :error_to_noise, :solution_count, :stored_ns,
             :set_document, :document)",
        named_params! {
            ":kind": fit.kind.name(),
            ":site": fit.site,
            ":subject": fit.subject,
            ":inputs_hash": fit.inputs_hash,
            ":structure": documents.structure,
            ":content_hash": documents.content_hash,
            ":eps_p_percent": set.fit.eps_p_percent,
            ":eps_q_percent": set.fit.eps_q_percent,
            ":error_to_noise": set.fit.error_to_noise,
            ":solution_count": count(fit.identification.solutions.len()),
            ":stored_ns": now_ns,
            ":set_document": documents.set,
            ":document": documents.whole,
        },
    )?;
    let id = transaction.last_insert_rowid();
    transaction.execute(
        "INSERT INTO validations (fit_id, status, document) VALUES (?1, ?2, ?3)",
        params![
            id,
            crate::adapters::wire::v1::verdict_status_name(set.verdict.status),
            documents.verdict
        ],
    )?;
    Ok(id)
}

/// Puts back what retention took: the same fit was made again.
fn refill(transaction: &Transaction<'_>, id: i64, documents: &Documents) -> Result<(), Trouble> {
    transaction.execute(
        "UPDATE fits SET set_document = ?2, document = ?3, content_hash = ?4 WHERE id = ?1",
        params![id, documents.set, documents.whole, documents.content_hash],
    )?;
    Ok(())
}

fn insert_events(
    transaction: &Transaction<'_>,
    id: i64,
    set: &ParameterSet,
) -> Result<(), Trouble> {
    let mut statement = transaction.prepare_cached(
        "INSERT INTO fit_events (fit_id, window_id, role) VALUES (?1, ?2, ?3)
         ON CONFLICT DO NOTHING",
    )?;
    for (events, role) in [
        (&set.fitted_events, "fitted"),
        (&set.held_out_events, "held_out"),
    ] {
        for event in events {
            statement.execute(params![id, event, role])?;
        }
    }
    Ok(())
}

/// Copies a fit with all that belongs to it: decisions and jobs are one per fit and hash, and a
/// request that comes back is to have its own.
pub(super) fn repeat(
    transaction: &Transaction<'_>,
    fit: FitId,
    inputs_hash: &str,
    now_ns: i64,
) -> Result<(FitId, Saved), Trouble> {
    let known = transaction
        .prepare_cached(
            "SELECT k.id FROM fits k JOIN fits f ON k.kind = f.kind AND k.subject = f.subject
             WHERE f.id = ?1 AND k.inputs_hash = ?2",
        )?
        .query_row(params![fit.0, inputs_hash], |row| row.get::<_, i64>(0))
        .optional()?;
    if let Some(id) = known {
        return Ok((FitId(id), Saved::AlreadyStored));
    }
    let copied = transaction.execute(
        "INSERT INTO fits (kind, site, subject, inputs_hash, structure, content_hash,
             eps_p_percent, eps_q_percent, error_to_noise, solution_count, stored_ns,
             set_document, document)
         SELECT kind, site, subject, ?2, structure, content_hash,
             eps_p_percent, eps_q_percent, error_to_noise, solution_count, ?3,
             set_document, document
         FROM fits WHERE id = ?1 AND set_document IS NOT NULL",
        params![fit.0, inputs_hash, now_ns],
    )?;
    if copied == 0 {
        return Err(Trouble::unknown("fit", fit.0.to_string()));
    }
    let id = transaction.last_insert_rowid();
    for sql in [
        "INSERT INTO validations (fit_id, status, document)
         SELECT ?2, status, document FROM validations WHERE fit_id = ?1",
        "INSERT INTO fit_events (fit_id, window_id, role)
         SELECT ?2, window_id, role FROM fit_events WHERE fit_id = ?1",
    ] {
        transaction.execute(sql, params![fit.0, id])?;
    }
    Ok((FitId(id), Saved::Stored))
}

pub(super) fn by_id(connection: &Connection, id: FitId) -> Result<Option<StoredFit>, Trouble> {
    one(connection, &format!("{SELECT} WHERE f.id = ?1"), [id.0])
}

pub(super) fn by_inputs(
    connection: &Connection,
    kind: JobKind,
    subject: &str,
    inputs_hash: &str,
) -> Result<Option<StoredFit>, Trouble> {
    one(
        connection,
        &format!("{SELECT} WHERE f.kind = ?1 AND f.subject = ?2 AND f.inputs_hash = ?3"),
        params![kind.name(), subject, inputs_hash],
    )
}

pub(super) fn of_site(
    connection: &Connection,
    site: &str,
    kind: JobKind,
    count_max: usize,
) -> Result<Vec<StoredFit>, Trouble> {
    let mut statement = connection.prepare_cached(&format!(
        "{SELECT} WHERE f.site = ?1 AND f.kind = ?2 ORDER BY f.id DESC LIMIT ?3"
    ))?;
    let rows = statement.query_map(params![site, kind.name(), count(count_max)], raw_fit)?;
    rows.map(|row| row.map_err(Trouble::from).and_then(RawFit::understand))
        .collect()
}

fn one(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
) -> Result<Option<StoredFit>, Trouble> {
    let found = connection
        .prepare_cached(sql)?
        .query_row(parameters, raw_fit)
        .optional()?;
    found.map(RawFit::understand).transpose()
}

/// A fit whose words have not been looked up yet.
struct RawFit {
    id: i64,
    kind: String,
    site: String,
    subject: String,
    inputs_hash: String,
    structure: String,
    content_hash: String,
    verdict: String,
    stored_ns: i64,
    set_document: Option<String>,
    document: Option<String>,
}

fn raw_fit(row: &Row<'_>) -> rusqlite::Result<RawFit> {
    Ok(RawFit {
        id: row.get(0)?,
        kind: row.get(1)?,
        site: row.get(2)?,
        subject: row.get(3)?,
        inputs_hash: row.get(4)?,
        structure: row.get(5)?,
        content_hash: row.get(6)?,
        verdict: row.get(7)?,
        stored_ns: row.get(8)?,
        set_document: row.get(9)?,
        document: row.get(10)?,
    })
}

impl RawFit {
    fn understand(self) -> Result<StoredFit, Trouble> {
        let structure =
            serde_json::from_str(&self.structure).map_err(|source| DocumentError::Malformed {
                document: "structure of a fit",
                source,
            })?;
        Ok(StoredFit {
            id: FitId(self.id),
            kind: kind_named(&self.kind)?,
            structure,
            verdict: verdict_status_named(&self.verdict)?,
            site: self.site,
            subject: self.subject,
            inputs_hash: self.inputs_hash,
            content_hash: self.content_hash,
            stored_ns: self.stored_ns,
            set_document: self.set_document,
            document: self.document,
        })
    }
}
