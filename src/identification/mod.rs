//! From windows to a proven parameter set: preparation of the measurement, residuals, fit,
//! identifiability, held-out validation, acceptance.

pub mod errors;
pub mod parameter_set;
pub mod solution;
pub mod verdict;

pub use errors::{ErrorSummary, EventErrors};
pub use parameter_set::{Bases, OperatingPoint, ParameterEstimate, ParameterSet};
pub use solution::{Cost, DirectionOutcome, DirectionRecord, Solution};
pub use verdict::{ChannelVerdict, Decision, Verdict, VerdictStatus};
