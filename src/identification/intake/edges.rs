//! Where the voltage jumps: fault inception, clearing, switching; and when exactly.

use super::{
    series::{Series, median, noise_sigma},
    voltage::Log,
};

/// An edge stands out of its surroundings by this many noise deviations. Chosen; insensitive
/// between 6 and 10.
const EDGE_SIGMAS: f64 = 8.0;
/// Least jump of ln|V| + j angle that counts as an edge.
const EDGE_LEAST: f64 = 0.012;
/// Samples over which the ordinary motion is taken, each side, and one for each sample of a longer window.
const SURROUNDINGS: usize = 7;

/// A jump of the terminal phasor between two samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Last sample before the jump that it does not touch.
    pub left: usize,
    /// First sample after it that it does not touch.
    pub right: usize,
    /// Instant of the jump, in samples from the start of the window.
    pub position: f64,
    /// Standard deviation of the instant, samples.
    pub deviation: f64,
    /// What the filter leaves unexplained of the voltage at the samples it spreads the jump over,
    /// relative (root mean square of a part).
    pub mismatch: f64,
}

/// For each step between neighbouring samples, whether it belongs to an edge, which the instrument spreads over
/// `spread` samples more than those of the standard.
pub(super) fn steps_at_edges(series: &Series, spread: usize) -> Vec<bool> {
    let threshold = (EDGE_SIGMAS * input_noise(series)).max(EDGE_LEAST);
    (standing_out(series, SURROUNDINGS + spread).into_iter())
        .map(|size| size > threshold)
        .collect()
}

/// A small jump stands out by this many noise deviations: of noise alone two steps in a thousand do ...
const SMALL_SIGMAS: f64 = 5.0;
/// ... and by this much of ln|V| + j angle.
const SMALL_LEAST: f64 = 0.003;

/// For each step between neighbouring samples, whether a jump may be behind it that is too small for an edge.
pub(super) fn small_steps(series: &Series) -> Vec<bool> {
    let threshold = (SMALL_SIGMAS * input_noise(series)).max(SMALL_LEAST);
    (standing_out(series, SURROUNDINGS).into_iter())
        .map(|size| size > threshold)
        .collect()
}

/// For each step between neighbouring samples, how far it is from the ordinary motion around it.
fn standing_out(series: &Series, surroundings: usize) -> Vec<f64> {
    let steps = log_phasor_steps(series);
    let n = steps.len();
    (0..n)
        .map(|k| {
            let from = k.saturating_sub(surroundings);
            let to = (k + surroundings + 1).min(n);
            let ordinary = |part: usize| {
                let around: Vec<f64> = steps[from..to].iter().map(|s| s[part]).collect();
                median(&around)
            };
            let [re, im] = steps[k];
            (re - ordinary(0)).hypot(im - ordinary(1))
        })
        .collect()
}

/// A filtered jump shows in the step before its largest one by more than this share ...
const BEFORE_SHARE: f64 = 0.03;
/// ... or in the step after it by more than this: of a triangular filter as wide as two sample
/// intervals, one of the two always does. What an unfiltered jump shows there is the load's and the
/// network's own motion.
const AFTER_SHARE: f64 = 0.25;
/// An event is taken as unfiltered only if one of its jumps is at least this large.
const JUMP_CLEAR: f64 = 0.05;

/// A steep step this many samples after a jump is the motion that follows it, ...
const MOTION_AFTER_JUMP: usize = 6;
/// ... unless it is larger than this share of the jump: then it is one itself.
pub(super) const MOTION_SHARE: f64 = 0.4;

/// Standard deviation of an instant that may lie anywhere between two samples.
const HALF_INTERVAL_DEVIATION: f64 = 0.29;

