//! Screening: can a window teach anything about the load, and with what reason if not.
//!
//! Every quantity is compared with its value before the onset, and is a median over three samples
//! first, so that one wild sample decides nothing. A reason either forbids the use of the window
//! (refusal) or is kept with it (mark).

use super::{Screening, ScreeningReason, Window};
use crate::measurement::{Quality, Sample};

/// Settings of screening.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScreeningOptions {
    /// Least change of the voltage after the onset, pu of its value before; a smaller one is
    /// refused. Default 0.008: a step of 1 % passes with its noise. 0 to 1.
    pub voltage_change_min_pu: f64,
    /// Change of the frequency after the onset, hertz, from which a window is kept whatever its voltage does: what a
    /// load does with the frequency shows best where the voltage stays. Where it lasts for a quarter of the samples, P need not
    /// follow the voltage either. Default 0.1. 0 to 10.
    pub frequency_change_min_hz: f64,
    /// Least share of usable samples; fewer are refused. Default 0.8, 0 to 1.
    pub usable_share_min: f64,
    /// Negative-sequence voltage, over the voltage before the onset, from which a window is marked.
    /// Default 0.05, 0 to 1.
    pub unbalance_mark: Option<f64>,
    /// The same, from which a window is refused: an open pole, or a single-phase fault close by.
    /// Default 0.25, 0 to 1.
    pub unbalance_refuse: Option<f64>,
    /// Negative active power, as a share of the power before the onset, down to which a load is
    /// believed. Default 0.05, 0 to 1.
    pub reverse_power_max: f64,
    /// Least share of the active power's change that the voltage explains; less is refused when
    /// what remains is large. Default 0.2: the lowest of 207 simulated events of loads, one with much
    /// generation behind it, is 0.39; switched loads and bus couplers have below 0.1. 0 to 1.
    pub explained_share_min: f64,
    /// Unexplained change of the active power, rms, as a share of the power before the onset, up to
    /// which it does not matter what explains it. Default 0.15, 0 to 10.
    pub unexplained_power_max: f64,
    /// Time before the onset below which a window is marked, seconds. Default 0.5, 0 to 60.
    pub pre_event_s: f64,
    /// Cycles of the nominal frequency before the onset below which a window is refused. Default 2,
    /// 0 to 1000.
    pub pre_event_cycles_min: f64,
    /// Range of the voltage before the onset (5th to 95th percentile) from which a window is
    /// marked, pu. Default 0.02, 0 to 1.
    pub pre_event_range_max_pu: f64,
    /// Whether an unsteady operating point is refused instead of marked. Default no: there are
    /// recordings of swings that never are steady.
    pub refuse_unsteady: bool,
    /// Least active power before the onset, pu; a smaller one is refused. Default 0.005, 0 to 1.
    pub active_min_pu: f64,
}

impl ScreeningOptions {
    /// Admissible range of every share and every per-unit value.
    pub const SHARE: (f64, f64) = (0.0, 1.0);
    /// Admissible range of `frequency_change_min_hz`.
    pub const FREQUENCY_CHANGE_MIN_HZ: (f64, f64) = (0.0, 10.0);
    /// Admissible range of `unexplained_power_max`.
    pub const UNEXPLAINED_POWER_MAX: (f64, f64) = (0.0, 10.0);
    /// Admissible range of `pre_event_s`.
    pub const PRE_EVENT_S: (f64, f64) = (0.0, 60.0);
    /// Admissible range of `pre_event_cycles_min`.
    pub const PRE_EVENT_CYCLES_MIN: (f64, f64) = (0.0, 1000.0);
}

impl Default for ScreeningOptions {
    fn default() -> Self {
        Self {
            voltage_change_min_pu: 0.008,
            frequency_change_min_hz: 0.1,
            usable_share_min: 0.8,
            unbalance_mark: Some(0.05),
            unbalance_refuse: Some(0.25),
            reverse_power_max: 0.05,
            explained_share_min: 0.2,
            unexplained_power_max: 0.15,
            pre_event_s: 0.5,
            pre_event_cycles_min: 2.0,
            pre_event_range_max_pu: 0.02,
            refuse_unsteady: false,
            active_min_pu: 0.005,
        }
    }
}

