//! The tiers: which directions are explored, in which order, and when it is enough.

use std::{collections::VecDeque, ops::Range};

use nalgebra::DVector;

use super::{
    DirectionOutcome, DirectionRecord, Ended, FoundSolution, MoreStarts, Options, Search, Starts,
    directions::Direction,
    exit_point::{ExitSearch, PathEnd},
    known::Known,
};
use crate::numerics::{Cost, Expansion, LocalSolution, local_solver::Termination};

/// What the tiers need to know of a formulation of the problem.
pub(super) trait Form: Sync {
    /// What a formulation keeps of the solutions known so far.
    fn known(&self, solutions: &mut dyn Iterator<Item = &LocalSolution>) -> Known;
    /// The local solution that each start leads to; none when no feasible point is reached (steps 1
    /// and 2 of section 5).
    fn settle(&self, starts: &[DVector<f64>], known: &Known) -> Vec<(Option<Reached>, Cost)>;
    /// The directions to be followed from a solution (step 3).
    fn directions(&self, from: &LocalSolution) -> Vec<Direction>;
    /// Follows some of them (steps 4 to 6), each from the same state of knowledge.
    fn follow(&self, tasks: &[Task], known: &Known) -> Vec<Followed>;
}

/// Where the local solver ended.
pub(super) enum Reached {
    /// At a solution.
    Solution(LocalSolution),
    /// On its way to the known solution of this index.
    Known(usize),
}

impl Reached {
    /// From a solution in scaled coordinates; none at the edge of the domain.
    pub(super) fn new(
        found: LocalSolution,
        known: &Known,
        unscaled: impl FnOnce(&LocalSolution) -> LocalSolution,
    ) -> Option<Self> {
        match found.termination {
            Termination::Recognised => {
                let expansion = Expansion {
                    value: found.value,
                    gradient: found.gradient,
                    curvature: found.curvature,
                };
                known.recognised(&found.x, &expansion).map(Self::Known)
            }
            end => (end.is_feasible()).then(|| Self::Solution(unscaled(&found))),
        }
    }
}

/// Where a direction led.
pub(super) struct Followed {
    pub(super) path: ExitSearch,
    /// The solution beyond the exit point, if there is one and the local solver reached it.
    pub(super) reached: Option<Reached>,
    pub(super) cost: Cost,
    /// The exit point, in the caller's coordinates.
    pub(super) exit_point: Option<DVector<f64>>,
    /// Whether it was not cut short by a cancellation.
    pub(super) complete: bool,
}

/// Directions (or starts) that are followed side by side, all from the same state of knowledge: a
/// fixed number, so that the outcome does not depend on how many threads there are. More would find
/// the same new solution several times over.
const SIDE_BY_SIDE: usize = 16;

/// Whether two solutions are one.
type Same<'a> = &'a (dyn Fn(&LocalSolution, &LocalSolution) -> bool + Sync);

/// Explores `form` from `starts`, tier by tier.
pub(super) fn explore(
    form: &dyn Form,
    starts: &Starts<'_>,
    same: Same<'_>,
    options: &Options,
    cancel: &(dyn Fn() -> bool + Sync),
) -> Search {
    let mut explorer = Explorer {
        form,
        same,
        options,
        cancel,
        solutions: Vec::new(),
        directions: Vec::new(),
        cost: Cost::default(),
        more: starts.second,
    };
    let ended = explorer.run(starts.first);
    Search {
        solutions: explorer.solutions,
        directions: explorer.directions,
        cost: explorer.cost,
        ended,
    }
}

/// A direction that is waiting to be followed.
pub(super) struct Task {
    /// Number of the solution it starts from.
    from: usize,
    /// That solution.
    pub(super) local: LocalSolution,
    /// Number of the direction there.
    number: usize,
    pub(super) direction: Direction,
}

struct Explorer<'a> {
    form: &'a dyn Form,
    same: Same<'a>,
    options: &'a Options,
    cancel: &'a (dyn Fn() -> bool + Sync),
    solutions: Vec<FoundSolution>,
    directions: Vec<DirectionRecord>,
    cost: Cost,
    /// More starts, until they have been asked for.
    more: Option<MoreStarts<'a>>,
}

