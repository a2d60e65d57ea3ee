//! Where a profile crosses a level.

use super::{End, Limit, Path, constrained::Found};

/// Solves at the interpolated crossing at most this often.
const REFINEMENTS: usize = 4;
/// A crossing is found when the signed root is met this well: a hundredth of a standard error.
const ROOT_TOLERANCE: f64 = 0.01;

impl Path<'_> {
    /// The first value on one side at which the signed root reaches `level`.
    pub(super) fn limit(&mut self, sign: f64, level: f64, end: End) -> Limit {
        let Some((mut inside, mut outside)) = self.bracket(sign, level) else {
            let furthest = self
                .on_side(sign)
                .last()
                .map_or(self.found[0].value, |f| f.value);
            return if end == End::Bound {
                Limit::Bound(furthest)
            } else {
                Limit::Open(furthest)
            };
        };
        for _ in 0..REFINEMENTS {
            let at = self.crossing(&inside, &outside, level);
            let near = if (at - inside.value).abs() < (at - outside.value).abs() {
                &inside
            } else {
                &outside
            };
            let Some(found) = self.constrained.solve(near, at) else {
                break;
            };
            let miss = self.root(&found) - level;
            self.found.push(found.clone());
            (self.progress)(self.found.len());
            if miss < 0.0 {
                inside = found;
            } else {
                outside = found;
            }
            if miss.abs() < ROOT_TOLERANCE {
                break;
            }
        }
        Limit::Reached(self.crossing(&inside, &outside, level))
    }

    /// Points of one side, the nearest to the estimate first.
    fn on_side(&self, sign: f64) -> Vec<Found> {
        let estimate = self.found[0].value;
        let mut side: Vec<Found> = (self.found.iter())
            .filter(|f| sign * (f.value - estimate) > 0.0)
            .cloned()
            .collect();
        side.sort_by(|a, b| (sign * a.value).total_cmp(&(sign * b.value)));
        side
    }

    fn bracket(&self, sign: f64, level: f64) -> Option<(Found, Found)> {
        let mut inside = self.found[0].clone();
        for found in self.on_side(sign) {
            if self.root(&found) >= level {
                return Some((inside, found));
            }
            inside = found;
        }
        None
    }

    /// Linear in the signed root, which is straight where the problem is linear.
    fn crossing(&self, inside: &Found, outside: &Found, level: f64) -> f64 {
        let (low, high) = (self.root(inside), self.root(outside));
        let share = if high > low {
            ((level - low) / (high - low)).clamp(0.0, 1.0)
        } else {
            0.5
        };
        inside.value + share * (outside.value - inside.value)
    }
}