/// Voltage before the onset below which a bus is dead, pu. Chosen: no load runs at a tenth of its
/// voltage, and no measuring chain has a tenth of noise.
const DEAD_BUS_PU: f64 = 0.1;

/// Sensitivity of P/P0 to V/V0 that a load can have, and its curvature. Appliances lie between
/// constant power (0, 0), constant impedance (2, 1) and discharge lighting (3 and more); below zero
/// because stalled motors and generation that drops out raise the net power while V is low.
const SENSITIVITY: (f64, f64) = (-0.5, 4.0);
const CURVATURE: (f64, f64) = (-2.0, 2.0);

/// Judges a window.
#[must_use]
pub fn screen(window: &Window, options: &ScreeningOptions) -> Screening {
    let mut screening = Screening::default();
    let usable_share = window.record.usable_share();
    if usable_share < options.usable_share_min || usable_share <= 0.0 {
        screening.refusals.push(ScreeningReason::TooManyBadSamples {
            usable_share,
            required_share: options.usable_share_min,
        });
    }
    marks_of_quality(window, &mut screening);
    let Some(view) = View::of(window) else {
        return screening;
    };
    pre_event(window, &view, options, &mut screening);
    if view.before_voltage_pu < DEAD_BUS_PU {
        screening.refusals.push(ScreeningReason::NoVoltage {
            voltage_pu: view.before_voltage_pu,
        });
        return screening;
    }
    depth(&view, options, &mut screening);
    balance(&view, options, &mut screening);
    power(&view, options, &mut screening);
    screening
}

/// Share of bad samples from which a window is marked. Chosen: what an isolated loss leaves is below it.
const BAD_SHARE_MARK: f64 = 0.01;

/// Around the onset, seconds before it and after it: a single bad sample there is worth a mark. Chosen: the motor's
/// answer is over after half a second.
const AT_ONSET_S: (f64, f64) = (0.1, 0.5);

/// Marks what the stream did to a window that is not refused for it.
fn marks_of_quality(window: &Window, screening: &mut Screening) {
    let (samples, rate_fps) = (&window.record.samples, window.record.rate_fps);
    if samples.is_empty() || !screening.refusals.is_empty() {
        return;
    }
    let from_onset_s = |k: usize| (k as f64 - window.onset as f64) / rate_fps;
    let at_onset = |k: usize| (-AT_ONSET_S.0..=AT_ONSET_S.1).contains(&from_onset_s(k));
    let samples_at = samples.iter().enumerate();
    let at_onset = samples_at
        .filter(|(k, s)| !s.usable() && at_onset(*k))
        .count();
    let bad_share = 1.0 - window.record.usable_share();
    if bad_share > BAD_SHARE_MARK || at_onset > 0 {
        let reason = ScreeningReason::BadSamples {
            bad_share,
            at_onset,
        };
        screening.marks.push(reason);
    }
    let unsynchronised = samples
        .iter()
        .filter(|s| s.quality.contains(Quality::NOT_SYNCHRONISED));
    let share = unsynchronised.count() as f64 / samples.len() as f64;
    if share > 0.0 {
        screening
            .marks
            .push(ScreeningReason::ClockNotSynchronised { share });
    }
}

/// What screening looks at: usable samples, smoothed, and their values before the onset.
struct View {
    /// Usable samples from the onset on.
    after: Vec<Point>,
    /// Voltages before the onset, pu.
    before_voltages_pu: Vec<f64>,
    before_voltage_pu: f64,
    voltage_noise_pu: f64,
    /// Largest distance of the frequency from that before the onset, a median over three samples; 0 where it is not
    /// known.
    frequency_change_hz: f64,
    /// The distance that a quarter of the samples after the onset exceeds: no phase jump is so long.
    lasting_frequency_change_hz: f64,
    before_active_pu: f64,
    active_noise_pu: f64,
    /// 2nd and 98th percentile of the active power, pu.
    active_range_pu: (f64, f64),
}

#[derive(Clone, Copy)]
struct Point {
    voltage_pu: f64,
    active_pu: f64,
    negative_sequence_ratio: f64,
}

