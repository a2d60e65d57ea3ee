//! The effects that can be hidden in a site: names, parameters, typical ranges.

use super::{Random, TruthError, effect_parameters::parameters_of};

/// An effect of the catalogue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Effect {
    /// Resistance in the motors' stators.
    StatorResistance,
    /// Motor power is torque times frequency.
    FrequencyScaledPower,
    /// Static load that follows the frequency.
    StaticFrequencyDependence,
    /// A second group of motors.
    SecondMotor,
    /// Motors that trip in dips.
    MotorUndervoltageTrip,
    /// Electronics that switch off.
    ElectronicLoadDropout,
    /// A block that disconnects for good.
    SelfDisconnection,
    /// Load that recovers.
    ExponentialRecovery,
    /// Generation inside the load.
    DistributedGeneration,
    /// Generation or load that leaves with the frequency.
    FrequencyTrip,
    /// Torque that follows the speed.
    SpeedDependentTorque,
    /// An impedance before the load.
    FeederImpedance,
    /// Two cages.
    DoubleCageRotor,
    /// Taps that move.
    TapChanger,
    /// Stalling air conditioners.
    SinglePhaseAcStall,
    /// Saturation of the motors' main flux.
    Saturation,
    /// Lamps that go out.
    DischargeLighting,
    /// Contactors that let go.
    ContactorDropout,
    /// Constant power that becomes impedance.
    LowVoltageConversion,
    /// Drift.
    LoadRamp,
    /// Currents late against voltages.
    TimeSkew,
    /// A long phasor window.
    PhasorWindow,
    /// An angle error between current and voltage.
    RatioPhaseError,
    /// A frequency estimate of its own.
    FrequencyTracking,
}

impl Effect {
    /// Every effect.
    pub const ALL: [Self; 24] = [
        Self::StatorResistance,
        Self::FrequencyScaledPower,
        Self::StaticFrequencyDependence,
        Self::SecondMotor,
        Self::MotorUndervoltageTrip,
        Self::ElectronicLoadDropout,
        Self::SelfDisconnection,
        Self::ExponentialRecovery,
        Self::DistributedGeneration,
        Self::SpeedDependentTorque,
        Self::FeederImpedance,
        Self::DoubleCageRotor,
        Self::TapChanger,
        Self::SinglePhaseAcStall,
        Self::Saturation,
        Self::DischargeLighting,
        Self::ContactorDropout,
        Self::LowVoltageConversion,
        Self::LoadRamp,
        Self::TimeSkew,
        Self::PhasorWindow,
        Self::RatioPhaseError,
        Self::FrequencyTracking,
        // Last: parameters are drawn by place.
        Self::FrequencyTrip,
    ];

    /// Name in the catalogue, in truth files and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::StatorResistance => "stator_resistance",
            Self::FrequencyScaledPower => "frequency_scaled_power",
            Self::StaticFrequencyDependence => "static_frequency_dependence",
            Self::SecondMotor => "second_motor",
            Self::MotorUndervoltageTrip => "motor_undervoltage_trip",
            Self::ElectronicLoadDropout => "electronic_load_dropout",
            Self::SelfDisconnection => "self_disconnection",
            Self::ExponentialRecovery => "exponential_recovery",
            Self::DistributedGeneration => "distributed_generation",
            Self::FrequencyTrip => "frequency_trip",
            Self::SpeedDependentTorque => "speed_dependent_torque",
            Self::FeederImpedance => "feeder_impedance",
            Self::DoubleCageRotor => "double_cage_rotor",
            Self::TapChanger => "tap_changer",
            Self::SinglePhaseAcStall => "single_phase_ac_stall",
            Self::Saturation => "saturation",
            Self::DischargeLighting => "discharge_lighting",
            Self::ContactorDropout => "contactor_dropout",
            Self::LowVoltageConversion => "low_voltage_conversion",
            Self::LoadRamp => "load_ramp",
            Self::TimeSkew => "time_skew",
            Self::PhasorWindow => "phasor_window",
            Self::RatioPhaseError => "ratio_phase_error",
            Self::FrequencyTracking => "frequency_tracking",
        }
    }

    /// The effect of that name.
    ///
    /// # Errors
    ///
    /// [`TruthError::UnknownEffect`].
    pub fn named(name: &str) -> Result<Self, TruthError> {
        let found = Self::ALL.into_iter().find(|effect| effect.name() == name);
        found.ok_or_else(|| TruthError::UnknownEffect {
            name: name.to_owned(),
        })
    }

    /// Whether the measurement does it and not the load.
    #[must_use]
    pub const fn is_instrument(self) -> bool {
        matches!(
            self,
            Self::TimeSkew | Self::PhasorWindow | Self::RatioPhaseError | Self::FrequencyTracking
        )
    }

    /// Whether it changes what motors do, so that without motors nothing of it is seen.
    #[must_use]
    pub const fn is_of_motors(self) -> bool {
        matches!(
            self,
            Self::StatorResistance
                | Self::FrequencyScaledPower
                | Self::SecondMotor
                | Self::MotorUndervoltageTrip
                | Self::SpeedDependentTorque
                | Self::DoubleCageRotor
                | Self::Saturation
        )
    }

    /// Its parameters.
    #[must_use]
    pub fn parameters(self) -> &'static [EffectParameter] {
        parameters_of(self)
    }
}

