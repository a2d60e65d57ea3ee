//! `loadmodeld inspect PATH`: what is in a COMTRADE recording, a site folder or a file of C37.118 frames.

mod comtrade;
mod frame_contents;
mod frames;
mod site_folder;
#[cfg(test)]
mod tests;

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

use encoding_rs::Encoding;
use serde_json::Value;
use thiserror::Error as ThisError;

use crate::adapters::recordings::{
    comtrade::{self as reader, Options},
    site_folder as folders,
};

/// What `inspect` is told.
#[derive(Clone, Debug, clap::Args)]
pub struct InspectArgs {
    /// COMTRADE file (.cfg, .dat or .cff), site folder, or file of C37.118 frames.
    pub path: PathBuf,
    /// Print JSON instead of text.
    #[arg(long)]
    pub json: bool,
    /// Code page of a COMTRADE file's texts, such as windows-1251; detected when not given.
    #[arg(long, value_name = "NAME")]
    pub code_page: Option<String>,
    /// Offset of a COMTRADE recorder's clock from UTC in hours, for files that do not say.
    #[arg(long, value_name = "HOURS", allow_negative_numbers = true)]
    pub utc_offset: Option<f64>,
    /// Read a COMTRADE recording whose data end early or hold blank lines all the same.
    #[arg(long)]
    pub lenient: bool,
    /// Print what each C37.118 frame holds, one line of JSON a frame.
    #[arg(long)]
    pub frames: bool,
}

/// Why there is nothing to show.
#[derive(Debug, ThisError)]
#[non_exhaustive]
pub enum Error {
    /// The COMTRADE recording cannot be read.
    #[error(transparent)]
    Comtrade(#[from] reader::Error),
    /// The site folder cannot be read.
    #[error(transparent)]
    SiteFolder(#[from] folders::Error),
    /// The file begins as one of C37.118 frames does and holds none.
    #[error("no C37.118 frame can be read: {fault}")]
    Frames {
        /// What is wrong with the first one.
        fault: String,
    },
    /// No code page has this name.
    #[error("no code page is called '{name}'")]
    CodePage {
        /// The name given.
        name: String,
    },
    /// The offset is no offset of a time zone.
    #[error("utc offset is {hours} h, must be -14 to 14")]
    UtcOffset {
        /// The offset given.
        hours: f64,
    },
    /// The output cannot be written.
    #[error("cannot write: {source}")]
    Write {
        /// What the operating system said.
        #[from]
        source: io::Error,
    },
}

/// Reads the path and describes it on `out`.
///
/// # Errors
/// The path cannot be read as what its name says, an option is wrong, or `out` cannot be written.
pub fn run(args: &InspectArgs, out: &mut dyn Write) -> Result<(), Error> {
    let (text, json) = if let Some(directory) = folder(&args.path) {
        let folder = folders::load_events(directory)?;
        (site_folder::text(&folder), site_folder::json(&folder))
    } else if let Some(bytes) = frames(&args.path) {
        let view =
            frames::View::new(&bytes, args.frames).map_err(|fault| Error::Frames { fault })?;
        (view.text(), view.json())
    } else {
        let recording = reader::read(&args.path, &options(args)?)?;
        let view = comtrade::View::new(&recording);
        (view.text(), view.json())
    };
    if args.json {
        writeln!(out, "{json:#}")?;
    } else {
        write!(out, "{text}")?;
    }
    Ok(())
}

/// The bytes of a file that begins as a frame does.
fn frames(path: &Path) -> Option<Vec<u8>> {
    const SYNC: u8 = 0xaa;
    let bytes = fs::read(path).ok()?;
    (bytes.first() == Some(&SYNC)).then_some(bytes)
}

/// The site folder a path names: the directory, or the one its `site.json` lies in.
fn folder(path: &Path) -> Option<&Path> {
    if path.is_dir() {
        return Some(path);
    }
    let is_site_file = path.file_name().is_some_and(|name| name == "site.json");
    let parent = path.parent().filter(|p| !p.as_os_str().is_empty());
    is_site_file.then(|| parent.unwrap_or(Path::new(".")))
}

fn options(args: &InspectArgs) -> Result<Options, Error> {
    let code_page = match &args.code_page {
        None => None,
        Some(name) => Some(Encoding::for_label(name.as_bytes()).ok_or_else(|| {
            let name = name.clone();
            Error::CodePage { name }
        })?),
    };
    let utc_offset_s = match args.utc_offset {
        None => None,
        Some(hours) if hours.abs() <= 14.0 => Some(whole_seconds(hours)),
        Some(hours) => return Err(Error::UtcOffset { hours }),
    };
    Ok(Options {
        code_page,
        utc_offset_s,
        lenient: args.lenient,
    })
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "the caller has limited the offset to 14 hours"
)]
fn whole_seconds(hours: f64) -> i32 {
    (hours * 3600.0).round() as i32
}

/// UTC as RFC 3339, or `unknown`.
fn utc_text(time_ns: Option<i64>) -> String {
    let time = time_ns.and_then(|ns| jiff::Timestamp::from_nanosecond(i128::from(ns)).ok());
    time.map_or_else(|| "unknown".to_owned(), |time| time.to_string())
}

/// UTC as RFC 3339, or null.
fn utc_json(time_ns: Option<i64>) -> Value {
    match time_ns {
        Some(_) => Value::from(utc_text(time_ns)),
        None => Value::Null,
    }
}

/// A number, or null where JSON has none.
fn number(value: f64) -> Value {
    if value.is_finite() {
        Value::from(value)
    } else {
        Value::Null
    }
}
