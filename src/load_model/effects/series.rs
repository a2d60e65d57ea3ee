//! A measured series as a function of time between its instants.
//!
//! Cubic Hermite with slopes from the neighbours, straight where the phasor jumps: a cubic would
//! overshoot there. Exact at the instants.

use crate::numerics::Scalar;

/// A series with its slopes.
pub(super) struct Curve<'a, S> {
    time_s: &'a [f64],
    jump: &'a [bool],
    value: &'a [S],
    slope: Vec<S>,
    /// Integral up to each instant, of straight pieces.
    area: Vec<S>,
}

impl<'a, S: Scalar> Curve<'a, S> {
    pub(super) fn new(time_s: &'a [f64], jump: &'a [bool], value: &'a [S]) -> Self {
        let n = value.len();
        let chord = |k: usize| (value[k + 1] - value[k]) * (1.0 / (time_s[k + 1] - time_s[k]));
        let slope = (0..n)
            .map(|k| {
                let before = (k > 0 && !jump[k - 1]).then(|| chord(k - 1));
                let after = (k + 1 < n && !jump[k]).then(|| chord(k));
                match (before, after) {
                    (Some(x), Some(y)) => {
                        let (left, right) = (time_s[k] - time_s[k - 1], time_s[k + 1] - time_s[k]);
                        (x * right + y * left) * (1.0 / (left + right))
                    }
                    (Some(x), None) | (None, Some(x)) => x,
                    (None, None) => S::constant(0.0),
                }
            })
            .collect();
        let mut area = vec![S::constant(0.0); n];
        for k in 1..n {
            let half = 0.5 * (time_s[k] - time_s[k - 1]);
            area[k] = area[k - 1] + (value[k - 1] + value[k]) * half;
        }
        Self {
            time_s,
            jump,
            value,
            slope,
            area,
        }
    }

    /// The value at a time; beyond the ends the value there.
    pub(super) fn at(&self, time_s: S) -> S {
        let Some(k) = self.interval(time_s.value()) else {
            return if time_s.value() <= self.time_s[0] {
                self.value[0]
            } else {
                self.value[self.value.len() - 1]
            };
        };
        if time_s.value().to_bits() == self.time_s[k].to_bits() {
            // The curve may have a kink here: between its slopes on both sides.
            let slope = (self.slope_before(k) + self.slope_after(k)) * 0.5;
            return self.value[k] + (time_s + -self.time_s[k]) * slope;
        }
        let length = self.time_s[k + 1] - self.time_s[k];
        let x = (time_s + -self.time_s[k]) * (1.0 / length);
        let (left, right) = (self.value[k], self.value[k + 1]);
        if self.jump[k] {
            return left + (right - left) * x;
        }
        let (rise, y) = (right - left, -x + 1.0);
        let bend = (self.slope[k] * length - rise) * y - (self.slope[k + 1] * length - rise) * x;
        left + rise * x + x * y * bend
    }

    fn chord(&self, k: usize) -> S {
        let length = self.time_s[k + 1] - self.time_s[k];
        (self.value[k + 1] - self.value[k]) * (1.0 / length)
    }

    fn slope_before(&self, k: usize) -> S {
        if k > 0 && self.jump[k - 1] {
            self.chord(k - 1)
        } else {
            self.slope[k]
        }
    }

    fn slope_after(&self, k: usize) -> S {
        if self.jump[k] {
            self.chord(k)
        } else {
            self.slope[k]
        }
    }

    /// Mean over a window, from its exact integral for straight pieces between the instants.
    pub(super) fn mean(&self, from_s: S, to_s: S) -> S {
        (self.integral(to_s) - self.integral(from_s)) / (to_s - from_s)
    }

    fn integral(&self, time_s: S) -> S {
        let last = self.value.len() - 1;
        if let Some(k) = self.interval(time_s.value()) {
            let part = time_s + -self.time_s[k];
            let x = part * (1.0 / (self.time_s[k + 1] - self.time_s[k]));
            let mean = self.value[k] + (self.value[k + 1] - self.value[k]) * x * 0.5;
            return self.area[k] + part * mean;
        }
        let end = if time_s.value() <= self.time_s[0] {
            0
        } else {
            last
        };
        self.area[end] + (time_s + -self.time_s[end]) * self.value[end]
    }

    fn interval(&self, time_s: f64) -> Option<usize> {
        let n = self.time_s.len();
        if n < 2 || time_s <= self.time_s[0] || time_s >= self.time_s[n - 1] {
            return None;
        }
        Some(self.time_s.partition_point(|t| *t <= time_s) - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_is_followed_and_averaged() {
        let time_s: Vec<f64> = (0..20).map(|k| 0.1 * f64::from(k)).collect();
        let value: Vec<f64> = time_s.iter().map(|t| t * t).collect();
        let jump = vec![false; 20];
        let curve = Curve::new(&time_s, &jump, &value);
        assert!((curve.at(0.83) - 0.6889).abs() < 1e-12);
        assert!((curve.at(0.8) - 0.64).abs() < 1e-12);
        // Straight pieces lie h^2/6 above the parabola on average.
        let exact = (1.0_f64.powi(3) - 0.5_f64.powi(3)) / 3.0 / 0.5;
        assert!((curve.mean(0.5, 1.0) - exact - 0.01 / 6.0).abs() < 1e-12);
    }
}
