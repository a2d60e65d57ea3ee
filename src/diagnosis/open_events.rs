//! Gating events that neither a structure nor the next one foretells, and that the next one follows.
//!
//! An event that the structure at the start follows and does not foretell is fitted from the beginning (decision 0066). Where
//! it takes what is missing to follow one, that shows when the step is tried, which such an event would refuse although it
//! says nothing of what is added: whether the motor recovers in it, the other events leave open.

use super::{
    anew::Stop,
    case::Case,
    event_sets::{Changes, LetBeFitted, not_foretold},
    options::EventSplit,
};
use crate::identification::{IdentificationError, composed::Baseline};

impl Case<'_> {
    /// That no gating event is open with and without an effect, which leads from one structure to another. Not asked where
    /// the events were named, nor where no others are quoted.
    pub(super) fn none_is_open(
        &self,
        before: &Baseline,
        after: &Baseline,
        effect: &str,
    ) -> Result<(), Stop> {
        let is_quoted_elsewhere = !self.untouched.is_empty();
        if self.options.split != EventSplit::Balanced || !is_quoted_elsewhere || !self.has_gate() {
            return Ok(());
        }
        let fitted = self.per_row(&after.all);
        let foretold = |of: &Baseline| -> Result<Vec<Option<f64>>, IdentificationError> {
            let fit = self.narrowed_without_gate(&of.all)?;
            Ok(self.foretold(&fit, &self.gates))
        };
        let (without, with) = (foretold(before)?, foretold(after)?);
        let let_be_fitted = open(&without, &with, &fitted)
            .into_iter()
            .map(|place| {
                let of = |foretold: &[Option<f64>]| foretold[place].unwrap_or(f64::INFINITY);
                LetBeFitted {
                    event: self.judged[place].id.clone(),
                    reason: format!(
                        "the others leave open how it goes (foretold from them, {:.0} per sample are left of it without {effect} and {:.0} with it, fitted {:.2})",
                        of(&without),
                        of(&with),
                        fitted[place],
                    ),
                }
            })
            .collect();
        self.anew_with(Changes {
            let_be_fitted,
            ..Changes::default()
        })
    }
}

/// The events of which both structures leave far more, where they are foretold, than the second leaves where it is fitted
/// to them ([`not_foretold`]).
fn open(without: &[Option<f64>], with: &[Option<f64>], fitted: &[f64]) -> Vec<usize> {
    let [without, with] = [without, with].map(|foretold| not_foretold(foretold, fitted));
    (0..fitted.len())
        .filter(|&place| without[place] && with[place])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::open;

    #[test]
    fn an_event_is_open_that_neither_structure_foretells_and_the_second_follows() {
        let without = [None, Some(6_000.0), Some(3.0), Some(2.0)];
        let with = [None, Some(70_000.0), Some(0.3), Some(0.3)];
        let fitted = [0.3, 0.4, 0.3, 0.3];
        assert_eq!(open(&without, &with, &fitted), [1]);
        // The structure foretells it, or the next one does, or does not follow it either.
        let foreseen = [None, Some(4.0), Some(3.0), Some(2.0)];
        assert!(open(&foreseen, &with, &fitted).is_empty());
        assert!(open(&without, &foreseen, &fitted).is_empty());
        assert!(open(&without, &with, &[0.3, 5_000.0, 0.3, 0.3]).is_empty());
        // Without it the gate is left with nothing.
        let alone = [None, Some(6_000.0), None, None];
        assert!(open(&alone, &alone, &fitted).is_empty());
    }
}
