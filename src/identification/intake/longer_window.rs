//! A phasor window longer than those of the standard, recognised from how it spreads the jumps of the
//! voltage: no model of the load takes part.
//!
//! Whatever the load does, a fault begins and ends within a millisecond. How many samples its two
//! jumps are spread over is the instrument's doing, and the same in every event.

use super::{
    super::phasor_filter::{LongerWindow, PhasorFilter, WindowShape},
    edges, jumps, operating_point,
    prepare::{NOISE_LEAST, VOLTAGE_MIN_PU, terminal_log},
    series::Series,
    spikes,
    voltage::Log,
};
use crate::disturbance::Window;

/// Usable samples of an event that is asked.
const SAMPLES_MIN: usize = 20;

/// Whole widths of a triangle that are tried first, nominal cycles. The shortest is clearly longer than the windows of the
/// standard.
const TRIANGLES: [f64; 7] = [2.6, 3.2, 4.0, 5.0, 6.5, 9.0, 12.0];
/// Means as wide as this share of the best triangle spread a jump as much, or nearly so.
const MEANS: [f64; 3] = [0.6, 0.7, 0.8];
/// The least width of a mean: over 1.4 cycles it spreads a jump as the triangle of the standard does.
const MEAN_LEAST_CYCLES: f64 = 2.0;
/// Then these further and nearer, twentieths of a cycle.
const CLOSER: [u16; 4] = [10, 5, 2, 1];
/// What one looks at before all of it.
const PROBED: [f64; 2] = [3.2, 5.0];
/// Events that the width is taken from: those with the largest jumps.
const PROBED_EVENTS: usize = 3;

/// A longer window leaves at most this share of what those of the standard leave of the jumps, ...
const LEAVES_SHARE_MAX: f64 = 0.7;
/// ... and less by this much, in all events ...
const LEAVES_LESS: f64 = 100.0;
/// ... and in this share of those that have jumps, ...
const EVENTS_SHARE_MIN: f64 = 0.65;
/// ... and explains this share of the jumps, ...
const EXPLAINED_SHARE_MIN: f64 = 0.5;
/// ... so many at least.
const EXPLAINED_MIN: usize = 2;

/// The window that the jumps of all these events show, where it is longer than those of the standard.
#[must_use]
pub fn longer_window(windows: &[Window]) -> Option<LongerWindow> {
    let mut events: Vec<Jumping> = windows.iter().filter_map(Jumping::read).collect();
    events.sort_by(|a, b| b.largest.total_cmp(&a.largest));
    let probed = &events[..events.len().min(PROBED_EVENTS)];
    let standard = of_standard(probed);
    let left = |seen: &[Seen]| seen.iter().map(|s| s.left).sum::<f64>();
    let promising = PROBED.iter().any(|cycles| {
        let seen = through(probed, triangle(*cycles));
        left(&seen) < left(&standard) - LEAVES_LESS
    });
    if !promising {
        return None;
    }
    let best = best_window(probed)?;
    is_recognised(&of_standard(&events), &through(&events, best)).then_some(best)
}

fn triangle(cycles: f64) -> LongerWindow {
    window(WindowShape::Triangle, cycles)
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "some cycles"
)]
fn window(shape: WindowShape, cycles: f64) -> LongerWindow {
    LongerWindow {
        shape,
        twentieths: (20.0 * cycles).round() as u16,
    }
}

/// The least width that is clearly longer than the windows of the standard.
const fn least_cycles(shape: WindowShape) -> f64 {
    match shape {
        WindowShape::Mean => MEAN_LEAST_CYCLES,
        WindowShape::Triangle => TRIANGLES[0],
    }
}

/// The window that leaves least.
fn best_window(events: &[Jumping]) -> Option<LongerWindow> {
    let left = |window: LongerWindow| {
        let seen = through(events, window);
        seen.iter().map(|s| s.left).sum::<f64>()
    };
    let by_left = |a: &(f64, LongerWindow), b: &(f64, LongerWindow)| a.0.total_cmp(&b.0);
    let tried = |window: LongerWindow| (left(window), window);
    let (mut least, mut best) = (TRIANGLES.map(triangle).into_iter())
        .map(tried)
        .min_by(by_left)?;
    let means = MEANS.map(|share| (share * best.cycles()).max(MEAN_LEAST_CYCLES));
    let means = means.map(|cycles| tried(window(WindowShape::Mean, cycles)));
    if let Some((leaves, mean)) = means.into_iter().min_by(by_left)
        && leaves < least
    {
        (least, best) = (leaves, mean);
    }
    for step in CLOSER {
        for twentieths in [best.twentieths - step, best.twentieths + step] {
            let other = LongerWindow { twentieths, ..best };
            if other.cycles() < least_cycles(best.shape) {
                continue;
            }
            let leaves = left(other);
            if leaves < least {
                (least, best) = (leaves, other);
            }
        }
    }
    Some(best)
}