impl View {
    /// None without a usable sample. A window that begins with its onset is seen from its first
    /// sample.
    fn of(window: &Window) -> Option<Self> {
        let samples = &window.record.samples;
        let onset = window.onset.min(samples.len());
        let before = smoothed(&samples[..onset]);
        let after = smoothed(&samples[onset..]);
        let first: Vec<Point> = if before.is_empty() {
            after.iter().take(1).copied().collect()
        } else {
            before
        };
        let actives: Vec<f64> = first.iter().map(|p| p.active_pu).collect();
        let voltages: Vec<f64> = first.iter().map(|p| p.voltage_pu).collect();
        let all: Vec<f64> = first.iter().chain(&after).map(|p| p.active_pu).collect();
        let [largest_hz, lasting_hz] = frequency_changes_hz(&samples[..onset], &samples[onset..]);
        Some(Self {
            before_voltage_pu: percentile(&voltages, 0.5)?,
            voltage_noise_pu: noise_of_samples(&samples[..onset], |s| s.voltage_pu),
            frequency_change_hz: largest_hz,
            lasting_frequency_change_hz: lasting_hz,
            before_active_pu: percentile(&actives, 0.5)?,
            active_noise_pu: noise(&actives),
            active_range_pu: (percentile(&all, 0.02)?, percentile(&all, 0.98)?),
            before_voltages_pu: voltages,
            after,
        })
    }

    /// Relative change of the voltage at a point.
    fn voltage_change(&self, point: &Point) -> f64 {
        point.voltage_pu / self.before_voltage_pu - 1.0
    }

    fn largest_voltage_change(&self) -> f64 {
        self.after
            .iter()
            .map(|point| self.voltage_change(point).abs())
            .fold(0.0, f64::max)
    }
}

fn pre_event(window: &Window, view: &View, options: &ScreeningOptions, screening: &mut Screening) {
    let seconds = window.onset as f64 / window.record.rate_fps;
    let cycles_min_s = options.pre_event_cycles_min / window.record.nominal_hz;
    if seconds < cycles_min_s {
        screening.refusals.push(ScreeningReason::PreEventTooShort {
            seconds,
            required_s: cycles_min_s,
        });
    } else if seconds < options.pre_event_s {
        screening.marks.push(ScreeningReason::PreEventTooShort {
            seconds,
            required_s: options.pre_event_s,
        });
    }
    let percentile = |share| percentile(&view.before_voltages_pu, share).unwrap_or(0.0);
    let voltage_range_pu = percentile(0.95) - percentile(0.05);
    if voltage_range_pu > options.pre_event_range_max_pu {
        let list = if options.refuse_unsteady {
            &mut screening.refusals
        } else {
            &mut screening.marks
        };
        list.push(ScreeningReason::PreEventNotSteady { voltage_range_pu });
    }
}

/// A change of voltage or frequency, a median over three, stands out of its noise by this many deviations of a sample: the
/// largest median among some thousand samples of nothing but noise is at three.
const STANDS_OUT: f64 = 4.0;
/// Beside a voltage with this noise no answer of a load to the frequency shows.
const NOISY_VOLTAGE_PU: f64 = 0.01;

fn depth(view: &View, options: &ScreeningOptions, screening: &mut Screening) {
    let change_pu = view.largest_voltage_change() * view.before_voltage_pu;
    let above_noise_pu = STANDS_OUT * view.voltage_noise_pu;
    let required_pu = options.voltage_change_min_pu.max(above_noise_pu);
    let moves_frequency = view.frequency_change_hz >= options.frequency_change_min_hz
        && view.voltage_noise_pu < NOISY_VOLTAGE_PU;
    if change_pu < required_pu && !moves_frequency {
        screening.refusals.push(ScreeningReason::TooShallow {
            change_pu,
            required_pu,
        });
    }
}

