//! A bounded Levenberg-Marquardt method in normal-equation form.
//!
//! Each step minimises the model `g's + s'(H + lambda D)s / 2` over the box, where `g` is the
//! gradient, `H` the curvature, `D` the diagonal of `H` (Marquardt 1963; it may grow at once but
//! only halve per step) and `lambda` the damping, driven by the ratio of actual to predicted
//! decrease (Nielsen 1999, IMM-REP-1999-05). Coordinates
//! that rest on a bound and want to leave the box are held (projected gradient, Bertsekas 1982);
//! those that a step would carry out of it are put on the bound and the rest is solved again. A
//! step to a point where the objective does not exist is halved until it does.
//!
//! Scaling by `D` makes the method indifferent to the units of `x`, and the measure of convergence
//! (what the undamped model still promises, in units of the objective) is too: in a nearly flat
//! valley the gradient is small everywhere, but the promise is not.
//!
//! Cost per step: one [`Objective::expansion`] and a few Cholesky factorisations of size n.

use nalgebra::{DMatrix, DVector};

use super::{
    Bounds, Cost, Objective,
    objective::{Counted, Expansion, OutOfRange},
};

mod model;

use model::{Model, free_coordinates, scale};

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
}

impl Default for Options {
    fn default() -> Self {
        Self {
            evaluations_max: 500,
            decrease_relative: 1e-12,
            decrease_absolute: 1e-30,
            step_relative: 1e-14,
            damping_initial: 1e-3,
            halvings_max: 45,
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

    fn of_small_gain(shortened: bool, gained: f64, tolerance: f64) -> Self {
        if shortened {
            Self::EdgeOfDomain { gained, tolerance }
        } else {
            Self::GainSmall { gained, tolerance }
        }
    }
}

/// Where the solver ended.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalSolution {
    /// The point, within the bounds.
    pub x: DVector<f64>,
    /// Objective there.
    pub value: f64,
    /// Gradient there; components on a bound may point out of the box.
    pub gradient: DVector<f64>,
    /// Curvature there, as the objective gave it.
    pub curvature: DMatrix<f64>,
    /// Why the solver ended.
    pub termination: Termination,
    /// What it cost.
    pub cost: Cost,
}

/// The objective does not exist at the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UndefinedStart {
    /// What it cost to find out.
    pub cost: Cost,
}

