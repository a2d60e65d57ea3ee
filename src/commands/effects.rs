//! `loadmodeld effects`: what effects there are, what one of them says about itself, and whether an
//! effect file is sound.

use std::{
    io::Write,
    path::{Path, PathBuf},
};

use serde_json::{Value, json};

use super::{Error, misuse};
use crate::{
    adapters::{
        effect_files,
        http::{effect_document, effect_kind_name},
    },
    load_model::{
        effect::page,
        effects,
        user_effects::{EffectFile, Problem},
    },
};

/// Arguments of `effects`.
#[derive(Debug, clap::Args)]
pub struct EffectsArgs {
    #[command(subcommand)]
    question: Question,
}

#[derive(Debug, clap::Subcommand)]
enum Question {
    /// List all effects, those of --effect-file included
    List {
        /// Print one JSON document
        #[arg(long)]
        json: bool,
    },
    /// Show what an effect is, its equations, parameters with priors, states and needs
    Show {
        /// Name of the effect
        name: String,
        /// Print one JSON document
        #[arg(long)]
        json: bool,
    },
    /// Tell every problem of effect files at once; exit 1 when there is one
    Check {
        /// Effect files, checked together
        #[arg(value_name = "FILE", required = true)]
        files: Vec<PathBuf>,
        /// Print one JSON document: {ok, files: [{file, name, problems: [{line, column, message, cure}]}], conflict}
        #[arg(long)]
        json: bool,
    },
}

/// Answers.
///
/// # Errors
///
/// An unknown name (wrong usage), an unsound file, a file that cannot be read, or `out`.
pub fn run(args: &EffectsArgs, out: &mut dyn Write) -> Result<(), Error> {
    match &args.question {
        Question::List { json } => list(*json, out),
        Question::Show { name, json } => show(name, *json, out),
        Question::Check { files, json } => check(files, *json, out),
    }
}

/// Makes the effects of files known to the rest of the program. To be called before anything else.
///
/// # Errors
///
/// A file that cannot be read or is unsound, or files that cannot be together.
pub(super) fn register(paths: &[PathBuf]) -> Result<(), Error> {
    if paths.is_empty() {
        return Ok(());
    }
    let mut files = Vec::new();
    for path in paths {
        let outcome = EffectFile::parse(&text_of(path)?);
        files.push(outcome.map_err(|problems| Error::EffectFile {
            problems: lines(path, &problems),
        })?);
    }
    effects::register(files).map_err(Error::other)
}

fn text_of(path: &Path) -> Result<String, Error> {
    effect_files::read(path).map_err(|source| Error::File {
        path: path.to_path_buf(),
        source,
    })
}

fn lines(path: &Path, problems: &[Problem]) -> String {
    let line = |problem: &Problem| format!("{}:{problem}", path.display());
    problems.iter().map(line).collect::<Vec<_>>().join("\n")
}

fn list(as_json: bool, out: &mut dyn Write) -> Result<(), Error> {
    let declarations = effects::catalogue().iter().map(|e| e.declaration());
    if as_json {
        let all: Vec<Value> = declarations.map(effect_document).collect();
        return Ok(writeln!(out, "{}", json!({ "effects": all }))?);
    }
    for d in declarations {
        let parameters: Vec<&str> = d.parameters.iter().map(|p| p.name).collect();
        writeln!(
            out,
            "{:30} {:10} {}: {}",
            d.name,
            effect_kind_name(d.kind),
            d.title,
            parameters.join(", ")
        )?;
    }
    Ok(())
}

fn show(name: &str, as_json: bool, out: &mut dyn Write) -> Result<(), Error> {
    let Some(effect) = effects::find(name) else {
        let names: Vec<&str> = effects::catalogue()
            .iter()
            .map(|e| e.declaration().name)
            .collect();
        let message = format!(
            "unknown effect `{name}`; known: {}; general forms: {}",
            names.join(", "),
            misuse::names_of_general_forms()
        );
        return Err(Error::Usage(message));
    };
    let declaration = effect.declaration();
    if as_json {
        return Ok(writeln!(out, "{}", effect_document(declaration))?);
    }
    let described = effects::description(name);
    let described = described.unwrap_or_else(|| declaration.title.to_owned());
    Ok(write!(out, "{}", page(declaration, &described))?)
}

