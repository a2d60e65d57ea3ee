//! Instants of jumps and model, estimated in turns that learn from one another.
//!
//! A turn fits the model at some instants and finds the instants that explain P and Q best at this model. Alone, turns
//! close in by a seventh each, as a later jump looks much like a motor of another loading: all instants move together,
//! ever less. What the last turns moved tells where they lead (Anderson's mixing: D. G. Anderson, J. ACM 12 (1965),
//! 547-560; the form of H. F. Walker, P. Ni, SIAM J. Numer. Anal. 49 (2011), 1715-1735).

use std::collections::VecDeque;

use nalgebra::{DMatrix, DVector};

/// Turns whose moves are taken into account. Chosen: one direction is slow; more cost nothing.
const REMEMBERED: usize = 4;
/// Singular values below this share of the largest say nothing.
const SINGULAR: f64 = 1e-6;
/// Decrease of the objective, relative, that is not worth another turn ...
const SMALL_GAIN: f64 = 0.01;
/// ... once no instant moves by more than this, samples: kappa is then within some 0.2 % of where the turns lead.
const SMALL_MOVE: f64 = 5e-4;

/// A turn: the instants at which the model was fitted and those that explain P and Q best at that model, samples.
#[derive(Clone, Debug)]
struct Turn {
    from: DVector<f64>,
    to: DVector<f64>,
}

impl Turn {
    fn moved(&self) -> DVector<f64> {
        &self.to - &self.from
    }
}

/// The turns so far.
#[derive(Clone, Debug, Default)]
pub(super) struct Turns {
    recent: VecDeque<Turn>,
    lowest: Option<(f64, Turn)>,
}

/// What follows from a turn.
#[derive(Clone, Debug)]
pub(super) struct Next {
    /// Whether another turn would change next to nothing.
    pub(super) settled: bool,
    /// Where to fit next.
    pub(super) instants: Vec<f64>,
}

impl Turns {
    /// Takes note of a turn: the objective at the instants `from`, and the instants `to` that its model prefers.
    pub(super) fn next(&mut self, objective: f64, from: &[f64], to: &[f64]) -> Next {
        let turn = Turn {
            from: DVector::from_column_slice(from),
            to: DVector::from_column_slice(to),
        };
        let still = turn.moved().amax() <= SMALL_MOVE;
        if let Some((lowest, at)) = &self.lowest
            && objective > *lowest
        {
            // What was learnt led astray: on from the best turn, by a plain step.
            let instants = at.to.as_slice().to_vec();
            self.recent.clear();
            return Next {
                settled: still,
                instants,
            };
        }
        let small = |(before, _): &(f64, Turn)| before - objective <= SMALL_GAIN * before;
        let settled = still && self.lowest.as_ref().is_some_and(small);
        self.lowest = Some((objective, turn.clone()));
        self.recent.push_back(turn);
        if self.recent.len() > REMEMBERED {
            self.recent.pop_front();
        }
        Next {
            settled,
            instants: self.mixed().as_slice().to_vec(),
        }
    }

    /// The combination of the last turns' ends whose moves, combined alike, cancel best.
    fn mixed(&self) -> DVector<f64> {
        let Some(last) = self.recent.back() else {
            return DVector::zeros(0);
        };
        let moves: Vec<_> = self.recent.iter().map(Turn::moved).collect();
        let pairs = moves.windows(2).map(|pair| &pair[1] - &pair[0]);
        let changes: Vec<DVector<f64>> = pairs.collect();
        if changes.is_empty() || last.to.is_empty() {
            return last.to.clone();
        }
        let svd = DMatrix::from_columns(&changes).svd(true, true);
        let floor = SINGULAR * svd.singular_values.amax();
        let Ok(weights) = svd.solve(&last.moved(), floor.max(f64::MIN_POSITIVE)) else {
            return last.to.clone();
        };
        let turns = self.recent.iter().zip(self.recent.iter().skip(1));
        let ends = turns.zip(weights.iter());
        ends.fold(last.to.clone(), |sum, ((before, after), weight)| {
            sum - (&after.to - &before.to) * *weight
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Turns that close in by a seventh in one direction and at once in the others.
    fn prefers(at: &[f64]) -> Vec<f64> {
        let (goal, slow) = ([0.3, 0.6, 0.45], [0.5, 0.6, 0.62]);
        let along: f64 = (0..3).map(|i| (at[i] - goal[i]) * slow[i]).sum();
        (0..3)
            .map(|i| goal[i] + 6.0 / 7.0 * along * slow[i] + 0.02 * along * along)
            .collect()
    }

    #[test]
    fn a_slow_direction_takes_a_handful_of_turns() {
        let (mut turns, mut at) = (Turns::default(), vec![0.5; 3]);
        let distance = |at: &[f64]| {
            let to = prefers(at);
            (0..3).map(|i| (to[i] - at[i]).powi(2)).sum::<f64>()
        };
        let mut count = 0;
        loop {
            let next = turns.next(1.0 + 1e3 * distance(&at), &at, &prefers(&at));
            if next.settled {
                break;
            }
            at = next.instants;
            count += 1;
            assert!(count < 8, "{at:?}");
        }
        for (at, goal) in at.iter().zip([0.3, 0.6, 0.45]) {
            assert!((at - goal).abs() < 3e-3, "{at} {goal}");
        }
    }

    #[test]
    fn a_turn_that_raises_the_objective_is_left_by_a_plain_step_from_the_best() {
        let mut turns = Turns::default();
        turns.next(10.0, &[0.5], &[0.6]);
        turns.next(5.0, &[0.6], &[0.65]);
        let next = turns.next(7.0, &[0.9], &[0.8]);
        assert!(!next.settled);
        assert_eq!(next.instants, [0.65]);
    }
}
