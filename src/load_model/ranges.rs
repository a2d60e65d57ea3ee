//! What a site knows of its parameters better than the declarations do: narrower bounds, other priors.
//!
//! The names are those of a parameter set: `effect.parameter`, a shared parameter, or a linear
//! coefficient of ZIP and motor. Bounds lie within the declared ones, because between these the equations
//! are tested (`composed::contract`).

use super::{
    composed::BASE,
    effect::{Parameter, Role, Scale},
    effects::{STATIC_LAG, catalogue},
};

/// Bounds and prior of one parameter at one site; what is `None` stays as declared.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ParameterRange {
    /// Name of the parameter.
    pub name: String,
    /// Lower bound, inclusive, in the parameter's unit.
    pub lower: Option<f64>,
    /// Upper bound, inclusive.
    pub upper: Option<f64>,
    /// Centre of the prior, in the parameter's unit on either scale.
    pub centre: Option<f64>,
    /// Standard deviation of the prior: in the parameter's unit, or of its natural logarithm where the
    /// declaration's prior is logarithmic.
    pub deviation: Option<f64>,
}

/// The ranges of a site, each checked against its declaration. Empty by default.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranges(Vec<ParameterRange>);

/// Why a range cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RangeError {
    /// No such parameter.
    #[error("unknown parameter `{name}`; near it: {near}")]
    Unknown {
        /// The name.
        name: String,
        /// Parameters that are known and resemble it.
        near: String,
    },
    /// The same parameter twice.
    #[error("parameter `{name}` is given twice")]
    Twice {
        /// The name.
        name: String,
    },
    /// A coordinate of the search.
    #[error("`{name}` is a coordinate of the search, whose box is the same for every site")]
    Coordinate {
        /// The name.
        name: String,
    },
    /// A bound that is none or beyond the declared ones.
    #[error("`{name}`: {key} is {value}, which must lie within {lower} to {upper}")]
    Outside {
        /// The parameter.
        name: String,
        /// `lower`, `upper` or `centre`.
        key: &'static str,
        /// The value.
        value: f64,
        /// What is admissible.
        lower: f64,
        /// What is admissible.
        upper: f64,
    },
    /// Bounds that leave nothing.
    #[error("`{name}`: lower is {lower} and upper {upper}, which leaves nothing between them")]
    Empty {
        /// The parameter.
        name: String,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// An amplitude that could not vanish.
    #[error("`{name}` makes its effect vanish at {neutral}, which the bounds must contain")]
    CannotVanish {
        /// The parameter.
        name: String,
        /// Its neutral value.
        neutral: f64,
    },
    /// No deviation.
    #[error("`{name}`: deviation is {value}, which must be a positive number")]
    Deviation {
        /// The parameter.
        name: String,
        /// The value.
        value: f64,
    },
    /// Something else than bounds that are whole numbers.
    #[error("`{name}` counts: it takes bounds that are whole numbers, and no prior")]
    Count {
        /// The parameter.
        name: String,
    },
    /// A prior where there is none of its own.
    #[error("`{name}` takes bounds only: a coefficient of ZIP and motor has no prior of its own")]
    NoPrior {
        /// The parameter.
        name: String,
    },
}

/// The declaration of a parameter by its name in a set.
fn declared(name: &str) -> Option<Parameter> {
    let base = BASE.iter().chain([&STATIC_LAG.1]);
    if let Some(base) = base.copied().find(|p| p.name == name) {
        return Some(base);
    }
    let own = |effect: &'static str, p: &Parameter| match p.role {
        Role::Shared => name == p.name,
        _ => name.split_once('.') == Some((effect, p.name)),
    };
    catalogue().iter().find_map(|effect| {
        let d = effect.declaration();
        d.parameters.iter().find(|p| own(d.name, p)).copied()
    })
}

/// Names that share the effect, or the parameter, with an unknown one.
fn near(name: &str) -> String {
    const SHOWN_MAX: usize = 8;
    let (effect, own) = name.split_once('.').unwrap_or((name, name));
    let base = BASE
        .iter()
        .filter(|p| p.role == Role::Base && !is_coordinate(p));
    let base = base.map(|p| p.name.to_owned());
    let of_effects = catalogue().iter().flat_map(|e| {
        let d = e.declaration();
        let parts = d.parameters.iter();
        parts.map(|p| match p.role {
            Role::Shared => p.name.to_owned(),
            _ => format!("{}.{}", d.name, p.name),
        })
    });
    let known: Vec<String> = base.chain(of_effects).collect();
    let like = |k: &&String| k.starts_with(effect) || k.ends_with(own);
    let mut found: Vec<&str> = known.iter().filter(like).map(String::as_str).collect();
    found.dedup();
    if found.is_empty() {
        found = known.iter().map(String::as_str).collect();
    }
    found.truncate(SHOWN_MAX);
    found.join(", ")
}

