//! The instants of jumps, and the filter that explains how they look.
//!
//! A jump behind a filter shows in the two to nine samples whose windows hold it. Its instant is the one
//! at which what lies on either side, seen through the filter, meets these samples (`voltage`, (1)).
//! A motion that no filter explains is no jump: a slow ramp, or several jumps within one window.

use super::{
    super::phasor_filter::{FilterChoice, PhasorFilter},
    edges::{Edge, MOTION_SHARE, distance, unfiltered_jumps},
    series::Series,
    voltage::{Jump, Log, Measured, Voltage},
};

/// Samples each side of a cluster of jumps that take part in finding the instants.
const AROUND: usize = 8;
/// The instant is sought this far before the steepest step and after it, samples.
const BEFORE: f64 = 0.8;
const AFTER: f64 = 1.8;
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
/// Where the filter's window is shorter than this many samples one or two of them hold all that tells a jump from a
/// bend, and what lies on either side may bend at will: a jump is then preferred to be this share of the change ...
const SHORT_WINDOW: f64 = 1.5;
const HEIGHT_EXPECTED: f64 = 0.9;
/// ... with this standard deviation, where the change is at least this large.
const HEIGHT_DEVIATION: f64 = 0.15;
const LARGE: f64 = 0.05;
/// Time within which a steep step that is smaller by [`MOTION_SHARE`] is the motion that follows a jump, seconds.
const MOTION_S: f64 = 0.06;
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
    let measured = |filter: PhasorFilter, steep: Vec<f64>| Measured {
        log: log.to_vec(),
        bad: series.bad.clone(),
        noise,
        interval_s: 1.0 / series.rate_fps,
        stiffness: vec![ORDINARY_STIFFNESS; log.len()],
        steep,
        half_width: filter.half_width_cycles() * series.rate_fps / series.nominal_hz,
        filter,
    };
    let calm = vec![0.0; steep.len()];
    let unfiltered = unfiltered_jumps(log, steep);
    let shapes = match (choice, &unfiltered) {
        (FilterChoice::Fixed(filter), _) => vec![filter],
        (FilterChoice::Auto, Some(_)) => vec![PhasorFilter::None],
        (FilterChoice::Auto, None) => vec![PhasorFilter::PClass, PhasorFilter::OneCycle],
    };
    let mut best: Option<(f64, Vec<Located>, Measured)> = None;
    for filter in shapes {
        let problem = measured(filter, calm.clone());
        let candidates = if filter == PhasorFilter::None {
            unfiltered_candidates(log, unfiltered.as_deref().unwrap_or(&[]))
        } else {
            candidates(&problem, steep)
        };
        let located = located(&problem, &candidates);
        let misfit: f64 = located.iter().map(|l| l.misfit).sum();
        let convincing = |b: f64| misfit < (1.0 - CONVINCING_SHARE) * b - CONVINCING;
        if best.as_ref().is_none_or(|b| convincing(b.0)) {
            best = Some((misfit, located, problem));
        }
    }
    let Some((_, located, mut problem)) = best else {
        return Found {
            measured: measured(PhasorFilter::None, calm),
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
    let unexplained = unexplained(&problem, steep, &jumps);
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

/// A jump with its instant.
struct Located {
    jump: Jump,
    deviation: f64,
    mismatch: f64,
    /// Its part of the objective.
    misfit: f64,
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
            size: distance(log[edge.left], log[edge.right]),
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
    let mut anchors: Vec<usize> = Vec::new();
    for k in order {
        let claimed = anchors.iter().any(|&a| {
            let apart = a.abs_diff(k);
            let same_way = (step(k) * step(a).conj()).re > 0.0;
            let smaller = step(k).norm() < MOTION_SHARE * step(a).norm();
            apart < 2
                || (apart <= 2 * reach && (same_way || smaller))
                || (apart <= reach + motion && smaller)
        });
        let inside = k >= reach + 3 && k + reach + 5 < log.len();
        if !claimed && inside {
            anchors.push(k);
        }
    }
    anchors.sort_unstable();
    let last = log.len() - 1;
    anchors
        .into_iter()
        .map(|anchor| Jump {
            anchor,
            position: anchor as f64 + 0.5,
            size: distance(
                log[anchor.saturating_sub(reach)],
                log[(anchor + 1 + reach).min(last)],
            ),
        })
        .collect()
}

/// Finds the instants, cluster by cluster.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a filter spans a handful of samples"
)]
fn located(measured: &Measured, candidates: &[Jump]) -> Vec<Located> {
    let reach = measured.half_width.ceil() as usize;
    let last = measured.log.len() - 1;
    let mut list = Vec::with_capacity(candidates.len());
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
        list.extend(cluster(measured, (from, to), &candidates[start..end]));
        start = end;
    }
    refuse_ramps(measured, &mut list);
    list
}

