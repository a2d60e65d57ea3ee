//! Settings of the detector.

/// What a dip or swell is measured against (IEC 61000-4-30, 5.4.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum VoltageReference {
    /// The sliding reference: a first-order filter over undisturbed samples.
    #[default]
    Sliding,
    /// The declared voltage, 1 pu.
    Declared,
}

impl VoltageReference {
    /// Every reference.
    pub const ALL: [Self; 2] = [Self::Sliding, Self::Declared];

    /// Name in the configuration.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sliding => "sliding",
            Self::Declared => "declared",
        }
    }
}

/// Settings of a detector. A threshold of none switches its trigger off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DetectorOptions {
    /// Time kept before the onset, seconds. Default 2, 0 to 60.
    pub pre_trigger_s: f64,
    /// Time without any trigger after which a window is closed, seconds. Default 8, 0.1 to 600.
    pub post_trigger_s: f64,
    /// Longest window, seconds. Default 30, 1 to 3600.
    pub longest_s: f64,
    /// What dips and swells are measured against. Default [`VoltageReference::Sliding`].
    pub voltage_reference: VoltageReference,
    /// Time constant of the sliding reference, seconds. Default 60 (IEC 61000-4-30, 5.4.4), 1 to
    /// 3600.
    pub reference_time_constant_s: f64,
    /// A dip is a voltage below this share of the reference. Default 0.9 (IEC 61000-4-30), 0.1 to
    /// 0.999.
    pub dip_ratio: Option<f64>,
    /// A swell is a voltage above this share of the reference. Default 1.1 (IEC 61000-4-30), 1.001
    /// to 2.
    pub swell_ratio: Option<f64>,
    /// By how much the voltage must come back over the threshold for a dip or swell to end, share
    /// of the reference. Default 0.02 (IEC 61000-4-30), 0 to 0.2.
    pub hysteresis_ratio: f64,
    /// A voltage step is a difference by more than this between the medians over the step time and
    /// over the base time before it, pu. Default 0.005: half of a common tap or capacitor step.
    /// 0.0005 to 0.5.
    pub step_pu: Option<f64>,
    /// A phase jump is an angle by more than this that the frequency's deviation from its own trend
    /// adds up to within the step time, degrees. Default 0.3: line switching turns the angle by
    /// more, 5 mHz of oscillation by less. 0.01 to 90.
    pub phase_jump_deg: Option<f64>,
    /// Time within which a step or jump happens, seconds. Default 0.1, 0.02 to 10.
    pub step_time_s: f64,
    /// Time before it from which level, trend and noise are taken, seconds. Default 1, 0.1 to 60.
    pub base_time_s: f64,
    /// Noise: a step or jump must exceed this many standard deviations of its own estimate.
    /// Default 6, 3 to 100.
    pub noise_factor: f64,
    /// A frequency excursion is a distance from nominal by more than this, hertz, of the median over
    /// half of `rocof_time_s`; it ends at 0.8 of the distance. Default 0.2: the largest steady deviation of the European synchronous area. 0.005 to 10.
    pub frequency_deviation_hz: Option<f64>,
    /// A rate of change of frequency above this is a trigger, hertz per second; it ends at half of
    /// it. Default 0.25, 0.01 to
    /// 100.
    pub rocof_hz_per_s: Option<f64>,
    /// Time over which the rate of change is taken, seconds: the difference of the medians of its
    /// two halves, so that spikes and phase jumps shorter than a quarter of it leave no trace.
    /// Default 0.5, 0.1 to 10.
    pub rocof_time_s: f64,
    /// Successive usable samples that must be in a dip or swell. Default 2: one wild sample is no
    /// disturbance. 1 to 20.
    pub confirm_samples: usize,
}