/// A parameter of an effect.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EffectParameter {
    /// Name, with its unit.
    pub name: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Range from which it is drawn.
    pub typical: (f64, f64),
    /// Whether the drawn value may as well be negative.
    pub either_sign: bool,
    /// Range in which it must lie.
    pub admissible: (f64, f64),
    /// Whether it is a whole number.
    pub counts: bool,
    /// Words for the values 0, 1, ..., where the parameter is a choice.
    pub choices: &'static [&'static str],
}

impl EffectParameter {
    fn drawn(&self, random: &mut Random) -> f64 {
        if !self.choices.is_empty() {
            return random.below(self.choices.len()) as f64;
        }
        let size = random.between(self.typical.0, self.typical.1);
        let negative = random.uniform() < 0.5;
        if negative && self.either_sign {
            -size
        } else {
            size
        }
    }

    /// The word for `value`, where the parameter is a choice.
    #[must_use]
    pub fn word(&self, value: f64) -> Option<&'static str> {
        let mut words = self.choices.iter().enumerate();
        words
            .find(|(index, _)| (*index as f64 - value).abs() < 0.5)
            .map(|(_, word)| *word)
    }
}

/// An effect with values for its parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct HiddenEffect {
    effect: Effect,
    values: Vec<f64>,
}

impl HiddenEffect {
    /// `effect` with parameters drawn from their typical ranges; the same seed gives the same ones.
    #[must_use]
    pub fn drawn(effect: Effect, seed: u64) -> Self {
        let number = Effect::ALL.iter().position(|other| *other == effect);
        let mut random = Random::for_part(seed, EFFECT_PARTS + number.unwrap_or(0) as u64);
        let mut values: Vec<_> = effect
            .parameters()
            .iter()
            .map(|parameter| parameter.drawn(&mut random))
            .collect();
        if effect == Effect::SecondMotor {
            contrast(&mut values, &mut random);
        }
        Self { effect, values }
    }

    /// Which effect it is.
    #[must_use]
    pub const fn effect(&self) -> Effect {
        self.effect
    }

    /// Gives `parameter` the value that `text` says: a number, or a word where it is a choice.
    ///
    /// # Errors
    ///
    /// [`TruthError::UnknownParameter`] and [`TruthError::ParameterOutOfRange`].
    pub fn set(&mut self, parameter: &str, text: &str) -> Result<(), TruthError> {
        let declared = self.effect.parameters();
        let found = declared.iter().position(|p| p.name == parameter);
        let index = found.ok_or_else(|| TruthError::UnknownParameter {
            effect: self.effect.name(),
            parameter: parameter.to_owned(),
            known: names(declared),
        })?;
        let declared = &declared[index];
        let word = declared.choices.iter().position(|choice| *choice == text);
        let value = word.map_or_else(|| text.parse().unwrap_or(f64::NAN), |word| word as f64);
        let (low, high) = declared.admissible;
        let may_be_broken = declared.choices.is_empty() && !declared.counts;
        let whole = may_be_broken || value.fract().abs() < f64::EPSILON;
        if !(low..=high).contains(&value) || !whole {
            return Err(TruthError::ParameterOutOfRange {
                effect: self.effect.name(),
                parameter: declared.name,
                given: text.to_owned(),
                required: if may_be_broken {
                    format!("{low} to {high}")
                } else if declared.counts {
                    format!("a whole number from {low} to {high}")
                } else {
                    declared.choices.join(" or ")
                },
            });
        }
        self.values[index] = value;
        Ok(())
    }

