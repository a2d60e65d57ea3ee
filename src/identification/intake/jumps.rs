//! The instants of jumps, and the filter that explains how they look.
//!
//! A jump behind a filter shows in the two to nine samples whose windows hold it. Its instant is the one
//! at which what lies on either side, seen through the filter, meets these samples (`voltage`, (1)).
//! A motion that no filter explains is no jump: a slow ramp, or several jumps within one window.

use super::{
    super::phasor_filter::{FilterChoice, PhasorFilter},
    edges::{Edge, MOTION_SHARE, distance, small_steps, unfiltered_jumps},
    longer_window::Seen,
    series::Series,
    voltage::{Jump, Log, Measured, Voltage},
};

mod instant;
mod small;

use instant::{bent, deviation, instant, within};

/// Samples each side of a cluster of jumps that take part in finding the instants.
const AROUND: usize = 8;
/// The instant is sought this far before the steepest step and after it, samples.
const BEFORE: f64 = 0.8;
const AFTER: f64 = 1.8;
/// Behind a longer window the middle of the steep steps is no better known than this, samples.
const BEFORE_MIDDLE: f64 = 1.8;
/// Steps of at least this share of the steepest one belong to the same jump behind a longer window.
const STEEP_SHARE: f64 = 0.5;
/// Instants that were sought together are taken where they leave less by this: two standard deviations.
const BETTER: f64 = 4.0;
/// Where samples are few, a jump is taken where without it more than this much more is left.
const NEEDED: f64 = 12.0;
/// Distance of the instants that are tried first, and least distance of two jumps, samples.
const COARSE: f64 = 0.2;
const LEAST_APART: f64 = 0.1;
/// More jumps than this close to each other are a flicker: a motion that no instants explain, and whose instants would
/// take minutes to find.
const FLICKER: usize = 16;
/// A jump is explained if what remains is below this share of it plus three times the noise.
const UNEXPLAINED_SHARE: f64 = 0.05;
/// The mean over one cycle is taken instead of the triangle, which streams of PMUs have, only if its
/// misfit is lower by this share and this much more: where a jump falls on a sample of a stream of one
/// sample per cycle, both look the same.
const CONVINCING_SHARE: f64 = 0.1;
const CONVINCING: f64 = 15.0;
/// Of the change from before the filter's window to after it at least this share is the jump itself;
/// less is a ramp.
const HEIGHT_SHARE: f64 = 0.5;
/// The same where the filter's window is short: the change then spans three samples of whatever moves, and that the
/// jump is needed has been shown.
const HEIGHT_SHARE_SHORT: f64 = 0.25;
/// Where the filter's window is shorter than this many samples one or two of them hold all that tells a jump from a
/// bend, and what lies on either side may bend at will: a jump is then preferred to be this share of the change ...
const SHORT_WINDOW: f64 = 1.5;
const HEIGHT_EXPECTED: f64 = 0.9;
/// ... with this standard deviation, where the change is at least this large.
const HEIGHT_DEVIATION: f64 = 0.15;
const LARGE: f64 = 0.05;
/// Time within which a steep step that is smaller by [`MOTION_SHARE`] is the motion that follows a jump, seconds.
const MOTION_S: f64 = 0.06;
/// Several jumps close to each other imitate one that a longer window has spread: each has to explain as much as its
/// instant and height could of noise.
const PER_JUMP: f64 = 25.0;
/// Third derivative to be expected while instants are sought, 1/s^3: a swing of 0.3 rad at 6 rad/s.
const ORDINARY_STIFFNESS: f64 = 65.0;

/// Jumps of an event and what spread them.
pub(super) struct Found {
    /// What remains to be minimised with the jumps known.
    pub(super) measured: Measured,
    /// Jumps that are explained, with what is reported of each.
    pub(super) jumps: Vec<(Jump, Edge)>,
    /// The filter; none where no jump shows it.
    pub(super) filter: Option<PhasorFilter>,
    /// Steps that belong to no explained jump.
    pub(super) unexplained: Vec<bool>,
}