/// Minimises `objective` over the box `bounds`, from `start` moved into the box.
///
/// `cancel` is asked before every call of the objective but the first; after a cancellation the
/// best point so far is returned. Where the objective supplies its true Hessian, saddle points are
/// left along a direction of negative curvature.
///
/// # Errors
///
/// [`UndefinedStart`] when the objective does not exist at the start.
pub fn minimise(
    objective: &dyn Objective,
    bounds: &Bounds,
    start: &DVector<f64>,
    options: &Options,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<LocalSolution, UndefinedStart> {
    let mut solver = Solver {
        counted: Counted::new(objective),
        bounds,
        spans: bounds.spans(),
        options,
        cancel,
        damping: options.damping_initial,
        damping_growth: 2.0,
        scale: DVector::zeros(start.len()),
        fraction: 1.0,
        leap_pause: 0,
        leap_patience: 1,
        last_was_rejected: false,
    };
    let x = bounds.clamped(start);
    let Some(expansion) = solver.counted.expansion(&x) else {
        return Err(UndefinedStart {
            cost: solver.counted.cost,
        });
    };
    let (at, termination) = solver.descend(Iterate { x, expansion });
    Ok(LocalSolution {
        x: at.x,
        value: at.expansion.value,
        gradient: at.expansion.gradient,
        curvature: at.expansion.curvature,
        termination,
        cost: solver.counted.cost,
    })
}

/// Steps that gain next to nothing before the solver gives up; one alone may be bad luck.
const SMALL_GAINS_MAX: u32 = 3;
/// Damping beyond which a step is too short to matter: 1e-20 of a gradient step.
const DAMPING_MAX: f64 = 1e20;
/// Damping below which it is lost in the rounding of the curvature.
const DAMPING_MIN: f64 = 1e-15;

/// A step creeps when it gains less than this part of what the undamped model promised.
const CREEPING_PART: f64 = 0.3;
/// Steps in a row that creep before a leap is tried.
const CREEPING_STEPS: u32 = 3;
/// Damping of a leap relative to that of the creep: a valley's length to its width, squared.
/// Measured on Rosenbrock's valley, where 1e-3 and 1e-2 gain less; on the NIST problems leaps cost
/// or save a tenth.
const LEAP_DAMPING: f64 = 1e-5;
const LEAP_PAUSE_MAX: u32 = 32;

struct Iterate {
    x: DVector<f64>,
    expansion: Expansion,
}

/// What became of an attempt to leave an iterate.
enum Move {
    To { next: Iterate, shortened: bool },
    End(Termination),
}

/// What became of one trial step.
enum Trial {
    Lower {
        next: Iterate,
        /// Actual decrease over predicted decrease.
        ratio: f64,
        shortened: bool,
    },
    NotLower,
    OutsideDomain,
}

struct Solver<'a> {
    counted: Counted<'a>,
    bounds: &'a Bounds,
    spans: DVector<f64>,
    options: &'a Options,
    cancel: &'a (dyn Fn() -> bool + Sync),
    damping: f64,
    damping_growth: f64,
    /// `D` of the last model.
    scale: DVector<f64>,
    /// Part of a step that is tried first; below 1 near the edge of the objective's domain.
    fraction: f64,
    /// Steps until the next leap may be tried, and how many it will be after a failure.
    leap_pause: u32,
    leap_patience: u32,
    last_was_rejected: bool,
}

