//! Decisions with their evidence, approvals, and the audit trail.

use rusqlite::{Connection, OptionalExtension, Params, Row, Transaction, named_params, params};
use serde_json::json;

use super::{
    failure::Trouble,
    sets::{assign_version, version_number},
    windows::count,
};
use crate::{
    adapters::{
        store::{
            Answer, Approval, CommittedDecision, DecisionId, DecisionRecord, FitId, NewDecision,
            Saved,
        },
        wire::{
            DocumentError,
            v1::{DecisionV1, EvidenceV1, decode_parameter_set},
        },
    },
    identification::Decision,
};

const SELECT: &str = "SELECT id, site, fit_id, document, awaiting, version, evidence, actor, \
                      decided_ns, approved, approver, comment, approval_ns FROM decisions";

pub(super) fn commit(
    transaction: &Transaction<'_>,
    new: &NewDecision<'_>,
    now_ns: i64,
) -> Result<CommittedDecision, Trouble> {
    if let Some(known) = of_fit(transaction, new.fit)? {
        return Ok(known);
    }
    let candidate = candidate(transaction, new.fit)?;
    let evidence = EvidenceV1::new(
        &decode_parameter_set(&candidate.document)?,
        &candidate.content_hash,
        new.in_force,
    );
    let publish = matches!(
        new.decision,
        Decision::Publish { .. } | Decision::PublishUnvalidated { .. }
    );
    let version = publish
        .then(|| assign_version(transaction, &candidate, now_ns))
        .transpose()?;
    let document = json_text(&DecisionV1::from(new.decision))?;
    transaction.execute(
        "INSERT INTO decisions (fit_id, site, document, evidence, actor, decided_ns, awaiting,
             version)
         VALUES (:fit_id, :site, :document, :evidence, :actor, :decided_ns, :awaiting, :version)",
        named_params! {
            ":fit_id": new.fit.0,
            ":site": candidate.site,
            ":document": document,
            ":evidence": json_text(&evidence)?,
            ":actor": new.actor,
            ":decided_ns": now_ns,
            ":awaiting": matches!(new.decision, Decision::AwaitApproval { .. }),
            ":version": version.map(version_number),
        },
    )?;
    let id = transaction.last_insert_rowid();
    let entry = AuditEntry {
        site: &candidate.site,
        actor: new.actor,
        action: "decide",
        detail: json!({"decision": id, "fit": new.fit.0, "version": version, "what": document}),
    };
    entry.write(transaction, now_ns)?;
    Ok(CommittedDecision {
        id: DecisionId(id),
        version,
        saved: Saved::Stored,
    })
}

pub(super) fn approve(
    transaction: &Transaction<'_>,
    approval: &Approval<'_>,
    now_ns: i64,
) -> Result<CommittedDecision, Trouble> {
    let id = approval.decision;
    let (fit, awaiting, approved, version) = transaction
        .prepare_cached("SELECT fit_id, awaiting, approved, version FROM decisions WHERE id = ?1")?
        .query_row([id.0], |row| {
            let fit = FitId(row.get(0)?);
            let awaiting: bool = row.get(1)?;
            let approved: Option<bool> = row.get(2)?;
            let version: Option<i64> = row.get(3)?;
            Ok((fit, awaiting, approved, version))
        })
        .optional()?
        .ok_or_else(|| Trouble::unknown("decision", id.0.to_string()))?;
    if !awaiting && approved == Some(approval.approved) {
        return Ok(CommittedDecision {
            id,
            version: version.map(i64::unsigned_abs),
            saved: Saved::AlreadyStored,
        });
    }
    if !awaiting {
        return Err(Trouble::unknown("waiting decision", id.0.to_string()));
    }
    let candidate = candidate(transaction, fit)?;
    let version = approval
        .approved
        .then(|| assign_version(transaction, &candidate, now_ns))
        .transpose()?;
    transaction.execute(
        "UPDATE decisions SET awaiting = 0, approved = ?2, approver = ?3, approval_ns = ?4,
             comment = ?5, version = ?6
         WHERE id = ?1",
        params![
            id.0,
            approval.approved,
            approval.actor,
            now_ns,
            approval.comment,
            version.map(version_number)
        ],
    )?;
    let entry = AuditEntry {
        site: &candidate.site,
        actor: approval.actor,
        action: if approval.approved {
            "approve"
        } else {
            "refuse"
        },
        detail: json!({"decision": id.0, "version": version, "comment": approval.comment}),
    };
    entry.write(transaction, now_ns)?;
    Ok(CommittedDecision {
        id,
        version,
        saved: Saved::Stored,
    })
}

pub(super) fn by_id(
    connection: &Connection,
    id: DecisionId,
) -> Result<Option<DecisionRecord>, Trouble> {
    let found = list(connection, &format!("{SELECT} WHERE id = ?1"), [id.0])?;
    Ok(found.into_iter().next())
}

