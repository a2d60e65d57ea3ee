//! Reading a site folder.

use std::{
    fmt, fs,
    path::{Path, PathBuf},
};

use csv::StringRecord;
use serde::Deserialize;

use super::error::Error;
use crate::measurement::{
    Quality, Record, Sample, Site,
    record::{NANOSECONDS_PER_SECOND, grid_offset_ns},
};

/// Largest file that is read, bytes: some three million rows.
const FILE_BYTES_MAX: u64 = 256 * 1024 * 1024;
/// Longest event, samples: nine hours at 30 per second.
const GRID_POINTS_MAX: f64 = 1_000_000.0;
/// A row further than this from its grid point, in intervals, is counted as off the grid.
const OFF_GRID: f64 = 0.25;
/// Time between events without a date, so that they do not share an instant.
const UNDATED_STEP_NS: i64 = 24 * 3600 * 1_000_000_000;

/// A site folder.
#[derive(Debug)]
pub struct SiteFolder {
    /// The site and its base.
    pub site: Site,
    /// Samples per second.
    pub rate_fps: f64,
    /// The events that could be read, in the order of the folder.
    pub events: Vec<FolderEvent>,
    /// What the user should know: events left out and events without a date.
    pub notes: Vec<Note>,
}

/// One event of a site folder.
#[derive(Clone, Debug, PartialEq)]
pub struct FolderEvent {
    /// File name without its ending.
    pub name: String,
    /// Time of `time_s` = 0, UTC nanoseconds; none when the folder does not say.
    pub utc_ns: Option<i64>,
    /// The samples on the grid. Without a date, event k starts k days after 1970-01-01.
    pub record: Record,
    /// What was found on the way in.
    pub intake: Intake,
}

/// What was found when an event was put on its grid.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Intake {
    /// Rows read.
    pub rows: usize,
    /// Rows without a usable time; left out.
    pub bad_rows: usize,
    /// Cells that are neither empty nor a number.
    pub bad_cells: usize,
    /// Line and column of the first bad row or cell.
    pub first_bad: Option<(u64, &'static str)>,
    /// Rows for a grid point that was already taken; left out.
    pub duplicates: usize,
    /// Rows earlier than the row before them; put in place.
    pub out_of_order: usize,
    /// Rows more than a quarter of an interval from their grid point.
    pub off_grid: usize,
    /// Grid points without a row.
    pub gaps: usize,
}

/// What the user should know of a folder that was read.
#[derive(Debug)]
#[non_exhaustive]
pub enum Note {
    /// An event was left out.
    EventLeftOut {
        /// The event.
        event: String,
        /// Why.
        error: Error,
    },
    /// An event has no date; its times are made up.
    NoDate {
        /// The event.
        event: String,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::EventLeftOut { error, .. } => write!(f, "event left out: {error}"),
            Self::NoDate { event } => write!(f, "{event} has no date: its times are made up"),
        }
    }
}

/// `site.json`; other keys are descriptive and ignored.
#[derive(Deserialize)]
struct SiteFile {
    site: String,
    sample_rate_fps: f64,
    nominal_hz: f64,
    base_mva: f64,
    base_kv: f64,
    events: Option<Vec<EventEntry>>,
}

#[derive(Deserialize)]
struct EventEntry {
    file: String,
    utc: Option<String>,
}

