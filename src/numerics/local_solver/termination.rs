//! Why the local solver ended.

/// Why the solver ended, with the two sides of the inequality that caused it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Termination {
    /// The undamped model promises no more: `promised <= tolerance`.
    PromiseSmall {
        /// Decrease the undamped model promises.
        promised: f64,
        /// What was asked for.
        tolerance: f64,
    },
    /// Three steps in a row gained less than the tolerance: `gained <= tolerance`.
    GainSmall {
        /// What the last of them gained.
        gained: f64,
        /// What was asked for.
        tolerance: f64,
    },
    /// No step longer than the tolerance lowers the objective: `step <= tolerance`. The usual end
    /// when the tolerances ask for more than the rounding of the objective allows.
    StepSmall {
        /// Longest component of the step, as a fraction of the box.
        step: f64,
        /// What was asked for.
        tolerance: f64,
    },
    /// The way down leads to where the objective does not exist, and the shortened steps that
    /// are left gain nothing: `gained <= tolerance`. Not a minimum.
    EdgeOfDomain {
        /// What the last of them gained; 0 when none was left.
        gained: f64,
        /// What was asked for.
        tolerance: f64,
    },
    /// `evaluations >= limit`. A usable point, perhaps not a minimum.
    EvaluationsExhausted {
        /// Calls made.
        evaluations: u64,
        /// Calls allowed.
        limit: u64,
    },
    /// The caller asked to stop. A usable point, perhaps not a minimum.
    Cancelled,
    /// What the caller wants is out of reach: `promised` several times is not enough. A usable point, not a minimum.
    OutOfReach {
        /// Decrease the undamped model promises.
        promised: f64,
        /// Objective that was wanted.
        wanted: f64,
    },
    /// The way down leads to a solution that the caller knows already; not followed to its end.
    Recognised,
}

impl Termination {
    /// Whether the point is a minimum as far as the tolerances and the rounding can tell.
    pub fn is_minimum(&self) -> bool {
        matches!(
            self,
            Self::PromiseSmall { .. } | Self::GainSmall { .. } | Self::StepSmall { .. }
        )
    }

    /// Whether the point may be reported at all: every end but the edge of the domain.
    pub fn is_feasible(&self) -> bool {
        !matches!(self, Self::EdgeOfDomain { .. })
    }

    pub(super) fn of_small_gain(shortened: bool, gained: f64, tolerance: f64) -> Self {
        if shortened {
            Self::EdgeOfDomain { gained, tolerance }
        } else {
            Self::GainSmall { gained, tolerance }
        }
    }
}