/// Whether what the jumps of all events leave, seen through the windows of the standard and a longer one, speaks for
/// the longer one.
fn is_recognised(standard: &[Seen], longer: &[Seen]) -> bool {
    let total = |seen: &[Seen]| seen.iter().map(|s| s.left).sum::<f64>();
    let (before, after) = (total(standard), total(longer));
    let less = standard.iter().zip(longer).filter(|(s, l)| l.left < s.left);
    let events = less.count() as f64;
    let jumps: usize = longer.iter().map(|s| s.jumps).sum();
    let explained: usize = longer.iter().map(|s| s.explained).sum();
    after <= LEAVES_SHARE_MAX * before
        && after <= before - LEAVES_LESS
        && events >= EVENTS_SHARE_MIN * standard.len() as f64
        && explained >= EXPLAINED_MIN
        && explained as f64 >= EXPLAINED_SHARE_MIN * jumps as f64
}

/// An event with steep steps in its voltage.
struct Jumping {
    series: Series,
    log: Vec<Log>,
    steep: Vec<bool>,
    noise: f64,
    /// Largest step of the voltage.
    largest: f64,
}

/// What the jumps of an event leave, seen through a window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    pub(super) left: f64,
    pub(super) jumps: usize,
    pub(super) explained: usize,
}

impl Jumping {
    /// None without steep steps, and where no filter has spread them.
    fn read(window: &Window) -> Option<Self> {
        let mut series = Series::read(&window.record)?;
        spikes::remove(&mut series);
        if series.bad.iter().filter(|bad| !**bad).count() < SAMPLES_MIN {
            return None;
        }
        let widest = TRIANGLES.into_iter().fold(0.0, f64::max);
        let steep = edges::steps_at_edges(&series, samples_of(widest, &series));
        if !steep.contains(&true) {
            return None;
        }
        let before = operating_point::find(&series, &steep, window.onset);
        if !(before.voltage.is_finite() && before.voltage > VOLTAGE_MIN_PU) {
            return None;
        }
        let log = terminal_log(&series, &before);
        if edges::unfiltered_jumps(&log, &steep).is_some() {
            return None;
        }
        let noise = edges::input_noise(&series).max(NOISE_LEAST);
        let steps = (0..steep.len()).filter(|&k| steep[k]);
        let largest = steps.map(|k| edges::distance(log[k], log[k + 1]));
        Some(Self {
            largest: largest.fold(0.0, f64::max),
            series,
            log,
            steep,
            noise,
        })
    }

    fn seen_through(&self, filter: PhasorFilter) -> Seen {
        jumps::seen_through(&self.series, &self.log, &self.steep, self.noise, filter)
    }
}

/// Samples within so many nominal cycles.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "some samples"
)]
pub(super) fn samples_of(cycles: f64, series: &Series) -> usize {
    (cycles * series.samples_per_cycle()).ceil() as usize
}

fn through(events: &[Jumping], window: LongerWindow) -> Vec<Seen> {
    let seen = |event: &Jumping| event.seen_through(PhasorFilter::Longer(window));
    events.iter().map(seen).collect()
}

/// Through whichever window of the standard leaves less.
fn of_standard(events: &[Jumping]) -> Vec<Seen> {
    let least = |event: &Jumping| {
        let [one, other] =
            [PhasorFilter::PClass, PhasorFilter::OneCycle].map(|filter| event.seen_through(filter));
        if other.left < one.left { other } else { one }
    };
    events.iter().map(least).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(left: f64, explained: usize) -> Seen {
        Seen {
            left,
            jumps: 2,
            explained,
        }
    }

    #[test]
    fn a_longer_window_must_explain_jumps_in_most_events() {
        let standard = [seen(900.0, 0), seen(400.0, 0), seen(300.0, 1)];
        let judged = |longer: [Seen; 3]| is_recognised(&standard, &longer);
        assert!(judged([seen(60.0, 2), seen(50.0, 2), seen(40.0, 1)]));
        // Most of what was left, in one event only, and jumps that stay what they are.
        assert!(!judged([seen(700.0, 2), seen(380.0, 2), seen(290.0, 1)]));
        assert!(!judged([seen(20.0, 2), seen(410.0, 2), seen(310.0, 1)]));
        assert!(!judged([seen(60.0, 1), seen(50.0, 1), seen(40.0, 0)]));
        assert!(!is_recognised(&[seen(120.0, 0)], &[seen(30.0, 2)]));
    }

    #[test]
    fn no_event_shows_no_window() {
        assert_eq!(longer_window(&[]), None);
        assert!(
            triangle(5.0)
                .in_words()
                .contains("triangle over 5.0 nominal")
        );
    }
}
