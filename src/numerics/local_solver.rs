//! A bounded Levenberg-Marquardt method in normal-equation form.
//!
//! Each step minimises the model `g's + s'(H + lambda D)s / 2` over the box, where `g` is the
//! gradient, `H` the curvature, `D` the diagonal of `H` (Marquardt 1963) and `lambda` the damping,
//! driven by the ratio of actual to predicted decrease (Nielsen 1999, IMM-REP-1999-05). Coordinates
//! that rest on a bound and want to leave the box are held (projected gradient, Bertsekas 1982);
//! those that a step would carry out of it are put on the bound and the rest is solved again. A
//! step to a point where the objective does not exist is halved until it does.
//!
//! Scaling by `D` makes the method indifferent to the units of `x`, and the measure of convergence
//! (what the undamped model still promises, in units of the objective) is too: in a nearly flat
//! valley the gradient is small everywhere, but the promise is not.
//!
//! Cost per step: one [`Objective::expansion`] and a few Cholesky factorisations of size n.

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

use super::{
    Bounds, Cost, Objective,
    objective::{Counted, Expansion},
};

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
    /// How often a step out of the objective's domain is halved before it counts as rejected.
    /// Default 12.
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
            halvings_max: 12,
        }
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
/// Smallest scale of a coordinate relative to the largest, both per width of the box. Keeps a
/// coordinate of which the objective does not depend from dividing by zero.
const SCALE_RELATIVE_MIN: f64 = 1e-12;
/// Ridge, relative to the scale, with which the undamped model is solved: far above rounding
/// (1e-16), far below any curvature that a difference of two doubles can show.
const RIDGE_RELATIVE: f64 = 1e-13;
/// Scaled eigenvalue below which the curvature is negative and not just rounding.
const NEGATIVE_CURVATURE: f64 = -1e-8;

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
    last_was_rejected: bool,
}

impl Solver<'_> {
    fn descend(&mut self, mut at: Iterate) -> (Iterate, Termination) {
        let mut small_gains = 0;
        loop {
            let model = Model::new(&at, self.bounds, &self.spans);
            let tolerance = self.tolerance(at.expansion.value);
            let moved = match model.promise() {
                Some(promised) if promised <= tolerance => {
                    return (
                        at,
                        Termination::PromiseSmall {
                            promised,
                            tolerance,
                        },
                    );
                }
                None if model.gradient_promise() <= tolerance => self.leave_saddle(&at, &model),
                _ => self.step(&at, &model),
            };
            match moved {
                Move::End(termination) => return (at, termination),
                Move::To { next, shortened } => {
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
                }
            }
        }
    }

    /// Decrease that is not worth a step.
    fn tolerance(&self, value: f64) -> f64 {
        self.options.decrease_relative * value.abs() + self.options.decrease_absolute
    }

    /// Raises the damping until a step lowers the objective.
    fn step(&mut self, at: &Iterate, model: &Model<'_>) -> Move {
        let mut met_edge = false;
        loop {
            if let Some(termination) = self.interruption() {
                return Move::End(termination);
            }
            let step = model.damped_step(self.damping);
            let length = step.as_ref().map_or(f64::INFINITY, |s| self.length(s));
            if length <= self.options.step_relative || self.damping > DAMPING_MAX {
                let tolerance = self.options.step_relative;
                return Move::End(if met_edge {
                    Termination::EdgeOfDomain {
                        gained: 0.0,
                        tolerance,
                    }
                } else {
                    Termination::StepSmall {
                        step: length,
                        tolerance,
                    }
                });
            }
            // Without a step the damped curvature is not positive definite: damp more.
            let Some(step) = step else {
                self.raise_damping();
                continue;
            };
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
                Trial::NotLower => met_edge = false,
                Trial::OutsideDomain => met_edge = true,
            }
            self.counted.cost.steps_rejected += 1;
            self.last_was_rejected = true;
            self.raise_damping();
        }
    }

    /// Tries `step`, halving it while it leads to where the objective does not exist.
    fn shortened_until_defined(
        &mut self,
        at: &Iterate,
        model: &Model<'_>,
        mut step: DVector<f64>,
    ) -> Trial {
        for halvings in 0..=self.options.halvings_max {
            let trial = self.try_step(at, model, &step, halvings > 0);
            if !matches!(trial, Trial::OutsideDomain) || self.interruption().is_some() {
                return trial;
            }
            step *= 0.5;
        }
        Trial::OutsideDomain
    }

    fn try_step(
        &mut self,
        at: &Iterate,
        model: &Model<'_>,
        step: &DVector<f64>,
        shortened: bool,
    ) -> Trial {
        let predicted = model.decrease(step);
        if predicted <= 0.0 {
            return Trial::NotLower;
        }
        let x = self.bounds.snapped(&(&at.x + step));
        // Most steps succeed, and an expansion costs less than a value and an expansion; after a
        // rejection another one is likely, and the cheaper value is asked first.
        if self.last_was_rejected {
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
        // A tenth rather than Nielsen's third: a flat valley needs a damping near 0, soon.
        self.damping = (self.damping * factor.clamp(0.1, 2.0)).max(DAMPING_MIN);
        self.damping_growth = 2.0;
    }

    fn raise_damping(&mut self) {
        self.damping *= self.damping_growth;
        self.damping_growth *= 2.0;
    }
}

