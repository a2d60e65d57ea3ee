//! The constrained problem: steps 1 to 6 of section 5 on the slack-variable form.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::{
    ConstrainedProblem, Options, UserDirection, UserDirectionKind, constrained_gradient,
    constrained_gradient::Feasible,
    directions::{Direction, DirectionKind, Directions},
    exit_point::{ExitSearch, PathEnd, find_exit},
    feasible_sqp,
    known::Known,
    quotient_gradient,
    scaled::Scaled,
    slack_form::SlackForm,
    tangent::Tangent,
    tiers::{Followed, Form, Reached, Task},
};
use crate::numerics::{
    Bounds, Cost, Expansion, LocalSolution, objective::Counted, side_by_side::at_once,
};

pub(super) struct ConstrainedForm<'a> {
    slack: SlackForm<'a>,
    scaled: &'a Scaled<'a>,
    bounds: &'a Bounds,
    user_directions: &'a [UserDirection],
    options: &'a Options,
    cancel: &'a (dyn Fn() -> bool + Sync),
}

/// How far ahead a point is lifted onto the slacks to turn a direction in `p` into one in `x`;
/// in widths of the box.
const LOOK_AHEAD: f64 = 0.05;

/// How far to the side of an unstable equilibrium the way to a feasible point is looked for; in
/// widths of the box. Chosen; the way does not depend on it as long as it is visible.
const ASIDE: f64 = 0.1;

impl<'a> ConstrainedForm<'a> {
    pub(super) fn new(
        problem: &ConstrainedProblem<'a>,
        scaled: &'a Scaled<'a>,
        unit_bounds: &'a Bounds,
        user_directions: &'a [UserDirection],
        options: &'a Options,
        cancel: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        Self {
            slack: SlackForm::new(problem.constraints, &scaled.spans, unit_bounds),
            scaled,
            bounds: problem.bounds,
            user_directions,
            options,
            cancel,
        }
    }

    /// The local solution that the stability region of the feasible point `x` belongs to: the
    /// projected gradient system, then the local solver.
    fn settle_from(
        &self,
        counted: &mut Counted<'_>,
        x: DVector<f64>,
        known: &Known,
    ) -> Option<Reached> {
        let recognises = |p: &DVector<f64>, at: &Expansion| known.recognised(p, at).is_some();
        let at = constrained_gradient::integrate(
            &self.slack,
            counted,
            x,
            (self.options.gradient_steps, self.options.step),
            &recognises,
            self.cancel,
        )?;
        // The limit of evaluations is the local solver's own.
        let mut local = Counted::new(self.scaled);
        let found = feasible_sqp::minimise(
            &self.slack,
            &mut local,
            at,
            &self.options.local,
            &known.guide(&recognises),
            self.cancel,
        );
        counted.cost += local.cost;
        Reached::new(found, known, |found| {
            self.scaled.unscaled(found, self.bounds)
        })
    }

    /// Within the feasible component (phase II): exit point, step 5, projected gradient system,
    /// local solver.
    fn follow_gradient(
        &self,
        counted: &mut Counted<'_>,
        (origin, value): (&DVector<f64>, f64),
        unit: &DVector<f64>,
        known: &Known,
    ) -> (ExitSearch, Option<Reached>) {
        let path = at_once(find_exit(
            (origin, value),
            unit,
            self.options,
            &|x, y| self.projected(x, y),
            &mut async |points: &[DVector<f64>]| {
                if (self.cancel)() {
                    return vec![None; points.len()];
                }
                let parameters: Vec<_> = (points.iter())
                    .map(|x| self.slack.parameters_of(x))
                    .collect();
                counted.values(&parameters)
            },
        ));
        let PathEnd::Exit { point } = &path.end else {
            return (path, None);
        };
        let beyond = (point - origin) * self.options.overshoot;
        // q0 = x_s + (x_exit - x_s) + 0.1 P(x_exit)(x_exit - x_s), or x_exit where there is none.
        let q0 = self.projected(point, &(point + beyond));
        let reached = q0
            .and_then(|q0| self.settle_from(counted, q0, known))
            .or_else(|| self.settle_from(counted, point.clone(), known));
        (path, reached)
    }

