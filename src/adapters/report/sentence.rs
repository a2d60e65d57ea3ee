//! What a figure shows, in one sentence: when the model is off, by how much, and how that compares
//! with the noise.

use super::{event::Power, number};
use crate::identification::Comparison;

/// Length of the moving mean that a stretch is judged by, seconds.
const MEAN_OVER_S: f64 = 0.1;
/// A mean counts as off when it is this many of its own standard deviations away from zero: with a
/// hundred means per event, chance alone reaches it in less than one event of ten thousand.
const SIGNIFICANT_SIGMA: f64 = 5.0;

/// A stretch over which a model is off to one side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stretch {
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    /// Mean of measured minus modelled, pu.
    pub(super) mean_pu: f64,
    /// Mean of residual over noise, signed.
    pub(super) to_noise: f64,
}

/// One sentence on P or Q of `comparison`.
pub(super) fn sentence(power: Power, comparison: &Comparison) -> String {
    let letter = power.letter();
    let Some(stretch) = worst_stretch(power, comparison) else {
        return format!("{letter}: nothing but noise away from the voltage edges.");
    };
    let side = if stretch.mean_pu < 0.0 { "high" } else { "low" };
    let share = before_event(power, comparison).map_or_else(String::new, |initial| {
        let percent = 100.0 * stretch.mean_pu.abs() / initial.abs();
        format!(
            " ({} % of {letter} before the event)",
            number::significant(percent, 2)
        )
    });
    format!(
        "{letter}: the model is too {side} by {} pu{share}, {} times the noise, from {} s to {} s.",
        number::significant(stretch.mean_pu.abs(), 2),
        number::significant(stretch.to_noise.abs(), 2),
        number::fixed(stretch.from_s, 2),
        number::fixed(stretch.to_s, 2),
    )
}

/// The stretch after the onset over which the model is furthest off, weighed by its duration; none
/// when the residual away from the edges is noise.
pub(super) fn worst_stretch(power: Power, comparison: &Comparison) -> Option<Stretch> {
    let judged = judged_samples(power, comparison);
    let half = half_width(comparison);
    let means: Vec<_> = (0..judged.len())
        .map(|k| mean_about(&judged, k, half))
        .collect();
    let mut worst: Option<(f64, Stretch)> = None;
    let mut first = 0;
    while first < judged.len() {
        let run = run_of_one_sign(&means[first..]);
        if run > 0 {
            let stretch = summed_up(&judged[first..first + run]);
            let weight = stretch.to_noise.abs() * run as f64;
            if worst.is_none_or(|(heaviest, _)| weight > heaviest) {
                worst = Some((weight, stretch));
            }
        }
        first += run.max(1);
    }
    worst.map(|(_, stretch)| stretch)
}

/// A sample that may be judged: time, residual, residual over noise.
#[derive(Clone, Copy)]
struct Judged {
    time_s: f64,
    residual_pu: f64,
    to_noise: f64,
}

fn judged_samples(power: Power, comparison: &Comparison) -> Vec<Judged> {
    let residual = power.residual(comparison);
    let noise = power.noise(comparison);
    (0..comparison.time_s.len())
        .filter(|&k| comparison.time_s[k] >= 0.0)
        .filter(|&k| comparison.used[k] && !comparison.near_edge[k])
        .filter(|&k| residual[k].is_finite() && noise[k] > 0.0)
        .map(|k| Judged {
            time_s: comparison.time_s[k],
            residual_pu: residual[k],
            to_noise: residual[k] / noise[k],
        })
        .collect()
}

/// Samples to each side of a mean's centre.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to 1..=1000 in the same expression"
)]
fn half_width(comparison: &Comparison) -> usize {
    let time = &comparison.time_s;
    let step = match (time.first(), time.last()) {
        (Some(first), Some(last)) if time.len() > 1 => (last - first) / (time.len() - 1) as f64,
        _ => MEAN_OVER_S,
    };
    (MEAN_OVER_S / step / 2.0).clamp(1.0, 1000.0) as usize
}

/// Mean of residual over noise about sample `k` in units of its own standard deviation.
fn mean_about(judged: &[Judged], k: usize, half: usize) -> f64 {
    let about = &judged[k.saturating_sub(half)..(k + half + 1).min(judged.len())];
    let sum: f64 = about.iter().map(|sample| sample.to_noise).sum();
    sum / (about.len() as f64).sqrt()
}

/// How many of `means` from the first on are off to the same side.
fn run_of_one_sign(means: &[f64]) -> usize {
    let side = means.first().map_or(0.0, |mean| mean.signum());
    means
        .iter()
        .take_while(|mean| side * **mean > SIGNIFICANT_SIGMA)
        .count()
}

fn summed_up(run: &[Judged]) -> Stretch {
    let count = run.len().max(1) as f64;
    Stretch {
        from_s: run.first().map_or(0.0, |sample| sample.time_s),
        to_s: run.last().map_or(0.0, |sample| sample.time_s),
        mean_pu: run.iter().map(|sample| sample.residual_pu).sum::<f64>() / count,
        to_noise: run.iter().map(|sample| sample.to_noise).sum::<f64>() / count,
    }
}

/// Median before the onset, pu; none where it is zero or nothing was measured.
fn before_event(power: Power, comparison: &Comparison) -> Option<f64> {
    let mut values: Vec<_> = comparison
        .time_s
        .iter()
        .zip(power.measured(comparison))
        .filter(|(time, value)| **time < 0.0 && value.is_finite())
        .map(|(_, value)| *value)
        .collect();
    values.sort_by(f64::total_cmp);
    values
        .get(values.len() / 2)
        .copied()
        .filter(|value| value.abs() > 1e-6)
}

#[cfg(test)]
mod tests {
    use super::{super::fixture, *};

    #[test]
    fn the_worst_stretch_is_where_the_model_overshoots() {
        let comparison = fixture::comparison("event_01", 0.7);
        let stretch = worst_stretch(Power::Active, &comparison).unwrap();
        assert!(stretch.from_s < 0.3 && stretch.to_s > 0.5, "{stretch:?}");
        assert!(
            stretch.mean_pu < -0.002 && stretch.to_noise < -2.0,
            "{stretch:?}"
        );
        let words = sentence(Power::Active, &comparison);
        assert!(
            words.starts_with("P: the model is too high by 0.00"),
            "{words}"
        );
    }

    #[test]
    fn noise_alone_is_called_noise() {
        let comparison = fixture::comparison("event_01", 0.7);
        assert_eq!(worst_stretch(Power::Reactive, &comparison), None);
        let words = sentence(Power::Reactive, &comparison);
        assert!(words.contains("nothing but noise"), "{words}");
    }

    #[test]
    fn an_event_without_samples_has_no_worst_stretch() {
        let comparison = fixture::without_samples("none");
        assert_eq!(worst_stretch(Power::Active, &comparison), None);
    }
}
