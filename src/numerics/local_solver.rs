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
    objective::{Counted, Expansion},
    side_by_side::{self, Ask, at_once},
};

mod model;
mod options;
mod termination;

use model::{Model, free_coordinates, scale};
pub use options::Options;
pub use termination::Termination;

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
    let mut counted = Counted::new(objective);
    let x = bounds.clamped(start);
    let Some(expansion) = counted.expansion(&x) else {
        return Err(UndefinedStart { cost: counted.cost });
    };
    let found = at_once(descend(
        &mut counted,
        bounds,
        (x, expansion),
        options,
        &Guide::default(),
        cancel,
    ));
    Ok(LocalSolution {
        cost: counted.cost,
        ..found
    })
}

/// [`minimise`] from several starts, whose questions are asked together.
pub fn minimise_all(
    objective: &dyn Objective,
    bounds: &Bounds,
    starts: &[DVector<f64>],
    options: &Options,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Vec<Result<LocalSolution, UndefinedStart>> {
    side_by_side::run(objective, starts.len(), &async |start, mut asking| {
        let x = bounds.clamped(&starts[start]);
        let Some(expansion) = asking.expansion(&x).await else {
            let cost = *asking.cost();
            return Err(UndefinedStart { cost });
        };
        let at = (x, expansion);
        let found = descend(&mut asking, bounds, at, options, &Guide::default(), cancel).await;
        Ok(LocalSolution {
            cost: *asking.cost(),
            ..found
        })
    })
}

/// What a caller who knows other solutions tells the solver.
pub(super) struct Guide<'a> {
    /// Whether the way down from a point leads to a known solution; asked at every iterate.
    pub(super) recognises: &'a dyn Fn(&DVector<f64>, &Expansion) -> bool,
    /// Objective above which a solution is not worth the last digits.
    pub(super) exact_below: f64,
    /// Decrease, relative to the objective, that is not worth a step just above it; farther up in
    /// proportion, to [`POOREST`] times as much.
    pub(super) decrease_relative: f64,
}

impl Default for Guide<'_> {
    fn default() -> Self {
        Self {
            recognises: &|_, _| false,
            exact_below: f64::INFINITY,
            decrease_relative: 0.0,
        }
    }
}

impl Guide<'_> {
    /// Decrease that is not worth a step at this objective.
    pub(super) fn tolerance(&self, options: &Options, value: f64) -> f64 {
        let mut relative = options.decrease_relative;
        if value > self.exact_below {
            let poor = (value / self.exact_below).clamp(1.0, POOREST);
            relative = relative.max(self.decrease_relative * poor);
        }
        relative * value.abs() + options.decrease_absolute
    }
}

/// [`minimise`] from a point of the box where the expansion is known. The limit of evaluations and
/// the cost refer to this descent alone, and are added to those of `asking`.
pub(super) async fn descend<A: Ask>(
    asking: &mut A,
    bounds: &Bounds,
    (x, expansion): (DVector<f64>, Expansion),
    options: &Options,
    guide: &Guide<'_>,
    cancel: &(dyn Fn() -> bool + Sync),
) -> LocalSolution {
    let before = std::mem::take(asking.cost());
    let mut solver = Solver {
        bounds,
        spans: bounds.spans(),
        options,
        guide,
        cancel,
        damping: options.damping_initial,
        damping_growth: 2.0,
        scale: DVector::zeros(x.len()),
        fraction: 1.0,
        leap_pause: 0,
        leap_patience: 1,
        last_was_rejected: false,
        asking,
    };
    let (at, termination) = solver.descend(Iterate { x, expansion }).await;
    let cost = *asking.cost();
    *asking.cost() += before;
    LocalSolution {
        x: at.x,
        value: at.expansion.value,
        gradient: at.expansion.gradient,
        curvature: at.expansion.curvature,
        termination,
        cost,
    }
}

/// Multiple of [`Guide::exact_below`] from which solutions are equally poor.
const POOREST: f64 = 10.0;
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

struct Solver<'a, A> {
    asking: &'a mut A,
    bounds: &'a Bounds,
    spans: DVector<f64>,
    options: &'a Options,
    guide: &'a Guide<'a>,
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

