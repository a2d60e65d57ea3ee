//! The load at its operating point.

use super::{
    Drive, Feeder, MotorDescription, Rest, SimulationError,
    active::{Active, Pass},
    motor::Motor,
};
use crate::load_model::{LinearCoefficients, MotorCoordinates, effect::Place};

/// Places of `d_z` and `d_i` among the linear coefficients.
const REACTIVE: std::ops::Range<usize> = 3..5;

/// The motor's constants with what the effects make of them, at the measured voltage.
pub(super) fn describe<S: Pass>(
    drive: &Drive<'_>,
    motor: MotorCoordinates<S>,
    effects: &[Active<'_, S>],
) -> MotorDescription<S> {
    let mut description = MotorDescription::new(motor, drive.terminal.synchronous_speed_rad_s);
    for e in effects
        .iter()
        .filter(|e| e.declaration.acts_on(Place::Motor))
    {
        e.equations.motor(&e.parameters, &mut description);
    }
    description
}

/// The linear coefficients of the load in this event, with those of its reactive power as they go with what is drawn
/// behind a feeder.
pub(super) fn at_load<S: Pass>(
    drive: &Drive<'_>,
    mut linear: [S; LinearCoefficients::COUNT],
    effects: &[Active<'_, S>],
) -> [S; LinearCoefficients::COUNT] {
    if let (Some(at_load), Some(feeder)) = (drive.at_load, feeder(effects)) {
        let correction = at_load.correction(&feeder, drive.reactive_at_rest);
        for (value, more) in linear[REACTIVE].iter_mut().zip(correction) {
            *value = *value + more;
        }
    }
    linear
}

/// The feeder among the effects.
fn feeder<S: Pass>(effects: &[Active<'_, S>]) -> Option<Feeder<S>> {
    let mut effects = effects.iter();
    let found = effects.find(|e| e.declaration.acts_on(Place::Feeder));
    found.map(|e| e.equations.feeder(&e.parameters))
}

/// The motor with what the effects make of it, and the load at its operating point.
pub(super) fn at_rest<S: Pass>(
    drive: &Drive<'_>,
    motor: MotorCoordinates<S>,
    linear: [S; LinearCoefficients::COUNT],
    effects: &[Active<'_, S>],
) -> Result<Rest<S>, SimulationError> {
    let synchronous_speed_rad_s = drive.terminal.synchronous_speed_rad_s;
    let mut description = describe(drive, motor, effects);
    let feeder = feeder(effects);
    let load_voltage_square = feeder.map_or(S::constant(1.0), |feeder| {
        feeder.load_voltage_square(drive.reactive_at_rest)
    });
    if feeder.is_some() {
        description.refer_to(load_voltage_square);
    }
    let motor = Motor::new(&description)?;
    let [share, c_z, c_i, d_z, d_i] = linear;
    Ok(Rest {
        reactive: drive.reactive_at_rest,
        motor_share: share,
        motor,
        own_motor: None,
        static_constant: [
            -(share + c_z + c_i) + 1.0,
            -(share * motor.rest_power[1] + d_z + d_i) + drive.reactive_at_rest,
        ],
        static_line: [c_i, d_i],
        load_voltage_square,
        synchronous_speed_rad_s,
    })
}
