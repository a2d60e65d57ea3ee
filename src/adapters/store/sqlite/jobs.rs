//! The queue of jobs with leases.

use rusqlite::{
    Connection, OptionalExtension, Row, Transaction, named_params, params, params_from_iter,
    types::Value,
};

use super::{
    failure::Trouble,
    windows::{count, site_is_known},
};
use crate::adapters::{
    store::{
        ClaimRequest, Enqueued, Job, JobFailure, JobId, JobKind, JobState, Lease, LeaseAnswer,
        NewJob,
    },
    wire::DocumentError,
};

const COLUMNS: &str = "id, claim, kind, site, subject, inputs_hash, state, failures, \
                       interruptions, last_error, enqueued_ns";

/// Longest error or outcome kept with a job, characters; the rest is cut.
const TEXT_CHARACTERS_MAX: usize = 4_000;

pub(super) fn enqueue(
    transaction: &Transaction<'_>,
    job: &NewJob<'_>,
    now_ns: i64,
) -> Result<Enqueued, Trouble> {
    site_is_known(transaction, job.site)?;
    let known = transaction
        .prepare_cached(
            "SELECT id, state FROM jobs WHERE kind = ?1 AND subject = ?2 AND inputs_hash = ?3",
        )?
        .query_row(
            params![job.kind.name(), job.subject, job.inputs_hash],
            |row| Ok((row.get::<_, i64>(0)?, row.get::<_, String>(1)?)),
        )
        .optional()?;
    let enqueued = match known {
        None => Enqueued::Added(insert(transaction, job, now_ns)?),
        Some((id, state)) => match state_named(&state)? {
            JobState::Superseded => {
                transaction.execute(
                    "UPDATE jobs SET state = 'queued', due_ns = ?2, ended_ns = NULL WHERE id = ?1",
                    params![id, job.due_ns],
                )?;
                Enqueued::Known(JobId(id), JobState::Queued)
            }
            state => return Ok(Enqueued::Known(JobId(id), state)),
        },
    };
    let (Enqueued::Added(id) | Enqueued::Known(id, _)) = enqueued;
    transaction.execute(
        "UPDATE jobs SET state = 'superseded', ended_ns = ?4
         WHERE kind = ?1 AND subject = ?2 AND state = 'queued' AND id <> ?3",
        params![job.kind.name(), job.subject, id.0, now_ns],
    )?;
    Ok(enqueued)
}

fn insert(transaction: &Transaction<'_>, job: &NewJob<'_>, now_ns: i64) -> Result<JobId, Trouble> {
    transaction.execute(
        "INSERT INTO jobs (kind, site, subject, inputs_hash, state, due_ns, enqueued_ns)
         VALUES (?1, ?2, ?3, ?4, 'queued', ?5, ?6)",
        params![
            job.kind.name(),
            job.site,
            job.subject,
            job.inputs_hash,
            job.due_ns,
            now_ns
        ],
    )?;
    Ok(JobId(transaction.last_insert_rowid()))
}

pub(super) fn claim(
    transaction: &Transaction<'_>,
    request: &ClaimRequest<'_>,
) -> Result<Option<Job>, Trouble> {
    park_interrupted(transaction, request)?;
    let places = vec!["?"; request.kinds.len()].join(", ");
    let mut values: Vec<Value> = vec![
        request.worker.to_owned().into(),
        request.lease_until_ns.into(),
        request.now_ns.into(),
    ];
    values.extend(
        request
            .kinds
            .iter()
            .map(|kind| kind.name().to_owned().into()),
    );
    // A job that is still claimed here is one whose lease has ended.
    let claimed = transaction
        .prepare_cached(&format!(
            "UPDATE jobs SET
                 interruptions = interruptions + (state = 'claimed'),
                 state = 'claimed', worker = ?1, lease_until_ns = ?2, claim = claim + 1
             WHERE id = (
                 SELECT id FROM jobs
                 WHERE ((state = 'queued' AND due_ns <= ?3)
                        OR (state = 'claimed' AND lease_until_ns <= ?3))
                   AND kind IN ({places})
                 ORDER BY kind = '{last}', id LIMIT 1)
             RETURNING {COLUMNS}",
            last = JobKind::DiagnoseSite.name()
        ))?
        .query_row(params_from_iter(values), stored_job)
        .optional()?;
    claimed.map(StoredJob::understand).transpose()
}

/// Parks what has cost too many holders: such a job may be what kills them.
fn park_interrupted(
    transaction: &Transaction<'_>,
    request: &ClaimRequest<'_>,
) -> Result<(), Trouble> {
    transaction.execute(
        "UPDATE jobs SET
             interruptions = interruptions + (state = 'claimed'),
             last_error = 'its holder disappeared '
                 || (interruptions + (state = 'claimed')) || ' times',
             state = 'parked', worker = NULL, lease_until_ns = NULL, ended_ns = :now_ns
         WHERE (state = 'claimed' AND lease_until_ns <= :now_ns AND interruptions + 1 >= :max)
            OR (state = 'queued' AND interruptions >= :max)",
        named_params! {":now_ns": request.now_ns, ":max": request.interruptions_max},
    )?;
    Ok(())
}

pub(super) fn heartbeat(
    transaction: &Transaction<'_>,
    lease: &Lease,
    until_ns: i64,
) -> Result<LeaseAnswer, Trouble> {
    let changed = transaction.execute(
        "UPDATE jobs SET lease_until_ns = ?3 WHERE id = ?1 AND claim = ?2 AND state = 'claimed'",
        params![lease.job.0, claim_number(lease), until_ns],
    )?;
    Ok(answer(changed))
}

