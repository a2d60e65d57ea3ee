//! Effects written in files, and whether the structures that the configuration asks for exist.

use std::path::{Path, PathBuf};

use super::{Config, Problem, Problems, SiteConfig};
use crate::{
    adapters::effect_files,
    load_model::{
        RangeError, Ranges, Structure, effects,
        user_effects::{EffectFile, conflicts},
    },
};

impl Config {
    /// Makes the effects of the files that the configuration names, and of `more`, known to the rest
    /// of the program, and looks whether every structure asked for is one. To be called before
    /// anything looks an effect up; `file_name` is for the messages only.
    ///
    /// # Errors
    ///
    /// Everything that is wrong with the files or the structures.
    pub fn register_effects(&self, more: &[PathBuf], file_name: &str) -> Result<(), Problems> {
        let mut list = Vec::new();
        let files = self.sound_files(more, &mut list);
        // What an unsound file would have declared cannot be asked for: its absence says nothing.
        if list.is_empty() {
            let paths: Vec<&PathBuf> = self.effect_files.iter().chain(more).collect();
            let apart = conflicts(&files);
            list.extend(apart.iter().map(|(number, told)| {
                let path = paths
                    .get(*number)
                    .map_or_else(String::new, |p| p.display().to_string());
                problem("effects.files", format!("{path}:{told}"))
            }));
            if !files.is_empty()
                && list.is_empty()
                && let Err(error) = effects::register(files)
            {
                list.push(problem("effects.files", error.to_string()));
            }
            self.check_structures(&mut list);
        }
        if list.is_empty() {
            return Ok(());
        }
        Err(Problems {
            file: file_name.to_owned(),
            list,
        })
    }

    fn sound_files(&self, more: &[PathBuf], list: &mut Vec<Problem>) -> Vec<EffectFile> {
        let mut files = Vec::new();
        for path in self.effect_files.iter().chain(more) {
            match read(path) {
                Ok(file) => files.push(file),
                Err(messages) => {
                    list.extend(messages.into_iter().map(|m| problem("effects.files", m)));
                }
            }
        }
        files
    }

    /// Structures, and the parameters of sites.
    fn check_structures(&self, list: &mut Vec<Problem>) {
        if let Err(error) = Structure::parse(&self.identification.structure) {
            list.push(problem("identification.structure", error.to_string()));
        }
        for site in &self.sites {
            let inherited = site.structure == self.identification.structure;
            if !inherited && let Err(error) = Structure::parse(&site.structure) {
                let message = format!("`{}`: {error}", site.site.name);
                list.push(problem("site.structure", message));
            }
            list.extend(parameters(site));
        }
    }
}

/// What is wrong with the parameters of a site, each at its place.
fn parameters(site: &SiteConfig) -> Vec<Problem> {
    let mut found = Vec::new();
    for (k, range) in site.parameters.iter().enumerate() {
        let mut errors = Ranges::new(vec![range.clone()]).err().unwrap_or_default();
        if site.parameters[..k]
            .iter()
            .any(|earlier| earlier.name == range.name)
        {
            let name = range.name.clone();
            errors.push(RangeError::Twice { name });
        }
        let places = site.parameter_places.get(k);
        found.extend(errors.into_iter().map(|error| {
            let place = places.and_then(|places| places.get(error.key()));
            let (line, column) = place.copied().unwrap_or_default();
            let message = format!("`{}`: {error}", site.site.name);
            Problem {
                line,
                column,
                ..problem(&format!("site.parameter.{}", error.key()), message)
            }
        }));
    }
    found
}

fn read(path: &Path) -> Result<EffectFile, Vec<String>> {
    let shown = path.display();
    let text = effect_files::read(path).map_err(|error| vec![format!("{shown}: {error}")])?;
    EffectFile::parse(&text).map_err(|problems| {
        let told = problems.iter().map(|p| format!("{shown}:{p}"));
        told.collect()
    })
}

fn problem(key: &str, message: String) -> Problem {
    Problem {
        line: 0,
        column: 0,
        key: key.to_owned(),
        message,
        allowed: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_and_structure_that_cannot_be_used_is_told() {
        let directory = tempfile::tempdir().unwrap();
        let unsound = directory.path().join("unsound.toml");
        std::fs::write(&unsound, "name = 3\n").unwrap();
        let mut config = Config {
            effect_files: vec![unsound, directory.path().join("absent.toml")],
            ..Config::default()
        };
        let told = config.register_effects(&[], "c.toml").unwrap_err();
        let text = told.to_string();
        assert!(text.contains("unsound.toml:1"), "{text}");
        assert!(text.contains("absent.toml"), "{text}");
        config.effect_files.clear();
        config.identification.structure.push("magic".to_owned());
        let told = config.register_effects(&[], "c.toml").unwrap_err();
        assert_eq!(told.list.len(), 1);
        assert!(told.to_string().contains("unknown model part `magic`"));
        config.identification.structure.pop();
        assert_eq!(config.register_effects(&[], "c.toml"), Ok(()));
    }

    #[test]
    fn a_parameter_of_a_site_is_checked_against_its_declaration() {
        let text = |upper: f64| {
            format!(
                "[[site]]\nname = \"north\"\ns_base_mva = 40\nv_base_kv = 110\nnominal_hz = 50\n\
                 [[site.parameter]]\nname = \"second_motor.inertia_s\"\nlower = 0.3\nupper = {upper}\n"
            )
        };
        let config = Config::parse(&text(0.9), "c.toml").unwrap();
        assert_eq!(config.sites[0].parameters[0].upper, Some(0.9));
        assert_eq!(config.register_effects(&[], "c.toml"), Ok(()));
        let config = Config::parse(&text(60.0), "c.toml").unwrap();
        let told = config.register_effects(&[], "c.toml").unwrap_err();
        let told = told.to_string();
        assert!(
            told.starts_with(
                "c.toml:9:9: site.parameter.upper: `north`: `second_motor.inertia_s`: upper is 60"
            ),
            "{told}"
        );
        let renamed = text(0.9).replace("second_motor.inertia_s", "M");
        let told = Config::parse(&renamed, "c.toml").unwrap();
        let told = told
            .register_effects(&[], "c.toml")
            .unwrap_err()
            .to_string();
        assert!(
            told.starts_with("c.toml:7:8: site.parameter.name: `north`: `M` is not set here"),
            "{told}"
        );
    }
}
