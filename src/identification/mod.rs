//! From windows to a proven parameter set: preparation of the measurement, residuals, fit,
//! identifiability, held-out validation, acceptance.

pub mod comparison;
pub mod decision;
pub mod errors;
pub mod identify;
pub mod parameter_set;
pub mod solution;
pub mod verdict;

pub use comparison::{Comparison, summarise};
pub use decision::{DecisionOptions, InForce, decide};
pub use errors::{ErrorSummary, EventErrors};
pub use identify::{Identification, IdentificationError, IdentificationOptions, compare, identify};
pub use parameter_set::{Bases, OperatingPoint, ParameterEstimate, ParameterSet};
pub use solution::{Cost, DirectionOutcome, DirectionRecord, Solution};
pub use verdict::{ChannelVerdict, Decision, Verdict, VerdictStatus};
