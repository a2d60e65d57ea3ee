//! What a PMU makes of the phasors: a triangular window over two cycles, a reporting raster, a
//! frequency from the change of angle, and noise.
//!
//! Source: IEEE C37.118.1-2011, annex C.5: the P-class reference filter weighs the samples by a
//! triangle that spans two nominal cycles. Here the weighted mean is taken exactly over phasors
//! that run straight between nodes.
//!
//! Off nominal frequency a window makes phasors smaller, a triangle whose half width is h nominal cycles by
//!
//! ```text
//! (1)  g = (sin x / x)^2,  x = pi h (f - f0)/f0
//! ```
//!
//! which the magnitudes are divided by, as the annex asks for. The frequency for that is the median over a
//! quarter of a second: jumps of the angle, which look like some hertz for four cycles, are not followed.

use std::f64::consts::PI;

use super::{Phasor, Random, simulation::Node};
use crate::measurement::{Quality, Record, Sample};

/// How the PMU measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pmu {
    /// Reports per second.
    pub(super) rate_fps: f64,
    pub(super) nominal_hz: f64,
    /// Whole width of the window, nominal cycles; 0 for none.
    pub(super) filter_cycles: f64,
    /// Standard deviation of either component of V and of I, relative to their magnitudes.
    pub(super) noise: f64,
    /// By how much the powers are late against the voltage, s.
    pub(super) skew_s: f64,
    /// Angle by which the current is measured too far ahead, rad.
    pub(super) angle_error_rad: f64,
    /// Cycles to either side over which the angle is differenced for the frequency.
    pub(super) frequency_span_cycles: f64,
    /// Lag of the frequency estimate, s; 0 for none.
    pub(super) frequency_lag_s: f64,
}

/// Standard deviation of the frequency over the relative noise of the phasors, Hz: chosen so that
/// 0.05 % gives 0.75 mHz, as in recordings of laboratory PMUs.
const FREQUENCY_NOISE_HZ: f64 = 1.5;

/// Reports over which the frequency that the magnitudes are compensated with is taken, s.
const COMPENSATION_SPAN_S: f64 = 0.25;

impl Pmu {
    /// A PMU without faults of its own.
    pub(super) fn sound(rate_fps: f64, nominal_hz: f64, filter_cycles: f64, noise: f64) -> Self {
        Self {
            rate_fps,
            nominal_hz,
            filter_cycles,
            noise,
            skew_s: 0.0,
            angle_error_rad: 0.0,
            frequency_span_cycles: 1.0,
            frequency_lag_s: 0.0,
        }
    }

    /// Time by which a run must go on after the last report, seconds.
    pub(super) fn margin_s(&self) -> f64 {
        let cycles = self.frequency_span_cycles.max(1.0) + 0.5 * self.filter_cycles;
        cycles / self.nominal_hz + self.skew_s.abs()
    }

    /// The record of `count` reports from 0 s on.
    pub(super) fn record(
        &self,
        nodes: &[Node],
        start_ns: i64,
        count: usize,
        random: &mut Random,
    ) -> Record {
        let mut record = Record {
            start_ns,
            rate_fps: self.rate_fps,
            nominal_hz: self.nominal_hz,
            samples: Vec::with_capacity(count),
        };
        let kept = if self.frequency_lag_s > 0.0 {
            (-1.0 / (self.rate_fps * self.frequency_lag_s)).exp()
        } else {
            0.0
        };
        let time_s = |index: usize| index as f64 / self.rate_fps;
        let seen_hz: Vec<f64> = (0..count)
            .map(|index| self.frequency_hz(nodes, time_s(index)))
            .collect();
        let mut frequency_hz = seen_hz.first().copied().unwrap_or(self.nominal_hz);
        for (index, now_hz) in seen_hz.iter().enumerate() {
            frequency_hz += (1.0 - kept) * (now_hz - frequency_hz);
            // The powers are those of another instant.
            let late = whole(index as f64 - self.skew_s * self.rate_fps);
            let [gain, of_power] = [index, late.min(count - 1)]
                .map(|index| self.gain(self.lasting_hz(&seen_hz, index)));
            let (voltage, power) = self.voltage_and_power(nodes, time_s(index), random);
            let frequency_noise_hz = FREQUENCY_NOISE_HZ * self.noise * random.normal();
            record.samples.push(Sample {
                time_ns: record.time_ns(index),
                voltage_pu: voltage.norm() / gain,
                angle_rad: voltage.arg(),
                frequency_hz: frequency_hz + frequency_noise_hz,
                active_pu: power.re / (of_power * of_power),
                reactive_pu: power.im / (of_power * of_power),
                negative_sequence_ratio: f64::NAN,
                quality: Quality::GOOD,
            });
        }
        record
    }

