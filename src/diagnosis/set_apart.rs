//! Events that no effect of the catalogue explains, where one explains all others.
//!
//! Where a motor comes to the edge of stall, a hundredth of its torque and a thousandth of a second decide what it does
//! next, and the right model may not follow the event. Being fitted to it, models give up the constants that all other
//! events show, each to another degree, and something else is named or nothing. Such an event is set apart, and said to be.
//! Not where a second effect may be all that is missing in it: one that explains it by itself speaks against that.

use super::{
    anew::Stop,
    case::Case,
    claim::reached_below,
    event_sets::{Apart, Changes},
    evidence::is_adequate,
    options::{ClaimOptions, EventSplit},
    trials::{Fitted, Trial},
};
use crate::identification::intake::PreparedEvent;

/// At most this share of the events is set apart.
const SHARE_MAX: f64 = 0.25;
/// An effect explains an event of which it leaves less than this share of what was above the floor, ...
const LEFT_SHARE: f64 = 0.35;
/// ... or less than this many times the floor.
const LEFT_FLOORS: f64 = 4.0;

/// What is left of each event, weighted squares per row.
type PerEvent = Vec<f64>;

/// An event that may be set apart: its place, and the least that any effect leaves of it.
type Unexplained = (usize, f64);

/// The events that no effect explains.
fn unexplained(before: &[f64], with: &[PerEvent], options: &ClaimOptions) -> Vec<Unexplained> {
    let excess = |left: f64| (left - options.floor).max(0.0);
    let least = |event: usize| {
        with.iter()
            .map(|left| left[event])
            .fold(f64::INFINITY, f64::min)
    };
    let all = (0..before.len()).map(|event| (event, least(event)));
    all.filter(|&(event, least)| {
        least.is_finite()
            && least >= LEFT_FLOORS * options.floor
            && excess(least) >= LEFT_SHARE * excess(before[event])
    })
    .collect()
}

/// What is left per row of all but some events.
fn of_others(left: &[f64], rows: &[usize], apart: &[Unexplained]) -> f64 {
    let is_apart = |event: &usize| apart.iter().any(|(own, _)| own == event);
    let others = || (0..left.len()).filter(|event| !is_apart(event));
    let squares: f64 = others().map(|event| left[event] * rows[event] as f64).sum();
    squares / others().map(|event| rows[event]).sum::<usize>().max(1) as f64
}

/// Events to be set apart, and what is left per row of the others with the effect that explains them best; none where no
/// event stands in the way of a name.
fn standing_apart(
    before: &[f64],
    with: &[PerEvent],
    rows: &[usize],
    options: &ClaimOptions,
) -> Option<(Vec<Unexplained>, f64)> {
    let apart = unexplained(before, with, options);
    if apart.is_empty() || apart.len() as f64 > SHARE_MAX * before.len() as f64 {
        return None;
    }
    let left = with.iter().map(|left| of_others(left, rows, &apart));
    let least = left.min_by(f64::total_cmp)?;
    let missing = of_others(before, rows, &apart);
    let explained = !is_adequate(missing, options) && least < reached_below(missing, options);
    explained.then_some((apart, least))
}

impl Case<'_> {
    /// That no event has to be set apart.
    pub(super) fn none_apart(&self, base: &Fitted, list: &[Trial]) -> Result<(), Stop> {
        if self.options.split != EventSplit::Balanced || !self.changes.apart.is_empty() {
            return Ok(());
        }
        let before = self.per_row(&base.baseline.all);
        let fits = list.iter().filter_map(|trial| trial.fit.as_ref());
        let with: Vec<PerEvent> = fits.map(|fit| self.per_row(fit)).collect();
        let rows: Vec<usize> = self.judged.iter().map(PreparedEvent::rows).collect();
        let found = standing_apart(&before, &with, &rows, &self.options.claim);
        let Some((apart, left)) = found else {
            return Ok(());
        };
        let apart = apart.into_iter().map(|(event, least)| Apart {
            event: self.judged[event].id.clone(),
            reason: format!(
                "of its {:.1} per sample every effect of the catalogue leaves {least:.1} or more, where one leaves {left:.2} of all others",
                before[event]
            ),
        });
        self.anew_with(Changes {
            apart: apart.collect(),
            ..Changes::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_that_nothing_explains_stands_apart_where_the_others_are_explained() {
        let options = ClaimOptions::default();
        let rows = [100; 5];
        let found = |before: [f64; 5], with: &[[f64; 5]]| {
            let with: Vec<PerEvent> = with.iter().map(|left| left.to_vec()).collect();
            standing_apart(&before, &with, &rows, &options)
        };
        let before = [12.9, 5.3, 16.1, 1.2, 1.6];
        let right = [7.7, 0.6, 0.8, 0.3, 0.4];
        let other = [8.6, 1.8, 3.3, 0.4, 1.0];
        let (apart, left) = found(before, &[other, right]).expect("the first stands apart");
        assert_eq!(apart, [(0, 7.7)]);
        assert!((left - 0.525).abs() < 1e-12);
        // Another effect explains it, two events are too many, or the others are followed without any, or with none.
        assert!(found(before, &[[1.0, 5.0, 16.0, 1.2, 1.6], right]).is_none());
        assert!(found(before, &[[7.7, 4.0, 0.8, 0.3, 0.4]]).is_none());
        assert!(found([12.9, 0.6, 0.9, 0.5, 0.6], &[right]).is_none());
        assert!(found(before, &[[8.6, 2.7, 4.9, 0.6, 1.2]]).is_none());
    }
}
