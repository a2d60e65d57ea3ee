//! `loadmodeld check-config`: everything that is wrong with a configuration, at once.

use std::{io, path::PathBuf};

use serde_json::json;

use crate::config::{Config, Problem};

/// Arguments of `check-config`.
#[derive(Debug, clap::Args)]
pub struct CheckConfigArgs {
    /// Configuration file
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Print one JSON document: {file, ok, sites, problems: [{line, column, key, message, allowed}]}
    #[arg(long)]
    pub json: bool,
}

/// Checks a file, and the effect files that it and the command line name, and writes what was found to `out`; says whether it can be used.
///
/// # Errors
///
/// `out` cannot be written to.
pub fn run(
    args: &CheckConfigArgs,
    effect_files: &[PathBuf],
    out: &mut dyn io::Write,
) -> Result<bool, io::Error> {
    let file_name = args.file.display().to_string();
    let outcome = Config::load(&args.file).and_then(|config| {
        config.register_effects(effect_files, &file_name)?;
        Ok(config)
    });
    let ok = outcome.is_ok();
    if args.json {
        let (sites, problems): (usize, Vec<serde_json::Value>) = match &outcome {
            Ok(config) => (config.sites.len(), Vec::new()),
            Err(problems) => (0, problems.list.iter().map(document).collect()),
        };
        let answer = json!({"file": file_name, "ok": ok, "sites": sites, "problems": problems});
        writeln!(out, "{answer}")?;
        return Ok(ok);
    }
    match outcome {
        Ok(config) => writeln!(
            out,
            "{}: no problem, {} sites",
            args.file.display(),
            config.sites.len()
        )?,
        Err(problems) => writeln!(out, "{problems}")?,
    }
    Ok(ok)
}

fn document(problem: &Problem) -> serde_json::Value {
    json!({
        "line": problem.line,
        "column": problem.column,
        "key": problem.key,
        "message": problem.message,
        "allowed": problem.allowed,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(text: &str, json: bool) -> (bool, String) {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("test.toml");
        std::fs::write(&file, text).unwrap();
        let mut out = Vec::new();
        let ok = run(&CheckConfigArgs { file, json }, &[], &mut out).unwrap();
        let text = String::from_utf8(out).unwrap();
        (ok, text.replace(directory.path().to_str().unwrap(), "DIR"))
    }

    #[test]
    fn a_good_file_has_no_problem() {
        let (ok, text) = checked(crate::config::DEFAULT_FILE, false);
        assert!(ok);
        assert_eq!(text, "DIR/test.toml: no problem, 0 sites\n");
    }

    #[test]
    fn every_problem_of_a_bad_file_is_printed() {
        let bad = "[http]\nrows_max = 0\nrows = 1\n";
        let (ok, text) = checked(bad, false);
        assert!(!ok);
        assert_eq!(text.lines().count(), 2);
        let (ok, text) = checked(bad, true);
        let answer: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert!(!ok && answer["ok"] == false);
        assert_eq!(answer["problems"][0]["line"], 2);
        assert_eq!(answer["problems"][1]["key"], "http.rows");
    }
}