fn balance(view: &View, options: &ScreeningOptions, screening: &mut Screening) {
    // Over the voltage before the onset: the ratio at the moment says nothing where the voltage is
    // near zero. NaN, without the channel, is ignored by max.
    let ratio = view
        .after
        .iter()
        .map(|p| p.negative_sequence_ratio * p.voltage_pu / view.before_voltage_pu)
        .fold(0.0, f64::max);
    match (options.unbalance_refuse, options.unbalance_mark) {
        (Some(limit), _) if ratio > limit => screening
            .refusals
            .push(ScreeningReason::Unbalanced { ratio, limit }),
        (_, Some(limit)) if ratio > limit => screening
            .marks
            .push(ScreeningReason::Unbalanced { ratio, limit }),
        _ => {}
    }
}

fn power(view: &View, options: &ScreeningOptions, screening: &mut Screening) {
    let active_pu = view.before_active_pu;
    if active_pu.abs() < options.active_min_pu.max(5.0 * view.active_noise_pu) {
        screening
            .refusals
            .push(ScreeningReason::NoPower { active_pu });
        return;
    }
    let (lowest_active_pu, highest_active_pu) = view.active_range_pu;
    let tolerated_pu =
        (options.reverse_power_max * active_pu.abs()).max(3.0 * view.active_noise_pu);
    if active_pu <= 0.0 || lowest_active_pu < -tolerated_pu {
        screening.refusals.push(ScreeningReason::NotALoad {
            lowest_active_pu,
            highest_active_pu,
        });
        return;
    }
    let (explained_share, unexplained) = explained_by_voltage(view);
    // No feeder moves the frequency of a grid: what its relays switch then is an answer of the load.
    let lasting_hz = view.lasting_frequency_change_hz;
    let of_the_grid = lasting_hz > 0.0 && lasting_hz >= options.frequency_change_min_hz;
    if explained_share < options.explained_share_min
        && unexplained > options.unexplained_power_max
        && !of_the_grid
    {
        screening
            .refusals
            .push(ScreeningReason::PowerDoesNotFollowVoltage { explained_share });
    }
}

/// Share of the active power's change that the voltage explains at once, 0 to 1, and the rms of the
/// rest as a share of the power before the onset.
///
/// The change of P/P0 is fitted by a x + b x^2, x the change of V/V0, within what a load's
/// sensitivity can be. A deep disturbance is judged where it is deep only: what the load does
/// afterwards (motors accelerate, contactors and inverters have dropped out) is what a fit is to
/// find out, and no objection. In a shallow one nothing of the kind is expected, and all counts.
fn explained_by_voltage(view: &View) -> (f64, f64) {
    const DEEP: f64 = 0.05;
    let largest = view.largest_voltage_change();
    let from = if largest < DEEP { 0.0 } else { 0.5 * largest };
    let points: Vec<(f64, f64)> = view
        .after
        .iter()
        .map(|p| {
            let y = p.active_pu / view.before_active_pu - 1.0;
            (view.voltage_change(p), y)
        })
        .filter(|(x, _)| x.abs() >= from)
        .collect();
    let total: f64 = points.iter().map(|(_, y)| y * y).sum();
    if points.is_empty() || total <= 0.0 {
        return (1.0, 0.0);
    }
    let rest = |(a, b): (f64, f64)| -> f64 {
        points
            .iter()
            .map(|(x, y)| (y - a * x - b * x * x).powi(2))
            .sum()
    };
    let least = candidates(&points)
        .into_iter()
        .map(rest)
        .fold(total, f64::min);
    (1.0 - least / total, (least / points.len() as f64).sqrt())
}

/// The points among which the least squares within the box lie: the free minimum if it is inside,
/// and the minimum on each edge.
fn candidates(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let sum = |f: &dyn Fn(f64, f64) -> f64| points.iter().map(|(x, y)| f(*x, *y)).sum::<f64>();
    let (xx, xxx, xxxx) = (
        sum(&|x, _| x.powi(2)),
        sum(&|x, _| x.powi(3)),
        sum(&|x, _| x.powi(4)),
    );
    let (xy, xxy) = (sum(&|x, y| x * y), sum(&|x, y| x * x * y));
    let within = |value: f64, (lowest, highest): (f64, f64)| {
        if value.is_finite() {
            value.clamp(lowest, highest)
        } else {
            0.0
        }
    };
    let mut found = Vec::with_capacity(5);
    for a in [SENSITIVITY.0, SENSITIVITY.1] {
        found.push((a, within((xxy - a * xxx) / xxxx, CURVATURE)));
    }
    for b in [CURVATURE.0, CURVATURE.1] {
        found.push((within((xy - b * xxx) / xx, SENSITIVITY), b));
    }
    let determinant = xx * xxxx - xxx * xxx;
    let a = (xy * xxxx - xxy * xxx) / determinant;
    let b = (xx * xxy - xxx * xy) / determinant;
    let inside = |value: f64, (lowest, highest)| (lowest..=highest).contains(&value);
    if inside(a, SENSITIVITY) && inside(b, CURVATURE) {
        found.push((a, b));
    }
    found
}

