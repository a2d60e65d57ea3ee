//! Where the settings of relays that the frequency switches may lie, as the events show it.

use super::screening::{Step, with};
use crate::identification::intake::PreparedEvent;

/// Settings that are tried on either side.
const LEVELS: usize = 8;
/// One in so many samples may lie beyond what counts as reached: near edges the frequency channel has spikes.
const SPIKES: usize = 50;

impl Step<'_> {
    /// The points of a grid with settings that the frequency of the events reaches, one side after the other, instead of theirs.
    /// As it is for effects that no frequency switches.
    pub(super) fn with_frequency_levels(&self, grid: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        let sides = self.effect.frequency_thresholds();
        if sides.is_empty() {
            return grid;
        }
        let shapes: Vec<_> = self.effect.declaration().shapes().collect();
        let mut points = Vec::new();
        for (name, sign) in sides.iter().zip([-1.0, 1.0]) {
            let Some(place) = shapes.iter().position(|shape| shape.name == *name) else {
                continue;
            };
            let reached = self.rows.iter().map(|rows| reached(rows.event(), sign));
            let reached = reached.fold(0.0, f64::max).min(shapes[place].upper);
            let lower = shapes[place].lower;
            for k in 0..LEVELS {
                // Evenly in the logarithm, the last one short of what is reached.
                let share = (k as f64 + 0.5) / LEVELS as f64;
                let level = lower * (reached / lower).powf(share);
                if level > lower {
                    points.extend(grid.iter().map(|point| with(point, place, level)));
                }
            }
        }
        points
    }
}

/// The largest deviation on one side, pu, that more than a few samples show.
fn reached(event: &PreparedEvent, sign: f64) -> f64 {
    let known = event.frequency_deviation.iter().filter(|df| df.is_finite());
    let mut side: Vec<f64> = known.map(|df| sign * df).collect();
    side.sort_by(|a, b| b.total_cmp(a));
    side.get(side.len() / SPIKES).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identification::composed::tests::events;

    #[test]
    fn a_spike_is_not_reached_and_a_decline_is() {
        let mut event = events().remove(0);
        let count = event.frequency_deviation.len();
        event.frequency_deviation.fill(0.0);
        event.frequency_deviation[10] = -0.02;
        for k in count / 2..count {
            event.frequency_deviation[k] = -0.004;
        }
        assert!((reached(&event, -1.0) - 0.004).abs() < 1e-15);
        assert!(reached(&event, 1.0).abs() < 1e-15);
    }
}
