//! What can be profiled, by name.

use nalgebra::DVector;

use crate::{
    identification::{
        estimates::coordinate_names,
        joint_problem::{OUTER, ProblemOptions, outer_bounds},
        quantities::{DERIVED, PARAMETERS, Quantity, gradient, parameters_at},
    },
    load_model::LoadBase,
};

/// There is no such quantity.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("no quantity `{name}` can be profiled; known: {known}")]
pub struct UnknownQuantity {
    /// The name asked for.
    pub name: String,
    /// The names there are.
    pub known: String,
}

/// Names of everything that can be profiled: parameters, engineering units, coordinates.
#[must_use]
pub fn names() -> Vec<&'static str> {
    let quantities = PARAMETERS.iter().chain(DERIVED).map(|q| q.name);
    let coordinates = coordinate_names().into_iter().filter(|name| *name != "Kpm");
    quantities.chain(coordinates).collect()
}

/// The quantity of a profile as a function of the eight coordinates and the reactance on the motor's
/// own base.
#[derive(Clone, Copy)]
pub(super) enum Target {
    Quantity(&'static Quantity),
    Coordinate {
        index: usize,
        name: &'static str,
        bounds: (f64, f64),
    },
}

impl Target {
    /// By name; `H` stands for `inertia_h`, and a coordinate may carry the prefix it has in a
    /// parameter set.
    pub(super) fn named(name: &str, options: &ProblemOptions) -> Result<Self, UnknownQuantity> {
        let wanted = match name {
            "H" => "inertia_h",
            other => other.strip_prefix("coordinate_").unwrap_or(other),
        };
        let mut quantities = PARAMETERS.iter().chain(DERIVED);
        if let Some(quantity) = quantities.find(|q| q.name == wanted) {
            return Ok(Self::Quantity(quantity));
        }
        let found = (coordinate_names().into_iter().enumerate()).find(|(_, n)| *n == wanted);
        let Some((index, name)) = found else {
            return Err(UnknownQuantity {
                name: name.to_owned(),
                known: names().join(", "),
            });
        };
        let outer = outer_bounds();
        let bounds = if index < OUTER {
            (outer.lower[index], outer.upper[index])
        } else {
            let i = index - OUTER;
            (options.linear_lower[i], options.linear_upper[i])
        };
        Ok(Self::Coordinate {
            index,
            name,
            bounds,
        })
    }

    pub(super) const fn name(&self) -> &'static str {
        match self {
            Self::Quantity(quantity) => quantity.name,
            Self::Coordinate { name, .. } => name,
        }
    }

    pub(super) const fn meaning(&self) -> &'static str {
        match self {
            Self::Quantity(quantity) => quantity.meaning,
            Self::Coordinate { .. } => "coordinate that P and Q determine",
        }
    }

    pub(super) const fn unit(&self) -> &'static str {
        match self {
            Self::Quantity(quantity) => quantity.unit,
            Self::Coordinate { .. } => "1",
        }
    }

    pub(super) const fn bounds(&self) -> (f64, f64) {
        match self {
            Self::Quantity(quantity) => quantity.bounds,
            Self::Coordinate { bounds, .. } => *bounds,
        }
    }

    /// Whether it moves along the null direction.
    pub(super) const fn in_valley(&self) -> bool {
        match self {
            Self::Quantity(quantity) => quantity.in_valley,
            Self::Coordinate { .. } => false,
        }
    }

    pub(super) fn value(&self, at: &DVector<f64>, base: &LoadBase) -> f64 {
        self.of(at.as_slice(), base)
    }

    pub(super) fn gradient(&self, at: &DVector<f64>, base: &LoadBase) -> DVector<f64> {
        gradient(at.as_slice(), |x| self.of(x, base))
    }

    fn of(&self, at: &[f64], base: &LoadBase) -> f64 {
        match self {
            Self::Quantity(quantity) => {
                let (coordinates, reactance) = at.split_at(at.len() - 1);
                (quantity.value)(&parameters_at(coordinates, reactance[0], base))
            }
            Self::Coordinate { index, .. } => at[*index],
        }
    }
}