/// Finds the jumps among the steep steps.
pub(super) fn find(
    series: &Series,
    log: &[Log],
    steep: &[bool],
    noise: f64,
    choice: FilterChoice,
) -> Found {
    let measured = |filter: PhasorFilter| problem(series, log, noise, filter);
    let unfiltered = unfiltered_jumps(log, steep);
    let shapes = match (choice, &unfiltered) {
        (FilterChoice::Fixed(filter), _) => vec![filter],
        (FilterChoice::Auto, Some(_)) => vec![PhasorFilter::None],
        (FilterChoice::Auto, None) => vec![PhasorFilter::PClass, PhasorFilter::OneCycle],
    };
    let small = small_steps(series);
    let mut best: Option<(f64, Vec<Jump>, Vec<Located>, Measured)> = None;
    for filter in shapes {
        let problem = measured(filter);
        let candidates = if filter == PhasorFilter::None {
            unfiltered_candidates(log, unfiltered.as_deref().unwrap_or(&[]))
        } else {
            candidates(&problem, steep)
        };
        let (mut located, mut misfit, _) = located(&problem, &candidates);
        let (more, left) = small::located(&problem, steep, &small);
        located.extend(more);
        located.sort_by_key(|l| l.jump.anchor);
        if candidates.is_empty() {
            misfit = left;
        }
        let convincing = |b: f64| misfit < (1.0 - CONVINCING_SHARE) * b - CONVINCING;
        if best.as_ref().is_none_or(|b| convincing(b.0)) {
            best = Some((misfit, candidates, located, problem));
        }
    }
    let Some((_, candidates, located, mut problem)) = best else {
        return Found {
            measured: measured(PhasorFilter::None),
            jumps: Vec::new(),
            filter: None,
            unexplained: steep.to_vec(),
        };
    };
    let jumps: Vec<(Jump, Edge)> = located
        .iter()
        .filter(|l| l.explained)
        .map(|l| (l.jump, l.edge(&problem)))
        .collect();
    let is_swing = |k: usize| {
        let nearest = candidates.iter().min_by_key(|c| c.anchor.abs_diff(k));
        nearest.is_some_and(|c| located.iter().all(|l| l.jump.anchor != c.anchor))
    };
    let mut unexplained = unexplained(&problem, steep, &jumps);
    for (k, unexplained) in unexplained.iter_mut().enumerate() {
        *unexplained &= !is_swing(k);
    }
    for (k, size) in problem.steep.iter_mut().enumerate() {
        if unexplained[k] {
            *size = distance(log[k], log[k + 1]);
        }
    }
    let filter = (!jumps.is_empty()).then_some(problem.filter);
    Found {
        measured: problem,
        jumps,
        filter,
        unexplained,
    }
}

/// What the jumps of an event leave of its voltage, seen through a filter.
pub(super) fn seen_through(
    series: &Series,
    log: &[Log],
    steep: &[bool],
    noise: f64,
    filter: PhasorFilter,
) -> Seen {
    let problem = Measured {
        rough: true,
        ..problem(series, log, noise, filter)
    };
    let (located, misfit, samples) = located(&problem, &candidates(&problem, steep));
    Seen {
        // Of noise alone the two parts of each sample leave two.
        left: misfit - 2.0 * samples as f64 + PER_JUMP * located.len() as f64,
        jumps: located.len(),
        explained: located.iter().filter(|l| l.explained).count(),
    }
}

/// What is known before the jumps are.
fn problem(series: &Series, log: &[Log], noise: f64, filter: PhasorFilter) -> Measured {
    Measured {
        rough: false,
        log: log.to_vec(),
        bad: series.bad.clone(),
        noise,
        interval_s: 1.0 / series.rate_fps,
        stiffness: vec![ORDINARY_STIFFNESS; log.len()],
        steep: vec![0.0; log.len() - 1],
        half_width: filter.half_width_cycles() * series.rate_fps / series.nominal_hz,
        filter,
    }
}

/// A jump with its instant.
struct Located {
    jump: Jump,
    deviation: f64,
    mismatch: f64,
    explained: bool,
}

impl Located {
    fn edge(&self, measured: &Measured) -> Edge {
        let (left, right) = if measured.filter == PhasorFilter::None {
            (self.jump.anchor, self.jump.anchor + 1)
        } else {
            spread_between(measured, &self.jump)
        };
        Edge {
            left,
            right,
            position: self.jump.position,
            deviation: self.deviation,
            mismatch: self.mismatch,
        }
    }
}

/// Last sample before and first sample after the ones a jump is spread over.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped to the samples"
)]
fn spread_between(measured: &Measured, jump: &Jump) -> (usize, usize) {
    let last = measured.log.len() - 1;
    let left = (jump.position - measured.half_width).floor().max(0.0) as usize;
    let right = (jump.position + measured.half_width).ceil() as usize;
    (left.min(last), right.min(last))
}

