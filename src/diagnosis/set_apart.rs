//! Events that no effect of the catalogue explains, where one explains all others.
//!
//! Where a motor comes to the edge of stall, a hundredth of its torque and a thousandth of a second decide what it does
//! next, and the right model may not follow the event. Being fitted to it, models give up the constants that all other
//! events show, each to another degree, and something else is named or nothing. Such an event is set apart, and said to be.
//! Not where a second effect may be all that is missing in it: one that explains it by itself speaks against that, and so
//! does load or generation that is gone when the voltage is back (decision 0124).

use super::{
    anew::Stop,
    case::Case,
    claim::reached_below,
    event_sets::{Apart, Changes},
    evidence::is_adequate,
    options::{ClaimOptions, EventSplit},
    trials::{Fitted, Trial},
};
use crate::{
    identification::{
        composed::{ComposedFit, composition_deviations},
        intake::PreparedEvent,
    },
    numerics::statistics::mean,
};

/// At most this share of the events is set apart, all that are taken together.
const SHARE_MAX: f64 = 0.25;
/// An effect explains an event of which it leaves less than this share of what was above the floor, ...
const LEFT_SHARE: f64 = 0.35;
/// ... or less than this many times the floor, ...
pub(super) const LEFT_FLOORS: f64 = 4.0;
/// ... with a composition that is no farther from that of all events, in the deviations that are assumed: a rotor that stands
/// draws what another composition would.
const DEVIATION_MAX: f64 = 6.0;

/// The end of an event, s, ...
const END_S: f64 = 0.5;
/// ... where the voltage is back, to so much of what it was, ...
const BACK: f64 = 0.05;
/// ... and P farther than this from everything between constant power and constant impedance: something was switched.
const ELSEWHERE: f64 = 0.05;

/// What a model leaves of each event.
struct Left {
    /// Weighted squares per row.
    per_row: Vec<f64>,
    /// How far the event's own composition is from that of all.
    deviation: Vec<f64>,
}

/// Why an event may be set apart.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Why {
    /// The least that any effect leaves of it, per row.
    Leaves(f64),
    /// Where what explains it needs a composition of its own: how far that is from the others'.
    OwnComposition(f64),
}

/// Whether `more` events may be set apart beside `apart` others, of which `judged` are left.
const fn has_room(more: usize, apart: usize, judged: usize) -> bool {
    (more + apart) as f64 <= SHARE_MAX * (judged + apart) as f64
}

/// The events that neither the structure itself nor any effect explains.
fn unexplained(base: &Left, with: &[Left], options: &ClaimOptions) -> Vec<(usize, Why)> {
    let excess = |left: f64| (left - options.floor).max(0.0);
    let near = |left: f64| left < LEFT_FLOORS * options.floor;
    let of = |event: usize| {
        let before = base.per_row[event];
        let follows = |left: &&Left| {
            let left = left.per_row[event];
            near(left) || excess(left) < LEFT_SHARE * excess(before)
        };
        let itself = Some(base).filter(|_| near(before));
        let following = itself.into_iter().chain(with.iter().filter(follows));
        let deviations = following.map(|left| left.deviation[event]);
        let deviation = deviations.fold(f64::INFINITY, f64::min);
        let least = with.iter().map(|left| left.per_row[event]);
        let least = least.fold(f64::INFINITY, f64::min);
        let why = if deviation.is_finite() {
            Why::OwnComposition(deviation)
        } else {
            Why::Leaves(least)
        };
        (least.is_finite() && deviation > DEVIATION_MAX).then_some((event, why))
    };
    (0..base.per_row.len()).filter_map(of).collect()
}

/// What is left per row of all but some events.
fn of_others(left: &Left, rows: &[usize], apart: &[(usize, Why)]) -> f64 {
    let is_apart = |event: &usize| apart.iter().any(|(own, _)| own == event);
    let others = || (0..rows.len()).filter(|event| !is_apart(event));
    let squares: f64 = others()
        .map(|event| left.per_row[event] * rows[event] as f64)
        .sum();
    squares / others().map(|event| rows[event]).sum::<usize>().max(1) as f64
}