    /// Name, declaration and value of every parameter.
    pub fn values(&self) -> impl Iterator<Item = (&'static EffectParameter, f64)> + '_ {
        let declared = self.effect.parameters().iter();
        declared.zip(self.values.iter().copied())
    }

    /// The value of the parameter called `name`; 0 if there is none, which a test excludes for
    /// every name the simulator uses.
    #[must_use]
    pub fn value(&self, name: &str) -> f64 {
        let mut values = self.values();
        let found = values.find(|(declared, _)| declared.name == name);
        debug_assert!(found.is_some(), "{} has no {name}", self.effect.name());
        found.map_or(0.0, |(_, value)| value)
    }

    /// The word of the choice called `name`.
    #[must_use]
    pub fn choice(&self, name: &str) -> &'static str {
        let mut values = self.values();
        let found = values.find(|(declared, _)| declared.name == name);
        found.and_then(|(d, value)| d.word(value)).unwrap_or("")
    }
}

/// First part of the random numbers that effects use; events use those from 1 on.
const EFFECT_PARTS: u64 = 1_000_000;

fn names(parameters: &[EffectParameter]) -> String {
    if parameters.is_empty() {
        return "none".to_owned();
    }
    let names: Vec<_> = parameters.iter().map(|p| p.name).collect();
    names.join(", ")
}

/// Two groups of motors that are alike are one: half of the drawn ones are heavy with little slip,
/// the other half light with much.
fn contrast(values: &mut [f64], random: &mut Random) {
    let heavy = random.uniform() < 0.5;
    let parameters = Effect::SecondMotor.parameters();
    for (parameter, value) in parameters.iter().zip(values) {
        let range = match (parameter.name, heavy) {
            ("inertia_s", true) => (1.3, 2.0),
            ("inertia_s", false) => (0.12, 0.3),
            ("rotor_resistance_pu", true) => (0.008, 0.011),
            ("rotor_resistance_pu", false) => (0.032, 0.045),
            _ => continue,
        };
        *value = random.between(range.0, range.1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_catalogue_and_lead_back() {
        for effect in Effect::ALL {
            assert_eq!(Effect::named(effect.name()).unwrap(), effect);
        }
        let error = Effect::named("tap").unwrap_err().to_string();
        assert!(error.starts_with("no effect is called `tap`"), "{error}");
    }

    #[test]
    fn drawn_parameters_are_typical_and_the_same_for_the_same_seed() {
        for effect in Effect::ALL {
            for seed in 0..40 {
                let drawn = HiddenEffect::drawn(effect, seed);
                assert_eq!(drawn, HiddenEffect::drawn(effect, seed));
                for (parameter, value) in drawn.values() {
                    let (low, high) = parameter.admissible;
                    assert!((low..=high).contains(&value), "{effect:?} {parameter:?}");
                    let (least, most) = parameter.typical;
                    if parameter.choices.is_empty() {
                        assert!((least..=most).contains(&value.abs()) || value >= least);
                    } else {
                        assert!(parameter.word(value).is_some());
                    }
                }
            }
        }
    }

    #[test]
    fn declarations_are_complete() {
        for effect in Effect::ALL {
            let parameters = effect.parameters();
            for (index, parameter) in parameters.iter().enumerate() {
                let twice = parameters[..index].iter().any(|p| p.name == parameter.name);
                assert!(!twice && !parameter.meaning.is_empty(), "{parameter:?}");
                let ((a, b), (low, high)) = (parameter.typical, parameter.admissible);
                assert!(low <= a && a <= b && b <= high, "{effect:?} {parameter:?}");
                assert!(!parameter.either_sign || low <= -b, "{parameter:?}");
            }
        }
    }

    #[test]
    fn a_parameter_can_be_given_and_a_wrong_one_is_named() {
        let mut hidden = HiddenEffect::drawn(Effect::DistributedGeneration, 1);
        hidden.set("share", "0.3").unwrap();
        hidden.set("behaviour", "trip").unwrap();
        assert!((hidden.value("share") - 0.3).abs() < 1e-15);
        assert_eq!(hidden.choice("behaviour"), "trip");
        let error = hidden.set("share", "3").unwrap_err().to_string();
        assert_eq!(
            error,
            "distributed_generation.share must be 0 to 0.8, got 3"
        );
        let error = hidden.set("behaviour", "sleep").unwrap_err().to_string();
        assert!(error.contains("momentary_cessation or trip"), "{error}");
        let mut counted = HiddenEffect::drawn(Effect::SelfDisconnection, 1);
        counted.set("dips", "2").unwrap();
        let error = counted.set("dips", "2.5").unwrap_err().to_string();
        assert_eq!(
            error,
            "self_disconnection.dips must be a whole number from 1 to 9, got 2.5"
        );
        let error = hidden.set("size", "3").unwrap_err().to_string();
        assert!(
            error.contains("has no parameter `size`; it has share"),
            "{error}"
        );
        let mut skew = HiddenEffect::drawn(Effect::TimeSkew, 1);
        assert!(skew.set("skew_s", "late").is_err());
    }
}
