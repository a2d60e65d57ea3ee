//! From windows to a proven parameter set: preparation of the measurement, residuals, fit,
//! identifiability, held-out validation, acceptance.

pub mod between_events;
pub mod comparison;
pub mod composed;
mod composed_estimates;
pub mod decision;
mod edge_exchange;
pub mod edge_timing;
mod error;
pub mod errors;
pub mod estimates;
pub mod evaluate;
pub mod fit;
mod gram;
pub mod hold_out;
pub mod identify;
pub mod intake;
pub mod joint_problem;
pub mod judgement;
pub mod measurement_chain;
mod on_windows;
pub mod paper_problem;
pub mod parameter_set;
pub mod phasor_filter;
pub mod plausibility;
pub mod precision;
pub mod profile;
mod quantities;
mod reactive_trend;
mod refit;
pub mod relay_edges;
pub mod robust;
pub mod scan_comparison;
mod search;
mod site_fit;
pub mod solution;
mod turns;
pub mod validate;
mod valley;
pub mod verdict;

pub use comparison::Comparison;
pub use composed_estimates::composed_parameters;
pub use decision::{DecisionOptions, InForce, decide};
pub use error::IdentificationError;
pub use errors::{ErrorSummary, EventErrors};
pub use identify::{
    Identification, IdentificationOptions, Split, conclude, identify, median_operating_point,
    prepare_all,
};
pub use judgement::{Judgement, judge};
pub use measurement_chain::{LateReport, MeasurementChain};
pub use on_windows::{compare, compare_fitted, errors_of_fitted, errors_on};
pub use parameter_set::{Bases, OperatingPoint, ParameterEstimate, ParameterSet};
pub use phasor_filter::{FilterChoice, LongerWindow, PhasorFilter, WindowShape};
pub use profile::{Profile, ProfileOptions, SiteProfile, profile_site};
pub use reactive_trend::ReactiveTrend;
pub use refit::FittedStructure;
pub use robust::RobustLoss;
pub use site_fit::{AlignedFit, COMPANION, FittedSite, fit_aligned};
pub use solution::{Cost, DirectionOutcome, DirectionRecord, Solution};
pub use verdict::{ChannelVerdict, Decision, Verdict, VerdictStatus};