/// The quadratic model of the objective around one iterate, and its box.
struct Model<'a> {
    at: &'a Iterate,
    bounds: &'a Bounds,
    /// `D`: the curvature's diagonal, kept away from 0.
    scale: DVector<f64>,
    /// Coordinates that are not held on a bound.
    free: Vec<usize>,
}

impl<'a> Model<'a> {
    fn new(at: &'a Iterate, bounds: &'a Bounds, spans: &DVector<f64>) -> Self {
        Self {
            at,
            bounds,
            scale: scale(&at.expansion.curvature, spans),
            free: free_coordinates(&at.x, &at.expansion.gradient, bounds),
        }
    }

    /// Decrease that the undamped model promises on the free coordinates, `g'inv(H)g / 2`; none
    /// when the curvature is not positive semidefinite.
    fn promise(&self) -> Option<f64> {
        let gradient = select(&self.at.expansion.gradient, &self.free);
        let step = self.factor(&self.free, RIDGE_RELATIVE)?.solve(&gradient);
        Some(0.5 * gradient.dot(&step))
    }

    /// The same with the curvature's diagonal alone.
    fn gradient_promise(&self) -> f64 {
        let gradient = &self.at.expansion.gradient;
        let terms = self
            .free
            .iter()
            .map(|&i| gradient[i].powi(2) / self.scale[i]);
        0.5 * terms.sum::<f64>()
    }

    /// Minimiser of the damped model over the box. Coordinates that would leave it are put on the
    /// bound, the one farthest out first, and the others solved again.
    fn damped_step(&self, damping: f64) -> Option<DVector<f64>> {
        let Expansion {
            gradient,
            curvature,
            ..
        } = &self.at.expansion;
        let mut step = DVector::zeros(gradient.len());
        let mut free = self.free.clone();
        while !free.is_empty() {
            let right = DVector::from_fn(free.len(), |row, _| {
                let i = free[row];
                -gradient[i] - self.pinned_pull(curvature, i, &free, &step)
            });
            let solved = self.factor(&free, damping)?.solve(&right);
            for (row, &i) in free.iter().enumerate() {
                step[i] = solved[row];
            }
            let Some(row) = self.farthest_out(&free, &step) else {
                break;
            };
            let i = free.remove(row);
            step[i] = self.bounds.clamp(i, self.at.x[i] + step[i]) - self.at.x[i];
        }
        Some(step)
    }

    /// `sum over j not free of H_ij s_j`.
    fn pinned_pull(&self, h: &DMatrix<f64>, i: usize, free: &[usize], step: &DVector<f64>) -> f64 {
        let pinned = self.free.iter().filter(|j| !free.contains(j));
        pinned.map(|&j| h[(i, j)] * step[j]).sum()
    }