    /// By what the window makes the magnitude of phasors smaller that turn with `frequency_hz`, (1).
    fn gain(&self, frequency_hz: f64) -> f64 {
        let half_cycles = 0.5 * self.filter_cycles;
        let x = PI * half_cycles * (frequency_hz - self.nominal_hz) / self.nominal_hz;
        if x == 0.0 { 1.0 } else { (x.sin() / x).powi(2) }
    }

    /// Median of the frequencies around report `index`.
    fn lasting_hz(&self, seen_hz: &[f64], index: usize) -> f64 {
        let reach = whole(0.5 * COMPENSATION_SPAN_S * self.rate_fps);
        let end = seen_hz.len().min(index + reach + 1);
        let mut around = seen_hz[index.saturating_sub(reach)..end].to_vec();
        around.sort_by(f64::total_cmp);
        around[around.len() / 2]
    }

    /// Voltage and complex power as the window sees them, with noise.
    fn voltage_and_power(
        &self,
        nodes: &[Node],
        time_s: f64,
        random: &mut Random,
    ) -> (Phasor, Phasor) {
        let mut noise = || {
            Phasor::new(
                1.0 + self.noise * random.normal(),
                self.noise * random.normal(),
            )
        };
        let (voltage_noise, current_noise) = (noise(), noise());
        let voltage = self.window(nodes, time_s).0 * voltage_noise;
        let (then, current) = self.window(nodes, time_s - self.skew_s);
        let turned = Phasor::from_polar(1.0, self.angle_error_rad);
        (
            voltage,
            then * voltage_noise * (current * current_noise * turned).conj(),
        )
    }

    /// Nominal frequency plus the change of the angle across the span.
    fn frequency_hz(&self, nodes: &[Node], time_s: f64) -> f64 {
        let span_s = self.frequency_span_cycles / self.nominal_hz;
        let (before, _) = self.window(nodes, time_s - span_s);
        let (after, _) = self.window(nodes, time_s + span_s);
        let turned = (after * before.conj()).arg();
        self.nominal_hz + turned / (2.0 * PI * 2.0 * span_s)
    }

    /// V and I as the window sees them; before the first node and after the last they stand still.
    fn window(&self, nodes: &[Node], time_s: f64) -> (Phasor, Phasor) {
        let half_s = 0.5 * self.filter_cycles / self.nominal_hz;
        if half_s <= 0.0 {
            return phasors_at(nodes, time_s);
        }
        let instants = [time_s - half_s, time_s, time_s + half_s];
        let rising = weighted(nodes, instants[0], instants[1], |t| {
            (t - instants[0]) / half_s
        });
        let falling = weighted(nodes, instants[1], instants[2], |t| {
            (instants[2] - t) / half_s
        });
        // Both halves of the triangle have area half_s/2.
        (
            (rising.0 + falling.0) / half_s,
            (rising.1 + falling.1) / half_s,
        )
    }
}

/// The nearest number of reports, none at least.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a record has thousands of reports"
)]
fn whole(reports: f64) -> usize {
    reports.round().max(0.0) as usize
}

