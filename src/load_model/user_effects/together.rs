//! What keeps sound files from being registered together, each conflict at its place.

use super::{EffectFile, Problem, problem::suggestion};
use crate::load_model::effects::{RegisterError, can_be_together, catalogue};

/// Everything that keeps the files apart, with the number of the file that is to be changed; empty where they can be
/// registered together.
#[must_use]
pub fn conflicts(files: &[EffectFile]) -> Vec<(usize, Problem)> {
    let mut left: Vec<(usize, EffectFile)> = files.iter().cloned().enumerate().collect();
    let mut found = Vec::new();
    // Each round takes away what it has told.
    loop {
        let list: Vec<EffectFile> = left.iter().map(|(_, file)| file.clone()).collect();
        let Err(error) = can_be_together(&list) else {
            return found;
        };
        let (name, other) = match &error {
            RegisterError::Known { name } | RegisterError::Twice { name } => (name.as_str(), None),
            RegisterError::UnknownOther { name, other } => (name.as_str(), Some(other.as_str())),
            _ => ("", None),
        };
        let cure = match &error {
            RegisterError::Twice { .. } => "rename one".to_owned(),
            RegisterError::UnknownOther { name, other } => known(name, other, files),
            // The message says it.
            _ => String::new(),
        };
        let refers = |file: &EffectFile| {
            let mut others = file.others();
            other.is_none_or(|other| others.any(|known| known == other))
        };
        // Of two with one name the last is to be changed.
        let named = left
            .iter()
            .rposition(|(_, file)| file.name() == name && refers(file));
        let Some((number, file)) = named.and_then(|place| left.get_mut(place)) else {
            let number = left.last().map_or(0, |(number, _)| *number);
            found.push((number, Problem::at([1, 1], error.to_string(), cure)));
            return found;
        };
        let place = file.place_of(other.unwrap_or(name));
        found.push((*number, Problem::at(place, error.to_string(), cure)));
        match (other, named) {
            (Some(other), _) => file.forget(other),
            (None, Some(place)) => drop(left.remove(place)),
            (None, None) => return found,
        }
    }
}

/// The effect that may have been meant by `other`, or where effects are listed.
fn known(name: &str, other: &str, files: &[EffectFile]) -> String {
    if name == other {
        return "an effect does not refer to itself".to_owned();
    }
    let built_in = catalogue().iter().map(|effect| effect.declaration().name);
    let known = built_in.chain(files.iter().map(EffectFile::name));
    let told = suggestion(other, known);
    if told.starts_with("did you mean") {
        return told;
    }
    "name an effect of `loadmodeld effects list` or of a file that is given, too".to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load_model::user_effects::tests::SOUND;

    fn file(text: &str) -> EffectFile {
        EffectFile::parse(text).unwrap()
    }

    #[test]
    fn every_conflict_is_told_once_at_its_place() {
        let referring = SOUND.replace(
            "[[parameters]]\nname = \"gain\"",
            "resembles = [\"exponential_recovry\", \"second_motor\"]\n[[excludes]]\nother = \"nothing\"\n\
             reason = \"a test\"\n[[parameters]]\nname = \"gain\"",
        );
        let taken = SOUND.replace("\"recovery\"", "\"second_motor\"");
        let files = [file(&referring), file(&taken), file(SOUND)];
        let found = conflicts(&files);
        let told: Vec<String> = found.iter().map(|(k, p)| format!("{k} {p}")).collect();
        assert_eq!(told.len(), 4, "{told:?}");
        for (words, place) in [
            ("did you mean `exponential_recovery`?", "0 5:14"),
            ("effects list", "0 7:10"),
            ("`second_motor` already; choose another name", "1 2:"),
            (
                "two effect files have the name `recovery`; rename one",
                "2 2:",
            ),
        ] {
            let line = told.iter().find(|line| line.contains(words));
            assert!(
                line.is_some_and(|line| line.starts_with(place)),
                "{words}: {told:?}"
            );
        }
        assert_eq!(conflicts(&files[2..]), []);
    }
}