/// Behind a filter two jumps the same way, close to each other, look like a ramp: neither is taken.
fn refuse_ramps(measured: &Measured, list: &mut [Located]) {
    /// Nominal cycles between them: more than two windows of the wider filter.
    const CLOSE: f64 = 4.5;
    if measured.filter == PhasorFilter::None {
        return;
    }
    let cycle = measured.half_width / measured.filter.half_width_cycles();
    let step = |jump: &Jump| measured.log[jump.anchor + 1] - measured.log[jump.anchor];
    for index in 1..list.len() {
        let (before, after) = (list[index - 1].jump, list[index].jump);
        let same_way = (step(&before) * step(&after).conj()).re > 0.0;
        let close = after.position - before.position <= CLOSE * cycle;
        if same_way && close {
            list[index - 1].explained = false;
            list[index].explained = false;
        }
    }
}

/// The instants of jumps close to each other, one after the other and then again.
fn cluster(measured: &Measured, range: (usize, usize), candidates: &[Jump]) -> Vec<Located> {
    let mut jumps = candidates.to_vec();
    let mut fit = Voltage::fit(measured, range, &jumps, None);
    if measured.filter != PhasorFilter::None {
        let rounds = if jumps.len() > 1 { 3 } else { 1 };
        for _ in 0..rounds {
            for index in 0..jumps.len() {
                jumps[index].position = instant(measured, range, &jumps, index, fit.as_ref());
                fit = Voltage::fit(measured, range, &jumps, fit.as_ref());
            }
        }
    }
    let count = jumps.len() as f64;
    (0..jumps.len())
        .map(|index| {
            let jump = jumps[index];
            let Some(fit) = &fit else {
                return Located {
                    jump,
                    deviation: f64::INFINITY,
                    mismatch: f64::INFINITY,
                    misfit: (jump.size / measured.noise).powi(2),
                    explained: false,
                };
            };
            let mismatch = mismatch(measured, fit, &jump);
            let limit = UNEXPLAINED_SHARE * jump.size + 3.0 * measured.noise;
            Located {
                jump,
                deviation: deviation(measured, range, &jumps, index, fit),
                mismatch,
                misfit: fit.objective / count,
                explained: mismatch <= limit && fit.height(index) >= HEIGHT_SHARE * jump.size,
            }
        })
        .collect()
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

fn objective_at(
    measured: &Measured,
    range: (usize, usize),
    jumps: &[Jump],
    (index, position): (usize, f64),
    start: Option<&Voltage>,
) -> f64 {
    let mut moved = jumps.to_vec();
    moved[index].position = position;
    Voltage::fit(measured, range, &moved, start).map_or(f64::INFINITY, |fit| {
        fit.objective + bent(measured, &fit, index, moved[index].size)
    })
}

/// What speaks against a jump that leaves most of the change to what lies on either side of it.
fn bent(measured: &Measured, fit: &Voltage, index: usize, size: f64) -> f64 {
    if 2.0 * measured.half_width > SHORT_WINDOW || size < LARGE {
        return 0.0;
    }
    let missing = (HEIGHT_EXPECTED - fit.height(index) / size).max(0.0);
    (missing / HEIGHT_DEVIATION).powi(2)
}

/// The instant of one jump with the others as they are: coarse scan, then golden section.
fn instant(
    measured: &Measured,
    range: (usize, usize),
    jumps: &[Jump],
    index: usize,
    start: Option<&Voltage>,
) -> f64 {
    const COARSE: f64 = 0.2;
    const FINE: f64 = 5e-4;
    let anchor = jumps[index].anchor as f64;
    let (mut low, mut high) = (anchor - BEFORE, anchor + AFTER);
    if let Some(before) = index.checked_sub(1).map(|i| jumps[i].position) {
        low = low.max(before + 0.1);
    }
    if let Some(after) = jumps.get(index + 1).map(|j| j.position) {
        high = high.min(after - 0.1);
    }
    let value = |t: f64| objective_at(measured, range, jumps, (index, t), start);
    let steps = ((high - low) / COARSE).floor();
    let mut best = (f64::INFINITY, jumps[index].position);
    let mut step = 0.0;
    while step <= steps {
        let t = low + step * COARSE;
        let v = value(t);
        if v < best.0 {
            best = (v, t);
        }
        step += 1.0;
    }
    let ratio = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut a, mut b) = ((best.1 - COARSE).max(low), (best.1 + COARSE).min(high));
    let (mut x, mut y) = (b - ratio * (b - a), a + ratio * (b - a));
    let (mut fx, mut fy) = (value(x), value(y));
    while b - a > FINE {
        if fx <= fy {
            (b, y, fy) = (y, x, fx);
            x = b - ratio * (b - a);
            fx = value(x);
        } else {
            (a, x, fx) = (x, y, fy);
            y = a + ratio * (b - a);
            fy = value(y);
        }
    }
    0.5 * (a + b)
}