fn unfiltered_candidates(log: &[Log], edges: &[Edge]) -> Vec<Jump> {
    edges
        .iter()
        .map(|edge| Jump {
            anchor: edge.left,
            position: edge.position,
            change: log[edge.right] - log[edge.left],
        })
        .collect()
}

/// The steepest step of each jump, in order of time: larger ones first claim what the filter spreads
/// and the motion that follows.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a filter spans a handful of samples"
)]
fn candidates(measured: &Measured, steep: &[bool]) -> Vec<Jump> {
    let log = &measured.log;
    let step = |k: usize| log[k + 1] - log[k];
    let reach = measured.half_width.ceil() as usize;
    let motion = (MOTION_S / measured.interval_s).round() as usize;
    let mut order: Vec<usize> = (0..steep.len()).filter(|&k| steep[k]).collect();
    order.sort_by(|&a, &b| step(b).norm().total_cmp(&step(a).norm()).then(a.cmp(&b)));
    // The recovery after a jump goes on its way with ever smaller steps.
    let fades = |a: usize, k: usize| {
        let same_way = |i: usize| (step(i) * step(a).conj()).re > 0.0;
        measured.has_short_window()
            && a < k
            && (a..=k).all(same_way)
            && step(k).norm() <= step(k - 1).norm()
    };
    let mut anchors: Vec<usize> = Vec::new();
    for k in order {
        let claimed = anchors.iter().any(|&a| {
            let apart = a.abs_diff(k);
            let same_way = (step(k) * step(a).conj()).re > 0.0;
            let smaller = step(k).norm() < MOTION_SHARE * step(a).norm();
            apart < 2
                || (apart <= 2 * reach && (same_way || smaller))
                || (apart <= reach + motion && smaller)
                || fades(a, k)
        });
        let inside = k >= reach + 3 && k + reach + 5 < log.len();
        if !claimed && inside {
            anchors.push(k);
        }
    }
    if measured.is_longer() {
        for anchor in &mut anchors {
            *anchor = middle_of_steep(&step, *anchor, steep.len());
        }
    }
    anchors.sort_unstable();
    // A ramp longer than the window has one middle for several anchors.
    anchors.dedup();
    let last = log.len() - 1;
    anchors
        .into_iter()
        .map(|anchor| Jump {
            anchor,
            position: anchor as f64 + 0.5,
            change: log[(anchor + 1 + reach).min(last)] - log[anchor.saturating_sub(reach)],
        })
        .collect()
}

/// The middle of the steps around the steepest one that are as steep: a long window has many.
fn middle_of_steep(step: &impl Fn(usize) -> Log, steepest: usize, steps: usize) -> usize {
    let peak = step(steepest);
    let as_steep = |k: &usize| (step(*k) * peak.conj()).re >= STEEP_SHARE * peak.norm_sqr();
    let before = (0..steepest).rev().take_while(as_steep).count();
    let after = (steepest + 1..steps).take_while(as_steep).count();
    steepest + after.saturating_sub(before) / 2 - before.saturating_sub(after).div_ceil(2)
}

/// Finds the instants, cluster by cluster, and what they leave of the voltage at so many samples.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a filter spans a handful of samples"
)]
fn located(measured: &Measured, candidates: &[Jump]) -> (Vec<Located>, f64, usize) {
    let reach = measured.half_width.ceil() as usize;
    let last = measured.log.len() - 1;
    let mut list = Vec::with_capacity(candidates.len());
    let (mut misfit, mut samples) = (0.0, 0);
    let mut start = 0;
    while start < candidates.len() {
        let mut end = start + 1;
        while end < candidates.len()
            && candidates[end].anchor - candidates[end - 1].anchor <= 2 * reach + AROUND
        {
            end += 1;
        }
        let from = candidates[start].anchor.saturating_sub(reach + AROUND);
        let from = start.checked_sub(1).map_or(from, |previous| {
            from.max(candidates[previous].anchor + reach + 2)
        });
        let to = (candidates[end - 1].anchor + reach + AROUND + 1).min(last);
        let to = candidates
            .get(end)
            .map_or(to, |next| to.min(next.anchor - reach - 1));
        let (found, left) = cluster(measured, (from, to), &candidates[start..end]);
        list.extend(found);
        misfit += left;
        samples += (from..=to).filter(|&k| !measured.bad[k]).count();
        start = end;
    }
    refuse_ramps(measured, &mut list);
    (list, misfit, samples)
}

