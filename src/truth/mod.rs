//! Synthetic sites whose truth is known: a small closed-loop network, a composite load, switchings,
//! a PMU and its noise.
//!
//! The simulator shares no code with the estimator, so that an error in one cannot hide in the
//! other: motors are circuits with rotor flux linkages in polar form (the estimator: transient
//! voltage in Cartesian form), integrated by Dormand and Prince's adaptive method (the estimator:
//! fixed-step Runge-Kutta), with a voltage that the load itself pulls down (the estimator: measured
//! voltage). Relays scan the terminal voltage on a fixed raster, as digital relays do.
//!
//! Frame: every phasor turns with nominal frequency; per unit on the site's load base; consumption
//! positive.

mod bad_samples;
mod integrator;
mod load;
mod motor;
mod network;
mod plan;
mod pmu;
mod prescribed_voltage;
mod random;
mod simulation;
mod site;
mod static_load;

pub use bad_samples::{BadSamples, Defect};
pub use integrator::IntegratorOptions;
pub use motor::{LoadBaseParameters, MotorCircuit};
pub use network::Network;
pub use plan::{EventKind, EventPlan};
pub use prescribed_voltage::{CompositeLoad, LoadResponse, MotorGroup, PrescribedVoltage, respond};
pub use random::Random;
pub use site::{EventTruth, SiteOptions, SyntheticSite, generate};
pub use static_load::Zip;

/// A phasor, or a power, per unit.
pub type Phasor = nalgebra::Complex<f64>;

/// Why no synthetic site could be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TruthError {
    /// An option lies outside its range.
    #[error("{option} must be {required}, got {given}")]
    OptionOutOfRange {
        /// Name of the option.
        option: &'static str,
        /// What was given.
        given: f64,
        /// What is required.
        required: &'static str,
    },
    /// A motor cannot carry its load at the voltage before the event.
    #[error(
        "no equilibrium: a motor is asked for {demand_pu} pu and can give {largest_pu} pu at {voltage_pu} pu voltage"
    )]
    NoEquilibrium {
        /// Electrical power asked for, pu of the motor's base.
        demand_pu: f64,
        /// Largest power the circuit can take, pu of the motor's base.
        largest_pu: f64,
        /// Terminal voltage, pu.
        voltage_pu: f64,
    },
    /// The network and the load have no common voltage: the load is too large for the grid left.
    #[error("no network solution at {time_s} s: mismatch {mismatch_pu} pu")]
    NoNetworkSolution {
        /// When, seconds from the start of the window.
        time_s: f64,
        /// Voltage mismatch left, pu.
        mismatch_pu: f64,
    },
    /// The integrator could not keep its tolerance.
    #[error("integration stopped at {time_s} s: step size fell below {step_s} s")]
    StepTooSmall {
        /// When, seconds from the start of the window.
        time_s: f64,
        /// Least step, seconds.
        step_s: f64,
    },
}
