//! Axes: which numbers stand beside them.

/// Numbers beside an axis from `low` to `high`, about `count` of them, a step of 1, 2 or 5 times a
/// power of ten apart, and the decimals that tell them apart. None where the axis has no length.
pub(super) fn ticks((low, high): (f64, f64), count: u32) -> (Vec<f64>, usize) {
    let span = high - low;
    if !(span.is_finite() && span > 0.0 && count > 0) {
        return (Vec::new(), 0);
    }
    let raw = span / f64::from(count);
    let power = 10_f64.powf(raw.log10().floor());
    let steps = [10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1].map(|factor| factor * power);
    // A hair's breadth, so that 0.2 is not missed as 0.19999.
    let wide = steps.iter().filter(|step| **step >= raw * (1.0 - 1e-9));
    let wide = wide.count().max(1) - 1;
    let ends = |step: f64| ((low / step).ceil(), (high / step + 1e-9).floor());
    // One number alone does not tell the scale.
    let step = steps[wide..]
        .iter()
        .copied()
        .find(|step| ends(*step).0 < ends(*step).1)
        .unwrap_or(power);
    let (first, last) = ends(step);
    let mut values = Vec::new();
    let mut index = first;
    while index <= last && values.len() < 64 {
        values.push(index * step);
        index += 1.0;
    }
    (values, decimals(step))
}

/// Places on an axis of decimal logarithms: powers of ten, with 2 and 5 times them where there is room.
pub(super) fn logarithmic_ticks((low, high): (f64, f64), count: u32) -> Vec<f64> {
    let span = high - low;
    if !(span.is_finite() && span > 0.0) || span > 64.0 {
        return Vec::new();
    }
    let factors: &[f64] = if span * 3.0 <= f64::from(count) + 1.0 {
        &[1.0, 2.0, 5.0]
    } else {
        &[1.0]
    };
    let mut values = Vec::new();
    let mut power = low.floor();
    while power <= high {
        let places = factors.iter().map(|factor| power + factor.log10());
        values.extend(places.filter(|place| (low..=high).contains(place)));
        power += 1.0;
    }
    // Within one power there may be too few of them to read the axis by: round numbers then, whose
    // places are nearly even on so short a piece.
    if values.len() < 3 && span < 1.0 {
        let ends = (10_f64.powf(low), 10_f64.powf(high));
        let (numbers, _) = ticks(ends, count);
        numbers.into_iter().map(f64::log10).collect()
    } else {
        values
    }
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to 0..=9 in the same expression"
)]
fn decimals(step: f64) -> usize {
    (-step.log10().floor()).clamp(0.0, 9.0) as usize
}

/// Lowest and highest finite value; none when there is none.
pub(in super::super) fn span_of<'a>(
    values: impl IntoIterator<Item = &'a f64>,
) -> Option<(f64, f64)> {
    values
        .into_iter()
        .filter(|value| value.is_finite())
        .fold(None, |span, &value| {
            let (low, high) = span.unwrap_or((value, value));
            Some((value.min(low), value.max(high)))
        })
}

/// The span with a margin of 6 percent to both sides, at least `least` wide; 0 to 1 for none.
pub(in super::super) fn padded(span: Option<(f64, f64)>, least: f64) -> (f64, f64) {
    let Some((low, high)) = span else {
        return (0.0, 1.0);
    };
    let missing = (least - (high - low)).max(0.0) / 2.0;
    let margin = 0.06 * (high - low + 2.0 * missing) + missing;
    (low - margin, high + margin)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside_the_axis() {
        let (values, decimals) = ticks((0.0, 1.0), 5);
        assert_eq!(decimals, 1);
        assert_eq!(values.len(), 6);
        let (values, _) = ticks((-0.13, 7.3), 8);
        assert!(
            values.iter().all(|v| (-0.13..=7.3).contains(v)),
            "{values:?}"
        );
        assert_eq!(ticks((1.0, 1.0), 5).0, Vec::<f64>::new());
        assert_eq!(ticks((f64::NAN, 1.0), 5).0, Vec::<f64>::new());
    }

    #[test]
    fn a_logarithmic_axis_shows_powers_of_ten() {
        let wide: Vec<_> = logarithmic_ticks((-0.2, 3.1), 6);
        assert_eq!(wide.len(), 4, "1, 10, 100, 1000: {wide:?}");
        let close: Vec<_> = logarithmic_ticks((-0.1, 1.1), 6);
        assert_eq!(close.len(), 4, "1, 2, 5, 10: {close:?}");
        let narrow = logarithmic_ticks((-0.06, 0.04), 6);
        let numbers: Vec<_> = narrow
            .iter()
            .map(|place| (10_f64.powf(*place) * 100.0).round())
            .collect();
        assert_eq!(numbers, [90.0, 95.0, 100.0, 105.0]);
    }

    #[test]
    fn a_constant_still_gets_an_axis() {
        let (low, high) = padded(span_of(&[0.5, f64::NAN, 0.5]), 0.1);
        assert!(low < 0.45 && high > 0.55);
        assert_eq!(padded(None, 1.0), (0.0, 1.0));
    }
}