/// Reads `site.json` and every event it lists, or every `event_*.csv` in order of name when it
/// lists none. An event that cannot be used is left out with a note.
///
/// # Errors
/// `site.json` is absent or wrong, there are no events, or not one of them can be used (then the
/// first one's error).
pub fn load_events(directory: &Path) -> Result<SiteFolder, Error> {
    let path = directory.join("site.json");
    let bytes = read_file(&path)?;
    let json = |source| Error::Json {
        path: path.clone(),
        source,
    };
    let file: SiteFile = serde_json::from_slice(&bytes).map_err(json)?;
    check(&path, &file)?;
    let entries = match file.events {
        Some(entries) => entries,
        None => event_files(directory)?,
    };
    let mut folder = SiteFolder {
        site: Site {
            name: file.site,
            s_base_mva: file.base_mva,
            v_base_kv: file.base_kv,
            nominal_hz: file.nominal_hz,
        },
        rate_fps: file.sample_rate_fps,
        events: Vec::new(),
        notes: Vec::new(),
    };
    if entries.is_empty() {
        return Err(Error::NoEvents {
            path: directory.to_owned(),
        });
    }
    for (entry, number) in entries.iter().zip(0_i64..) {
        match event(directory, &path, &folder, entry, number) {
            Ok(event) => {
                if event.utc_ns.is_none() {
                    let event = event.name.clone();
                    folder.notes.push(Note::NoDate { event });
                }
                folder.events.push(event);
            }
            Err(error) => folder.notes.push(Note::EventLeftOut {
                event: name_of(&entry.file),
                error,
            }),
        }
    }
    if folder.events.is_empty() {
        for note in folder.notes {
            if let Note::EventLeftOut { error, .. } = note {
                return Err(error);
            }
        }
        return Err(Error::NoEvents {
            path: directory.to_owned(),
        });
    }
    Ok(folder)
}

fn check(path: &Path, file: &SiteFile) -> Result<(), Error> {
    let range = |key, value: f64, high: f64, expected| {
        if value > 0.0 && value <= high {
            return Ok(());
        }
        Err(Error::Value {
            path: path.to_owned(),
            key,
            found: value.to_string(),
            expected,
        })
    };
    range(
        "sample_rate_fps",
        file.sample_rate_fps,
        1e4,
        "above 0, at most 10000",
    )?;
    range("nominal_hz", file.nominal_hz, 1e3, "above 0, at most 1000")?;
    range("base_mva", file.base_mva, 1e9, "above 0")?;
    range("base_kv", file.base_kv, 1e6, "above 0")?;
    let forbidden = |c: char| "/*$?#".contains(c) || c.is_whitespace() || c.is_control();
    if file.site.is_empty() || file.site.contains(forbidden) {
        return Err(Error::Value {
            path: path.to_owned(),
            key: "site",
            found: file.site.clone(),
            expected: "a name without white space, '/', '*', '$', '?' and '#'",
        });
    }
    Ok(())
}

fn event_files(directory: &Path) -> Result<Vec<EventEntry>, Error> {
    let failed = |source| Error::Io {
        path: directory.to_owned(),
        source,
    };
    let mut names = Vec::new();
    for entry in fs::read_dir(directory).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        let name = name.to_string_lossy();
        if name.starts_with("event_") && name.to_ascii_lowercase().ends_with(".csv") {
            names.push(name.into_owned());
        }
    }
    names.sort();
    let entry = |file| EventEntry { file, utc: None };
    Ok(names.into_iter().map(entry).collect())
}

/// File name without its ending.
fn name_of(file: &str) -> String {
    let name = Path::new(file).file_stem().unwrap_or_default();
    name.to_string_lossy().into_owned()
}

fn event(
    directory: &Path,
    site_file: &Path,
    folder: &SiteFolder,
    entry: &EventEntry,
    number: i64,
) -> Result<FolderEvent, Error> {
    let path = directory.join(&entry.file);
    let utc_ns = entry
        .utc
        .as_deref()
        .map(|text| utc(site_file, text))
        .transpose()?;
    let zero_ns = utc_ns.unwrap_or(number * UNDATED_STEP_NS);
    let mut intake = Intake::default();
    let rows = rows(&path, &mut intake)?;
    let record = on_grid(&path, folder, zero_ns, &rows, &mut intake)?;
    Ok(FolderEvent {
        name: name_of(&entry.file),
        utc_ns,
        record,
        intake,
    })
}

fn utc(site_file: &Path, text: &str) -> Result<i64, Error> {
    let timestamp: Option<jiff::Timestamp> = text.trim().parse().ok();
    timestamp
        .and_then(|time| i64::try_from(time.as_nanosecond()).ok())
        .ok_or_else(|| Error::Value {
            path: site_file.to_owned(),
            key: "utc",
            found: text.to_owned(),
            expected: "an RFC 3339 time such as 2026-02-11T03:07:00Z",
        })
}

