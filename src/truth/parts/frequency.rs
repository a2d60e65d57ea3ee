//! The frequency as devices at the terminals notice it: a tracked angle.

use crate::truth::Phasor;

/// Follows the angle of the voltage with a lag; its rate is the frequency.
///
/// ```text
/// (1)  d phi/dt = (arg V - phi)/T
/// (2)  df = (1/w0) d phi/dt
/// ```
///
/// A step of the angle is noticed as a spike of df that decays with T, as controllers with a
/// phase-locked loop see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct FrequencyTracker {
    pub(super) nominal_rad_s: f64,
    pub(super) lag_s: f64,
}

impl FrequencyTracker {
    /// d phi/dt, rad/s.
    pub(super) fn rate_rad_s(&self, voltage: Phasor, angle_rad: f64) -> f64 {
        (voltage * Phasor::from_polar(1.0, -angle_rad)).arg() / self.lag_s // (1)
    }

    /// df, relative to nominal.
    pub(super) fn deviation(&self, voltage: Phasor, angle_rad: f64) -> f64 {
        self.rate_rad_s(voltage, angle_rad) / self.nominal_rad_s // (2)
    }
}