pub(super) fn complete(
    transaction: &Transaction<'_>,
    lease: &Lease,
    outcome: &str,
    now_ns: i64,
) -> Result<LeaseAnswer, Trouble> {
    let changed = transaction.execute(
        "UPDATE jobs SET state = 'done', outcome = ?3, ended_ns = ?4,
             worker = NULL, lease_until_ns = NULL
         WHERE id = ?1 AND claim = ?2 AND state = 'claimed'",
        params![lease.job.0, claim_number(lease), cut(outcome), now_ns],
    )?;
    Ok(answer(changed))
}

pub(super) fn fail(
    transaction: &Transaction<'_>,
    lease: &Lease,
    failure: &JobFailure<'_>,
    now_ns: i64,
) -> Result<LeaseAnswer, Trouble> {
    let state = transaction
        .prepare_cached(
            "UPDATE jobs SET
                 failures = failures + 1, last_error = :error, due_ns = :retry_at_ns,
                 state = CASE WHEN failures + 1 >= :max THEN 'parked' ELSE 'queued' END,
                 ended_ns = CASE WHEN failures + 1 >= :max THEN :now_ns END,
                 worker = NULL, lease_until_ns = NULL
             WHERE id = :id AND claim = :claim AND state = 'claimed'
             RETURNING state",
        )?
        .query_row(
            named_params! {
                ":id": lease.job.0,
                ":claim": claim_number(lease),
                ":error": cut(failure.error),
                ":retry_at_ns": failure.retry_at_ns,
                ":max": failure.failures_max,
                ":now_ns": now_ns,
            },
            |row| row.get::<_, String>(0),
        )
        .optional()?;
    Ok(match state.as_deref() {
        None => LeaseAnswer::Lost,
        Some("parked") => LeaseAnswer::Parked,
        Some(_) => LeaseAnswer::Held,
    })
}

pub(super) fn release(
    transaction: &Transaction<'_>,
    lease: &Lease,
    now_ns: i64,
) -> Result<LeaseAnswer, Trouble> {
    let changed = transaction.execute(
        "UPDATE jobs SET state = 'queued', due_ns = ?3, worker = NULL, lease_until_ns = NULL
         WHERE id = ?1 AND claim = ?2 AND state = 'claimed'",
        params![lease.job.0, claim_number(lease), now_ns],
    )?;
    Ok(answer(changed))
}

pub(super) fn release_leases_of(
    transaction: &Transaction<'_>,
    worker: &str,
    now_ns: i64,
) -> Result<usize, Trouble> {
    Ok(transaction.execute(
        "UPDATE jobs SET state = 'queued', due_ns = ?2, interruptions = interruptions + 1,
             worker = NULL, lease_until_ns = NULL
         WHERE worker = ?1 AND state = 'claimed'",
        params![worker, now_ns],
    )?)
}

pub(super) fn parked(connection: &Connection, count_max: usize) -> Result<Vec<Job>, Trouble> {
    let mut statement = connection.prepare_cached(&format!(
        "SELECT {COLUMNS} FROM jobs WHERE state = 'parked' ORDER BY id DESC LIMIT ?1"
    ))?;
    let rows = statement.query_map([count(count_max)], stored_job)?;
    rows.map(|row| row.map_err(Trouble::from).and_then(StoredJob::understand))
        .collect()
}

const fn answer(changed: usize) -> LeaseAnswer {
    if changed > 0 {
        LeaseAnswer::Held
    } else {
        LeaseAnswer::Lost
    }
}

/// A number beyond SQLite's integers was never handed out, and matches nothing.
fn claim_number(lease: &Lease) -> i64 {
    i64::try_from(lease.claim).unwrap_or(-1)
}

fn cut(text: &str) -> String {
    text.chars().take(TEXT_CHARACTERS_MAX).collect()
}

/// A job whose words have not been looked up yet.
struct StoredJob {
    id: i64,
    claim: i64,
    kind: String,
    site: String,
    subject: String,
    inputs_hash: String,
    state: String,
    failures: u32,
    interruptions: u32,
    last_error: Option<String>,
    enqueued_ns: i64,
}

fn stored_job(row: &Row<'_>) -> rusqlite::Result<StoredJob> {
    Ok(StoredJob {
        id: row.get(0)?,
        claim: row.get(1)?,
        kind: row.get(2)?,
        site: row.get(3)?,
        subject: row.get(4)?,
        inputs_hash: row.get(5)?,
        state: row.get(6)?,
        failures: row.get(7)?,
        interruptions: row.get(8)?,
        last_error: row.get(9)?,
        enqueued_ns: row.get(10)?,
    })
}

impl StoredJob {
    fn understand(self) -> Result<Job, Trouble> {
        Ok(Job {
            lease: Lease {
                job: JobId(self.id),
                claim: u64::try_from(self.claim).unwrap_or(0),
            },
            kind: kind_named(&self.kind)?,
            state: state_named(&self.state)?,
            site: self.site,
            subject: self.subject,
            inputs_hash: self.inputs_hash,
            failures: self.failures,
            interruptions: self.interruptions,
            last_error: self.last_error,
            enqueued_ns: self.enqueued_ns,
        })
    }
}

pub(super) fn kind_named(word: &str) -> Result<JobKind, DocumentError> {
    JobKind::named(word).ok_or_else(|| DocumentError::UnknownWord {
        document: "job",
        field: "kind",
        found: word.to_owned(),
        known: JobKind::ALL.map(JobKind::name).join(", "),
    })
}

fn state_named(word: &str) -> Result<JobState, DocumentError> {
    JobState::named(word).ok_or_else(|| DocumentError::UnknownWord {
        document: "job",
        field: "state",
        found: word.to_owned(),
        known: JobState::ALL.map(JobState::name).join(", "),
    })
}
