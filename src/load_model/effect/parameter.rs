//! The parameters of effects: role, bounds, prior, and what their unit refers to.

/// What a parameter's prior is normal in, and a search walks in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// The parameter itself.
    Linear,
    /// Its natural logarithm.
    Logarithmic,
}

/// A weak normal prior: it decides only what the data leave open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Centre, in the parameter's own unit on either scale.
    pub centre: f64,
    /// Standard deviation, on the scale; infinite when nothing is known.
    pub deviation: f64,
    /// Linear or logarithmic.
    pub scale: Scale,
}

/// How a parameter goes with the operating point of an event. Declared values hold at 1 pu voltage
/// and, where power enters, at 1 pu load. Everything is simulated on the base of an event's own P0 and
/// V0, where the same equipment has other figures whenever those differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reference {
    /// It does not depend on it.
    Anywhere,
    /// An impedance on the initial power of a group of motors, `~ V0^-2`: at another load there are
    /// more or fewer of the same motors.
    GroupImpedance,
    /// The logarithm of a group's admittance, `~ ln V0^2`.
    LogarithmOfGroupAdmittance,
    /// An impedance that is there whatever the load, `~ P0/V0^2`.
    FixedImpedance,
    /// A voltage that a relay, a rectifier or iron knows, in pu of the nominal one, `~ 1/V0`.
    Voltage,
    /// An admittance on the power of a group of loads that draw constant power, `~ V0^2`.
    GroupAdmittance,
}

impl Reference {
    /// The value on the base of an event, and its derivative with respect to the declared one.
    #[must_use]
    pub fn on_event_base(self, declared: f64, v0_pu: f64, p0_pu: f64) -> (f64, f64) {
        let square = v0_pu * v0_pu;
        let factor = match self {
            Self::Anywhere => 1.0,
            Self::LogarithmOfGroupAdmittance => return (declared + square.ln(), 1.0),
            Self::GroupImpedance => 1.0 / square,
            Self::FixedImpedance => p0_pu / square,
            Self::Voltage => 1.0 / v0_pu,
            Self::GroupAdmittance => square,
        };
        (factor * declared, factor)
    }

    /// Where a declared value holds, in words; `None` where that is everywhere.
    pub(super) const fn holds(self) -> Option<&'static str> {
        match self {
            Self::Anywhere => None,
            Self::GroupImpedance | Self::LogarithmOfGroupAdmittance | Self::GroupAdmittance => {
                Some("at 1 pu voltage")
            }
            Self::FixedImpedance => Some("at 1 pu voltage and load"),
            Self::Voltage => Some("of the nominal voltage, whatever V0 is"),
        }
    }

    /// The declared value of one on the base of an event.
    #[must_use]
    pub fn declared(self, on_event_base: f64, v0_pu: f64, p0_pu: f64) -> f64 {
        let (zero, slope) = self.on_event_base(0.0, v0_pu, p0_pu);
        (on_event_base - zero) / slope
    }
}

/// What a parameter does to its effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Role {
    /// At its neutral value, which is its lower bound, the effect is absent.
    OneSidedAmplitude {
        /// Smallest value worth reporting.
        meaningful: f64,
    },
    /// At its neutral value the effect is absent; may have both signs.
    TwoSidedAmplitude {
        /// Smallest distance from the neutral value worth reporting.
        meaningful: f64,
    },
    /// Meaningless while the amplitudes are neutral.
    Shape,
    /// A shape that is a whole number: a search tries one after the other, and a fit leaves it as it is.
    Count,
    /// A shape under one name for all effects that declare it: a structure holds it once.
    Shared,
    /// A parameter of ZIP and motor, in every structure.
    Base,
}

/// One parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameter {
    /// Name in configuration and JSON; the unit comes last.
    pub name: &'static str,
    /// Symbol in the file's equations.
    pub symbol: &'static str,
    /// Unit, `"1"` when dimensionless.
    pub unit: &'static str,
    /// Lower bound, inclusive.
    pub lower: f64,
    /// Upper bound, inclusive.
    pub upper: f64,
    /// Where an amplitude vanishes; for a shape, a value that does no harm (the typical one).
    pub neutral: f64,
    /// A common value, to start from.
    pub typical: f64,
    /// What is believed without data.
    pub prior: Prior,
    /// Amplitude or shape.
    pub role: Role,
    /// How it goes with the operating point.
    pub reference: Reference,
    /// Standard deviation of what the effect's form leaves open by itself; part of the standard error.
    pub resolution: f64,
}