/// `ln_alpha`, `ln_nu`, `kappa`.
fn is_coordinate(declared: &Parameter) -> bool {
    BASE.iter().take(3).any(|p| p.name == declared.name)
}

impl ParameterRange {
    fn check(&self) -> Result<(), RangeError> {
        let name = || self.name.clone();
        let Some(declared) = declared(&self.name) else {
            let near = near(&self.name);
            return Err(RangeError::Unknown { name: name(), near });
        };
        let is_base = declared.role == Role::Base;
        if is_base && is_coordinate(&declared) {
            return Err(RangeError::Coordinate { name: name() });
        }
        if is_base && (self.centre.is_some() || self.deviation.is_some()) {
            return Err(RangeError::NoPrior { name: name() });
        }
        let within = declared.lower..=declared.upper;
        let given = [
            ("lower", self.lower),
            ("upper", self.upper),
            ("centre", self.centre),
        ];
        for (key, value) in given {
            if let Some(value) = value.filter(|v| !within.contains(v)) {
                let (lower, upper) = (declared.lower, declared.upper);
                return Err(RangeError::Outside {
                    name: name(),
                    key,
                    value,
                    lower,
                    upper,
                });
            }
        }
        let lower = self.lower.unwrap_or(declared.lower);
        let upper = self.upper.unwrap_or(declared.upper);
        let counts = declared.role == Role::Count;
        let is_whole = |bound: f64| bound.fract().abs() < f64::EPSILON;
        let has_prior = self.centre.is_some() || self.deviation.is_some();
        if counts && (has_prior || !is_whole(lower) || !is_whole(upper)) {
            return Err(RangeError::Count { name: name() });
        }
        // A count may be known.
        if lower > upper || lower >= upper && !counts {
            return Err(RangeError::Empty {
                name: name(),
                lower,
                upper,
            });
        }
        let neutral = declared.neutral;
        if declared.is_amplitude() && !(lower..=upper).contains(&neutral) {
            return Err(RangeError::CannotVanish {
                name: name(),
                neutral,
            });
        }
        match self.deviation {
            Some(value) if !(value.is_finite() && value > 0.0) => Err(RangeError::Deviation {
                name: name(),
                value,
            }),
            _ => Ok(()),
        }
    }

    fn applied(&self, declared: Parameter) -> Parameter {
        let mut p = declared;
        p.lower = self.lower.unwrap_or(p.lower);
        p.upper = self.upper.unwrap_or(p.upper);
        p.prior.deviation = self.deviation.unwrap_or(p.prior.deviation);
        p.prior.centre = self.centre.unwrap_or(p.prior.centre);
        if let (Some(centre), true) = (self.centre, matches!(p.role, Role::Shape | Role::Shared)) {
            p.typical = centre;
        }
        p.typical = p.typical.clamp(p.lower, p.upper);
        if !p.is_amplitude() {
            // What does no harm while the effect is absent is the value to start from.
            p.neutral = p.typical;
        }
        debug_assert!(p.prior.scale == Scale::Linear || p.lower > 0.0);
        p
    }
}

impl Ranges {
    /// Ranges that fit their declarations.
    ///
    /// # Errors
    ///
    /// Every [`RangeError`] there is.
    pub fn new(list: Vec<ParameterRange>) -> Result<Self, Vec<RangeError>> {
        let mut errors: Vec<RangeError> = list.iter().filter_map(|r| r.check().err()).collect();
        for (k, range) in list.iter().enumerate() {
            if list[..k].iter().any(|earlier| earlier.name == range.name) {
                let name = range.name.clone();
                errors.push(RangeError::Twice { name });
            }
        }
        if errors.is_empty() {
            Ok(Self(list))
        } else {
            Err(errors)
        }
    }

    /// The range of a parameter.
    #[must_use]
    pub fn of(&self, name: &str) -> Option<&ParameterRange> {
        self.0.iter().find(|range| range.name == name)
    }

    /// The declaration as it holds at this site.
    #[must_use]
    pub fn applied(&self, name: &str, declared: Parameter) -> Parameter {
        self.of(name)
            .map_or(declared, |range| range.applied(declared))
    }