pub(super) fn of_site(
    connection: &Connection,
    site: &str,
    count_max: usize,
) -> Result<Vec<DecisionRecord>, Trouble> {
    list(
        connection,
        &format!("{SELECT} WHERE site = ?1 ORDER BY id DESC LIMIT ?2"),
        params![site, count(count_max)],
    )
}

pub(super) fn awaiting(
    connection: &Connection,
    count_max: usize,
) -> Result<Vec<DecisionRecord>, Trouble> {
    list(
        connection,
        &format!("{SELECT} WHERE awaiting = 1 ORDER BY id LIMIT ?1"),
        [count(count_max)],
    )
}

/// One entry of the audit trail.
pub(super) struct AuditEntry<'a> {
    pub(super) site: &'a str,
    pub(super) actor: &'a str,
    pub(super) action: &'a str,
    pub(super) detail: serde_json::Value,
}

impl AuditEntry<'_> {
    pub(super) fn write(&self, transaction: &Transaction<'_>, now_ns: i64) -> Result<(), Trouble> {
        transaction.execute(
            "INSERT INTO audit (at_ns, site, actor, action, detail) VALUES (?1, ?2, ?3, ?4, ?5)",
            params![
                now_ns,
                self.site,
                self.actor,
                self.action,
                self.detail.to_string()
            ],
        )?;
        Ok(())
    }
}

/// What a decision is about.
pub(super) struct CandidateSet {
    pub(super) fit: FitId,
    pub(super) site: String,
    pub(super) content_hash: String,
    pub(super) document: String,
}

fn candidate(transaction: &Transaction<'_>, fit: FitId) -> Result<CandidateSet, Trouble> {
    transaction
        .prepare_cached(
            "SELECT site, content_hash, set_document FROM fits
             WHERE id = ?1 AND set_document IS NOT NULL",
        )?
        .query_row([fit.0], |row| {
            Ok(CandidateSet {
                fit,
                site: row.get(0)?,
                content_hash: row.get(1)?,
                document: row.get(2)?,
            })
        })
        .optional()?
        .ok_or_else(|| Trouble::unknown("fit", fit.0.to_string()))
}

fn of_fit(transaction: &Transaction<'_>, fit: FitId) -> Result<Option<CommittedDecision>, Trouble> {
    Ok(transaction
        .prepare_cached("SELECT id, version FROM decisions WHERE fit_id = ?1")?
        .query_row([fit.0], |row| {
            Ok(CommittedDecision {
                id: DecisionId(row.get(0)?),
                version: row.get::<_, Option<i64>>(1)?.map(i64::unsigned_abs),
                saved: Saved::AlreadyStored,
            })
        })
        .optional()?)
}

fn list(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
) -> Result<Vec<DecisionRecord>, Trouble> {
    let mut statement = connection.prepare_cached(sql)?;
    let rows = statement.query_map(parameters, |row| Ok((record(row)?, row.get(3)?)))?;
    rows.map(|row| {
        let (record, document): (DecisionRecord, String) = row?;
        let decision: DecisionV1 = serde_json::from_str(&document).map_err(malformed)?;
        Ok(DecisionRecord {
            decision: decision.into(),
            ..record
        })
    })
    .collect()
}

/// The record but for the decision itself, which is a document.
fn record(row: &Row<'_>) -> rusqlite::Result<DecisionRecord> {
    Ok(DecisionRecord {
        id: DecisionId(row.get(0)?),
        site: row.get(1)?,
        fit: FitId(row.get(2)?),
        decision: Decision::Reject {
            reason: String::new(),
        },
        awaiting_approval: row.get(4)?,
        version: row.get::<_, Option<i64>>(5)?.map(i64::unsigned_abs),
        evidence: row.get(6)?,
        actor: row.get(7)?,
        decided_ns: row.get(8)?,
        answer: answer(row)?,
    })
}

/// Columns 9 to 12; none until a person has answered.
fn answer(row: &Row<'_>) -> rusqlite::Result<Option<Answer>> {
    let Some(approved) = row.get(9)? else {
        return Ok(None);
    };
    let text =
        |column| Ok::<_, rusqlite::Error>(row.get::<_, Option<_>>(column)?.unwrap_or_default());
    Ok(Some(Answer {
        approved,
        actor: text(10)?,
        comment: text(11)?,
        answered_ns: row.get::<_, Option<_>>(12)?.unwrap_or_default(),
    }))
}

fn json_text(document: &impl serde::Serialize) -> Result<String, Trouble> {
    Ok(serde_json::to_string(document).map_err(malformed)?)
}

fn malformed(source: serde_json::Error) -> DocumentError {
    DocumentError::Malformed {
        document: "decision",
        source,
    }
}
