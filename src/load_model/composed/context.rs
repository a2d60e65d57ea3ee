//! What the equations of an effect get to see.

use super::motor::Motor;

/// What does not change during a simulation.
#[derive(Clone, Copy, Debug)]
pub struct Rest<S> {
    /// `Q0/P0`.
    pub reactive: f64,
    /// Motor share of P0.
    pub motor_share: S,
    /// The motor.
    pub motor: Motor<S>,
    /// The effect's own motor, see [`Equations::own_motor`](crate::load_model::effect::Equations::own_motor).
    pub own_motor: Option<Motor<S>>,
    /// Constant-power part of the static load over P0, active and reactive.
    pub static_constant: [S; 2],
    /// Constant-current part of the static load over P0, active and reactive.
    pub static_line: [S; 2],
    /// Square of the voltage at the load over that at the measured bus, 1 without a feeder: bases of
    /// motors refer to the voltage at the load.
    pub load_voltage_square: S,
    /// Synchronous angular speed before the event, rad/s.
    pub synchronous_speed_rad_s: f64,
}

/// The course of the frequency, for [`Equations::motor_frequency`](crate::load_model::effect::Equations).
#[derive(Clone, Copy, Debug)]
pub struct FrequencyCourse<'a, S> {
    /// Output instants, s.
    pub time_s: &'a [f64],
    /// Frequency deviation there, pu.
    pub deviation: &'a [S],
    /// When the phasor jumps, s.
    pub jumps_s: &'a [f64],
    /// Synchronous angular speed before the event, rad/s.
    pub synchronous_speed_rad_s: f64,
}

/// What motors see of the frequency at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen<S> {
    /// Frequency over that at rest, 1 at rest.
    pub frequency: S,
    /// Angle by which the phasor is further on than measured, rad, 0 at rest.
    pub turn_rad: S,
}

/// One step of the states. Phasors and voltages are those at the load, 1 at rest.
#[derive(Clone, Copy, Debug)]
pub struct Step<S> {
    /// Length, s.
    pub duration_s: f64,
    /// Phasor at the start, in the middle and at the end.
    pub phasor: [[S; 2]; 3],
    /// The same as motors see it.
    pub motor_phasor: [[S; 2]; 3],
    /// Modulus of the phasor there.
    pub voltage: [S; 3],
    /// Frequency deviation, pu, at the last output instant.
    pub frequency_deviation: S,
}

/// One instant at which power is wanted.
#[derive(Clone, Copy, Debug)]
pub struct Instant<S> {
    /// Time since the first sample, s.
    pub time_s: f64,
    /// Phasor at the load, 1 at rest.
    pub phasor: [S; 2],
    /// The same as motors see it.
    pub motor_phasor: [S; 2],
    /// Modulus of the phasor.
    pub voltage: S,
    /// Frequency deviation, pu.
    pub frequency_deviation: S,
    /// Active and reactive power of the motor on its own initial power, magnetisation included.
    pub motor: [S; 2],
    /// Factor on the power of every motor.
    pub motor_factor: S,
    /// Active power of the static part over P0.
    pub static_active: S,
}

/// The measured series, on their way through an instrument.
#[derive(Debug)]
pub struct Series<'a, S> {
    /// Output instants, s.
    pub time_s: &'a [f64],
    /// Whether the phasor jumps between an instant and the next.
    pub jump: &'a [bool],
    /// Measured phasor.
    pub phasor: &'a [[f64; 2]],
    /// `Q0/P0`.
    pub reactive_at_rest: f64,
    /// Active power over P0.
    pub active: &'a mut Vec<S>,
    /// Reactive power over P0.
    pub reactive: &'a mut Vec<S>,
}