fn read_file(path: &Path) -> Result<Vec<u8>, Error> {
    let failed = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    let bytes = fs::metadata(path).map_err(failed)?.len();
    if bytes > FILE_BYTES_MAX {
        return Err(Error::TooLarge {
            path: path.to_owned(),
            bytes,
            limit_bytes: FILE_BYTES_MAX,
        });
    }
    fs::read(path).map_err(failed)
}

/// A row with a usable time; absent and unreadable values are NaN.
struct Row {
    line: u64,
    time_s: f64,
    sample: Sample,
}

/// Where each column is.
struct Columns {
    time: usize,
    voltage: usize,
    frequency: usize,
    active: usize,
    reactive: usize,
    angle: Option<usize>,
    stat: Option<usize>,
}

impl Columns {
    fn find(path: &Path, header: &StringRecord) -> Result<Self, Error> {
        let find = |name: &str| header.iter().position(|column| column == name);
        let need = |column: &'static str| {
            find(column).ok_or_else(|| Error::NoColumn {
                path: path.to_owned(),
                column,
            })
        };
        Ok(Self {
            time: need("time_s")?,
            voltage: need("v_pu")?,
            frequency: need("freq_hz")?,
            active: need("p_pu")?,
            reactive: need("q_pu")?,
            angle: find("angle_deg"),
            stat: find("stat"),
        })
    }
}

fn rows(path: &Path, intake: &mut Intake) -> Result<Vec<Row>, Error> {
    let bytes = read_file(path)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut reader = csv::ReaderBuilder::new()
        .flexible(true)
        .trim(csv::Trim::All)
        .from_reader(text.trim_start_matches('\u{feff}').as_bytes());
    let unreadable = |error: csv::Error| Error::Io {
        path: path.to_owned(),
        source: error.into(),
    };
    let columns = Columns::find(path, reader.headers().map_err(unreadable)?)?;
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record.map_err(unreadable)?;
        let line = record.position().map_or(0, csv::Position::line);
        intake.rows += 1;
        let mut cells = Cells {
            record: &record,
            line,
            intake,
        };
        let time_s = cells.number(columns.time, "time_s");
        if !time_s.is_finite() {
            intake.bad_rows += 1;
            intake.first_bad.get_or_insert((line, "time_s"));
            continue;
        }
        let sample = sample(&mut cells, &columns);
        rows.push(Row {
            line,
            time_s,
            sample,
        });
    }
    Ok(rows)
}

fn sample(cells: &mut Cells<'_>, columns: &Columns) -> Sample {
    let angle = columns.angle.map(|at| cells.number(at, "angle_deg"));
    let mut sample = Sample {
        voltage_pu: cells.number(columns.voltage, "v_pu"),
        frequency_hz: cells.number(columns.frequency, "freq_hz"),
        active_pu: cells.number(columns.active, "p_pu"),
        reactive_pu: cells.number(columns.reactive, "q_pu"),
        angle_rad: angle.map_or(f64::NAN, f64::to_radians),
        quality: columns.stat.map_or(Quality::GOOD, |at| cells.stat(at)),
        ..Sample::missing(0)
    };
    let needed = [
        sample.voltage_pu,
        sample.frequency_hz,
        sample.active_pu,
        sample.reactive_pu,
    ];
    let known = needed.iter().filter(|value| value.is_finite()).count();
    let flag = match known {
        0 => Quality::MISSING,
        4 if angle.is_none_or(f64::is_finite) => Quality::GOOD,
        _ => Quality::NOT_FINITE,
    };
    sample.quality = sample.quality | flag;
    sample
}

struct Cells<'a> {
    record: &'a StringRecord,
    line: u64,
    intake: &'a mut Intake,
}