/// Behind a filter two jumps the same way, close to each other, look like a ramp: neither is taken.
fn refuse_ramps(measured: &Measured, list: &mut [Located]) {
    /// Nominal cycles between them: more than two windows of the wider filter of the standard ...
    const CLOSE: f64 = 4.5;
    /// ... and windows of a longer one.
    const CLOSE_WINDOWS: f64 = 2.25;
    if measured.filter == PhasorFilter::None {
        return;
    }
    let half_width_cycles = measured.filter.half_width_cycles();
    let cycle = measured.half_width / half_width_cycles;
    let close = CLOSE.max(CLOSE_WINDOWS * 2.0 * half_width_cycles);
    let step = |jump: &Jump| measured.log[jump.anchor + 1] - measured.log[jump.anchor];
    for index in 1..list.len() {
        let (before, after) = (list[index - 1].jump, list[index].jump);
        let same_way = (step(&before) * step(&after).conj()).re > 0.0;
        let close = after.position - before.position <= close * cycle;
        if same_way && close {
            list[index - 1].explained = false;
            list[index].explained = false;
        }
    }
}

impl Measured {
    /// Whether the window is longer than those of the standard.
    const fn is_longer(&self) -> bool {
        matches!(self.filter, PhasorFilter::Longer(_))
    }

    /// Whether so few samples hold a jump that what lies on either side of it may stand in for it.
    pub(super) fn has_short_window(&self) -> bool {
        let width = 2.0 * self.half_width;
        0.0 < width && width <= SHORT_WINDOW
    }
}

/// Jumps at their instants, the voltage with them, and what it leaves.
struct Settled {
    jumps: Vec<Jump>,
    fit: Option<Voltage>,
    left: f64,
}

/// Jumps at the instants found one after the other and then again.
fn descended(measured: &Measured, range: (usize, usize), mut jumps: Vec<Jump>) -> Settled {
    let mut fit = Voltage::fit(measured, range, &jumps, None);
    if measured.filter != PhasorFilter::None {
        let once = jumps.len() == 1 || measured.rough;
        let rounds = if once { 1 } else { 3 };
        for _ in 0..rounds {
            for index in 0..jumps.len() {
                jumps[index].position = instant(measured, range, &jumps, index, fit.as_ref());
                fit = Voltage::fit(measured, range, &jumps, fit.as_ref());
            }
        }
    }
    let left = fit.as_ref().map_or(f64::INFINITY, |fit| {
        let bent = |index: usize| bent(measured, fit, index);
        fit.objective + (0..jumps.len()).map(bent).sum::<f64>()
    });
    Settled { jumps, fit, left }
}

/// The instants of jumps close to each other, one after the other and then again, and what all candidates leave.
fn cluster(measured: &Measured, range: (usize, usize), candidates: &[Jump]) -> (Vec<Located>, f64) {
    let unexplained = |jump: &Jump| Located {
        jump: *jump,
        deviation: f64::INFINITY,
        mismatch: f64::INFINITY,
        explained: false,
    };
    let none_explained = |jumps: &[Jump]| {
        let squares = jumps.iter().map(|j| (j.size() / measured.noise).powi(2));
        (jumps.iter().map(unexplained).collect(), squares.sum())
    };
    if measured.filter != PhasorFilter::None && candidates.len() > FLICKER {
        return none_explained(candidates);
    }
    let all = settled(measured, range, candidates);
    let Some(misfit) = all.fit.as_ref().map(|fit| fit.objective) else {
        return none_explained(candidates);
    };
    let Settled { jumps, fit, .. } = if measured.has_short_window() {
        needed(measured, range, candidates, all)
    } else {
        all
    };
    let Some(fit) = fit else {
        return none_explained(&jumps);
    };
    let is_high = |index: usize| {
        if measured.has_short_window() {
            fit.share_of_change(index) >= HEIGHT_SHARE_SHORT
        } else {
            fit.height(index).norm() >= HEIGHT_SHARE * jumps[index].size()
        }
    };
    let located = (0..jumps.len())
        .map(|index| {
            let jump = jumps[index];
            let mismatch = mismatch(measured, &fit, &jump);
            let limit = UNEXPLAINED_SHARE * jump.size() + 3.0 * measured.noise;
            Located {
                jump,
                deviation: deviation(measured, range, &jumps, index, &fit),
                mismatch,
                explained: mismatch <= limit && is_high(index),
            }
        })
        .collect();
    (located, misfit)
}

