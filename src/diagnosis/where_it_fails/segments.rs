//! Parts of a window by what the voltage does, and residuals in them.

use super::{Channel, EventFailure, EventSeries, Segment, SegmentResidual};

/// Time in which a clearing brings the voltage back, seconds: longer than the filters of phasor
/// measurement units, shorter than any recovery of a load.
const STEEP_S: f64 = 0.06;
/// Share of the deepest departure that has to come back within [`STEEP_S`] to be a clearing.
/// Chosen: above a tap's step after a moderate dip, below a clearing into a delayed recovery.
const STEEP_SHARE: f64 = 0.3;
/// Share of the deepest departure from which a clearing starts: lesser swings are none.
const FAULTED_SHARE: f64 = 0.5;
/// Departure of the voltage below which nothing was there to clear, relative.
const DEPARTURE_MIN: f64 = 0.005;
/// The first moments after a step that nothing clears, seconds.
const FIRST_MOMENTS_S: f64 = 0.2;
/// End of the early recovery, seconds after the clearing.
const EARLY_END_S: f64 = 0.5;
/// End of the late part, seconds after the clearing.
const LATE_END_S: f64 = 2.0;

const SEGMENTS: [Segment; 5] = [
    Segment::Before,
    Segment::During,
    Segment::EarlyRecovery,
    Segment::Late,
    Segment::After,
];
const CHANNELS: [Channel; 2] = [Channel::Active, Channel::Reactive];

/// Instant of the last clearing, seconds since the onset: the voltage comes back steeply from a
/// deep departure. None after a step that stays, in a ramp or a swing.
pub(super) fn clearing_s(series: &EventSeries) -> Option<f64> {
    let departure: Vec<f64> = series.voltage.iter().map(|u| (u - 1.0).abs()).collect();
    let onset = series.onset();
    let deepest = departure.get(onset..)?.iter().copied().fold(0.0, f64::max);
    if deepest < DEPARTURE_MIN {
        return None;
    }
    let reach = steep_samples(series.interval_s());
    let clears = |k: &usize| {
        departure[*k] >= FAULTED_SHARE * deepest
            && departure[*k] - departure[*k + reach] >= STEEP_SHARE * deepest
            // A fast swing falls as much, but has no edge.
            && series.near_edge[*k..=*k + reach].contains(&true)
    };
    let last = (onset..series.len().saturating_sub(reach)).rfind(clears)?;
    // Where it comes back most steeply, around the last sample that is still deep.
    let fall = |k: usize| departure[k] - departure[k + 1];
    let steepest = (last..last + reach).max_by(|&a, &b| fall(a).total_cmp(&fall(b)))?;
    let middle = f64::midpoint(series.time_s[steepest], series.time_s[steepest + 1]);
    let near = |jump: &&f64| (**jump - middle).abs() <= 1.5 * series.interval_s();
    let jump = series
        .jumps_s
        .iter()
        .filter(near)
        .min_by(|a, b| (**a - middle).abs().total_cmp(&(**b - middle).abs()));
    Some(jump.copied().unwrap_or(middle))
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "clamped in the same expression"
)]
fn steep_samples(interval_s: f64) -> usize {
    (STEEP_S / interval_s).round().clamp(1.0, 1000.0) as usize
}

/// The segment of an instant, seconds since the onset.
pub(super) fn segment_at(time_s: f64, clearing_s: Option<f64>) -> Segment {
    let since = time_s - clearing_s.unwrap_or(FIRST_MOMENTS_S);
    if time_s < 0.0 {
        Segment::Before
    } else if since < 0.0 {
        Segment::During
    } else if since < EARLY_END_S {
        Segment::EarlyRecovery
    } else if since < LATE_END_S {
        Segment::Late
    } else {
        Segment::After
    }
}

/// Residuals of both channels in every segment that has a sample, in the order of time.
pub(super) fn residuals(series: &EventSeries, clearing_s: Option<f64>) -> Vec<SegmentResidual> {
    let each = SEGMENTS.into_iter().flat_map(|segment| {
        CHANNELS.map(|channel| residual_in(series, clearing_s, segment, channel))
    });
    each.flatten().collect()
}

fn residual_in(
    series: &EventSeries,
    clearing_s: Option<f64>,
    segment: Segment,
    channel: Channel,
) -> Option<SegmentResidual> {
    let values = series.channel(channel);
    let inside: Vec<usize> = (0..series.len())
        .filter(|&k| segment_at(series.time_s[k], clearing_s) == segment)
        .filter(|&k| series.counts(channel, k))
        .collect();
    let (first, last) = (*inside.first()?, *inside.last()?);
    let (mut weights, mut mean, mut square) = (0.0, 0.0, 0.0);
    for &k in &inside {
        let weight = values.deviation[k].powi(-2);
        let residual = values.residual(k);
        weights += weight;
        mean += weight * residual;
        square += weight * residual * residual;
    }
    Some(SegmentResidual {
        segment,
        channel,
        begin_s: series.time_s[first],
        end_s: series.time_s[last],
        samples: inside.len(),
        mean_pu: mean / weights,
        rms_pu: (square / weights).sqrt(),
        to_noise: (square / inside.len() as f64).sqrt(),
    })
}

/// Residuals by segment and channel of all events together: means and mean squares weighted by the
/// number of samples.
#[must_use]
pub fn pooled(failures: &[EventFailure]) -> Vec<SegmentResidual> {
    let each = SEGMENTS.into_iter().flat_map(|segment| {
        CHANNELS.map(|channel| {
            let of_all = failures.iter().flat_map(|failure| &failure.segments);
            let same = of_all.filter(|r| r.segment == segment && r.channel == channel);
            together(&same.collect::<Vec<_>>())
        })
    });
    each.flatten().collect()
}

fn together(residuals: &[&SegmentResidual]) -> Option<SegmentResidual> {
    let first = residuals.first()?;
    let samples: usize = residuals.iter().map(|r| r.samples).sum();
    let mean = |of: fn(&SegmentResidual) -> f64| {
        let sum: f64 = residuals.iter().map(|r| r.samples as f64 * of(r)).sum();
        sum / samples as f64
    };
    let extreme = |of: fn(&SegmentResidual) -> f64, choose: fn(f64, f64) -> f64| {
        residuals.iter().map(|r| of(r)).fold(of(first), choose)
    };
    Some(SegmentResidual {
        segment: first.segment,
        channel: first.channel,
        begin_s: extreme(|r| r.begin_s, f64::min),
        end_s: extreme(|r| r.end_s, f64::max),
        samples,
        mean_pu: mean(|r| r.mean_pu),
        rms_pu: mean(|r| r.rms_pu * r.rms_pu).sqrt(),
        to_noise: mean(|r| r.to_noise * r.to_noise).sqrt(),
    })
}
