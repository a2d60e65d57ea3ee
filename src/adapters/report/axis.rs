//! Which samples set the axis of a plot, and how the others are drawn: one rule for reports and
//! pages. A single bad sample would otherwise flatten everything that is to be seen.

use super::number;

/// Which samples set an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::adapters) enum Sets {
    /// Of powers: what the fit uses, and what lies near an edge, which is the event itself.
    Powers,
    /// Of residuals: what the fit uses away from edges. Near them the instrument speaks.
    Residuals,
}

impl Sets {
    /// Whether a sample that the fit uses or not, near an edge or not, sets the axis.
    pub(in crate::adapters) const fn by(self, used: bool, near_edge: bool) -> bool {
        match self {
            Self::Powers => used || near_edge,
            Self::Residuals => used && !near_edge,
        }
    }

    /// Whether each of an event's samples does.
    pub(in crate::adapters) fn each(self, used: &[bool], near_edge: &[bool]) -> Vec<bool> {
        let pairs = used.iter().zip(near_edge);
        pairs.map(|(&used, &near)| self.by(used, near)).collect()
    }
}

/// The values of the samples that set the axis; all others are no number. All values where no
/// sample sets it.
pub(in crate::adapters) fn setting(values: &[f64], sets: &[bool]) -> Vec<f64> {
    if !sets.contains(&true) {
        return values.to_vec();
    }
    let one = |(k, &value)| {
        if sets.get(k).copied().unwrap_or(true) {
            value
        } else {
            f64::NAN
        }
    };
    values.iter().enumerate().map(one).collect()
}

/// What lies beyond the axis is drawn at its end.
pub(in crate::adapters) fn clamped(values: &[f64], (low, high): (f64, f64)) -> Vec<f64> {
    let ends = (low.min(high), low.max(high));
    values
        .iter()
        .map(|value| value.clamp(ends.0, ends.1))
        .collect()
}

/// The samples beyond the axis, to be marked at its end.
pub(in crate::adapters) fn beyond(values: &[f64], (low, high): (f64, f64)) -> Vec<usize> {
    let places = values.iter().enumerate();
    places
        .filter(|(_, value)| **value < low || **value > high)
        .map(|(k, _)| k)
        .collect()
}

/// Says so where the axis cuts something off: how far it goes, and when.
pub(in crate::adapters) fn cut_note(values: &[f64], time_s: &[f64], axis: (f64, f64)) -> String {
    let middle = f64::midpoint(axis.0, axis.1);
    let far = |k: &usize| (values[*k] - middle).abs();
    let largest = (beyond(values, axis).into_iter())
        .filter(|k| *k < time_s.len())
        .max_by(|a, b| far(a).total_cmp(&far(b)));
    largest.map_or_else(String::new, |k| {
        format!(
            " (cut off; {} at {} s)",
            number::significant(values[k], 2),
            number::fixed(time_s[k], 2)
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_fit_does_not_use_sets_no_axis_unless_it_is_the_event_itself() {
        let (used, near) = ([true, false, false], [false, true, false]);
        assert_eq!(Sets::Powers.each(&used, &near), [true, true, false]);
        assert_eq!(Sets::Residuals.each(&used, &near), [true, false, false]);
        let values = setting(&[1.0, 0.5, 9.0], &Sets::Powers.each(&used, &near));
        assert_eq!(values[..2], [1.0, 0.5]);
        assert!(values[2].is_nan());
        assert_eq!(setting(&[1.0, 9.0], &[false, false]), [1.0, 9.0]);
    }

    #[test]
    fn what_lies_beyond_the_axis_is_drawn_at_its_end_and_told() {
        let values = [0.9, f64::NAN, 0.1, 1.5];
        let axis = (0.8, 1.0);
        assert_eq!(beyond(&values, axis), [2, 3]);
        let drawn = clamped(&values, axis);
        assert_eq!((drawn[0], drawn[2], drawn[3]), (0.9, 0.8, 1.0));
        assert!(drawn[1].is_nan());
        let note = cut_note(&values, &[0.0, 1.0, 2.0, 3.0], axis);
        assert_eq!(note, " (cut off; 0.10 at 2.00 s)");
        assert_eq!(cut_note(&[0.9], &[0.0], axis), "");
    }
}
