//! What a site knows of its parameters better than the declarations do: narrower bounds, other priors.
//!
//! The names are those of a parameter set: `effect.parameter`, a shared parameter, or a linear
//! coefficient of ZIP and motor. Bounds lie within the declared ones, because between these the equations
//! are tested (`composed::contract`).

use super::{
    composed::BASE,
    effect::{Parameter, Role, Scale},
    effects::{STATIC_LAG, catalogue},
    user_effects::nearest,
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
    #[error("unknown parameter `{name}`; {near}")]
    Unknown {
        /// The name.
        name: String,
        /// What may have been meant, or what is known.
        near: String,
    },
    /// The same parameter twice.
    #[error("parameter `{name}` is given twice")]
    Twice {
        /// The name.
        name: String,
    },
    /// A coordinate of the search, or what is computed from others.
    #[error("`{name}` is not set here: {from}")]
    Computed {
        /// The name.
        name: String,
        /// From what it comes.
        from: &'static str,
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

impl RangeError {
    /// The key of a `[[site.parameter]]` that is at fault.
    #[must_use]
    pub const fn key(&self) -> &'static str {
        match self {
            Self::Unknown { .. } | Self::Twice { .. } | Self::Computed { .. } => "name",
            Self::Outside { key, .. } => key,
            Self::Empty { .. } | Self::CannotVanish { .. } | Self::Count { .. } => "lower",
            Self::Deviation { .. } | Self::NoPrior { .. } => "deviation",
        }
    }
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

/// What an unknown name may have meant, or what there is.
fn near(name: &str) -> String {
    /// Parameters of sets have short names of their own.
    const IN_SETS: [(&str, &str); 1] = [("Kpm", "motor_share")];
    let base = BASE.iter().filter(|p| !is_coordinate(p));
    let base: Vec<&str> = base.chain([&STATIC_LAG.1]).map(|p| p.name).collect();
    let (mut shared, mut own) = (Vec::new(), Vec::new());
    for d in catalogue().iter().map(|e| e.declaration()) {
        for p in d.parameters {
            match p.role {
                Role::Shared => shared.push(p.name.to_owned()),
                _ => own.push(format!("{}.{}", d.name, p.name)),
            }
        }
    }
    shared.sort();
    shared.dedup();
    let of_all = shared.iter().chain(&own).map(String::as_str);
    let of_all = base.iter().copied().chain(of_all);
    let in_sets = IN_SETS.iter().find(|(short, _)| *short == name);
    if let Some(meant) = in_sets
        .map(|(_, long)| *long)
        .or_else(|| nearest(name, of_all))
    {
        return format!("did you mean `{meant}`?");
    }
    let (effect, last) = name.split_once('.').unwrap_or(("", name));
    let of_effect = |known: &&String| known.split_once('.').is_some_and(|(e, _)| e == effect);
    let known: Vec<&str> = own.iter().filter(of_effect).map(String::as_str).collect();
    if !known.is_empty() {
        return format!("`{effect}` has {}", known.join(", "));
    }
    let same = |known: &&String| known.split_once('.').is_some_and(|(_, p)| p == last);
    let same: Vec<&str> = own.iter().filter(same).map(String::as_str).collect();
    if effect.is_empty() && !same.is_empty() {
        return format!("with its effect it is one of {}", same.join(", "));
    }
    format!(
        "known are {}, {}, and EFFECT.PARAMETER as `loadmodeld effects list` tells them",
        base.join(", "),
        shared.join(", ")
    )
}

/// Names in a parameter set of what is computed from other parameters, and from which.
const COMPUTED: [(&[&str], &str); 3] = [
    (
        &[
            "M",
            "T0_prime",
            "X",
            "X_prime",
            "inertia_h",
            "H",
            "slip",
            "ln_alpha",
            "ln_nu",
            "kappa",
        ],
        "the first motor is sought in `ln_alpha`, `ln_nu` and `kappa`, from which its constants are computed and whose \
         box is the same for every site (decision 0025); of motors, only those of effects (`second_motor.inertia_s`) are \
         set here",
    ),
    (
        &["Pz", "Pi", "Pp"],
        "it is computed from `active_quadratic` and `active_linear`, which take bounds",
    ),
    (
        &["Qz", "Qi", "Qq"],
        "it is computed from `reactive_quadratic` and `reactive_linear`, which take bounds",
    ),
];

fn computed(name: &str) -> Option<&'static str> {
    let own = name.strip_prefix("induction_motor.").unwrap_or(name);
    let found = COMPUTED.iter().find(|(names, _)| names.contains(&own));
    found.map(|(_, from)| *from)
}

/// `ln_alpha`, `ln_nu`, `kappa`.
fn is_coordinate(declared: &Parameter) -> bool {
    BASE.iter().take(3).any(|p| p.name == declared.name)
}

impl ParameterRange {
    fn check(&self) -> Result<(), RangeError> {
        let name = || self.name.clone();
        if let Some(from) = computed(&self.name) {
            return Err(RangeError::Computed { name: name(), from });
        }
        let Some(declared) = declared(&self.name) else {
            let near = near(&self.name);
            return Err(RangeError::Unknown { name: name(), near });
        };
        let is_base = declared.role == Role::Base;
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
            (
                range("second_motor.slpi", 0.1, 0.2),
                "did you mean `second_motor.slip`?",
            ),
            (
                range("second_motor.size_of_it", 0.1, 0.2),
                "`second_motor` has second_motor.share",
            ),
            (
                range("motor_sahre", 0.1, 0.2),
                "did you mean `motor_share`?",
            ),
            (range("Kpm", 0.1, 0.2), "did you mean `motor_share`?"),
            (
                range("inertia_s", 0.1, 0.2),
                "with its effect it is one of second_motor.inertia_s",
            ),
            (
                range("colour", 0.1, 0.2),
                "known are motor_share, active_quadratic",
            ),
            (
                range("kappa", 0.1, 0.2),
                "`kappa` is not set here: the first motor",
            ),
            (range("X_prime", 0.1, 0.2), "(decision 0025)"),
            (range("Pz", 0.1, 0.2), "`active_quadratic` and"),
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