/// Integral of weight times phasors from `from_s` to `to_s`, by Simpson's rule between nodes: exact
/// for a straight weight and straight phasors.
fn weighted(
    nodes: &[Node],
    from_s: f64,
    to_s: f64,
    weight: impl Fn(f64) -> f64,
) -> (Phasor, Phasor) {
    let zero = Phasor::new(0.0, 0.0);
    let mut sum = (zero, zero);
    let mut add = |left: (f64, Phasor, Phasor), right: (f64, Phasor, Phasor)| {
        let width = right.0 - left.0;
        if width <= 0.0 {
            return;
        }
        let (first, last) = (weight(left.0), weight(right.0));
        let middle = 0.5 * (first + last);
        let simpson = |a: Phasor, b: Phasor| {
            (a * first + (a + b) * (2.0 * middle) + b * last) * (width / 6.0)
        };
        sum.0 += simpson(left.1, right.1);
        sum.1 += simpson(left.2, right.2);
    };
    let at = |time_s: f64| {
        let (voltage, current) = phasors_at(nodes, time_s);
        (time_s, voltage, current)
    };
    let first = nodes.partition_point(|node| node.time_s <= from_s);
    let end = nodes.partition_point(|node| node.time_s < to_s);
    let mut left = at(from_s);
    for node in nodes.get(first..end).unwrap_or(&[]) {
        let right = (node.time_s, node.voltage, node.current);
        add(left, right);
        left = right;
    }
    add(left, before(nodes, to_s));
    sum
}

/// Phasors just before `time_s`, where a switching at that very instant has not happened yet.
fn before(nodes: &[Node], time_s: f64) -> (f64, Phasor, Phasor) {
    let next = nodes.partition_point(|node| node.time_s < time_s);
    let (voltage, current) = between(nodes, next, time_s);
    (time_s, voltage, current)
}

/// Phasors at `time_s`, after any switching at that very instant.
fn phasors_at(nodes: &[Node], time_s: f64) -> (Phasor, Phasor) {
    let next = nodes.partition_point(|node| node.time_s <= time_s);
    between(nodes, next, time_s)
}

