//! Counts of dips that a search tries, as the events have them.

use super::screening::{Step, with};
use crate::{identification::intake::PreparedEvent, load_model::effect::Parameter};

/// Voltages, shares of V0, whose crossings are counted: at which of them a relay looks is not known.
const LEVELS: [f64; 7] = [0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4];
/// A dip has ended when the voltage is above the level by this, share of V0.
const RETURN: f64 = 0.02;

impl Step<'_> {
    /// The points of a grid with every count that some event reaches, the fewest first. As it is for effects that count no
    /// dips.
    pub(super) fn with_counts(&self, grid: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        let Some(name) = self.effect.counts_dips() else {
            return grid;
        };
        let own = self.own(Parameter::is_shape);
        let declared = |index: usize| self.model.parameters()[index].declaration;
        let Some(place) = own.iter().position(|&index| declared(index).name == name) else {
            return grid;
        };
        let declared = declared(own[place]);
        let most = self.rows.iter().map(|rows| dips(rows.event())).max();
        let most = (most.unwrap_or(0) as f64).clamp(declared.lower, declared.upper);
        let counts = std::iter::successors(Some(declared.lower), |count| Some(count + 1.0));
        let of = |count: f64| grid.iter().map(move |point| with(point, place, count));
        counts
            .take_while(|count| *count <= most)
            .flat_map(of)
            .collect()
    }
}

/// How often the voltage of an event falls below a level and returns, or stays: at the level at which that is most often.
#[must_use]
pub fn dips(event: &PreparedEvent) -> usize {
    let at = |level: f64| {
        let (mut count, mut low) = (0, false);
        for voltage in &event.voltage {
            if !low && *voltage < level {
                (count, low) = (count + 1, true);
            } else if *voltage > level + RETURN {
                low = false;
            }
        }
        count
    };
    LEVELS.into_iter().map(at).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::dips;
    use crate::identification::composed::tests::events;

    #[test]
    fn dips_are_counted_at_the_level_that_tells_most_of_them_apart() {
        let mut event = events().remove(0);
        let count = event.voltage.len();
        event.voltage.fill(1.0);
        assert_eq!(dips(&event), 0);
        let tenth = count / 10;
        event.voltage[tenth..2 * tenth].fill(0.5);
        assert_eq!(dips(&event), 1);
        // Between two dips the voltage need not come back to where it was, and noise at a level is no dip.
        event.voltage[2 * tenth..3 * tenth].fill(0.87);
        event.voltage[3 * tenth..4 * tenth].fill(0.65);
        for (k, voltage) in event.voltage[5 * tenth..].iter_mut().enumerate() {
            *voltage = if k % 2 == 0 { 0.895 } else { 0.905 };
        }
        assert_eq!(dips(&event), 2);
    }
}
