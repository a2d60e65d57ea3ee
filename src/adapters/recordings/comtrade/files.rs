//! From files or bytes to a [`Recording`].

use std::{
    fs,
    path::{Path, PathBuf},
};

use encoding_rs::Encoding;

use super::{
    ascii, binary, code_page,
    configuration::{self, Configuration},
    container,
    error::{Error, Part},
    recording::{AnalogChannel, DataFormat, DigitalChannel, Note, Recording},
    sample_times::{self, Rows},
};

/// Largest file that is read, bytes. Decoding a 16-bit file takes four times its size in memory;
/// the longest recordings met have 50 MB.
pub const FILE_BYTES_MAX: u64 = 512 * 1024 * 1024;

/// What the file cannot say, or says wrongly.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Code page of the texts; none: detected (UTF-8, else GB 18030, windows-1251 or
    /// windows-1252).
    pub code_page: Option<&'static Encoding>,
    /// Offset of the recorder's clock from UTC, seconds east, for files that do not say (all
    /// before 2013); none: UTC.
    pub utc_offset_s: Option<i32>,
    /// Read a recording whose data end early as far as it goes, and skip blank lines between
    /// samples; both are noted. Default: refused.
    pub lenient: bool,
}

/// Reads the recording that `path` (`.cfg`, `.dat` or `.cff`, in any case) belongs to.
///
/// # Errors
/// The file or its companion cannot be read, is too large or malformed: see [`Error`].
pub fn read(path: &Path, options: &Options) -> Result<Recording, Error> {
    match extension(path).as_str() {
        "cff" => decode_container(&read_file(path)?, options),
        "cfg" => {
            let data = companion(path, "dat", Part::Data)?;
            decode(&read_file(path)?, &read_file(&data)?, options)
        }
        "dat" => {
            let configuration = companion(path, "cfg", Part::Configuration)?;
            decode(&read_file(&configuration)?, &read_file(path)?, options)
        }
        _ => Err(Error::UnknownExtension {
            path: path.to_owned(),
        }),
    }
}

/// Decodes a `.cff` container.
///
/// # Errors
/// The bytes are malformed, or its header contradicts its configuration: see [`Error`].
pub fn decode_container(bytes: &[u8], options: &Options) -> Result<Recording, Error> {
    let sections = container::split(bytes)?;
    let recording = decode(sections.configuration, sections.data, options)?;
    match sections.data_format {
        Some(format) if format != recording.format => Err(Error::FormatsDisagree {
            header: format.name(),
            configuration: recording.format.name(),
        }),
        _ => Ok(recording),
    }
}

/// Decodes a configuration and its data.
///
/// # Errors
/// The bytes are malformed: see [`Error`].
pub fn decode(configuration: &[u8], data: &[u8], options: &Options) -> Result<Recording, Error> {
    let encoding = options
        .code_page
        .unwrap_or_else(|| code_page::detect(configuration));
    let (text, _) = encoding.decode_with_bom_removal(configuration);
    let configuration = configuration::parse(&text)?;
    let rows = match configuration.format {
        DataFormat::Ascii => ascii::parse(
            &configuration,
            // Numbers are the same in every code page but UTF-16, which has a byte-order mark.
            &Encoding::for_bom(data)
                .map_or(encoding_rs::UTF_8, |(e, _)| e)
                .decode(data)
                .0,
            options.lenient,
        )?,
        DataFormat::Binary | DataFormat::Binary32 | DataFormat::Float32 => {
            binary::parse(&configuration, data)
        }
    };
    assemble(configuration, rows, encoding.name(), options)
}

fn assemble(
    mut configuration: Configuration,
    rows: Rows,
    code_page: &'static str,
    options: &Options,
) -> Result<Recording, Error> {
    let mut notes = std::mem::take(&mut configuration.notes);
    let (found, declared) = (rows.times.len(), configuration.samples());
    if found < declared {
        if found == 0 || !options.lenient {
            return Err(Error::DataEnds { found, declared });
        }
        notes.push(Note::Truncated { found, declared });
    }
    if rows.more_than_declared {
        notes.push(Note::MoreDataThanDeclared { declared });
    }
    if rows.blank_lines > 0 {
        notes.push(Note::BlankLines {
            count: rows.blank_lines,
        });
    }
    if rows.odd_states > 0 {
        notes.push(Note::DigitalValues {
            count: rows.odd_states,
        });
    }
    let (time_s, segments) = sample_times::sample_times(&configuration, &rows.times, &mut notes)?;
    let stated_offset_s = configuration.time_code.and_then(|code| code.utc_offset_s);
    let offset_s = stated_offset_s.or(options.utc_offset_s).unwrap_or(0);
    let utc = |civil_ns: i64| civil_ns.checked_sub(i64::from(offset_s) * 1_000_000_000);
    Ok(Recording {
        station: configuration.station,
        recorder: configuration.recorder,
        revision: configuration.revision,
        format: configuration.format,
        code_page,
        nominal_hz: configuration.nominal_hz,
        start_ns: configuration.start.civil_ns.and_then(utc),
        trigger_ns: configuration.trigger.civil_ns.and_then(utc),
        time_code: configuration.time_code,
        analog: analog_channels(configuration.analog, rows.analog),
        digital: digital_channels(configuration.digital, rows.digital),
        time_s,
        segments,
        notes,
    })
}

fn analog_channels(
    lines: Vec<configuration::Analog>,
    columns: Vec<Vec<f64>>,
) -> Vec<AnalogChannel> {
    lines
        .into_iter()
        .zip(columns)
        .map(|(line, values)| AnalogChannel {
            number: line.number,
            name: line.name,
            phase: line.phase,
            circuit: line.circuit,
            unit: line.unit,
            skew_us: line.skew_us,
            primary: line.primary,
            secondary: line.secondary,
            scaling: line.scaling,
            values,
        })
        .collect()
}

fn digital_channels(
    lines: Vec<configuration::Digital>,
    tracks: Vec<sample_times::Track>,
) -> Vec<DigitalChannel> {
    lines
        .into_iter()
        .zip(tracks)
        .map(|(line, track)| DigitalChannel {
            number: line.number,
            name: line.name,
            phase: line.phase,
            circuit: line.circuit,
            normal: line.normal,
            initial: track.initial,
            changes: track.changes,
        })
        .collect()
}

fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
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

/// The file of the same stem whose extension is `wanted` in any case; the first one by name.
fn companion(path: &Path, wanted: &str, missing: Part) -> Result<PathBuf, Error> {
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
    let directory = parent.unwrap_or(Path::new("."));
    let entries = fs::read_dir(directory).map_err(|source| Error::Io {
        path: directory.to_owned(),
        source,
    })?;
    let candidates = entries
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .filter(|other| other.file_stem() == path.file_stem() && extension(other) == wanted);
    candidates.min().ok_or_else(|| Error::NoCompanion {
        path: path.to_owned(),
        missing,
    })
}
