//! The problem in a box: the form in which every constraint is a bound.
//!
//! The projection onto the tangent space of a box, `P_H` of (8), drops the components that would
//! leave it. Everything happens in scaled coordinates; solutions are reported in the caller's.

use nalgebra::DVector;

use super::{
    Options, UserDirection, UserDirectionKind,
    directions::{Direction, Directions},
    exit_point::{PathEnd, find_exit},
    projected_gradient,
    scaled::Scaled,
    tiers::{Followed, Form},
};
use crate::numerics::{Bounds, Cost, LocalSolution, Objective, local_solver, objective::Counted};

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

    fn local_solution(&self, start: &DVector<f64>) -> (Option<LocalSolution>, Cost) {
        let objective = self.scaled.objective;
        let local = &self.options.local;
        match local_solver::minimise(objective, self.bounds, start, local, self.cancel) {
            Ok(found) => {
                let cost = found.cost;
                (
                    Some(found).filter(|found| found.termination.is_feasible()),
                    cost,
                )
            }
            Err(undefined) => (None, undefined.cost),
        }
    }

    /// `q0 = x_s + (x_exit - x_s) + 0.1 P(x_exit)(x_exit - x_s)` (step 5), with a shorter overshoot
    /// where the objective does not exist that far; then the projected gradient system.
    fn cross_into_next_region(
        &self,
        counted: &mut Counted<'_>,
        origin: &DVector<f64>,
        exit: &DVector<f64>,
    ) -> Option<DVector<f64>> {
        let mut overshoot = self.options.overshoot;
        for _ in 0..OVERSHOOTS_MAX {
            let q0 = self
                .unit_bounds
                .clamped(&(exit + (exit - origin) * overshoot));
            let reached = projected_gradient::integrate(
                counted,
                &self.unit_bounds,
                q0,
                self.options.gradient_steps,
                self.options.step,
                self.cancel,
            );
            if reached.is_some() {
                return reached;
            }
            overshoot *= 0.5;
        }
        Some(exit.clone())
    }
}

/// Overshoots that are tried before the search goes on from the exit point itself.
const OVERSHOOTS_MAX: u32 = 4;

impl Form for BoxForm<'_> {
    fn settle(&self, start: &DVector<f64>) -> (Option<LocalSolution>, Cost) {
        self.local_solution(start)
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

    fn follow(&self, from: &LocalSolution, direction: &Direction) -> Followed {
        let mut counted = Counted::new(&self.scaled);
        let origin = from.x.component_div(&self.scaled.spans);
        let path = find_exit(
            (&origin, from.value),
            &direction.unit,
            self.options,
            &|_, y| Some(self.unit_bounds.clamped(y)),
            &mut |x| {
                if (self.cancel)() {
                    None
                } else {
                    counted.value(x)
                }
            },
        );
        let mut reached = None;
        let mut cost = Cost::default();
        if let PathEnd::Exit { point } = &path.end {
            let inside = self.cross_into_next_region(&mut counted, &origin, point);
            if let Some(inside) = inside {
                (reached, cost) = self.local_solution(&inside.component_mul(&self.scaled.spans));
            }
        }
        cost += counted.cost;
        Followed {
            path,
            reached,
            cost,
        }
    }
}