impl Solver<'_> {
    fn descend(&mut self, mut at: Iterate) -> (Iterate, Termination) {
        let (mut small_gains, mut creeping) = (0, 0);
        loop {
            let model = self.model(&at);
            let tolerance = self.tolerance(at.expansion.value);
            let promise = model.promise();
            if let Some(promised) = promise.filter(|promised| *promised <= tolerance) {
                return (
                    at,
                    Termination::PromiseSmall {
                        promised,
                        tolerance,
                    },
                );
            }
            let moved = if promise.is_none() && model.gradient_promise() <= tolerance {
                self.leave_saddle(&at, &model)
            } else if creeping >= CREEPING_STEPS {
                self.leap(&at, &model)
                    .unwrap_or_else(|| self.step(&at, &model))
            } else {
                self.step(&at, &model)
            };
            let (next, shortened) = match moved {
                Move::End(termination) => return (at, termination),
                Move::To { next, shortened } => (next, shortened),
            };
            let gained = at.expansion.value - next.expansion.value;
            at = next;
            small_gains = if gained <= tolerance {
                small_gains + 1
            } else {
                0
            };
            if small_gains >= SMALL_GAINS_MAX {
                return (at, Termination::of_small_gain(shortened, gained, tolerance));
            }
            let creeps = promise.is_some_and(|promised| gained < CREEPING_PART * promised);
            creeping = if creeps && !shortened {
                creeping + 1
            } else {
                0
            };
        }
    }

    /// Out of a creep along a curved valley, where every step that must not rise is short: a step
    /// with far less damping, which may rise if the one after it lands below where the first began
    /// (the watchdog technique of Chamberlain and others, 1982). After a failure twice as many
    /// steps pass before the next attempt. On Rosenbrock's valley with steepness 1e4 this takes 17
    /// evaluations instead of 1000.
    fn leap(&mut self, at: &Iterate, model: &Model<'_>) -> Option<Move> {
        if self.leap_pause > 0 {
            self.leap_pause -= 1;
            return None;
        }
        let damping = (self.damping * LEAP_DAMPING).max(DAMPING_MIN);
        let mut far = self.lightly_damped_move(&at.x, model, damping);
        if let Some(above) = far.take_if(|far| far.expansion.value >= at.expansion.value) {
            let model = self.model_without_memory(&above);
            far = self
                .lightly_damped_move(&above.x, &model, damping)
                .filter(|far| far.expansion.value < at.expansion.value);
        }
        if let Some(next) = far {
            self.counted.cost.steps_accepted += 1;
            self.damping = damping;
            self.leap_patience = 1;
            return Some(Move::To {
                next,
                shortened: false,
            });
        }
        self.counted.cost.steps_rejected += 1;
        self.leap_pause = self.leap_patience;
        self.leap_patience = (2 * self.leap_patience).min(LEAP_PAUSE_MAX);
        None
    }

    /// Where a step with this damping leads, whether down or up.
    fn lightly_damped_move(
        &mut self,
        x: &DVector<f64>,
        model: &Model<'_>,
        damping: f64,
    ) -> Option<Iterate> {
        if self.interruption().is_some() {
            return None;
        }
        let x = self.bounds.snapped(&(x + model.damped_step(damping)?));
        let expansion = self.counted.expansion(&x)?;
        Some(Iterate { x, expansion })
    }

    /// The quadratic model at an iterate. A scale that has just been large is not forgotten at
    /// once: measured on NIST's MGH09, that saves a third of the evaluations (131 to 87).
    fn model<'i>(&mut self, at: &'i Iterate) -> Model<'i>
    where
        Self: 'i,
    {
        let mut model = self.model_without_memory(at);
        model.scale = model.scale.sup(&(&self.scale * 0.5));
        self.scale.copy_from(&model.scale);
        model
    }

    fn model_without_memory<'i>(&self, at: &'i Iterate) -> Model<'i>
    where
        Self: 'i,
    {
        Model {
            at: &at.expansion,
            x: &at.x,
            bounds: self.bounds,
            free: free_coordinates(&at.x, &at.expansion.gradient, self.bounds),
            scale: scale(&at.expansion.curvature, &self.spans),
        }
    }

    /// Decrease that is not worth a step.
    fn tolerance(&self, value: f64) -> f64 {
        self.options.decrease_relative * value.abs() + self.options.decrease_absolute
    }

    /// Raises the damping until a step lowers the objective.
    fn step(&mut self, at: &Iterate, model: &Model<'_>) -> Move {
        loop {
            if let Some(termination) = self.interruption() {
                return Move::End(termination);
            }
            let tolerance = self.options.step_relative;
            if self.damping > DAMPING_MAX {
                let step = 0.0;
                return Move::End(Termination::StepSmall { step, tolerance });
            }
            // Without a step the damped curvature is not positive definite: damp more.
            let Some(step) = model.damped_step(self.damping) else {
                self.raise_damping();
                continue;
            };
            let length = self.length(&step);
            if length <= tolerance {
                return Move::End(Termination::StepSmall {
                    step: length,
                    tolerance,
                });
            }
            match self.shortened_until_defined(at, model, step) {
                Trial::Lower {
                    next,
                    ratio,
                    shortened,
                } => {
                    self.counted.cost.steps_accepted += 1;
                    self.last_was_rejected = false;
                    self.adapt_damping(ratio);
                    return Move::To { next, shortened };
                }
                Trial::OutsideDomain => {
                    let tolerance = self.tolerance(at.expansion.value);
                    let edge = Termination::EdgeOfDomain {
                        gained: 0.0,
                        tolerance,
                    };
                    return Move::End(self.interruption().unwrap_or(edge));
                }
                Trial::NotLower => {
                    self.counted.cost.steps_rejected += 1;
                    self.last_was_rejected = true;
                    self.raise_damping();
                }
            }
        }
    }

    /// Tries `step`, halving it while it leads to where the objective does not exist. An edge that
    /// has been met is expected again: the first trial is twice the part that was left last time.
    fn shortened_until_defined(
        &mut self,
        at: &Iterate,
        model: &Model<'_>,
        mut step: DVector<f64>,
    ) -> Trial {
        step *= self.fraction;
        for _ in 0..=self.options.halvings_max {
            let trial = self.try_step(at, model, &step);
            if !matches!(trial, Trial::OutsideDomain) {
                self.fraction = (2.0 * self.fraction).min(1.0);
                return trial;
            }
            self.counted.cost.steps_rejected += 1;
            if self.interruption().is_some() {
                break;
            }
            step *= 0.5;
            self.fraction *= 0.5;
        }
        Trial::OutsideDomain
    }

    fn try_step(&mut self, at: &Iterate, model: &Model<'_>, step: &DVector<f64>) -> Trial {
        let predicted = model.decrease(step);
        if predicted <= 0.0 {
            return Trial::NotLower;
        }
        let x = self.bounds.snapped(&(&at.x + step));
        // Most steps succeed, and an expansion costs less than a value and an expansion; after a
        // rejection another one is likely, and the cheaper value is asked first.
        if self.last_was_rejected || self.fraction < 1.0 {
            match self.counted.value(&x) {
                None => return Trial::OutsideDomain,
                Some(value) if value >= at.expansion.value => return Trial::NotLower,
                Some(_) => {}
            }
        }
        match self.counted.expansion(&x) {
            None => Trial::OutsideDomain,
            Some(expansion) if expansion.value >= at.expansion.value => Trial::NotLower,
            Some(expansion) => {
                let ratio = (at.expansion.value - expansion.value) / predicted;
                let next = Iterate { x, expansion };
                let shortened = self.fraction < 1.0;
                Trial::Lower {
                    next,
                    ratio,
                    shortened,
                }
            }
        }
    }

    /// At a stationary point whose curvature is indefinite, looks for a lower point on both sides
    /// along the most negative curvature; a point without one is kept.
    fn leave_saddle(&mut self, at: &Iterate, model: &Model<'_>) -> Move {
        let (promised, tolerance) = (model.gradient_promise(), self.tolerance(at.expansion.value));
        let Some(direction) = model.most_negative_curvature() else {
            return Move::End(Termination::PromiseSmall {
                promised,
                tolerance,
            });
        };
        // A tenth of the box downwards to a millionth: below that, curvature is not visible.
        for exponent in 1..=6 {
            for sign in [1.0, -1.0] {
                if let Some(termination) = self.interruption() {
                    return Move::End(termination);
                }
                let reach = sign * 0.1_f64.powi(exponent) / self.length(&direction);
                let x = self.bounds.clamped(&(&at.x + &direction * reach));
                let lower = self
                    .counted
                    .expansion(&x)
                    .filter(|expansion| expansion.value < at.expansion.value - tolerance);
                if let Some(expansion) = lower {
                    self.counted.cost.steps_accepted += 1;
                    let next = Iterate { x, expansion };
                    return Move::To {
                        next,
                        shortened: false,
                    };
                }
                self.counted.cost.steps_rejected += 1;
            }
        }
        Move::End(Termination::PromiseSmall {
            promised,
            tolerance,
        })
    }

    fn interruption(&self) -> Option<Termination> {
        let (evaluations, limit) = (
            self.counted.cost.evaluations(),
            self.options.evaluations_max,
        );
        if evaluations >= limit {
            Some(Termination::EvaluationsExhausted { evaluations, limit })
        } else {
            (self.cancel)().then_some(Termination::Cancelled)
        }
    }

    /// Longest component of a step as a fraction of the box.
    fn length(&self, step: &DVector<f64>) -> f64 {
        step.component_div(&self.spans).amax()
    }

    /// Nielsen's rule: the better the model predicted, the less damping.
    fn adapt_damping(&mut self, ratio: f64) {
        let factor = 1.0 - (2.0 * ratio.min(1.0) - 1.0).powi(3);
        self.damping = (self.damping * factor.clamp(1.0 / 3.0, 2.0)).max(DAMPING_MIN);
        self.damping_growth = 2.0;
    }

    fn raise_damping(&mut self) {
        self.damping *= self.damping_growth;
        self.damping_growth *= 2.0;
    }
}

#[cfg(test)]
mod tests;
