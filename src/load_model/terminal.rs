//! What drives a load model: the complex terminal voltage, dense enough for an integrator.

/// Complex terminal voltage on a fine uniform grid.
///
/// The phasor is normalised to 1 at rest and given in the frame that turns at the frequency before
/// the disturbance, so its angle holds both phase jumps and the integral of the frequency
/// deviation.
#[derive(Clone, Debug, PartialEq)]
pub struct TerminalInput {
    /// Real part at each fine grid point, `(samples - 1) * points_per_sample + 1` of them.
    pub real: Vec<f64>,
    /// Imaginary part.
    pub imaginary: Vec<f64>,
    /// Fine grid points per measured sample, a power of two and at least [`DENSE_POINTS`].
    pub points_per_sample: usize,
    /// Time between measured samples, seconds.
    pub sample_interval_s: f64,
    /// For each interval between samples, whether the phasor jumps within it: the integrator then
    /// follows every fine grid point.
    pub jumps: Vec<bool>,
    /// For each interval between samples, whether the load's power is wanted inside it too, at
    /// [`DENSE_POINTS`] equally spaced instants from its left sample on (the measurement chain needs
    /// them where a phasor filter spreads an edge); otherwise only at its left sample.
    pub dense: Vec<bool>,
    /// Synchronous angular speed before the disturbance, rad/s.
    pub synchronous_speed_rad_s: f64,
}

/// Instants per dense interval at which a simulation gives its output. A power of two, so that
/// they lie on substeps.
pub const DENSE_POINTS: usize = 8;

impl TerminalInput {
    /// Number of instants at which a simulation gives its output.
    #[must_use]
    pub fn output_count(&self) -> usize {
        let samples = self.sample_count();
        let dense = self.dense.iter().filter(|d| **d).count();
        samples + dense * (DENSE_POINTS - 1)
    }

    /// The fine grid point of every output instant, in order.
    #[must_use]
    pub fn output_points(&self) -> Vec<usize> {
        let samples = self.sample_count();
        let mut points = Vec::with_capacity(self.output_count());
        for k in 0..samples {
            let origin = k * self.points_per_sample;
            points.push(origin);
            if self.dense.get(k) == Some(&true) {
                let apart = self.points_per_sample / DENSE_POINTS;
                points.extend((1..DENSE_POINTS).map(|j| origin + j * apart));
            }
        }
        points
    }

    /// Number of measured samples.
    #[must_use]
    pub fn sample_count(&self) -> usize {
        if self.real.is_empty() {
            0
        } else {
            (self.real.len() - 1) / self.points_per_sample + 1
        }
    }

    /// The lowest magnitude of the phasor, which moves on a straight line from each grid point to the next.
    #[must_use]
    pub fn lowest_voltage(&self) -> f64 {
        let lines = (1..self.real.len()).map(|i| {
            let [from, to] = [self.point(i - 1), self.point(i)];
            let along = [to[0] - from[0], to[1] - from[1]];
            let length = (along[0] * along[0] + along[1] * along[1]).max(f64::MIN_POSITIVE);
            let share = -(from[0] * along[0] + from[1] * along[1]) / length;
            let share = share.clamp(0.0, 1.0);
            (from[0] + share * along[0]).hypot(from[1] + share * along[1])
        });
        lines.fold(f64::INFINITY, f64::min)
    }

    /// The longest time in a row that the magnitude stays below a level, s; between grid points the magnitude is taken as
    /// straight, so that a dip between two of them is not seen.
    #[must_use]
    pub fn longest_below_s(&self, level: f64) -> f64 {
        let magnitude = |index: usize| self.real[index].hypot(self.imaginary[index]);
        let interval_s = self.sample_interval_s / self.points_per_sample as f64;
        let (mut longest, mut own) = (0.0_f64, 0.0);
        for index in 1..self.real.len() {
            let [from, to] = [magnitude(index - 1), magnitude(index)];
            let at = (level - from) / (to - from);
            match [from < level, to < level] {
                [true, true] => own += interval_s,
                [true, false] => {
                    longest = longest.max(own + at * interval_s);
                    own = 0.0;
                }
                [false, true] => own = (1.0 - at) * interval_s,
                [false, false] => own = 0.0,
            }
        }
        longest.max(own)
    }

    /// The phasor at a fine grid point.
    pub(super) fn point(&self, index: usize) -> [f64; 2] {
        [self.real[index], self.imaginary[index]]
    }
}

#[cfg(test)]
mod tests {
    use crate::load_model::composed::contract::a_dip;

    #[test]
    fn the_lowest_voltage_lies_on_the_way_of_a_turning_phasor_too() {
        let dip = a_dip(0.8, 0.0);
        assert!((dip.lowest_voltage() - 0.8).abs() < 1e-12);
        let mut turned = dip;
        // By 90 degrees from one point to the next: the chord passes at cos 45 degrees.
        let last = turned.real.len() - 1;
        (turned.real[last - 1], turned.imaginary[last - 1]) = (1.0, 0.0);
        (turned.real[last], turned.imaginary[last]) = (0.0, 1.0);
        assert!((turned.lowest_voltage() - 0.5_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_longest_time_below_a_level_is_that_of_one_dip() {
        let mut input = a_dip(0.8, 0.0);
        // From 0.5 s on 0.8, rising by 0.02 each second; at 0.75 s back to 0.93 and slowly on to 1.
        let fine_s = input.sample_interval_s / input.points_per_sample as f64;
        assert!((input.longest_below_s(0.9) - 0.25).abs() <= 2.0 * fine_s);
        assert!((input.longest_below_s(0.802) - 0.1).abs() <= 2.0 * fine_s);
        assert!(input.longest_below_s(0.8).abs() <= fine_s);
        assert!(input.longest_below_s(2.0) > 1.0);
        // A second, shorter dip changes nothing.
        let end_s = input.real.len() as f64 * fine_s;
        for index in 0..input.real.len() {
            if index as f64 * fine_s > end_s - 0.1 {
                (input.real[index], input.imaginary[index]) = (0.7, 0.0);
            }
        }
        assert!((input.longest_below_s(0.9) - 0.25).abs() <= 2.0 * fine_s);
    }
}
