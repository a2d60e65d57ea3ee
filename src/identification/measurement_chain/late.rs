//! What an instrument reports that is late: its report at the samples' times less a delay.
//!
//! The phasors of the report are those of a window around `t_k - tau` (equation (1) of the chain at that time); where
//! no window matters, power between the output instants is a cubic with slopes from the neighbours, straight where an
//! unfiltered voltage jumps. Either way the report is linear in the power at the instants, and so is its
//! derivative with respect to `tau`.

use nalgebra::Complex;

use super::{Grid, MeasurementChain};

/// The report of a late instrument, sample by sample.
#[derive(Clone, Debug, PartialEq)]
pub struct LateReport {
    rows: Vec<LateRow>,
}

/// One sample: weights of the output instants from `first` on, and their derivatives with respect to the delay in
/// samples.
#[derive(Clone, Debug, PartialEq)]
struct LateRow {
    first: usize,
    weights: Vec<Complex<f64>>,
    slopes: Vec<Complex<f64>>,
}

impl MeasurementChain {
    /// The report of an instrument that is late by `delay_samples`; before the first sample and after the last what
    /// it reports there. Cost: as [`MeasurementChain::new`].
    #[must_use]
    pub fn late(&self, delay_samples: f64) -> LateReport {
        let row = |sample: usize| self.late_row(sample as f64 - delay_samples);
        LateReport {
            rows: (0..self.instants.len()).map(row).collect(),
        }
    }

    /// The report at a time: windowed at samples that the filter changes, power itself at the others, and smoothly
    /// from one to the other in between.
    fn late_row(&self, time: f64) -> LateRow {
        let last = self.instants.len().saturating_sub(1);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "clamped to the samples"
        )]
        let before = time.floor().clamp(0.0, last as f64) as usize;
        let is_filtered = |sample: usize| {
            let filtered = &self.filtered;
            filtered.binary_search_by_key(&sample, |f| f.sample).is_ok()
        };
        let [left, right] = [before, (before + 1).min(last)].map(is_filtered);
        if !left && !right {
            return self.grid.between(time);
        }
        let Some(windowed) = self.grid.windowed(time) else {
            return self.grid.between(time);
        };
        if left && right {
            return windowed;
        }
        let x = (time - before as f64).clamp(0.0, 1.0);
        let (after, slope) = (x * x * (3.0 - 2.0 * x), 6.0 * x * (1.0 - x));
        let (share, slope) = if left {
            (1.0 - after, -slope)
        } else {
            (after, slope)
        };
        windowed.mixed(share, slope, &self.grid.between(time))
    }
}

impl LateReport {
    /// P and Q that the instrument reports at a sample, from P and Q at every output instant.
    #[must_use]
    pub fn measured(&self, sample: usize, active: &[f64], reactive: &[f64]) -> [f64; 2] {
        let row = &self.rows[sample];
        row.sum(&row.weights, active, reactive)
    }

    /// Their derivatives with respect to the delay, per sample.
    #[must_use]
    pub fn by_delay(&self, sample: usize, active: &[f64], reactive: &[f64]) -> [f64; 2] {
        let row = &self.rows[sample];
        row.sum(&row.slopes, active, reactive)
    }
}

impl LateRow {
    /// `share` of this row and the rest of another; the share has the slope `slope` over time.
    fn mixed(&self, share: f64, slope: f64, other: &Self) -> Self {
        let first = self.first.min(other.first);
        let end = |row: &Self| row.first + row.weights.len();
        let count = end(self).max(end(other)) - first;
        let nothing = Complex::from(0.0);
        let (mut weights, mut slopes) = (vec![nothing; count], vec![nothing; count]);
        for (row, share, slope) in [(self, share, slope), (other, 1.0 - share, -slope)] {
            let both = row.weights.iter().zip(&row.slopes).enumerate();
            for (place, (weight, by_delay)) in both {
                let place = row.first - first + place;
                weights[place] += weight * share;
                slopes[place] += by_delay * share - weight * slope;
            }
        }
        Self {
            first,
            weights,
            slopes,
        }
    }

