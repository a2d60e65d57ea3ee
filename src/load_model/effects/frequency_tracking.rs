//! A frequency channel that lags.
//!
//! Instruments filter their frequency estimate over several cycles. Where the motor's drive and the
//! frequency effects are built from that channel (no angle is recorded), both are late.
//!
//! Missing, it leaves residuals in proportion to the rate of change of the frequency in whatever depends on the frequency,
//! and in the power of motors, through their inertia, to the change of that rate.
//!
//! With the channel late by `T`, to first order:
//!
//! ```text
//! df = df_m + T d(df_m)/dt                  (1)
//! u  = u_m exp(j w_0 T df_m)                (2)
//! ```
//!
//! (2) because the angle is the integral of the frequency. Without a frequency channel there is nothing
//! to correct. Only the lag is here: what a filter takes off fast swings, its overshoot and its noise are not. Spikes at phase jumps are blanked before they get here.
//!
//! Source: first-order expansion of a delay; IEEE C37.118.1 bounds the delay by a few cycles (not
//! verified).

use crate::{
    load_model::{
        composed::Rest,
        effect::{Declaration, Declared, Equations, Kind, Needs, Parameter, Place},
    },
    numerics::Elementary,
};

/// A frequency channel that lags.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrequencyTracking;

const DECLARATION: Declaration = Declaration {
    name: "frequency_tracking",
    title: "Frequency channel that lags",
    kind: Kind::Instrument,
    version: 1,
    parameters: &[Parameter::two_sided(
        ["delay_s", "T", "s"],
        [-0.15, 0.05, 0.15, 0.02],
    )],
    states: &[],
    acts_on: &[Place::Frequency, Place::Gain],
    excludes: &[],
    resembles: &["frequency_scaled_power", "static_frequency_dependence"],
    needs: Needs {
        frequency: true,
        voltage_below: None,
        frequency_deviation: Some(1e-3),
        window_s: 5.0,
        separating_event: "fast changes of frequency at a steady voltage",
        ..Needs::A_DIP
    },
    source: "first-order expansion of a delay; IEEE C37.118.1 (limits not verified)",
};

impl Declared for FrequencyTracking {
    fn declaration(&self) -> &'static Declaration {
        &DECLARATION
    }
}

impl<S: Elementary> Equations<S> for FrequencyTracking {
    fn frequency(&self, p: &[S], time_s: &[f64], deviation: &mut [S]) {
        let measured = deviation.to_vec();
        let last = measured.len().saturating_sub(1);
        for (k, out) in deviation.iter_mut().enumerate() {
            let (left, right) = (k.saturating_sub(1), (k + 1).min(last));
            if left < right {
                let slope = measured[right] - measured[left];
                *out = *out + p[0] * slope * (1.0 / (time_s[right] - time_s[left])); // (1)
            }
        }
    }

    fn gain(&self, p: &[S], _x: &[S], frequency_deviation: S, rest: &Rest<S>) -> [S; 2] {
        let turned = p[0] * frequency_deviation * rest.synchronous_speed_rad_s;
        let [sine, cosine] = turned.sin_cos();
        [cosine, sine] // (2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_that_is_late_is_moved_back() {
        // df_m = 0.01 (t - T) corrected by T is 0.01 t, away from the ends.
        let time_s: Vec<f64> = (0..20).map(|k| 0.02 * f64::from(k)).collect();
        let mut deviation: Vec<f64> = time_s.iter().map(|t| 0.01 * (t - 0.05)).collect();
        FrequencyTracking.frequency(&[0.05], &time_s, &mut deviation);
        for (t, df) in time_s.iter().zip(&deviation) {
            assert!((df - 0.01 * t).abs() < 1e-12);
        }
    }
}
