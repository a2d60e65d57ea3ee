//! Sites, windows, waveforms, screenings.

use rusqlite::{Connection, OptionalExtension, Row, Transaction, named_params, params};

use super::failure::{Trouble, refers_to_nothing};
use crate::{
    adapters::{
        store::{Saved, WindowQuery, WindowSummary, WindowTally},
        wire::{
            DocumentError,
            v1::{
                ScreeningV1, closing_name, closing_named, decode_waveforms, encode_waveforms,
                trigger_name, trigger_named,
            },
        },
    },
    disturbance::{Screening, Trigger, Window},
    measurement::{Progress, Site},
};

pub(super) fn save_site(
    transaction: &Transaction<'_>,
    site: &Site,
    now_ns: i64,
) -> Result<(), Trouble> {
    transaction.execute(
        "INSERT INTO sites (name, s_base_mva, v_base_kv, nominal_hz, updated_ns)
         VALUES (?1, ?2, ?3, ?4, ?5)
         ON CONFLICT (name) DO UPDATE SET
             s_base_mva = excluded.s_base_mva, v_base_kv = excluded.v_base_kv,
             nominal_hz = excluded.nominal_hz, updated_ns = excluded.updated_ns",
        params![
            site.name,
            site.s_base_mva,
            site.v_base_kv,
            site.nominal_hz,
            now_ns
        ],
    )?;
    Ok(())
}

pub(super) fn sites(connection: &Connection) -> Result<Vec<Site>, Trouble> {
    let mut statement = connection.prepare_cached(
        "SELECT name, s_base_mva, v_base_kv, nominal_hz FROM sites ORDER BY name",
    )?;
    let sites = statement.query_map([], |row| {
        Ok(Site {
            name: row.get(0)?,
            s_base_mva: row.get(1)?,
            v_base_kv: row.get(2)?,
            nominal_hz: row.get(3)?,
        })
    })?;
    Ok(sites.collect::<Result<_, _>>()?)
}

pub(super) fn save_progress(
    transaction: &Transaction<'_>,
    progress: &[(String, Progress)],
) -> Result<(), Trouble> {
    for (site, progress) in progress {
        site_is_known(transaction, site)?;
        transaction
            .prepare_cached(
                "INSERT INTO progress (site, newest_ns, rate_fps) VALUES (?1, ?2, ?3)
                 ON CONFLICT (site) DO UPDATE SET
                     newest_ns = excluded.newest_ns, rate_fps = excluded.rate_fps",
            )?
            .execute(params![site, progress.newest_ns, progress.rate_fps])?;
    }
    Ok(())
}

pub(super) fn progress(connection: &Connection) -> Result<Vec<(String, Progress)>, Trouble> {
    let mut statement = connection
        .prepare_cached("SELECT site, newest_ns, rate_fps FROM progress ORDER BY site")?;
    let rows = statement.query_map([], |row| {
        let progress = Progress {
            newest_ns: row.get(1)?,
            rate_fps: row.get(2)?,
        };
        Ok((row.get(0)?, progress))
    })?;
    Ok(rows.collect::<Result<_, _>>()?)
}

pub(super) fn save_window(
    transaction: &Transaction<'_>,
    window: &Window,
    now_ns: i64,
) -> Result<Saved, Trouble> {
    site_is_known(transaction, &window.site)?;
    let inserted = transaction.execute(
        "INSERT INTO windows (id, site, onset_ns, onset_index, start_ns, sample_count, rate_fps,
             lowest_voltage_pu, triggers, closing, stored_ns)
         VALUES (:id, :site, :onset_ns, :onset_index, :start_ns, :sample_count, :rate_fps,
             :lowest_voltage_pu, :triggers, :closing, :stored_ns)
         ON CONFLICT (id) DO NOTHING",
        named_params! {
            ":id": window.id,
            ":site": window.site,
            ":onset_ns": window.onset_ns(),
            ":onset_index": count(window.onset),
            ":start_ns": window.record.start_ns,
            ":sample_count": count(window.record.samples.len()),
            ":rate_fps": window.record.rate_fps,
            // A NaN is stored as null by SQLite itself.
            ":lowest_voltage_pu": window.record.lowest_voltage_pu(),
            ":triggers": trigger_words(&window.triggers),
            ":closing": closing_name(window.closing),
            ":stored_ns": now_ns,
        },
    )?;
    if inserted == 0 {
        return Ok(Saved::AlreadyStored);
    }
    transaction.execute(
        "INSERT INTO waveforms (window_id, data) VALUES (?1, ?2)",
        params![window.id, encode_waveforms(&window.record)],
    )?;
    Ok(Saved::Stored)
}