/// Standard deviation of an instant from the curvature of the objective, samples.
fn deviation(
    measured: &Measured,
    range: (usize, usize),
    jumps: &[Jump],
    index: usize,
    fit: &Voltage,
) -> f64 {
    const APART: f64 = 0.05;
    /// Of a uniform distribution over one interval.
    const UNKNOWN: f64 = 0.29;
    if measured.filter == PhasorFilter::None {
        return UNKNOWN;
    }
    let at = |t: f64| objective_at(measured, range, jumps, (index, t), Some(fit));
    let t = jumps[index].position;
    let least = fit.objective + bent(measured, fit, index, jumps[index].size);
    let curvature = (at(t - APART) - 2.0 * least + at(t + APART)) / (APART * APART);
    if curvature > 0.0 {
        (2.0 / curvature).sqrt().min(UNKNOWN)
    } else {
        UNKNOWN
    }
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
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// A dip with phase jumps between two instants (seconds) that settles exponentially, through
    /// a window of this half width and shape, by brute force.
    fn record(rate_fps: f64, filter: PhasorFilter, (begin_s, end_s): (f64, f64)) -> Vec<Log> {
        let half_s = filter.half_width_cycles() / 60.0;
        let phasor = |t: f64| {
            if t < begin_s {
                Log::new(0.0, 0.0).exp()
            } else if t < end_s {
                let settling = 0.05 * (-(t - begin_s) / 0.03).exp();
                Log::new(-0.4 - settling, -0.08 + 0.5 * (t - begin_s)).exp()
            } else {
                let settling = 0.04 * (-(t - end_s) / 0.05).exp();
                Log::new(-0.01 - settling, 0.03).exp()
            }
        };
        (0..400)
            .map(|k| f64::from(k) / rate_fps)
            .take_while(|t| *t < 2.0)
            .map(|t| {
                if half_s == 0.0 {
                    return phasor(t).ln();
                }
                let (mut sum, mut total) = (Log::new(0.0, 0.0), 0.0);
                for i in -2000..2000 {
                    let offset = (f64::from(i) + 0.5) / 2000.0;
                    let weight = filter.weight(offset);
                    sum += phasor(t + offset * half_s) * weight;
                    total += weight;
                }
                (sum / total).ln()
            })
            .collect()
    }

    fn series(rate_fps: f64, log: &[Log]) -> Series {
        let n = log.len();
        Series {
            rate_fps,
            nominal_hz: 60.0,
            voltage: log.iter().map(|l| l.re.exp()).collect(),
            angle: log.iter().map(|l| l.im).collect(),
            frequency_hz: vec![60.0; n],
            active: vec![1.0; n],
            reactive: vec![0.3; n],
            bad: vec![false; n],
        }
    }

    fn found(rate_fps: f64, filter: PhasorFilter, instants: (f64, f64), bad: &[usize]) -> Found {
        let log = record(rate_fps, filter, instants);
        let mut series = series(rate_fps, &log);
        for &k in bad {
            series.bad[k] = true;
        }
        let steep = super::super::edges::steps_at_edges(&series);
        find(&series, &log, &steep, 2e-4, FilterChoice::Auto)
    }

    #[test]
    fn instants_and_shape_of_filtered_jumps_are_found_at_every_usual_rate() {
        for filter in [PhasorFilter::PClass, PhasorFilter::OneCycle] {
            for rate in [60.0, 100.0, 120.0, 200.0, 240.0] {
                let instants = (0.906_1, 0.990_7);
                let found = found(rate, filter, instants, &[]);
                assert_eq!(found.filter, Some(filter), "{rate} frames/s");
                assert_eq!(found.jumps.len(), 2, "{rate} frames/s");
                for ((jump, _), instant) in found.jumps.iter().zip([instants.0, instants.1]) {
                    let late_s = jump.position / rate - instant;
                    // A settling of 5 % within 30 ms is not a parabola over 17 ms samples.
                    assert!(late_s.abs() < 5e-4, "{rate} frames/s: {late_s} s");
                }
            }
        }
    }

    #[test]
    fn both_jumps_of_a_dip_of_three_samples_are_found() {
        let instants = (0.906_1, 0.990_7);
        let found = found(30.0, PhasorFilter::PClass, instants, &[]);
        assert_eq!(found.jumps.len(), 2);
        for ((jump, _), instant) in found.jumps.iter().zip([instants.0, instants.1]) {
            let late = jump.position - 30.0 * instant;
            assert!(late.abs() < 0.4, "{late} samples");
        }
    }

    #[test]
    fn unfiltered_jumps_keep_their_instant_open() {
        let found = found(60.0, PhasorFilter::None, (0.906_1, 0.990_7), &[]);
        assert_eq!(found.filter, Some(PhasorFilter::None));
        let positions: Vec<f64> = found.jumps.iter().map(|j| j.1.position).collect();
        assert_eq!(positions, [54.5, 59.5]);
    }

    #[test]
    fn a_missing_sample_at_a_jump_leaves_the_instant_less_certain() {
        let whole = found(60.0, PhasorFilter::PClass, (0.906_1, 0.990_7), &[]);
        let holed = found(60.0, PhasorFilter::PClass, (0.906_1, 0.990_7), &[54]);
        assert_eq!(holed.jumps.len(), 2);
        let late = holed.jumps[0].1.position - 0.906_1 * 60.0;
        assert!(late.abs() < 0.1, "{late} samples");
        assert!(holed.jumps[0].1.deviation > whole.jumps[0].1.deviation);
    }

    #[test]
    fn a_ramp_is_no_jump_behind_a_filter() {
        // From 1 to 0.6 within 0.1 s: six steep steps in a row.
        let log: Vec<Log> = (0..120)
            .map(|k| {
                let share = ((f64::from(k) - 54.0) / 6.0).clamp(0.0, 1.0);
                Log::new((1.0 - 0.4 * share).ln(), -0.02 * PI * share)
            })
            .collect();
        let series = series(60.0, &log);
        let steep = super::super::edges::steps_at_edges(&series);
        let found = find(&series, &log, &steep, 2e-4, FilterChoice::Auto);
        assert!(found.jumps.is_empty(), "{:?}", found.jumps);
    }
}