impl DetectorOptions {
    /// Admissible range of `pre_trigger_s`.
    pub const PRE_TRIGGER_S: (f64, f64) = (0.0, 60.0);
    /// Admissible range of `post_trigger_s`.
    pub const POST_TRIGGER_S: (f64, f64) = (0.1, 600.0);
    /// Admissible range of `longest_s`.
    pub const LONGEST_S: (f64, f64) = (1.0, 3600.0);
    /// Admissible range of `reference_time_constant_s`.
    pub const REFERENCE_TIME_CONSTANT_S: (f64, f64) = (1.0, 3600.0);
    /// Admissible range of `dip_ratio`.
    pub const DIP_RATIO: (f64, f64) = (0.1, 0.999);
    /// Admissible range of `swell_ratio`.
    pub const SWELL_RATIO: (f64, f64) = (1.001, 2.0);
    /// Admissible range of `hysteresis_ratio`.
    pub const HYSTERESIS_RATIO: (f64, f64) = (0.0, 0.2);
    /// Admissible range of `step_pu`.
    pub const STEP_PU: (f64, f64) = (0.0005, 0.5);
    /// Admissible range of `phase_jump_deg`.
    pub const PHASE_JUMP_DEG: (f64, f64) = (0.01, 90.0);
    /// Admissible range of `step_time_s`.
    pub const STEP_TIME_S: (f64, f64) = (0.02, 10.0);
    /// Admissible range of `base_time_s`.
    pub const BASE_TIME_S: (f64, f64) = (0.1, 60.0);
    /// Admissible range of `noise_factor`.
    pub const NOISE_FACTOR: (f64, f64) = (3.0, 100.0);
    /// Admissible range of `frequency_deviation_hz`.
    pub const FREQUENCY_DEVIATION_HZ: (f64, f64) = (0.005, 10.0);
    /// Admissible range of `rocof_hz_per_s`.
    pub const ROCOF_HZ_PER_S: (f64, f64) = (0.01, 100.0);
    /// Admissible range of `rocof_time_s`.
    pub const ROCOF_TIME_S: (f64, f64) = (0.1, 10.0);
    /// Admissible range of `confirm_samples`.
    pub const CONFIRM_SAMPLES: (usize, usize) = (1, 20);
}

impl Default for DetectorOptions {
    fn default() -> Self {
        Self {
            pre_trigger_s: 2.0,
            post_trigger_s: 8.0,
            longest_s: 30.0,
            voltage_reference: VoltageReference::Sliding,
            reference_time_constant_s: 60.0,
            dip_ratio: Some(0.9),
            swell_ratio: Some(1.1),
            hysteresis_ratio: 0.02,
            step_pu: Some(0.005),
            phase_jump_deg: Some(0.3),
            step_time_s: 0.1,
            base_time_s: 1.0,
            noise_factor: 6.0,
            frequency_deviation_hz: Some(0.2),
            rocof_hz_per_s: Some(0.25),
            rocof_time_s: 0.5,
            confirm_samples: 2,
        }
    }
}

/// The settings counted in samples of one grid. Every count is bounded, whatever the settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Counts {
    pub(super) pre: usize,
    pub(super) post: usize,
    pub(super) longest: usize,
    pub(super) step: usize,
    pub(super) base: usize,
    pub(super) rocof_half: usize,
    /// How far back from the sample that met a trigger the onset may lie.
    pub(super) lookback: usize,
    /// Samples to remember while no window is open.
    pub(super) memory: usize,
}

impl Counts {
    pub(super) fn new(options: &DetectorOptions, rate_fps: f64) -> Self {
        let step = samples(options.step_time_s, rate_fps).max(3);
        let base = samples(options.base_time_s, rate_fps).max(5);
        let rocof_half = samples(options.rocof_time_s / 2.0, rate_fps).max(3);
        let longest = samples(options.longest_s, rate_fps).max(2);
        let pre = samples(options.pre_trigger_s, rate_fps).min(longest / 2);
        let lookback = step
            + options
                .confirm_samples
                .min(DetectorOptions::CONFIRM_SAMPLES.1)
            + 2;
        Self {
            pre,
            post: samples(options.post_trigger_s, rate_fps).max(1),
            longest,
            step,
            base,
            rocof_half,
            lookback,
            memory: (pre + lookback + 1)
                .max(step + base + lookback)
                .max(2 * rocof_half),
        }
    }
}

/// Samples in a duration; at most an hour's at 10 kHz, so that no setting can ask for more memory
/// than there is.
fn samples(seconds: f64, rate_fps: f64) -> usize {
    const MOST: f64 = 3.6e7;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to 0 to 3.6e7; a value that is not a number becomes 0"
    )]
    let count = (seconds * rate_fps).round().clamp(0.0, MOST) as usize;
    count
}