/// Events to be set apart beside those that are `already`, and what is left per row of the others with the effect that
/// explains them best; none where no event stands in the way of a name.
fn standing_apart(
    base: &Left,
    with: &[Left],
    (rows, already): (&[usize], usize),
    options: &ClaimOptions,
) -> Option<(Vec<(usize, Why)>, f64)> {
    let apart = unexplained(base, with, options);
    if apart.is_empty() || !has_room(apart.len(), already, rows.len()) {
        return None;
    }
    let left = with.iter().map(|left| of_others(left, rows, &apart));
    let least = left.min_by(f64::total_cmp)?;
    let missing = of_others(base, rows, &apart);
    let explained = !is_adequate(missing, options) && least < reached_below(missing, options);
    explained.then_some((apart, least))
}

/// Whether load or generation is gone at the end of an event.
fn ends_elsewhere(event: &PreparedEvent) -> bool {
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "some ten samples"
    )]
    let count = (END_S * event.rate_fps).ceil() as usize;
    let samples = event.voltage.len();
    let begin = samples.saturating_sub(count).max(event.event_start);
    let end: Vec<usize> = (begin..samples).filter(|&k| event.used[k]).collect();
    let of_end = |values: &[f64]| mean(&end.iter().map(|&k| values[k]).collect::<Vec<f64>>());
    let means = [&event.voltage, &event.active, &event.reactive].map(|values| of_end(values));
    let [Some(voltage), Some(active), Some(reactive)] = means else {
        return false;
    };
    is_gone(voltage, active, reactive - event.q0_pu / event.p0_pu)
}

/// Whether means at the end of an event (voltage and P beside those before it, Q over P0 above that) say that something was
/// switched: the voltage is back and P is not. A rotor that stands or speeds up draws more Q than P departs.
fn is_gone(voltage: f64, active: f64, more_reactive: f64) -> bool {
    let impedance = voltage.powi(2);
    let departs = (active - impedance.max(1.0)).max(impedance.min(1.0) - active);
    (voltage - 1.0).abs() < BACK && departs > ELSEWHERE && more_reactive < departs
}

