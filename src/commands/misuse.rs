//! What is wrong with a command line before anything is read or computed.

use crate::{
    identification::IdentificationError,
    load_model::{Structure, general_forms, structure::StructureError},
};

/// How a command line asks for what cannot be.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Misuse {
    /// An event to be fitted and held out.
    #[error(
        "event `{event}` is named by --train and by --hold-out: an event that is fitted proves nothing; name it once"
    )]
    FittedAndHeldOut {
        /// The event.
        event: String,
    },
    /// An effect to be added and removed.
    #[error("effect `{effect}` is named by --add and by --remove; name it once")]
    AddedAndRemoved {
        /// The effect.
        effect: String,
    },
    /// An effect that shall be removed is not there.
    #[error("`{effect}` cannot be removed: the structure is {structure}")]
    NotInStructure {
        /// The effect.
        effect: String,
        /// The structure.
        structure: String,
    },
    /// A part that is neither an effect nor a general form.
    #[error("{unknown}; general forms, which can be added too: {forms}")]
    UnknownPart {
        /// The name, and the effects.
        unknown: StructureError,
        /// The general forms.
        forms: String,
    },
    /// A structure that cannot be composed.
    #[error(transparent)]
    Structure(StructureError),
}

impl From<StructureError> for Misuse {
    fn from(error: StructureError) -> Self {
        match error {
            unknown @ StructureError::Unknown { .. } => Self::UnknownPart {
                unknown,
                forms: names_of_general_forms(),
            },
            other => Self::Structure(other),
        }
    }
}

/// Names of the general forms, which the catalogue does not list.
pub(super) fn names_of_general_forms() -> String {
    let forms = general_forms::all().iter();
    let names: Vec<&str> = forms.map(|form| form.declaration().name).collect();
    names.join(", ")
}

/// An error of a command that may be the fault of whoever typed it.
pub(super) trait MayBeMisuse: std::error::Error + Send + Sync + 'static {
    /// Whether the command was used wrongly.
    fn is_misuse(&self) -> bool;
}

/// Whether a fit was asked for events that are not there.
pub(super) const fn names_no_event(error: &IdentificationError) -> bool {
    matches!(error, IdentificationError::UnknownEvent { .. })
}

/// Refuses an event in both lists.
///
/// # Errors
///
/// [`Misuse::FittedAndHeldOut`].
pub(super) fn no_event_twice(train: &[String], hold_out: &[String]) -> Result<(), Misuse> {
    match train.iter().find(|event| hold_out.contains(event)) {
        None => Ok(()),
        Some(event) => Err(Misuse::FittedAndHeldOut {
            event: event.clone(),
        }),
    }
}

/// Refuses a structure that cannot be composed, and changes of it that cannot be made.
///
/// # Errors
///
/// [`Misuse::UnknownPart`], [`Misuse::Structure`], [`Misuse::AddedAndRemoved`], [`Misuse::NotInStructure`].
pub(super) fn no_impossible_change(
    parts: &[String],
    add: &[String],
    remove: &[String],
) -> Result<(), Misuse> {
    Structure::parse(parts)?;
    if let Some(effect) = add.iter().find(|effect| remove.contains(effect)) {
        return Err(Misuse::AddedAndRemoved {
            effect: effect.clone(),
        });
    }
    if let Some(effect) = remove.iter().find(|effect| !parts.contains(effect)) {
        return Err(Misuse::NotInStructure {
            effect: effect.clone(),
            structure: parts.join(" + "),
        });
    }
    let kept: Vec<String> = (parts.iter())
        .filter(|part| !remove.contains(part))
        .cloned()
        .collect();
    let mut changed = Structure::parse(&kept)?;
    for effect in add {
        changed = changed.with(effect)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(of: &[&str]) -> Vec<String> {
        of.iter().map(|name| (*name).to_owned()).collect()
    }

    #[test]
    fn an_event_is_fitted_or_held_out() {
        let twice = |train: &[&str], held: &[&str]| no_event_twice(&names(train), &names(held));
        assert!(twice(&["a", "b"], &["c"]).is_ok() && twice(&[], &["c"]).is_ok());
        let error = twice(&["a", "b"], &["b"]).unwrap_err().to_string();
        assert!(
            error.contains("`b`") && error.contains("--hold-out"),
            "{error}"
        );
    }

    #[test]
    fn changes_that_cannot_be_made_are_named() {
        let told = |add: &[&str], remove: &[&str]| {
            let parts = names(&["zip", "induction_motor", "saturation"]);
            let outcome = no_impossible_change(&parts, &names(add), &names(remove));
            outcome.map_err(|error| error.to_string()).err()
        };
        assert_eq!(
            told(&["second_motor", "general_ringing"], &["saturation"]),
            None
        );
        let contains = |told: Option<String>, words: &str| {
            assert!(told.as_ref().is_some_and(|t| t.contains(words)), "{told:?}");
        };
        contains(told(&["saturation"], &["saturation"]), "--remove");
        contains(told(&["saturation"], &[]), "appears twice");
        contains(told(&[], &["second_motor"]), "cannot be removed");
        contains(told(&["nonsense"], &[]), "general_ringing");
        contains(told(&[], &["zip"]), "needs `zip`");
    }
}