/// Usable samples, each channel a median over three neighbours.
fn smoothed(samples: &[Sample]) -> Vec<Point> {
    let usable: Vec<Point> = samples
        .iter()
        .filter(|s| s.usable())
        .map(|s| Point {
            voltage_pu: s.voltage_pu,
            active_pu: s.active_pu,
            negative_sequence_ratio: s.negative_sequence_ratio,
        })
        .collect();
    let last = usable.len().saturating_sub(1);
    (0..usable.len())
        .map(|k| {
            let three = [
                usable[k.saturating_sub(1)],
                usable[k],
                usable[(k + 1).min(last)],
            ];
            let of = |value: fn(&Point) -> f64| middle(three.map(|p| value(&p)));
            Point {
                voltage_pu: of(|p| p.voltage_pu),
                active_pu: of(|p| p.active_pu),
                negative_sequence_ratio: of(|p| p.negative_sequence_ratio),
            }
        })
        .collect()
}

fn middle(mut three: [f64; 3]) -> f64 {
    three.sort_by(f64::total_cmp);
    three[1]
}

fn percentile(values: &[f64], share: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a length is a length"
    )]
    let at = (share * sorted.len().saturating_sub(1) as f64).round() as usize;
    sorted.get(at).copied()
}

/// Standard deviation of the noise, from successive differences of values smoothed over three: a
/// lower bound, which is enough to tell a load from nothing.
fn noise(values: &[f64]) -> f64 {
    let differences: Vec<f64> = values.windows(2).map(|w| (w[1] - w[0]).abs()).collect();
    percentile(&differences, 0.5).unwrap_or(0.0)
}

/// Standard deviation of the noise of single samples of a channel, from its second differences, in which swings
/// hardly show; 0 where there are too few.
fn noise_of_samples(samples: &[Sample], channel: impl Fn(&Sample) -> f64) -> f64 {
    /// Median of the size of a second difference of white noise with unit deviation: 0.6745 sqrt 6.
    const MEDIAN: f64 = 1.652;
    let usable = samples.iter().filter(|s| s.usable());
    let values: Vec<f64> = usable.map(channel).filter(|y| y.is_finite()).collect();
    let second = values.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs());
    percentile(&second.collect::<Vec<f64>>(), 0.5).unwrap_or(0.0) / MEDIAN
}

/// How far the frequency goes from that before the onset where it does so clearly, and how far it stays away for a
/// quarter of the time; else 0.
fn frequency_changes_hz(before: &[Sample], after: &[Sample]) -> [f64; 2] {
    let of = |samples: &[Sample]| -> Vec<f64> {
        let usable = samples.iter().filter(|s| s.usable());
        usable
            .map(|s| s.frequency_hz)
            .filter(|f| f.is_finite())
            .collect()
    };
    let Some(level_hz) = percentile(&of(before), 0.5) else {
        return [0.0; 2];
    };
    let far = |w: &[f64]| percentile(w, 0.5).map_or(0.0, |f| (f - level_hz).abs());
    let changes_hz: Vec<f64> = of(after).windows(3).map(far).collect();
    let noise_hz = noise_of_samples(before, |s| s.frequency_hz);
    let clear_hz = |share: f64| {
        let change_hz = percentile(&changes_hz, share);
        change_hz
            .filter(|change_hz| *change_hz > STANDS_OUT * noise_hz)
            .unwrap_or(0.0)
    };
    [clear_hz(1.0), clear_hz(0.75)]
}

#[cfg(test)]
mod tests;
