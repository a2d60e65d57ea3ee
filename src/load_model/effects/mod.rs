//! The catalogue of effects: one file each, in the order in which they are tried and listed.
//!
//! To add one: a file with header, declaration, equations and tests like the others, and a line in each
//! of the three lists below; `composed::contract` then tests it. Effects that a user wrote in a file
//! come behind those of the catalogue, see [`register`].

mod contactor_dropout;
mod discharge_lighting;
mod distributed_generation;
mod double_cage_rotor;
mod electronic_load_dropout;
mod exponential_recovery;
mod feeder_impedance;
mod frequency_scaled_power;
mod frequency_tracking;
mod frequency_trip;
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
mod static_lag;
mod stator_resistance;
mod tap_changer;
mod time_skew;

pub(super) mod lag;
pub(super) mod relay;
mod series;

use std::sync::OnceLock;

use super::{
    effect::{Effect, Parameter},
    general_forms,
    user_effects::EffectFile,
};

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
    &frequency_trip::FrequencyTrip,
    &single_phase_ac_stall::SinglePhaseAcStall,
    &discharge_lighting::DischargeLighting,
    &exponential_recovery::ExponentialRecovery,
    &tap_changer::TapChanger,
    &saturation::Saturation,
    &low_voltage_conversion::LowVoltageConversion,
    &load_ramp::LoadRamp,
];

/// What every composed model has besides ZIP and motor, with its parameter: never listed, never named as missing.
pub(super) const STATIC_LAG: (&dyn Effect, Parameter) =
    (&static_lag::StaticLag, static_lag::STATIC_LAG);

/// All effects there are, once somebody has asked or registered.
static ALL: OnceLock<Vec<&'static dyn Effect>> = OnceLock::new();

/// Most effects from files: each stays in memory until the program ends.
pub const REGISTERED_MAX: usize = 32;

/// Why effects from files are refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RegisterError {
    /// The name is taken.
    #[error("there is an effect or part `{name}` already; choose another name")]
    Known {
        /// The name.
        name: String,
    },
    /// Two files of one name.
    #[error("two effect files have the name `{name}`")]
    Twice {
        /// The name.
        name: String,
    },
    /// A reference to an effect that is not there.
    #[error("`{name}` resembles or excludes `{other}`, which does not exist")]
    UnknownOther {
        /// The name.
        name: String,
        /// The other.
        other: String,
    },
    /// Too many.
    #[error("{count} effect files; at most {REGISTERED_MAX}")]
    TooMany {
        /// How many.
        count: usize,
    },
    /// Effects have been looked up, or registered, before.
    #[error("effect files must be registered once, before the first use of any effect")]
    InUse,
}

/// Adds effects from files, sorted by name behind the catalogue, for the rest of the program. To be
/// called at most once and before anything looks an effect up, so that nobody sees two catalogues.
///
/// # Errors
///
/// [`RegisterError`]; nothing is added then.
pub fn register(mut files: Vec<EffectFile>) -> Result<(), RegisterError> {
    files.sort_by(|x, y| x.name().cmp(y.name()));
    can_be_together(&files)?;
    if ALL.get().is_some() {
        return Err(RegisterError::InUse);
    }
    let added = files.into_iter().map(EffectFile::into_effect);
    let all = CATALOGUE.iter().copied().chain(added).collect();
    ALL.set(all).map_err(|_| RegisterError::InUse)
}

/// Whether effects from files can be registered together; registers nothing.
///
/// # Errors
///
/// [`RegisterError`], all but [`RegisterError::InUse`].
pub fn can_be_together(files: &[EffectFile]) -> Result<(), RegisterError> {
    if files.len() > REGISTERED_MAX {
        return Err(RegisterError::TooMany { count: files.len() });
    }
    for (k, file) in files.iter().enumerate() {
        let name = file.name().to_owned();
        let taken = is_built_in(&name) || general_forms::find(&name).is_some();
        if taken || BASE_PARTS.contains(&name.as_str()) {
            return Err(RegisterError::Known { name });
        }
        if files[..k].iter().any(|f| f.name() == name) {
            return Err(RegisterError::Twice { name });
        }
        let known = |other: &&str| {
            *other != name && (is_built_in(other) || files.iter().any(|f| f.name() == *other))
        };
        if let Some(other) = file.others().find(|other| !known(other)) {
            let other = other.to_owned();
            return Err(RegisterError::UnknownOther { name, other });
        }
    }
    Ok(())
}

macro_rules! files {
    ($($name:ident),* $(,)?) => {
        &[$((stringify!($name), include_str!(concat!(stringify!($name), ".rs")))),*]
    };
}

/// The files of the effects, whose headers describe them.
const FILES: &[(&str, &str)] = files![
    contactor_dropout,
    discharge_lighting,
    distributed_generation,
    double_cage_rotor,
    electronic_load_dropout,
    exponential_recovery,
    feeder_impedance,
    frequency_scaled_power,
    frequency_tracking,
    frequency_trip,
    load_ramp,
    low_voltage_conversion,
    motor_undervoltage_trip,
    phasor_window,
    ratio_phase_error,
    saturation,
    second_motor,
    self_disconnection,
    single_phase_ac_stall,
    speed_dependent_torque,
    static_frequency_dependence,
    stator_resistance,
    tap_changer,
    time_skew,
];

/// What an effect of the catalogue is, its equations and what it leaves when it is missing, as Markdown: the header of its
/// file. `None` for other effects.
#[must_use]
pub fn description(name: &str) -> Option<String> {
    let (_, file) = FILES.iter().find(|(file, _)| *file == name)?;
    let header = file.lines().map_while(|line| line.strip_prefix("//!"));
    let lines: Vec<&str> = header
        .map(|line| line.strip_prefix(' ').unwrap_or(line))
        .collect();
    Some(lines.join("\n").trim().to_owned())
}

/// Parts of every structure, whose names no effect may take.
const BASE_PARTS: [&str; 2] = ["zip", "induction_motor"];

fn is_built_in(name: &str) -> bool {
    CATALOGUE.iter().any(|e| e.declaration().name == name)
}

/// Every effect: those of the catalogue, then those registered.
#[must_use]
pub fn catalogue() -> &'static [&'static dyn Effect] {
    ALL.get_or_init(|| CATALOGUE.to_vec())
}

/// The effect of this name, or the general form.
#[must_use]
pub fn find(name: &str) -> Option<&'static dyn Effect> {
    let listed = catalogue().iter().copied();
    let mut named = listed.filter(|e| e.declaration().name == name);
    named.next().or_else(|| general_forms::find(name))
}

/// Whether the effect was registered from a file.
#[must_use]
pub fn is_registered(name: &str) -> bool {
    let form = general_forms::find(name).is_some();
    !is_built_in(name) && !form && find(name).is_some()
}
