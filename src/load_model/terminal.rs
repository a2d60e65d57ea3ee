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

    /// The phasor at a fine grid point.
    pub(super) fn point(&self, index: usize) -> [f64; 2] {
        [self.real[index], self.imaginary[index]]
    }
}
