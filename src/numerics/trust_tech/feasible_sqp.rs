//! The local solver of the constrained form: sequential quadratic programming that stays feasible.
//!
//! Each step solves the quadratic program of the Lagrangian's curvature, damped as in
//! [`local_solver`](crate::numerics::local_solver), over the linearised constraints; the quotient
//! gradient system then brings the point back onto the curved ones, so that the objective is only
//! ever asked at feasible points and no penalty has to be weighed against it. The paper's
//! conclusion asks for exactly this: "robust feasible local solvers need to be employed".

use nalgebra::{Cholesky, DMatrix, DVector, SymmetricEigen};

use super::{constrained_gradient::Feasible, quotient_gradient, slack_form::SlackForm};
use crate::numerics::{
    Bounds, LocalSolution,
    local_solver::{Guide, Options, Termination},
    objective::Counted,
    quadratic_program::{Constraint, LinearConstraints, QuadraticProgram, Solution},
};

/// Damping beyond which no step is left.
const DAMPING_MAX: f64 = 1e12;
/// Consecutive steps that may gain next to nothing.
const SMALL_GAINS_MAX: u32 = 3;

/// Minimises from a feasible point. In scaled coordinates; `cost` is left to the caller.
pub(super) fn minimise(
    form: &SlackForm<'_>,
    counted: &mut Counted<'_>,
    start: Feasible,
    options: &Options,
    guide: &Guide<'_>,
    cancel: &(dyn Fn() -> bool + Sync),
) -> LocalSolution {
    let mut solver = Solver {
        form,
        counted,
        options,
        guide,
        cancel,
        damping: options.damping_initial,
        multipliers: vec![0.0; form.own_constraints()],
    };
    let (at, termination) = solver.descend(start);
    LocalSolution {
        x: form.parameters_of(&at.x),
        value: at.expansion.value,
        gradient: at.expansion.gradient,
        curvature: at.expansion.curvature,
        termination,
        cost: solver.counted.cost,
    }
}

struct Solver<'a, 'o> {
    form: &'a SlackForm<'a>,
    counted: &'a mut Counted<'o>,
    options: &'a Options,
    guide: &'a Guide<'a>,
    cancel: &'a (dyn Fn() -> bool + Sync),
    damping: f64,
    /// Of the problem's own constraints, from the last quadratic program.
    multipliers: Vec<f64>,
}

impl Solver<'_, '_> {
    fn descend(&mut self, mut at: Feasible) -> (Feasible, Termination) {
        let mut small_gains = 0;
        loop {
            let value = at.expansion.value;
            if (self.guide.recognises)(&self.form.parameters_of(&at.x), &at.expansion) {
                return (at, Termination::Recognised);
            }
            let tolerance = self.guide.tolerance(self.options, value);
            let Some(program) = self.program(&at) else {
                return (
                    at,
                    Termination::EdgeOfDomain {
                        gained: 0.0,
                        tolerance,
                    },
                );
            };
            if let Some(full) = solved(&program, 0.0) {
                let promised = -full.value;
                if promised <= tolerance {
                    return (
                        at,
                        Termination::PromiseSmall {
                            promised,
                            tolerance,
                        },
                    );
                }
            }
            match self.step(&at, &program) {
                Err(termination) => return (at, termination),
                Ok(next) => at = next,
            }
            let gained = value - at.expansion.value;
            small_gains = if gained <= tolerance {
                small_gains + 1
            } else {
                0
            };
            if small_gains >= SMALL_GAINS_MAX {
                return (at, Termination::GainSmall { gained, tolerance });
            }
        }
    }

    /// Raises the damping until a step lowers the objective.
    fn step(&mut self, at: &Feasible, program: &QuadraticProgram) -> Result<Feasible, Termination> {
        let tolerance = self.options.step_relative;
        let mut met_edge = false;
        loop {
            let (evaluations, limit) = (
                self.counted.cost.evaluations(),
                self.options.evaluations_max,
            );
            if evaluations >= limit {
                return Err(Termination::EvaluationsExhausted { evaluations, limit });
            }
            if (self.cancel)() {
                return Err(Termination::Cancelled);
            }
            let solution = solved(program, self.damping);
            let step = solution.as_ref().map_or(0.0, |solution| solution.x.amax());
            if self.damping > DAMPING_MAX || (solution.is_some() && step <= tolerance) {
                return Err(if met_edge {
                    Termination::EdgeOfDomain {
                        gained: 0.0,
                        tolerance,
                    }
                } else {
                    Termination::StepSmall { step, tolerance }
                });
            }
            if let Some(solution) = solution {
                let trial = self.restored(at, &solution.x);
                met_edge = trial.is_none();
                if let Some(next) = trial.filter(|next| next.expansion.value < at.expansion.value) {
                    self.counted.cost.steps_accepted += 1;
                    self.adapt(at, &next, program, &solution);
                    return Ok(next);
                }
                self.counted.cost.steps_rejected += 1;
            }
            self.damping *= 4.0;
        }
    }