/// The instants of jumps with what they leave, sought one after the other or together, whichever leaves less.
fn settled(measured: &Measured, range: (usize, usize), candidates: &[Jump]) -> Settled {
    let descended_to = descended(measured, range, candidates.to_vec());
    if measured.has_short_window() && candidates.len() > 1 {
        let mut scanned = candidates.to_vec();
        for first in 1..scanned.len() {
            settle_pair(measured, range, &mut scanned, first - 1);
        }
        let other = descended(measured, range, scanned);
        if other.left < descended_to.left - BETTER {
            return other;
        }
    }
    descended_to
}

/// [`settled`] without the jumps that are not needed, the smallest first: where samples are few a swing has steps
/// as steep as a jump, and what is taken for a jump there draws the others from their places.
fn needed(
    measured: &Measured,
    range: (usize, usize),
    candidates: &[Jump],
    all: Settled,
) -> Settled {
    let (mut kept, mut best) = (candidates.to_vec(), all);
    let mut smallest_first = candidates.to_vec();
    smallest_first.sort_by(|a, b| a.size().total_cmp(&b.size()));
    for candidate in smallest_first {
        let mut without = kept.clone();
        without.retain(|jump| jump.anchor != candidate.anchor);
        let other = settled(measured, range, &without);
        if other.left < best.left + NEEDED {
            (kept, best) = (without, other);
        }
    }
    best
}

/// Puts jump `first` and the next one, where few samples lie between them, to where both together are best, the
/// others as they are: what lies between them is then known so little that each alone is best somewhere else.
fn settle_pair(measured: &Measured, range: (usize, usize), jumps: &mut [Jump], first: usize) {
    let pair = [jumps[first], jumps[first + 1]];
    if pair[1].anchor - pair[0].anchor > AROUND {
        return;
    }
    let positions = |(low, high): (f64, f64)| {
        std::iter::successors(Some(low), |at| Some(at + COARSE)).take_while(move |at| *at <= high)
    };
    let low = within(measured, jumps, first).0;
    let high = within(measured, jumps, first + 1).1;
    let mut moved = jumps.to_vec();
    let mut best = (f64::INFINITY, [pair[0].position, pair[1].position]);
    for early in positions((low, pair[0].anchor as f64 + AFTER)) {
        let after = (pair[1].anchor as f64 - BEFORE).max(early + LEAST_APART);
        for late in positions((after, high)) {
            (moved[first].position, moved[first + 1].position) = (early, late);
            let value = Voltage::fit(measured, range, &moved, None).map_or(f64::INFINITY, |fit| {
                let bent = |index: usize| bent(measured, &fit, index);
                fit.objective + bent(first) + bent(first + 1)
            });
            if value < best.0 {
                best = (value, [early, late]);
            }
        }
    }
    (jumps[first].position, jumps[first + 1].position) = best.1.into();
}

/// Root mean square of what remains at the samples a jump is spread over and their neighbours.
fn mismatch(measured: &Measured, fit: &Voltage, jump: &Jump) -> f64 {
    let (left, right) = spread_between(measured, jump);
    let residuals: Vec<f64> = (left..=right)
        .filter(|&k| !measured.bad[k])
        .map(|k| 0.5 * fit.residual(measured, k).norm_sqr())
        .collect();
    if residuals.is_empty() {
        return 0.0;
    }
    (residuals.iter().sum::<f64>() / residuals.len() as f64).sqrt()
}

/// Steep steps that no explained jump accounts for: outside its filter and the motion it starts.
fn unexplained(measured: &Measured, steep: &[bool], jumps: &[(Jump, Edge)]) -> Vec<bool> {
    let motion = (MOTION_S / measured.interval_s).round();
    (0..steep.len())
        .map(|k| {
            let middle = k as f64 + 0.5;
            let accounted = jumps.iter().any(|(jump, _)| {
                let after = middle - jump.position;
                after > -(measured.half_width + 1.0) && after < measured.half_width + motion
            });
            steep[k] && !accounted
        })
        .collect()
}

#[cfg(test)]
mod tests;
