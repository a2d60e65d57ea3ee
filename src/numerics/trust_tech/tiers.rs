//! The tiers: which directions are explored, in which order, and when it is enough.

use nalgebra::DVector;

use super::{
    DirectionOutcome, DirectionRecord, Ended, FoundSolution, Options, Search,
    directions::Direction,
    exit_point::{ExitSearch, PathEnd},
};
use crate::numerics::{Cost, LocalSolution};

/// What the tiers need to know of a formulation of the problem.
pub(super) trait Form: Sync {
    /// The local solution that a start leads to; none when no feasible point is reached (steps 1
    /// and 2 of section 5).
    fn settle(&self, start: &DVector<f64>) -> (Option<LocalSolution>, Cost);
    /// The directions to be followed from a solution (step 3).
    fn directions(&self, from: &LocalSolution) -> Vec<Direction>;
    /// Follows one of them (steps 4 to 6).
    fn follow(&self, from: &LocalSolution, direction: &Direction) -> Followed;
}

/// Where a direction led.
pub(super) struct Followed {
    pub(super) path: ExitSearch,
    /// The solution beyond the exit point, if there is one and the local solver reached it.
    pub(super) reached: Option<LocalSolution>,
    pub(super) cost: Cost,
}

/// Whether two solutions are one.
type Same<'a> = &'a (dyn Fn(&LocalSolution, &LocalSolution) -> bool + Sync);

/// Explores `form` from `starts`, tier by tier.
pub(super) fn explore(
    form: &dyn Form,
    starts: &[DVector<f64>],
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
    };
    let ended = explorer
        .settle_starts(starts)
        .unwrap_or_else(|| explorer.climb_tiers());
    Search {
        solutions: explorer.solutions,
        directions: explorer.directions,
        cost: explorer.cost,
        ended,
    }
}

struct Explorer<'a> {
    form: &'a dyn Form,
    same: Same<'a>,
    options: &'a Options,
    cancel: &'a (dyn Fn() -> bool + Sync),
    solutions: Vec<FoundSolution>,
    directions: Vec<DirectionRecord>,
    cost: Cost,
}

impl Explorer<'_> {
    /// Tier 0. Returns a reason to end, if there is one already.
    fn settle_starts(&mut self, starts: &[DVector<f64>]) -> Option<Ended> {
        for start in starts {
            if let Some(ended) = self.interruption() {
                return Some(ended);
            }
            let (settled, cost) = self.form.settle(start);
            self.cost += cost;
            if let Some(local) = settled {
                self.admit(local, 0, None);
            }
        }
        self.solutions.is_empty().then_some(Ended::NoSolution)
    }

    fn climb_tiers(&mut self) -> Ended {
        let mut begun = 0;
        for tier in 1..=self.options.tiers_max {
            let tier_before = begun..self.solutions.len();
            begun = tier_before.end;
            for index in tier_before {
                if !self.worth_exploring(index) {
                    continue;
                }
                if let Some(ended) = self.follow_all_from(index, tier) {
                    return ended;
                }
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
        let within = self.options.explore_within;
        within.is_infinite()
            || self.solutions[index].local.value <= best + (within - 1.0) * best.abs()
    }

    /// Explores every direction of one solution. Returns a reason to end, if there is one.
    fn follow_all_from(&mut self, index: usize, tier: usize) -> Option<Ended> {
        let (from, local) = (
            self.solutions[index].id,
            self.solutions[index].local.clone(),
        );
        let directions = self.form.directions(&local);
        for (number, direction) in (1..).zip(directions) {
            if let Some(ended) = self.interruption() {
                return Some(ended);
            }
            let followed = self.form.follow(&local, &direction);
            self.cost += followed.cost;
            // A direction that was cut short has no outcome to record.
            if (self.cancel)() {
                return Some(Ended::Cancelled);
            }
            let exit_distance = followed.path.exit_distance();
            let outcome = self.outcome(followed.path.end, followed.reached, tier, (from, number));
            self.directions.push(DirectionRecord {
                from,
                direction: number,
                label: direction.label,
                exit_distance,
                outcome,
                profile: followed.path.profile,
            });
        }
        None
    }

    fn outcome(
        &mut self,
        end: PathEnd,
        reached: Option<LocalSolution>,
        tier: usize,
        origin: (usize, usize),
    ) -> DirectionOutcome {
        match (end, reached) {
            (PathEnd::Exit { .. }, Some(local)) => self.admit(local, tier, Some(origin)),
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
        local: LocalSolution,
        tier: usize,
        origin: Option<(usize, usize)>,
    ) -> DirectionOutcome {
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
