//! The problem in a box: the form in which every constraint is a bound.
//!
//! The projection onto the tangent space of a box, `P_H` of (8), drops the components that would
//! leave it. Everything happens in scaled coordinates; solutions are reported in the caller's.

use nalgebra::DVector;

use super::{
    Options, UserDirection, UserDirectionKind,
    directions::{Direction, Directions},
    exit_point::{PathEnd, find_exit},
    known::Known,
    projected_gradient,
    scaled::Scaled,
    tiers::{Followed, Form, Reached, Task},
};
use crate::numerics::{
    Bounds, Cost, Expansion, LocalSolution, Objective, local_solver,
    side_by_side::{self, Ask, Asking},
};

pub(super) struct BoxForm<'a> {
    scaled: Scaled<'a>,
    bounds: &'a Bounds,
    unit_bounds: Bounds,
    user_directions: &'a [UserDirection],
    options: &'a Options,
    cancel: &'a (dyn Fn() -> bool + Sync),
}

impl<'a> BoxForm<'a> {
    pub(super) fn new(
        objective: &'a dyn Objective,
        bounds: &'a Bounds,
        user_directions: &'a [UserDirection],
        options: &'a Options,
        cancel: &'a (dyn Fn() -> bool + Sync),
    ) -> Self {
        let scaled = Scaled::new(objective, bounds);
        Self {
            unit_bounds: scaled.unit_bounds(bounds),
            scaled,
            bounds,
            user_directions,
            options,
            cancel,
        }
    }

    /// The local solver from a point where the expansion is known; none where it ends at the edge
    /// of the domain.
    async fn local_solution(
        &self,
        asking: &mut Asking<'_>,
        start: (DVector<f64>, Expansion),
        known: &Known,
    ) -> Option<Reached> {
        let recognises = |x: &DVector<f64>, at: &Expansion| known.recognised(x, at).is_some();
        let found = local_solver::descend(
            asking,
            &self.unit_bounds,
            start,
            &self.options.local,
            &known.guide(&recognises),
            self.cancel,
        )
        .await;
        Reached::new(found, known, |found| {
            self.scaled.unscaled(found, self.bounds)
        })
    }

    /// `q0 = x_s + (x_exit - x_s) + 0.1 P(x_exit)(x_exit - x_s)` (step 5), with a shorter overshoot
    /// where the objective does not exist that far; then the projected gradient system.
    async fn cross_into_next_region(
        &self,
        asking: &mut Asking<'_>,
        origin: &DVector<f64>,
        exit: &DVector<f64>,
        known: &Known,
    ) -> Option<(DVector<f64>, Expansion)> {
        let recognises = |x: &DVector<f64>, at: &Expansion| known.recognised(x, at).is_some();
        let mut overshoot = self.options.overshoot;
        for _ in 0..OVERSHOOTS_MAX {
            let q0 = self
                .unit_bounds
                .clamped(&(exit + (exit - origin) * overshoot));
            let reached = projected_gradient::integrate(
                asking,
                &self.unit_bounds,
                q0,
                (self.options.gradient_steps, self.options.step),
                &recognises,
                self.cancel,
            )
            .await;
            if reached.is_some() {
                return reached;
            }
            overshoot *= 0.5;
        }
        let at = asking.expansion(exit).await?;
        Some((exit.clone(), at))
    }
}

/// Overshoots that are tried before the search goes on from the exit point itself.
const OVERSHOOTS_MAX: u32 = 4;

impl Form for BoxForm<'_> {
    fn known(&self, solutions: &mut dyn Iterator<Item = &LocalSolution>) -> Known {
        Known::new(solutions, &self.scaled, self.options, |_| true)
    }

    fn settle(&self, starts: &[DVector<f64>], known: &Known) -> Vec<(Option<Reached>, Cost)> {
        side_by_side::run(&self.scaled, starts.len(), &async |start, mut asking| {
            let x = starts[start].component_div(&self.scaled.spans);
            let start = self.unit_bounds.clamped(&x);
            let reached = match asking.expansion(&start).await {
                Some(at) => self.local_solution(&mut asking, (start, at), known).await,
                None => None,
            };
            (reached, *asking.cost())
        })
    }

    fn directions(&self, from: &LocalSolution) -> Vec<Direction> {
        let spans = &self.scaled.spans;
        let mut directions = Directions::new(self.options);
        directions.add_eigenvectors(&self.scaled.scaled_curvature(&from.curvature));
        if self.options.box_directions {
            directions.add_coordinates(spans.len());
            let centre = (&self.bounds.lower + &self.bounds.upper) * 0.5;
            let way = (centre - &from.x).component_div(spans);
            directions.add("towards the centre".to_owned(), &way);
        }
        for user in self.user_directions {
            match &user.kind {
                UserDirectionKind::Along(vector) => {
                    directions.add_line(&user.label, &vector.component_div(spans));
                }
                UserDirectionKind::Towards(point) => {
                    let way = (point - &from.x).component_div(spans);
                    directions.add(user.label.clone(), &way);
                }
            }
        }
        directions.into_list()
    }

    fn follow(&self, tasks: &[Task], known: &Known) -> Vec<Followed> {
        side_by_side::run(&self.scaled, tasks.len(), &async |task, mut asking| {
            let Task {
                local, direction, ..
            } = &tasks[task];
            let origin = local.x.component_div(&self.scaled.spans);
            let path = find_exit(
                (&origin, local.value),
                &direction.unit,
                self.options,
                &|_, y| Some(self.unit_bounds.clamped(y)),
                &mut async |points: &[DVector<f64>]| {
                    if (self.cancel)() {
                        vec![None; points.len()]
                    } else {
                        asking.values(points).await
                    }
                },
            )
            .await;
            let mut reached = None;
            if let PathEnd::Exit { point } = &path.end {
                let inside = self
                    .cross_into_next_region(&mut asking, &origin, point, known)
                    .await;
                if let Some(start) = inside {
                    reached = self.local_solution(&mut asking, start, known).await;
                }
            }
            let spans = &self.scaled.spans;
            Followed {
                exit_point: path.exit_point().map(|point| point.component_mul(spans)),
                path,
                reached,
                cost: *asking.cost(),
                complete: !(self.cancel)(),
            }
        })
    }
}
