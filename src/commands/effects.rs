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
        user_effects::{EffectFile, Problem, conflicts},
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
        /// Print one JSON document: {ok, files: [{file, name, problems: [{line, column, message, cure}], warnings: [the same]}], conflict}
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
    let apart = conflicts(&files);
    if apart.is_empty() {
        return effects::register(files).map_err(Error::other);
    }
    let line = |(number, problem): &(usize, Problem)| lines(&paths[*number], [problem]);
    Err(Error::EffectFile {
        problems: apart.iter().map(line).collect::<Vec<_>>().join("\n"),
    })
}

fn text_of(path: &Path) -> Result<String, Error> {
    effect_files::read(path).map_err(|source| Error::File {
        path: path.to_path_buf(),
        source,
    })
}

fn lines<'a>(path: &Path, problems: impl IntoIterator<Item = &'a Problem>) -> String {
    let line = |problem: &Problem| format!("{}:{problem}", path.display());
    problems
        .into_iter()
        .map(line)
        .collect::<Vec<_>>()
        .join("\n")
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

/// A file as it was found.
struct Checked<'a> {
    path: &'a Path,
    /// Why it cannot be read.
    unreadable: Option<String>,
    name: Option<String>,
    problems: Vec<Problem>,
    warnings: Vec<Problem>,
}

impl<'a> Checked<'a> {
    /// With the effect, where it is sound by itself.
    fn new(path: &'a Path) -> (Self, Option<EffectFile>) {
        let mut checked = Self {
            path,
            unreadable: None,
            name: None,
            problems: Vec::new(),
            warnings: Vec::new(),
        };
        let text = match effect_files::read(path) {
            Ok(text) => text,
            Err(error) => {
                checked.unreadable = Some(error.to_string());
                return (checked, None);
            }
        };
        match EffectFile::parse(&text) {
            Ok(file) => {
                checked.name = Some(file.name().to_owned());
                checked.warnings = file.warnings().to_vec();
                (checked, Some(file))
            }
            Err(problems) => {
                checked.problems = problems;
                (checked, None)
            }
        }
    }

    fn is_sound(&self) -> bool {
        self.unreadable.is_none() && self.problems.is_empty()
    }

    fn print(&self, out: &mut dyn Write) -> Result<(), Error> {
        let path = self.path.display();
        if let Some(reason) = &self.unreadable {
            writeln!(out, "{path}: {reason}")?;
        }
        if !self.problems.is_empty() {
            writeln!(out, "{}", lines(self.path, &self.problems))?;
        }
        for warning in &self.warnings {
            let Problem {
                line,
                column,
                message,
                cure,
            } = warning;
            writeln!(out, "{path}:{line}:{column}: warning: {message}; {cure}")?;
        }
        let name = self.name.as_deref().unwrap_or_default();
        match self.warnings.len() {
            _ if !self.is_sound() => {}
            0 => writeln!(out, "{path}: no problem, effect `{name}`")?,
            count => writeln!(out, "{path}: {count} warning, effect `{name}` can be used")?,
        }
        Ok(())
    }

    fn document(&self) -> Value {
        let all = |list: &[Problem]| list.iter().map(problem).collect::<Vec<_>>();
        let mut problems = all(&self.problems);
        // The file itself: it has no line.
        let unreadable = self.unreadable.iter();
        problems.extend(
            unreadable.map(|reason| json!({"line": 0, "column": 0, "message": reason, "cure": ""})),
        );
        json!({
            "file": self.path.display().to_string(),
            "name": self.name,
            "problems": problems,
            "warnings": all(&self.warnings),
        })
    }
}

fn check(paths: &[PathBuf], as_json: bool, out: &mut dyn Write) -> Result<(), Error> {
    let (mut told, sound): (Vec<Checked<'_>>, Vec<Option<EffectFile>>) =
        paths.iter().map(|path| Checked::new(path)).unzip();
    // A file that refers to an unsound one would be blamed for it.
    let sound: Option<Vec<EffectFile>> = sound.into_iter().collect();
    let apart = sound.as_deref().map_or_else(Vec::new, conflicts);
    let conflict = apart.first().map(|(_, problem)| problem.message.clone());
    for (number, problem) in apart {
        told[number].problems.push(problem);
    }
    if as_json {
        let files: Vec<Value> = told.iter().map(Checked::document).collect();
        let ok = told.iter().all(Checked::is_sound);
        let document = json!({"ok": ok, "files": files, "conflict": conflict});
        writeln!(out, "{document}")?;
    } else {
        for checked in &told {
            checked.print(out)?;
        }
    }
    if told.iter().all(Checked::is_sound) {
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
        // As the manual says.
        let told = "56:16: unknown variable `V`; did you mean `v`?";
        assert!(!ok && text.contains(&format!("mine.toml:{told}")), "{text}");
        let manual = include_str!("../../docs/adding-an-effect.md");
        assert!(manual.contains(told));
        std::fs::write(&file, sound).unwrap();
        let files = vec![file.clone(), file];
        let (ok, text) = asked(Question::Check { files, json: true });
        let document: Value = serde_json::from_str(&text).unwrap();
        assert!(!ok && document["conflict"].is_string(), "{text}");
    }

    #[test]
    fn a_clash_is_one_line_with_its_place_and_a_warning_leaves_the_file_usable() {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("mine.toml");
        let sound = include_str!("../../examples/effects/recovery_from_file.toml");
        let clash = sound.replace("\"recovery_from_file\"", "\"second_motor\"");
        std::fs::write(&file, clash).unwrap();
        let files = vec![file.clone()];
        let (ok, text) = asked(Question::Check { files, json: false });
        assert!(!ok && text.lines().count() == 1, "{text}");
        let line = 1 + sound.lines().position(|l| l.starts_with("name")).unwrap();
        let place = format!("mine.toml:{line}:9: there is an effect or part `second_motor`");
        assert!(text.contains(&place), "{text}");
        let fragile = sound.replace("k_p*(v - z)", "k_p*(v - z)*sqrt(v - 0.44)");
        std::fs::write(&file, fragile).unwrap();
        let files = vec![file];
        let (ok, text) = asked(Question::Check { files, json: false });
        assert!(ok && text.lines().count() == 2, "{text}");
        assert!(
            text.contains(": warning: active = ") && text.contains("can be used"),
            "{text}"
        );
    }

    #[test]
    fn a_file_that_cannot_be_read_does_not_keep_others_from_being_checked() {
        let directory = tempfile::tempdir().unwrap();
        let [binary, sound] = ["binary.toml", "sound.toml"].map(|n| directory.path().join(n));
        std::fs::write(&binary, b"\xff\xfen\0").unwrap();
        let text = include_str!("../../examples/effects/recovery_from_file.toml");
        std::fs::write(&sound, text).unwrap();
        let files = vec![binary, directory.path().join("absent.toml"), sound];
        let (ok, text) = asked(Question::Check {
            files: files.clone(),
            json: false,
        });
        let lines: Vec<&str> = text.lines().collect();
        assert!(!ok && lines.len() == 3, "{text}");
        assert!(
            lines[0].ends_with("a text in UTF-16; save it as UTF-8"),
            "{text}"
        );
        assert!(
            lines[2].ends_with("no problem, effect `recovery_from_file`"),
            "{text}"
        );
        let (ok, text) = asked(Question::Check { files, json: true });
        let document: Value = serde_json::from_str(&text).unwrap();
        assert!(
            !ok && document["files"][0]["problems"][0]["line"] == 0,
            "{text}"
        );
    }
}
