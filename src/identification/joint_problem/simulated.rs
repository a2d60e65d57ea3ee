//! The problem, simulated as roughly as a search can bear.

use std::{collections::BTreeMap, sync::Mutex};

use nalgebra::DVector;

use super::{JointPoint, JointProblem, OUTER};
use crate::{
    load_model::induction_motor::Effort,
    numerics::{Expansion, Objective},
};

/// The problem with simulations of a given effort. Remembers every point it was asked to expand, as those a search
/// ends at are wanted again with all that is known of them.
#[derive(Debug)]
pub(in crate::identification) struct Simulated<'a, 'e> {
    problem: &'a JointProblem<'e>,
    effort: Effort,
    /// By the bits of the outer unknowns.
    points: Mutex<BTreeMap<[u64; OUTER], JointPoint>>,
}

impl<'a, 'e> Simulated<'a, 'e> {
    /// As exactly as the problem itself.
    pub(in crate::identification) const fn exactly(problem: &'a JointProblem<'e>) -> Self {
        Self::with(problem, Effort::Exact)
    }

    /// Steps with errors below 1e-3 of the power that the motor draws at the moment, as large as the noise of a good
    /// recording; away from transients far below.
    pub(in crate::identification) const fn roughly(problem: &'a JointProblem<'e>) -> Self {
        Self::with(
            problem,
            Effort::Rough {
                looseness: 1_000_000,
            },
        )
    }

    /// Errors of up to 1e-2, for a scan whose cells differ by more.
    pub(in crate::identification) const fn for_scan(problem: &'a JointProblem<'e>) -> Self {
        let looseness = 10_000_000;
        Self::with(problem, Effort::Rough { looseness })
    }

    /// Everything at a point; costs nothing where its expansion was asked for before.
    pub(in crate::identification) fn point(&self, x: &DVector<f64>) -> Option<JointPoint> {
        let known = self.points.lock().ok()?.get(&bits(x)).cloned();
        known.or_else(|| {
            let points = self.problem.points_to(std::slice::from_ref(x), self.effort);
            points.into_iter().next().flatten()
        })
    }

    const fn with(problem: &'a JointProblem<'e>, effort: Effort) -> Self {
        Self {
            problem,
            effort,
            points: Mutex::new(BTreeMap::new()),
        }
    }
}

impl Objective for Simulated<'_, '_> {
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
        let found = self.problem.points_to(points, self.effort);
        let expansions = found.iter().map(|point| Some(point.as_ref()?.expansion()));
        let expansions = expansions.collect();
        // A poisoned lock means that a panic is on its way already.
        if let Ok(mut known) = self.points.lock() {
            let found = points.iter().zip(found);
            known.extend(found.filter_map(|(x, point)| Some((bits(x), point?))));
        }
        expansions
    }
}

fn bits(x: &DVector<f64>) -> [u64; OUTER] {
    std::array::from_fn(|i| x[i].to_bits())
}
