//! The load as equations: what is at its terminal, what its parts draw, and how the parts are
//! composed. Where a voltage comes from is not known here.
//!
//! Conventions: per unit; consumption positive. Inside this module everything is normalised by the
//! event's own pre-disturbance operating point: voltage by V0, power by P0, and the motor's
//! quantities by the motor's own initial power Kpm P0. In that base the motor's dynamics and its
//! feasibility do not depend on how much load is connected, and several events of one site share
//! one set of parameters.

pub mod composed;
pub mod effect;
pub mod effects;
pub mod general_forms;
pub mod induction_motor;
pub mod ranges;
pub mod structure;
pub mod terminal;
pub mod user_effects;
pub mod zip_im;

pub use composed::{ComposedModel, Drive, Response, SimulationError};
pub use induction_motor::{Infeasible, MotorCoordinates, MotorOutput};
pub use ranges::{ParameterRange, RangeError, Ranges};
pub use structure::Structure;
pub use terminal::TerminalInput;
pub use zip_im::{LinearCoefficients, LoadBase, ZipImParameters};