impl Explorer<'_> {
    fn run(&mut self, first: &[DVector<f64>]) -> Ended {
        if let Some(ended) = self.settle_starts(first) {
            return ended;
        }
        let mut begun = 0;
        loop {
            let ended = self.climb_tiers(begun);
            if !matches!(ended, Ended::NothingNew { .. }) {
                return ended;
            }
            begun = self.solutions.len();
            if let Some(interrupted) = self.settle_more() {
                return interrupted;
            }
            if self.solutions.len() == begun {
                return ended;
            }
        }
    }

    /// Asks for more starts, unless that has been done. Returns a reason to end, if there is one.
    fn settle_more(&mut self) -> Option<Ended> {
        let more = self.more.take()?;
        self.settle_starts(&more(&self.solutions))
    }

    /// Tier 0. Returns a reason to end, if there is one already.
    fn settle_starts(&mut self, starts: &[DVector<f64>]) -> Option<Ended> {
        for some in starts.chunks(SIDE_BY_SIDE) {
            if let Some(ended) = self.interruption() {
                return Some(ended);
            }
            let (form, known) = (self.form, self.known());
            for (reached, cost) in form.settle(some, &known) {
                self.cost += cost;
                if let Some(reached) = reached {
                    self.admit(reached, 0, None);
                }
            }
        }
        self.solutions.is_empty().then_some(Ended::NoSolution)
    }

    /// The tiers above the solutions from index `begun` on.
    fn climb_tiers(&mut self, mut begun: usize) -> Ended {
        for tier in 1..=self.options.tiers_max {
            let tier_before = begun..self.solutions.len();
            begun = tier_before.end;
            if let Some(ended) = self.explore_tier(tier_before, tier) {
                return ended;
            }
            if self.solutions.len() == begun {
                return Ended::NothingNew { tier };
            }
        }
        Ended::TiersExhausted {
            limit: self.options.tiers_max,
        }
    }

    /// Whether a solution is good enough, against the best so far, to lead anywhere.
    fn worth_exploring(&self, index: usize) -> bool {
        let best = (self.solutions.iter())
            .map(|s| s.local.value)
            .fold(f64::INFINITY, f64::min);
        self.solutions[index].local.value <= self.options.worth_exploring_below(best)
    }

    /// Explores every direction of the solutions `indices`. Returns a reason to end, if there is
    /// one.
    fn explore_tier(&mut self, mut indices: Range<usize>, tier: usize) -> Option<Ended> {
        let mut waiting = VecDeque::new();
        loop {
            while waiting.len() < SIDE_BY_SIDE {
                let Some(index) = indices.next() else { break };
                if self.worth_exploring(index) {
                    let found = &self.solutions[index];
                    let directions = self.form.directions(&found.local);
                    let task = |(number, direction)| Task {
                        from: found.id,
                        local: found.local.clone(),
                        number,
                        direction,
                    };
                    waiting.extend((1..).zip(directions).map(task));
                }
            }
            if waiting.is_empty() {
                return None;
            }
            let ended = self.interruption();
            if ended.is_some() {
                return ended;
            }
            // Tiers that climb along a row of minima without end would leave nothing for these.
            if self.cost.evaluations() >= self.options.evaluations_max / 2
                && let Some(ended) = self.settle_more()
            {
                return Some(ended);
            }
            let some: Vec<Task> = waiting.drain(..waiting.len().min(SIDE_BY_SIDE)).collect();
            self.follow_side_by_side(some, tier);
        }
    }

    fn follow_side_by_side(&mut self, tasks: Vec<Task>, tier: usize) {
        let (form, known) = (self.form, self.known());
        let followed = form.follow(&tasks, &known);
        for (task, followed) in tasks.into_iter().zip(followed) {
            self.cost += followed.cost;
            // A direction that was cut short has no outcome to record.
            if !followed.complete {
                continue;
            }
            let exit_distance = followed.path.exit_distance();
            let origin = (task.from, task.number);
            let outcome = self.outcome(followed.path.end, followed.reached, tier, origin);
            self.directions.push(DirectionRecord {
                from: task.from,
                direction: task.number,
                label: task.direction.label,
                exit_distance,
                exit_point: followed.exit_point,
                outcome,
                profile: followed.path.profile,
            });
        }
    }

    fn known(&self) -> Known {
        let mut solutions = self.solutions.iter().map(|found| &found.local);
        self.form.known(&mut solutions)
    }

    fn outcome(
        &mut self,
        end: PathEnd,
        reached: Option<Reached>,
        tier: usize,
        origin: (usize, usize),
    ) -> DirectionOutcome {
        match (end, reached) {
            (PathEnd::Exit { .. }, Some(reached)) => self.admit(reached, tier, Some(origin)),
            (PathEnd::Exit { .. }, None) => DirectionOutcome::LocalSolverInfeasible,
            (
                PathEnd::NoExit {
                    at_distance,
                    diverged,
                },
                _,
            ) => DirectionOutcome::NoExitPoint {
                at_distance,
                diverged,
            },
        }
    }

    /// Adds a solution unless it is known (step 7).
    fn admit(
        &mut self,
        reached: Reached,
        tier: usize,
        origin: Option<(usize, usize)>,
    ) -> DirectionOutcome {
        let local = match reached {
            Reached::Known(index) => {
                return DirectionOutcome::KnownSolution(self.solutions[index].id);
            }
            Reached::Solution(local) => local,
        };
        if let Some(known) = self
            .solutions
            .iter_mut()
            .find(|known| (self.same)(&known.local, &local))
        {
            if local.value < known.local.value {
                known.local = local;
            }
            return DirectionOutcome::KnownSolution(known.id);
        }
        let id = self.solutions.len() + 1;
        self.solutions.push(FoundSolution {
            id,
            tier,
            found_from: origin.map(|(from, _)| from),
            direction: origin.map(|(_, direction)| direction),
            local,
        });
        DirectionOutcome::NewSolution(id)
    }

    fn interruption(&self) -> Option<Ended> {
        let (evaluations, limit) = (self.cost.evaluations(), self.options.evaluations_max);
        if (self.cancel)() {
            Some(Ended::Cancelled)
        } else if evaluations >= limit {
            Some(Ended::EvaluationsExhausted { evaluations, limit })
        } else {
            None
        }
    }
}