    /// To another feasible component (phase I): straight ahead until the energy (7), having risen,
    /// falls; then the quotient gradient system.
    fn follow_quotient(
        &self,
        counted: &mut Counted<'_>,
        origin: &DVector<f64>,
        unit: &DVector<f64>,
        known: &Known,
    ) -> (ExitSearch, Option<Reached>) {
        let energy = |p: &DVector<f64>| quotient_gradient::energy(&self.slack, p);
        let path = at_once(find_exit(
            (origin, energy(origin).unwrap_or(0.0)),
            unit,
            self.options,
            &|_, y| Some(self.slack.bounds.clamped(y)),
            &mut async |points: &[DVector<f64>]| points.iter().map(energy).collect(),
        ));
        let PathEnd::Exit { point } = &path.end else {
            return (path, None);
        };
        let beyond = point + (point - origin) * self.options.overshoot;
        let reached = self
            .feasible(&beyond)
            .and_then(|x| self.settle_from(counted, x, known));
        (path, reached)
    }

    /// Steps 1 and 2 of section 3.2, `x + P_H(x)(y - x)`, and the quotient gradient system against
    /// the drift of second order. A slack that would change its sign stops at 0: beyond it the same
    /// points would be met again in reverse.
    fn projected(&self, x: &DVector<f64>, y: &DVector<f64>) -> Option<DVector<f64>> {
        let tangent = Tangent::new(&self.slack.jacobian(x)?);
        let mut next = x + tangent.project(&(y - x));
        for i in self.slack.parameters()..x.len() {
            if next[i] * x[i] < 0.0 {
                next[i] = 0.0;
            }
        }
        quotient_gradient::integrate(&self.slack, next)
    }

    /// The feasible point that the quotient gradient system reaches from `p`. Where that is an
    /// unstable equilibrium (a slack of 0, or the crest of a constraint), from a little beside it.
    fn feasible(&self, p: &DVector<f64>) -> Option<DVector<f64>> {
        let p = self.slack.bounds.clamped(p);
        let from = |p: &DVector<f64>, slack_min: f64| {
            let lifted = self.slack.lifted_above(p, slack_min)?;
            quotient_gradient::integrate(&self.slack, lifted)
        };
        let beside = |k: usize| {
            let mut beside = p.clone();
            beside[k / 2] += if k.is_multiple_of(2) { ASIDE } else { -ASIDE };
            self.slack.bounds.clamped(&beside)
        };
        from(&p, 0.0)
            .or_else(|| from(&p, ASIDE))
            .or_else(|| (0..2 * p.len()).find_map(|k| from(&beside(k), ASIDE)))
    }

    /// Eigenvectors of the Lagrangian's Hessian on the tangent space.
    fn add_tangent_eigenvectors(&self, directions: &mut Directions, at: &Feasible) -> Option<()> {
        let tangent = Tangent::new(&self.slack.jacobian(&at.x)?);
        let hessian = constrained_gradient::lagrangian_hessian(&self.slack, at, &tangent)?;
        let basis = tangent.basis();
        if !basis.is_empty() {
            let basis = DMatrix::from_columns(&basis);
            let reduced = basis.transpose() * hessian * &basis;
            directions.add_eigenvectors_within(&reduced, &basis);
        }
        Some(())
    }

    /// Directions in `p`, each as the way to a point a little ahead, slacks and all: on a bound a
    /// slack of 0 has to grow before its coordinate can move.
    fn add_ways(
        &self,
        directions: &mut Directions,
        x: &DVector<f64>,
        ways: &[(String, DVector<f64>)],
    ) {
        let p = self.slack.parameters_of(x);
        for (label, way) in ways {
            let Some(unit) = way.clone().try_normalize(f64::MIN_POSITIVE) else {
                continue;
            };
            let ahead = self.slack.bounds.clamped(&(&p + unit * LOOK_AHEAD));
            if let Some(lifted) = self.slack.lifted(&ahead) {
                directions.add(label.clone(), &(lifted - x));
            }
        }
    }

