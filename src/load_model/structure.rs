//! Which parts a model is made of.

/// A composed load model: `zip`, `induction_motor`, and effects. The parts are named as in the
/// catalogue (`docs/effects`); the order is the order of the parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Structure {
    parts: Vec<&'static Part>,
}

/// A part of a model.
#[derive(Debug, PartialEq, Eq)]
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
    /// A part every structure needs is absent.
    #[error("a structure needs `{name}`")]
    Absent {
        /// The name.
        name: &'static str,
    },
}

const CATALOGUE: &[Part] = &[
    Part {
        name: "zip",
        version: 1,
    },
    Part {
        name: "induction_motor",
        version: 1,
    },
    Part {
        name: "frequency_scaled_power",
        version: 1,
    },
];

impl Structure {
    /// The reference paper's model: static ZIP and third-order induction motor.
    #[must_use]
    pub fn zip_im() -> Self {
        Self {
            parts: CATALOGUE.iter().take(2).collect(),
        }
    }

    /// Looks the names up.
    ///
    /// # Errors
    ///
    /// [`StructureError`] for an unknown, repeated or absent part.
    pub fn parse<T: AsRef<str>>(names: &[T]) -> Result<Self, StructureError> {
        let mut parts: Vec<&'static Part> = Vec::new();
        for name in names {
            let name = name.as_ref().trim();
            let part = CATALOGUE.iter().find(|p| p.name == name).ok_or_else(|| {
                let known = CATALOGUE
                    .iter()
                    .map(|p| p.name)
                    .collect::<Vec<_>>()
                    .join(", ");
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
        for name in ["zip", "induction_motor"] {
            if !parts.iter().any(|p| p.name == name) {
                return Err(StructureError::Absent { name });
            }
        }
        Ok(Self { parts })
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
}