/// The schema would refuse a row of an unknown site too, but not name it.
pub(super) fn site_is_known(transaction: &Transaction<'_>, site: &str) -> Result<(), Trouble> {
    let known = transaction
        .prepare_cached("SELECT 1 FROM sites WHERE name = ?1")?
        .exists([site])?;
    if known {
        Ok(())
    } else {
        Err(Trouble::unknown("site", site))
    }
}

pub(super) fn window(connection: &Connection, id: &str) -> Result<Option<Window>, Trouble> {
    let found = connection
        .prepare_cached(
            "SELECT w.id, w.site, w.onset_index, w.triggers, w.closing, f.data
             FROM windows w JOIN waveforms f ON f.window_id = w.id WHERE w.id = ?1",
        )?
        .query_row([id], stored_window)
        .optional()?;
    found.map(StoredWindow::unpack).transpose()
}

pub(super) fn usable_windows(
    connection: &Connection,
    site: &str,
    count_max: usize,
) -> Result<Vec<Window>, Trouble> {
    let mut statement = connection.prepare_cached(
        "SELECT w.id, w.site, w.onset_index, w.triggers, w.closing, f.data
         FROM windows w
         JOIN waveforms f ON f.window_id = w.id
         JOIN screenings s ON s.window_id = w.id
         WHERE w.site = ?1 AND s.usable = 1
         ORDER BY w.onset_ns DESC, w.id DESC LIMIT ?2",
    )?;
    let rows = statement.query_map(params![site, count(count_max)], stored_window)?;
    let mut windows = rows
        .map(|row| row.map_err(Trouble::from).and_then(StoredWindow::unpack))
        .collect::<Result<Vec<_>, _>>()?;
    windows.reverse();
    Ok(windows)
}

pub(super) fn summaries(
    connection: &Connection,
    query: &WindowQuery<'_>,
) -> Result<Vec<WindowSummary>, Trouble> {
    let mut statement = connection.prepare_cached(
        "SELECT w.id, w.site, w.onset_ns, w.start_ns, w.sample_count, w.rate_fps,
                w.lowest_voltage_pu, w.triggers, w.closing, w.stored_ns, w.announced_ns,
                s.document,
                EXISTS (SELECT 1 FROM waveforms f WHERE f.window_id = w.id)
         FROM windows w LEFT JOIN screenings s ON s.window_id = w.id
         WHERE (:site IS NULL OR w.site = :site)
           AND (:id IS NULL OR w.id = :id)
           AND (:before_ns IS NULL OR w.onset_ns < :before_ns)
           AND (NOT :unscreened OR s.window_id IS NULL)
           AND (NOT :unannounced OR (s.window_id IS NOT NULL AND w.announced_ns IS NULL))
         ORDER BY w.onset_ns DESC, w.id DESC LIMIT :count_max",
    )?;
    let rows = statement.query_map(
        named_params! {
            ":site": query.site,
            ":id": query.id,
            ":before_ns": query.before_ns,
            ":unscreened": query.unscreened,
            ":unannounced": query.unannounced,
            ":count_max": count(query.count_max),
        },
        stored_summary,
    )?;
    rows.map(|row| {
        row.map_err(Trouble::from)
            .and_then(StoredSummary::understand)
    })
    .collect()
}

pub(super) fn tallies(connection: &Connection) -> Result<Vec<WindowTally>, Trouble> {
    let mut statement = connection.prepare_cached(
        "SELECT w.site, COUNT(*), COALESCE(SUM(s.usable), 0), MAX(w.onset_ns)
         FROM windows w LEFT JOIN screenings s ON s.window_id = w.id
         GROUP BY w.site ORDER BY w.site",
    )?;
    let rows = statement.query_map([], |row| {
        Ok(WindowTally {
            site: row.get(0)?,
            windows: row.get::<_, i64>(1)?.unsigned_abs(),
            usable: row.get::<_, i64>(2)?.unsigned_abs(),
            newest_onset_ns: row.get(3)?,
        })
    })?;
    Ok(rows.collect::<Result<_, _>>()?)
}

