//! Which parts a model is made of.

use super::{effect::Effect, effects, general_forms, ranges::Ranges};

/// A composed load model: `zip`, `induction_motor`, and effects. The parts are named as in the
/// catalogue (`docs/effects`); the order is the order of the parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Structure {
    parts: Vec<Part>,
    /// What the site knows of the parameters.
    ranges: Ranges,
}

/// A part of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Name in configuration, JSON, file names.
    pub name: &'static str,
    /// Version of its equations; raised whenever the same parameters give another output.
    pub version: u32,
}

/// A name that is not in the catalogue, or a combination that makes no sense.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StructureError {
    /// No such part.
    #[error("unknown model part `{name}`; known: {known}")]
    Unknown {
        /// The name.
        name: String,
        /// All known names.
        known: String,
    },
    /// The same part twice.
    #[error("model part `{name}` appears twice")]
    Twice {
        /// The name.
        name: String,
    },
    /// A part that was to be taken out is not there.
    #[error("`{name}` is not part of the structure")]
    NotThere {
        /// The name.
        name: String,
    },
    /// A part every structure needs is absent.
    #[error("a structure needs `{name}`")]
    Absent {
        /// The name.
        name: &'static str,
    },
    /// Two parts that cannot be together.
    #[error("`{name}` cannot be combined with `{other}`, because {reason}")]
    Excluded {
        /// The part that says so.
        name: &'static str,
        /// The other.
        other: &'static str,
        /// Why.
        reason: &'static str,
    },
}

/// Parts of every structure.
const BASE: [Part; 2] = [
    Part {
        name: "zip",
        version: 1,
    },
    Part {
        name: "induction_motor",
        version: 1,
    },
];

fn part(effect: &dyn Effect) -> Part {
    let declaration = effect.declaration();
    Part {
        name: declaration.name,
        version: declaration.version,
    }
}

/// All parts there are, in the order of the catalogue.
fn known() -> impl Iterator<Item = Part> {
    let effects = effects::catalogue().iter().map(|e| part(*e));
    BASE.into_iter().chain(effects)
}

impl Structure {
    /// The reference paper's model: static ZIP and third-order induction motor.
    #[must_use]
    pub fn zip_im() -> Self {
        Self {
            parts: BASE.to_vec(),
            ranges: Ranges::default(),
        }
    }

    /// Looks the names up.
    ///
    /// # Errors
    ///
    /// [`StructureError`] for an unknown, repeated or absent part, and for parts that exclude each
    /// other.
    pub fn parse<T: AsRef<str>>(names: &[T]) -> Result<Self, StructureError> {
        let mut parts: Vec<Part> = Vec::new();
        for name in names {
            let name = name.as_ref().trim();
            let form = || general_forms::find(name).map(part);
            let part = known()
                .find(|p| p.name == name)
                .or_else(form)
                .ok_or_else(|| {
                    let known = known().map(|p| p.name).collect::<Vec<_>>().join(", ");
                    StructureError::Unknown {
                        name: name.to_owned(),
                        known,
                    }
                })?;
            if parts.contains(&part) {
                return Err(StructureError::Twice {
                    name: name.to_owned(),
                });
            }
            parts.push(part);
        }
        for Part { name, .. } in BASE {
            if !parts.iter().any(|p| p.name == name) {
                return Err(StructureError::Absent { name });
            }
        }
        let structure = Self {
            parts,
            ranges: Ranges::default(),
        };
        structure.check_exclusions()?;
        Ok(structure)
    }

    /// This structure and one more effect.
    ///
    /// # Errors
    ///
    /// As [`Structure::parse`].
    pub fn with(&self, effect: &str) -> Result<Self, StructureError> {
        let mut names = self.names();
        names.push(effect.to_owned());
        Ok(Self::parse(&names)?.with_ranges(self.ranges.clone()))
    }

    /// This structure with one effect less.
    ///
    /// # Errors
    ///
    /// [`StructureError::NotThere`], and as [`Structure::parse`].
    pub fn without(&self, effect: &str) -> Result<Self, StructureError> {
        if !self.contains(effect) {
            let name = effect.to_owned();
            return Err(StructureError::NotThere { name });
        }
        let mut names = self.names();
        names.retain(|name| name != effect);
        Ok(Self::parse(&names)?.with_ranges(self.ranges.clone()))
    }

    /// The same parts with the bounds and priors of a site, in place of those it had.
    #[must_use]
    pub fn with_ranges(self, ranges: Ranges) -> Self {
        Self { ranges, ..self }
    }

    /// The bounds and priors of the site; empty where the declarations hold.
    #[must_use]
    pub const fn ranges(&self) -> &Ranges {
        &self.ranges
    }

    /// The structure without its effects: ZIP and motor.
    #[must_use]
    pub fn plain_part(&self) -> Self {
        let base = BASE.map(|p| p.name);
        let kept = |p: &&Part| base.contains(&p.name);
        Self {
            parts: self.parts.iter().filter(kept).copied().collect(),
            ranges: self.ranges.clone(),
        }
    }

    fn check_exclusions(&self) -> Result<(), StructureError> {
        for effect in self.effects() {
            let declaration = effect.declaration();
            let found = declaration.excludes.iter().find(|e| self.contains(e.other));
            if let Some(exclusion) = found {
                return Err(StructureError::Excluded {
                    name: declaration.name,
                    other: exclusion.other,
                    reason: exclusion.reason,
                });
            }
        }
        Ok(())
    }

    /// The effects, in order.
    pub fn effects(&self) -> impl Iterator<Item = &'static dyn Effect> {
        self.parts.iter().filter_map(|p| effects::find(p.name))
    }

    /// Whether the structure has this part.
    #[must_use]
    pub fn contains(&self, name: &str) -> bool {
        self.parts.iter().any(|p| p.name == name)
    }

    /// The names, in order.
    #[must_use]
    pub fn names(&self) -> Vec<String> {
        self.parts.iter().map(|p| p.name.to_owned()).collect()
    }

    /// The versions, in the order of the names.
    #[must_use]
    pub fn versions(&self) -> Vec<u32> {
        self.parts.iter().map(|p| p.version).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_structure_names_every_part_once_and_has_zip_and_motor() {
        assert_eq!(
            Structure::parse(&["zip", "induction_motor"]).unwrap(),
            Structure::zip_im()
        );
        assert!(matches!(
            Structure::parse(&["zip"]),
            Err(StructureError::Absent { .. })
        ));
        assert!(matches!(
            Structure::parse(&["zip", "zip"]),
            Err(StructureError::Twice { .. })
        ));
        assert!(matches!(
            Structure::parse(&["zap"]),
            Err(StructureError::Unknown { .. })
        ));
    }

    #[test]
    fn the_plain_part_has_no_effect() {
        let more = Structure::zip_im().with("frequency_scaled_power").unwrap();
        let more = more.with("second_motor").unwrap();
        assert_eq!(more.plain_part(), Structure::zip_im());
    }

    #[test]
    fn every_exclusion_names_an_effect_that_is_there() {
        for effect in effects::catalogue() {
            let declaration = effect.declaration();
            for other in declaration.excludes {
                assert!(effects::find(other.other).is_some(), "{}", declaration.name);
            }
        }
    }
}
