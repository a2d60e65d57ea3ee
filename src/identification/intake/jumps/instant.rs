//! Where one jump lies, the others as they are, and how well that is known.

use super::{
    AFTER, BEFORE, BEFORE_MIDDLE, COARSE, HEIGHT_DEVIATION, HEIGHT_EXPECTED, Jump, LARGE,
    LEAST_APART, Measured, PhasorFilter, Voltage,
};

/// What is left with one jump elsewhere.
pub(super) fn objective_at(
    measured: &Measured,
    range: (usize, usize),
    jumps: &[Jump],
    (index, position): (usize, f64),
    start: Option<&Voltage>,
) -> f64 {
    let mut moved = jumps.to_vec();
    moved[index].position = position;
    Voltage::fit(measured, range, &moved, start).map_or(f64::INFINITY, |fit| {
        fit.objective + bent(measured, &fit, index)
    })
}

/// What speaks against a jump that leaves most of the change to what lies on either side of it.
pub(super) fn bent(measured: &Measured, fit: &Voltage, index: usize) -> f64 {
    if !measured.has_short_window() || fit.jumps()[index].size() < LARGE {
        return 0.0;
    }
    let missing = (HEIGHT_EXPECTED - fit.share_of_change(index)).max(0.0);
    (missing / HEIGHT_DEVIATION).powi(2)
}

/// Where a jump is sought, the others as they are.
pub(super) fn within(measured: &Measured, jumps: &[Jump], index: usize) -> (f64, f64) {
    let anchor = jumps[index].anchor as f64;
    let earliest = if measured.is_longer() {
        anchor - BEFORE_MIDDLE
    } else {
        anchor - BEFORE
    };
    let before = index
        .checked_sub(1)
        .map(|i| jumps[i].position + LEAST_APART);
    let after = jumps.get(index + 1).map(|jump| jump.position - LEAST_APART);
    (
        before.map_or(earliest, |low| low.max(earliest)),
        after.map_or(anchor + AFTER, |high| high.min(anchor + AFTER)),
    )
}

/// The instant of one jump with the others as they are: coarse scan, then golden section.
pub(super) fn instant(
    measured: &Measured,
    range: (usize, usize),
    jumps: &[Jump],
    index: usize,
    start: Option<&Voltage>,
) -> f64 {
    const FINE: f64 = 5e-4;
    const ROUGH: f64 = 0.02;
    let fine = if measured.rough { ROUGH } else { FINE };
    let (low, high) = within(measured, jumps, index);
    let value = |t: f64| objective_at(measured, range, jumps, (index, t), start);
    let steps = ((high - low) / COARSE).floor();
    let mut best = (f64::INFINITY, jumps[index].position);
    let mut step = 0.0;
    while step <= steps {
        let t = low + step * COARSE;
        let v = value(t);
        if v < best.0 {
            best = (v, t);
        }
        step += 1.0;
    }
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut a, mut b) = ((best.1 - COARSE).max(low), (best.1 + COARSE).min(high));
    let (mut x, mut y) = (b - ratio * (b - a), a + ratio * (b - a));
    let (mut fx, mut fy) = (value(x), value(y));
    while b - a > fine {
        if fx <= fy {
            (b, y, fy) = (y, x, fx);
            x = b - ratio * (b - a);
            fx = value(x);
        } else {
            (a, x, fx) = (x, y, fy);
            y = a + ratio * (b - a);
            fy = value(y);
        }
    }
    0.5 * (a + b)
}

/// Standard deviation of an instant of which nothing is known: of a uniform distribution over one interval.
const UNKNOWN: f64 = 0.29;

/// Standard deviation of an instant given the voltages, the other jumps as they are, samples: over all that they allow,
/// because what few samples tell has two minima or a long flat side.
fn deviation_of_few(
    measured: &Measured,
    range: (usize, usize),
    jumps: &[Jump],
    index: usize,
) -> f64 {
    const POINTS: u32 = 54;
    let (low, high) = within(measured, jumps, index);
    let at = |i: u32| low + (high - low) * f64::from(i) / f64::from(POINTS);
    let left: Vec<(f64, f64)> = (0..=POINTS)
        .map(|i| {
            let left = objective_at(measured, range, jumps, (index, at(i)), None);
            (at(i), left)
        })
        .filter(|(_, left)| left.is_finite())
        .collect();
    if left.is_empty() {
        return UNKNOWN;
    }
    let least = left.iter().map(|l| l.1).fold(f64::INFINITY, f64::min);
    let mut sums = [0.0; 3];
    for (t, left) in left {
        let weight = (-0.5 * (left - least)).exp();
        for (sum, moment) in sums.iter_mut().zip([1.0, t, t * t]) {
            *sum += weight * moment;
        }
    }
    let mean = sums[1] / sums[0];
    (sums[2] / sums[0] - mean * mean).max(0.0).sqrt()
}

/// Standard deviation of an instant, samples: from the curvature of the objective where the filter spans samples enough.
pub(super) fn deviation(
    measured: &Measured,
    range: (usize, usize),
    jumps: &[Jump],
    index: usize,
    fit: &Voltage,
) -> f64 {
    const APART: f64 = 0.05;
    if measured.filter == PhasorFilter::None || measured.rough {
        return UNKNOWN;
    }
    if measured.has_short_window() {
        return deviation_of_few(measured, range, jumps, index);
    }
    let at = |t: f64| objective_at(measured, range, jumps, (index, t), Some(fit));
    let t = jumps[index].position;
    let least = fit.objective + bent(measured, fit, index);
    let curvature = (at(t - APART) - 2.0 * least + at(t + APART)) / (APART * APART);
    if curvature > 0.0 {
        (2.0 / curvature).sqrt().min(UNKNOWN)
    } else {
        UNKNOWN
    }
}
