//! The problem, simulated roughly.

use nalgebra::DVector;

use super::{JointPoint, JointProblem, OUTER};
use crate::{
    load_model::induction_motor::Effort,
    numerics::{Expansion, Objective},
};

/// The problem with simulations that are good enough to find the way, but not to end it.
#[derive(Debug)]
pub(in crate::identification) struct Rough<'a, 'e> {
    problem: &'a JointProblem<'e>,
    effort: Effort,
}

impl<'a, 'e> Rough<'a, 'e> {
    /// Steps with errors below 1e-4 of the motor's power, a tenth of the noise of any recording; away from
    /// transients far below.
    pub(in crate::identification) const fn new(problem: &'a JointProblem<'e>) -> Self {
        Self::loose(problem, 100_000)
    }

    /// Errors of up to 1e-3, for a scan whose cells differ by more.
    pub(in crate::identification) const fn for_scan(problem: &'a JointProblem<'e>) -> Self {
        Self::loose(problem, 1_000_000)
    }

    /// Everything at a point.
    pub(in crate::identification) fn point(&self, x: &DVector<f64>) -> Option<JointPoint> {
        let points = self.problem.points_to(std::slice::from_ref(x), self.effort);
        points.into_iter().next().flatten()
    }

    const fn loose(problem: &'a JointProblem<'e>, looseness: u32) -> Self {
        Self {
            problem,
            effort: Effort::Rough { looseness },
        }
    }
}

impl Objective for Rough<'_, '_> {
    fn dimension(&self) -> usize {
        OUTER
    }

    fn value(&self, x: &DVector<f64>) -> Option<f64> {
        self.values(std::slice::from_ref(x)).pop().flatten()
    }

    fn values(&self, points: &[DVector<f64>]) -> Vec<Option<f64>> {
        self.problem.values_to(points, self.effort)
    }

    fn expansion(&self, x: &DVector<f64>) -> Option<Expansion> {
        self.expansions(std::slice::from_ref(x)).pop().flatten()
    }

    fn expansions(&self, points: &[DVector<f64>]) -> Vec<Option<Expansion>> {
        self.problem.expansions_to(points, self.effort)
    }
}