    /// Narrows the bounds of the linear coefficients of ZIP and motor, in their order, to this site's.
    pub fn narrow_linear(&self, lower: &mut [f64], upper: &mut [f64]) {
        let linear = BASE.iter().skip(3);
        for ((p, lower), upper) in linear.zip(lower).zip(upper) {
            if let Some(range) = self.of(p.name) {
                *lower = range.lower.map_or(*lower, |value| value.max(*lower));
                *upper = range.upper.map_or(*upper, |value| value.min(*upper));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::load_model::{ComposedModel, Structure};

    fn range(name: &str, lower: f64, upper: f64) -> ParameterRange {
        ParameterRange {
            name: name.to_owned(),
            lower: Some(lower),
            upper: Some(upper),
            ..ParameterRange::default()
        }
    }

    /// Values that are handed on, never computed with.
    fn same(found: &[f64], expected: &[f64]) {
        let bits = |values: &[f64]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(found), bits(expected), "{found:?} {expected:?}");
    }

    #[test]
    fn a_range_changes_its_parameter_in_every_model_of_the_structure() {
        let known = ParameterRange {
            centre: Some(0.4),
            deviation: Some(0.1),
            ..range("second_motor.inertia_s", 0.3, 0.5)
        };
        let ranges = Ranges::new(vec![known, range("motor_share", 0.3, 0.6)]).unwrap();
        let structure = Structure::zip_im().with_ranges(ranges);
        let model = ComposedModel::new(&structure.with("second_motor").unwrap());
        let of = |name: &str| model.parameters()[model.index(name).unwrap()].declaration;
        let inertia = of("second_motor.inertia_s");
        same(&[inertia.lower, inertia.upper], &[0.3, 0.5]);
        same(&[inertia.typical, inertia.neutral], &[0.4, 0.4]);
        same(
            &[inertia.prior.centre, inertia.prior.deviation],
            &[0.4, 0.1],
        );
        same(
            &[of("motor_share").upper, of("second_motor.slip").upper],
            &[0.6, 0.06],
        );
        assert_eq!(structure.plain_part(), structure);
    }

    #[test]
    fn a_count_takes_whole_bounds_and_may_be_known() {
        let name = "self_disconnection.dips";
        let ranges = Ranges::new(vec![range(name, 2.0, 2.0)]).unwrap();
        let structure = Structure::zip_im().with_ranges(ranges);
        let model = ComposedModel::new(&structure.with("self_disconnection").unwrap());
        let at = model.index(name).unwrap();
        same(&[model.typical()[at], model.neutral()[at]], &[2.0, 2.0]);
        let count = vec![RangeError::Count {
            name: name.to_owned(),
        }];
        let with_prior = ParameterRange {
            centre: Some(2.0),
            ..range(name, 1.0, 2.0)
        };
        for wrong in [range(name, 1.5, 3.0), with_prior] {
            assert_eq!(Ranges::new(vec![wrong]).unwrap_err(), count);
        }
        assert!(matches!(
            Ranges::new(vec![range(name, 3.0, 2.0)]).unwrap_err()[..],
            [RangeError::Empty { .. }]
        ));
    }

    #[test]
    fn linear_coefficients_are_narrowed_and_never_widened() {
        let ranges = Ranges::new(vec![range("active_linear", -0.1, 0.5)]).unwrap();
        let (mut lower, mut upper) = ([0.1, -0.4, 0.0, -1.5, -2.0], [0.95, 1.2, 1.4, 2.0, 2.5]);
        ranges.narrow_linear(&mut lower, &mut upper);
        same(&lower, &[0.1, -0.4, 0.0, -1.5, -2.0]);
        same(&upper, &[0.95, 1.2, 0.5, 2.0, 2.5]);
    }

    #[test]
    fn everything_that_is_wrong_is_told_with_name_and_figures() {
        let told = |list: Vec<ParameterRange>| {
            let errors = Ranges::new(list).unwrap_err();
            let words: Vec<String> = errors.iter().map(ToString::to_string).collect();
            words.join("\n")
        };
        let prior = |name: &str, deviation: f64| ParameterRange {
            name: name.to_owned(),
            deviation: Some(deviation),
            ..ParameterRange::default()
        };
        for (given, expected) in [
            (range("second_motor.slpi", 0.1, 0.2), "second_motor.slip"),
            (range("kappa", 0.1, 0.2), "coordinate of the search"),
            (range("motor_reactance", 0.1, 2.0), "within 1.2 to 5"),
            (range("motor_reactance", 3.0, 2.0), "leaves nothing"),
            (range("second_motor.share", 0.1, 0.2), "vanish at 0"),
            (range("motor_reactance", f64::NAN, 2.0), "lower is NaN"),
            (prior("motor_reactance", 0.0), "positive number"),
            (prior("motor_share", 0.1), "bounds only"),
        ] {
            let words = told(vec![given]);
            assert!(words.contains(expected), "{words}");
        }
        let twice = vec![range("motor_share", 0.3, 0.6); 2];
        assert!(told(twice).contains("given twice"));
    }
}
