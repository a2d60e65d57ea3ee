//! The catalogue of effects: one file each, in the order in which they are tried and listed.

mod frequency_scaled_power;
mod second_motor;
mod static_frequency_dependence;
mod stator_resistance;

use super::effect::Effect;

/// Every effect.
const CATALOGUE: &[&dyn Effect] = &[
    &stator_resistance::StatorResistance,
    &frequency_scaled_power::FrequencyScaledPower,
    &static_frequency_dependence::StaticFrequencyDependence,
    &second_motor::SecondMotor,
];

/// Every effect of the catalogue.
#[must_use]
pub fn catalogue() -> &'static [&'static dyn Effect] {
    CATALOGUE
}

/// The effect of this name.
#[must_use]
pub fn find(name: &str) -> Option<&'static dyn Effect> {
    CATALOGUE
        .iter()
        .copied()
        .find(|e| e.declaration().name == name)
}
