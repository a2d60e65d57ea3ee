//! Which events are held out: the same whatever the order or the time of arrival, balanced over
//! depth so that both sides see deep and shallow events, and leaving no wide gap to the fit.

/// Splits events into fitted and held out. `events` are `(identifier, lowest voltage)`, voltages as
/// shares of those before the events; returns the indices held out, ascending.
///
/// Of two events one is held out, of one none; the others as [`by_kind`] and [`inner_events`] say.
#[must_use]
pub fn held_out(events: &[(&str, f64)], share: f64) -> Vec<usize> {
    if share.is_nan() || share <= 0.0 {
        return Vec::new();
    }
    let mut chosen = Vec::new();
    for kind in by_kind(events) {
        if kind.len() < 2 {
            continue;
        }
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "the quotient is a small positive number"
        )]
        let count = ((kind.len() as f64 * share).round() as usize).clamp(1, kind.len() - 1);
        let of: Vec<(&str, f64)> = kind.iter().map(|&event| events[event]).collect();
        chosen.extend(
            inner_events(&of, count)
                .into_iter()
                .map(|place| kind[place]),
        );
    }
    chosen.sort_unstable();
    chosen
}

/// The events with a dip, and those without one, which show the frequency or a swell: indices.
///
/// Each kind is split by itself. Together those without a dip, side by side in depth, would be held
/// out first, and the more of them there are the fewer dips. A dip and one without: both together.
#[must_use]
pub fn by_kind(events: &[(&str, f64)]) -> Vec<Vec<usize>> {
    let (still, dips): (Vec<usize>, Vec<usize>) =
        (0..events.len()).partition(|&event| events[event].1 >= STILL_FROM);
    if dips.len() < 2 && still.len() < 2 {
        return vec![(0..events.len()).collect()];
    }
    vec![dips, still]
}

/// Lowest voltage, as a share of that before the event, from which there was no dip: what `screening` takes for too
/// shallow by default.
const STILL_FROM: f64 = 0.992;

/// As many of the events as asked for, deep ones first: `(identifier, lowest voltage)` to indices.
///
/// What happens only in the deepest event, or between two depths far apart, cannot be learnt from
/// other events: those are left to the fit. Of the events sorted by depth (equal ones by the hash of
/// their identifiers) those go whose neighbours are nearest, so that the sum of the gaps that they
/// leave is least. The deepest stays, so do both neighbours of one that goes, and of half again as
/// many events in a row as there are for one that goes at least one goes: both sides see every depth. The
/// idea is that of Kennard and Stone, Technometrics 11 (1969) 137-148: calibrate on a set that
/// fills the space, test inside it.
///
/// At most one fewer than there are events; beyond half of them neighbours go together.
#[must_use]
pub fn inner_events(events: &[(&str, f64)], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..events.len()).collect();
    order.sort_by(|&a, &b| {
        let deeper = events[a].1.total_cmp(&events[b].1);
        let by_hash = || stable_hash(events[a].0).cmp(&stable_hash(events[b].0));
        deeper
            .then_with(by_hash)
            .then_with(|| events[a].0.cmp(events[b].0))
    });
    let count = count.min(events.len().saturating_sub(1));
    if count == 0 {
        return Vec::new();
    }
    let depths: Vec<f64> = order.iter().map(|&i| events[i].1).collect();
    let farthest = (3 * events.len()).div_ceil(2 * count);
    let places = narrowest_gaps(&depths, count, [2, farthest])
        .or_else(|| narrowest_gaps(&depths, count, [1, farthest]))
        .unwrap_or_else(|| (depths.len() - count..depths.len()).collect());
    places.into_iter().map(|place| order[place]).collect()
}

/// The `count` places of the ascending `depths`, not the first, that leave the least sum of gaps,
/// with distances of places (and to either end) within `spacing`; none where that cannot be.
fn narrowest_gaps(depths: &[f64], count: usize, spacing: [usize; 2]) -> Option<Vec<usize>> {
    let n = depths.len();
    // The mildest event has no neighbour above: it counts as far away as the one below.
    let gap = |place: usize| match depths.get(place + 1) {
        Some(above) => above - depths[place - 1],
        None => 2.0 * (depths[place] - depths[place - 1]),
    };
    // Least sum with the place as the last of as many as the row's number, and the place before it.
    let mut rows: Vec<Vec<Option<(f64, usize)>>> = Vec::with_capacity(count);
    for taken in 0..count {
        let row = (0..n).map(|place| {
            if place == 0 {
                return None;
            }
            if taken == 0 {
                return (place <= spacing[1]).then(|| (gap(place), 0));
            }
            let before = place.saturating_sub(spacing[1])..=place.saturating_sub(spacing[0]);
            before
                .filter_map(|b| rows[taken - 1][b].map(|(sum, _)| (sum + gap(place), b)))
                .min_by(|x, y| x.0.total_cmp(&y.0))
        });
        let row = row.collect();
        rows.push(row);
    }
    let last = (n.saturating_sub(spacing[1])..n)
        .filter(|&place| rows[count - 1][place].is_some())
        .min_by(|&a, &b| {
            let sum = |place: usize| rows[count - 1][place].map_or(f64::INFINITY, |(sum, _)| sum);
            sum(a).total_cmp(&sum(b))
        })?;
    let mut places = vec![last];
    for row in rows.iter().skip(1).rev() {
        let (_, before) = row[*places.last()?]?;
        places.push(before);
    }
    places.reverse();
    Some(places)
}

/// How far apart the neighbours of an event in depth are, or twice the one that there is.
#[must_use]
pub fn distance(events: &[(&str, f64)], event: usize) -> f64 {
    let own = events[event].1;
    let apart = |other: usize| (events[other].1 - own).abs();
    match neighbours(events, event).map(|other| other.map(apart)) {
        [Some(below), Some(above)] => below + above,
        [Some(one), None] | [None, Some(one)] => 2.0 * one,
        [None, None] => f64::INFINITY,
    }
}