    /// Coordinates, the centre and the user's directions, as vectors in scaled `p`.
    fn ways(&self, from: &LocalSolution) -> Vec<(String, DVector<f64>)> {
        let spans = &self.scaled.spans;
        let mut ways = Vec::new();
        let mut add_line = |name: &str, vector: DVector<f64>| {
            ways.push((format!("{name} +"), vector.clone()));
            if self.options.both_signs {
                ways.push((format!("{name} -"), -vector));
            }
        };
        if self.options.box_directions {
            for i in 0..spans.len() {
                let unit = DVector::from_fn(spans.len(), |row, _| f64::from(u8::from(row == i)));
                add_line(&format!("coordinate {}", i + 1), unit);
            }
        }
        for user in self.user_directions {
            if let UserDirectionKind::Along(vector) = &user.kind {
                add_line(&user.label, vector.component_div(spans));
            }
        }
        if self.options.box_directions {
            let centre = (&self.bounds.lower + &self.bounds.upper) * 0.5;
            let way = (centre - &from.x).component_div(spans);
            ways.push(("towards the centre".to_owned(), way));
        }
        for user in self.user_directions {
            if let UserDirectionKind::Towards(point) = &user.kind {
                let way = (point - &from.x).component_div(spans);
                ways.push((user.label.clone(), way));
            }
        }
        ways
    }

    /// Directions of the quotient gradient system: only a problem with constraints of its own can
    /// have more than one feasible component.
    fn add_quotient_directions(
        &self,
        directions: &mut Directions,
        curvature: &DMatrix<f64>,
        ways: &[(String, DVector<f64>)],
    ) {
        if self.slack.own_constraints() == 0 {
            return;
        }
        directions.set_kind(DirectionKind::Quotient);
        directions.add_eigenvectors(curvature);
        for (label, way) in ways {
            directions.add(label.clone(), way);
        }
    }

    fn settle_one(&self, start: &DVector<f64>, known: &Known) -> (Option<Reached>, Cost) {
        let mut counted = Counted::new(self.scaled);
        let found = self
            .feasible(&start.component_div(&self.scaled.spans))
            .and_then(|x| self.settle_from(&mut counted, x, known));
        (found, counted.cost)
    }

    fn follow_one(&self, from: &LocalSolution, direction: &Direction, known: &Known) -> Followed {
        let mut counted = Counted::new(self.scaled);
        let origin = from.x.component_div(&self.scaled.spans);
        let (path, reached) = match direction.kind {
            DirectionKind::Quotient => {
                self.follow_quotient(&mut counted, &origin, &direction.unit, known)
            }
            DirectionKind::Gradient => match self.slack.lifted(&origin) {
                Some(x) => {
                    self.follow_gradient(&mut counted, (&x, from.value), &direction.unit, known)
                }
                None => (ExitSearch::nowhere(from.value), None),
            },
        };
        let exit_point = path.exit_point().map(|point| {
            let parameters = self.slack.parameters_of(point);
            parameters.component_mul(&self.scaled.spans)
        });
        Followed {
            exit_point,
            path,
            reached,
            cost: counted.cost,
            complete: !(self.cancel)(),
        }
    }
}

impl Form for ConstrainedForm<'_> {
    fn known(&self, solutions: &mut dyn Iterator<Item = &LocalSolution>) -> Known {
        Known::new(solutions, self.scaled, self.options, |p| {
            self.slack.is_free_of_own_constraints(p)
        })
    }

    fn settle(&self, starts: &[DVector<f64>], known: &Known) -> Vec<(Option<Reached>, Cost)> {
        (starts.par_iter())
            .map(|start| self.settle_one(start, known))
            .collect()
    }

    fn directions(&self, from: &LocalSolution) -> Vec<Direction> {
        let mut directions = Directions::new(self.options);
        let curvature = self.scaled.scaled_curvature(&from.curvature);
        let ways = self.ways(from);
        if let Some(x) = self.slack.lifted(&from.x.component_div(&self.scaled.spans)) {
            let expansion = Expansion {
                value: from.value,
                gradient: from.gradient.component_mul(&self.scaled.spans),
                curvature: curvature.clone(),
            };
            let at = Feasible { x, expansion };
            // Without the constraints' derivatives there are no eigenvectors; the ways remain.
            let _ = self.add_tangent_eigenvectors(&mut directions, &at);
            self.add_ways(&mut directions, &at.x, &ways);
        }
        self.add_quotient_directions(&mut directions, &curvature, &ways);
        directions.into_list()
    }

    fn follow(&self, tasks: &[Task], known: &Known) -> Vec<Followed> {
        (tasks.par_iter())
            .map(|task| self.follow_one(&task.local, &task.direction, known))
            .collect()
    }
}