    fn sum(&self, weights: &[Complex<f64>], active: &[f64], reactive: &[f64]) -> [f64; 2] {
        let window = self.first..self.first + weights.len();
        let powers = active[window.clone()].iter().zip(&reactive[window]);
        let terms = powers.zip(weights);
        let sum: Complex<f64> = terms.map(|((p, q), w)| w * Complex::new(*p, *q)).sum();
        [sum.re, sum.im]
    }
}

impl Grid {
    /// What the filter makes of the power around a time.
    fn windowed(&self, time: f64) -> Option<LateRow> {
        let (first, shares, total) = self.weights(time)?;
        let moved = self.weight_slopes(time, first, &shares, total);
        let u = &self.u[first..first + shares.len()];
        let sum = |weights: &[f64]| -> Complex<f64> {
            u.iter().zip(weights).map(|(u, weight)| u * weight).sum()
        };
        let (seen, seen_moved) = (sum(&shares), sum(&moved));
        let both = u.iter().zip(&shares);
        Some(LateRow {
            first,
            weights: both.clone().map(|(u, weight)| seen / u * weight).collect(),
            slopes: (both.zip(&moved))
                .map(|((u, weight), moved)| -(seen * moved + seen_moved * weight) / u)
                .collect(),
        })
    }

    /// The cubic through the output instants.
    fn between(&self, time: f64) -> LateRow {
        let last = self.time.len() - 1;
        let fixed = |at: usize| LateRow {
            first: at,
            weights: vec![Complex::from(1.0)],
            slopes: vec![Complex::from(0.0)],
        };
        if time <= self.time[0] {
            return fixed(0);
        }
        if time >= self.time[last] {
            return fixed(last);
        }
        // A time that is not a number gives a report that is none.
        let left = self.time.partition_point(|t| *t <= time).saturating_sub(1);
        let first = left.saturating_sub(1);
        let count = (left + 2).min(last) + 1 - first;
        let mut weights = vec![0.0; count];
        let mut slopes = vec![0.0; count];
        let length = self.time[left + 1] - self.time[left];
        let x = (time - self.time[left]) / length;
        let y = 1.0 - x;
        let (here, next) = (left - first, left + 1 - first);
        let mut add = |place: usize, weight: f64, slope: f64| {
            weights[place] += weight;
            slopes[place] -= slope;
        };
        if self.jumps_between(left) {
            add(here, y, -1.0 / length);
            add(next, x, 1.0 / length);
        } else {
            // With the slopes s at both ends: f = f_0 + rise (x - x y y + x x y) + s_0 L x y y - s_1 L x x y.
            let rise = x - x * y * y + x * x * y;
            let rise_slope = (1.0 - y * y - x * x + 4.0 * x * y) / length;
            add(here, 1.0 - rise, -rise_slope);
            add(next, rise, rise_slope);
            let ends = [
                (left, length * x * y * y, y * y - 2.0 * x * y),
                (left + 1, -length * x * x * y, x * x - 2.0 * x * y),
            ];
            for (node, weight, slope) in ends {
                for (at, share) in self.slope_at(node) {
                    add(at - first, weight * share, slope * share);
                }
            }
        }
        let complex = |list: Vec<f64>| list.into_iter().map(Complex::from).collect();
        LateRow {
            first,
            weights: complex(weights),
            slopes: complex(slopes),
        }
    }

    /// The slope at an output instant as a sum over instants: that of a parabola through its neighbours, or straight
    /// to the only one on its side of a jump.
    fn slope_at(&self, node: usize) -> Vec<(usize, f64)> {
        let length = |k: usize| self.time[k + 1] - self.time[k];
        let before = (node > 0 && !self.jumps_between(node - 1)).then(|| length(node - 1));
        let after = (node + 1 < self.time.len() && !self.jumps_between(node)).then(|| length(node));
        let chord = |from: usize, length: f64, share: f64| {
            [(from, -share / length), (from + 1, share / length)]
        };
        let (early, late) = match (before, after) {
            (Some(b), Some(a)) => (a / (a + b), b / (a + b)),
            (Some(_), None) => (1.0, 0.0),
            (None, Some(_)) => (0.0, 1.0),
            (None, None) => (0.0, 0.0),
        };
        let mut list = Vec::with_capacity(4);
        list.extend(before.into_iter().flat_map(|b| chord(node - 1, b, early)));
        list.extend(after.into_iter().flat_map(|a| chord(node, a, late)));
        list
    }
}