    /// The point a step leads to, brought back onto the constraints.
    fn restored(&mut self, at: &Feasible, step: &DVector<f64>) -> Option<Feasible> {
        let p = self.form.parameters_of(&at.x) + step;
        let x = self.form.lifted(&self.form.bounds.clamped(&p))?;
        let x = quotient_gradient::integrate(self.form, x)?;
        let expansion = self.counted.expansion(&self.form.parameters_of(&x))?;
        Some(Feasible { x, expansion })
    }

    fn adapt(
        &mut self,
        at: &Feasible,
        next: &Feasible,
        program: &QuadraticProgram,
        solution: &Solution,
    ) {
        let curved = &program.hessian * &solution.x;
        let predicted = -(program.gradient.dot(&solution.x) + 0.5 * curved.dot(&solution.x));
        let ratio = (at.expansion.value - next.expansion.value) / predicted;
        self.damping *= match ratio {
            ratio if ratio > 0.75 => 0.1,
            ratio if ratio > 0.25 => 0.5,
            _ => 2.0,
        };
        self.damping = self.damping.max(1e-15);
        self.multipliers.fill(0.0);
        for held in &solution.active {
            match held.constraint {
                Constraint::Equality(i) => self.multipliers[i] = held.multiplier,
                Constraint::Inequality(i) => {
                    self.multipliers[self.form.equalities() + i] = held.multiplier;
                }
                Constraint::Lower(_) | Constraint::Upper(_) => {}
            }
        }
    }

    /// The quadratic program at a feasible point; none where a constraint does not exist.
    fn program(&self, at: &Feasible) -> Option<QuadraticProgram> {
        let p = self.form.parameters_of(&at.x);
        let h = self.form.own_values(&p)?;
        let jacobian = self.form.own_jacobian(&p)?;
        let fixed = self.form.equalities();
        let free = h.len() - fixed;
        let curvature = &at.expansion.curvature + self.form.curvature(&p, &self.multipliers)?;
        // What the restoration has left of a violation is rounding; 0 is always a feasible step.
        let room = DVector::from_fn(free, |i, _| (-h[fixed + i]).max(0.0));
        Some(QuadraticProgram {
            hessian: convexified(curvature),
            gradient: at.expansion.gradient.clone(),
            bounds: Bounds {
                lower: (&self.form.bounds.lower - &p).map(|room| room.min(0.0)),
                upper: (&self.form.bounds.upper - &p).map(|room| room.max(0.0)),
            },
            equalities: LinearConstraints {
                matrix: jacobian.rows(0, fixed).into_owned(),
                right: DVector::zeros(fixed),
            },
            inequalities: LinearConstraints {
                matrix: jacobian.rows(fixed, free).into_owned(),
                right: room,
            },
        })
    }
}

/// The program with `damping` times its diagonal added; none when it has no solution.
fn solved(program: &QuadraticProgram, damping: f64) -> Option<Solution> {
    let mut damped = program.clone();
    let diagonal = program.hessian.diagonal();
    let floor = 1e-6 * diagonal.amax().max(f64::MIN_POSITIVE);
    for i in 0..diagonal.len() {
        damped.hessian[(i, i)] += damping * diagonal[i].max(floor);
    }
    damped.minimise().ok()
}

/// The matrix itself when it is positive definite; otherwise with the absolute values of its
/// eigenvalues.
fn convexified(matrix: DMatrix<f64>) -> DMatrix<f64> {
    if Cholesky::new(matrix.clone()).is_some() {
        return matrix;
    }
    let eigen = SymmetricEigen::new(matrix);
    let floor = 1e-8 * eigen.eigenvalues.amax().max(f64::MIN_POSITIVE);
    let values = eigen.eigenvalues.map(|value| value.abs().max(floor));
    &eigen.eigenvectors * DMatrix::from_diagonal(&values) * eigen.eigenvectors.transpose()
}