/// Phasors on the straight line between node `next - 1` and node `next`.
fn between(nodes: &[Node], next: usize, time_s: f64) -> (Phasor, Phasor) {
    let zero = Phasor::new(0.0, 0.0);
    let (left, right) = match (nodes.get(next.wrapping_sub(1)), nodes.get(next)) {
        (Some(left), Some(right)) => (left, right),
        (Some(only), None) | (None, Some(only)) => return (only.voltage, only.current),
        (None, None) => return (zero, zero),
    };
    let width = right.time_s - left.time_s;
    let share = if width > 0.0 {
        (time_s - left.time_s) / width
    } else {
        0.0
    };
    (
        left.voltage + (right.voltage - left.voltage) * share,
        left.current + (right.current - left.current) * share,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pmu(filter_cycles: f64) -> Pmu {
        Pmu::sound(60.0, 60.0, filter_cycles, 0.0)
    }

    /// Voltage 1 before 0.5 s and 0.6 after it, a jump with two nodes.
    fn step() -> Vec<Node> {
        let node = |time_s: f64, v: f64| Node {
            time_s,
            voltage: Phasor::new(v, 0.0),
            current: Phasor::new(1.0, 0.0),
        };
        vec![
            node(0.0, 1.0),
            node(0.3, 1.0),
            node(0.5, 1.0),
            node(0.5, 0.6),
            node(1.0, 0.6),
        ]
    }

    #[test]
    fn a_step_comes_out_as_the_integral_of_the_triangle() {
        let (nodes, pmu) = (step(), pmu(2.0));
        let seen = |time_s: f64| pmu.window(&nodes, time_s).0.re;
        let cycle = 1.0 / 60.0;
        // Half of the window is past the step at its centre; a quarter cycle later
        // 1 - 0.5 (1 - 0.25)^2 = 0.71875 of its area is.
        assert!((seen(0.5 - cycle) - 1.0).abs() < 1e-12);
        assert!((seen(0.5) - 0.8).abs() < 1e-12);
        assert!((seen(0.5 + 0.25 * cycle) - (1.0 - 0.4 * 0.718_75)).abs() < 1e-12);
        assert!((seen(0.5 + cycle) - 0.6).abs() < 1e-12);
    }

    #[test]
    fn without_a_window_a_step_is_a_step() {
        let (nodes, pmu) = (step(), pmu(0.0));
        assert!((pmu.window(&nodes, 0.499_999).0.re - 1.0).abs() < 1e-12);
        assert!((pmu.window(&nodes, 0.5).0.re - 0.6).abs() < 1e-12);
    }

    #[test]
    fn a_turning_phasor_has_the_frequency_with_which_it_turns() {
        let nodes: Vec<_> = (0..=2000)
            .map(|k| {
                let time_s = f64::from(k) * 1e-3;
                let turned = Phasor::from_polar(1.0, 2.0 * PI * -0.3 * time_s);
                Node {
                    time_s,
                    voltage: turned,
                    current: turned,
                }
            })
            .collect();
        let mut random = Random::new(1);
        let record = pmu(2.0).record(&nodes, 0, 110, &mut random);
        let sample = record.samples[60];
        assert!(
            (sample.frequency_hz - 59.7).abs() < 1e-9,
            "{}",
            sample.frequency_hz
        );
        // A triangle over two cycles takes 1 - (sin x/x)^2 with x = pi 0.3/60, 8.2e-5, by hand;
        // nodes a millisecond apart are chords, which are 3e-7 shorter.
        let seen = pmu(2.0).window(&nodes, 1.0).0.norm();
        assert!((1.0 - seen - 8.225e-5).abs() < 5e-7, "{seen}");
        assert!((sample.voltage_pu - 1.0).abs() < 1e-6);
        assert!((sample.active_pu - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_jump_of_the_angle_does_not_change_the_magnitude_that_is_reported() {
        let turned = Phasor::from_polar(1.0, 0.4);
        let before = Phasor::new(1.0, 0.0);
        let node = |time_s, voltage| Node {
            time_s,
            voltage,
            current: voltage,
        };
        let nodes = [
            node(0.0, before),
            node(0.5, before),
            node(0.5, turned),
            node(1.0, turned),
        ];
        let record = pmu(2.0).record(&nodes, 0, 60, &mut Random::new(1));
        let outside = |s: &&Sample| (s.time_ns - 500_000_000).abs() > 17_000_000;
        for sample in record.samples.iter().filter(outside) {
            assert!((sample.voltage_pu - 1.0).abs() < 1e-12, "{sample:?}");
        }
        // 0.4 rad over four cycles.
        let largest = record.samples.iter().map(|s| s.frequency_hz);
        assert!(largest.fold(0.0, f64::max) > 61.9);
    }

    #[test]
    fn noise_has_the_spread_asked_for() {
        let measuring = Pmu {
            noise: 0.002,
            ..pmu(2.0)
        };
        let nodes = [step()[0]];
        let record = measuring.record(&nodes, 0, 4000, &mut Random::new(3));
        let spread = |value: &dyn Fn(&Sample) -> f64, mean: f64| {
            let sum: f64 = record
                .samples
                .iter()
                .map(|s| (value(s) - mean).powi(2))
                .sum();
            (sum / 4000.0).sqrt()
        };
        let voltage = spread(&|s| s.voltage_pu, 1.0);
        let active = spread(&|s| s.active_pu, 1.0);
        // Four standard errors of a spread from 4000 values: 4.5 %.
        assert!((voltage / 0.002 - 1.0).abs() < 0.045, "{voltage}");
        assert!(
            (active / (0.002 * 2.0_f64.sqrt()) - 1.0).abs() < 0.045,
            "{active}"
        );
    }
}