/// The jumps of an event whose samples no filter has spread, each put half way between its two
/// samples; none if any steep step looks filtered.
pub(super) fn unfiltered_jumps(phasor: &[Log], at_edge: &[bool]) -> Option<Vec<Edge>> {
    let mut list: Vec<Edge> = Vec::new();
    let mut largest = 0.0_f64;
    for k in (0..at_edge.len()).filter(|&k| at_edge[k]) {
        if let Some(size) = unfiltered_jump(phasor, k) {
            largest = largest.max(size);
            list.push(Edge {
                left: k,
                right: k + 1,
                position: k as f64 + 0.5,
                deviation: HALF_INTERVAL_DEVIATION,
                mismatch: 0.0,
            });
        } else if list.last().is_none_or(|jump| {
            let size = distance(phasor[jump.left], phasor[jump.right]);
            let large = distance(phasor[k], phasor[k + 1]) > MOTION_SHARE * size;
            large || k > jump.left + MOTION_AFTER_JUMP
        }) {
            return None;
        }
    }
    (largest >= JUMP_CLEAR).then_some(list)
}

/// The size of step `at` if it is a jump whose neighbours show no filter.
fn unfiltered_jump(phasor: &[Log], at: usize) -> Option<f64> {
    if at < 2 || at + 2 >= phasor.len() {
        return None;
    }
    let step = |k: usize| phasor[k + 1] - phasor[k];
    let jump = step(at);
    let square = jump.norm_sqr();
    let share = |x: Log| (x * jump.conj()).re / square;
    // The trend before the jump goes on for one more step.
    let (last, trend) = (step(at - 1), step(at - 2));
    let before = share(last - trend);
    let alone = share(last) <= AFTER_SHARE && share(step(at + 1)) <= AFTER_SHARE;
    (before.abs() <= BEFORE_SHARE && alone).then_some(square.sqrt())
}

/// For each sample, the distance to the nearest edge in samples; infinite without one.
pub(super) fn distance_to_edge(at_edge: &[bool], samples: usize) -> Vec<f64> {
    let middles: Vec<f64> = (0..at_edge.len())
        .filter(|&k| at_edge[k])
        .map(|k| k as f64 + 0.5)
        .collect();
    (0..samples)
        .map(|k| {
            middles
                .iter()
                .map(|m| (m - k as f64).abs())
                .fold(f64::INFINITY, f64::min)
        })
        .collect()
}

/// Distance of two log-phasors.
pub(super) fn distance(a: Log, b: Log) -> f64 {
    (b - a).norm()
}

/// Noise of ln|V| + j angle per part: the larger of the two.
pub(super) fn input_noise(series: &Series) -> f64 {
    let log: Vec<f64> = series.voltage.iter().map(|v| v.max(1e-3).ln()).collect();
    noise_sigma(&log).max(noise_sigma(&series.angle))
}

fn log_phasor_steps(series: &Series) -> Vec<[f64; 2]> {
    (1..series.len())
        .map(|k| {
            let ratio = series.voltage[k].max(1e-3) / series.voltage[k - 1].max(1e-3);
            [ratio.ln(), series.angle[k] - series.angle[k - 1]]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step_at(instant: f64, half_width: f64) -> Vec<Log> {
        let distribution = |x: f64| match x {
            x if x <= -1.0 => 0.0,
            x if x <= 0.0 => 0.5 * (1.0 + x) * (1.0 + x),
            x if x <= 1.0 => 1.0 - 0.5 * (1.0 - x) * (1.0 - x),
            _ => 1.0,
        };
        (0..12)
            .map(|k| {
                Log::new(
                    -0.4 * distribution((f64::from(k) - instant) / half_width),
                    0.0,
                )
            })
            .collect()
    }

    fn edges_of(phasor: &[Log]) -> Vec<bool> {
        phasor
            .windows(2)
            .map(|w| distance(w[0], w[1]) > 0.012)
            .collect()
    }

    #[test]
    fn a_jump_behind_a_filter_is_never_taken_for_an_unfiltered_one() {
        for tenth in 0..10 {
            let phasor = step_at(5.0 + 0.1 * f64::from(tenth), 1.0);
            assert!(unfiltered_jumps(&phasor, &edges_of(&phasor)).is_none());
        }
    }

    #[test]
    fn an_unfiltered_jump_is_put_half_way_between_its_samples() {
        let phasor = step_at(5.3, 1e-9);
        let found = unfiltered_jumps(&phasor, &edges_of(&phasor)).unwrap();
        assert_eq!(
            found,
            [Edge {
                left: 5,
                right: 6,
                position: 5.5,
                deviation: HALF_INTERVAL_DEVIATION,
                mismatch: 0.0,
            }]
        );
    }
}
