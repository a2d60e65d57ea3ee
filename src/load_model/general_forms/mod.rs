//! Forms of what no effect of the catalogue describes: written as effect files, tried where the catalogue leaves more than
//! noise, never named as what is missing. Each stands for a kind of dynamics, not for a device: if one explains clearly more than
//! the best effect of the catalogue, something else is there, and the form is where the search for it begins
//! (`docs/general-forms.md`).

use std::sync::OnceLock;

use super::{
    effect::Effect,
    user_effects::{EffectFile, Problem},
};

/// The files.
const FILES: [&str; 4] = [
    include_str!("frequency_rate.toml"),
    include_str!("second_order.toml"),
    include_str!("delayed_block.toml"),
    include_str!("ringing.toml"),
];

/// What the names of all forms begin with.
pub const PREFIX: &str = "general_";
/// What takes its place in a file of fitted values, which is an effect of its own.
const FITTED_PREFIX: &str = "fitted_";

static ALL: OnceLock<Vec<&'static dyn Effect>> = OnceLock::new();

/// All forms, in the order in which they are tried. Their parameters are in pu and s, as those of effect files.
#[must_use]
pub fn all() -> &'static [&'static dyn Effect] {
    ALL.get_or_init(|| {
        let read = FILES.iter().filter_map(|text| EffectFile::parse(text).ok());
        read.map(EffectFile::into_effect).collect()
    })
}

/// The form of this name.
#[must_use]
pub fn find(name: &str) -> Option<&'static dyn Effect> {
    // A name is looked up often, and forms are seldom.
    if !name.starts_with(PREFIX) {
        return None;
    }
    all()
        .iter()
        .copied()
        .find(|form| form.declaration().name == name)
}

/// A form with fitted values of its parameters as an effect file of its own: typical values, and centres of priors, are those.
/// `value` gives the value of a parameter by its name.
///
/// # Errors
///
/// The problems of the file, where values lie outside of the bounds; none for a name that is no form.
pub fn with_values(
    name: &str,
    value: &dyn Fn(&str) -> Option<f64>,
) -> Result<Option<String>, Vec<Problem>> {
    let own = |text: &&&str| text.contains(&format!("name = \"{name}\"\n"));
    let Some(text) = FILES.iter().find(own) else {
        return Ok(None);
    };
    let mut parameter = None;
    let mut lines: Vec<String> = Vec::new();
    for line in text.lines() {
        let of_key = |key: &str| line.strip_prefix(key)?.strip_prefix(" = ");
        if let Some(quoted) = of_key("name") {
            parameter = Some(quoted.trim_matches('"'));
        }
        let fitted = of_key("typical").and_then(|_| value(parameter?));
        lines.push(match fitted {
            Some(x) => format!("typical = {}", written(x)),
            None if of_key("name").is_some() => line.replacen(PREFIX, FITTED_PREFIX, 1),
            None => line.to_owned(),
        });
    }
    let file = lines.join("\n") + "\n";
    EffectFile::parse(&file).map(|_| Some(file))
}

/// Five significant digits, as TOML reads a float.
fn written(x: f64) -> String {
    let text = format!("{x:.4e}");
    let value: f64 = text.parse().unwrap_or(x);
    // Not "-0".
    let plain = format!("{}", value + 0.0);
    if plain.contains(['.', 'e']) {
        plain
    } else {
        format!("{plain}.0")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load_model::{Structure, effects};

    #[test]
    fn every_file_is_sound_and_no_part_of_the_catalogue() {
        for text in FILES {
            let problems = EffectFile::parse(text).err().unwrap_or_default();
            assert!(problems.is_empty(), "{problems:?}");
        }
        assert_eq!(all().len(), FILES.len());
        for form in all() {
            let name = form.declaration().name;
            assert!(name.starts_with(PREFIX) && find(name).is_some());
            assert!(effects::find(name).is_some(), "{name} can be composed");
            let listed = effects::catalogue();
            assert!(listed.iter().all(|e| e.declaration().name != name));
            assert!(Structure::zip_im().with(name).is_ok());
        }
        assert!(find("general_nonsense").is_none() && find("second_motor").is_none());
    }

    #[test]
    fn whatever_a_fit_may_end_at_can_be_written() {
        for form in all() {
            let declaration = form.declaration();
            for corner in 0..1_usize << declaration.parameters.len() {
                let value = |own: &str| {
                    let mut listed = declaration.parameters.iter().enumerate();
                    let (place, p) = listed.find(|(_, p)| p.name == own)?;
                    let upper = corner >> place & 1 == 1;
                    Some(if upper { p.upper } else { p.lower })
                };
                let written = with_values(declaration.name, &value);
                assert!(matches!(written, Ok(Some(_))), "{corner:b}: {written:?}");
            }
        }
    }

    #[test]
    fn a_file_of_fitted_values_is_an_effect_of_its_own() {
        let value = |name: &str| match name {
            "active_gain" => Some(-0.0),
            "time_constant_s" => Some(0.123_456_7),
            _ => None,
        };
        let file = with_values("general_frequency_rate", &value)
            .unwrap()
            .unwrap();
        assert!(file.contains("name = \"fitted_frequency_rate\"\n"));
        assert!(file.contains("name = \"time_constant_s\"\n"));
        assert!(file.contains("typical = 0.12346\n") && file.contains("typical = 0.0\n"));
        let effect = EffectFile::parse(&file).unwrap();
        assert_eq!(effect.name(), "fitted_frequency_rate");
        let outside = |_: &str| Some(1e6);
        assert!(with_values("general_frequency_rate", &outside).is_err());
        assert_eq!(with_values("second_motor", &value), Ok(None));
    }
}
