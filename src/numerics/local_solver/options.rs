//! Settings of the local solver.

use crate::numerics::OutOfRange;

/// Settings of the local solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Largest number of calls of the objective. Default 500; at least 1.
    pub evaluations_max: u64,
    /// The solver ends when the decrease still promised is below this fraction of the objective.
    /// Default 1e-12; positive.
    pub decrease_relative: f64,
    /// The same in units of the objective, for objectives whose minimum is 0. Default 1e-30;
    /// not negative.
    pub decrease_absolute: f64,
    /// The solver ends when a step is shorter than this fraction of the box along every coordinate
    /// (of 1 where the box is unbounded). Default 1e-14; positive.
    pub step_relative: f64,
    /// First damping, relative to the curvature. Default 1e-3; positive. Smaller trusts a good
    /// start, larger creeps away from a bad one; insensitive between 1e-4 and 1e-1.
    pub damping_initial: f64,
    /// How often a step out of the objective's domain is halved before the solver gives up; the
    /// next step begins with twice what was left. Default 45: to a step of 3e-14.
    pub halvings_max: u32,
    /// The solver gives up where even four times what the undamped model promises does not lead down to
    /// this objective. Default infinite: it never does.
    pub wanted: f64,
}

/// Multiple of what the undamped model promises that a descent may still gain: models of curved valleys promise too
/// little as often as too much.
pub(super) const REACH: f64 = 4.0;

impl Default for Options {
    fn default() -> Self {
        Self {
            evaluations_max: 500,
            decrease_relative: 1e-12,
            decrease_absolute: 1e-30,
            step_relative: 1e-14,
            damping_initial: 1e-3,
            halvings_max: 45,
            wanted: f64::INFINITY,
        }
    }
}

impl Options {
    /// The settings themselves, when every one is within its range.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] names the first that is not.
    pub fn checked(self) -> Result<Self, OutOfRange> {
        let calls = self.evaluations_max;
        OutOfRange::check("evaluations_max", calls as f64, calls > 0, "at least 1")?;
        for (field, value) in [
            ("decrease_relative", self.decrease_relative),
            ("step_relative", self.step_relative),
            ("damping_initial", self.damping_initial),
        ] {
            OutOfRange::check(field, value, value.is_finite() && value > 0.0, "positive")?;
        }
        let absolute = self.decrease_absolute;
        OutOfRange::check(
            "decrease_absolute",
            absolute,
            absolute >= 0.0,
            "not negative",
        )?;
        Ok(self)
    }
}