impl Parameter {
    /// The same with another dependence on the operating point.
    #[must_use]
    pub const fn with_reference(self, reference: Reference) -> Self {
        Self { reference, ..self }
    }

    /// The same, believed without data to be about `centre`.
    #[must_use]
    pub const fn with_centre(self, centre: f64) -> Self {
        let prior = Prior {
            centre,
            ..self.prior
        };
        Self { prior, ..self }
    }

    /// Whether the effect vanishes at the neutral value (of all its amplitudes).
    #[must_use]
    pub const fn is_amplitude(&self) -> bool {
        matches!(
            self.role,
            Role::OneSidedAmplitude { .. } | Role::TwoSidedAmplitude { .. }
        )
    }

    /// Whether it is a shape of the effect's own.
    #[must_use]
    pub const fn is_shape(&self) -> bool {
        matches!(self.role, Role::Shape | Role::Count)
    }

    /// Whether a fit may change it.
    #[must_use]
    pub const fn can_be_free(&self) -> bool {
        !matches!(self.role, Role::Count)
    }

    /// An amplitude between 0 and `upper` with the neutral value 0 and no prior.
    #[must_use]
    pub const fn one_sided(
        [name, symbol, unit]: [&'static str; 3],
        [typical, upper, meaningful]: [f64; 3],
    ) -> Self {
        Self {
            name,
            symbol,
            unit,
            lower: 0.0,
            upper,
            neutral: 0.0,
            typical,
            prior: Prior {
                centre: 0.0,
                deviation: f64::INFINITY,
                scale: Scale::Linear,
            },
            role: Role::OneSidedAmplitude { meaningful },
            reference: Reference::Anywhere,
            resolution: 0.0,
        }
    }

    /// An amplitude of either sign with the neutral value 0 and no prior.
    #[must_use]
    pub const fn two_sided(
        [name, symbol, unit]: [&'static str; 3],
        [lower, typical, upper, meaningful]: [f64; 4],
    ) -> Self {
        Self {
            name,
            symbol,
            unit,
            lower,
            upper,
            neutral: 0.0,
            typical,
            prior: Prior {
                centre: 0.0,
                deviation: f64::INFINITY,
                scale: Scale::Linear,
            },
            role: Role::TwoSidedAmplitude { meaningful },
            reference: Reference::Anywhere,
            resolution: 0.0,
        }
    }

    /// A shape with a normal prior around its typical value.
    #[must_use]
    pub const fn shape(
        [name, symbol, unit]: [&'static str; 3],
        [lower, typical, upper]: [f64; 3],
        deviation: f64,
    ) -> Self {
        Self {
            name,
            symbol,
            unit,
            lower,
            upper,
            neutral: typical,
            typical,
            prior: Prior {
                centre: typical,
                deviation,
                scale: Scale::Linear,
            },
            role: Role::Shape,
            reference: Reference::Anywhere,
            resolution: 0.0,
        }
    }

    /// A count between `lower` and `upper`, `lower` where nothing else is known.
    #[must_use]
    pub const fn count(names: [&'static str; 3], [lower, upper]: [f64; 2]) -> Self {
        Self {
            role: Role::Count,
            ..Self::shape(names, [lower, lower, upper], 1.0)
        }
    }

    /// A positive shape whose logarithm has a normal prior around that of its typical value.
    #[must_use]
    pub const fn positive_shape(names: [&'static str; 3], range: [f64; 3], deviation: f64) -> Self {
        let linear = Self::shape(names, range, deviation);
        Self {
            prior: Prior {
                centre: linear.typical,
                deviation,
                scale: Scale::Logarithmic,
            },
            ..linear
        }
    }
}

/// The motor's reactance `X` on its own initial power, at 1 pu. A plain third-order motor does not
/// need it (`1/x` is absorbed by a constant-impedance load); losses, coasting and saturation do.
/// Range: stator plus magnetising reactance of 2 to 5 pu on the rating (Kundur, "Power System
/// Stability and Control", table 7.1, from memory), at 60 to 90 % loading.
pub const MOTOR_REACTANCE: Parameter = Parameter {
    role: Role::Shared,
    reference: Reference::GroupImpedance,
    ..Parameter::positive_shape(
        ["motor_reactance", "x", "1"],
        [1.2, TYPICAL_MOTOR_REACTANCE, 5.0],
        0.3,
    )
};

/// `X` where nothing declares it: about 3 pu on the rating, at 75 % loading.
pub const TYPICAL_MOTOR_REACTANCE: f64 = 2.2;
