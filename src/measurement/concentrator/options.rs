//! Settings of the concentrator.

use crate::measurement::Channel;

/// Settings of a concentrator. All times are times of the data, not of their arrival, so that a
/// replay at any speed is treated alike.
#[derive(Clone, Debug, PartialEq)]
pub struct ConcentratorOptions {
    /// How long an instant waits for what is still missing of it, seconds: it is released as soon
    /// as it is complete, else when newer data than this have arrived. Longer than the longest
    /// batch of a stream plus its jitter. Default 1, 0 to 60.
    pub lag_s: f64,
    /// A step of the stream's time by more than this, forwards or backwards, starts a new grid,
    /// seconds; shorter gaps are filled with missing samples. At least the lag time. Default 5,
    /// 0.1 to 60.
    pub gap_restart_s: f64,
    /// Samples per second of the grid; batches at another rate are then refused. Default none: the
    /// first batch decides, and a stream that changes its rate starts a new grid.
    pub rate_fps: Option<f64>,
    /// Optional channels that an instant waits for from the start. Voltage, frequency, P and Q are
    /// always waited for; angle and negative sequence are learnt when they arrive. Default none.
    pub expected: Vec<Channel>,
    /// Distance from the nearest grid point up to which a sample is put on it, as a share of the
    /// sampling period. Values are not interpolated. At 0.5 no sample is off
    /// the grid: for sources whose stamps are the moments of sending. Default 0.25, 0.01 to 0.5.
    pub grid_tolerance_share: f64,
    /// How long samples must have been off the grid, with none on it, until the grid starts anew
    /// where they are, seconds. Default 1, 0.1 to 60.
    pub off_grid_restart_s: f64,
}

impl ConcentratorOptions {
    /// Admissible range of `lag_s`.
    pub const LAG_S: (f64, f64) = (0.0, 60.0);
    /// Admissible range of `gap_restart_s`.
    pub const GAP_RESTART_S: (f64, f64) = (0.1, 60.0);
    /// Admissible range of `rate_fps`.
    pub const RATE_FPS: (f64, f64) = (1.0, 10_000.0);
    /// Admissible range of `grid_tolerance_share`.
    pub const GRID_TOLERANCE_SHARE: (f64, f64) = (0.01, 0.5);
    /// Admissible range of `off_grid_restart_s`.
    pub const OFF_GRID_RESTART_S: (f64, f64) = (0.1, 60.0);

    /// The nearest admissible settings; a value that is not a number becomes its default.
    #[must_use]
    pub(super) fn within_ranges(self) -> Self {
        let default = Self::default();
        let lag_s = nearest(self.lag_s, Self::LAG_S, default.lag_s);
        Self {
            lag_s,
            gap_restart_s: nearest(
                self.gap_restart_s,
                Self::GAP_RESTART_S,
                default.gap_restart_s,
            )
            .max(lag_s),
            rate_fps: self.rate_fps.filter(|rate| rate_is_admissible(*rate)),
            grid_tolerance_share: nearest(
                self.grid_tolerance_share,
                Self::GRID_TOLERANCE_SHARE,
                default.grid_tolerance_share,
            ),
            off_grid_restart_s: nearest(
                self.off_grid_restart_s,
                Self::OFF_GRID_RESTART_S,
                default.off_grid_restart_s,
            ),
            expected: self.expected,
        }
    }
}

impl Default for ConcentratorOptions {
    fn default() -> Self {
        Self {
            lag_s: 1.0,
            gap_restart_s: 5.0,
            rate_fps: None,
            expected: Vec::new(),
            grid_tolerance_share: 0.25,
            off_grid_restart_s: 1.0,
        }
    }
}

/// Whether a grid can have this rate, samples per second.
pub(super) fn rate_is_admissible(rate_fps: f64) -> bool {
    let (lowest, highest) = ConcentratorOptions::RATE_FPS;
    (lowest..=highest).contains(&rate_fps)
}

fn nearest(value: f64, (lowest, highest): (f64, f64), default: f64) -> f64 {
    if value.is_nan() {
        default
    } else {
        value.clamp(lowest, highest)
    }
}