impl Cells<'_> {
    /// The number in a cell; NaN for an empty cell, for one that is not there and for a bad one.
    fn number(&mut self, at: usize, column: &'static str) -> f64 {
        let text = self.record.get(at).unwrap_or("");
        if text.is_empty() {
            return f64::NAN;
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => value,
            // A NaN or an infinity is a number the source could not give, not a bad cell.
            Ok(_) => f64::NAN,
            Err(_) => {
                self.bad(column);
                f64::NAN
            }
        }
    }

    /// STAT bits, decimal or hexadecimal; a cell that is neither makes the sample invalid.
    fn stat(&mut self, at: usize) -> Quality {
        let text = self.record.get(at).unwrap_or("");
        let hexadecimal = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
        let bits = match (text, hexadecimal) {
            ("", _) => Some(0),
            (_, Some(digits)) => u16::from_str_radix(digits, 16).ok(),
            (text, None) => text.trim_end_matches(".0").parse().ok(),
        };
        if let Some(bits) = bits {
            return Quality(u32::from(bits));
        }
        self.bad("stat");
        Quality::DATA_INVALID
    }

    fn bad(&mut self, column: &'static str) {
        self.intake.bad_cells += 1;
        self.intake.first_bad.get_or_insert((self.line, column));
    }
}

/// Puts the rows on the grid that the earliest row begins.
fn on_grid(
    path: &Path,
    folder: &SiteFolder,
    zero_ns: i64,
    rows: &[Row],
    intake: &mut Intake,
) -> Result<Record, Error> {
    let rate_fps = folder.rate_fps;
    let first = rows.first().ok_or_else(|| Error::NoRows {
        path: path.to_owned(),
    })?;
    let position = |row: &Row| (row.time_s - first.time_s) * rate_fps;
    let (mut low, mut high) = (0.0_f64, 0.0_f64);
    for row in rows {
        low = low.min(position(row).round());
        high = high.max(position(row).round());
        if high - low >= GRID_POINTS_MAX {
            return Err(too_long(path, row, high - low));
        }
    }
    let origin_s = first.time_s + low / rate_fps;
    let seconds_limit = 1e9;
    if origin_s.abs() > seconds_limit {
        return Err(too_long(path, first, origin_s.abs() * rate_fps));
    }
    let start_ns =
        zero_ns + grid_offset_ns(origin_s * NANOSECONDS_PER_SECOND, NANOSECONDS_PER_SECOND);
    let points = index(high - low) + 1;
    let mut record = Record {
        start_ns,
        rate_fps,
        nominal_hz: folder.site.nominal_hz,
        samples: Vec::with_capacity(points),
    };
    for point in 0..points {
        let sample = Sample::missing(record.time_ns(point));
        record.samples.push(sample);
    }
    fill(&mut record, rows, low, position, intake);
    let misplaced = intake.off_grid + intake.duplicates;
    if misplaced * 2 > rows.len() {
        return Err(Error::RateDoesNotFit {
            path: path.to_owned(),
            misplaced,
            rows: rows.len(),
            rate_fps,
        });
    }
    Ok(record)
}

fn fill(
    record: &mut Record,
    rows: &[Row],
    low: f64,
    position: impl Fn(&Row) -> f64,
    intake: &mut Intake,
) {
    let mut taken = vec![false; record.samples.len()];
    let mut before = f64::NEG_INFINITY;
    for row in rows {
        let exact = position(row) - low;
        let point = index(exact.round());
        intake.out_of_order += usize::from(exact < before);
        before = exact;
        intake.off_grid += usize::from((exact - exact.round()).abs() > OFF_GRID);
        if std::mem::replace(&mut taken[point], true) {
            intake.duplicates += 1;
            continue;
        }
        let time_ns = record.samples[point].time_ns;
        record.samples[point] = Sample {
            time_ns,
            ..row.sample
        };
    }
    intake.gaps = taken.iter().filter(|taken| !**taken).count();
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "grid positions are whole, not negative and below GRID_POINTS_MAX"
)]
fn index(position: f64) -> usize {
    position as usize
}

fn too_long(path: &Path, row: &Row, points: f64) -> Error {
    Error::TooLong {
        path: PathBuf::from(path),
        line: row.line,
        time_s: row.time_s,
        points,
        limit: GRID_POINTS_MAX,
    }
}