    /// Position within `free` of the coordinate that the step carries farthest out of the box,
    /// measured in units of what it had left.
    fn farthest_out(&self, free: &[usize], step: &DVector<f64>) -> Option<usize> {
        let mut farthest = None;
        let mut shortest_fraction = 1.0;
        for (row, &i) in free.iter().enumerate() {
            let room = if step[i] > 0.0 {
                self.bounds.upper[i] - self.at.x[i]
            } else {
                self.bounds.lower[i] - self.at.x[i]
            };
            if step[i].abs() > room.abs() && room.abs() / step[i].abs() < shortest_fraction {
                shortest_fraction = room.abs() / step[i].abs();
                farthest = Some(row);
            }
        }
        farthest
    }

    /// `-(g's + s'Hs / 2)`.
    fn decrease(&self, step: &DVector<f64>) -> f64 {
        let curved = &self.at.expansion.curvature * step;
        -(self.at.expansion.gradient.dot(step) + 0.5 * curved.dot(step))
    }

    /// Cholesky factor of `H + damping D` on the coordinates `free`.
    fn factor(&self, free: &[usize], damping: f64) -> Option<Cholesky<f64, nalgebra::Dyn>> {
        let h = &self.at.expansion.curvature;
        let damped = DMatrix::from_fn(free.len(), free.len(), |row, column| {
            let (i, j) = (free[row], free[column]);
            h[(i, j)] + if i == j { damping * self.scale[i] } else { 0.0 }
        });
        Cholesky::new(damped)
    }

    /// Direction of the most negative curvature on the free coordinates, if there is any.
    fn most_negative_curvature(&self) -> Option<DVector<f64>> {
        let h = &self.at.expansion.curvature;
        let scaled = DMatrix::from_fn(self.free.len(), self.free.len(), |row, column| {
            let (i, j) = (self.free[row], self.free[column]);
            h[(i, j)] / (self.scale[i] * self.scale[j]).sqrt()
        });
        if scaled.is_empty() {
            return None;
        }
        let eigen = SymmetricEigen::new(scaled);
        let lowest = eigen.eigenvalues.imin();
        if eigen.eigenvalues[lowest] >= NEGATIVE_CURVATURE {
            return None;
        }
        let mut direction = DVector::zeros(h.nrows());
        for (row, &i) in self.free.iter().enumerate() {
            direction[i] = eigen.eigenvectors[(row, lowest)] / self.scale[i].sqrt();
        }
        Some(direction)
    }
}

/// Diagonal of the curvature, no smaller than a fraction of its largest entry per width of the box.
fn scale(curvature: &DMatrix<f64>, spans: &DVector<f64>) -> DVector<f64> {
    let n = spans.len();
    let largest = (0..n)
        .map(|i| curvature[(i, i)].abs() * spans[i].powi(2))
        .fold(0.0, f64::max);
    let floor = if largest > 0.0 {
        SCALE_RELATIVE_MIN * largest
    } else {
        1.0
    };
    DVector::from_fn(n, |i, _| {
        curvature[(i, i)].abs().max(floor / spans[i].powi(2))
    })
}

/// Coordinates that a descent step may move: all but those on a bound with the way down outside.
fn free_coordinates(x: &DVector<f64>, gradient: &DVector<f64>, bounds: &Bounds) -> Vec<usize> {
    (0..x.len())
        .filter(|&i| {
            let held_below = x[i] <= bounds.lower[i] && gradient[i] >= 0.0;
            let held_above = x[i] >= bounds.upper[i] && gradient[i] <= 0.0;
            !(held_below || held_above)
        })
        .collect()
}

fn select(vector: &DVector<f64>, indices: &[usize]) -> DVector<f64> {
    DVector::from_fn(indices.len(), |row, _| vector[indices[row]])
}

#[cfg(test)]
mod tests;
