//! From windows to a parameter set: prepare, split, fit jointly, validate on what was held out.

use super::{Comparison, Cost, DirectionRecord, ParameterSet, Solution};
use crate::{disturbance::Window, measurement::Site};

/// Settings of an identification; each group belongs to one step of the path.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IdentificationOptions {}

/// What an identification produced.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// The parameter set, validated, with version 0.
    pub set: ParameterSet,
    /// Every local solution found, best first.
    pub solutions: Vec<Solution>,
    /// Every search direction and its outcome.
    pub directions: Vec<DirectionRecord>,
    /// What it cost; `seconds` is left at 0, time is not known here.
    pub cost: Cost,
}

/// Why no set could be identified.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentificationError {
    /// No event can be fitted; each with its reason.
    #[error("no event can be fitted: {}", .refused.iter().map(|(event, reason)| format!("{event}: {reason}")).collect::<Vec<_>>().join("; "))]
    NoUsableEvent {
        /// Event and why it cannot be fitted.
        refused: Vec<(String, String)>,
    },
    /// The structure names something that does not exist.
    #[error("unknown model part `{part}`; known: {known}")]
    UnknownStructure {
        /// The name.
        part: String,
        /// What exists.
        known: String,
    },
    /// The search found no feasible point.
    #[error("no feasible parameters were found from any start")]
    NoSolution,
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
}

/// Fits `structure` to the windows jointly, holds some of them out, validates on those.
///
/// Deterministic: the same windows and options give the same bytes, whatever the number of threads.
/// `cancel` is asked between simulations.
///
/// # Errors
///
/// See [`IdentificationError`].
pub fn identify(
    _site: &Site,
    _windows: &[Window],
    _structure: &[String],
    _options: &IdentificationOptions,
    _cancel: &(dyn Fn() -> bool + Sync),
) -> Result<Identification, IdentificationError> {
    Err(IdentificationError::NoSolution)
}

/// Simulates a parameter set on each window.
///
/// # Errors
///
/// [`IdentificationError::NoUsableEvent`] when no window can be simulated.
pub fn compare(
    _set: &ParameterSet,
    _windows: &[Window],
    _options: &IdentificationOptions,
) -> Result<Vec<Comparison>, IdentificationError> {
    Err(IdentificationError::NoSolution)
}