impl Case<'_> {
    /// Whether one more event may be set apart.
    pub(super) fn has_room_apart(&self) -> bool {
        let may_choose = self.options.split == EventSplit::Balanced;
        may_choose && has_room(1, self.changes.apart.len(), self.judged.len())
    }

    /// That no event has to be set apart.
    pub(super) fn none_apart(&self, base: &Fitted, list: &[Trial]) -> Result<(), Stop> {
        if !self.has_room_apart() {
            return Ok(());
        }
        let rows: Vec<usize> = self.judged.iter().map(PreparedEvent::rows).collect();
        let (before, with) = self.left_by(&base.baseline.all, list);
        let rows = (&rows[..], self.changes.apart.len());
        let found = standing_apart(&before, &with, rows, &self.options.claim);
        let Some((apart, left)) = found else {
            return Ok(());
        };
        if (apart.iter()).any(|(event, _)| ends_elsewhere(&self.judged[*event])) {
            return Ok(());
        }
        let apart = apart.into_iter().map(|(event, why)| {
            let why = match why {
                Why::Leaves(least) => format!("leaves {least:.1} or more"),
                Why::OwnComposition(deviation) => format!(
                    "that explains it takes a composition {deviation:.0} times as far from the other events' as is assumed"
                ),
            };
            Apart {
                event: self.judged[event].id.clone(),
                reason: format!(
                    "of its {:.1} per sample every effect of the catalogue {why}, where one leaves {left:.2} of all others",
                    before.per_row[event]
                ),
            }
        });
        self.anew_with(Changes {
            apart: apart.collect(),
            ..Changes::default()
        })
    }

    /// What is left of each event by a fit, and with every effect. Compositions are looked at where the best effect needs one
    /// that is out of the ordinary; one that cannot be had counts as ordinary and sets nothing apart.
    fn left_by(&self, base: &ComposedFit, list: &[Trial]) -> (Left, Vec<Left>) {
        let fits: Vec<&ComposedFit> = (list.iter())
            .filter_map(|trial| trial.fit.as_ref())
            .collect();
        let (scatter, count) = (&self.composed.scatter, self.judged.len());
        let deviations = |fit: &ComposedFit| composition_deviations(&self.judged, fit, scatter);
        let of_best = fits.first().and_then(|fit| deviations(fit));
        let looked_at = of_best.is_some_and(|all| all.iter().any(|d| *d > DEVIATION_MAX));
        let left = |fit: &ComposedFit| Left {
            per_row: self.per_row(fit),
            deviation: (looked_at.then(|| deviations(fit)).flatten())
                .unwrap_or_else(|| vec![0.0; count]),
        };
        let with = fits.into_iter().map(left).collect();
        (left(base), with)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_event_that_nothing_explains_stands_apart_where_the_others_are_explained() {
        let options = ClaimOptions::default();
        let found = |before: [f64; 5], with: &[[f64; 5]]| {
            let with: Vec<Left> = with.iter().map(|left| ordinary(*left)).collect();
            standing_apart(&ordinary(before), &with, (&[100; 5], 0), &options)
        };
        let before = [12.9, 5.3, 16.1, 1.2, 1.6];
        let right = [7.7, 0.6, 0.8, 0.3, 0.4];
        let other = [8.6, 1.8, 3.3, 0.4, 1.0];
        let (apart, left) = found(before, &[other, right]).expect("the first stands apart");
        assert_eq!(apart, [(0, Why::Leaves(7.7))]);
        assert!((left - 0.525).abs() < 1e-12);
        // Another effect explains it, two events are too many, or the others are followed without any, or with none.
        assert!(found(before, &[[1.0, 5.0, 16.0, 1.2, 1.6], right]).is_none());
        assert!(found(before, &[[7.7, 4.0, 0.8, 0.3, 0.4]]).is_none());
        assert!(found([12.9, 0.6, 0.9, 0.5, 0.6], &[right]).is_none());
        assert!(found(before, &[[8.6, 2.7, 4.9, 0.6, 1.2]]).is_none());
    }

    #[test]
    fn a_quarter_of_the_events_is_set_apart_at_most() {
        assert!(has_room(1, 0, 5) && has_room(1, 1, 7) && has_room(2, 0, 8));
        assert!(!has_room(2, 0, 7) && !has_room(1, 1, 6) && !has_room(1, 2, 8));
    }

    #[test]
    fn an_event_that_takes_a_composition_of_its_own_stands_apart() {
        let options = ClaimOptions::default();
        let before = ordinary([5.9, 5.3, 16.1, 1.2, 1.6]);
        let with = |per_row: [f64; 5], first: f64| Left {
            deviation: vec![first, 1.0, 0.5, 0.2, 2.0],
            ..ordinary(per_row)
        };
        let right = |first| with([0.9, 0.6, 0.8, 0.3, 0.4], first);
        let found =
            |before: &Left, with: &[Left]| standing_apart(before, with, (&[100; 5], 0), &options);
        let (apart, left) = found(&before, &[right(9.0)]).expect("the first stands apart");
        assert_eq!(apart, [(0, Why::OwnComposition(9.0))]);
        assert!((left - 0.525).abs() < 1e-12);
        assert!(
            found(&before, &[right(4.0)]).is_none(),
            "as compositions vary"
        );
        // What follows the event with an ordinary composition speaks for it, the structure itself too.
        let other = with([2.0, 5.0, 15.0, 1.2, 1.6], 3.0);
        assert!(found(&before, &[right(9.0), other]).is_none());
        let followed = ordinary([1.9, 5.3, 16.1, 1.2, 1.6]);
        assert!(found(&followed, &[right(9.0)]).is_none());
    }

    #[test]
    fn what_is_switched_is_gone_when_the_voltage_is_back() {
        assert!(is_gone(0.99, 1.3, 0.05), "generation tripped");
        assert!(is_gone(1.01, 0.8, -0.1), "motors with their contactors");
        assert!(!is_gone(0.98, 1.15, 0.9), "a motor stands");
        assert!(!is_gone(0.96, 0.93, -0.05), "an impedance at 0.96 pu");
        assert!(!is_gone(0.9, 0.6, -0.1), "the voltage is not back");
    }

    fn ordinary(per_row: [f64; 5]) -> Left {
        Left {
            per_row: per_row.to_vec(),
            deviation: vec![0.0; 5],
        }
    }
}
