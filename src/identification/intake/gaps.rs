//! Gaps that hide what the voltage did.
//!
//! The model is driven by a straight line across a gap. Where the voltage did something else meanwhile, the
//! motors behind the gap move as no model can know, until they have forgotten it.
//!
//! With `a` the last sample before a gap, `b` the first one after it, and slopes `s` per sample before, across
//! and after it, a course without a corner departs from the line by about
//!
//! ```text
//! (b - a)/4 max(|s_across - s_before|, |s_after - s_across|)                       (1)
//! ```

use nalgebra::Complex;

use super::series::Series;

/// A gap can hide a motion when its neighbours are at least this far apart and it has this many samples; what is shorter is
/// left to the search for jumps, which finds instants between samples. Chosen: three samples at 60 frames/s, two at 30.
const GAP_S: f64 = 0.06;
const GAP_SAMPLES: usize = 2;
/// Samples over which the slopes beside a gap are taken.
const BESIDE: usize = 3;
/// (1) of the phasor of the voltage, relative to V0, from which a gap hides something. Chosen: three times what a noise of
/// 0.3 % makes of it, a fifth of what a second fault does.
const VOLTAGE_HIDDEN: f64 = 0.01;
/// The same of P and Q, relative to P0: a motion that was over when the gap ended shows in what it left of the motors.
const POWER_HIDDEN: f64 = 0.03;
/// How long motors remember. Chosen: what a wrong voltage of a tenth of a second leaves in P is below the noise by then.
const MEMORY_S: f64 = 0.5;

/// Samples behind gaps that hide a motion of the voltage. `v0_pu` and `p0_pu`: before the event.
pub(super) fn behind(series: &Series, v0_pu: f64, p0_pu: f64) -> Vec<bool> {
    let n = series.len();
    let mut behind = vec![false; n];
    let phasor = |k: usize| Complex::from_polar(series.voltage[k] / v0_pu, series.angle[k]);
    let power = |k: usize| Complex::new(series.active[k], series.reactive[k]) / p0_pu;
    let good: Vec<usize> = (0..n).filter(|&k| !series.bad[k]).collect();
    for pair in good.windows(2) {
        let gap = Gap {
            last: pair[0],
            first: pair[1],
            samples: n,
        };
        let missing = gap.first - gap.last - 1;
        if missing < GAP_SAMPLES || gap.length() / series.rate_fps < GAP_S {
            continue;
        }
        if gap.departure(phasor) > VOLTAGE_HIDDEN || gap.departure(power) > POWER_HIDDEN {
            let forgotten = gap.first as f64 + MEMORY_S * series.rate_fps;
            let after = behind.iter_mut().enumerate().skip(gap.first);
            for (_, sample) in after.take_while(|(k, _)| (*k as f64) < forgotten) {
                *sample = true;
            }
        }
    }
    behind
}

/// A run of bad samples between two good ones.
struct Gap {
    last: usize,
    first: usize,
    samples: usize,
}

impl Gap {
    fn length(&self) -> f64 {
        (self.first - self.last) as f64
    }

    /// (1).
    fn departure(&self, value: impl Fn(usize) -> Complex<f64>) -> f64 {
        let slope = |from: usize, to: usize| {
            if from == to {
                Complex::new(0.0, 0.0)
            } else {
                (value(to) - value(from)) / (to - from) as f64
            }
        };
        let before = slope(self.last.saturating_sub(BESIDE), self.last);
        let across = slope(self.last, self.first);
        let after = slope(self.first, (self.first + BESIDE).min(self.samples - 1));
        let corner = (across - before).norm().max((after - across).norm());
        0.25 * corner * self.length()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// P and V alike at 60 samples/s, the samples of `gap` bad and bridged.
    fn series(voltage: impl Fn(f64) -> f64, gap: std::ops::Range<usize>) -> Series {
        series_at(60.0, voltage, gap)
    }

    fn series_at(
        rate_fps: f64,
        voltage: impl Fn(f64) -> f64,
        gap: std::ops::Range<usize>,
    ) -> Series {
        let n = 200;
        let course = (0..n).map(|k| voltage(k as f64 / rate_fps));
        let bad: Vec<bool> = (0..n).map(|k| gap.contains(&k)).collect();
        let bridged = super::super::series::bridged(&course.collect::<Vec<_>>(), &bad).unwrap();
        Series {
            rate_fps,
            nominal_hz: 60.0,
            angle: vec![0.0; n],
            frequency_hz: vec![60.0; n],
            active: bridged.clone(),
            reactive: vec![0.0; n],
            voltage: bridged,
            bad,
        }
    }

    fn count(series: &Series) -> usize {
        let behind = behind(series, 1.0, 1.0);
        behind.iter().filter(|b| **b).count()
    }

    #[test]
    fn a_fault_within_a_gap_keeps_half_a_second_behind_it_out() {
        // Down at 1 s, back by a third of the way each tenth of a second from 1.1 s on.
        let dip = |t: f64| match t {
            t if t < 1.0 => 1.0,
            t if t < 1.1 => 0.6,
            t => 1.0 - 0.1 * (-(t - 1.1) / 0.25).exp(),
        };
        let series = series(dip, 58..67);
        let behind = behind(&series, 1.0, 1.0);
        assert!(behind[67] && behind[96] && !behind[66] && !behind[97]);
    }

    #[test]
    fn a_gap_in_a_smooth_course_or_in_a_quiet_one_hides_nothing() {
        let recovery = |t: f64| 1.0 - 0.1 * (-t / 0.5).exp();
        assert_eq!(count(&series(recovery, 30..37)), 0);
        let noisy = |t: f64| 1.0 + 1e-3 * (t * 1e4).sin();
        assert_eq!(count(&series(noisy, 30..40)), 0);
    }

    #[test]
    fn a_bad_sample_beside_a_jump_is_left_to_the_search_for_jumps() {
        let step = |t: f64| if t < 1.0 { 1.0 } else { 0.7 };
        assert_eq!(count(&series(step, 60..61)), 0);
        assert_eq!(count(&series_at(30.0, step, 30..31)), 0);
        assert_eq!(count(&series_at(30.0, step, 29..31)), 15);
        assert!(count(&series(step, 58..64)) > 0);
    }
}