impl<A: Ask> Solver<'_, A> {
    async fn descend(&mut self, mut at: Iterate) -> (Iterate, Termination) {
        let (mut small_gains, mut creeping) = (0, 0);
        loop {
            if (self.guide.recognises)(&at.x, &at.expansion) {
                return (at, Termination::Recognised);
            }
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
            let wanted = self.options.wanted;
            let out_of_reach =
                |promised: &f64| at.expansion.value - options::REACH * promised > wanted;
            if let Some(promised) = promise.filter(out_of_reach) {
                return (at, Termination::OutOfReach { promised, wanted });
            }
            let moved = if promise.is_none() && model.gradient_promise() <= tolerance {
                self.leave_saddle(&at, &model).await
            } else {
                let leapt = if creeping >= CREEPING_STEPS {
                    self.leap(&at, &model).await
                } else {
                    None
                };
                match leapt {
                    Some(moved) => moved,
                    None => self.step(&at, &model).await,
                }
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
    async fn leap(&mut self, at: &Iterate, model: &Model<'_>) -> Option<Move> {
        if self.leap_pause > 0 {
            self.leap_pause -= 1;
            return None;
        }
        let damping = (self.damping * LEAP_DAMPING).max(DAMPING_MIN);
        let mut far = self.lightly_damped_move(&at.x, model, damping).await;
        if let Some(above) = far.take_if(|far| far.expansion.value >= at.expansion.value) {
            let model = self.model_without_memory(&above);
            far = self
                .lightly_damped_move(&above.x, &model, damping)
                .await
                .filter(|far| far.expansion.value < at.expansion.value);
        }
        if let Some(next) = far {
            self.asking.cost().steps_accepted += 1;
            self.damping = damping;
            self.leap_patience = 1;
            return Some(Move::To {
                next,
                shortened: false,
            });
        }
        self.asking.cost().steps_rejected += 1;
        self.leap_pause = self.leap_patience;
        self.leap_patience = (2 * self.leap_patience).min(LEAP_PAUSE_MAX);
        None
    }

    /// Where a step with this damping leads, whether down or up.
    async fn lightly_damped_move(
        &mut self,
        x: &DVector<f64>,
        model: &Model<'_>,
        damping: f64,
    ) -> Option<Iterate> {
        if self.interruption().is_some() {
            return None;
        }
        let x = self.bounds.snapped(&(x + model.damped_step(damping)?));
        let expansion = self.asking.expansion(&x).await?;
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
        self.guide.tolerance(self.options, value)
    }

    /// Raises the damping until a step lowers the objective.
    async fn step(&mut self, at: &Iterate, model: &Model<'_>) -> Move {
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
            match self.shortened_until_defined(at, model, step).await {
                Trial::Lower {
                    next,
                    ratio,
                    shortened,
                } => {
                    self.asking.cost().steps_accepted += 1;
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
                    self.asking.cost().steps_rejected += 1;
                    self.last_was_rejected = true;
                    self.raise_damping();
                }
            }
        }
    }

    /// Tries `step`, halving it while it leads to where the objective does not exist. An edge that
    /// has been met is expected again: the first trial is twice the part that was left last time.
    async fn shortened_until_defined(
        &mut self,
        at: &Iterate,
        model: &Model<'_>,
        mut step: DVector<f64>,
    ) -> Trial {
        step *= self.fraction;
        for _ in 0..=self.options.halvings_max {
            let trial = self.try_step(at, model, &step).await;
            if !matches!(trial, Trial::OutsideDomain) {
                self.fraction = (2.0 * self.fraction).min(1.0);
                return trial;
            }
            self.asking.cost().steps_rejected += 1;
            if self.interruption().is_some() {
                break;
            }
            step *= 0.5;
            self.fraction *= 0.5;
        }
        Trial::OutsideDomain
    }

    async fn try_step(&mut self, at: &Iterate, model: &Model<'_>, step: &DVector<f64>) -> Trial {
        let predicted = model.decrease(step);
        if predicted <= 0.0 {
            return Trial::NotLower;
        }
        let x = self.bounds.snapped(&(&at.x + step));
        // Most steps succeed, and an expansion costs less than a value and an expansion; after a
        // rejection another one is likely, and the cheaper value is asked first.
        if self.last_was_rejected || self.fraction < 1.0 {
            match self.asking.value(&x).await {
                None => return Trial::OutsideDomain,
                Some(value) if value >= at.expansion.value => return Trial::NotLower,
                Some(_) => {}
            }
        }
        match self.asking.expansion(&x).await {
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
    async fn leave_saddle(&mut self, at: &Iterate, model: &Model<'_>) -> Move {
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
                    .asking
                    .expansion(&x)
                    .await
                    .filter(|expansion| expansion.value < at.expansion.value - tolerance);
                if let Some(expansion) = lower {
                    self.asking.cost().steps_accepted += 1;
                    let next = Iterate { x, expansion };
                    return Move::To {
                        next,
                        shortened: false,
                    };
                }
                self.asking.cost().steps_rejected += 1;
            }
        }
        Move::End(Termination::PromiseSmall {
            promised,
            tolerance,
        })
    }

    fn interruption(&mut self) -> Option<Termination> {
        let (evaluations, limit) = (
            self.asking.cost().evaluations(),
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
