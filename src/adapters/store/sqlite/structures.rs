//! Which model each site is to have.

use rusqlite::{Connection, Params, Row, Transaction, params};
use serde_json::json;

use super::{
    decisions::AuditEntry,
    failure::Trouble,
    windows::{count, site_is_known},
};
use crate::adapters::{
    store::{NewStructure, Origin, Saved, StructureRecord},
    wire::DocumentError,
};

const SELECT: &str =
    "SELECT site, structure, origin, actor, comment, changed_ns FROM structures WHERE site = ?1";

pub(super) fn change(
    transaction: &Transaction<'_>,
    new: &NewStructure<'_>,
    now_ns: i64,
) -> Result<(StructureRecord, Saved), Trouble> {
    site_is_known(transaction, new.site)?;
    let current = newest(transaction, new.site, None)?;
    let before = current.as_ref().map_or(&[][..], |record| &record.structure);
    let structure = new.change.applied_to(before)?.names();
    // What the configuration says is noted even where it is what somebody else said before: the
    // next start is to see that it has not changed.
    if let Some(known) = &current
        && known.structure == structure
        && (new.origin != Origin::Configuration || known.origin == Origin::Configuration)
    {
        return Ok((known.clone(), Saved::AlreadyStored));
    }
    transaction.execute(
        "INSERT INTO structures (site, structure, origin, actor, comment, changed_ns)
         VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
        params![
            new.site,
            names(&structure),
            new.origin.name(),
            new.actor,
            new.comment,
            now_ns
        ],
    )?;
    let entry = AuditEntry {
        site: new.site,
        actor: new.actor,
        action: "change_structure",
        detail: json!({
            "before": before,
            "after": structure,
            "origin": new.origin.name(),
            "comment": new.comment,
        }),
    };
    entry.write(transaction, now_ns)?;
    let record = StructureRecord {
        site: new.site.to_owned(),
        structure,
        origin: new.origin,
        actor: new.actor.to_owned(),
        comment: new.comment.to_owned(),
        changed_ns: now_ns,
    };
    Ok((record, Saved::Stored))
}

pub(super) fn newest(
    connection: &Connection,
    site: &str,
    origin: Option<Origin>,
) -> Result<Option<StructureRecord>, Trouble> {
    let found = list(
        connection,
        &format!("{SELECT} AND (?2 IS NULL OR origin = ?2) ORDER BY id DESC LIMIT 1"),
        params![site, origin.map(Origin::name)],
    )?;
    Ok(found.into_iter().next())
}

pub(super) fn of_site(
    connection: &Connection,
    site: &str,
    count_max: usize,
) -> Result<Vec<StructureRecord>, Trouble> {
    list(
        connection,
        &format!("{SELECT} ORDER BY id DESC LIMIT ?2"),
        params![site, count(count_max)],
    )
}

/// Names as the database keeps them.
pub(super) fn names(names: &[String]) -> String {
    json!(names).to_string()
}

/// The names again.
pub(super) fn names_of(text: &str) -> Result<Vec<String>, DocumentError> {
    serde_json::from_str(text).map_err(|source| DocumentError::Malformed {
        document: "list of names",
        source,
    })
}

fn list(
    connection: &Connection,
    sql: &str,
    parameters: impl Params,
) -> Result<Vec<StructureRecord>, Trouble> {
    let mut statement = connection.prepare_cached(sql)?;
    let mut rows = statement.query(parameters)?;
    let mut records = Vec::new();
    while let Some(row) = rows.next()? {
        records.push(record(row)?);
    }
    Ok(records)
}

fn record(row: &Row<'_>) -> Result<StructureRecord, Trouble> {
    let (structure, origin): (String, String) = (row.get(1)?, row.get(2)?);
    Ok(StructureRecord {
        site: row.get(0)?,
        structure: names_of(&structure)?,
        origin: origin_named(origin)?,
        actor: row.get(3)?,
        comment: row.get(4)?,
        changed_ns: row.get(5)?,
    })
}

fn origin_named(word: String) -> Result<Origin, DocumentError> {
    Origin::named(&word).ok_or_else(|| DocumentError::UnknownWord {
        document: "structure",
        field: "origin",
        found: word,
        known: Origin::ALL.map(Origin::name).join(", "),
    })
}
