//! `loadmodeld structure`: which model a site is to have, and since when; add an effect, take one
//! out, or name all parts.

use std::{
    env,
    io::Write,
    path::{Path, PathBuf},
};

use clap::Args;
use serde_json::{Value, json};

use super::Error;
use crate::{
    adapters::{
        http::{StructureDocument, client::Call},
        store::{
            NewStructure, Origin, Saved, SqliteOptions, SqliteStore, Store, StructureChange,
            what_follows,
        },
    },
    daemon::clock,
};

/// Records of the past that are shown.
const SHOWN_MAX: usize = 50;

/// Arguments of `structure`.
#[derive(Debug, Args)]
pub struct StructureArgs {
    /// Site
    site: String,
    #[command(flatten)]
    change: ChangeArgs,
    #[command(flatten)]
    place: PlaceArgs,
    /// File whose first line is the token of the service
    #[arg(long, value_name = "FILE", requires = "server")]
    token_file: Option<PathBuf>,
    /// Why: kept with the change
    #[arg(long, value_name = "TEXT", default_value = "")]
    comment: String,
    /// Print one JSON document: the change, or the history, newest first
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Args)]
#[group(multiple = false)]
struct ChangeArgs {
    /// Add an effect
    #[arg(long, value_name = "EFFECT")]
    add: Option<String>,
    /// Take an effect out
    #[arg(long, value_name = "EFFECT")]
    remove: Option<String>,
    /// Name all parts, joined by `+`
    #[arg(long, value_name = "A+B+C")]
    set: Option<String>,
}

#[derive(Debug, Args)]
#[group(required = true, multiple = false)]
struct PlaceArgs {
    /// Store of a service; one that runs notices within its `workers.sweep_s`
    #[arg(long, value_name = "FILE")]
    store: Option<PathBuf>,
    /// Address of a service that runs, http://HOST:PORT; it begins at once
    #[arg(long, value_name = "URL")]
    server: Option<String>,
}

impl ChangeArgs {
    fn change(&self) -> Option<StructureChange> {
        let parts = |text: &str| text.split('+').map(|part| part.trim().to_owned()).collect();
        let add = self.add.clone().map(StructureChange::Add);
        let remove = || self.remove.clone().map(StructureChange::Remove);
        let set = || {
            self.set
                .as_deref()
                .map(|text| StructureChange::Set(parts(text)))
        };
        add.or_else(remove).or_else(set)
    }
}

/// Shows or changes the structure of a site.
///
/// # Errors
///
/// [`Error`] when the store or the service does not do it.
pub fn run(args: &StructureArgs, out: &mut dyn Write) -> Result<(), Error> {
    match (&args.place.store, &args.place.server) {
        (Some(store), _) => in_store(args, store, out),
        (None, Some(server)) => at_server(args, server, out),
        (None, None) => Err(Error::Usage("--store or --server is needed".to_owned())),
    }
}

fn in_store(args: &StructureArgs, path: &Path, out: &mut dyn Write) -> Result<(), Error> {
    if !path.exists() {
        return Err(Error::Usage(format!("{}: no such file", path.display())));
    }
    let store = SqliteStore::open(path, &SqliteOptions::default()).map_err(Error::other)?;
    let known = store
        .structures(&args.site, SHOWN_MAX)
        .map_err(Error::other)?;
    if known.is_empty() {
        return Err(Error::Usage(format!(
            "`{}` is no site that a service with this store has taken up",
            args.site
        )));
    }
    let Some(change) = args.change.change() else {
        let documents: Vec<_> = known.iter().map(StructureDocument::from).collect();
        return show(args.json, &json!(documents), out);
    };
    let new = NewStructure {
        site: &args.site,
        change: &change,
        origin: Origin::CommandLine,
        actor: &actor(),
        comment: &args.comment,
    };
    let (record, saved) = store
        .change_structure(&new, clock::now_ns())
        .map_err(Error::other)?;
    let note = what_follows(&store, &record, saved).map_err(Error::other)?;
    let mut document = json!(StructureDocument::from(&record));
    document["changed"] = json!(saved == Saved::Stored);
    document["note"] = json!(note);
    told(args.json, &document, out)
}

fn at_server(args: &StructureArgs, server: &str, out: &mut dyn Write) -> Result<(), Error> {
    let path = format!("/api/v1/sites/{}/structure", segment(&args.site));
    let token = args.token_file.as_deref().map(first_line).transpose()?;
    let body = args.change.change().map(|change| {
        let (actor, comment) = (actor(), &args.comment);
        let body = match change {
            StructureChange::Add(effect) => json!({"add": effect}),
            StructureChange::Remove(effect) => json!({"remove": effect}),
            StructureChange::Set(parts) => json!({"set": parts}),
        };
        with(body, &[("actor", &actor), ("comment", comment)]).to_string()
    });
    let call = Call {
        server,
        path: &path,
        token: token.as_deref(),
        body: body.as_deref(),
    };
    let answer = call.answer().map_err(Error::other)?;
    let document: Value = serde_json::from_str(&answer).map_err(Error::other)?;
    if body.is_some() {
        told(args.json, &document, out)
    } else {
        show(args.json, &document, out)
    }
}

