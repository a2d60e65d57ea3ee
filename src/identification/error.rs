//! Why no set could be identified.

use crate::load_model::structure::StructureError;

/// Why no set could be identified.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum IdentificationError {
    /// No event can be fitted; each with its reason.
    #[error("no event can be fitted: {}", list(.refused))]
    NoUsableEvent {
        /// Event and why it cannot be fitted.
        refused: Vec<(String, String)>,
    },
    /// A structure that cannot be composed.
    #[error("{0}")]
    Structure(#[from] StructureError),
    /// A named event does not exist or cannot be used.
    #[error("event `{event}` asked for is not among the usable events: {usable}")]
    UnknownEvent {
        /// The name.
        event: String,
        /// What can be used.
        usable: String,
    },
    /// A stored set lacks a coordinate and cannot be simulated.
    #[error("parameter set holds no `{name}`: it cannot be simulated; fit the site again")]
    IncompleteSet {
        /// The coordinate.
        name: String,
    },
    /// A fitted model has no response in an event.
    #[error("the fitted model cannot be simulated: {reason}")]
    NotSimulated {
        /// Which structure, and why.
        reason: String,
    },
    /// An effect has no finite value in an event.
    #[error(
        "effect `{effect}` has no finite value in {event} at {voltage:.3} of V0, {time_s:.3} s after its first sample: {what}; guard roots, logarithms and divisions where the voltage is low, as in `sqrt(max(v - 0.44, 0))`"
    )]
    NoValue {
        /// The effect.
        effect: String,
        /// The event.
        event: String,
        /// The expression.
        what: String,
        /// Voltage over V0.
        voltage: f64,
        /// Time since the first sample, s.
        time_s: f64,
    },
    /// The search found no feasible point.
    #[error("no feasible parameters were found from any start")]
    NoSolution,
    /// The caller asked to stop.
    #[error("cancelled")]
    Cancelled,
}

impl IdentificationError {
    /// Whether it is the model that could not be fitted or simulated: another one may be.
    #[must_use]
    pub const fn is_of_the_model(&self) -> bool {
        matches!(
            self,
            Self::NoSolution | Self::NotSimulated { .. } | Self::NoValue { .. }
        )
    }
}

fn list(refused: &[(String, String)]) -> String {
    let lines: Vec<String> = refused
        .iter()
        .map(|(event, reason)| format!("{event}: {reason}"))
        .collect();
    lines.join("; ")
}
