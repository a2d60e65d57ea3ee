//! The triggers, each with its hysteresis.

use super::{
    DetectorOptions, VoltageReference,
    history::{Base, FrequencyBase, History, median, trigger_frequency, trigger_voltage},
    options::Counts,
};
use crate::disturbance::Trigger;

/// Share of its threshold at which a frequency excursion ends.
const FREQUENCY_RELEASE: f64 = 0.8;

/// Share of its threshold at which a step, a jump or a rate of change ends.
const STEP_RELEASE: f64 = 0.5;

/// Standard deviation of a median over that of a mean, of normal values: sqrt(pi/2).
const MEDIAN_PENALTY: f64 = 1.2533;

/// The sliding reference of IEC 61000-4-30: a first-order filter over undisturbed samples. Its
/// first time constant is a plain mean, so that a stream that has just begun has a reference.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SlidingReference {
    voltage_pu: f64,
    count: f64,
}

impl SlidingReference {
    /// The reference once three samples were seen.
    pub(super) fn voltage_pu(&self) -> Option<f64> {
        (self.count >= 3.0).then_some(self.voltage_pu)
    }

    pub(super) fn starting_at(voltage_pu: f64, count: usize) -> Self {
        let count = count as f64;
        Self { voltage_pu, count }
    }

    fn take(&mut self, voltage_pu: f64, samples_per_time_constant: f64) {
        self.count = (self.count + 1.0).min(samples_per_time_constant.max(1.0));
        self.voltage_pu += (voltage_pu - self.voltage_pu) / self.count;
    }
}

/// Whether a trigger is met, and whether it may open a window.
#[derive(Clone, Copy, Debug, Default)]
struct Latch {
    active: bool,
    /// It was active when a window was closed at its longest: it must end before it counts again.
    held: bool,
}

impl Latch {
    /// `strength` over its threshold, and the share of the threshold at which it ends.
    fn update(&mut self, over_threshold: bool, over_release: bool) {
        self.active = if self.active {
            over_release
        } else {
            over_threshold
        };
        self.held &= self.active;
    }
}

/// All triggers of one stream.
#[derive(Clone, Debug, Default)]
pub(super) struct Triggers {
    latches: [Latch; Trigger::ALL.len()],
    below: usize,
    above: usize,
}

impl Triggers {
    /// Judges the newest sample. A bad or missing sample changes nothing.
    pub(super) fn judge(
        &mut self,
        history: &History,
        base: Option<&Base>,
        reference: &mut SlidingReference,
        at: &Settings<'_>,
    ) {
        let Some(newest) = history.back(0) else {
            return;
        };
        if let Some(voltage_pu) = trigger_voltage(newest) {
            self.dip_and_swell(voltage_pu, reference, at);
            // Shorter, and its noise is not known well enough.
            if let Some(base) = base.filter(|base| 5 * base.voltages >= at.counts.base) {
                self.step(history, base, at);
            }
        }
        if trigger_frequency(newest).is_some() {
            if let Some(base) = base {
                self.phase_jump(history, base, at);
            }
            self.frequency(history, at);
            self.rate_of_change(history, at);
        }
    }

    /// Triggers that count at present, in the order of [`Trigger::ALL`].
    pub(super) fn met(&self) -> impl Iterator<Item = Trigger> {
        Trigger::ALL
            .into_iter()
            .filter(|t| self.latches[*t as usize].active && !self.latches[*t as usize].held)
    }

    /// What is active now must end before it counts again.
    pub(super) fn hold(&mut self) {
        for latch in &mut self.latches {
            latch.held = latch.active;
        }
    }

    fn latch(&mut self, trigger: Trigger) -> &mut Latch {
        &mut self.latches[trigger as usize]
    }

    fn dip_and_swell(
        &mut self,
        voltage_pu: f64,
        reference: &mut SlidingReference,
        at: &Settings<'_>,
    ) {
        let reference_pu = match at.options.voltage_reference {
            VoltageReference::Sliding => reference.voltage_pu(),
            VoltageReference::Declared => Some(1.0),
        };
        let ratio = reference_pu.map_or(1.0, |reference_pu| voltage_pu / reference_pu);
        let hysteresis = at.options.hysteresis_ratio;
        let dip_ratio = at.options.dip_ratio.unwrap_or(f64::NEG_INFINITY);
        let swell_ratio = at.options.swell_ratio.unwrap_or(f64::INFINITY);

        self.below = counted(self.below, ratio < dip_ratio);
        self.above = counted(self.above, ratio > swell_ratio);
        let (below, above) = (self.below, self.above);
        let confirm = at.options.confirm_samples.max(1);
        self.latch(Trigger::VoltageDip)
            .update(below >= confirm, ratio < dip_ratio + hysteresis);
        self.latch(Trigger::VoltageSwell)
            .update(above >= confirm, ratio > swell_ratio - hysteresis);

        let disturbed = self.latch(Trigger::VoltageDip).active
            || self.latch(Trigger::VoltageSwell).active
            || ratio < dip_ratio
            || ratio > swell_ratio;
        if !disturbed && !at.window_open {
            let time_constant = at.options.reference_time_constant_s * at.rate_fps;
            reference.take(voltage_pu, time_constant);
        }
    }