fn check(paths: &[PathBuf], as_json: bool, out: &mut dyn Write) -> Result<(), Error> {
    let mut sound = Vec::new();
    let mut told = Vec::new();
    for path in paths {
        let outcome = EffectFile::parse(&text_of(path)?);
        let (name, problems) = match outcome {
            Ok(file) => {
                let name = file.name().to_owned();
                sound.push(file);
                (Some(name), Vec::new())
            }
            Err(problems) => (None, problems),
        };
        if !as_json {
            match &name {
                Some(name) => writeln!(out, "{}: no problem, effect `{name}`", path.display())?,
                None => writeln!(out, "{}", lines(path, &problems))?,
            }
        }
        let problems: Vec<Value> = problems.iter().map(problem).collect();
        told.push(json!({"file": path.display().to_string(), "name": name, "problems": problems}));
    }
    // A file that refers to an unsound one would be blamed for it.
    let complete = sound.len() == paths.len();
    let conflict = complete
        .then(|| effects::can_be_together(&sound).err())
        .flatten();
    let conflict = conflict.map(|c| c.to_string());
    let ok = complete && conflict.is_none();
    if as_json {
        writeln!(
            out,
            "{}",
            json!({"ok": ok, "files": told, "conflict": conflict})
        )?;
    } else if let Some(conflict) = conflict {
        writeln!(out, "{conflict}")?;
    }
    if ok {
        Ok(())
    } else {
        Err(Error::UnusableEffectFile)
    }
}

fn problem(problem: &Problem) -> Value {
    json!({
        "line": problem.line,
        "column": problem.column,
        "message": problem.message,
        "cure": problem.cure,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked(question: Question) -> (bool, String) {
        let mut out = Vec::new();
        let ok = run(&EffectsArgs { question }, &mut out).is_ok();
        (ok, String::from_utf8(out).unwrap())
    }

    #[test]
    fn every_effect_is_listed_and_can_be_shown() {
        let (ok, text) = asked(Question::List { json: false });
        assert!(ok && text.lines().count() == effects::catalogue().len());
        for effect in effects::catalogue() {
            let name = effect.declaration().name.to_owned();
            assert!(text.contains(&name));
            let (ok, shown) = asked(Question::Show { name, json: true });
            let document: Value = serde_json::from_str(&shown).unwrap();
            assert!(ok && document["parameters"].is_array());
        }
        let name = "no_such".to_owned();
        let unknown = EffectsArgs {
            question: Question::Show { name, json: false },
        };
        assert!(run(&unknown, &mut Vec::new()).unwrap_err().is_usage());
    }

    #[test]
    fn what_is_shown_says_what_the_manual_says() {
        let name = "discharge_lighting".to_owned();
        let (ok, shown) = asked(Question::Show { name, json: false });
        assert!(ok && shown.contains("Missing, it leaves") && shown.contains("(2)"));
        assert!(
            shown.contains("| 100 | 3 of the natural logarithm |"),
            "{shown}"
        );
        for line in [
            "States: `lit` (1)",
            "Cannot be combined with",
            "Resembles: ",
            "Version ",
        ] {
            assert!(shown.contains(line), "{line}: {shown}");
        }
    }

    #[test]
    fn a_file_is_checked_with_places_and_cures() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("mine.toml");
        let sound = include_str!("../../examples/effects/recovery_from_file.toml");
        std::fs::write(&file, sound.replace("k_p*(v - z)", "k_p*(V - z)")).unwrap();
        let files = vec![file.clone()];
        let (ok, text) = asked(Question::Check { files, json: false });
        assert!(!ok && text.contains("did you mean `v`?"), "{text}");
        std::fs::write(&file, sound).unwrap();
        let files = vec![file.clone(), file];
        let (ok, text) = asked(Question::Check { files, json: true });
        let document: Value = serde_json::from_str(&text).unwrap();
        assert!(!ok && document["conflict"].is_string(), "{text}");
    }
}