pub(super) fn save_screening(
    transaction: &Transaction<'_>,
    window_id: &str,
    screening: &Screening,
    now_ns: i64,
) -> Result<Saved, Trouble> {
    let document = serde_json::to_string(&ScreeningV1::from(screening)).map_err(malformed)?;
    let changed = transaction.execute(
        "INSERT INTO screenings (window_id, usable, document, screened_ns)
         VALUES (?1, ?2, ?3, ?4)
         ON CONFLICT (window_id) DO UPDATE SET
             usable = excluded.usable, document = excluded.document,
             screened_ns = excluded.screened_ns
         WHERE document <> excluded.document",
        params![window_id, screening.usable(), document, now_ns],
    );
    match changed {
        Ok(0) => Ok(Saved::AlreadyStored),
        Ok(_) => Ok(Saved::Stored),
        Err(error) if refers_to_nothing(&error) => Err(Trouble::unknown("window", window_id)),
        Err(error) => Err(error.into()),
    }
}

pub(super) fn mark_announced(
    transaction: &Transaction<'_>,
    window_id: &str,
    now_ns: i64,
) -> Result<Saved, Trouble> {
    let changed = transaction.execute(
        "UPDATE windows SET announced_ns = ?2 WHERE id = ?1 AND announced_ns IS NULL",
        params![window_id, now_ns],
    )?;
    if changed > 0 {
        return Ok(Saved::Stored);
    }
    let known = transaction
        .prepare_cached("SELECT 1 FROM windows WHERE id = ?1")?
        .exists([window_id])?;
    if known {
        Ok(Saved::AlreadyStored)
    } else {
        Err(Trouble::unknown("window", window_id))
    }
}

/// A count as SQLite takes it; more than its integers hold is as good as all.
pub(super) fn count(count: usize) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// A stored count; never negative, since only [`count`] writes it.
pub(super) fn counted(count: i64) -> usize {
    usize::try_from(count).unwrap_or(0)
}

struct StoredWindow {
    id: String,
    site: String,
    onset: i64,
    triggers: String,
    closing: String,
    waveforms: Vec<u8>,
}

fn stored_window(row: &Row<'_>) -> rusqlite::Result<StoredWindow> {
    Ok(StoredWindow {
        id: row.get(0)?,
        site: row.get(1)?,
        onset: row.get(2)?,
        triggers: row.get(3)?,
        closing: row.get(4)?,
        waveforms: row.get(5)?,
    })
}

impl StoredWindow {
    fn unpack(self) -> Result<Window, Trouble> {
        Ok(Window {
            triggers: triggers_of(&self.triggers)?,
            closing: closing_named(&self.closing)?,
            record: decode_waveforms(&self.waveforms).map_err(DocumentError::from)?,
            onset: counted(self.onset),
            id: self.id,
            site: self.site,
        })
    }
}

/// A summary whose words have not been looked up yet.
struct StoredSummary {
    summary: WindowSummary,
    triggers: String,
    closing: String,
    screening: Option<String>,
}

fn stored_summary(row: &Row<'_>) -> rusqlite::Result<StoredSummary> {
    Ok(StoredSummary {
        summary: WindowSummary {
            id: row.get(0)?,
            site: row.get(1)?,
            onset_ns: row.get(2)?,
            start_ns: row.get(3)?,
            sample_count: counted(row.get(4)?),
            rate_fps: row.get(5)?,
            lowest_voltage_pu: row.get::<_, Option<f64>>(6)?.unwrap_or(f64::NAN),
            stored_ns: row.get(9)?,
            announced_ns: row.get(10)?,
            has_waveforms: row.get(12)?,
            // Filled in by `understand`.
            triggers: Vec::new(),
            closing: crate::disturbance::Closing::Recovered,
            screening: None,
        },
        triggers: row.get(7)?,
        closing: row.get(8)?,
        screening: row.get(11)?,
    })
}

impl StoredSummary {
    fn understand(self) -> Result<WindowSummary, Trouble> {
        let screening = self
            .screening
            .map(|document| serde_json::from_str::<ScreeningV1>(&document).map_err(malformed))
            .transpose()?;
        Ok(WindowSummary {
            triggers: triggers_of(&self.triggers)?,
            closing: closing_named(&self.closing)?,
            screening: screening.map(Screening::from),
            ..self.summary
        })
    }
}

fn trigger_words(triggers: &[Trigger]) -> String {
    let words: Vec<_> = triggers.iter().copied().map(trigger_name).collect();
    words.join(" ")
}

fn triggers_of(words: &str) -> Result<Vec<Trigger>, DocumentError> {
    words.split_whitespace().map(trigger_named).collect()
}

fn malformed(source: serde_json::Error) -> DocumentError {
    DocumentError::Malformed {
        document: "screening",
        source,
    }
}