    fn step(&mut self, history: &History, base: &Base, at: &Settings<'_>) {
        let Some(step_pu) = at.options.step_pu else {
            return;
        };
        let mut latest = history.voltages(0..at.counts.step);
        let count = latest.len() as f64;
        let Some(level_pu) = median(&mut latest) else {
            return;
        };
        let noise_pu = base.voltage_noise_pu
            * MEDIAN_PENALTY
            * (1.0 / count + 1.0 / base.voltages as f64).sqrt();
        let threshold_pu = step_pu.max(at.options.noise_factor * noise_pu);
        let change_pu = (level_pu - base.voltage_pu).abs();
        self.latch(Trigger::VoltageStep).update(
            change_pu > threshold_pu,
            change_pu > STEP_RELEASE * threshold_pu,
        );
    }

    fn phase_jump(&mut self, history: &History, base: &Base, at: &Settings<'_>) {
        let (Some(jump_deg), Some(base)) = (at.options.phase_jump_deg, &base.frequency) else {
            return;
        };
        if !base.has_trend {
            return;
        }
        let (mut sum_hz, mut count) = (0.0, 0.0);
        for back in 0..at.counts.step {
            if let Some(frequency_hz) = history.back(back).and_then(trigger_frequency) {
                sum_hz += frequency_hz - base.at(back);
                count += 1.0;
            }
        }
        let degrees_per_hz = 360.0 / at.rate_fps;
        let noise_deg = base.noise_hz * f64::sqrt(count) * degrees_per_hz;
        let threshold_deg = jump_deg.max(at.options.noise_factor * noise_deg);
        let angle_deg = (sum_hz * degrees_per_hz).abs();
        // One sample is a spike, not a jump.
        self.latch(Trigger::PhaseJump).update(
            angle_deg > threshold_deg && deviating(history, base, at) > 1,
            angle_deg > STEP_RELEASE * threshold_deg,
        );
    }

    fn frequency(&mut self, history: &History, at: &Settings<'_>) {
        let Some(deviation_hz) = at.options.frequency_deviation_hz else {
            return;
        };
        // Over as long as the rate of change, so that a phase jump leaves no trace here either.
        let mut latest = history.frequencies(0..at.counts.rocof_half);
        if latest.len() < 3 {
            return;
        }
        let Some(frequency_hz) = median(&mut latest) else {
            return;
        };
        let distance_hz = (frequency_hz - at.nominal_hz).abs();
        self.latch(Trigger::FrequencyExcursion).update(
            distance_hz > deviation_hz,
            distance_hz > FREQUENCY_RELEASE * deviation_hz,
        );
    }

    fn rate_of_change(&mut self, history: &History, at: &Settings<'_>) {
        let Some(rocof_hz_per_s) = at.options.rocof_hz_per_s else {
            return;
        };
        let half = at.counts.rocof_half;
        let mut late = history.frequencies(0..half);
        let mut early = history.frequencies(half..2 * half);
        if late.len().min(early.len()) < half.div_ceil(2).max(3) {
            return;
        }
        let (Some(late), Some(early)) = (median(&mut late), median(&mut early)) else {
            return;
        };
        let rate_hz_per_s = (late - early).abs() / (half as f64 / at.rate_fps);
        self.latch(Trigger::RateOfChangeOfFrequency).update(
            rate_hz_per_s > rocof_hz_per_s,
            rate_hz_per_s > STEP_RELEASE * rocof_hz_per_s,
        );
    }
}

/// What the triggers need to know beside the samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settings<'a> {
    pub(super) options: &'a DetectorOptions,
    pub(super) counts: &'a Counts,
    pub(super) rate_fps: f64,
    pub(super) nominal_hz: f64,
    pub(super) window_open: bool,
}

fn counted(count: usize, again: bool) -> usize {
    if again { count.saturating_add(1) } else { 0 }
}

/// Samples within the step time whose frequency is off its trend by more than noise.
fn deviating(history: &History, base: &FrequencyBase, at: &Settings<'_>) -> usize {
    let tolerance_hz = frequency_tolerance_hz(base);
    (0..at.counts.step)
        .filter(|back| {
            history
                .back(*back)
                .and_then(trigger_frequency)
                .is_some_and(|f| (f - base.at(*back)).abs() > tolerance_hz)
        })
        .count()
}

/// Deviation from which a frequency is no longer noise, hertz: five standard deviations, and above
/// the resolution of the measurement.
pub(super) fn frequency_tolerance_hz(base: &FrequencyBase) -> f64 {
    (5.0 * base.noise_hz).max(0.005)
}

/// Deviation from which a voltage is no longer noise, pu: four standard deviations, and above a
/// fifth of the default step.
pub(super) fn voltage_tolerance_pu(base: &Base) -> f64 {
    (4.0 * base.voltage_noise_pu).max(0.001)
}