fn with(mut object: Value, fields: &[(&str, &str)]) -> Value {
    for (name, text) in fields {
        object[*name] = json!(text);
    }
    object
}

/// A name as one segment of a path (RFC 3986, 2.1).
fn segment(name: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
    let bytes = name.bytes();
    bytes
        .map(|byte| {
            if plain(byte) {
                char::from(byte).to_string()
            } else {
                format!("%{byte:02X}")
            }
        })
        .collect()
}

fn first_line(path: &Path) -> Result<String, Error> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::File {
        path: path.to_owned(),
        source,
    })?;
    Ok(text.lines().next().unwrap_or_default().trim().to_owned())
}

/// Who runs the command, as the system says.
fn actor() -> String {
    env::var("USER").unwrap_or_else(|_| "unknown user".to_owned())
}

fn told(as_json: bool, document: &Value, out: &mut dyn Write) -> Result<(), Error> {
    if as_json {
        return Ok(writeln!(out, "{document}")?);
    }
    let structure = parts(document);
    let site = document["site"].as_str().unwrap_or_default();
    // A service that does not say answers what it has changed.
    if document["changed"].as_bool().unwrap_or(true) {
        writeln!(out, "{site}: to be fitted as {structure}")?;
        if let Some(note) = document["note"].as_str() {
            writeln!(out, "{note}")?;
        }
    } else {
        writeln!(out, "{site}: is {structure} already")?;
    }
    Ok(())
}

fn show(as_json: bool, history: &Value, out: &mut dyn Write) -> Result<(), Error> {
    if as_json {
        return Ok(writeln!(out, "{history}")?);
    }
    for record in history.as_array().into_iter().flatten() {
        let text = |field: &str| record[field].as_str().unwrap_or_default();
        writeln!(
            out,
            "{}  {}  ({}, {}) {}",
            text("changed_utc"),
            parts(record),
            text("origin"),
            text("actor"),
            text("comment")
        )?;
    }
    Ok(())
}

fn parts(document: &Value) -> String {
    let parts = document["structure"].as_array().into_iter().flatten();
    parts
        .filter_map(Value::as_str)
        .collect::<Vec<_>>()
        .join("+")
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;
    use crate::measurement::Site;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: StructureArgs,
    }

    fn asked(arguments: &[&str]) -> Result<String, String> {
        let line = ["structure", "north"].iter().chain(arguments);
        let line = Line::try_parse_from(line).map_err(|error| error.to_string())?;
        let mut out = Vec::new();
        run(&line.args, &mut out).map_err(|error| error.to_string())?;
        Ok(String::from_utf8(out).unwrap())
    }

    #[test]
    fn a_structure_is_changed_in_the_store_with_who_and_why() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("store.sqlite");
        let file = path.display().to_string();
        assert!(asked(&["--store", &file]).unwrap_err().contains("no such"));
        let store = SqliteStore::open(&path, &SqliteOptions::default()).unwrap();
        assert!(asked(&["--store", &file]).unwrap_err().contains("no site"));
        let site = Site {
            name: "north".to_owned(),
            s_base_mva: 40.0,
            v_base_kv: 110.0,
            nominal_hz: 50.0,
        };
        store.save_site(&site, 1).unwrap();
        let base = ["zip", "induction_motor"].map(str::to_owned).to_vec();
        let new = NewStructure {
            site: "north",
            change: &StructureChange::Set(base),
            origin: Origin::Configuration,
            actor: "service",
            comment: "",
        };
        store.change_structure(&new, 2).unwrap();
        let added = asked(&["--store", &file, "--add", "saturation", "--comment", "why"]);
        assert_eq!(
            added.unwrap(),
            "north: to be fitted as zip+induction_motor+saturation\n\
             a joint fit, its validation, a decision and a diagnosis follow\n"
        );
        let set = "zip+induction_motor+saturation";
        let same = asked(&["--store", &file, "--set", set]).unwrap();
        assert!(same.contains("already"), "{same}");
        let out = asked(&["--store", &file, "--remove", "saturation"]).unwrap();
        assert!(out.contains("had this structure before"), "{out}");
        asked(&["--store", &file, "--add", "saturation"]).unwrap();
        let wrong = asked(&["--store", &file, "--remove", "tap_changer"]);
        assert!(wrong.unwrap_err().contains("is not part of"));
        let history = asked(&["--store", &file]).unwrap();
        assert_eq!(history.lines().count(), 4);
        assert!(history.contains("command_line") && history.contains("why"));
        assert!(asked(&["--add", "saturation"]).is_err(), "where?");
    }

    #[test]
    fn a_name_becomes_one_segment_of_a_path() {
        assert_eq!(segment("north-1.a"), "north-1.a");
        assert_eq!(segment("a%b\u{e4}"), "a%25b%C3%A4");
    }
}
