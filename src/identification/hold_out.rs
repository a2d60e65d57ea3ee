//! Which events are held out: the same whatever the order or the time of arrival, and balanced
//! over depth so that both sides see deep and shallow events.

/// Splits events into fitted and held out. `events` are `(identifier, lowest voltage)`; returns the
/// indices held out, ascending.
///
/// The events are sorted by depth and cut into groups of about `1 / share`; of each group, the one
/// whose identifier has the smallest hash is held out. Of two events one is held out, of one none.
#[must_use]
pub fn held_out(events: &[(&str, f64)], share: f64) -> Vec<usize> {
    if events.len() < 2 || share.is_nan() || share <= 0.0 {
        return Vec::new();
    }
    let mut order: Vec<usize> = (0..events.len()).collect();
    order.sort_by(|&a, &b| {
        events[a]
            .1
            .total_cmp(&events[b].1)
            .then_with(|| events[a].0.cmp(events[b].0))
    });
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the quotient is a small positive number"
    )]
    let groups = ((events.len() as f64 * share).round() as usize).clamp(1, events.len() - 1);
    let mut chosen: Vec<usize> = (0..groups)
        .filter_map(|g| {
            let from = g * events.len() / groups;
            let to = (g + 1) * events.len() / groups;
            order[from..to]
                .iter()
                .copied()
                .min_by_key(|&i| stable_hash(events[i].0))
        })
        .collect();
    chosen.sort_unstable();
    chosen
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
    fn one_event_is_never_held_out_and_of_two_one_is() {
        assert!(held_out(&[("a", 0.5)], 0.33).is_empty());
        assert_eq!(held_out(&[("a", 0.5), ("b", 0.9)], 0.33).len(), 1);
    }
}