#[cfg(test)]
mod tests {
    use super::super::{
        ChainParts, PhasorFilter,
        tests::{PER, SAMPLES, dip},
    };
    use super::*;

    fn chain(filter: PhasorFilter, half_width: f64) -> (MeasurementChain, [Vec<f64>; 2]) {
        let input = dip(10.3);
        let filtered: Vec<bool> = (0..SAMPLES)
            .map(|k| filter != PhasorFilter::None && (8..=13).contains(&k))
            .collect();
        let chain = MeasurementChain::new(&ChainParts {
            input: &input,
            filter,
            half_width,
            jumps: &[10.3],
            filtered: &filtered,
            frequency_deviation: &[0.0; SAMPLES],
        });
        // A load that recovers after the jump, and swings.
        let power = |t: f64| {
            let since = t - 10.3;
            let back = if since > 0.0 {
                -0.4 * (-0.3 * since).exp()
            } else {
                0.0
            };
            1.0 + back + 0.1 * (0.4 * t).sin()
        };
        let points = input.output_points();
        let times = points.iter().map(|p| *p as f64 / PER as f64);
        let active: Vec<f64> = times.map(power).collect();
        let reactive = active.iter().map(|p| 0.3 * p * p).collect();
        (chain, [active, reactive])
    }

    const INSTRUMENTS: [(PhasorFilter, f64); 3] = [
        (PhasorFilter::None, 0.0),
        (PhasorFilter::OneCycle, 0.5),
        (PhasorFilter::PClass, 1.0),
    ];

    #[test]
    fn whole_samples_late_is_the_report_of_samples_before() {
        for (filter, half_width) in INSTRUMENTS {
            let (chain, [active, reactive]) = chain(filter, half_width);
            let report = chain.measured(&active, &reactive);
            for delay in [0_u8, 1, 2] {
                let late = chain.late(f64::from(delay));
                for k in usize::from(delay)..SAMPLES {
                    let found = late.measured(k, &active, &reactive);
                    let expected = report[k - usize::from(delay)];
                    for (found, expected) in found.iter().zip(expected) {
                        assert!((found - expected).abs() < 1e-12, "{filter:?} {delay} {k}");
                    }
                }
            }
        }
    }

    #[test]
    fn derivatives_by_the_delay_agree_with_differences() {
        const STEP: f64 = 1e-5;
        for (filter, half_width) in INSTRUMENTS {
            let (chain, [active, reactive]) = chain(filter, half_width);
            for delay in [-1.637, -0.418, 0.231, 0.877, 1.694] {
                let [before, at, after] =
                    [delay - STEP, delay, delay + STEP].map(|delay| chain.late(delay));
                for k in 3..SAMPLES - 3 {
                    let value = |late: &LateReport| late.measured(k, &active, &reactive);
                    let (before, after) = (value(&before), value(&after));
                    let slope = at.by_delay(k, &active, &reactive);
                    for channel in 0..2 {
                        let difference = (after[channel] - before[channel]) / (2.0 * STEP);
                        let error = (slope[channel] - difference).abs();
                        assert!(error < 1e-6, "{filter:?} {delay} {k} {channel}: {error:e}");
                    }
                }
            }
        }
    }

    #[test]
    fn delays_beyond_the_event_or_none_at_all_are_no_reason_to_fail() {
        for (filter, half_width) in INSTRUMENTS {
            let (chain, [active, reactive]) = chain(filter, half_width);
            for (delay, at) in [(1e6, 0), (-1e6, SAMPLES - 1)] {
                let late = chain.late(delay);
                let expected = chain.measured(&active, &reactive)[at];
                let bits = |numbers: [f64; 2]| numbers.map(f64::to_bits);
                let found = late.measured(7, &active, &reactive);
                assert_eq!(bits(found), bits(expected));
                let slopes = late.by_delay(7, &active, &reactive);
                assert!(slopes.iter().all(|slope| slope.abs() < 1e-300));
            }
            let unknown = chain.late(f64::NAN).measured(7, &active, &reactive);
            assert!(unknown.iter().all(|y| y.is_nan()));
        }
    }
}