/// The next deeper and the next milder event, where there are.
#[must_use]
pub fn neighbours(events: &[(&str, f64)], event: usize) -> [Option<usize>; 2] {
    let own = events[event].1;
    let by_depth = |a: &usize, b: &usize| events[*a].1.total_cmp(&events[*b].1);
    let others = || (0..events.len()).filter(|other| *other != event);
    [
        others().filter(|o| events[*o].1 <= own).max_by(by_depth),
        others().filter(|o| events[*o].1 > own).min_by(by_depth),
    ]
}

/// FNV-1a, 64 bits: the same on every machine and in every version of the program.
#[must_use]
pub fn stable_hash(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_the_published_one() {
        // Test vectors of the FNV authors: "" and "a".
        assert_eq!(stable_hash(""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(stable_hash("a"), 0xaf63_dc4c_8601_ec8c);
    }

    #[test]
    fn the_choice_does_not_depend_on_the_order_and_spans_the_depths() {
        let names: Vec<String> = (0..12).map(|i| format!("event_{i:02}")).collect();
        let events: Vec<(&str, f64)> = names
            .iter()
            .zip(0..)
            .map(|(n, i)| (n.as_str(), 0.4 + 0.05 * f64::from(i)))
            .collect();
        let forward: Vec<&str> = held_out(&events, 0.33)
            .iter()
            .map(|&i| events[i].0)
            .collect();
        let reversed: Vec<(&str, f64)> = events.iter().rev().copied().collect();
        let mut backward: Vec<&str> = held_out(&reversed, 0.33)
            .iter()
            .map(|&i| reversed[i].0)
            .collect();
        backward.sort_unstable();
        assert_eq!(forward, backward);
        assert_eq!(forward.len(), 4);
        let deep = forward.iter().filter(|n| **n < "event_06").count();
        assert_eq!(deep, 2);
    }

    #[test]
    fn the_fit_keeps_the_deepest_event_and_those_that_stand_alone() {
        let depths = [0.40, 0.42, 0.43, 0.60, 0.75, 0.76, 0.78, 0.92, 0.94];
        let names: Vec<String> = (0..depths.len()).map(|i| format!("event_{i}")).collect();
        let events: Vec<(&str, f64)> = names.iter().map(String::as_str).zip(depths).collect();
        let chosen: Vec<f64> = inner_events(&events, 3)
            .iter()
            .map(|&i| depths[i])
            .collect();
        assert_eq!(chosen, [0.42, 0.76, 0.94]);
        for count in 1..9 {
            let chosen = inner_events(&events, count);
            assert_eq!(chosen.len(), count);
            assert!(!chosen.contains(&0));
        }
        assert_eq!(inner_events(&events, 20).len(), 8);
        assert!(inner_events(&[], 1).is_empty());
    }

    #[test]
    fn events_without_a_dip_change_nothing_of_which_dips_are_held_out() {
        let held_of = |depths: &[f64]| {
            let names: Vec<String> = (0..depths.len()).map(|i| format!("event_{i}")).collect();
            let events: Vec<(&str, f64)> = (names.iter().map(String::as_str))
                .zip(depths.iter().copied())
                .collect();
            held_out(&events, 0.33)
        };
        let dips = [0.5, 0.6, 0.7, 0.8, 0.85, 0.95];
        let held = held_of(&dips);
        assert_eq!(held.len(), 2);
        for still in [[0.993].as_slice(), &[0.993, 0.9999, 0.998], &[0.9995; 9]] {
            let of_mixed = held_of(&[&dips, still].concat());
            assert_eq!(of_mixed[..2], held);
            assert_eq!(of_mixed.len(), 2 + still.len() / 3);
        }
        assert_eq!(held_of(&[0.5, 0.999]), [1]);
        assert_eq!(held_of(&[0.999, 0.6, 0.5]), [1]);
        assert_eq!(held_of(&[0.998, 0.999]), [1]);
    }

    #[test]
    fn many_shallow_events_do_not_keep_the_deep_ones_from_being_tested() {
        let deep = (0..8).map(|i| 0.3 + 0.07 * f64::from(i));
        let depths: Vec<f64> = deep
            .chain((0..32).map(|i| 0.9 + 0.003 * f64::from(i)))
            .collect();
        let names: Vec<String> = (0..depths.len()).map(|i| format!("event_{i:02}")).collect();
        let events: Vec<(&str, f64)> = names.iter().map(String::as_str).zip(depths).collect();
        let chosen = inner_events(&events, 13);
        assert!(chosen.iter().any(|&i| i < 8));
        // 40 events, 13 of them: at most five places apart, and never neighbours.
        assert!(chosen.windows(2).all(|w| (2..=5).contains(&(w[1] - w[0]))));
    }

    #[test]
    fn neighbours_are_the_next_in_depth() {
        let events = [("a", 0.5), ("b", 0.6), ("c", 0.7), ("d", 0.6)];
        assert_eq!(neighbours(&events, 1), [Some(3), Some(2)]);
        assert_eq!(neighbours(&events, 0), [None, Some(1)]);
        assert!((distance(&events, 2) - 0.2).abs() < 1e-12);
        assert!(distance(&events[..1], 0).is_infinite());
    }

    #[test]
    fn one_event_is_never_held_out_and_of_two_one_is() {
        assert!(held_out(&[("a", 0.5)], 0.33).is_empty());
        assert_eq!(held_out(&[("a", 0.5), ("b", 0.9)], 0.33).len(), 1);
    }
}
