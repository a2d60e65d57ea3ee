//! Synthetic sites whose truth is known: a small closed-loop network, a composite load, switchings,
//! a PMU and its noise.
//!
//! The simulator shares no code with the estimator, so that an error in one cannot hide in the
//! other: motors are circuits with rotor flux linkages in polar form (the estimator: transient
//! voltage in Cartesian form), integrated by Dormand and Prince's adaptive method (the estimator:
//! fixed-step Runge-Kutta), with a voltage that the load itself pulls down (the estimator: measured
//! voltage). Relays are discrete, with definite times; their instants are found inside the
//! integrator's steps (the estimator: smooth timers).
//!
//! Frame: every phasor turns with nominal frequency; per unit on the site's load base; consumption
//! positive.

mod bad_samples;
mod compose;
mod effect;
mod effect_parameters;
mod excitation;
mod integrator;
mod load;
mod network;
mod options;
mod parts;
mod plan;
mod pmu;
mod prescribed_voltage;
mod random;
mod relay;
mod simulation;
mod site;
mod solution;
mod study;
mod tap_changer;
mod terms;

pub use bad_samples::{BadSamples, Defect};
pub use compose::PartPower;
pub use effect::{Effect, EffectParameter, HiddenEffect};
pub use integrator::IntegratorOptions;
pub use load::Operation;
pub use network::Network;
pub use options::SiteOptions;
pub use parts::{LoadBaseParameters, MotorCircuit, Zip};
pub use plan::{EventKind, EventPlan};
pub use prescribed_voltage::{CompositeLoad, LoadResponse, MotorGroup, PrescribedVoltage, respond};
pub use random::Random;
pub use site::{EventTruth, SyntheticSite, generate};
pub use study::{StudyShape, study_site, study_sites};
pub use terms::{EffectTerms, estimator_terms};

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
    /// No effect of that name.
    #[error("no effect is called `{name}`; see `loadmodeld generate --list-effects`")]
    UnknownEffect {
        /// The name.
        name: String,
    },
    /// An effect has no such parameter.
    #[error("{effect} has no parameter `{parameter}`; it has {known}")]
    UnknownParameter {
        /// The effect.
        effect: &'static str,
        /// The parameter.
        parameter: String,
        /// Those that it has.
        known: String,
    },
    /// A parameter of an effect lies outside its range.
    #[error("{effect}.{parameter} must be {required}, got {given}")]
    ParameterOutOfRange {
        /// The effect.
        effect: &'static str,
        /// The parameter.
        parameter: &'static str,
        /// What was given.
        given: String,
        /// What is required.
        required: String,
    },
    /// An effect is asked for twice.
    #[error("{effect} is asked for twice")]
    EffectTwice {
        /// The effect.
        effect: &'static str,
    },
    /// An effect of motors where there are none.
    #[error(
        "{effect} is an effect of motors, and the motor share is {motor_share}: without motors nothing of it is seen; give motors a share above 0 or leave {effect} out"
    )]
    NoMotors {
        /// The effect.
        effect: &'static str,
        /// Share of the active power that motors draw.
        motor_share: f64,
    },
    /// Effects and motors take more than there is.
    #[error("nothing is left for {of}: the others take all but {left} of it")]
    NothingLeft {
        /// What gets nothing.
        of: &'static str,
        /// Share that is left.
        left: f64,
    },
    /// Relays set each other off without end.
    #[error("relays set each other off without end at {time_s} s")]
    EndlessCascade {
        /// When, seconds from the start of the window.
        time_s: f64,
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
