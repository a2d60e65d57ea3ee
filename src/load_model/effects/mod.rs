//! The catalogue of effects: one file each, in the order in which they are tried and listed.
//!
//! To add one: a file with header, declaration, equations and tests like the others, and a line in each
//! of the two lists below; `composed::contract` then tests it.

mod contactor_dropout;
mod discharge_lighting;
mod distributed_generation;
mod double_cage_rotor;
mod electronic_load_dropout;
mod exponential_recovery;
mod feeder_impedance;
mod frequency_scaled_power;
mod frequency_tracking;
mod load_ramp;
mod low_voltage_conversion;
mod motor_undervoltage_trip;
mod phasor_window;
mod ratio_phase_error;
mod saturation;
mod second_motor;
mod self_disconnection;
mod single_phase_ac_stall;
mod speed_dependent_torque;
mod static_frequency_dependence;
mod stator_resistance;
mod tap_changer;
mod time_skew;

mod lag;
mod relay;
mod series;

use super::effect::Effect;

/// Every effect: the instruments first, then the physics.
const CATALOGUE: &[&dyn Effect] = &[
    &time_skew::TimeSkew,
    &phasor_window::PhasorWindow,
    &ratio_phase_error::RatioPhaseError,
    &frequency_tracking::FrequencyTracking,
    &stator_resistance::StatorResistance,
    &frequency_scaled_power::FrequencyScaledPower,
    &static_frequency_dependence::StaticFrequencyDependence,
    &speed_dependent_torque::SpeedDependentTorque,
    &second_motor::SecondMotor,
    &double_cage_rotor::DoubleCageRotor,
    &feeder_impedance::FeederImpedance,
    &motor_undervoltage_trip::MotorUndervoltageTrip,
    &contactor_dropout::ContactorDropout,
    &electronic_load_dropout::ElectronicLoadDropout,
    &self_disconnection::SelfDisconnection,
    &distributed_generation::DistributedGeneration,
    &single_phase_ac_stall::SinglePhaseAcStall,
    &discharge_lighting::DischargeLighting,
    &exponential_recovery::ExponentialRecovery,
    &tap_changer::TapChanger,
    &saturation::Saturation,
    &low_voltage_conversion::LowVoltageConversion,
    &load_ramp::LoadRamp,
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
